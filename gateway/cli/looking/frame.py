"""One picture of `ta2 watch` as lines that fit a terminal. Pure: a snapshot, notices and a size in, styled text out.

```
title, state, lease                     always
what is wrong, or what to do next       latches as loud as a terminal can be
joints of both arms                     bars from limit to limit, setpoint beside measured
topics | streams, motions, loop         two columns
notices                                 the newest at the bottom; they get the lines that are left
```

Rules
    * No line is wider than the terminal, and there are never more lines than it has: what is normal gives way first.
    * Every figure has its unit in sight.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from rich.text import Text

from gateway.api import protocol
from gateway.cli.terminal.advice import Step, next_steps
from gateway.cli.terminal.bars import arm_rows
from gateway.cli.terminal.figures import (
    age_limit_ns,
    age_text,
    fsm_text,
    rate_text,
    since_text,
    topic_text,
)
from gateway.cli.terminal.style import NOTICE_STYLES, STEP_MARKS, STEP_STYLES, state_style
from gateway.robot.topics import TOPICS

__all__ = ["Picture", "Remark", "frame"]

LEAST_WIDTH = 20
TALL = 30
"""From this many lines on there is room for rules between the parts and for long advice."""
TOPIC_WIDTH = 48
LATE_NS = 20_000_000
"""The gap bounds of the streams hold for ticks up to this late [ns]."""
NEAR = 2.0
"""Parts of the body with less than so many times the margin between them are near."""
CLEAR = 3.0
"""What pulls at an arm by so many standard deviations is something."""
SLOW = 0.8
"""A topic below this part of its nominal rate is slow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Remark:
    """A notice, or something this view has to say itself.

    Attributes:
        clock: Local time of day, `17:32:19`.
        level: `info`, `warning` or `error`.
        text: Code and message.
    """

    clock: str
    level: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """What is to be seen.

    Attributes:
        address: Where the gateway is, as a person would type it.
        info: What does not change while the gateway runs.
        view: The newest snapshot.
        since_ns: Since it arrived [ns]; added to every age.
        remarks: Oldest first.
        trouble: What is wrong with the view itself, e.g. that the gateway is gone; empty when nothing is.
        is_live: Whether there will be a next picture, and q ends them.
    """

    address: str
    info: protocol.Info
    view: protocol.Snapshot
    since_ns: int
    remarks: Sequence[Remark]
    trouble: str = ""
    is_live: bool = True


def frame(picture: Picture, width: int, height: int) -> list[Text]:
    """Return the lines of the picture."""
    width = max(width, LEAST_WIDTH)
    is_tall = height >= TALL
    head = [_title(picture, width), _state(picture), _lease(picture)]
    head += _alarms(picture, width, most=6 if is_tall else 2)
    arms = list(arm_rows(picture.view, picture.info, picture.since_ns, width))
    rules = [_rule(width)] if is_tall else []
    least = len(head) + len(arms) + 3 * len(rules) + 1
    middle = _side_by_side(list(_topics(picture)), list(_traffic(picture.view)), width, height - least)
    lines = [*head, *rules, *arms, *rules, *middle, *rules]
    lines += _notices(picture.remarks, width, height - len(lines), is_wrapped=is_tall)
    for line in lines:
        line.truncate(width, overflow="ellipsis")
    return lines[: max(0, height)]


def _rule(width: int) -> Text:
    return Text("─" * width, style="dim")


# ---------------------------------------------------------------------------------------------------------------- head


def _title(picture: Picture, width: int) -> Text:
    info = picture.info
    left = f" ta2 watch  {info.robot} ({info.model})"
    key = "  q ends " if picture.is_live else " "
    right = f"{picture.address}{key}"
    if len(left) + len(right) + 1 > width:
        right = key
    return Text(left.ljust(width - len(right))[: width - len(right)] + right, style="reverse")


def _state(picture: Picture) -> Text:
    view, mode = picture.view, picture.view.mode
    label = f" was {view.shown} " if picture.trouble else f" {view.shown} "
    line = Text.assemble((label, f"{'bold red' if picture.trouble else state_style(view)} reverse"))
    if view.shown != view.state:
        line.append(f" {view.state}")
    line.append(f"  FSM {fsm_text(view.fsm)}", style="" if view.fsm in (0, 1, 2) else "yellow")
    age_ns = None if view.link.age_ns is None else view.link.age_ns + picture.since_ns
    if not view.link.up:
        line.append("  link DOWN", style="bold red")
    else:
        is_fresh = view.link.fresh and not picture.trouble
        line.append(f"  link {age_text(age_ns)}", style="green" if is_fresh else "bold red")
    if mode is None:
        line.append("  mode unknown", style="yellow")
    else:
        line.append("  API mode" if mode.api else "  VR mode", style="" if mode.api else "yellow")
    return line


