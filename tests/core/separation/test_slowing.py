"""Slowing near singularities: joints keep their bound as far as can be foreseen, nothing is slowed elsewhere, nothing stops."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.core.messages.events import SampleArrived
from gateway.core.messages.outputs import Remembered
from gateway.core.robot_state.body_model import BodyModel
from gateway.core.separation.slowing import Slowing, predicted
from gateway.core.supervision.coordinator import Coordinator
from gateway.errors import Code, Refusal
from gateway.kinematics.description import nominal
from gateway.kinematics.placement import rows_from_quat, turn_rad
from gateway.kinematics.solving.dexterity import LENGTH_M
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import arm_state
from gateway.settings.settings import ModelSettings, PoseSettings, Settings
from gateway.values import ArmState, Side
from tests.core.pose_judge import judge
from tests.thoroughness import either

R = Side.RIGHT
S = 1_000_000_000
HOME = HOME_Q_RAD[R]
HARD = PoseSettings(rate_hz=50.0, v_mps=0.5, a_mps2=5.0, j_mps3=100.0, w_radps=1.5, dw_radps2=15.0, ddw_radps3=300.0)
USUAL = PoseSettings(rate_hz=50.0)
ANSWER_S = 0.06
"""How late the arm of these tests is."""
DAMPING = 0.02
SINGULAR = (0.9, 0.0, 0.0, -0.6, -0.7, 0.5, -0.2)
"""Inside the limits; see `tests/kinematics/solving/test_dexterity.py`."""
OTHER_MODEL = Refusal(code=Code.MODEL_DIFFERS, message="9 mm and 0 mrad apart, up to 5 mm are allowed")


class Posing:
    """A right arm in end-effector mode that follows its setpoints by damped least squares, late; no joint has a limit.

    Attributes:
        refusal: Why the model may not be used; None while it agrees.
    """

    def __init__(self, q_rad=HOME, pose=USUAL, **model):
        self.refusal = None
        settings = Settings(pose=pose, model=ModelSettings(**model))
        self.model = BodyModel(nominal(), settings) if settings.model.check else None
        self.coordinator = Coordinator(settings, Remembered(), self.model)
        if self.model is not None:
            self.model.refusal = lambda side, now_ns: self.refusal
        self.slowing = Slowing(self.coordinator)
        self.now_ns, self.q_rad = 1000 * S, np.array(q_rad)
        self.arm = self.coordinator.body.pose_arms[R]
        self._chain = BodyModel(nominal(), settings).arms[R].chain
        self.setpoints = [self.at(q_rad)] * 3
        self.peaks: list[float] = []
        """Joint speeds that the setpoints ask for, by the prediction's own measure at the measured joints [rad/s]."""
        self.ratios: list[float] = []
        self.arm.start(self.at(q_rad), self.now_ns)
        self._hear()

    def at(self, q_rad):
        """Return the pose that belongs to joints."""
        return self._chain.forward(tuple(q_rad)).pose.values

    @property
    def seen(self):
        """What is shown of it."""
        return self.coordinator.body.slowing[R]

    @property
    def codes(self):
        """Codes of what was told."""
        return [notice.code for notice in self.coordinator.notices]

    def _hear(self):
        value = ArmState(q_rad=tuple(self.q_rad.tolist()), dq_radps=(), tau_nm=(), stamp_ns=self.now_ns)
        event = SampleArrived(topic=arm_state(R), value=value, received_ns=self.now_ns, stamp_ns=self.now_ns)
        self.coordinator.store.receive(event, self.now_ns)

    def step(self):
        """One setpoint, and what the arm does of it."""
        self.slowing.look(self.now_ns)
        self.arm.frame(self.now_ns)
        self.setpoints.append(self.arm.values)
        at, to, period_s = self._chain.forward(self.q_rad.tolist()), self.arm.values, self.arm.period_s
        off = [(a - b) / LENGTH_M for a, b in zip(to[:3], at.p_m, strict=True)]
        off += turn_rad(at.rows, rows_from_quat(to[3:]))
        jacobian = self._chain.jacobian(self.q_rad.tolist())
        jacobian[:3] /= LENGTH_M
        dq = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING**2 * np.eye(6), np.array(off) / ANSWER_S)
        self.q_rad = self.q_rad + period_s * dq
        self.now_ns += round(period_s * S)
        self._hear()
        if self.model is not None:
            self.peaks.append(max(map(abs, self.model.joint_speeds_radps(R, tuple(self.q_rad), self.arm.rates))))
        slowing = self.coordinator.body.slowing.get(R)
        self.ratios.append(1.0 if slowing is None else slowing.speed_ratio)

    def lead(self, target, seconds):
        """Stream one target; return after how long it was reached [s], None when it was not."""
        self.arm.follow_target(tuple(target), 1.0, 1)
        for step in range(round(seconds / self.arm.period_s)):
            self.step()
            if self.arm.is_at_rest and self.arm.values[:3] == tuple(target[:3]):
                return step * self.arm.period_s
        return None


