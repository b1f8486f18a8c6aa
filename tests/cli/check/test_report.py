"""The report of `ta2 check`: a table, JSON, a page; and how a row is made of the table of bounds."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from gateway.cli.check.report import document, print_rows, write_page
from gateway.cli.check.rows import MOVING, POINTS, measured, row, skipped, worst
from gateway.errors import Rejected

EVIL = "<script>alert('[bold]')</script> & \u201cμ\u201d"


def text_of(rows, facts=None):
    """Return the table as it is printed."""
    out = io.StringIO()
    print_rows(Console(file=out, width=200, highlight=False), rows, facts or {})
    return out.getvalue()


def test_a_page_is_one_file_in_which_everything_is_escaped(tmp_path):
    """Text of a robot, of a bridge, or of whoever is connected is text."""
    path = tmp_path / "a.html"
    write_page(path, [row("bridge", False, EVIL)], {"robot": EVIL})
    page = path.read_text(encoding="utf-8")
    assert "<script" not in page and page.count("&lt;script&gt;") == 2 and "μ" in page
    assert "src=" not in page and "href=" not in page and "@import" not in page
    with pytest.raises(Rejected, match="nowhere"):
        write_page(tmp_path / "nowhere" / "a.html", [], {})


def test_the_table_has_each_row_with_figure_bound_and_remedy():
    """Markup in a text is text; what was skipped for one reason says once what to do."""
    out = text_of(
        [measured("still", 0.3, "left"), row("bridge", True, EVIL), *skipped(MOVING[:3], "nobody agreed", "type it")]
    )
    assert "0.3 (<= 0.05) rad" in out and "-> who moves it?" in out and "[bold]" in out
    assert out.count("type it") == 1 and "1 pass, 1 fail, 3 skipped, 0 unknown" in out


def test_json_has_everything_and_one_verdict():
    """Unknown and skipped are no failure."""
    rows = [row("fsm", "unknown", ""), *skipped(("home",), "left to you"), measured("clock", 0.2, "")]
    told = document(rows, {"robot": "r"})
    assert (
        told["ok"]
        and told["robot"] == "r"
        and [each["verdict"] for each in told["rows"]] == ["unknown", "skipped", "pass"]
    )
    assert not document([measured("clock", 0.6, "")], {})["ok"]


@pytest.mark.parametrize(
    ("name", "figure", "verdict", "bound"),
    [
        ("clock", 0.5, "pass", "-0.5 to 0.5"),
        ("clock", -0.51, "fail", "-0.5 to 0.5"),
        ("clock", None, "unknown", "-0.5 to 0.5"),
        ("gripper_left", 0.05, "pass", ">= 0.05"),
        ("gripper_left", 0.04, "fail", ">= 0.05"),
        ("still", float("nan"), "fail", "<= 0.05"),
        ("fsm", 2, "pass", "0 to 2"),
        ("fsm", -1, "fail", "0 to 2"),
    ],
)
def test_a_figure_is_judged_by_the_bound_that_is_shown(name, figure, verdict, bound):
    """NaN is outside of every bound; without a figure nobody can tell."""
    made = measured(name, figure, "")
    assert (made.verdict, made.bound) == (verdict, bound) and bool(made.remedy) == (
        verdict != "pass" and bool(POINTS[name].remedy)
    )


def test_of_several_figures_the_greatest_counts_and_those_beyond_are_named():
    """None of them: nobody can tell."""
    made = worst("still", {"left": 0.01, "right": 0.2}, "the furthest", "moved")
    assert (made.verdict, made.figure, made.found) == ("fail", 0.2, "moved: right")
    assert worst("still", {}, "", "").verdict == "unknown"
