"""The index of the behaviour table: every test that it names exists, and every test of this folder stands in it."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

from tests.behaviour.index import INDEX
from tests.behaviour.test_transitions import EVENTS

TESTS = Path(__file__).resolve().parents[1]
PAGE = TESTS.parent / "docs/reference/behaviour.md"
NAMED = [name for rows in INDEX.values() for tests in rows.values() if not isinstance(tests, str) for name in tests]


@cache
def names_in(path: Path) -> set[str]:
    """Return the names of the tests in a file, without their `test_`."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    return {
        node.name.removeprefix("test_")
        for node in body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


def file_of(place: str) -> Path:
    """Return the file that a place of the index stands for."""
    folder, _, name = place.rpartition("/")
    return TESTS / (folder or "behaviour") / f"test_{name}.py"


def rows_of_the_page() -> dict[str, set[str]]:
    """Return the rows of each section of the behaviour page by their first cells."""
    sections: dict[str, set[str]] = {}
    for part in PAGE.read_text(encoding="utf-8").split("\n## ")[1:]:
        title, _, body = part.partition("\n")
        rows = [line.split(" | ")[0].removeprefix("| ") for line in body.splitlines() if line.startswith("| ")]
        sections[title] = set(rows[1:])  # without the head
    return sections


def test_the_page_and_the_index_have_the_same_rows() -> None:
    """Each row of the page has its tests, and each test its row."""
    proven = {section: {row for row in rows if not row.startswith("(")} for section, rows in INDEX.items()}
    assert rows_of_the_page() == proven


def test_every_test_that_the_index_names_exists() -> None:
    """A renamed or deleted test leaves a row unproven."""
    missing = []
    for name in NAMED:
        place, _, test = name.partition("::")
        known = set(EVENTS) if place == "cells" else names_in(file_of(place))
        if test not in known:
            missing.append(name)
    assert not missing


def test_every_row_has_tests_or_says_whose_they_are() -> None:
    """No empty row; where a whole folder has it, that folder is there."""
    for section, rows in INDEX.items():
        for row, tests in rows.items():
            assert tests, f"{section}: {row}"
            if isinstance(tests, str):
                assert all((TESTS.parent / path).exists() for path in tests.split(", "))


def test_every_test_of_this_folder_stands_in_the_index() -> None:
    """A test that proves no row belongs elsewhere."""
    exempt = {"index", "transitions"}
    orphans = []
    for path in sorted((TESTS / "behaviour").glob("test_*.py")):
        place = path.stem.removeprefix("test_")
        if place not in exempt:
            orphans += [f"{place}::{test}" for test in sorted(names_in(path)) if f"{place}::{test}" not in NAMED]
    assert not orphans


def test_every_row_of_the_cells_stands_in_the_index() -> None:
    """The rows of the transitions that are judged cell by cell."""
    assert {name.removeprefix("cells::") for name in NAMED if name.startswith("cells::")} == set(EVENTS)
