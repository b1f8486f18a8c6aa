"""A pair whose hands are pushed as a test says: engine and simulated robot, and a stand-in for what is felt."""

from __future__ import annotations

from gateway.core.output.view import build
from gateway.core.robot_state.body_model import body_model
from gateway.messages.body_views import ContactView
from gateway.messages.incoming import Until
from gateway.messages.requests import Move
from gateway.messages.snapshot import MotionView, Snapshot, TouchView
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import CURRENT_MODE, FSM_STATE, arm_state, ee_pose
from gateway.settings.settings import LocalSettings, ModelSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side, Vector
from tests.pair import COMPLIANCE_RADPNM, MS, Pair

__all__ = ["LEFT", "RIGHT", "UP", "Pushed", "PushedPair", "felt"]

LEFT, RIGHT = Side.LEFT, Side.RIGHT
TOPICS = (*map(arm_state, Side), *map(ee_pose, Side), FSM_STATE, CURRENT_MODE)
"""What matters here: fewer topics make it cheaper."""
UP = Until(force_n=8.0, direction=(0.0, 0.0, 1.0))
"""A table under the hand."""


def felt(*force_n: float | None, sd_n: float = 2.0) -> ContactView:
    """Return that a hand is pushed so [N]; None for an axis that is not felt."""
    wrench, sd = (*force_n, 0.1, 0.2, 0.3), tuple(None if force is None else sd_n for force in force_n)
    frame, point = "left_shoulder_base", "left_ee"
    return ContactView(state="known", frame=frame, point=point, wrench=wrench, wrench_sd=(*sd, 0.1, 0.1, 0.1))


class Pushed:
    """What is felt, per arm; in place of `Contacts`."""

    def __init__(self) -> None:
        self.views = dict.fromkeys(Side, felt(0.0, 0.0, 0.0))

    def hear(self, *_: object) -> None:
        """Efforts do not matter here."""

    def forget(self) -> None:
        """Nor does what was before."""

    def view(self, side: Side, now_ns: int) -> ContactView:
        """Return what is felt."""
        return self.views[side]


class PushedPair(Pair):
    """An engine that feels what it is told, ACTIVE, with both arms at the home of §6.6.

    Args:
        bound_n: The gateway's own bound on what the left hand is pushed with [N]; 0 for none.
        right_mode: `joint` or `pose`.
    """

    def __init__(self, bound_n: float = 0.0, right_mode: str = "joint") -> None:
        settings = Settings(
            model=ModelSettings(dynamics=True, left_touch_n=bound_n), local=LocalSettings(snapshot_hz=1.0)
        )
        model = body_model(settings)
        assert model is not None
        self.pushed = Pushed()
        setattr(model, "contacts", self.pushed)  # noqa: B010  it tells what it is told, and is no observer
        sim = SimSettings(
            state_period_ns=10 * MS,
            compliance_radpnm=COMPLIANCE_RADPNM,
            right_mode=right_mode,
            start_rad={side: HOME_Q_RAD[side] for side in Side},
        )
        super().__init__(settings, sim, model=model)
        self.topics = TOPICS
        self.epoch = self.activate()

    def see(self) -> Snapshot:
        """Return a snapshot of this instant; no time passes."""
        return build(self.engine._coordinator, (), {}, self.engine._pace.view(0), 1, self.now_ns, {})

    def push(self, *force_n: float | None, side: Side = LEFT, sd_n: float = 2.0) -> None:
        """Push a hand from now on [N]."""
        self.pushed.views[side] = felt(*force_n, sd_n=sd_n)

    def deafen(self, side: Side = LEFT) -> None:
        """Nothing is known of an arm any more."""
        self.pushed.views[side] = ContactView(state="unknown", code="NO_EFFORTS", reason="the robot sends none")

    def goal(self, side: Side = LEFT, by_rad: float = 0.4) -> Vector:
        """Return the arm's home with its first joint elsewhere."""
        first, *others = HOME_Q_RAD[side]
        return (first + by_rad, *others)

    def to(self, by_rad: float = 0.4, until: Until | None = UP, side: Side = LEFT) -> Move:
        """Return a motion of one arm by its first joint."""
        return Move(epoch=self.epoch, targets_rad={side: self.goal(side, by_rad)}, until=until)

    def begun(self, *, until: Until | None = UP, seconds: float = 0.5) -> int:
        """Begin a motion, and let it be under way; return its id."""
        motion_id = self.granted(self.to(until=until))["motion_id"]
        self.run(seconds)
        assert isinstance(motion_id, int) and not self.is_at_rest
        return motion_id

    def motion_view(self, motion_id: int) -> MotionView:
        """Return what a snapshot of now says of a motion."""
        return next(motion for motion in self.see().motions if motion.motion_id == motion_id)

    @property
    def touch(self) -> TouchView | None:
        """The last touch of the left arm that is shown."""
        return self.see().arms["left"].touch

    @property
    def is_at_rest(self) -> bool:
        """Whether the left arm's setpoint stands still."""
        return not any(self.see().arms["left"].dq_ref_radps)

    def settled(self) -> Vector:
        """Let the left arm come to rest; return where it is held [rad]."""
        self.run_until(lambda: self.is_at_rest)
        return self.see().arms["left"].q_ref_rad
