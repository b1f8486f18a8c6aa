"""The body model in the daemon: kinematics of both arms, what they must not hit, and whether the robot agrees with them.

What moves the robot by the model asks `refusal` first. It is None only while FK(joint_states) and `current_ee_pose` have been
near each other for some seconds (`kinematics.agreement`); not knowing is a no. The judge hears what the engine hears, as it
arrives, and begins anew with each link and each robot.

Costs: a sample of joints is kept, a pose is compared 20 times a second, a verdict is worked out every 0.4 s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec.structs import replace

from gateway.core.messages.events import SampleArrived
from gateway.core.motion.gap import Gap, gap
from gateway.errors import Code, Refusal
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.capsules import hull
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.configured import configured
from gateway.kinematics.description import Description
from gateway.kinematics.identification.agreement import Agreement, ModelJudge, Tolerances, Verdict
from gateway.kinematics.separation.approach import Approach
from gateway.kinematics.solving.dexterity import joint_speeds
from gateway.robot.topics import arm_state, ee_pose
from gateway.settings.settings import Settings
from gateway.values import ArmState, EePose, Side, Space, Vector

if TYPE_CHECKING:
    from gateway.core.robot_state.contact import Contacts

__all__ = ["BodyModel", "body_model"]

MS = 1_000_000

COMPARED_NS = 50 * MS
"""Poses of an arm are compared this far apart [ns], less the jitter of their arrival."""
JITTER_NS = 5 * MS
LEAST_PAIRS = 12
"""Fewer comparisons say nothing: 0.6 s of them, and what the shortest window has where each third look finds a pose."""
JUDGED_NS = 400 * MS
"""A verdict is worked out anew after this long [ns]."""
TURN_NS = {Side.LEFT: 0, Side.RIGHT: JUDGED_NS // 2}
"""The arms' turns are apart, so that no tick bears both [ns]."""
APART_RAD, APART_M = 0.05, 0.02
"""Beyond the tolerances joints and a pose may be apart by this [rad, m]: a slow arm, and 50 ms between the two."""
BOUND_NS = 120 * MS
"""Longest time between the joints around a pose [ns]: while nobody watches they come 50 ms apart."""

SIDES = {**{arm_state(side): side for side in Side}, **{ee_pose(side): side for side in Side}}
"""Which arm a topic is about."""

CODES_OF = {Agreement.UNKNOWN: Code.MODEL_UNKNOWN, Agreement.DIFFERS: Code.MODEL_DIFFERS}