def _lease(picture: Picture) -> Text:
    lease = picture.view.lease
    if not lease.owned:
        line = Text(" owner nobody", style="dim")
        if lease.down_in_ns is not None:
            line.append(f"  robot pauses in {since_text(lease.down_in_ns - picture.since_ns)}", style="bold yellow")
        return line
    line = Text.assemble(" owner ", (lease.name, "bold"), f" (pid {lease.pid}), epoch {lease.epoch}")
    if lease.lost_ns is None:
        since_ns = picture.view.at_ns - lease.since_ns + picture.since_ns
        line.append(f", for {since_text(since_ns)}, on loss: {lease.on_loss}")
        return line
    line.append(f"  SILENT {since_text(lease.lost_ns + picture.since_ns)}", style="bold red")
    for name, left_ns in (("free in", lease.free_in_ns), ("robot pauses in", lease.down_in_ns)):
        if left_ns is not None:
            line.append(f"  {name} {since_text(left_ns - picture.since_ns)}", style="bold yellow")
    return line


def _alarms(picture: Picture, width: int, most: int) -> list[Text]:
    """Return what is wrong, filling whole lines with colour; the state's own line of advice when nothing is."""
    steps = list(next_steps(picture.view, picture.info))
    if picture.trouble:
        steps.insert(0, Step(level="error", text=picture.trouble))
    urgent = [step for step in steps if step.level != "info" and step.subject != "lease"]
    lines = [
        Text(line.ljust(width), style=f"{STEP_STYLES[step.level]}{' reverse' if step.level == 'error' else ''}")
        for step in urgent or steps[-1:]
        for line in _wrapped(f"{STEP_MARKS[step.level]} ", step.text, width)
    ]
    if len(lines) > most:
        lines = [
            *lines[: most - 1],
            Text(f"    ... {len(lines) - most + 1} more lines: `ta2 status`", style="bold red"),
        ]
    return lines


def _wrapped(lead: str, text: str, width: int) -> list[str]:
    return textwrap.wrap(text, max(width, LEAST_WIDTH), initial_indent=lead, subsequent_indent=" " * len(lead))


# -------------------------------------------------------------------------------------------------------------- middle


def _side_by_side(left: list[Text], right: list[Text], width: int, most: int) -> list[Text]:
    """Return two columns, or one below the other where the terminal is too narrow; each as long as there is room."""
    if width < TOPIC_WIDTH + LEAST_WIDTH:
        return _shortened([*left, *right], most)
    left_width = width // 2 if width > 2 * TOPIC_WIDTH + 4 else TOPIC_WIDTH
    left, right = _shortened(left, most), _shortened(right, most)
    lines = []
    for n in range(max(len(left), len(right))):
        line = left[n].copy() if n < len(left) else Text()
        line.truncate(left_width, overflow="ellipsis", pad=True)
        lines.append(line + Text(" ") + (right[n] if n < len(right) else Text()))
    return lines


def _shortened(lines: list[Text], most: int) -> list[Text]:
    if len(lines) <= most:
        return lines
    kept = max(0, most - 1)
    return [*lines[:kept], Text(f"... {len(lines) - kept} more: `ta2 topics`", style="dim")][: max(0, most)]


def _topics(picture: Picture) -> Iterator[Text]:
    yield Text(f"{'FROM THE ROBOT':<26} {'Hz':>5} {'age':>7} {'gap':>6}", style="bold")
    for name, topic in picture.view.topics.items():
        age_ns = None if topic.age_ns is None else topic.age_ns + picture.since_ns
        style = ""
        if age_ns is None or age_ns > age_limit_ns(name):
            style = "red"
        elif name in TOPICS and topic.rate_hz < SLOW * TOPICS[name].rate_hz:
            style = "yellow"
        age = "never" if age_ns is None else age_text(age_ns)
        gap = age_text(topic.worst_gap_ns).replace(" ", "")
        line = Text(f"{topic_text(name):<26} {rate_text(topic.rate_hz):>5} {age:>7} {gap:>6}", style=style)
        for count, what in ((topic.duplicates, "dup"), (topic.refused, "bad")):
            if count:
                line.append(f" {what} {count}", style="yellow")
        yield line


def _traffic(view: protocol.Snapshot) -> Iterator[Text]:
    """Yield what goes to the robot: running streams, targets, motions; streams that are off give way first."""
    yield Text(f"{'TO THE ROBOT':<19} {'Hz':>5} {'gap':>5}", style="bold")
    off = []
    for name, stream in view.streams.items():
        if not stream.running:
            off.append(Text(f"{topic_text(name):<19} {'off':>5}", style="dim"))
            continue
        watchdog_ns = TOPICS[name].watchdog_ns if name in TOPICS else None
        is_late = watchdog_ns is not None and stream.worst_gap_ns > watchdog_ns
        gap = age_text(stream.worst_gap_ns).replace(" ", "")
        yield Text(
            f"{topic_text(name):<19} {rate_text(stream.rate_hz):>5} {gap:>5}", style="bold red" if is_late else "green"
        )
    for target in view.targets:
        if target.open:
            refused = f", {target.refused} bad" if target.refused else ""
            limited = ", limited" if target.limited else ""
            yield Text(f"targets {target.side} #{target.seq}{refused}{limited}", style="yellow" if refused else "green")
    yield from _slowing(view.slowing)
    yield from _ground(view)
    yield from _motions(view)
    yield from _contacts(view)
    yield from _spacing(view.spacing)
    yield _loop(view.loop)
    yield from off


