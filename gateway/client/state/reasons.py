"""Why the robot does not do what it is told: what the daemon has inferred, and what it would refuse now.

Rules
    * Made from the newest snapshot without asking anybody.
    * A finding is an inference from what was sent and measured: the robot gives no reasons (manual §4.10).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from msgspec import Struct

from gateway.api import protocol
from gateway.client.state.reading import RobotState

__all__ = ["Finding", "Why", "why_of"]


class Finding(Struct, frozen=True, kw_only=True):
    """One thing that seems to keep the robot from doing what it is told.

    Attributes:
        code: Stable code, e.g. `TRACKING_STALL` (docs/reference/codes.md).
        message: What is seen, in one sentence.
        hint: What to do.
        since: For how long [s].
        facts: The numbers of the message, with units in their names.
    """

    code: str
    message: str
    hint: str
    since: float
    facts: Mapping[str, float]

    def __str__(self) -> str:
        """Return `CODE (for 1.2 s): message -> hint`."""
        return f"{self.code} (for {self.since:.1f} s): {self.message} -> {self.hint}"


class Why(Struct, frozen=True, kw_only=True):
    """Everything that is known to stand in the way; false when there is nothing.

    Attributes:
        state: What a person should read, e.g. `ACTIVE`, `ESTOP`.
        findings: What was inferred, causes before effects.
        latches: What holds motion off until `recover()`: code to message.
        refusals: What its owner would be refused now, by kind of request (`enable`, `left_arm`, `left_gripper`, `chassis`,
            `lift` ...), with code, message and hint. Kinds that would be accepted are not in it.
        age: Since the snapshot arrived here [s].
    """

    state: str
    findings: tuple[Finding, ...]
    latches: Mapping[str, str]
    refusals: Mapping[str, protocol.RefusalMessage]
    age: float

    def __bool__(self) -> bool:
        """Whether anything is wrong. What is refused because nobody owns or has enabled the robot is not wrong."""
        return bool(self.findings or self.latches)

    def __str__(self) -> str:
        """Return one line for each reason."""
        lines = [f"{code} (latched): {message} -> recover() when it is safe" for code, message in self.latches.items()]
        lines += map(str, self.findings)
        if not lines:
            lines.append(f"{self.state}: nothing is known to keep the robot from doing what it is told")
        return "\n".join([*lines, *(f"refused now: {', '.join(kinds)}: {why}" for kinds, why in self.grouped())])

    def grouped(self) -> tuple[tuple[tuple[str, ...], str], ...]:
        """Return what is refused, kinds with the same reason together: (kinds, `CODE: message -> hint`)."""
        reasons: dict[str, list[str]] = {}
        for kind, refusal in self.refusals.items():
            reasons.setdefault(f"{refusal.code}: {refusal.message} -> {refusal.hint}", []).append(kind)
        return tuple((tuple(kinds), why) for why, kinds in reasons.items())


def why_of(state: RobotState) -> Why:
    """Return what a state says about it."""
    view = state.view
    findings = [
        Finding(
            code=seen.code,
            message=seen.message,
            hint=seen.hint,
            since=max(0, view.at_ns - seen.since_ns) / 1e9 + state.age,
            facts=MappingProxyType(seen.facts),
        )
        for seen in view.findings
    ]
    return Why(
        state=state.shown,
        findings=tuple(findings),
        latches=state.latches,
        refusals=MappingProxyType(view.refusals),
        age=state.age,
    )
