"""What no arm can have moved to is refused with value and bound, and believed once it has lasted."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.robot_state.jumps import JOINTS, JUMP_MPS, JUMP_RADPS, POSES, JumpGuard, Posture
from gateway.settings.settings import EnableSettings

MS = 1_000_000
S = 1_000_000_000
ZERO = (0.0,) * 7
POSE = (0.3, 0.0, -0.2, 0.0, 0.0, 0.0, 1.0)


class Feed:
    """A guard that is given a sample every 10 ms."""

    def __init__(self, kind=JOINTS) -> None:
        self.guard = JumpGuard(kind, EnableSettings())
        self.now_ns = 10 * S

    def give(self, values, after_ns: int = 10 * MS, stamp_ns: int | None = None) -> str:
        """One sample; return why it is refused."""
        self.now_ns += after_ns
        return self.guard.why_not(Posture(values, self.now_ns, self.now_ns if stamp_ns is None else stamp_ns))

    def refusals(self, values, samples: int) -> int:
        """Give the same again and again; return how often it was refused."""
        return sum(bool(self.give(values)) for _ in range(samples))


def joint(number: int, rad: float) -> tuple[float, ...]:
    """A posture that differs from zero in one joint."""
    return tuple(rad if n == number else 0.0 for n in range(1, 8))


def turned(rad: float, sign: float = 1.0) -> tuple[float, ...]:
    """A pose turned about x."""
    return (*POSE[:3], sign * math.sin(rad / 2), 0.0, 0.0, sign * math.cos(rad / 2))


def test_the_first_sample_is_believed_whatever_it_is():
    """There is nothing to compare it with; so after a loss of the transport."""
    feed = Feed()
    assert feed.give(joint(1, 3.0)) == ""
    feed.guard.believe(None)
    assert feed.give(joint(1, -3.0)) == ""


@pytest.mark.parametrize("gap_ms", [5, 10, 50, 90])
def test_a_step_may_be_as_long_as_an_arm_needs_for_it(gap_ms: int):
    """10 rad/s for the time since the last believed sample, and 0.1 rad of noise; one step, not the sum of all joints'."""
    bound_rad = JUMP_RADPS * gap_ms / 1000 + 0.1
    feed = Feed()
    feed.give(ZERO)
    assert feed.give((0.99 * bound_rad,) * 7, gap_ms * MS) == ""
    feed.give(ZERO, S)
    why = feed.give(joint(3, -1.01 * bound_rad), gap_ms * MS)
    assert why.startswith(f"joint 3 is {1.01 * bound_rad:.3f} rad away from where it was {gap_ms} ms ago")
    assert f"at most {bound_rad:.3f} rad is plausible (10 rad/s and 0.1 rad of noise)" in why


@pytest.mark.parametrize("ahead_ns", [100 * MS, 10 * S, 3600 * S])
def test_no_stamp_makes_a_jump_plausible(ahead_ns: int):
    """A robot's clock that steps ahead, or somebody on its network, says that there was time; our clock knows."""
    feed = Feed()
    feed.give(ZERO)
    assert feed.give(joint(1, 0.6), stamp_ns=feed.now_ns + 10 * MS + ahead_ns).startswith("joint 1 is 0.600 rad away")
    assert feed.give(joint(1, 0.1)) == ""


def test_a_stamp_may_say_that_there_was_less_time():
    """The second sample of a stall is as old as it says, though nothing came before it for long."""
    feed = Feed()
    feed.give(ZERO)
    old_ns = feed.now_ns
    assert feed.give(joint(1, 0.5), S, stamp_ns=old_ns + 10 * MS) != ""
    assert feed.give(joint(1, 0.19), 0, stamp_ns=old_ns + 10 * MS) == ""


def test_a_gap_of_arrivals_gives_its_time_to_what_was_queued_in_it():
    """Once: what comes after it has the time since the gap, and that of its own stamp."""
    feed = Feed()
    feed.give(ZERO)
    old_ns = feed.now_ns
    assert feed.give(ZERO, 500 * MS, stamp_ns=old_ns + 10 * MS) == ""
    assert feed.give(joint(1, 3.0), 1 * MS, stamp_ns=old_ns + 310 * MS) == ""
    assert feed.give(joint(1, 0.6), 1 * MS, stamp_ns=old_ns + 610 * MS) != "", (
        "0.19 s are left, and were asked for 2.4 rad"
    )


