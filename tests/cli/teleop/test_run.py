"""Tests of `ta2 teleop` up to the first key; the rest: tests/e2e/test_teleop.py."""

from __future__ import annotations

import io
import signal
import sys

import pytest

from gateway.cli.teleop.run import _Screen
from gateway.cli.terminal.ending import Interrupted
from tests.client.robot_world import RobotWorld


def test_without_a_terminal_nobody_can_press_keys(shell, monkeypatch):
    """It says so before anything is connected or owned."""
    shell.world = RobotWorld()
    monkeypatch.setattr("sys.stdin", io.StringIO())
    ended = shell.run("teleop", "--yes")
    assert ended.status == 1 and "no terminal with keys" in ended.err and "--device gamepad" in ended.err
    assert not shell.world.pair.see().lease.owned


def test_it_knows_its_devices_and_arms(shell):
    """Usage, status 2."""
    for words in (("--device", "mouse"), ("--arm", "both"), ("--task",)):
        assert shell.run("teleop", *words).status == 2


def test_a_gamepad_that_cannot_be_read_is_refused_before_anything_moves(shell, monkeypatch):
    """With the pip command."""
    shell.world = RobotWorld()
    monkeypatch.setitem(sys.modules, "sdl2", None)
    ended = shell.run("teleop", "--device", "gamepad", "--yes")
    assert ended.status == 1 and "teleavatar-gateway[teleop]" in ended.err
    assert not shell.world.pair.see().lease.owned


class Terminal(io.StringIO):
    """A terminal, which may be gone."""

    is_gone = False

    def isatty(self):
        """It is one."""
        return True

    def write(self, text):
        """Fail when it is gone."""
        if self.is_gone:
            raise OSError(5, "Input/output error")
        return super().write(text)


def test_lines_stay_above_the_line_of_status_which_is_never_wrapped(monkeypatch):
    """On a terminal; elsewhere there is no line of status."""
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setattr("sys.stderr", Terminal())
    screen = _Screen()
    screen.say("held")
    screen.advance("teleop", None, "x" * 200)
    text = sys.stderr.getvalue()
    assert text.startswith("\r\x1b[2Kheld\n\r\x1b[2Kteleop: xxx") and len(text.split("\x1b[2K")[-1]) < 40
    monkeypatch.setattr("sys.stderr", io.StringIO())
    screen.say("held")
    screen.advance("teleop", None, "x")
    assert sys.stderr.getvalue() == "held\n"


def test_a_terminal_that_is_gone_is_as_a_hangup(monkeypatch):
    """What is still said on the way out goes nowhere, and fails nothing."""
    gone = Terminal()
    gone.is_gone = True
    monkeypatch.setattr("sys.stderr", gone)
    screen = _Screen()
    with pytest.raises(Interrupted) as hangup:
        screen.say("held")
    assert hangup.value.number == signal.SIGHUP
    screen.say("once more")
    sys.stderr.close()
