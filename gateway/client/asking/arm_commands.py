"""What an owner asks of one arm, said once for the blocking and the asyncio control, as `commands` for both arms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, Literal, TypeVar, overload

from gateway.api import protocol
from gateway.client.asking.chunks import Tolerance
from gateway.client.asking.commands import DoneT, HandleT, MotionCommands
from gateway.client.asking.poses import Axes, PoseLike, PoseTarget, admittance, frame_of, require_space
from gateway.client.asking.stream import JointTargets, PoseTargets, StreamOptions

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["ArmCommands"]

JointStreamT = TypeVar("JointStreamT", bound=JointTargets)
PoseStreamT = TypeVar("PoseStreamT", bound=PoseTargets)


class ArmCommands(Generic[HandleT, DoneT, JointStreamT, PoseStreamT]):
    """One arm of a control."""

    _joint_stream: type[JointStreamT]
    _pose_stream: type[PoseStreamT]

    def __init__(self, control: MotionCommands[HandleT, DoneT], side: protocol.SideName) -> None:
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
        until: protocol.Until | None = None,
    ) -> HandleT:
        """Move this arm to seven joint positions [rad]; see `Control.move_to`."""
        return self._control._begin(self._control._move({self.side: q}, False, speed, tolerance, on_limit, until))

    def move_by(
        self,
        dq: ArrayLike,
        *,
        speed: float = 1.0,
        tolerance: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
        until: protocol.Until | None = None,
    ) -> HandleT:
        """Move this arm by seven joint offsets [rad]; see `Control.move_to`."""
        return self._control._begin(self._control._move({self.side: dq}, True, speed, tolerance, on_limit, until))

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
        until: protocol.Until | None = None,
    ) -> HandleT:
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
            until=until,
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
        until: protocol.Until | None = None,
    ) -> HandleT:
        """Move this arm's end effector to a pose in its own shoulder frame; see `Control.move_pose`.

        Args:
            p: Position [m], shape (3,).
            quat_xyzw: Orientation, norm 1, shape (4,); either sign.
            frame: `left_shoulder_base` or `right_shoulder_base`: that of this arm (manual §4.0.1).
            speed: Factor on the velocity limits, 0 < speed <= 1.
            tolerance_m: Reached when the position is measured within this of the goal [m]; None for the configured one ...
            tolerance_rad: ... and the orientation within this [rad].
            on_limit: `reject` or `clip`.
            until: A touch at which it ends before its goal; see `Control.move_to`.
        """
        target: dict[str, PoseLike] = {self.side: PoseTarget(p, quat_xyzw, frame)}
        return self._control._begin(
            self._control._move_pose(target, False, speed, tolerance_m, tolerance_rad, on_limit, until)
        )

    def move_linear(
        self,
        p: ArrayLike,
        quat_xyzw: ArrayLike,
        *,
        frame: str,
        speed: float = 1.0,
        tolerance_m: float | None = None,
        tolerance_rad: float | None = None,
        on_limit: protocol.OnLimitName = "reject",
        until: protocol.Until | None = None,
    ) -> HandleT:
        """Move this arm's end effector straight to a pose, in either control mode; see `Control.move_linear`.

        Arguments as in `move_pose`.
        """
        target: dict[str, PoseLike] = {self.side: PoseTarget(p, quat_xyzw, frame)}
        return self._control._begin(
            self._control._move_pose(target, True, speed, tolerance_m, tolerance_rad, on_limit, until)
        )

    def hold(self) -> DoneT:
        """Brake this arm and hold it; ends its motion as cancelled, or its stream."""
        return self._control._do(self._control._hold((protocol.Side(self.side),)))

    @overload
    def stream(
        self,
        space: Literal["joint"] = "joint",
        rate_hz: float = 50.0,
        *,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
        paced: bool = True,
        until: protocol.Until | None = None,
    ) -> JointStreamT: ...

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
        paced: bool = True,
        until: protocol.Until | None = None,
    ) -> PoseStreamT: ...

    @overload
    def stream(
        self,
        space: Literal["admittance"],
        rate_hz: float = 50.0,
        *,
        frame: str,
        mass_kg: Axes = None,
        damping: Axes = 0.0,
        stiffness: Axes = 0.0,
        inertia_kgm2: Axes = None,
        turn_damping: Axes = 0.0,
        turn_stiffness: Axes = 0.0,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
        paced: bool = True,
    ) -> PoseStreamT: ...

    def stream(
        self,
        space: protocol.SpaceName | Literal["admittance"] = "joint",
        rate_hz: float = 50.0,
        *,
        frame: str | None = None,
        mass_kg: Axes = None,
        damping: Axes = 0.0,
        stiffness: Axes = 0.0,
        inertia_kgm2: Axes = None,
        turn_damping: Axes = 0.0,
        turn_stiffness: Axes = 0.0,
        speed: float = 1.0,
        on_limit: protocol.OnLimitName = "reject",
        expiry: float | None = None,
        paced: bool = True,
        until: protocol.Until | None = None,
    ) -> JointStreamT | PoseStreamT:
        """Return a stream of targets for this arm, to be used in a `with` block.

        A stream of `admittance` lets the hand yield to what pushes it, as a virtual mass would with a damper and a spring to
        an anchor: where the hand is when it begins, or what `set` said last. `tick` says that somebody is there. Axes are those
        of the shoulder frame; each argument is a number for all three, or three. It is an experiment on a real robot.

        Args:
            space: `joint`, or `pose` for an arm in end-effector mode; `admittance` for one that feels (`[model] dynamics`).
            rate_hz: Rate of `tick` [Hz], 1 to 100; targets may also be set without ticking.
            frame: Of poses: `left_shoulder_base` or `right_shoulder_base`, that of this arm (manual §4.0.1).
            mass_kg: Virtual mass [kg], 1 to 30; None locks an axis.
            damping: What a velocity takes [N·s/m], 150 to 2000.
            stiffness: Of the spring [N/m], at most damping² / (4 mass); 0 for none: the hand stays where it is let go.
            inertia_kgm2: The same about the axes: virtual inertia [kg·m²], 0.02 to 1; None locks one, and is the default ...
            turn_damping: ... damping [N·m·s/rad], 15 to 100 ...
            turn_stiffness: ... and spring [N·m/rad]. A hand turns by at most 1 rad from its anchor.
            speed: Factor on the velocity limit, 0 < speed <= 1.
            on_limit: `reject` refuses a target outside the limits, `clip` moves it to the limit.
            expiry: A target that has no successor for so long makes the arm brake and hold [s], 0.05 to 3; None for
                the configured time (1.5 s).
            paced: Whether `tick` returns where the next target is just in time for a setpoint, at the same average rate;
                False keeps a grid of even intervals, and a target waits for up to a setpoint's period.
            until: A touch at which the stream ends (`contact()`): the next `tick` or `check` raises Aborted, CONTACT, and
                `touch` has it.

        Raises:
            Rejected: WRONG_FRAME, a stream of poses without a frame, or in another arm's; OUT_OF_RANGE, the rate;
                WRONG_SHAPE, neither one nor three numbers. The `with` block raises what the daemon refuses.
        """
        require_space(space, yields=mass_kg is not None or inertia_kgm2 is not None)
        owner = self._control
        how = StreamOptions(rate_hz=rate_hz, speed=speed, on_limit=on_limit, expiry=expiry, paced=paced, until=until)
        if space == "joint":
            return self._joint_stream(owner._session, owner._owned(), self.side, how)
        wish = None
        if space == "admittance":
            wish = admittance(
                {"mass_kg": mass_kg, "damping": damping, "stiffness": stiffness},
                {"inertia_kgm2": inertia_kgm2, "turn_damping": turn_damping, "turn_stiffness": turn_stiffness},
            )
        return self._pose_stream(owner._session, owner._owned(), self.side, how, frame_of(self.side, frame), wish)
