"""Watching while somebody moves the arms: how far identification is, what motion it lacks, and when it is enough.

Each second one line tells what the postures carry. From time to time what there is is fitted, more rarely the longer it
will take: that costs a second, in which nothing is looked at. It is enough when every arm asked about is identified.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gateway.cli.body.pairs import Pairs
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.identification.excitation import LEAST_GAIN, distinct, excitation_of
from gateway.kinematics.identification.pairing import Pair
from gateway.kinematics.identification.parameters import Group, Parameters
from gateway.kinematics.identify import Identification, Why, identify
from gateway.values import ARM_DOF, Side

__all__ = ["Observer"]

FIRST_S = 10.0
"""Sooner nothing is fitted [s]."""
SOONEST_S, LATEST_S = 5.0, 20.0
"""Between fits of an arm there is half of the time that it will probably take, within these [s]."""


class Observer:
    """What is told each second, and whether there is enough; a function for `measured_live`."""

    def __init__(
        self,
        arms: Mapping[Side, ArmModel],
        sides: Sequence[Side],
        groups: frozenset[Group],
        say: Callable[[str], None] | None = None,
    ) -> None:
        self._arms = {side: arms[side] for side in sides}
        self._groups = groups
        self._say = say or _to_stderr
        self._due_s = dict.fromkeys(sides, FIRST_S)
        self._found: dict[Side, str] = {}
        """What the last fit of each arm said."""
        self._done: set[Side] = set()

    def __call__(self, so_far: Pairs, passed_s: float, left_s: float) -> bool:
        """Tell how far it is; return whether it is enough."""
        said = []
        for side, arm in self._arms.items():
            if passed_s >= self._due_s[side] and side not in self._done:
                self._fit(arm, so_far[side], passed_s)
            said.append(f"{self._carries(arm, so_far[side])}{self._found.get(side, '')}")
        self._say(f"at most {left_s:.0f} s more; {'; '.join(said)}")
        return len(self._done) == len(self._arms)

    def _fit(self, arm: ArmModel, pairs: Sequence[Pair], passed_s: float) -> None:
        """Fit what there is; take note of what it lacks, and of when to do it again."""
        result = identify(arm, pairs, self._groups)
        wait_s = SOONEST_S
        if isinstance(result, Identification):
            self._done.add(arm.side)
            self._found[arm.side] = ", enough"
        elif result.missing is not None:
            more_s = (result.missing - 1.0) * passed_s
            wait_s = min(max(0.5 * more_s, SOONEST_S), LATEST_S)
            self._found[arm.side] = f", {result.message.split(' (')[0]}: some {more_s:.0f} s more of such motion"
        else:
            self._found[arm.side] = "" if result.why in (Why.FEW, Why.BLURRED) else f", {result.why.value}"
        self._due_s[arm.side] = passed_s + wait_s

    def _carries(self, arm: ArmModel, pairs: Sequence[Pair]) -> str:
        """Return how far an arm's postures carry, and what to move next."""
        q_rad = np.array([pair.q_rad for pair in pairs]).reshape(-1, ARM_DOF)
        q_rad = q_rad[distinct(q_rad)]
        if len(q_rad) < 2:
            return f"{arm.side}: stands still"
        known = excitation_of(
            Parameters(arm.chain, self._groups), q_rad, np.array(arm.lower_rad), np.array(arm.upper_rad)
        )
        move = f", move joint {known.advice[0].joint}" if known.advice else ""
        return f"{arm.side}: {len(q_rad)} postures, gain {known.gain:.3f} of {LEAST_GAIN:g}{move}"


def _to_stderr(line: str) -> None:
    print(line, file=sys.stderr)
