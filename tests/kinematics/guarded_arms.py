"""Both arms in a closed loop for tests: real followers and brakes at 100 Hz, led by the rule of `approach.py`."""

from __future__ import annotations

import random
import time
from functools import cache

from gateway.core.motion.joints.braking import Braking, JointLimits, advance
from gateway.core.motion.joints.follower import JointFollower
from gateway.core.motion.space import State
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.correction import NOWHERE, ArmCorrection, corrected
from gateway.kinematics.description import nominal
from gateway.kinematics.placement import Placement, rows_from_rpy
from gateway.kinematics.separation.approach import Approach
from gateway.kinematics.separation.judgement import Motion
from gateway.kinematics.separation.stopping import stop_extent, way_extent
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.values import Side

__all__ = [
    "DT_S",
    "LIMITS",
    "MARGIN_M",
    "MEET",
    "OWN",
    "ROUNDING_M",
    "ZEROS_RAD",
    "GuardedArms",
    "calibrated",
    "free_posture",
    "model",
    "random_joints",
    "really",
]

DT_S = 0.01
MARGIN_M = 0.02
ROUNDING_M = 1e-6
LIMITS = [(1.0, 3.0, 20.0), (3.0, 15.0, 300.0), (0.1, 3.0, 20.0), (3.0, 3.0, 20.0), (0.5, 1.0, 5.0), (3.0, 1.0, 300.0)]
"""Velocity, acceleration, jerk: the defaults, the hard limits, and what a config may mix."""
MEET = {
    Side.LEFT: (1.49, 1.28, -1.14, 1.75, 0.72, -0.66, 0.57),
    Side.RIGHT: (-1.65, -0.99, 1.07, -2.02, 0.56, 0.25, -0.65),
}
"""Both hands in the same place before the chest, if they could."""
ZEROS_RAD = {
    Side.LEFT: (0.02, -0.03, 0.02, 0.06, -0.02, 0.02, 0.03),
    Side.RIGHT: (-0.02, -0.04, 0.01, -0.05, 0.02, 0.03, -0.01),
}
"""Of a calibrated robot: what its joints really are beyond what they report."""
OWN = Placement((0.004, 0.003, -0.002), rows_from_rpy((0.01, 0.0, 0.008)))
"""By how much frames of such a robot are displaced."""
SEVEN = range(7)


@cache
def model():
    """Return the nominal body."""
    return CollisionModel(nominal())


def calibrated(own: Placement = NOWHERE):
    """Return the numbers of a robot with these zeros, its hands and its left shoulder displaced."""
    left = ArmCorrection(offsets_rad=ZEROS_RAD[Side.LEFT], ee=own, shoulder=own)
    right = ArmCorrection(offsets_rad=ZEROS_RAD[Side.RIGHT], ee=own)
    return corrected(corrected(nominal(), Side.LEFT, left), Side.RIGHT, right)


def really(q_rad):
    """Return the joints that such a robot really has."""
    return {side: tuple(q + zero for q, zero in zip(q_rad[side], ZEROS_RAD[side], strict=True)) for side in Side}


def random_joints(rng: random.Random):
    """Return joint angles of both arms anywhere inside the limits."""
    return {
        side: tuple(rng.uniform(a, b) for a, b in zip(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True))
        for side in Side
    }


def free_posture(rng: random.Random, gap_m: float = 0.03):
    """Return joint angles at which the body keeps more than a gap."""
    while True:
        q_rad = random_joints(rng)
        if model().posture(q_rad).nearest().gap_m > gap_m:
            return q_rad


class GuardedArms:
    """Arms that follow targets; the body is looked at where it was one tick before."""

    def __init__(self, start, v_radps: float, a_radps2: float, j_radps3: float, *, is_guarded: bool = True) -> None:
        zeros = (0.0,) * 7
        self.v, self.a, self.j = v_radps, a_radps2, j_radps3
        self.now = {side: (tuple(start[side]), zeros, zeros) for side in Side}
        self._is_guarded = is_guarded
        self._rule = Approach(model())
        self._brakes = {side: Braking(self._limits(side), DT_S) for side in Side}
        self._followers = {side: JointFollower(self._brakes[side]) for side in Side}
        self._seen = dict(start)
        self.gap = model().posture(start).nearest()
        self.least_m = self.gap.gap_m
        self.states = [self.now]
        self.refused = 0
        self.judged_us: list[float] = []
        """What the rule took for each tick, with all that it needs to know, in processor time of the thread [us]."""
        for follower in self._followers.values():
            follower.begin()

    def _limits(self, side):
        lower, upper = JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side]
        return JointLimits(v_radps=self.v, a_radps2=self.a, j_radps3=self.j, lower_rad=lower, upper_rad=upper)

    @property
    def q_rad(self):
        """Setpoints."""
        return {side: self.now[side][0] for side in Side}

    def off_rad(self, q_rad) -> float:
        """Return how far the joint farthest from its goal is."""
        return max(abs(a - b) for side in Side for a, b in zip(self.now[side][0], q_rad[side], strict=True))

    def stream(self, target, seconds: float) -> None:
        """Follow a target; stop early when it is reached and all stand."""
        for side in Side:
            self._followers[side].aim(tuple(target[side]), 1.0, self.now[side])
        for _ in range(int(seconds / DT_S)):
            self.tick()
            if self.off_rad(target) < 1e-9 and not any(map(any, (self.now[side][1] for side in Side))):
                return

    def tick(self) -> None:
        """Go on by one setpoint."""
        wanted = {side: self._followers[side].follow(self.now[side]) for side in Side}
        if self._is_guarded:
            wanted = self._led(wanted)
        self._seen, self.now = self.q_rad, wanted
        self.states.append(wanted)
        self.gap = model().posture(self.q_rad).nearest()
        self.least_m = min(self.least_m, self.gap.gap_m)

    def _led(self, wanted):
        braked = {side: self._brake(side) for side in Side}
        begun_ns = time.thread_time_ns()
        motion = Motion(
            wanted=self._ways(wanted),
            braked=lambda: self._ways(braked),
            speed_radps={side: wanted[side][1] for side in Side},
        )
        verdict = self._rule.look(self._seen, motion.wanted).judge(motion)
        self.judged_us.append((time.thread_time_ns() - begun_ns) / 1e3)
        self.refused += not verdict.is_free
        for side, follower in self._followers.items():
            follower.bound(min(1.0, verdict.limit_radps[side] / self.v))
        return {
            side: State(
                *(
                    tuple(w if goes else b for w, b, goes in zip(*rows, verdict.going[side], strict=True))
                    for rows in zip(wanted[side], braked[side], strict=True)
                )
            )
            for side in Side
        }

    def _brake(self, side):
        brakes = self._brakes[side]
        ends = [advance(q, v, a, brakes.stop(v, a), DT_S) for q, v, a in zip(*self.now[side], strict=True)]
        return tuple(zip(*ends, strict=True))

    def _ways(self, states):
        return {
            side: [
                way_extent(self._seen[side][k], (self.now[side][0][k], q[k]), stop_extent(v[k], a[k], self.a, self.j))
                for k in SEVEN
            ]
            for side, (q, v, a) in states.items()
        }
