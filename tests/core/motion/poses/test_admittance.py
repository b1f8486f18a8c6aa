"""The virtual mass: it follows what pushes it, swings neither by itself nor when something holds it, and winds nothing up."""

from __future__ import annotations

import math

import pytest

from gateway.core.limits.admittance_rules import HELD, LAG_S, LEAST_DAMPING, MASSES
from gateway.core.motion.motion import PoseReference
from gateway.core.motion.poses.admittance import MOST_TURN_RAD, VirtualMass
from gateway.core.motion.poses.pose_follower import followed
from gateway.core.motion.poses.quaternion import turn
from gateway.settings.settings import PoseSettings

SETTINGS = PoseSettings()
PERIOD_S = 1.0 / SETTINGS.rate_hz
HERE = (0.10, 0.10, -0.20, 0.0, 0.0, 0.0, 1.0)
STILL = (0.0,) * 6
OUTSIDE_S = 0.13
"""Of the lag, what the observer and the robot have; the rest is that of the setpoints themselves [s]."""
SHIFTED, TURNED = 0, 5
"""Along x; about z."""


class Hand:
    """A virtual mass and the reference that follows it.

    Args:
        axis: The axis that is free, or all with None.
        damping: Of each free axis, the least that is permitted of each kind by default.
    """

    def __init__(self, mass, damping=None, stiffness=0.0, axis=SHIFTED):
        free = range(6) if axis is None else (axis,)
        damps = [LEAST_DAMPING[n // 3] if damping is None else damping for n in range(6)]
        masses = tuple(mass if n in free else None for n in range(6))
        self.axis = axis
        self.mass = VirtualMass(masses, tuple(damps), (stiffness,) * 6)
        self.mass.anchor = HERE
        self.mass.rest(HERE)
        self.reference = PoseReference(SETTINGS, PERIOD_S)
        self.reference.seed(HERE)

    def step(self, force=STILL, share=1.0):
        """Let a period pass; return where the setpoint is along or about the free axis, from the anchor."""
        self.reference.follow(self.mass.step(self.reference.space, force, share), 1.0)
        return self.away(self.reference.step())

    def push(self, size, share=1.0):
        """The same while the free axis is pushed."""
        return self.step(tuple(size if n == self.axis else 0.0 for n in range(6)), share)

    def away(self, pose):
        """How far a pose is from the anchor, along or about the free axis."""
        both = [x - x0 for x, x0 in zip(pose[:3], HERE[:3], strict=True)] + list(turn(HERE[3:], pose[3:]))
        return both[self.axis or 0]


@pytest.mark.parametrize(("axis", "force"), [(SHIFTED, 9.0), (TURNED, 1.8)])
def test_a_steady_push_moves_it_by_its_damping(axis, force):
    """V = F / D, whatever its mass, and both for shifts and for turns."""
    kind = axis // 3
    hand = Hand(MASSES[kind][0] * 4.0, axis=axis)
    places = [hand.push(force) for _ in range(140)]
    speed = (places[-1] - places[-71]) / (70 * PERIOD_S)
    assert speed == pytest.approx(force / LEAST_DAMPING[kind], rel=0.02)


@pytest.mark.parametrize("mass", [MASSES[0][0], 8.0, MASSES[0][1]])
def test_let_go_it_comes_to_rest_without_turning_round(mass):
    """Without a spring it stays there, no further than it would coast: what is followed is never beyond that."""
    hand = Hand(mass)
    for _ in range(70):
        hand.push(20.0)
    coasts = hand.away(hand.mass.place) + hand.mass._v[0] * mass / LEAST_DAMPING[0]
    places = [hand.step() for _ in range(400)]
    assert places[-1] == pytest.approx(coasts, abs=2e-4) and max(places) < min(coasts, places[-1]) + 1e-4
    assert hand.reference.is_at_rest or places[-1] - places[-2] < 1e-6


@pytest.mark.parametrize(
    ("axis", "part", "mass"), [(SHIFTED, 0.2, 1), (SHIFTED, 1.0, 0), (TURNED, 0.2, 0), (TURNED, 1.0, 1)]
)
def test_a_spring_leads_it_home_without_overshoot(axis, part, mass):
    """Over the range that is permitted: no further beyond the anchor than a hundredth of the way."""
    kind = axis // 3
    inertia, damping = MASSES[kind][mass] * (0.4 if mass else 1.0), LEAST_DAMPING[kind] * (3.0 if mass else 1.0)
    hand = Hand(inertia, damping, part * damping**2 / (4.0 * inertia), axis)
    for _ in range(100):
        hand.push(30.0 if kind == 0 else 3.0)
    places = [hand.step() for _ in range(1000)]
    assert min(places) > -0.01 * max(places) and abs(places[-1]) < 0.02 * max(places)


def held(mass, damping, stiffness, way_m, axis=SHIFTED, settle_s=5.0):
    """How much the setpoint still swings after a while, as a part of how far something stiff, which pulls late, is away."""
    hand, late = Hand(mass, damping, stiffness, axis), [0.0] * round(OUTSIDE_S / PERIOD_S)
    places = []
    for _ in range(round(settle_s / PERIOD_S)):
        late.append(HELD[axis // 3] * (way_m - hand.away(hand.reference.values)))
        places.append(hand.push(late.pop(0)))
    last = places[-round(1.5 / PERIOD_S) :]
    return (max(last) - min(last)) / way_m


@pytest.mark.parametrize(("axis", "ways"), [(SHIFTED, (0.01, 0.1)), (TURNED, (0.05, 0.3))])
@pytest.mark.parametrize("part", [0.0, 1.0])
@pytest.mark.parametrize("mass", [0.0, 1.0])
def test_held_by_what_is_stiff_it_does_not_swing_whatever_its_mass_and_spring(axis, ways, part, mass):
    """The least damping against the stiffness and the lag for which it was worked out, near and far away: it dies away."""
    low, high = MASSES[axis // 3]
    inertia, damping = low + mass * (high - low), LEAST_DAMPING[axis // 3]
    assert damping == pytest.approx(HELD[axis // 3] * LAG_S)
    for way in ways:
        assert held(inertia, damping, part * damping**2 / (4.0 * inertia), way, axis) < 0.1


def test_with_a_third_of_the_damping_that_is_permitted_it_would_swing():
    """The bound is no idle one."""
    assert held(5.0, LEAST_DAMPING[0] / 3.0, 0.0, 0.01) > 0.5


def test_it_is_never_faster_than_setpoints_may_be_nor_beyond_the_reach():
    """However it is pushed: nothing winds up, and let go it is where the setpoint is."""
    hand = Hand(1.0, axis=None)
    _, top_mps, _, top_radps, _ = followed(hand.reference.space)
    for n in range(400):
        before = hand.mass.place
        hand.step((500.0, 300.0, -200.0, 50.0, 0.0, 50.0), share=0.5)
        if n < 20:
            assert math.dist(before[:3], hand.mass.place[:3]) <= 0.5 * top_mps * PERIOD_S * 1.001
            assert math.hypot(*turn(before[3:], hand.mass.place[3:])) <= 0.5 * top_radps * PERIOD_S * 1.001
    assert math.hypot(*hand.mass.place[:3]) <= SETTINGS.reach_m
    assert math.hypot(*turn(HERE[3:], hand.mass.place[3:])) == pytest.approx(MOST_TURN_RAD, rel=1e-6)
    assert math.dist(hand.mass.place[:3], hand.reference.values[:3]) < 2e-3
    places = [hand.step((-60.0, 0.0, 0.0, 0.0, 0.0, 0.0)) for _ in range(20)]
    assert places[-1] < places[0] - 0.005, "pushed back, it comes back at once"


def test_locked_axes_stay_with_the_anchor_wherever_that_goes():
    """They are led as by a stream of poses; the free one stays where it was pushed to."""
    hand = Hand(5.0)
    for _ in range(70):
        hand.step((20.0, 90.0, 90.0, 9.0, 9.0, 9.0))
    x = hand.mass.place[0]
    assert x > HERE[0] + 0.05 and hand.mass.place[1:] == pytest.approx(HERE[1:])
    hand.mass.anchor = (0.2, 0.15, -0.25, 0.0, math.sin(0.1), 0.0, math.cos(0.1))
    for _ in range(200):
        hand.step()
    assert hand.reference.values[1:] == pytest.approx(hand.mass.anchor[1:], abs=1e-6)
    assert hand.reference.values[0] == pytest.approx(x, abs=0.02)


def test_it_rests_where_it_is_told_to_begin():
    """And forgets how it went and what pushed it."""
    hand = Hand(5.0)
    for _ in range(20):
        hand.push(50.0)
    hand.mass.rest(HERE)
    assert (hand.mass.place, hand.mass.force, hand.mass._v) == (HERE, STILL, STILL)
