"""What stands in the way of motion, and what a person does next: read off one snapshot. Pure.

The gateway refuses with the same reasons; here they are told before anybody asks. Worst first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gateway.api import protocol
from gateway.cli.terminal.ending import in_shell_words
from gateway.cli.terminal.figures import age_limit_ns, age_text, fsm_text, since_text
from gateway.cli.terminal.others import is_in_the_way, other_text
from gateway.errors import CODES, Code

__all__ = ["Step", "next_steps"]

BUSY = frozenset({"READ_ONLY", "IDLE"})
"""States in which nothing of ours runs the robot's FSM."""

MANY_COPIES = 0.5
"""So many copies a sample mean that a bridge delivers twice (it happens after restarts of it)."""

TOLD_BESIDE = frozenset({"MODE_VR", "ARM_DISABLED", "FOREIGN_WRITER", "OTHER_GATEWAY"})
"""Findings that a step about the robot's modes, or about others on it, says already."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One thing to know or to do.

    Attributes:
        level: `error`: something is wrong; `warning`: something is not as usual; `info`: what is possible.
        text: One sentence, with the remedy.
        subject: `lease` for what a view that shows the lease's clocks has said already, `finding` for what one that shows
            findings has; empty for anything else.
    """

    level: str
    text: str
    subject: str = ""


def next_steps(view: protocol.Snapshot, info: protocol.Info) -> tuple[Step, ...]:
    """Return everything worth knowing about a snapshot, worst first; at least one step.

    Args:
        view: What the gateway sees.
        info: What does not change while it runs.
    """
    found = [
        *_latches(view),
        *_link(view, info),
        *_others(view),
        *_findings(view),
        *_loss(view),
        *_robot(view),
        *_topics(view),
    ]
    found.sort(key=lambda step: step.level != "error")  # stable: warnings keep their order behind the errors
    return (*found, *_state(view, has_trouble=any(step.level == "error" for step in found)))


def _error(text: str) -> Step:
    return Step(level="error", text=text)


def _warning(text: str, subject: str = "") -> Step:
    return Step(level="warning", text=text, subject=subject)


def _hint(code: str) -> str:
    """Return the remedy for a code, as a shell has it; empty for codes that have none."""
    try:
        return in_shell_words(CODES[Code(code)].hint)
    except (ValueError, KeyError):  # a later gateway knows codes that we do not; notices have no remedy
        return ""


def _latches(view: protocol.Snapshot) -> Iterator[Step]:
    for code, message in view.latches.items():
        hint = _hint(code)
        yield _error(f"{code}: {message}" + (f" -> {hint}" if hint else " -> `ta2 recover` when it is safe"))


def _link(view: protocol.Snapshot, info: protocol.Info) -> Iterator[Step]:
    link = view.link
    if not link.up:
        yield _error(f"no link to the robot at {info.robot} -> {_hint('NO_LINK')}")
    elif link.age_ns is None:
        yield _error("the robot's router answers, its state has not come yet -> is the robot's software running?")
    elif not link.fresh:
        yield _error(f"the robot's state is {age_text(link.age_ns)} old, 100 ms at most -> {_hint('STATE_STALE')}")


def _others(view: protocol.Snapshot) -> Iterator[Step]:
    """Yield one step for those who command or announce it, and one for gateways that are armed."""
    there = [other for other in view.others.seen if is_in_the_way(other)]
    told = {finding.code for finding in view.findings}
    for code, gateways in (("FOREIGN_WRITER", False), ("OTHER_GATEWAY", True)):
        found = [other for other in there if (other.kind == "gateway") is gateways]
        if found and code not in view.latches:
            more = f", and {len(found) - 1} more (`ta2 topics`)" if len(found) > 1 else ""
            yield _warning(
                f"{other_text(found[0], view.at_ns)}{more} -> {_hint(code)}", "finding" if code in told else ""
            )


def _findings(view: protocol.Snapshot) -> Iterator[Step]:
    """Yield what was inferred; what the modes and others say is told with them."""
    for finding in view.findings:
        if finding.code not in TOLD_BESIDE:
            yield _warning(f"{finding.code}: {finding.message} -> {in_shell_words(finding.hint)}", "finding")


def _loss(view: protocol.Snapshot) -> Iterator[Step]:
    lease = view.lease
    if not lease.owned and lease.down_in_ns is not None:
        text = f"held for nobody: the robot pauses in {since_text(lease.down_in_ns)} unless somebody owns it"
        yield _warning(text, "lease")
    if lease.owned and lease.lost_ns is not None:
        then = "" if lease.down_in_ns is None else f", the robot pauses in {since_text(lease.down_in_ns)}"
        free = "" if lease.free_in_ns is None else f": free in {since_text(lease.free_in_ns)}{then}"
        yield _warning(f"the owner {lease.name!r} has been silent for {since_text(lease.lost_ns)}{free}", "lease")


