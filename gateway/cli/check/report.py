"""Rows for people, for scripts and for a file: a table of the terminal, JSON, and one HTML page that needs nothing else."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gateway.cli.check.rows import Row
from gateway.errors import Code, Refusal, to_exception

__all__ = ["document", "page", "show", "write_page"]

STYLES = {"pass": "green", "fail": "bold red", "skipped": "dim", "unknown": "yellow"}
CSS = """body{font:15px sans-serif;margin:2em}table{border-collapse:collapse}td,th{padding:.3em .8em;text-align:left;
vertical-align:top;border-bottom:1px solid #ccc}.pass{color:#060}.fail{color:#b00;font-weight:bold}.skipped{color:#777}
.unknown{color:#960}"""


def document(rows: Sequence[Row], facts: Mapping[str, object]) -> dict[str, object]:
    """Return it for scripts: `ok` when nothing failed, what was checked, and every row."""
    return {"ok": all(row.verdict != "fail" for row in rows), **facts, "rows": [asdict(row) for row in rows]}


def _figure(row: Row) -> str:
    """Return figure, bound and unit in one cell."""
    figure = "" if row.figure is None else f"{row.figure:g}"
    return " ".join(part for part in (figure, f"({row.bound})" if row.bound else "", row.unit) if part)


def _summary(rows: Sequence[Row]) -> str:
    return ", ".join(f"{sum(row.verdict == verdict for row in rows)} {verdict}" for verdict in STYLES)


def show(rows: Sequence[Row], facts: Mapping[str, object], *, as_json: bool) -> None:
    """Print the report on standard output."""
    if as_json:
        print(json.dumps(document(rows, facts), ensure_ascii=False, indent=2))
        return
    table = Table(box=None, pad_edge=False)
    for title in ("", "row", "figure (bound)", "found", "manual"):
        table.add_column(title, overflow="fold")
    for row in rows:
        found = Text(row.found)
        if row.remedy:
            found.append(f"\n-> {row.remedy}", style="bold" if row.verdict == "fail" else "dim")
        verdict = Text(row.verdict, style=STYLES[row.verdict])
        table.add_row(verdict, Text(row.title), Text(_figure(row)), found, Text(row.section))
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 160)
    console.print(Text(", ".join(f"{key} {value}" for key, value in facts.items()), style="dim"))
    console.print(table)
    console.print(
        Text(_summary(rows), style="bold red" if any(row.verdict == "fail" for row in rows) else "bold green")
    )


def page(rows: Sequence[Row], facts: Mapping[str, object]) -> str:
    """Return the report as HTML; whatever it is made of is escaped."""
    cells = "".join(
        f'<tr><td class="{row.verdict}">{row.verdict}</td>'
        + "".join(f"<td>{escape(text)}</td>" for text in (row.title, _figure(row), row.found, row.remedy, row.section))
        + "</tr>\n"
        for row in rows
    )
    told = "".join(f"<li>{escape(key)}: {escape(str(value))}</li>" for key, value in facts.items())
    head = "".join(f"<th>{title}</th>" for title in ("", "row", "figure (bound)", "found", "what to do", "manual"))
    return (
        f'<!doctype html>\n<html lang="en"><meta charset="utf-8"><title>ta2 check</title><style>{CSS}</style>\n'
        f"<h1>ta2 check</h1><ul>{told}</ul>\n<p>{_summary(rows)}</p>\n<table><tr>{head}</tr>\n{cells}</table></html>\n"
    )


def write_page(path: Path, rows: Sequence[Row], facts: Mapping[str, object]) -> None:
    """Write the HTML page.

    Raises:
        Rejected: BAD_REQUEST, the file cannot be written.
    """
    try:
        path.write_text(page(rows, facts), encoding="utf-8")
    except OSError as error:
        message = f"{path}: {error.strerror or error}"
        refusal = Refusal(code=Code.BAD_REQUEST, message=message, field="file", hint="name another place: --html FILE")
        raise to_exception(refusal) from None
