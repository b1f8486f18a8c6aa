"""The store in virtual time: what is fresh, what may seed a stream, what is believed."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.messages.events import SampleArrived, SampleRefused
from gateway.core.robot_state.store import Store
from gateway.errors import Code
from gateway.robot.topics import (
    CHASSIS_STATE,
    CURRENT_MODE,
    FSM_STATE,
    MOTION_STATE_TOPICS,
    TOPICS,
    arm_state,
    ee_pose,
    gripper_state,
)
from gateway.settings.settings import EnableSettings
from gateway.values import ArmState, CurrentMode, EePose, MotorState, Side

MS = 1_000_000
S = 1_000_000_000
HOUR = 3600 * S
LEFT = arm_state(Side.LEFT)
RIGHT = arm_state(Side.RIGHT)
MODE = CurrentMode(
    api=True,
    joint_mode={side: True for side in Side},
    arm_enabled={side: True for side in Side},
    chassis_enabled=True,
    lift_enabled=False,
    collision_check=False,
)
POSE = EePose(p_m=(0.3, 0.0, -0.2), quat_xyzw=(0.0, 0.0, 0.0, 1.0))


def joints(q: float = 0.0, stamp_ns: int = 0) -> ArmState:
    """A posture that differs from others in joint 5 only."""
    return ArmState(q_rad=(0.0, 0.5, 0.0, 1.0, q, 0.0, 0.0), dq_radps=(), tau_nm=(), stamp_ns=stamp_ns)


class Feed:
    """A store, and a robot whose clock is `offset_ns` ahead of ours and whose states take `delay_ns` to arrive."""

    def __init__(self, offset_ns: int = 7 * HOUR, delay_ns: int = 2 * MS) -> None:
        self.store = Store(EnableSettings())
        self.now_ns = 1000 * S
        self.offset_ns = offset_ns
        self.delay_ns = delay_ns
        self.q = 0.0
        self.jumps: list[str] = []

    def arm(self, topic: str = LEFT, **changes) -> None:
        """One arm sample that was stamped `delay_ns` ago."""
        value = joints(self.q, self.now_ns + self.offset_ns - self.delay_ns)
        event = {"topic": topic, "value": value, "received_ns": self.now_ns, "stamp_ns": value.stamp_ns, "count": 2}
        self.jumps += filter(None, [self.store.receive(SampleArrived(**(event | changes)), self.now_ns)])

    def give(self, topic: str, value, **changes) -> None:
        self.store.receive(SampleArrived(topic=topic, value=value, received_ns=self.now_ns, **changes), self.now_ns)

    def run(self, duration_ns: int, step_ns: int = 10 * MS) -> None:
        """Time passes with an arm sample every `step_ns`."""
        for _ in range(duration_ns // step_ns):
            self.now_ns += step_ns
            self.arm()

    def seedable(self) -> bool:
        return self.store.seedable(Side.LEFT, self.now_ns)

    def refused(self) -> int:
        return self.store.topic_view(LEFT, self.now_ns).refused


class Hands:
    """A store that hears the left arm's joints and pose together, every 10 ms."""

    def __init__(self) -> None:
        self.store, self.now_ns = Store(EnableSettings()), 1000 * S

    def run(self, samples: int, *, with_pose: bool = True, x_m: float = 0.1, angle_rad: float = 0.0) -> None:
        """Let time pass; the hand is there, turned by an angle."""
        for _ in range(samples):
            self.now_ns += 10 * MS
            quat = (0.0, 0.0, math.sin(angle_rad / 2), math.cos(angle_rad / 2))
            self._hear(LEFT, joints(0.0, self.now_ns))
            if with_pose:
                self._hear(ee_pose(Side.LEFT), EePose(p_m=(x_m, 0.2, 0.3), quat_xyzw=quat))

    def _hear(self, topic: str, value) -> None:
        self.store.receive(SampleArrived(topic=topic, value=value, received_ns=self.now_ns), self.now_ns)

    def seedable(self) -> bool:
        return self.store.seedable(Side.LEFT, self.now_ns, needs_pose=True)


@pytest.fixture
def feed() -> Feed:
    """A store that has seen nothing yet."""
    return Feed()


# ------------------------------------------------------------------------------------------------ freshness and ages


