"""What no arm can have moved to is refused with value and bound, and believed once it has lasted."""

from __future__ import annotations

import math

import pytest

from gateway.core.jumps import JOINTS, JUMP_MPS, JUMP_RADPS, POSES, JumpGuard, Posture
from gateway.settings import EnableSettings

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


def test_the_robots_stamps_tell_how_much_time_a_burst_is_about():
    """Samples that waited arrive together; they are as far apart as their stamps."""
    feed = Feed()
    feed.give(ZERO, stamp_ns=0)
    assert feed.give(joint(1, 1.0), 1 * MS, stamp_ns=100 * MS) == ""
    assert feed.give(joint(1, 0.0), 1 * MS, stamp_ns=101 * MS) != ""


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
