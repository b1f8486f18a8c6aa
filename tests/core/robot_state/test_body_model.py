"""The body model in virtual time: what arrives of a robot that obeys the model, or another one, and what follows from it."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import SampleArrived
from gateway.core.robot_state.body_model import JUDGED_NS, BodyModel, arrival_ns, body_model
from gateway.errors import Code, ConfigError
from gateway.kinematics.description import nominal
from gateway.kinematics.identification.agreement import Agreement
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import FSM_STATE, arm_state, ee_pose
from gateway.settings.settings import ArmSettings, ModelSettings, Settings
from gateway.values import ArmState, EePose, Side
from tests.kinematics.bodies import ARMS, nudged

MS = 1_000_000
S = 1_000_000_000
LEFT, RIGHT = Side.LEFT, Side.RIGHT
Q_RAD = HOME_Q_RAD


class Robot:
    """Sends joints and, 4 ms later, the pose that belongs to them, 100 times a second.

    Attributes:
        off_m: How far its left hand is from where our numbers have it [m].
    """

    def __init__(self, off_m=0.0):
        self.off_m, self.now_ns, self.posed = off_m, 5 * S, 0

    def hear(self, model, seconds, *, sides=tuple(Side)):
        """Let time pass."""
        for _ in range(round(100 * seconds)):
            self.now_ns += 10 * MS
            for side in sides:
                x, y, z = (at := ARMS[side].forward(Q_RAD[side])).p_m
                shift_m = self.off_m if side is LEFT else 0.0
                state = ArmState(q_rad=Q_RAD[side], dq_radps=(), tau_nm=(), stamp_ns=self.now_ns)
                pose = EePose(p_m=(x + shift_m, y, z), quat_xyzw=at.quat_xyzw)
                for topic, value, late_ns in (
                    (arm_state(side), state, 6 * MS),
                    (ee_pose(side), pose, 2 * MS),
                ):
                    at_ns = self.now_ns - late_ns
                    model.hear(SampleArrived(topic=topic, value=value, received_ns=at_ns), self.now_ns)


def test_a_robot_of_our_numbers_may_be_moved_by_them():
    """Unknown at first, and unknown is no; after a second both arms agree, each by its own samples."""
    model, there = BodyModel(nominal(), Settings()), Robot()
    assert model.source == nominal().source and model.collision is None
    for side in Side:
        refusal = model.refusal(side, there.now_ns)
        assert refusal.code is Code.MODEL_UNKNOWN and refusal.value == "" and str(side) in refusal.message
    there.hear(model, 1.5, sides=(LEFT,))
    assert model.refusal(LEFT, there.now_ns) is None
    assert model.refusal(RIGHT, there.now_ns).code is Code.MODEL_UNKNOWN
    verdict = model.verdict(LEFT, there.now_ns)
    assert verdict.state is Agreement.AGREES and verdict.position_m < 1e-6


def test_the_speeds_of_joints_are_those_of_its_own_arms():
    """As the Jacobian has them, per side."""
    model, rates = BodyModel(nominal(), Settings()), (0.1, -0.05, 0.2, 0.3, 0.0, -0.2)
    for side in Side:
        dq = model.joint_speeds_radps(side, Q_RAD[side], rates)
        assert ARMS[side].jacobian(Q_RAD[side]) @ dq == pytest.approx(rates)


def test_another_robot_is_told_with_figure_and_bound():
    """A hand that is 9 mm elsewhere: refused on that arm only."""
    model, there = BodyModel(nominal(), Settings()), Robot(off_m=0.009)
    there.hear(model, 1.5)
    refusal = model.refusal(LEFT, there.now_ns)
    assert (refusal.code, refusal.value) == (Code.MODEL_DIFFERS, "9.00 mm, 0.00 mrad")
    assert refusal.bound == "5.00 mm, 20.00 mrad" and "9.00 mm" in refusal.message
    assert model.refusal(RIGHT, there.now_ns) is None


def test_tolerances_and_window_are_those_of_the_settings():
    """9 mm are allowed where somebody said so; a window that is shorter forgets sooner."""
    settings = Settings(model=ModelSettings(position_tolerance_m=0.01, window_ns=1 * S))
    model, there = BodyModel(nominal(), settings), Robot(off_m=0.009)
    there.hear(model, 3.0)
    assert model.refusal(LEFT, there.now_ns) is None
    assert 20 <= model.verdict(LEFT, there.now_ns).pairs <= 21


def test_poses_are_compared_20_times_a_second():
    """Whatever comes at 100 Hz: a comparison costs more than everything else in here."""
    model, there = BodyModel(nominal(), Settings()), Robot()
    there.hear(model, 2.0)
    assert 39 <= model.verdict(LEFT, there.now_ns).pairs <= 41


def test_a_verdict_is_kept_for_a_while():
    """Who asks on every tick gets the same one, every 0.4 s another."""
    model, there = BodyModel(nominal(), Settings()), Robot()
    there.hear(model, 1.5)
    there.now_ns = (there.now_ns // JUDGED_NS + 1) * JUDGED_NS
    first = model.verdict(LEFT, there.now_ns)
    assert model.verdict(LEFT, there.now_ns + JUDGED_NS - 1) is first
    right = model.verdict(RIGHT, there.now_ns)
    assert model.verdict(RIGHT, there.now_ns + JUDGED_NS // 2) is not right, "its turn is another one"
    later = model.verdict(LEFT, there.now_ns + 600 * MS)
    assert later.state is Agreement.UNKNOWN and "at most 0.5 s is allowed" in later.reason


def test_a_new_link_begins_anew():
    """What was known is forgotten at once, and learnt again."""
    model, there = BodyModel(nominal(), Settings()), Robot()
    there.hear(model, 1.5)
    assert model.refusal(LEFT, there.now_ns) is None
    model.forget()
    assert model.refusal(LEFT, there.now_ns).code is Code.MODEL_UNKNOWN
    there.hear(model, 1.5)
    assert model.refusal(LEFT, there.now_ns) is None


def test_what_is_no_arms_is_passed_over():
    """Grippers move other motors; a mode is none."""
    model, there = BodyModel(nominal(), Settings()), Robot()
    for topic, value in ((FSM_STATE, 2), (arm_state(LEFT), 7)):
        model.hear(SampleArrived(topic=topic, value=value, received_ns=there.now_ns), there.now_ns)
    assert model.verdict(LEFT, there.now_ns).pairs == 0


@pytest.mark.parametrize(
    ("received_ms", "count", "at_ms"),
    [(100, 1, 100), (80, 4, 97.5), (80, 1, 90), (100, 0, 100)],
)
def test_the_newest_of_several_came_late_in_the_time_between(received_ms, count, at_ms):
    """A stamp of the look before is made the likeliest arrival; one of the arrival itself stays nearly what it is."""
    event = SampleArrived(topic=ee_pose(LEFT), value=0, received_ns=received_ms * MS, count=count)
    assert arrival_ns(event, 100 * MS) == at_ms * MS


def test_arms_keep_within_the_configured_limits():
    """Inverse kinematics stays inside the range that validation allows."""
    narrow = {side: tuple(q - 0.1 for q in Q_RAD[side]) for side in Side}
    lower = {side: tuple(max(a, b) for a, b in zip(narrow[side], JOINT_LOWER_RAD[side], strict=True)) for side in Side}
    model = BodyModel(nominal(), Settings(arm=ArmSettings(lower_rad=lower)))
    assert {side: model.arms[side].lower_rad for side in Side} == lower
    assert model.arms[LEFT].upper_rad == JOINT_UPPER_RAD[LEFT]


def test_what_keeps_arms_apart_is_built_only_when_asked_for():
    """It is of the same numbers."""
    model = BodyModel(nudged(LEFT, 4, xyz_m=(0.0, 0.0, 0.01)), Settings(model=ModelSettings(self_collision=True)))
    assert model.collision.chains[LEFT].zero == model.arms[LEFT].chain.zero != ARMS[LEFT].chain.zero


def test_the_settings_say_whether_there_is_a_model(tmp_path):
    """Off: none. On: that of the files named; one that cannot be used stops the start."""
    assert body_model(Settings(model=ModelSettings(check=False))) is None
    assert body_model(Settings()).source == nominal().source
    with pytest.raises(ConfigError, match="cannot be read"):
        body_model(Settings(model=ModelSettings(urdf=str(tmp_path / "no.urdf"))))


def test_the_margin_that_is_kept_is_that_of_the_settings():
    """The hull is built only where arms are to be kept apart, with what the configuration leaves free."""
    settings = Settings(model=ModelSettings(self_collision=True, margin_m=0.05))
    model = BodyModel(nominal(), settings)
    assert model.collision is not None and model.collision.margin_m == 0.05 and model.approach is not None
    assert BodyModel(nominal(), Settings()).approach is None


def test_joints_are_contradicted_by_a_pose_that_is_elsewhere():
    """Once the model has agreed with the robot; by more than what a slow arm and the tolerance explain."""
    model, there = BodyModel(nominal(), Settings()), Robot()
    first, second, *others = Q_RAD[LEFT]
    off = (first, second + 0.15, *others)
    pose = ARMS[LEFT].forward(Q_RAD[LEFT])
    assert not model.contradicts(LEFT, off, pose, there.now_ns), "nothing is known yet"
    there.hear(model, 1.5)
    assert model.contradicts(LEFT, off, pose, there.now_ns)
    assert not model.contradicts(LEFT, (first, second + 0.02, *others), pose, there.now_ns)


def test_the_body_model_hands_on_what_it_hears_and_forgets():
    """Joints of the arms, with what the chassis is commanded."""
    heard = []

    class Listening:
        def hear(self, side, state, received_ns, base):
            heard.append((side, state.stamp_ns, received_ns, base))

        def forget(self):
            heard.append("forgotten")

    model = BodyModel(nominal(), Settings())
    model.contacts = Listening()
    state = ArmState(q_rad=Q_RAD[RIGHT], dq_radps=(), tau_nm=(), stamp_ns=3)
    model.hear(SampleArrived(topic=arm_state(RIGHT), value=state, received_ns=8 * MS), 9 * MS, (0.1, 0.0, 0.2))
    model.forget()
    assert heard == [(RIGHT, 3, 8 * MS, (0.1, 0.0, 0.2)), "forgotten"]