def test_nothing_is_known_before_the_first_sample(feed):
    """Every question has an answer before the robot has spoken, and none of them permits anything."""
    store, now_ns = feed.store, feed.now_ns
    assert not store.is_fresh(now_ns)
    assert not store.part_fresh(Side.LEFT, now_ns, False)
    assert not feed.seedable()
    assert store.link_age_ns(now_ns) is store.age_ns(LEFT, now_ns) is store.value(LEFT) is None
    assert store.arm(Side.LEFT) is store.pose(Side.LEFT) is store.fsm_raw is store.mode(now_ns) is None
    assert store.fsm(now_ns) is store.fsm_received_ns is store.mode_received_ns is None
    assert store.name_order_wrong(now_ns) is None and store.why_not_believed(LEFT, S, now_ns) == ""
    view = store.topic_view(LEFT, now_ns)
    assert (view.age_ns, view.rate_hz, view.worst_gap_ns, view.count) == (None, 0.0, 0, 0)


@pytest.mark.parametrize(("age_ns", "fresh"), [(0, True), (100 * MS, True), (100 * MS + 1, False)])
@pytest.mark.parametrize("topic", MOTION_STATE_TOPICS)
def test_the_link_is_fresh_up_to_100_ms_after_any_fast_topic(feed, topic, age_ns, fresh):
    """BEHAVIOUR, values: the newest fast state topic decides."""
    value = (
        POSE
        if topic.endswith("ee_pose")
        else joints()
        if "_arm" in topic
        else MotorState(q_rad=(0.0,), dq_radps=(), tau_nm=(), stamp_ns=1)
    )
    feed.give(topic, value)
    assert feed.store.is_fresh(feed.now_ns + age_ns) is fresh
    assert feed.store.link_age_ns(feed.now_ns + age_ns) == feed.store.age_ns(topic, feed.now_ns + age_ns) == age_ns


def test_slow_topics_do_not_make_the_link_fresh(feed):
    """A live `/fsm_state` (20 Hz) or mode (1 Hz) says nothing about the motion states."""
    feed.give(FSM_STATE, 0)
    feed.give(CURRENT_MODE, MODE)
    assert not feed.store.is_fresh(feed.now_ns)
    assert feed.store.link_age_ns(feed.now_ns) is None


def test_the_newest_topic_counts_for_the_link_in_whatever_order_they_are_read(feed):
    """An older sample of another topic, read later in the same tick, does not age the link."""
    feed.arm(LEFT)
    feed.arm(RIGHT, received_ns=feed.now_ns - 50 * MS)
    assert feed.store.is_fresh(feed.now_ns + 100 * MS)
    assert feed.store.link_age_ns(feed.now_ns + 100 * MS) == 100 * MS


def test_an_arrival_after_the_start_of_the_tick_is_not_younger_than_the_tick(feed):
    """Samples are stamped by another thread: ages are never negative."""
    feed.arm(received_ns=feed.now_ns + 3 * MS)
    assert feed.store.age_ns(LEFT, feed.now_ns) == 0


def test_a_part_is_fresh_by_its_own_joints_and_in_pose_mode_by_its_pose_too(feed):
    """BEHAVIOUR, values: a dead arm is not hidden by the other one."""
    feed.arm(RIGHT)
    assert not feed.store.part_fresh(Side.LEFT, feed.now_ns, False)
    feed.arm(LEFT)
    assert feed.store.part_fresh(Side.LEFT, feed.now_ns, False)
    assert not feed.store.part_fresh(Side.LEFT, feed.now_ns, True)
    feed.give(ee_pose(Side.LEFT), POSE)
    assert feed.store.part_fresh(Side.LEFT, feed.now_ns + 100 * MS, True)
    assert not feed.store.part_fresh(Side.LEFT, feed.now_ns + 101 * MS, True)
    assert feed.store.pose(Side.LEFT) == POSE and feed.store.arm(Side.LEFT) == feed.store.value(LEFT)


def test_fsm_and_mode_are_unknown_when_old(feed):
    """0.5 s for the FSM (20 Hz), 3 s for the mode (1 Hz); the raw value stays for display."""
    feed.give(FSM_STATE, 2)
    feed.give(CURRENT_MODE, MODE)
    store, now_ns = feed.store, feed.now_ns
    assert store.fsm(now_ns + 500 * MS) == 2 and store.fsm(now_ns + 501 * MS) is None and store.fsm_raw == 2
    assert store.mode(now_ns + 3 * S) == MODE and store.mode(now_ns + 3 * S + 1) is None
    assert store.fsm_received_ns == store.mode_received_ns == now_ns


