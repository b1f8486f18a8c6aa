"""The table of errors in the docs, written from the code table: what a user reads is what the code raises.

`python -m tests.tooling.error_table` writes it into the page; with `--check` it only says whether it is the same.
"""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

from gateway import errors
from gateway.codes import Code
from gateway.errors import CODES, GatewayError

__all__ = ["BEGIN", "END", "main", "section", "with_section"]

PAGE = Path(__file__).resolve().parents[2] / "docs/reference/codes.md"
BEGIN = "<!-- errors: written by `python -m tests.tooling.error_table` -->"
END = "<!-- end of errors -->"


def _classes() -> list[type[GatewayError]]:
    """Return the classes that a code becomes, in the order in which they are defined."""
    found = [c for c in vars(errors).values() if inspect.isclass(c) and issubclass(c, GatewayError)]
    used = {info.error for info in CODES.values()}
    return [error for error in found if error in used]


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


def section() -> str:
    """Return what stands between the markers: the classes with their codes, then each code with its remedy."""
    codes = {error: [code for code in Code if code in CODES and CODES[code].error is error] for error in _classes()}
    lines = ["| Class | Means | Codes |", "|---|---|---|"]
    for error, members in codes.items():
        means = (inspect.getdoc(error) or "").split("\n")[0].rstrip(".")
        lines.append(f"| `{error.__name__}` | {_cell(means)} | {' '.join(f'`{code}`' for code in members)} |")
    lines += [
        "",
        "<details><summary>What to do about each code</summary>",
        "",
        "| Code | The same request may succeed later by itself | What to do |",
        "|---|---|---|",
    ]
    for members in codes.values():
        for code in members:
            info = CODES[code]
            lines.append(f"| `{code}` | {'yes' if info.retryable else ''} | {_cell(info.hint)} |")
    return "\n".join([*lines, "", "</details>"])


def with_section(page: str) -> str:
    """Return the page with the table as it must be.

    Args:
        page: As it is.

    Raises:
        ValueError: The markers are not there, once each.
    """
    pattern = re.compile(f"{re.escape(BEGIN)}\n.*?{re.escape(END)}", re.DOTALL)
    written, count = pattern.subn(lambda _: f"{BEGIN}\n\n{section()}\n\n{END}", page)
    if count != 1:
        raise ValueError(f"the page must have {BEGIN} and {END} once, it has {count}")
    return written


def main(arguments: list[str], path: Path = PAGE) -> int:
    """Write the table, or say that it is not the code table's; return the exit status."""
    page = path.read_text(encoding="utf-8")
    wanted = with_section(page)
    if wanted == page:
        return 0
    if "--check" in arguments:
        print(f"{path.name}: the table of errors is not that of gateway/errors.py; python -m tests.tooling.error_table")
        return 1
    path.write_text(wanted, encoding="utf-8")
    print(f"{path.name}: table of errors written")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
