"""What an owner asks of both arms, said once: the blocking and the asyncio control only add how they wait."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Generic, TypeVar

from gateway.api import protocol
from gateway.client.asking.chunks import Tolerance, Wishes
from gateway.client.asking.ownership import Accepted, Ownership
from gateway.client.asking.poses import PoseLike
from gateway.client.asking.procedures import Procedure

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["DoneT", "HandleT", "MotionCommands"]

HandleT = TypeVar("HandleT")
"""A motion that was accepted: a `MotionHandle`, under asyncio what gives one when it is awaited."""

DoneT = TypeVar("DoneT")
"""That something was done: None, under asyncio what is awaited for it."""


class MotionCommands(Ownership, Generic[HandleT, DoneT]):
    """What a control does with both arms. Under asyncio everything here is awaited; arguments and errors are the same."""

    @abstractmethod
    def _do(self, procedure: Procedure[None]) -> DoneT:
        """Wait for the end of a procedure."""

    @abstractmethod
    def _begin(self, procedure: Procedure[Accepted]) -> HandleT:
        """Wait until a motion was accepted."""

    def release(self) -> DoneT:
        """Brake, rest, pause the robot, and give the lease back. Nothing happens when it is already gone.

        Raises:
            GatewayTimeout: The robot did not come to rest in time; it is still braking or pausing.
        """
        return self._do(self._release())

    def leave(self) -> DoneT:
        """Leave the robot held, as if this client had vanished: held for 60 s, free for others after 10 s."""
        return self._do(self._leave())

    def enable(self, timeout: float = 12.0) -> DoneT:
        """Bring the robot's FSM to READY; the arms are held where they are. Waits until it is there.

        Args:
            timeout: How long to wait [s]; the daemon itself gives up after 10 s and says what was missing.

        Raises:
            NotReady: What stands against it (mode, disabled arm, latch, stale state ...), at once or after 10 s.
            GatewayTimeout: Neither in time.
        """
        return self._do(self._enable(timeout))

    def disable(self, timeout: float = 10.0) -> DoneT:
        """Brake to rest and pause the robot's FSM; the grip is lost, the lease stays. Waits until it is done.

        Raises:
            GatewayTimeout: Not in time; it goes on.
        """
        return self._do(self._disable(timeout))

    def hold(self) -> DoneT:
        """Brake both arms and hold them; ends their motions as cancelled, and their streams."""
        return self._do(self._hold())

    def move_to(
        self,
        targets: Mapping[str, ArrayLike],
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
        until: protocol.Until | None = None,
    ) -> HandleT:
        """Move one or both arms to joint positions, smoothly, all joints ending together. Does not wait for the end.

        Args:
            targets: Per side (`left`, `right`) seven joints [rad], in the order of manual §4.0.3.
            speed: Factor on the velocity limit, 0 < speed <= 1.
            tolerance: Reached when every joint is measured within this of its goal [rad]; None for the configured one.
            on_limit: `reject` refuses a goal outside the limits, `clip` moves it to the limit and reports it.
            until: A touch at which it ends before its goal, by the daemon's estimate: `contact(force_n=8)`. The arm brakes
                within the tick, and goes back if that was asked for; `result().touch` has the touch. Not a safety function.

        Returns:
            The motion, accepted and under way.

        Raises:
            Rejected: The goal is wrong: WRONG_SHAPE, NOT_FINITE, OUT_OF_RANGE with joint, value and bound.
            NotReady: The robot or the gateway is not in a state for it; with `until` MODEL_OFF or CONTACT_UNKNOWN, where a
                touch would not be felt.
            Aborted: CONTACT, the hand was touched half a second ago, or goes back, and nobody has been told so yet.
            LeaseError: This control is over.
        """
        return self._begin(self._move(targets, False, speed, tolerance, on_limit, until))

    def move_by(
        self,
        offsets: Mapping[str, ArrayLike],
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
        until: protocol.Until | None = None,
    ) -> HandleT:
        """Move one or both arms by offsets from where they are being held [rad]; else as `move_to`."""
        return self._begin(self._move(offsets, True, speed, tolerance, on_limit, until))

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
        until: protocol.Until | None = None,
    ) -> HandleT:
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
            until: A touch at which it ends before its last point; see `move_to`. Each chunk needs its own.

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
            "until": until,
        }
        return self._begin(self._follow(points, dt, wishes))

    def move_pose(
        self,
        targets: Mapping[str, PoseLike],
        *,
        speed: float = 1.0,
        tolerance_m: float | None = None,
        tolerance_rad: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
        until: protocol.Until | None = None,
    ) -> HandleT:
        """Move one or both end effectors to poses, all ending together. Does not wait for the end.

        Arms in end-effector mode (`state.mode`, manual §2.3) go straight, by the robot's own kinematics. Arms in joint mode
        go by the gateway's model of the body, and only while that agrees with the robot: to the joints for the pose that are
        nearest to where they are, as they like (`move_linear` goes straight). All arms of one motion must be in one mode.

        Args:
            targets: Per side (`left`, `right`) a `PoseTarget`, or a measured pose: position, orientation and frame.
            speed: Factor on the velocity limits, 0 < speed <= 1.
            tolerance_m: Reached when the position is measured within this of the goal [m]; None for the configured one ...
            tolerance_rad: ... and the orientation within this [rad].
            on_limit: `reject` refuses a position beyond the reach, `clip` moves it to its end and reports it.
            until: A touch at which it ends before its goal; see `move_to`.

        Returns:
            The motion, accepted and under way; the same handle as that of `move_to`.

        Raises:
            Rejected: The goal is wrong: WRONG_SHAPE, NOT_FINITE, OUT_OF_RANGE, WRONG_FRAME, with value and bound.
            NotReady: The robot or the gateway is not in a state for it; MODEL_OFF, MODEL_UNKNOWN or MODEL_DIFFERS for an arm
                in joint mode, WRONG_CONTROL_MODE for arms in different modes.
            LeaseError: This control is over.
        """
        return self._begin(self._move_pose(targets, False, speed, tolerance_m, tolerance_rad, on_limit, until))

    def move_linear(
        self,
        targets: Mapping[str, PoseLike],
        *,
        speed: float = 1.0,
        tolerance_m: float | None = None,
        tolerance_rad: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
        until: protocol.Until | None = None,
    ) -> HandleT:
        """Move one or both end effectors straight to poses, in either control mode; else as `move_pose`.

        The position goes along a straight line, the orientation the shorter way about one axis, on one clock. In joint mode
        the arms come to rest first; the whole way is worked out (some tenths of a second, in which the motion is `queued`)
        and nothing moves unless all of it can be: joints inside their limits, no part of the body too near to another where
        that is watched, slowed down where joints need it. Else it ends as Aborted: `result` tells the first place that
        cannot be, with value and bound (NO_STRAIGHT_WAY, COLLISION_AHEAD). A pose at which a hand would be too near to
        something is refused at once (GOAL_TOO_NEAR). The model must agree with the robot to the end: MODEL_DIFFERS or
        MODEL_UNKNOWN end it as well, and the arms brake.
        """
        return self._begin(self._move_pose(targets, True, speed, tolerance_m, tolerance_rad, on_limit, until))