def _ground(view: protocol.Snapshot) -> Iterator[Text]:
    """Yield what grippers, chassis and lift are told, where it is anything."""
    for side, grip in view.grips.items():
        if grip.input_ratio is not None and grip.torque_nm:
            holds = ", holds?" if grip.holding else ""  # an estimate
            yield Text(f"grip {side} {grip.input_ratio:.2f} {grip.torque_nm:+.2f} N·m{holds}", style="green")
    if view.drive.driven:
        vx, vy = view.drive.commanded_mps
        yield Text(f"drive {vx:+.2f} {vy:+.2f} m/s {view.drive.commanded_radps:+.2f} rad/s", style="bold green")
    if view.lift is not None and (view.lift.driven or view.lift.servo_on):
        style = "bold green" if view.lift.driven else "green"
        yield Text(
            f"lift {view.lift.velocity_ratio:+.2f} {'servo on' if view.lift.servo_on else ''}".rstrip(), style=style
        )


def _loop(loop: protocol.LoopView) -> Text:
    late_ns = loop.worst_late_ns
    text = f"{'loop late by':<19} {'':>5} {age_text(late_ns).replace(' ', ''):>5}"
    return Text(text, style="yellow" if late_ns > LATE_NS else "dim")


def _spacing(spacing: protocol.SpacingView | None) -> Iterator[Text]:
    """Yield how near parts of the body are to each other, where arms are kept apart, or why they are not."""
    if spacing is None:
        return
    if spacing.gap_m is None:
        yield Text(f"not kept apart: {spacing.why or 'joints not heard'}", style="yellow")
        return
    is_near = bool(spacing.held) or spacing.gap_m < NEAR * spacing.margin_m
    style = "bold yellow" if is_near else "dim"
    held = f", {'+'.join(spacing.held)} held back" if spacing.held else ""
    yield Text(f"{1e3 * spacing.gap_m:.0f} mm of {1e3 * spacing.margin_m:.0f} mm free{held}", style=style)
    yield Text(f"  {spacing.first} - {spacing.second}", style=style)


def _contacts(view: protocol.Snapshot) -> Iterator[Text]:
    """Yield forces on the hands with standard deviations, `?` for what is not felt, what they hold, and their last touch.

    What is clearly something stands out.
    """
    for side, arm in view.arms.items():
        if (felt := arm.contact) is None:
            continue
        pairs = zip(felt.wrench[:3], felt.wrench_sd[:3], strict=True)
        figures = " ".join("?" if value is None else f"{value:+.1f}±{sd:.1f}" for value, sd in pairs)
        text = f"{side} feels {figures} N" if felt.state == "known" else f"{side} feels nothing known: {felt.code}"
        text += f", holds {felt.load_kg:.3f} kg" if felt.load_kg else ""
        yield Text(text, style="bold yellow" if felt.sigmas >= CLEAR else "dim")
        if (touch := arm.touch) is not None:
            ago = since_text(view.at_ns - touch.at_ns)
            yield Text(f"  touch {touch.number}: {touch.force_n:.1f}±{touch.sd_n:.1f} N, {ago} ago", style="dim")


def _slowing(slowing: Mapping[str, protocol.SlowingView]) -> Iterator[Text]:
    """Yield the arms whose poses are followed slower near a singularity, and the joint for whose sake."""
    for side, seen in slowing.items():
        if seen.held:
            text = f"{side} at {seen.speed_ratio:.0%}: joint {seen.joint} near a singularity"
            yield Text(text, style="yellow")


def _motions(view: protocol.Snapshot) -> Iterator[Text]:
    """Yield the running motions with progress, and the latest one that ended."""
    running = [motion for motion in view.motions if motion.state in ("queued", "executing")]
    for motion in running or view.motions[-1:]:
        sides = "+".join(motion.sides)
        error = "" if motion.error_rad is None else f"{motion.error_rad:.3f} rad off"
        if motion in running:
            done = round(10 * motion.progress)
            yield Text(f"motion {motion.motion_id} {sides}", style="bold green")
            yield Text(f"  {'█' * done}{'░' * (10 - done)} {motion.progress:>4.0%} {error}", style="green")
        else:
            style = "" if motion.state == "reached" else "yellow"
            yield Text(f"motion {motion.motion_id} {motion.state} {motion.code}".rstrip(), style=style)
            yield Text(f"  {sides} {error}", style=style)


# ------------------------------------------------------------------------------------------------------------- notices


def _notices(remarks: Sequence[Remark], width: int, most: int, *, is_wrapped: bool) -> list[Text]:
    """Return the newest notices, as many lines as there is room for; where that is little, a line each."""
    if most <= 0:
        return []
    lines = [
        Text(line, style=NOTICE_STYLES.get(remark.level, ""))
        for remark in remarks[-most:]
        for line in (
            _wrapped(f"{remark.clock} ", remark.text, width) if is_wrapped else [f"{remark.clock} {remark.text}"]
        )
    ]
    return lines[-most:] or [Text("no notices yet", style="dim")]
