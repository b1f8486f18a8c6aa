"""The table of errors in the docs is the code table."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.codes import Code
from gateway.errors import CODES
from tests.tooling.error_table import BEGIN, END, PAGE, main, section, with_section


def test_the_page_has_the_table_of_the_code() -> None:
    """When this fails: `python -m tests.tooling.error_table`."""
    assert main(["--check"]) == 0


def test_every_code_stands_in_the_table_with_its_remedy() -> None:
    """A code that can reach a caller is never left out, and its row has the hint that the caller gets."""
    rows = [line for line in section().splitlines() if line.startswith("| `")]
    for code, info in CODES.items():
        (row,) = [line for line in rows if line.startswith(f"| `{code}` |")]
        assert row.endswith(f"| {info.hint} |") and ("| yes |" in row) is info.retryable
        assert any(line.startswith(f"| `{info.error.__name__}` |") and f"`{code}`" in line for line in rows)


def test_every_code_stands_on_the_page() -> None:
    """Those that are only told have no remedy, and are in a table of their own."""
    page = PAGE.read_text(encoding="utf-8")
    assert [code for code in Code if f"`{code}`" not in page] == []


def test_an_old_table_is_found_and_rewritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--check` fails on any difference and changes nothing; without it the table is written, and all else is kept."""
    page = tmp_path / "codes.md"
    page.write_text(PAGE.read_text(encoding="utf-8").replace("`NOT_OWNER`", "`NOT_OWNED`"), encoding="utf-8")
    old = page.read_text(encoding="utf-8")
    assert main(["--check"], page) == 1 and "table of errors" in capsys.readouterr().out
    assert page.read_text(encoding="utf-8") == old
    assert main([], page) == 0
    assert page.read_text(encoding="utf-8") == PAGE.read_text(encoding="utf-8")
    assert main(["--check"], page) == 0


@pytest.mark.parametrize("text", ["no markers", f"{BEGIN}\n{END}\n{BEGIN}\n{END}"], ids=["none", "two"])
def test_markers_must_be_there_once(text: str) -> None:
    """A page that lost its markers is not quietly left without a table."""
    with pytest.raises(ValueError, match="once"):
        with_section(text)