def test_reset_forgets_freshness_and_keeps_values_for_display(feed):
    """A lost transport or a restarted robot: nothing of before permits anything, the view still shows it."""
    feed.run(1 * S)
    feed.give(FSM_STATE, 2)
    feed.give(CURRENT_MODE, MODE)
    store, now_ns = feed.store, feed.now_ns
    assert feed.seedable() and store.is_fresh(now_ns)
    store.reset()
    assert not (feed.seedable() or store.is_fresh(now_ns) or store.part_fresh(Side.LEFT, now_ns, False))
    assert store.fsm(now_ns) is store.mode(now_ns) is store.fsm_received_ns is store.mode_received_ns is None
    assert store.arm(Side.LEFT) is not None and store.fsm_raw == 2
    assert store.age_ns(LEFT, now_ns) == store.link_age_ns(now_ns) == 0
    feed.run(10 * MS)
    assert store.is_fresh(feed.now_ns) and not feed.seedable()


@pytest.mark.parametrize("step_ns", [HOUR, -HOUR, 50 * MS, -50 * MS])
@pytest.mark.parametrize("all_at_once", [True, False])
def test_a_step_of_the_robots_clock_changes_nothing(feed, step_ns, all_at_once):
    """Wall clock jumps: freshness never drops, and seeding is possible again after its own time (BEHAVIOUR)."""
    feed.run(2 * S)
    feed.offset_ns += step_ns
    for n in range(60):
        if not all_at_once and n == 30:
            feed.offset_ns -= step_ns
        feed.run(10 * MS)
        assert feed.store.is_fresh(feed.now_ns) and feed.store.part_fresh(Side.LEFT, feed.now_ns, False)
        assert feed.store.age_ns(LEFT, feed.now_ns) <= 10 * MS
    feed.run(350 * MS)
    assert feed.seedable()


# ---------------------------------------------------------------------------------------------------------- seeding


def test_seeding_takes_300_ms_of_uninterrupted_fresh_samples(feed):
    """From the first sample on, not earlier; for the arm that sends them only."""
    feed.arm()
    feed.run(290 * MS)
    assert not feed.seedable()
    feed.run(10 * MS)
    assert feed.seedable() and not feed.store.seedable(Side.RIGHT, feed.now_ns)


def test_an_age_above_100_ms_ends_the_window_at_once_and_starts_it_anew(feed):
    """A stall is followed by 0.3 s of good samples before a stream may start."""
    feed.run(1 * S)
    feed.now_ns += 100 * MS
    assert feed.seedable()
    feed.now_ns += 1 * MS
    assert not feed.seedable()
    feed.arm()
    feed.run(290 * MS)
    assert not feed.seedable()
    feed.run(10 * MS)
    assert feed.seedable()


def test_queued_old_states_do_not_seed_though_they_are_fresh(feed):
    """A route that works off a backlog of a second gives fresh receive times: the stamp lag tells."""
    feed.run(2 * S)
    feed.delay_ns += 1 * S
    feed.now_ns += 1 * S
    feed.run(2 * S)
    assert feed.store.is_fresh(feed.now_ns) and not feed.seedable()
    feed.delay_ns -= 1 * S
    feed.run(300 * MS)
    assert not feed.seedable()
    feed.run(10 * MS)
    assert feed.seedable()


@pytest.mark.parametrize(("excess_ns", "seedable"), [(100 * MS, True), (100 * MS + 1, False)])
def test_a_lag_of_100_ms_above_the_least_is_allowed(feed, excess_ns, seedable):
    """BEHAVIOUR, starting: the bound itself still counts as timely."""
    feed.run(2 * S)
    feed.delay_ns += excess_ns
    feed.now_ns += excess_ns
    feed.run(400 * MS)
    assert feed.seedable() is seedable


def test_a_backlog_right_after_a_reconnect_does_not_seed(feed):
    """With no lag known yet, the first timely sample shows that all before it were old: they leave the window."""
    feed.delay_ns = 500 * MS
    for _ in range(60):  # the queue drains: each sample is 5 ms less late than the one before
        feed.run(10 * MS)
        feed.delay_ns -= 5 * MS
    assert not feed.seedable()
    feed.delay_ns = 2 * MS
    feed.run(10 * MS)
    assert not feed.seedable()
    feed.run(300 * MS)
    assert feed.seedable()