def test_a_clock_that_runs_slow_saves_no_time_up():
    """Nor one that is set back again and again: spare time is at most the longest gap of arrivals."""
    feed = Feed()
    stamp_ns = 0
    for n in range(3000):
        stamp_ns += 1 if n % 7 else -S
        assert feed.give(ZERO, stamp_ns=stamp_ns) == ""
    assert feed.give(joint(1, 0.35), stamp_ns=stamp_ns + 10 * S) != ""


@given(
    data=st.data(),
    period_ms=st.sampled_from([4, 10, 20]),
    stalls_ms=st.lists(st.sampled_from([0, 0, 0, 3, 15, 80, 200, 500, 800]), max_size=40),
    newest_only=st.booleans(),
)
def test_no_stall_of_the_link_makes_a_healthy_arm_incredible(data, period_ms, stalls_ms, newest_only):
    """An arm at 3 rad/s, whose samples wait in stalls and come in bursts, all of them or the newest of each look."""
    feed, made_ns, turned_at_ns, q, sign = Feed(), 0, 0, 0.0, 1.0
    queue: list[tuple[int, float]] = []
    start_ns = feed.now_ns
    feed.give(ZERO, 0, stamp_ns=5 * S)
    for stall_ms in [*stalls_ms, 0, 0]:
        due_ns = feed.now_ns - start_ns + max(stall_ms, period_ms) * MS
        while made_ns + period_ms * MS <= due_ns:
            made_ns += period_ms * MS
            if made_ns - turned_at_ns > 400 * MS and data.draw(st.booleans()):
                sign, turned_at_ns = -sign, made_ns
            q += sign * 3.0 * period_ms / 1000
            queue.append((made_ns, q))
        after_ns = due_ns - (feed.now_ns - start_ns)
        looks = data.draw(st.integers(1, 3))
        while queue:
            count = len(queue) if looks == 1 else max(1, len(queue) // looks)
            part, queue = queue[:count], queue[count:]
            for stamp_ns, value in part[-1:] if newest_only else part:
                assert feed.give(joint(1, value), after_ns, stamp_ns=5 * S + stamp_ns) == ""
                after_ns = 0
            looks = max(1, looks - 1)


def test_waiting_makes_no_jump_plausible_but_lasting_does():
    """Refused for 0.3 s, 30 samples, however small; then it is the truth, and that is told."""
    feed = Feed()
    feed.give(ZERO)
    assert feed.refusals(joint(5, 0.3), 40) == 30
    assert feed.guard.jumped == ""  # only the sample with which it was believed tells
    feed.give(ZERO)
    feed.guard.believe(Posture(ZERO, feed.now_ns, feed.now_ns))
    seen = [feed.guard.jumped for _ in range(40) if feed.give(joint(5, 0.3)) == "" and feed.guard.jumped]
    assert len(seen) == 1 and seen[0].startswith("joint 5 is 0.300 rad away") and "believed from now on" in seen[0]


def test_a_glitch_between_good_samples_leaves_no_trace():
    """The next good sample is believed; a later glitch begins anew."""
    feed = Feed()
    feed.give(ZERO)
    for _ in range(50):
        assert feed.refusals(joint(2, 1.0), 20) == 20
        assert feed.give(ZERO) == ""


def test_a_rival_must_go_on_within_itself():
    """Noise between two wrong values, or a wrong value with holes, never lasts."""
    feed = Feed()
    feed.give(ZERO)
    assert all(feed.give(joint(2, 1.0 + (n % 2))) for n in range(100))
    feed = Feed()
    feed.give(ZERO)
    assert all(feed.give(joint(2, 3.0), 150 * MS) for _ in range(20))


def test_a_pose_may_not_jump_either():
    """Position and orientation, each by its bound; the worse one is named; a flipped quaternion is the same pose."""
    feed = Feed(POSES)
    feed.give(POSE)
    assert feed.give((*POSE[:3], *(-q for q in POSE[3:]))) == ""
    assert feed.give((POSE[0] + 0.15, *POSE[1:])) == ""
    why = feed.give((POSE[0] - 0.4, *POSE[1:]))
    assert why.startswith("the position is 0.550 m away") and f"({JUMP_MPS:g} m/s and 0.11 m of noise)" in why
    feed = Feed(POSES)
    feed.give(turned(0.0))
    assert feed.give(turned(0.5, -1.0)) == ""
    assert feed.give(turned(2.5)).startswith("the orientation is 2.000 rad away")
    assert feed.refusals(turned(2.5), 40) == 29 and feed.give(turned(2.5)) == ""
