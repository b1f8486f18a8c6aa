"""`ta2 model check`: the body's numbers, ours or a URDF's, held against the manual and the published figures."""

from __future__ import annotations

import json
import math
from argparse import Namespace
from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from gateway.cli.terminal.ending import ExitStatus
from gateway.kinematics.clearance import clearances
from gateway.kinematics.description import nominal
from gateway.kinematics.model_check import Finding, compared, findings
from gateway.kinematics.urdf import from_urdf

__all__ = ["carry_out"]


def carry_out(options: Namespace) -> ExitStatus:
    """Print the check; REFUSED when a figure differs.

    Raises:
        ConfigError: The file cannot be used; the message names what is missing.
    """
    urdf = options.urdf
    description = nominal() if urdf is None else from_urdf(urdf)
    rows = (*findings(description), *clearances(description), *(compared(description) if urdf is not None else ()))
    wrong = [row for row in rows if not row.is_good]
    if options.json:
        print(json.dumps(document(description.source, rows), indent=2))
    else:
        _show(description.source, rows, wrong)
    return ExitStatus.REFUSED if wrong else ExitStatus.OK


def document(source: str, rows: Sequence[Finding]) -> dict[str, object]:
    """Return the check for scripts; null where nothing is demanded, or where there is no figure."""
    return {
        "source": source,
        "good": all(row.is_good for row in rows),
        "findings": [
            {
                "name": row.name,
                "found": row.found,
                "expected": row.expected,
                "off": row.off if math.isfinite(row.off) else None,
                "allowed": row.allowed if math.isfinite(row.allowed) else None,
                "unit": row.unit,
                "good": row.is_good,
            }
            for row in rows
        ],
    }


def _show(source: str, rows: Sequence[Finding], wrong: Sequence[Finding]) -> None:
    console = Console(highlight=False)
    table = Table(title=f"body: {source}", title_justify="left")
    for name in ("checked", "from the numbers", "held against", "off", ""):
        table.add_column(name, overflow="fold")
    for row in rows:
        mark = "" if math.isinf(row.allowed) else "[green]agrees[/]" if row.is_good else "[bold red]differs[/]"
        off = f"{row.off:.3g} {row.unit}".strip()
        table.add_row(row.name, row.found, row.expected, off, mark)
    console.print(table)
    judged = [row for row in rows if math.isfinite(row.allowed)]
    console.print(
        f"{len(judged)} figures checked, {len(wrong)} differ"
        + (": " + "; ".join(row.name for row in wrong) if wrong else "")
    )
