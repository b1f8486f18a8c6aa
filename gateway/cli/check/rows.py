"""A row of a check: what is asked, what was found, how it is judged, and what to do. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

__all__ = ["MOVING", "TITLES", "Row", "Verdict", "row", "skipped"]

Verdict = Literal["pass", "fail", "skipped", "unknown"]

TITLES: Final[Mapping[str, tuple[str, str]]] = {
    "network": ("the robot's port answers", "§2.7.1"),
    "router": ("the router answers", "§2.4"),
    "bridge": ("one bridge announces the robot", "§2.4"),
    "announced": ("topics are announced", "§2.7.1"),
    "types": ("they have the manual's types", "§4.1.1"),
    "routes": ("the bridge passes them on", "§2.4"),
    "samples": ("what comes can be read", "§4.8"),
    "states": ("states come, and go on coming", "§2.7.1"),
    "fresh": ("states are new each time", "§2.7.1"),
    "rates": ("rates are about the manual's", "§4.1.1"),
    "copies": ("each sample comes once", "§4.1.1"),
    "order": ("samples come in their order", "§4.8"),
    "latency": ("no topic comes later than others", "§4.8"),
    "clock": ("the robot's clock agrees with ours", "§4.8"),
    "mode": ("the robot is in API mode", "§2.3"),
    "parts": ("its parts are enabled", "§2.3"),
    "control": ("control mode of the arms", "§2.3"),
    "fsm": ("the state machine is ready to be enabled", "§4.11.1"),
    "still": ("arms stand still while nobody commands", "§1.3"),
    "writers": ("nobody else commands", "§3.3.2"),
    "video": ("video", "§2.7.2"),
    "echo": ("arms that are sent where they are stay there", "§2.7.3"),
    "move_left": ("the left arm goes a little and back", "§2.7.3"),
    "move_right": ("the right arm goes a little and back", "§2.7.3"),
    "gripper_left": ("the left gripper pulls and lets go", "§4.4"),
    "gripper_right": ("the right gripper pulls and lets go", "§4.4"),
    "disable": ("a disable pauses the robot", "§2.7.3"),
    "chassis_stop": ("zero velocity stops the chassis", "§2.7.3"),
    "lift_stop": ("the lift is stopped", "§4.6"),
    "heartbeat": ("without its heartbeat the robot pauses by itself", "§2.7.3"),
    "chassis_timeout": ("without commands the chassis stops by itself", "§2.7.3"),
    "home": ("both arms reach the initial position", "§2.7.3"),
}
"""Each row's title and section of the manual, in the order of a report."""

MOVING: Final = tuple(TITLES)[tuple(TITLES).index("echo") :]
"""Rows for which something moves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What came of one point.

    Attributes:
        name: Stable name, for scripts.
        title: What is asked, in words.
        section: Of the manual.
        verdict: `pass`, `fail`, `skipped` (not tried) or `unknown` (tried, and nobody can tell).
        found: What was found, in words.
        figure: The number that was judged; None where there is none.
        bound: What it must keep, e.g. `<= 10`; empty when it is only told.
        unit: Of both.
        remedy: What to do; empty when there is nothing to be done.
    """

    name: str
    title: str
    section: str
    verdict: Verdict
    found: str
    figure: float | None = None
    bound: str = ""
    unit: str = ""
    remedy: str = ""


def row(
    name: str,
    verdict: Verdict | bool,
    found: str,
    *,
    figure: float | None = None,
    bound: str = "",
    unit: str = "",
    remedy: str = "",
) -> Row:
    """Return a row with its title and section; True is `pass`, False `fail`. What passed needs no remedy."""
    judged: Verdict = verdict if isinstance(verdict, str) else "pass" if verdict else "fail"
    title, section = TITLES[name]
    return Row(
        name=name,
        title=title,
        section=section,
        verdict=judged,
        found=found,
        figure=None if figure is None else round(figure, 4),
        bound=bound,
        unit=unit,
        remedy="" if judged == "pass" else remedy,
    )


def skipped(names: tuple[str, ...], why: str, remedy: str = "") -> list[Row]:
    """Return rows that were not tried, and why."""
    return [row(name, "skipped", why, remedy=remedy) for name in names]
