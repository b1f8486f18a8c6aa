"""Owning the robot: `with robot.control() as own`, its arms, motions and streams. The blocking half of `client`."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Literal, overload

from gateway.api import protocol
from gateway.client.blocking import run
from gateway.client.chunks import Tolerance, Wishes
from gateway.client.door import OnExitName
from gateway.client.handles import JointStream, MotionHandle, PoseStream
from gateway.client.ownership import Ownership
from gateway.client.parts import ChassisControl, GripperControl, LiftControl
from gateway.client.poses import PoseLike, PoseTarget, frame_of, require_space
from gateway.client.session import Session
from gateway.client.stream import StreamOptions

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["ArmControl", "Control", "JointStream", "MotionHandle", "PoseStream"]


class Control(Ownership):
    """The right to command the robot. Made by `Robot.control`; use it in a `with` block.

    Attributes:
        left_arm: The left arm.
        right_arm: The right arm.
        left_gripper: The left gripper.
        right_gripper: The right gripper.
        chassis: The chassis.
        lift: The lift, on the model that has one.
    """

    def __init__(
        self,
        session: Session,
        on_loss: protocol.OnLossName,
        on_exit: OnExitName,
        take: str | None,
        timeout_ns: int,
    ) -> None:
        super().__init__(session, on_loss, on_exit, take, timeout_ns)
        self.left_arm = ArmControl(self, "left")
        self.right_arm = ArmControl(self, "right")
        self.left_gripper = GripperControl(self, "left")
        self.right_gripper = GripperControl(self, "right")
        self.chassis = ChassisControl(self)
        self.lift = LiftControl(self)

    def acquire(self) -> Control:
        """Become the owner; what `with` does.

        Raises:
            LeaseError: LEASE_HELD, somebody else owns the robot; the message says who and since when.
        """
        run(self._session, self._acquire())
        return self

    def release(self) -> None:
        """Brake, rest, pause the robot, and give the lease back. Nothing happens when it is already gone.

        Raises:
            GatewayTimeout: The robot did not come to rest in time; it is still braking or pausing.
        """
        run(self._session, self._release())

    def leave(self) -> None:
        """Leave the robot held, as if this client had vanished: held for 60 s, free for others after 10 s."""
        run(self._session, self._leave())

    def __enter__(self) -> Control:
        return self.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            run(self._session, self._end())
        else:
            self._break_off()

    def enable(self, timeout: float = 12.0) -> None:
        """Bring the robot's FSM to READY; the arms are held where they are. Waits until it is there.

        Args:
            timeout: How long to wait [s]; the daemon itself gives up after 10 s and says what was missing.

        Raises:
            NotReady: What stands against it (mode, disabled arm, latch, stale state ...), at once or after 10 s.
            GatewayTimeout: Neither in time.
        """
        run(self._session, self._enable(timeout))

    def disable(self, timeout: float = 10.0) -> None:
        """Brake to rest and pause the robot's FSM; the grip is lost, the lease stays. Waits until it is done.

        Raises:
            GatewayTimeout: Not in time; it goes on.
        """
        run(self._session, self._disable(timeout))

    def hold(self) -> None:
        """Brake both arms and hold them; ends their motions as cancelled, and their streams."""
        run(self._session, self._hold())

    def move_to(
        self,
        targets: Mapping[str, ArrayLike],
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both arms to joint positions, smoothly, all joints ending together. Does not wait for the end.

        Args:
            targets: Per side (`left`, `right`) seven joints [rad], in the order of manual §4.0.3.
            speed: Factor on the velocity limit, 0 < speed <= 1.
            tolerance: Reached when every joint is measured within this of its goal [rad]; None for the configured one.
            on_limit: `reject` refuses a goal outside the limits, `clip` moves it to the limit and reports it.

        Returns:
            The motion, accepted and under way.

        Raises:
            Rejected: The goal is wrong: WRONG_SHAPE, NOT_FINITE, OUT_OF_RANGE with joint, value and bound.
            NotReady: The robot or the gateway is not in a state for it.
            LeaseError: This control is over.
        """
        return MotionHandle(*run(self._session, self._move(targets, False, speed, tolerance, on_limit)))

    def move_by(
        self,
        offsets: Mapping[str, ArrayLike],
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both arms by offsets from where they are being held [rad]; else as `move_to`."""
        return MotionHandle(*run(self._session, self._move(offsets, True, speed, tolerance, on_limit)))

    def follow(
        self,
        points: Mapping[str, ArrayLike],
        dt: float | None = None,
        *,
        frames: Mapping[str, str] | None = None,
        times: ArrayLike | None = None,
        start_at: float | None = None,
        start_in: float | None = None,
        open_end: bool = False,
        stretch: float = 1.0,
        smoothing: float = 0.0,
        path_tolerance: Tolerance = None,
        goal_tolerance: Tolerance = None,
        goal_time: float | None = None,
    ) -> MotionHandle:
        """Follow points with one or both arms on one clock: a trajectory, or an action chunk of a policy.

        The motion is the smooth one through the points (cubic, continuous in velocity and acceleration). All of it is
        judged before it begins; nothing is clipped. The arms get onto it from whatever they do, and a later chunk
        takes over without a stop. Does not wait for the end.

        Args:
            points: Per side (`left`, `right`) shape (N, 7), N from 2 to 450, the same for both: joints [rad] in the order
                of manual §4.0.3, or with `frames` poses x, y, z [m], qx, qy, qz, qw.
            dt: Time from point to point [s]; the first is passed at 0. Either this or `times`.
            frames: Per side the frame of poses, `left_shoulder_base` or `right_shoulder_base`; None for joints.
            times: When each point is passed, shape (N,), rising, from 0 on [s].
            start_at: When time 0 is, as `time.monotonic()` of the daemon's host [s]: of the observation that a policy
                worked from, say. Points whose time has passed are skipped. It may be up to 10 s ahead: until then the
                arm goes on with the chunk it follows. None for `start_in`.
            start_in: The same, counted from the arrival of the request [s], negative for the past; None for now.
            open_end: Whether it ends at speed because another chunk will follow; when none does, the motion ends with
                UNDERRUN and the arm brakes and holds. Else it ends at rest at the last point.
            stretch: Factor by which all of it becomes slower, 1 to 100; a refusal says which would do.
            smoothing: Averages jitter over so much time on each side of a point [s], 0 to 1; needs `dt`.
            path_tolerance: Aborts when a joint is measured farther than this from the motion once it is on it [rad];
                one for all or seven; of poses two, position and orientation [m, rad]. None for no tolerance of its
                own. The arm lags its setpoints by some 50 ms; poses are followed within some millimetres
                (about 15 at full speed and acceleration).
            goal_tolerance: Reached when every joint is measured within this of the last point [rad]; one for all or
                seven, of poses two; None for the configured one.
            goal_time: How long after its end that may take [s]; None for the configured time.

        Returns:
            The motion, accepted and under way. Its `result` raises Aborted with PATH_TOLERANCE, GOAL_TOLERANCE or
            UNDERRUN, and Superseded when a later chunk took over.

        Raises:
            Rejected: WRONG_SHAPE, NOT_FINITE, OUT_OF_RANGE, TOO_FAST, JUMP_TOO_FAR, TOO_LATE, CANNOT_JOIN: with the
                first point and joint to blame, value, bound and remedy.
            NotReady: The robot or the gateway is not in a state for it.
            LeaseError: This control is over.
        """
        wishes: Wishes = {
            "frames": frames,
            "times": times,
            "start_at": start_at,
            "start_in": start_in,
            "open_end": open_end,
            "stretch": stretch,
            "smoothing": smoothing,
            "path_tolerance": path_tolerance,
            "goal_tolerance": goal_tolerance,
            "goal_time": goal_time,
        }
        return MotionHandle(*run(self._session, self._follow(points, dt, wishes)))

    def move_pose(
        self,
        targets: Mapping[str, PoseLike],
        *,
        speed: float = 1.0,
        tolerance_m: float | None = None,
        tolerance_rad: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move one or both end effectors to poses, straight, all ending together. Does not wait for the end.

        For arms in end-effector mode (`state.mode`, manual §2.3).

        Args:
            targets: Per side (`left`, `right`) a `PoseTarget`, or a measured pose: position, orientation and frame.
            speed: Factor on the velocity limits, 0 < speed <= 1.
            tolerance_m: Reached when the position is measured within this of the goal [m]; None for the configured one ...
            tolerance_rad: ... and the orientation within this [rad].
            on_limit: `reject` refuses a position beyond the reach, `clip` moves it to its end and reports it.

        Returns:
            The motion, accepted and under way; the same handle as that of `move_to`.

        Raises:
            Rejected: The goal is wrong: WRONG_SHAPE, NOT_FINITE, OUT_OF_RANGE, WRONG_FRAME, with value and bound.
            NotReady: The robot or the gateway is not in a state for it; WRONG_CONTROL_MODE for an arm in joint mode.
            LeaseError: This control is over.
        """
        accepted = run(self._session, self._move_pose(targets, speed, tolerance_m, tolerance_rad, on_limit))
        return MotionHandle(*accepted)


class ArmControl:
    """One arm of a `Control`."""

    def __init__(self, control: Control, side: protocol.SideName) -> None:
        self._control = control
        self.side = side

    def __repr__(self) -> str:
        """Show which arm of which control."""
        return f"<{self.side} arm of {self._control!r}>"

    def move_to(
        self,
        q: ArrayLike,
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm to seven joint positions [rad]; see `Control.move_to`."""
        return self._control.move_to({self.side: q}, speed=speed, tolerance=tolerance, on_limit=on_limit)

    def move_by(
        self,
        dq: ArrayLike,
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm by seven joint offsets [rad]; see `Control.move_to`."""
        return self._control.move_by({self.side: dq}, speed=speed, tolerance=tolerance, on_limit=on_limit)

    def follow(
        self,
        points: ArrayLike,
        dt: float | None = None,
        *,
        frame: str | None = None,
        times: ArrayLike | None = None,
        start_at: float | None = None,
        start_in: float | None = None,
        open_end: bool = False,
        stretch: float = 1.0,
        smoothing: float = 0.0,
        path_tolerance: Tolerance = None,
        goal_tolerance: Tolerance = None,
        goal_time: float | None = None,
    ) -> MotionHandle:
        """Follow points with this arm, shape (N, 7), joints [rad] or with `frame` poses; see `Control.follow`."""
        return self._control.follow(
            {self.side: points},
            dt,
            frames=None if frame is None else {self.side: frame},
            times=times,
            start_at=start_at,
            start_in=start_in,
            open_end=open_end,
            stretch=stretch,
            smoothing=smoothing,
            path_tolerance=path_tolerance,
            goal_tolerance=goal_tolerance,
            goal_time=goal_time,
        )

    def move_pose(
        self,
        p: ArrayLike,
        quat_xyzw: ArrayLike,
        *,
        frame: str,
        speed: float = 1.0,
        tolerance_m: float | None = None,
        tolerance_rad: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
    ) -> MotionHandle:
        """Move this arm's end effector to a pose in its own shoulder frame; see `Control.move_pose`.

        Args:
            p: Position [m], shape (3,).
            quat_xyzw: Orientation, norm 1, shape (4,); either sign.
            frame: `left_shoulder_base` or `right_shoulder_base`: that of this arm (manual §4.0.1).
            speed: Factor on the velocity limits, 0 < speed <= 1.
            tolerance_m: Reached when the position is measured within this of the goal [m]; None for the configured one ...
            tolerance_rad: ... and the orientation within this [rad].
            on_limit: `reject` or `clip`.
        """
        return self._control.move_pose(
            {self.side: PoseTarget(p, quat_xyzw, frame)},
            speed=speed,
            tolerance_m=tolerance_m,
            tolerance_rad=tolerance_rad,
            on_limit=on_limit,
        )

    def hold(self) -> None:
        """Brake this arm and hold it; ends its motion as cancelled, or its stream."""
        run(self._control._session, self._control._hold((self.side,)))

    @overload
    def stream(
        self,
        space: Literal["joint"] = "joint",
        rate_hz: float = 50.0,
        *,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
    ) -> JointStream: ...

    @overload
    def stream(
        self,
        space: Literal["pose"],
        rate_hz: float = 50.0,
        *,
        frame: str,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
    ) -> PoseStream: ...

    def stream(
        self,
        space: protocol.SpaceName = "joint",
        rate_hz: float = 50.0,
        *,
        frame: str | None = None,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
    ) -> JointStream | PoseStream:
        """Return a stream of targets for this arm, to be used in a `with` block.

        Args:
            space: `joint`, or `pose` for an arm in end-effector mode.
            rate_hz: Rate of `tick` [Hz], 1 to 100; targets may also be set without ticking.
            frame: Of poses: `left_shoulder_base` or `right_shoulder_base`, that of this arm (manual §4.0.1).
            speed: Factor on the velocity limit, 0 < speed <= 1.
            on_limit: `reject` refuses a target outside the limits, `clip` moves it to the limit.
            expiry: A target that has no successor for so long makes the arm brake and hold [s], 0.05 to 3; None for
                the configured time (1.5 s).

        Raises:
            Rejected: WRONG_FRAME, a stream of poses without a frame, or in another arm's; OUT_OF_RANGE, the rate.
        """
        require_space(space)
        owner, how = self._control, StreamOptions(rate_hz=rate_hz, speed=speed, on_limit=on_limit, expiry=expiry)
        if space == "joint":
            return JointStream(owner._session, owner._owned(), self.side, how)
        return PoseStream(owner._session, owner._owned(), self.side, how, frame_of(self.side, frame))
