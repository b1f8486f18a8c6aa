"""One table of results: what was measured, ours, the peer's, the ratio, and the goal."""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

__all__ = ["Row", "show"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One result.

    Attributes:
        name: What was measured.
        ours: Figure with unit.
        peer: The peer's figure in the same run; empty when there is none.
        ratio: How they compare, in words.
        goal: What is asked for; empty when it is only told.
        good: Whether the goal is met; None without a goal.
    """

    name: str
    ours: str
    peer: str = ""
    ratio: str = ""
    goal: str = ""
    good: bool | None = None


def show(title: str, rows: list[Row], console: Console) -> None:
    """Print rows as a table."""
    table = Table(title=title, title_justify="left")
    for name in ("measured", "ours", "peer", "ratio", "goal", ""):
        table.add_column(name, justify="left" if name in {"measured", ""} else "right")
    marks = {True: "[green]met[/]", False: "[bold red]missed[/]", None: ""}
    for row in rows:
        table.add_row(row.name, row.ours, row.peer, row.ratio, row.goal, marks[row.good])
    console.print(table)
