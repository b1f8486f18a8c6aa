"""Tests of `ta2 events`: a line for each notice, as it comes, for people and for scripts."""

from __future__ import annotations

import json

import pytest

from gateway.cli.looking.events import line_of_notice
from gateway.cli.main import main
from gateway.core.messages.outputs import Level, Notice
from gateway.errors import Code
from tests.cli.shell import Shell


@pytest.fixture
def shell(monkeypatch, capsys):
    """A shell whose commands find a scripted engine."""
    return Shell(monkeypatch, capsys)


def tell(shell, ticks, message):
    """Let the gateway tell something so many ticks after the command was begun."""
    notice = Notice(code=Code.WALK, level=Level.WARNING, message=message, at_ns=7, facts={"side": "left"})
    shell.world.engine.later(ticks, lambda: shell.world.engine.notices.append(notice))


def test_notices_are_lines_until_there_is_silence(shell):
    """Level, code, message and facts; the end comes after the silence that was asked for."""
    tell(shell, 5, "first, see recover()")
    tell(shell, 30, "second")
    before_ns = shell.world.time_ns
    ended = shell.run("events", "--silence", "0.5")
    assert ended.status == 0
    assert ended.out.splitlines() == [
        "warning WALK: first, see `ta2 recover` side=left",
        "warning WALK: second side=left",
    ]
    assert 0.8 <= (shell.world.time_ns - before_ns) / 1e9 < 1.0 and "Ctrl-C" in ended.err


def test_scripts_get_a_json_object_a_line(shell):
    """All fields, under the names of the protocol."""
    tell(shell, 3, "m")
    (line,) = shell.run("events", "--json", "--silence", "0.2").out.splitlines()
    assert json.loads(line) == {
        "code": "WALK",
        "level": "warning",
        "message": "m",
        "at_ns": 7,
        "facts": {"side": "left"},
    }


def test_ctrl_c_is_the_usual_end(shell):
    """Without --silence it goes on until somebody ends it; that is no error."""

    def interrupt():
        raise KeyboardInterrupt

    tell(shell, 3, "m")
    shell.after_ticks(500, interrupt)
    ended = shell.run("events")
    assert ended.status == 0 and ended.out.startswith("warning WALK: m")


def test_it_goes_on_with_the_next_gateway(shell):
    """A restart is a line, and what the next gateway tells follows."""
    world = shell.world

    def on_tick():
        if world.ticks == 50:
            world.plane.set_reachable(False)
        elif world.ticks == 300:
            world.plane._daemon_id = "second"
            world.plane._outbox._told = 0
            world.plane.set_reachable(True)
            tell(shell, 3, "from the second")

    world.on_tick = on_tick
    lines = shell.run("events", "--silence", "5").out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["warning DISCONNECTED", "warning CONNECTED", "warning WALK"]


def test_silence_for_lack_of_a_gateway_is_an_error(shell):
    """A script must not take a dead gateway for a quiet one."""
    shell.after_ticks(20, lambda: shell.world.plane.set_reachable(False))
    ended = shell.run("events", "--silence", "3")
    assert ended.status == 3 and "DISCONNECTED" in ended.out and "DISCONNECTED" in ended.err


def test_a_notice_without_facts_is_a_short_line():
    """Nothing trails where there is nothing to say."""
    from gateway.api import protocol

    assert line_of_notice(protocol.Notice(code="A", level="info", message="m", at_ns=1)) == "info    A: m"


def test_nobody_there_ends_at_once(capsys):
    """As every client command."""
    assert main(["events", "--socket", "/nowhere/gw.sock"]) == 3
    assert "/nowhere/gw.sock" in capsys.readouterr().err
