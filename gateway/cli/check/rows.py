"""Rows of a check: what is asked, within which bound, what was found, and what to do. One table has all bounds. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Final, Literal, NamedTuple

from gateway.cli.looking.link_findings import FAST, SLOW, TWICE, names_of
from gateway.robot.limits import CHASSIS_DOWN_MPS2, CHASSIS_WATCHDOG_NS, FSM_WATCHDOG_NS

__all__ = ["DRIVE_MPS", "MOVING", "POINTS", "Row", "Verdict", "measured", "row", "skipped", "worst"]

Verdict = Literal["pass", "fail", "skipped", "unknown"]
S = 1_000_000_000
DRIVE_MPS = 0.05
"""How fast a trial drives [m/s] (choice)."""
LATE_S = 0.5
"""So long a reaction may take to be seen, beyond the manual's time [s] (choice: states of 20 Hz, and a slow host)."""
BRAKE_S = DRIVE_MPS / CHASSIS_DOWN_MPS2 + LATE_S
PAGE = "set it on the robot's page, save, apply, restart (§2.3)"
HALT = "do not go on: the robot does not stop as the manual says"


class Point(NamedTuple):
    """What a row asks: title, section of the manual, both bounds of its figure, their unit, what to do when it fails."""

    title: str
    section: str
    least: float = -inf
    most: float = inf
    unit: str = ""
    remedy: str = ""


# Bounds that the manual does not give are choices.
# fmt: off
POINTS: Final[Mapping[str, Point]] = {
    "network": Point("the robot's port answers", "§2.7.1", most=3, unit="s", remedy="check power, cable and address"),
    "router": Point("the router answers", "§2.4"),
    "bridge": Point("one bridge announces the robot", "§2.4"),
    "announced": Point("topics are announced", "§2.7.1"),
    "types": Point("they have the manual's types", "§4.1.1"),
    "routes": Point("the bridge passes them on", "§2.4"),
    "samples": Point("what comes can be read", "§4.8", most=0, unit="refused"),
    "states": Point("states come, and go on coming", "§2.7.1", most=10, unit="s", remedy="look at the node that publishes it"),
    "fresh": Point("stamped states are new each time", "§2.7.1", most=1, unit="s", remedy="restart that node on the robot"),
    "rates": Point("rates are about the manual's", "§4.1.1", SLOW, FAST, "of it"),
    "copies": Point("each sample comes once", "§4.1.1", most=TWICE, unit="times"),
    "order": Point("stamped samples come in their order", "§4.8", most=0, unit="samples", remedy="restart the robot's bridge"),
    "latency": Point("no stamped topic comes later", "§4.8", most=0.1, unit="s", remedy="look at the robot's load"),
    "clock": Point("the robot's clock agrees with ours", "§4.8", -0.5, 0.5, "s", "let both keep one time, by NTP or chrony"),
    "mode": Point("the robot is in API mode", "§2.3", remedy=PAGE),
    "parts": Point("its parts are enabled", "§2.3", remedy=f"{PAGE}; of a part that is meant to be off: --without PART"),
    "control": Point("control mode of the arms", "§2.3", remedy=PAGE),
    "fsm": Point("it can be enabled", "§4.11.1", 0, 2, remedy="end VR or playback there; in ERROR restart the robot"),
    "still": Point("arms stand still", "§1.3", most=0.05, unit="rad", remedy="who moves it? else that joint's encoder"),
    "writers": Point("nobody else commands", "§3.3.2"),
    "video": Point("video", "§2.7.2"),
    "echo": Point("sent where they are, arms stay", "§2.7.3", most=0.02, unit="rad", remedy="do not go on: the robot jumps"),
    "move_left": Point("the left arm goes a little and back", "§2.7.3", 0.8, 1.2, "of it", "free, enabled, in that mode?"),
    "move_right": Point("the right arm goes a little and back", "§2.7.3", 0.8, 1.2, "of it", "free, enabled, in that mode?"),
    "gripper_left": Point("the left gripper pulls", "§4.4", 0.05, unit="N·m", remedy="is its arm enabled?"),
    "gripper_right": Point("the right gripper pulls", "§4.4", 0.05, unit="N·m", remedy="is its arm enabled?"),
    "disable": Point("a disable pauses the robot", "§2.7.3", most=LATE_S, unit="s", remedy=HALT),
    "chassis_stop": Point("zeros stop the chassis", "§2.7.3", most=BRAKE_S, unit="s", remedy=HALT),
    "lift_stop": Point("the lift is stopped", "§4.6", remedy="did you see it move a little, and stop?"),
    "heartbeat": Point("unheard, the robot pauses", "§2.7.3", most=FSM_WATCHDOG_NS / S + LATE_S, unit="s", remedy=HALT),
    "chassis_timeout": Point("unheard, the chassis stops", "§2.7.3", -inf, CHASSIS_WATCHDOG_NS / S + BRAKE_S, "s", HALT),
    "home": Point("arms reach the initial position", "§2.7.3", remedy="`ta2 home`, with the arms' way in sight"),
}
"""Every row in the order of a report."""
# fmt: on
MOVING: Final = tuple(POINTS)[tuple(POINTS).index("echo") :]
"""Rows for which something moves."""


@dataclass(frozen=True, slots=True)
class Row:
    """What came of one point; `figure` is what was judged by `bound`, both in `unit`.

    `skipped` was not tried; `unknown` was, and nobody can tell.
    """

    name: str
    title: str
    section: str
    verdict: Verdict
    found: str
    figure: float | None
    bound: str
    unit: str
    remedy: str


def row(name: str, verdict: Verdict | bool, found: str, figure: float | None = None, remedy: str | None = None) -> Row:
    """Return a row of the table; True is `pass`, False `fail`. What passed needs no remedy."""
    said: Verdict = verdict if isinstance(verdict, str) else "pass" if verdict else "fail"
    title, section, least, most, unit, remedy_then = POINTS[name]
    both = f"{least:g} to {most:.3g}" if least > -inf else f"<= {most:.3g}"
    bound = "" if least == -inf and most == inf else f">= {least:g}" if most == inf else both
    remedy = "" if said == "pass" else remedy_then if remedy is None else remedy
    shown = None if figure is None else round(figure, 4)
    return Row(name, title, section, said, found, shown, bound, unit, remedy)


def measured(name: str, figure: float | None, found: str, *, wrong: str = "", remedy: str | None = None) -> Row:
    """Return a row that its figure decides, or what is wrong beside it; without either nobody can tell."""
    good = not wrong and figure is not None and POINTS[name].least <= figure <= POINTS[name].most
    return row(name, "unknown" if figure is None and not wrong else good, wrong or found, figure, remedy)


def worst(name: str, figures: Mapping[str, float], found: str, wrong: str) -> Row:
    """Return a row that the greatest of some figures decides; those beyond the bound are named."""
    beyond = [who for who, figure in figures.items() if not figure <= POINTS[name].most]
    most = max(figures.values(), default=None)
    return measured(name, most, found, wrong=f"{wrong}: {names_of(beyond)}" if beyond else "")


def skipped(names: Iterable[str], why: str, remedy: str = "") -> list[Row]:
    """Return rows that were not tried, and why."""
    return [row(name, "skipped", why, remedy=remedy) for name in names]
