"""Tests of what is said while a command runs."""

from __future__ import annotations

import io
import sys
import threading

import pytest

from gateway.cli.terminal.progress import teller


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_without_a_terminal_progress_is_a_few_plain_lines(capsys):
    """A line per quarter and phase, none in between: logs stay readable."""
    with teller() as tell:
        tell.say("begin")
        for percent in range(0, 101, 5):
            tell.advance("move", percent / 100, f"{percent} %")
        for _ in range(5):
            tell.advance("wait", None, "a while")
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["begin", "move: 0 %", "move: 25 %", "move: 50 %", "move: 75 %", "move: 100 %", "wait: a while"]


@pytest.mark.parametrize("has_thread", [True, False])
def test_on_a_terminal_progress_is_drawn(monkeypatch, has_thread):
    """One bar per phase, with its detail; what is said stays above. Without a thread, whoever tells draws."""
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    before = threading.active_count()
    with teller(has_thread=has_thread) as tell:
        assert threading.active_count() - before == has_thread
        tell.advance("enable", None, "waiting for READY")
        assert has_thread or "waiting for READY" in screen.getvalue()
        tell.advance("enable", 1.0, "READY")
        tell.say("a [sentence] that stays")
        tell.advance("move", 0.5, "50 %")
    text = screen.getvalue()
    assert "enable" in text and "READY" in text and "50 %" in text and "a [sentence] that stays" in text