def outward(pose, reach_m=0.5485):
    """Return a pose further out on the line from the shoulder."""
    return (*(reach_m / math.hypot(*pose[:3]) * x for x in pose[:3]), *pose[3:])


def wild(posing, rng, count):
    """Lead it through the whole range, every other time nearly stretched, each target before the last is reached."""
    low, high = np.array(JOINT_LOWER_RAD[R]), np.array(JOINT_UPPER_RAD[R])
    for number in range(count):
        goal = low + rng.random(7) * (high - low)
        if number % 2:
            goal[3] = -rng.uniform(0.0, 0.3)
        target = posing.at(goal)
        if math.hypot(*target[:3]) > 0.549:
            target = outward(target)
        posing.lead(target, rng.uniform(0.4, 3.0))


@pytest.mark.parametrize(
    ("pose", "bound_radps", "most", "is_rare"),
    [
        (USUAL, 3.0, 1.6, True),
        (HARD, 1.0, 4.0, False),
        *either((), ((USUAL, 1.5, 2.0, False), (HARD, 3.0, 2.0, False))),
    ],
)
def test_the_bound_is_kept(pose, bound_radps, most, is_rare):
    """Poses anywhere, targets that jump at any moment: to 5 % in 99 of 100 setpoints.

    In the others a target jumped at full speed beside a singularity, and that takes a moment of braking: factors `most` at
    most. The setpoints keep all their limits, and it is not for nothing.
    """
    peaks, without = [], []
    for seed in range(either(5, 12)):
        kept = Posing(pose=pose, singularity_radps=bound_radps)
        wild(kept, np.random.default_rng(seed), 6)
        limits = kept.arm.reference.space.limits
        judge(kept.setpoints, limits, 0.02)
        peaks += kept.peaks
        free = Posing(pose=pose, singularity_slowdown=False)
        wild(free, np.random.default_rng(seed), 6)
        without += free.peaks
        assert min(kept.ratios) > 0.02 and max(free.ratios) == 1.0 == min(free.ratios)
    assert max(peaks) < most * bound_radps, max(peaks)
    assert np.percentile(peaks, 99) < 1.05 * bound_radps
    assert max(without) > max(peaks) and (is_rare or np.percentile(without, 99) > 1.2 * bound_radps)


def test_a_calm_way_into_a_stretched_arm_and_out_of_it_is_slow_and_arrives():
    """Along its own line, both ways: the bound to 10 %, no stop, and full speed again where there is room for it."""
    posing = Posing()
    there = outward(posing.at(HOME))
    home = posing.at(HOME)[:3] + there[3:]
    inside = tuple(0.75 * x for x in home[:3]) + home[3:]
    assert posing.lead(inside, 3.0) is not None
    posing.peaks.clear()
    posing.ratios.clear()
    took_s = posing.lead(there, 10.0)
    assert took_s is not None and min(posing.ratios) < 0.6
    assert posing.seen.on and posing.seen.bound_radps == 3.0
    posing.lead(inside, 0.3)
    assert posing.seen.joint == 4 and posing.seen.joint_radps > 3.0 and posing.seen.held
    assert posing.lead(inside, 10.0) is not None
    assert max(posing.peaks) < 1.1 * 3.0 and posing.codes == []
    assert posing.ratios[-1] == 1.0


