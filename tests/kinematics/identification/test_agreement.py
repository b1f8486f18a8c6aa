"""Agreement: FK against the measured pose, in virtual time; the pose is the witness's."""

from __future__ import annotations

import math

import pytest

from gateway.kinematics.identification.agreement import MOST_PAIRS, Agreement, ModelJudge, Tolerances
from gateway.kinematics.solving.chain import ArmChain
from gateway.robot.limits import HOME_Q_RAD
from gateway.sim.robot.geometry import arm_geometry
from gateway.sim.robot.manual import Side as SimSide
from gateway.values import EePose, Side, ValueRefused
from tests.kinematics.bodies import ARMS, nudged
from tests.kinematics.identities import postures

MS = 1_000_000
S = 1_000_000_000


class Robot:
    """Sends joints at 100 Hz and, 3 ms later, poses at 50 Hz, of an arm in motion."""

    def __init__(self, side, shift_m=0.0, lag_s=0.0):
        self.side, self.shift_m, self.now_ns, self._count = side, shift_m, 5 * S, 0
        self._behind = 0.7 + 100 * lag_s  # in samples: of 7 ms the stamp knows
        self._q = postures(side, 6000, share=0.9)
        self._arm = arm_geometry(SimSide(side.value))

    def run(self, judge, seconds, *, poses=True, joints=True):
        """Let time pass; return the verdict at its end."""
        for _ in range(round(seconds * 100)):
            self.now_ns += 10 * MS
            self._count += 1
            there = self._q[self._count]
            if joints:
                judge.joints(tuple(there.tolist()), self.now_ns)
            if poses and self._count % 2:
                at = self._arm.forward(self._at(self._count - self._behind))
                x, y, z = at.position_m
                pose = EePose(p_m=(x, y + self.shift_m, z), quat_xyzw=at.quat_xyzw)
                judge.pose(pose, self.now_ns - 7 * MS)
        return judge.verdict(self.now_ns)

    def _at(self, place):
        """Return the joints between two samples; those before the first are the first."""
        first = math.floor(place)
        here, there = self._q[max(first, 0)], self._q[max(first + 1, 0)]
        return here + (place - first) * (there - here)


@pytest.mark.parametrize("side", Side)
def test_our_model_agrees_with_the_witness(side):
    """In motion, with streams at their own times: residuals of interpolation, far below any tolerance."""
    verdict = Robot(side).run(ModelJudge(side, ARMS[side].chain), 4.0)
    assert verdict.state is Agreement.AGREES and verdict.is_usable and verdict.side is side
    assert verdict.position_m < 5e-5 and verdict.angle_rad < 2e-4 and verdict.pairs == 150
    assert "FK(joint_states)" in verdict.reason and "mm" in verdict.reason and "mrad" in verdict.reason


@pytest.mark.parametrize(
    ("body", "position", "angle"),
    [
        (nudged(Side.LEFT, 4, xyz_m=(0.0, 0.0, 0.012)), (0.011, 0.013), (0.0, 6e-3)),
        (nudged(Side.LEFT, 7, rpy_rad=(0.0, 0.0, 0.03)), (0.0, 1e-3), (0.027, 0.031)),
    ],
)
def test_another_model_differs_by_its_figure(body, position, angle):
    """A link that is 12 mm too long; a hand that is turned by 30 mrad; each told in its own unit.

    In motion a little of what such an arm does may pass for a lag: that shows in the other figure, not in the verdict.
    """
    verdict = Robot(Side.LEFT).run(ModelJudge(Side.LEFT, ArmChain(body, Side.LEFT)), 4.0)
    assert verdict.state is Agreement.DIFFERS and not verdict.is_usable
    assert position[0] <= verdict.position_m <= position[1] and angle[0] <= verdict.angle_rad <= angle[1]
    assert f"{1e3 * verdict.position_m:.2f} mm and {1e3 * verdict.angle_rad:.2f} mrad apart" in verdict.reason


@pytest.mark.parametrize("side", Side)
@pytest.mark.parametrize("lag_s", [-0.02, -0.005, 0.01, 0.02])
def test_what_a_lag_explains_is_not_held_against_the_model(side, lag_s):
    """Nobody knows exactly when a pose was measured: 20 ms are a centimetre here, and no other robot."""
    verdict = Robot(side, lag_s=lag_s).run(ModelJudge(side, ARMS[side].chain), 6.0)
    assert verdict.state is Agreement.AGREES and verdict.position_m < 2e-3 and verdict.angle_rad < 5e-3
    assert verdict.lag_s == pytest.approx(lag_s, abs=4e-3)
    blind = Tolerances(lag_ns=1)
    assert (
        Robot(side, lag_s=lag_s).run(ModelJudge(side, ARMS[side].chain, blind), 6.0).position_m > 2 * verdict.position_m
    )


def test_a_strict_judge_finds_the_lag_as_well():
    """Tolerances of half a millimetre and two milliradians: what 20 ms make of a motion is many times that."""
    strict = Tolerances(position_m=0.0005, angle_rad=0.002)
    verdict = Robot(Side.LEFT, lag_s=0.02).run(ModelJudge(Side.LEFT, ARMS[Side.LEFT].chain, strict), 6.0)
    assert verdict.lag_s == pytest.approx(0.02, abs=2e-3) and verdict.position_m < 1e-3