@pytest.mark.parametrize("ppm", [-500, 500])
def test_a_drifting_robot_clock_does_not_block_seeding(feed, ppm):
    """Ten minutes of the fastest slew a clock daemon uses: the least lag is that of the last minute only."""
    for _ in range(6000):
        feed.now_ns += 100 * MS
        feed.offset_ns += ppm * 100 * MS // 1_000_000
        feed.arm()
    assert feed.seedable()


def test_a_clock_set_back_during_a_stall_blocks_seeding_for_a_minute_at_most(feed):
    """It looks like a queue of 2 s, which is why it waits; it is over when the old least lag is."""
    feed.run(10 * S)
    feed.now_ns += 5 * S
    feed.offset_ns -= 2 * S
    feed.run(1 * S)
    assert not feed.seedable()
    feed.run(61 * S, 100 * MS)
    assert feed.seedable()


def test_our_own_pause_starts_seeding_anew(feed):
    """Suspend, late tick: nothing that arrived before the pause was noticed counts."""
    feed.run(1 * S)
    feed.store.disturb(feed.now_ns + 50 * MS)
    assert not feed.seedable()
    feed.run(340 * MS)
    assert not feed.seedable()
    feed.run(10 * MS)
    assert feed.seedable()


# -------------------------------------------------------------------------------------------------------- believing


def test_a_late_sample_is_counted_and_not_used(feed):
    """A stamp that repeats or goes back once: the newer value stays, its age goes on."""
    feed.run(1 * S)
    newest = feed.store.arm(Side.LEFT)
    for back_ns in (0, 10 * MS):
        feed.now_ns += 10 * MS
        feed.arm(value=joints(0.01, newest.stamp_ns - back_ns))
    assert feed.store.arm(Side.LEFT) == newest and feed.refused() == 2
    assert feed.store.age_ns(LEFT, feed.now_ns) == 20 * MS
    assert "not newer" in feed.store.why_not_believed(LEFT, S, feed.now_ns)


def test_late_samples_between_timely_ones_never_pass_for_a_clock_set_back(feed):
    """Only two in a row that go on between themselves do; a repeated old one does not either."""
    feed.run(1 * S)
    old = feed.store.arm(Side.LEFT).stamp_ns - 50 * MS
    for n in range(5):
        feed.arm(value=joints(0.02, old + n))
        feed.run(10 * MS)
    feed.arm(value=joints(0.02, old))
    feed.arm(value=joints(0.02, old))
    feed.arm(value=joints(0.02, old - 1))
    assert feed.store.arm(Side.LEFT).q_rad[4] == 0.0 and feed.refused() == 8


def test_gripper_and_chassis_states_are_kept_in_order_too(feed):
    """Every JointState has a stamp (manual §4.8)."""
    for stamp_ns in (5, 4):
        feed.give(CHASSIS_STATE, MotorState(q_rad=(1.0, 2.0, 3.0), dq_radps=(), tau_nm=(), stamp_ns=stamp_ns))
    assert feed.store.value(CHASSIS_STATE).stamp_ns == 5


def test_why_nothing_is_believed_is_known_while_it_lasts(feed):
    """Not before a refusal, not once a sample is believed again, and not long after the last one came."""
    feed.run(1 * S)

    def why() -> str:
        return feed.store.why_not_believed(LEFT, 200 * MS, feed.now_ns)

    assert why() == ""
    feed.now_ns += 10 * MS
    feed.store.receive(
        SampleRefused(topic=LEFT, code=Code.SAMPLE_REFUSED, message="position[2] is nan", received_ns=feed.now_ns),
        feed.now_ns,
    )
    assert why() == "position[2] is nan"
    feed.now_ns += 200 * MS
    assert why() == "position[2] is nan"
    feed.now_ns += 10 * MS
    assert why() == ""
    feed.arm()
    feed.now_ns -= 100 * MS
    assert why() == ""


