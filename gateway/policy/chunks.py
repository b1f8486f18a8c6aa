"""Action chunks: an answer's rows as arms and grippers on one clock, and the arithmetic of joining them. Pure.

A chunk's clock begins when its policy looked, not when its answer came: the steps that passed meanwhile are never played.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from gateway.errors import Code, GatewayError, failure
from gateway.policy.policy_map import Actions
from gateway.robot.vector_layout import command_of_effort

__all__ = ["MIN_STEPS", "ROUNDED", "Chunk", "chunk_of", "refused", "retry_after_ns"]

SMOOTHED_TWICE = 2
"""The gateway takes the mean of means: a step depends on neighbours up to twice the smoothing away."""
CURVED = 3
"""A way between steps depends on so many neighbours more."""
FADES = 2
"""So many times as long does a chunk take to fade into the next one."""
MIN_STEPS = 2
"""Fewer steps make no motion."""
ANOTHER = "ask a server whose policy fits this robot and --map; nothing of this answer was sent"
MAX_STEPS = 450
"""The gateway takes no more in one request."""
ROUNDED = 1e-6
"""A velocity may be above its bound by this part, as float32 rounds; the gateway allows nothing."""


class Chunk(Struct, frozen=True, kw_only=True):
    """What a policy wants next.

    Attributes:
        arms: Per side the joints of each step [rad], shape (H, 7).
        grips: Per side the gripper's command of each step, 0..1, shape (H,).
        drives: Of `chassis` vx, vy [m/s] and wz [rad/s] of each step, shape (H, 3); of `lift`
            the part of full speed, -1 (down) to 1 (up), shape (H, 1).
        observed_ns: When step 0 is: the policy looked then [ns].
        period_ns: From step to step [ns].
    """

    arms: Mapping[str, NDArray[np.float64]]
    grips: Mapping[str, NDArray[np.float64]]
    observed_ns: int
    period_ns: int
    drives: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """How many steps it has."""
        return len(next(iter(self.arms.values())))

    @property
    def end_ns(self) -> int:
        """When its last step is [ns]."""
        return self.observed_ns + (self.steps - 1) * self.period_ns

    def passed(self, now_ns: int) -> int:
        """Return how many of its steps lie before an instant."""
        return min(self.steps, max(0, -((self.observed_ns - now_ns) // self.period_ns)))

    def is_over(self, now_ns: int) -> bool:
        """Return whether its last step has passed, or is the only one left."""
        return now_ns >= self.end_ns

    def row(self, now_ns: int) -> int:
        """Return the step that counts at an instant; the last one stays."""
        return min(self.steps - 1, max(0, (now_ns - self.observed_ns) // self.period_ns))

    def at(self, at_ns: int | NDArray[np.int64], side: str) -> NDArray[np.float64]:
        """Return where it has an arm at an instant, or at many, between its steps, too [rad]; shape (..., 7)."""
        place = (at_ns - self.observed_ns) / self.period_ns
        return np.stack([np.interp(place, np.arange(self.steps), q) for q in self.arms[side].T], axis=-1)

    def gap(self, now_ns: int, measured: Mapping[str, NDArray[np.float64]]) -> tuple[float, str, int]:
        """Return how far the farthest joint is from where the chunk is at an instant [rad], its side and number, 1 to 7."""
        row = self.row(now_ns)
        away = {side: np.abs(joints[row] - measured[side]) for side, joints in self.arms.items()}
        return max((float(gap), side, n + 1) for side, gaps in away.items() for n, gap in enumerate(gaps))

    def smoothing_s(self, wanted_s: float) -> float:
        """Return the smoothing nearest to one that is wanted that so few, or so distant, steps allow [s]."""
        return min(round(wanted_s * 1e9 / self.period_ns), self.steps - 1) * self.period_ns / 1e9

    def joined_to(self, before: Chunk | None, now_ns: int, smoothing_s: float) -> Chunk:
        """Return the arms' way of this chunk after one that plays: nobody sees where they meet, as long as they are near.

        Up to now, and for twice the smoothing from now on, it is the old way step by step: so far has smoothing looked ahead
        already, and where the gateway takes over nothing may differ. Then the difference fades, for four times the smoothing,
        velocity and acceleration without a step; behind the end of the old way its last difference does. Where little of this
        chunk is left, a quarter and a half of that instead. Without smoothing the gateway joins them as fast as it may.

        Args:
            before: The chunk that plays; None for none.
            now_ns: The instant at which this one begins to count [ns].
            smoothing_s: Over how much time jitter is averaged on each side of a step [s].
        """
        period_ns = self.period_ns
        reach = SMOOTHED_TWICE * round(smoothing_s * 1e9 / period_ns)
        if before is None or not reach or before.end_ns <= now_ns:
            return self
        begin = max(0, before.passed(now_ns) - reach - CURVED)
        at_ns = np.arange(before.observed_ns + begin * period_ns, self.end_ns + 1, period_ns)[-MAX_STEPS:]
        left_ns = self.end_ns - now_ns
        held_ns, fade_ns = min(reach * period_ns, left_ns // 4), min(FADES * reach * period_ns, left_ns // 2)
        if fade_ns <= 0 or len(at_ns) < MIN_STEPS:
            return self
        share = np.clip((at_ns - now_ns - held_ns) / fade_ns, 0.0, 1.0)[:, np.newaxis]
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        both_ns = np.clip(at_ns, self.observed_ns, max(self.observed_ns, before.end_ns))
        is_old = (at_ns < self.observed_ns)[:, np.newaxis]
        arms = {}
        for side in self.arms:
            way = self.at(at_ns, side) + (1.0 - share) * (before.at(both_ns, side) - self.at(both_ns, side))
            arms[side] = np.where(is_old, before.at(at_ns, side), way)
        return Chunk(arms=arms, grips={}, observed_ns=int(at_ns[0]), period_ns=period_ns)

    def over_speed(self, v_radps: float) -> int:
        """Return how many steps ask a joint for more than a velocity [rad/s]."""
        too_fast = [np.abs(np.diff(q, axis=0)).max(axis=1) * 1e9 / self.period_ns > v_radps for q in self.arms.values()]
        return int(np.logical_or.reduce(too_fast).sum())

    def require_drivable(self, v_mps: float, w_radps: float, lift: float) -> None:
        """Refuse a chunk that drives faster: over the ground [m/s], turning [rad/s], the lift as a part of full speed.

        Raises:
            Rejected: OUT_OF_RANGE, with value and bound.
        """
        chassis, lifted = self.drives.get("chassis", np.zeros((1, 3))), self.drives.get("lift", np.zeros(1))
        for wanted, bound, what in (
            (np.hypot(chassis[:, 0], chassis[:, 1]), v_mps, "m/s of the chassis"),
            (chassis[:, 2], w_radps, "rad/s of the chassis"),
            (lifted, lift, "of the lift's full speed"),
        ):
            value = float(np.abs(wanted).max())
            if value > bound * (1.0 + ROUNDED):
                message = f"the policy wants {value:.3g} {what}, {bound:g} is the bound"
                raise refused(Code.OUT_OF_RANGE, message, f"{value:.4g}", f"{bound:g}")

    def ask_ns(self, horizon: int, delay_ns: int) -> int:
        """Return when the next chunk should be asked for, to be there once `horizon` steps were played [ns]."""
        return self.observed_ns + min(horizon, self.steps - 1) * self.period_ns - delay_ns


def chunk_of(answer: Mapping[Any, Any], layout: Actions, observed_ns: int, period_ns: int) -> Chunk:
    """Return the chunk of an answer.

    Args:
        answer: Of the server.
        layout: What its actions consist of.
        observed_ns: When the policy looked [ns].
        period_ns: From step to step [ns].

    Raises:
        Rejected: WRONG_SHAPE or NOT_FINITE, with value and bound.
    """
    key, its = layout.key, f"the policy server's {layout.key}"
    wanted = f"(H, {layout.width}), H from {MIN_STEPS} to {MAX_STEPS}"
    if key not in answer:
        message = f"the policy server's answer has no {key!r}, only {sorted(map(str, answer))}"
        raise refused(Code.WRONG_SHAPE, message, bound=key)
    try:
        actions = np.asarray(answer[key])
    except ValueError:  # rows of different lengths
        raise refused(Code.WRONG_SHAPE, f"{its} are no table of numbers, {wanted} is needed", bound=wanted) from None
    shape, kind = str(actions.shape), str(actions.dtype)
    if actions.ndim != 2 or actions.shape[1] != layout.width or not MIN_STEPS <= len(actions) <= MAX_STEPS:
        raise refused(Code.WRONG_SHAPE, f"{its} have shape {shape}, {wanted} is needed", shape, wanted)
    if actions.dtype.kind not in "iuf":
        raise refused(Code.WRONG_SHAPE, f"{its} are of {kind}, numbers are needed", kind, "float32")
    rows = actions.astype(np.float64)
    if not np.isfinite(rows).all():
        step, place = map(int, np.argwhere(~np.isfinite(rows))[0])
        value = str(rows[step, place])
        raise refused(Code.NOT_FINITE, f"{its} have {value} in step {step}, column {place}", value, "finite numbers")
    arms, grips, drives = (dict[str, NDArray[np.float64]]() for _ in range(3))
    for column, its_place in layout.places:
        side, _, part = column.partition("_")
        values = rows[:, its_place]
        if part == "arm":
            arms[side] = values
        elif part == "velocity":
            drives[side] = values
        elif part == "gripper_effort":
            grips[side] = np.array([command_of_effort(effort) for effort in values[:, 0]])
        else:
            grips[side] = np.clip(values[:, 0], 0.0, 1.0)
    return Chunk(arms=arms, grips=grips, drives=drives, observed_ns=observed_ns, period_ns=period_ns)


def retry_after_ns(failures: int) -> int:
    """Return how long to wait after so many failures in a row: 0.1 s, doubled each time, at most 2 s [ns]."""
    return min(2_000_000_000, 100_000_000 << min(max(failures - 1, 0), 8))


def refused(
    code: Code, message: str, value: str = "", bound: str = "", *, field: str = "actions", hint: str = ANOTHER
) -> GatewayError:
    """Return why a chunk is not played."""
    return failure(code, message, field=field, value=value, bound=bound, hint=hint)