def test_a_clock_that_goes_back_to_the_very_same_instant_tells_no_speed():
    """Joints of another clock begin anew; a pose of the old one's last instant is one more, and nothing is divided by 0."""
    arm = ARMS[Side.LEFT]
    judge, pose = ModelJudge(Side.LEFT, arm.chain), arm.forward(HOME_Q_RAD[Side.LEFT])
    for stamp_ns in (S, 2 * S, S):
        judge.joints(HOME_Q_RAD[Side.LEFT], stamp_ns)
        judge.pose(pose, S)
    verdict = judge.verdict(2 * S)
    assert (verdict.pairs, verdict.position_m) == (2, pytest.approx(0.0, abs=1e-9))


@pytest.mark.parametrize("shift_m", [0.006, 0.012, 0.2])
def test_no_lag_explains_what_is_there_at_any_speed(shift_m):
    """A hand that is elsewhere, in motion and with a lag beside it: the distance is what it is, to half a millimetre."""
    verdict = Robot(Side.RIGHT, shift_m, lag_s=0.01).run(ModelJudge(Side.RIGHT, ARMS[Side.RIGHT].chain), 6.0)
    assert verdict.state is Agreement.DIFFERS and verdict.position_m == pytest.approx(
        shift_m, abs=5e-4 + 0.05 * shift_m
    )


def test_a_lag_beyond_reason_is_not_believed():
    """0.2 s: either the streams or the model are not what they are taken for."""
    verdict = Robot(Side.LEFT, lag_s=0.2).run(ModelJudge(Side.LEFT, ARMS[Side.LEFT].chain), 6.0)
    assert verdict.state is Agreement.DIFFERS and verdict.lag_s == 0.03


def test_a_window_is_never_longer_than_its_most_pairs():
    """Somebody sends poses at a kilohertz: what is kept stays bounded."""
    arm = ARMS[Side.LEFT]
    judge, pose = ModelJudge(Side.LEFT, arm.chain), arm.forward(HOME_Q_RAD[Side.LEFT])
    for count in range(2 * MOST_PAIRS):
        judge.joints(HOME_Q_RAD[Side.LEFT], S + count * 1000)
        judge.pose(pose, S + count * 1000)
    assert judge.verdict(S + 3 * MS).pairs == MOST_PAIRS


def test_nothing_known_is_no_yes():
    """At the beginning, with too few pairs, without poses, without joints: UNKNOWN with the reason."""
    side = Side.RIGHT
    judge, robot = ModelJudge(side, ARMS[side].chain), Robot(side)
    verdict = judge.verdict(robot.now_ns)
    assert verdict.state is Agreement.UNKNOWN and verdict.position_m is None and "have arrived" in verdict.reason
    few = robot.run(judge, 0.3)
    assert few.state is Agreement.UNKNOWN and "20 are needed" in few.reason and not few.is_usable
    for lacking in ({"poses": False}, {"joints": False}):
        other = ModelJudge(side, ARMS[side].chain)
        assert Robot(side).run(other, 3.0, **lacking).state is Agreement.UNKNOWN


def test_silence_ends_what_was_known():
    """Half a second without a pose: no longer known, and after the window nothing is left; then it begins anew."""
    side = Side.LEFT
    judge, robot = ModelJudge(side, ARMS[side].chain), Robot(side)
    assert robot.run(judge, 2.0).is_usable
    assert robot.run(judge, 0.4, poses=False).is_usable
    silent = robot.run(judge, 0.2, poses=False)
    assert silent.state is Agreement.UNKNOWN and "nothing for 0.6 s" in silent.reason
    assert robot.run(judge, 3.0, poses=False).pairs == 0
    assert robot.run(judge, 2.0).is_usable


def test_a_median_does_not_care_for_some_bad_samples():
    """A few poses of nowhere do not switch anything off; a lasting shift does, within the window, and ends likewise."""
    side = Side.LEFT
    judge, robot = ModelJudge(side, ARMS[side].chain), Robot(side)
    robot.run(judge, 3.0)
    robot.shift_m = 0.5
    assert robot.run(judge, 0.5).is_usable
    assert robot.run(judge, 1.5).state is Agreement.DIFFERS
    robot.shift_m = 0.0
    assert robot.run(judge, 0.5).state is Agreement.DIFFERS
    assert robot.run(judge, 2.0).is_usable


def test_a_model_at_its_bound_does_not_flicker():
    """Having differed by 6 mm it has to come below 4 mm, not below 5 mm, to be used again."""
    side = Side.RIGHT
    judge, robot = ModelJudge(side, ARMS[side].chain), Robot(side)
    states = []
    for shift_m in (0.0045, 0.006, 0.0045, 0.0038):
        robot.shift_m = shift_m
        states.append(robot.run(judge, 4.0).state)
    assert states == [Agreement.AGREES, Agreement.DIFFERS, Agreement.DIFFERS, Agreement.AGREES]


def test_another_clock_begins_anew():
    """A robot whose time went back: what was measured before has no age any more."""
    side = Side.LEFT
    judge, robot = ModelJudge(side, ARMS[side].chain), Robot(side, shift_m=0.5)
    robot.run(judge, 3.0)
    robot.now_ns, robot.shift_m = 1 * S, 0.0
    assert robot.run(judge, 2.0).is_usable
    judge.forget()
    assert judge.verdict(robot.now_ns).state is Agreement.UNKNOWN


@pytest.mark.parametrize(
    "setting",
    [{"position_m": 0.0}, {"angle_rad": math.nan}, {"window_ns": -1}, {"least_pairs": 0}, {"return_share": 1.1}],
)
def test_tolerances_that_judge_nothing_are_refused(setting):
    """Each has to be above 0; the share up to 1."""
    with pytest.raises(ValueRefused, match=next(iter(setting))):
        Tolerances(**setting)