def test_a_glitch_of_one_sample_is_refused_with_joint_value_and_bound(feed):
    """No arm moves 1 rad in 10 ms; the part stays fresh and goes on with the next good sample."""
    feed.run(1 * S)
    feed.q = 1.0
    feed.run(10 * MS)
    assert feed.store.arm(Side.LEFT).q_rad[4] == 0.0 and feed.refused() == 1
    why = feed.store.why_not_believed(LEFT, S, feed.now_ns)
    assert "joint 5 is 1.000 rad away from where it was 10 ms ago, at most 0.200 rad" in why
    assert feed.store.part_fresh(Side.LEFT, feed.now_ns, False)
    feed.q = 0.1
    feed.run(10 * MS)
    assert feed.store.arm(Side.LEFT).q_rad[4] == 0.1 and feed.refused() == 1


@pytest.mark.parametrize("jump_rad", [0.3, 1.0, 3.0])
def test_a_jump_that_lasts_kills_the_part_and_is_then_believed(feed, jump_rad):
    """However small: dead from 100 ms on, so that it is noticed, and true after 0.3 s. The link stays fresh."""
    feed.run(1 * S)
    feed.q = jump_rad
    for n in range(1, 40):
        feed.now_ns += 10 * MS
        feed.arm()
        feed.arm(RIGHT)
        assert feed.store.part_fresh(Side.LEFT, feed.now_ns, False) is (n <= 10 or n > 30)
        assert feed.store.is_fresh(feed.now_ns)
    assert feed.refused() == 30
    assert not feed.seedable()
    feed.run(300 * MS)
    assert feed.seedable() and feed.store.arm(Side.LEFT).q_rad[4] == jump_rad
    (jump,) = feed.jumps
    assert jump.startswith(f"{LEFT}: joint 5 is {jump_rad:.3f} rad away from where it was")


def test_a_jumping_rival_is_not_believed(feed):
    """Noise between two wrong values, or one with holes, does not become the truth by lasting."""
    feed.run(1 * S)
    for n in range(50):
        feed.q = 1.0 + (n % 2)
        feed.run(10 * MS)
    assert feed.store.arm(Side.LEFT).q_rad[4] == 0.0
    feed.q = 1.0
    feed.run(2 * S, 110 * MS)
    assert feed.store.arm(Side.LEFT).q_rad[4] == 0.0


def test_fast_motion_is_believed_also_through_gaps_and_bursts(feed):
    """8 rad/s: more than we command; after 90 ms of silence, or when late samples arrive on each other's heels."""
    for n, (gap_ns, late_ns) in enumerate([(10, 0)] * 20 + [(90, 80), (1, 70), (1, 0), (10, 0)] * 10):
        feed.now_ns += gap_ns * MS
        feed.delay_ns = late_ns * MS
        feed.q = 8.0 * (feed.now_ns - feed.delay_ns) / S
        feed.arm()
        assert feed.refused() == 0, n


def test_reset_forgets_the_posture_and_the_stamp(feed):
    """After a restart of the robot its first sample is the truth, wherever the arm is and whatever its clock says."""
    feed.run(1 * S)
    feed.store.reset()
    feed.q, feed.offset_ns = 1.5, -9 * HOUR
    feed.run(310 * MS)
    assert feed.refused() == 0 and feed.seedable() and feed.store.arm(Side.LEFT).q_rad[4] == 1.5


@settings(max_examples=40, deadline=None)
@given(st.randoms(use_true_random=False))
def test_no_history_of_samples_blocks_the_store_for_ever(rng: random.Random):
    """Whatever came before, jumps, clock steps, gaps: a minute of an ordinary stream is believed and seeds."""
    feed = Feed()
    for _ in range(rng.randrange(60)):
        feed.now_ns += rng.choice([1, 10, 10, 10, 150, 2000]) * MS
        feed.q = rng.choice([feed.q, feed.q, -1.0, 1.5])
        feed.offset_ns += rng.choice([0, 0, 0, HOUR, -HOUR, 30 * MS, -30 * MS])
        feed.delay_ns = rng.choice([2, 2, 2, 50, 900]) * MS
        feed.arm()
    feed.delay_ns = 2 * MS
    feed.run(67 * S, 90 * MS)
    assert feed.store.arm(Side.LEFT).q_rad[4] == feed.q and feed.seedable()