def _robot(view: protocol.Snapshot) -> Iterator[Step]:
    """Yield what the robot's own modes and FSM have against motion; nothing is known of them without a fresh link."""
    if not view.link.fresh:
        return
    if view.fsm == -1:
        yield _error(f"the robot's FSM is ERROR (manual §4.11.1) -> {_hint('FSM_ERROR')}")
    elif view.fsm is None:
        yield _warning(f"the robot's FSM is unknown -> {_hint('FSM_UNKNOWN')}")
    elif view.fsm not in (0, 1, 2) or (view.fsm != 0 and view.state in BUSY):
        yield _warning(f"the robot's FSM is {fsm_text(view.fsm)}, not by us -> {_hint('FSM_BUSY')}")
    mode, found = view.mode, {finding.code for finding in view.findings}
    if mode is None:
        yield _warning(f"the robot's mode is unknown -> {_hint('MODE_UNKNOWN')}")
        return
    if not mode.api:
        yield _warning(f"the robot is in VR mode -> {_hint('MODE_VR')}", "finding" if "MODE_VR" in found else "")
    for side in ("left", "right"):
        if not mode.arm_enabled.get(side, False):
            told = "finding" if "ARM_DISABLED" in found else ""
            yield _warning(f"the {side} arm is disabled -> {_hint('ARM_DISABLED')}", told)
        elif not mode.joint_mode.get(side, False):
            yield _warning(f"the {side} arm is in end-effector mode -> {_hint('WRONG_CONTROL_MODE')}")


def _topics(view: protocol.Snapshot) -> Iterator[Step]:
    if not view.link.fresh:
        return  # the link's age says it already
    old = [
        f"{name} ({'never' if topic.age_ns is None else age_text(topic.age_ns)})"
        for name, topic in view.topics.items()
        if topic.age_ns is None or topic.age_ns > age_limit_ns(name)
    ]
    is_told = any(finding.code in ("ROUTE_SUSPECT", "SAMPLE_REFUSED") for finding in view.findings)
    if old and not is_told:
        yield _warning(f"not heard of late: {', '.join(old)} -> see `ta2 topics`")
    twice = [name for name, topic in view.topics.items() if topic.duplicates > MANY_COPIES * topic.count > 0]
    if twice:
        yield _warning(f"delivered more than once: {', '.join(twice)} -> restart the robot's bridge")


def _state(view: protocol.Snapshot, *, has_trouble: bool) -> Iterator[Step]:
    """Yield what the state means for whoever wants to go on."""
    enable = view.enable
    if view.state in BUSY and enable.outcome == "failed":
        yield _warning(f"the last enable failed, {enable.code}: {enable.message}")
    owner = f"{view.lease.name!r} (pid {view.lease.pid})"
    texts = {
        "OFFLINE": "waiting for the robot; nothing is needed but its return",
        "STALE": "waiting for fresh state; nothing moves by itself when it is back",
        "READ_ONLY": "nobody owns the robot -> `ta2 enable`, `ta2 home`, `ta2 move`, or control()",
        "IDLE": f"{owner} owns the robot and has not enabled it",
        "ENABLING": f"{owner} is bringing the robot to READY",
        "ACTIVE": f"{owner} commands the arms",
        "HOLDING": f"arms and grip are held; {owner} may go on with a new motion",
        "PAUSED": f"the robot paused by itself (physical stop?) -> look why; then {owner} must enable again",
        "STOPPING": "the arms are coming to rest",
    }
    if view.lease.lost_ns is not None:
        texts["HOLDING"] = "arms and grip are held -> whoever owns the robot next goes on from here"
    elif not view.lease.owned and view.state == "HOLDING":
        texts["HOLDING"] = "arms and grip are held for nobody -> `ta2 home`, `ta2 move`, or control() goes on from here"
    elif not view.lease.owned and view.state == "PAUSED":
        texts["PAUSED"] = "the robot paused by itself (physical stop?) -> look why, then own and enable it again"
    if view.state == "READ_ONLY" and (has_trouble or view.lease.owned or (view.mode is not None and not view.mode.api)):
        texts["READ_ONLY"] = "only looking is possible"
    yield Step(level="info", text=texts.get(view.state, f"the gateway is {view.state}"))
