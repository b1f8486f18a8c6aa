"""The reader of pages in `tests/e2e/pages.py` runs what it shall, and a block that breaks is found and named."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.e2e.pages import PageBroken, PageRun, blocks, differs


def ran(tmp_path: Path, text: str) -> None:
    """Run a page with this text."""
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    run = PageRun(page, tmp_path)
    try:
        run.run()
    finally:
        run.close()


def block(language: str, text: str, directive: str = "") -> str:
    """Return a block of a page, with the comment before it."""
    return (f"<!-- {directive} -->\n" if directive else "") + f"```{language}\n{text}\n```\n\n"


def test_blocks_are_found_in_their_order_with_what_the_comment_before_them_says(tmp_path: Path) -> None:
    """A comment that is not right before a block is not about it."""
    page = tmp_path / "page.md"
    page.write_text(
        f"# Page\n\n{block('sh', 'a', 'not run: a real robot')}<!-- output -->\n\nWords.\n\n{block('text', 'b')}"
    )
    found = list(blocks(page))
    assert [(b.language, b.directive, b.text) for b in found] == [
        ("sh", "not run: a real robot", "a\n"),
        ("text", "", "b\n"),
    ]
    assert found[0].place == "page.md:4"


def test_blocks_of_python_are_one_session_and_what_they_print_is_compared(tmp_path: Path) -> None:
    """A name of one block is there in the next one; numbers and columns may differ, and a shell's files stay."""
    ran(
        tmp_path,
        block("python", "x = 1.25")
        + block("python", "print('x is', x, 'rad')\nopen('made', 'w').close()")
        + block("text", "x is  -3e-4 rad", "output")
        + block("sh", "ls made && ta2 --version")
        + block("text", "...\nta2 0.0.0", "output"),
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (block("sh", "true\nfalse\ntrue"), "page.md:1: status 1"),
        (block("python", "x = 1\nraise ValueError('no')"), "ValueError: no"),
        (block("python", "import os\nos._exit(0)"), "did not end in order"),
        (block("python", "print('a')") + block("text", "b", "output"), "page.md:6: the page says"),
        (block("sh", "ta2 move --left 1"), "7 joints"),
    ],
    ids=["a command that fails", "an exception", "a session that ends", "another output", "wrong arguments"],
)
def test_a_block_that_breaks_is_found_and_named(tmp_path: Path, text: str, told: str) -> None:
    """What the reader of the page would meet fails the test."""
    with pytest.raises(PageBroken, match=told):
        ran(tmp_path, text)


def test_a_block_for_another_machine_is_not_run(tmp_path: Path) -> None:
    """Nor is its output compared with that of an earlier block."""
    ran(tmp_path, block("sh", "false", "not run: a real robot") + block("text", "", "output"))


@pytest.mark.parametrize(
    ("told", "wanted", "is_same"),
    [
        ("a 1.5 b\n", "a -2 b", True),
        ("a b", "a c", False),
        ("a\nb\nc", "a\n...", True),
        ("a\nb\nc", "...\nc", True),
        ("a", "a\n...", True),
        ("a\nb\nc", "a\n...\nd", False),
        ("by me (root) -> go", "by me (...) -> go", True),
        ("by me\n(root) -> go", "by me (...) -> go", False),
        ("a\nb", "a", False),
    ],
)
def test_outputs_are_the_same_but_for_numbers_and_what_is_left_out(told: str, wanted: str, is_same: bool) -> None:
    """Dots stand for anything within a line, or for any lines."""
    assert (differs(told, wanted) == "") is is_same