def test_refused_samples_are_counted_and_do_not_refresh(feed):
    """NaN, wrong length, bad CDR: the part goes dead when it lasts."""
    feed.arm()
    refusal = SampleRefused(
        topic=LEFT, code=Code.SAMPLE_REFUSED, message="position[2] is nan", received_ns=feed.now_ns + 1, count=3
    )
    feed.now_ns += 101 * MS
    feed.store.receive(refusal, feed.now_ns)
    assert feed.refused() == 3 and feed.store.why_not_believed(LEFT, S, feed.now_ns) == "position[2] is nan"
    assert not feed.store.part_fresh(Side.LEFT, feed.now_ns, False) and not feed.store.is_fresh(feed.now_ns)
    assert feed.store.name_order_wrong(feed.now_ns) is None


def misnamed(feed, topic, message):
    """A sample of a topic arrives with other names."""
    feed.store.receive(
        SampleRefused(topic=topic, code=Code.JOINT_ORDER, message=message, received_ns=feed.now_ns), feed.now_ns
    )


def test_joint_names_in_another_order_are_told_for_a_second(feed):
    """Manual §4.0.3: only arms count, their order is what we command by."""
    for _ in range(11):
        feed.now_ns += 5 * MS
        misnamed(feed, LEFT, "l_joint2 first")
        misnamed(feed, gripper_state(Side.LEFT), "gripper")
    assert feed.store.name_order_wrong(feed.now_ns + 1 * S) == "l_joint2 first"
    assert feed.store.name_order_wrong(feed.now_ns + 1 * S + 1) is None


def test_joint_names_of_a_few_samples_say_nothing_of_the_robot(feed):
    """A connection that comes back may bring another topic's: refused, and no other robot while there are right ones."""
    for count in range(40):
        feed.now_ns += 5 * MS
        misnamed(feed, LEFT, "of the right arm")
        if count % 10 == 9:
            feed.arm()
    assert feed.store.name_order_wrong(feed.now_ns) is None and feed.refused() == 40
    for _ in range(2):
        misnamed(feed, LEFT, "of the right arm")
        feed.store.reset()  # the transport was lost
        feed.now_ns += 1 * S
    assert feed.store.name_order_wrong(feed.now_ns) is None


# ------------------------------------------------------------------------------------------------------------ views


@pytest.mark.parametrize(("topic", "value"), [(LEFT, None), (FSM_STATE, 2), (CURRENT_MODE, MODE)])
def test_the_measured_rate_is_the_nominal_one_whenever_it_is_asked(feed, topic, value):
    """200, 20 and 1 Hz, read on a 10 ms tick, within 3 %."""
    period_ns = round(S / TOPICS[topic].rate_hz)
    arrived = events = 0
    for tick in range(800):
        feed.now_ns += 10 * MS
        due = (tick + 1) * 10 * MS // period_ns
        if due > arrived:
            sample = value or joints(0.0, feed.now_ns)
            feed.give(topic, sample, count=due - arrived, duplicates=1)
            arrived, events = due, events + 1
        if tick > 300:
            rate_hz = feed.store.topic_view(topic, feed.now_ns).rate_hz
            assert rate_hz == pytest.approx(TOPICS[topic].rate_hz, rel=0.03)
    view = feed.store.topic_view(topic, feed.now_ns)
    assert (view.count, view.duplicates, view.refused) == (arrived, events, 0)


def test_the_rate_of_a_dead_topic_falls_to_zero(feed):
    """Half of it after as long as was measured, nothing after the window."""
    feed.run(3 * S)
    feed.now_ns += 1 * S
    assert 100 < feed.store.topic_view(LEFT, feed.now_ns).rate_hz < 150
    feed.now_ns += 2 * S
    assert feed.store.topic_view(LEFT, feed.now_ns).rate_hz == 0.0


def test_the_worst_gap_is_that_of_the_last_ten_seconds(feed):
    """The link's own measure where it has one, the silence between arrivals else, the present silence included."""
    feed.run(2 * S)
    feed.arm(worst_gap_ns=40 * MS)
    feed.run(2 * S)
    assert feed.store.topic_view(LEFT, feed.now_ns).worst_gap_ns == 40 * MS
    feed.run(5 * S)
    assert feed.store.topic_view(LEFT, feed.now_ns).worst_gap_ns == 40 * MS
    feed.run(4 * S)
    assert feed.store.topic_view(LEFT, feed.now_ns).worst_gap_ns == 10 * MS
    feed.now_ns += 3 * S
    assert feed.store.topic_view(LEFT, feed.now_ns).worst_gap_ns == 3 * S


