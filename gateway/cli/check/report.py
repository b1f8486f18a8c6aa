"""Rows for people, for scripts and for a file: a table of the terminal, JSON, and one HTML page that needs nothing else."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gateway.cli.check.rows import Row
from gateway.errors import Code, Refusal, to_exception

__all__ = ["document", "print_rows", "show", "write_page"]

STYLES = {"pass": "green", "fail": "bold red", "skipped": "dim", "unknown": "yellow"}
PAGE_COLUMNS = 180


def document(rows: Sequence[Row], facts: Mapping[str, object]) -> dict[str, object]:
    """Return it for scripts: `ok` when nothing failed, what was checked, and every row."""
    return {"ok": all(row.verdict != "fail" for row in rows), **facts, "rows": [asdict(row) for row in rows]}


def print_rows(console: Console, rows: Sequence[Row], facts: Mapping[str, object]) -> None:
    """Print a table, what was checked above, the counts below; a remedy of what was skipped once."""
    table, told = Table(box=None, pad_edge=False), set[str]()
    for title in ("", "row", "figure (bound)", "found", "manual"):
        table.add_column(title, overflow="fold")
    for row in rows:
        found = Text(row.found)
        if row.remedy and row.remedy not in told:
            found.append(f"\n-> {row.remedy}", style="bold" if row.verdict == "fail" else "dim")
        told |= {row.remedy} if row.verdict == "skipped" else set()
        figure = "" if row.figure is None else f"{row.figure:g}"
        cell = " ".join(part for part in (figure, f"({row.bound})" if row.bound else "", row.unit) if part)
        verdict = Text(row.verdict, style=STYLES[row.verdict])
        table.add_row(verdict, Text(row.title), Text(cell), found, Text(row.section))
    counts = ", ".join(f"{sum(row.verdict == verdict for row in rows)} {verdict}" for verdict in STYLES)
    console.print(Text(", ".join(f"{key} {value}" for key, value in facts.items()), style="dim"))
    console.print(table)
    console.print(Text(counts, style=STYLES["fail" if any(row.verdict == "fail" for row in rows) else "pass"]))


def show(rows: Sequence[Row], facts: Mapping[str, object], *, as_json: bool) -> None:
    """Print the report on standard output."""
    if as_json:
        print(json.dumps(document(rows, facts), ensure_ascii=False, indent=2))
    else:
        print_rows(Console(highlight=False, width=None if sys.stdout.isatty() else PAGE_COLUMNS), rows, facts)


def write_page(path: Path, rows: Sequence[Row], facts: Mapping[str, object]) -> None:
    """Write the report as one HTML file; whatever it is made of is escaped.

    Raises:
        Rejected: BAD_REQUEST, the file cannot be written.
    """
    try:
        with open(os.devnull, "w", encoding="utf-8") as nowhere:
            console = Console(record=True, file=nowhere, width=PAGE_COLUMNS, highlight=False)
            print_rows(console, rows, {"ta2 check": "of", **facts})
        path.write_text(console.export_html(inline_styles=True), encoding="utf-8")
    except OSError as error:
        hint = "name another place: --html FILE"
        refusal = Refusal(code=Code.BAD_REQUEST, message=f"{path}: {error.strerror or error}", field="file", hint=hint)
        raise to_exception(refusal) from None