def test_from_a_singular_posture_every_direction_is_left():
    """The upper arm straight out to the side, whose direction is lost: in, up and turned, a tenth of the speed at least."""
    for away in ((-0.1, 0.0, 0.0, 0.0), (0.0, 0.05, -0.05, 0.0), (-0.02, 0.0, 0.0, 0.3)):
        posing = Posing(q_rad=SINGULAR)
        x, y, z, *_ = posing.at(posing.q_rad)
        scale = 1.0 + away[0] / math.hypot(x, y, z)
        p_m = np.array([scale * x, scale * y + away[1], scale * z + away[2]])
        p_m *= min(1.0, 0.548 / math.hypot(*p_m))
        half = 0.5 * away[3]
        turned = np.array(posing.at(posing.q_rad)[3:])
        qx, qy, qz, qw = turned
        s, c = math.sin(half), math.cos(half)
        target = (*p_m, c * qx - s * qy, c * qy + s * qx, c * qz + s * qw, c * qw - s * qz)
        assert posing.lead(target, 15.0) is not None and 0.05 < min(posing.ratios) < 0.5


def test_away_from_singularities_not_a_bit_of_a_setpoint_is_another():
    """With the rule, without it, without a model: the same setpoints."""
    ways = []
    for model in ({}, {"singularity_slowdown": False}, {"check": False}):
        posing = Posing(**model)
        x, y, z, *quat = posing.at(HOME)
        posing.lead((0.8 * x, 0.8 * y, 0.8 * z, *quat), 2.0)
        posing.lead((0.7 * x + 0.05, 0.8 * y, 0.7 * z, *quat), 0.7)
        posing.lead((0.8 * x, 0.8 * y, 0.8 * z, *quat), 2.0)
        assert set(posing.ratios) == {1.0}
        ways.append(posing.setpoints)
    assert ways[0] == ways[1] == ways[2] and len(set(ways[0])) > 80


def test_while_the_model_does_not_agree_it_is_off_and_that_is_told():
    """Once, with the model's reason; on again without a word, at once where it is needed."""
    posing = Posing(singularity_radps=0.3)
    there = outward(posing.at(HOME))
    posing.refusal = OTHER_MODEL
    posing.lead(there, 0.4)
    assert not posing.seen.on and posing.seen.why == OTHER_MODEL.message and set(posing.ratios) == {1.0}
    assert (posing.seen.joint, posing.seen.held) == (0, False)
    assert posing.codes == [Code.MODEL_DIFFERS] and "right arm" in posing.coordinator.notices[0].message
    posing.refusal = None
    posing.lead(posing.at(HOME), 0.4)
    assert posing.seen.on and posing.seen.why == "" and posing.ratios[-1] < 1.0
    posing.refusal = OTHER_MODEL
    posing.step()
    assert posing.ratios[-1] == 1.0 and posing.codes == [Code.MODEL_DIFFERS] * 2


@pytest.mark.parametrize(
    ("model", "why"), [({"singularity_slowdown": False}, "does not ask for it"), ({"check": False}, "no body model")]
)
def test_what_the_configuration_does_not_ask_for_is_shown_and_no_news(model, why):
    """Neither the rule nor the model: in the snapshot, not among the notices."""
    posing = Posing(**model)
    posing.lead(outward(posing.at(HOME)), 0.2)
    assert not posing.seen.on and why in posing.seen.why and posing.codes == []


def test_only_streams_of_poses_are_looked_at():
    """Nothing while the arm holds, is silent, or its setpoint is not due; what was seen ends with the stream."""
    posing = Posing()
    posing.step()
    assert posing.coordinator.body.slowing == {}
    posing.lead(outward(posing.at(HOME)), 0.3)
    assert list(posing.coordinator.body.slowing) == [R]
    posing.model.joint_speeds_radps = None  # would raise
    posing.now_ns -= round(0.5 * posing.arm.period_s * S)
    posing.slowing.look(posing.now_ns)
    posing.arm.brake()
    posing.slowing.look(posing.now_ns + S)
    assert posing.coordinator.body.slowing == {}


def test_an_arm_at_its_target_is_not_near_anything():
    """A target where the arm is held: nothing moves, nothing is slowed."""
    posing = Posing(singularity_radps=0.3)
    assert posing.lead(posing.at(HOME), 1.0) == 0.0
    assert posing.seen.speed_ratio == 1.0 and posing.seen.joint == 0


def test_the_fastest_joint_decides():
    """Twice the speed limits at half the bound: a part that does not depend on how fast it goes now."""
    one, other = (predicted([0.1 * n, -2.0 * n, 0.3 * n], 0.25 * n, 1.0) for n in (1, 4))
    assert one == pytest.approx(other) and one == pytest.approx((0.125, 1, 8.0))