def test_a_gap_of_long_ago_is_forgotten_also_on_a_slow_topic(feed):
    """Ten seconds are ten seconds, however few samples came in them."""
    feed.arm()
    feed.now_ns += 8 * S
    feed.arm()
    for _ in range(6):
        feed.now_ns += 2 * S
        feed.arm()
    assert feed.store.topic_view(LEFT, feed.now_ns).worst_gap_ns == 2 * S


def test_what_queued_up_does_not_count_as_timely_until_it_has_drained():
    """After a stall the samples that waited carry a fresh receive time; timely is only what came after them."""
    feed = Feed()
    assert feed.store.timely_since_ns() is None
    feed.run(500 * MS)
    begun_ns = feed.store.timely_since_ns()
    assert begun_ns is not None and begun_ns <= 1000 * S + 20 * MS
    feed.now_ns += 400 * MS
    feed.delay_ns = 390 * MS
    feed.arm()
    assert feed.store.timely_since_ns() is None
    feed.delay_ns = 2 * MS
    feed.now_ns += 5 * MS
    feed.arm()
    assert feed.store.timely_since_ns() == feed.now_ns


def test_an_arm_whose_pose_is_needed_is_seedable_only_with_poses_of_the_same_time():
    """Poses that came before the samples went steady may be from before a stall, and fewer than three may be one."""
    hands = Hands()
    hands.run(3)
    hands.now_ns += S
    hands.run(40, with_pose=False)
    assert hands.store.seedable(Side.LEFT, hands.now_ns) and not hands.seedable()
    for is_enough in (False, False, True):
        hands.run(1)
        assert hands.seedable() is is_enough
    hands.now_ns += 101 * MS
    assert not hands.seedable()


@pytest.mark.parametrize(
    ("is_turned", "off", "agrees"),
    [(False, 0.009, True), (False, 0.011, False), (True, 0.04, True), (True, 0.06, False)],
)
def test_one_pose_is_not_where_an_end_effector_is(is_turned, off, agrees):
    """1 cm and 0.05 rad are noise and a slow hand; more stops a stream from starting until it is 50 ms old."""
    hands = Hands()
    hands.run(40)
    x, turned = (0.0, off) if is_turned else (off, 0.0)
    hands.run(1, x_m=0.1 + x, angle_rad=turned)
    assert hands.seedable() is hands.store.agreed(Side.LEFT, needs_pose=True) is agrees
    assert hands.store.agreed(Side.LEFT) and hands.store.seedable(Side.LEFT, hands.now_ns), "its joints do"
    hands.run(5)
    assert hands.seedable() is agrees
    hands.run(1)
    assert hands.seedable()


def test_one_sample_is_not_where_an_arm_is(feed):
    """A stream starts from samples that agree: one that is off stops it until it is 50 ms old, and few are too few."""
    feed.run(1 * S)
    assert feed.seedable() and feed.store.agreed(Side.LEFT) and not feed.store.agreed(Side.RIGHT)
    feed.q = 0.03
    feed.run(10 * MS)
    assert feed.store.part_fresh(Side.LEFT, feed.now_ns, False)
    assert not feed.seedable() and not feed.store.agreed(Side.LEFT)
    feed.q = 0.0
    feed.run(50 * MS)
    assert not feed.seedable()
    feed.run(10 * MS)
    assert feed.seedable() and feed.store.agreed(Side.LEFT)


def test_a_slow_arm_agrees_with_itself_and_a_fast_one_does_not(feed):
    """0.3 rad/s and 0.6 rad/s."""
    for speed_radps, agrees in ((0.3, True), (0.6, False)):
        for _ in range(60):
            feed.q += speed_radps * 0.01
            feed.run(10 * MS)
        assert feed.store.agreed(Side.LEFT) is agrees is feed.seedable()


def test_what_was_said_before_a_silence_agrees_with_nothing_after_it(feed):
    """The first sample after 0.8 s is alone: what the arm did meanwhile nobody saw, and it may be an old one."""
    feed.run(1 * S)
    feed.now_ns += 800 * MS
    for is_enough in (False, False, True):
        feed.run(10 * MS)
        assert feed.store.agreed(Side.LEFT) is is_enough
