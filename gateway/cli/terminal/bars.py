"""Joints as bars from limit to limit: where an arm is, where it is sent, how near the ends. Pure.

`●` is measured, `◆` the setpoint where it is elsewhere; yellow is near a limit, red beyond one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.text import Text

from gateway.api import protocol
from gateway.cli.terminal.figures import age_text, joints_text, model_text
from gateway.cli.terminal.style import MODEL_STYLES

__all__ = ["arm_rows", "bar"]

SIDES = ("left", "right")
NEAR = 0.05
"""This part of its range from a limit, a joint is near it."""
LIMITS_FROM = 55
"""A column of at least this width shows the limits in figures."""


def bar(q_rad: float | None, q_ref_rad: float | None, lower_rad: float, upper_rad: float, width: int) -> Text:
    """Return one joint's bar.

    Args:
        q_rad: Measured [rad]; None when unknown.
        q_ref_rad: Setpoint [rad]; None when none is sent.
        lower_rad: Configured lower limit [rad].
        upper_rad: Configured upper limit [rad].
        width: Columns, 5 or more.
    """
    inner = max(3, width - 2)
    line = Text("├" + "─" * inner + "┤", style="dim")

    def place(value_rad: float, mark: str, style: str) -> None:
        part = (value_rad - lower_rad) / (upper_rad - lower_rad)
        at = 1 + min(max(round(part * (inner - 1)), 0), inner - 1)
        line.plain = line.plain[:at] + mark + line.plain[at + 1 :]
        line.stylize(f"not dim {style}", at, at + 1)

    if q_ref_rad is not None:
        place(q_ref_rad, "◆", "bold magenta")
    if q_rad is not None:
        place(q_rad, "●", f"bold {_colour(q_rad, lower_rad, upper_rad)}")
    return line


def _colour(q_rad: float, lower_rad: float, upper_rad: float) -> str:
    near_rad = NEAR * (upper_rad - lower_rad)
    if not lower_rad <= q_rad <= upper_rad:
        return "red"
    return "green" if lower_rad + near_rad <= q_rad <= upper_rad - near_rad else "yellow"


def arm_rows(view: protocol.Snapshot, info: protocol.Info, since_ns: int, width: int) -> Iterator[Text]:
    """Yield both arms side by side: a heading, a row per joint, and one for the end effector."""
    column = (width - 2) // 2
    for left, right in zip(*(_arm(side, view, info, since_ns, column) for side in SIDES), strict=True):
        left.truncate(column, overflow="ellipsis", pad=True)
        right.truncate(column, overflow="ellipsis")
        yield left + Text("  ") + right


def _arm(side: str, view: protocol.Snapshot, info: protocol.Info, since_ns: int, width: int) -> list[Text]:
    arm = view.arms[side]
    q_rad: Sequence[float | None] = arm.measured.q_rad if arm.measured is not None else (None,) * protocol.ARM_DOF
    q_ref_rad: Sequence[float | None] = arm.q_ref_rad or (None,) * protocol.ARM_DOF
    rows = [_heading(side, view, since_ns)]
    limits = zip(info.lower_rad[side], info.upper_rad[side], strict=True)
    for n, (q, ref, (lower, upper)) in enumerate(zip(q_rad, q_ref_rad, limits, strict=True), start=1):
        line = Text(f"{n} {'-' if q is None else f'{q:+.3f}':>6} ")
        if width >= LIMITS_FROM:
            line.append(f"{lower:>6.2f} ", style="dim")
            line.append_text(bar(q, ref, lower, upper, width - len(line) - 7))
            line.append(f" {upper:.2f}", style="dim")
        else:
            line.append_text(bar(q, ref, lower, upper, width - len(line)))
        rows.append(line)
    rows.append(_place(arm))
    return rows


def _place(arm: protocol.ArmView) -> Text:
    """Return where the end effector is, its setpoint where poses are sent, and how far the body model is from it."""
    line = Text(f"p {joints_text(arm.p_m)} m" if arm.p_m else "p -")
    if arm.ref_p_m:
        line.append(f" ◆ {joints_text(arm.ref_p_m)}", style="bold magenta")
    if arm.model is not None and not (arm.ref_p_m and arm.model.state == "agrees"):
        line.append(f"  {model_text(arm.model)}", style=MODEL_STYLES.get(arm.model.state, ""))
    return line


def _heading(side: str, view: protocol.Snapshot, since_ns: int) -> Text:
    arm, mode = view.arms[side], view.mode
    line = Text(f"{side.upper()} ARM rad", style="bold")
    if mode is not None and not mode.arm_enabled.get(side):
        line.append(" disabled", style="not bold yellow")
    elif mode is not None and not mode.joint_mode.get(side):
        line.append(" pose mode", style="not bold yellow")
    age_ns = None if arm.measured is None else arm.measured.age_ns + since_ns
    is_old = age_ns is None or age_ns > 100_000_000
    line.append(f" {age_text(age_ns)}", style="not bold red" if is_old else "not bold")
    if arm.streaming and arm.tracking_rad is not None and arm.tracking_m is not None:
        line.append(f" ◆ off by {arm.tracking_m * 1e3:.1f} mm {arm.tracking_rad:.3f}", style="not bold green")
    elif arm.streaming and arm.tracking_rad is not None:
        line.append(f" ◆ off by {arm.tracking_rad:.3f}", style="not bold green")
    else:
        line.append(" no setpoint", style="not bold dim")
    return line
