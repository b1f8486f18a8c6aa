"""Tests of the picture of a replay."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from gateway.cli.motion import replay_plot
from gateway.cli.motion.replay_plot import LEAST_RAD, write_plot


@pytest.fixture
def figures(monkeypatch):
    """The figures that were written."""
    kept, close = [], replay_plot.plt.close
    monkeypatch.setattr(replay_plot.plt, "close", kept.append)
    yield kept
    for figure in kept:
        close(figure)


def rows(off_rad, count=40):
    """Return an arm that swings, and is off by so much now."""
    times_s = np.linspace(0.0, 2.0, count)
    then = np.outer(np.sin(times_s), [0.3, 0.0, 0.2, 0.0, 0.1, 0.0, 0.0]) + 1.0
    return np.column_stack([times_s, then + off_rad, then])


def test_each_joint_has_a_panel_whose_title_tells_the_distance(figures, tmp_path):
    """RMS in mrad, of both arms."""
    write_plot({"left": rows(0.003), "right": rows(0.0)}, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    (figure,) = figures
    titles = [panel.get_title(loc="left") for panel in figure.axes]
    assert len(titles) == 14
    assert titles[:2] == ["left joint 1: RMS 3.0 mrad", "right joint 1: RMS 0.0 mrad"]
    assert all(panel.viewLim.height >= LEAST_RAD - 1e-9 for panel in figure.axes), "noise fills no panel"


def test_what_was_not_recorded_is_no_distance(figures, tmp_path):
    """A part of the time is left out of it, all of it is said; one arm alone has one column."""
    table = rows(0.002)
    table[5:20, 8:] = np.nan
    write_plot({"right": table}, tmp_path / "a.svg")
    table[:, 8:] = np.nan
    write_plot({"right": table}, tmp_path / "b.pdf")
    part, nothing = ([panel.get_title(loc="left") for panel in figure.axes] for figure in figures)
    assert part[3] == "right joint 4: RMS 2.0 mrad" and len(part) == 7
    assert nothing[3] == "right joint 4: not recorded"
    assert b"<svg" in (tmp_path / "a.svg").read_bytes() and (tmp_path / "b.pdf").read_bytes().startswith(b"%PDF")


def test_a_single_moment_is_a_picture_too(figures, tmp_path):
    """Of a replay that ended at once."""
    write_plot({"left": rows(0.0, count=1)}, tmp_path / "a.png")
    assert (tmp_path / "a.png").exists()