class BodyModel:
    """The body's model and how far it can be relied on.

    Args:
        description: Numbers of the body.
        settings: Position limits of the arms, tolerances of the check, and whether arms are kept apart.

    Attributes:
        source: Where the numbers come from, for people.
        arms: Forward and inverse kinematics, within the configured position limits.
        collision: How near the body's parts are to each other; None while nothing is kept apart.
        approach: How quickly they may come nearer; None while nothing is kept apart.
        contacts: What pulls at the arms; None where nobody asked for dynamics. Given by whoever builds the daemon.
    """

    def __init__(self, description: Description, settings: Settings) -> None:
        arm, model = settings.arm, settings.model
        self.source = description.source
        self.arms = {side: ArmModel(description, side, arm.lower_rad[side], arm.upper_rad[side]) for side in Side}
        self.collision: CollisionModel | None = None
        self.approach: Approach | None = None
        self.contacts: Contacts | None = None
        if model.self_collision:
            self.collision = CollisionModel(description, replace(hull(), margin_m=model.margin_m))
            self.approach = Approach(self.collision)
        tolerances = Tolerances(
            position_m=model.position_tolerance_m,
            angle_rad=model.angle_tolerance_rad,
            window_ns=model.window_ns,
            bound_ns=BOUND_NS,
            least_pairs=LEAST_PAIRS,
        )
        self._tolerances = tolerances
        self._judges = {side: ModelJudge(side, self.arms[side].chain, tolerances) for side in Side}
        self._compared_ns: dict[Side, int] = {}
        self._verdicts: dict[Side, tuple[int, Verdict]] = {}

    def hear(self, event: SampleArrived, now_ns: int, base: Vector = ()) -> None:
        """Take what arrived: joints and poses of the arms; everything else is passed over.

        Args:
            event: As the engine got it.
            now_ns: Monotonic time [ns].
            base: What the chassis is commanded: x, y [m/s], yaw [rad/s].
        """
        side, value = SIDES.get(event.topic), event.value
        if side is None:
            return
        if isinstance(value, ArmState):
            self._judges[side].joints(value.q_rad, event.received_ns)
            if self.contacts is not None:
                self.contacts.hear(side, value, event.received_ns, base)
        elif isinstance(value, EePose):
            at_ns = arrival_ns(event, now_ns)
            if at_ns - self._compared_ns.get(side, at_ns - COMPARED_NS) >= COMPARED_NS - JITTER_NS:
                self._compared_ns[side] = at_ns
                self._judges[side].pose(value, at_ns)

    def forget(self) -> None:
        """Begin anew: the link was gone, or it is another robot."""
        for judge in self._judges.values():
            judge.forget()
        self._compared_ns.clear()
        self._verdicts.clear()
        if self.contacts is not None:
            self.contacts.forget()

    def joint_speeds_radps(self, side: Side, q_rad: Vector, rates: Vector) -> Vector:
        """Return how fast joints have to go for a velocity of their end effector, bounded near singularities.

        Args:
            side: Which arm.
            q_rad: Where its joints are, shape (7,) [rad].
            rates: Velocity [m/s], then angular velocity [rad/s] in the shoulder frame, shape (6,).
        """
        return joint_speeds(self.arms[side].jacobian(q_rad), rates)

    def verdict(self, side: Side, now_ns: int) -> Verdict:
        """Return what is known of an arm's model, at most 0.4 s old."""
        turn = (now_ns + TURN_NS[side]) // JUDGED_NS
        kept = self._verdicts.get(side)
        if kept is None or turn != kept[0]:
            kept = self._verdicts[side] = turn, self._judges[side].verdict(now_ns)
        return kept[1]

    def contradicts(self, side: Side, q_rad: Vector, pose: EePose, now_ns: int) -> bool:
        """Return whether an arm's joints and its end effector are said to be in different places.

        Only a model that has agreed with this robot can tell; the median of seconds that it goes by is not moved by the
        sample that is to be judged.

        Joints, shape (7,) [rad], and pose were measured at about the same time.
        """
        if not self.verdict(side, now_ns).is_usable:
            return False
        there, limits = self.arms[side].forward(q_rad).values, self._tolerances
        off = gap(Space.POSE, there, pose.values)
        return off.exceeds(Gap(limits.angle_rad + APART_RAD, limits.position_m + APART_M))

    def refusal(self, side: Side, now_ns: int) -> Refusal | None:
        """Return why an arm may not be moved by the model; None while it agrees with the robot."""
        verdict = self.verdict(side, now_ns)
        if verdict.is_usable:
            return None
        limits, off_m, off_rad = self._tolerances, verdict.position_m, verdict.angle_rad
        return Refusal(
            code=CODES_OF[verdict.state],
            message=f"the model of the {side} arm cannot be relied on: {verdict.reason}",
            field="model",
            value="" if off_m is None or off_rad is None else _figures(off_m, off_rad),
            bound=_figures(limits.position_m, limits.angle_rad),
        )


def body_model(settings: Settings) -> BodyModel | None:
    """Return the model that the settings ask for; None where they ask for none.

    Raises:
        ConfigError: A file that they name cannot be used.
    """
    return BodyModel(configured(settings), settings) if settings.model.check else None


def arrival_ns(event: SampleArrived, now_ns: int) -> int:
    """Return when a sample came, as well as can be told [ns].

    Where nobody saw it arrive its stamp is that of the look before, so that it never looks younger than it is: the newest of
    several came near the end of the time between.
    """
    return now_ns - (now_ns - event.received_ns) // (2 * max(event.count, 1))


def _figures(position_m: float, angle_rad: float) -> str:
    """Return a distance and an angle for people."""
    return f"{1e3 * position_m:.2f} mm, {1e3 * angle_rad:.2f} mrad"
