"""Tests of `ta2 enable`: it holds in the foreground, ends by Ctrl-C, and tells what happens meanwhile."""

from __future__ import annotations

import signal

import pytest
from msgspec.structs import replace

from gateway.codes import Code
from gateway.core.messages.outputs import Level, Notice
from tests.api.stand_in import a_snapshot


def when_enabled(shell, ticks, action):
    """Let something happen so long after the robot is READY."""
    since = []

    def on_tick():
        if shell.world.engine.snapshot.state != "ENABLING" and shell.world.engine.snapshot.enable.outcome == "ok":
            since.append(True)
            if len(since) == ticks:
                action()

    shell.world.on_tick = on_tick


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_holds_until_it_is_asked_to_end_and_then_releases(shell, number):
    """Ctrl-C and SIGTERM are its normal end: released, not left held, status 0; both signals are given back."""
    before = signal.getsignal(number)
    when_enabled(shell, 100, lambda: signal.raise_signal(number))
    ended = shell.run("enable")
    assert ended.status == 0 and ended.out == "released\n"
    assert shell.world.engine.names() == ["Acquire", "Enable", "Release"]
    assert "enable: READY" in ended.err and "Ctrl-C releases" in ended.err and "release: PAUSE" in ended.err
    assert signal.getsignal(number) is before and shell.names == ["ta2 enable"]


def test_a_closed_terminal_leaves_the_arms_held(shell):
    """SIGHUP is somebody who vanished: held as for any client that is lost."""
    when_enabled(shell, 30, lambda: signal.raise_signal(signal.SIGHUP))
    assert shell.run("enable").status == 129
    assert shell.world.engine.names()[-1] == "Abandon"


def test_a_stop_by_somebody_is_told_and_the_arms_stay_held(shell):
    """What happens is told as it happens, with the remedy; holding goes on."""
    world = shell.world

    def happen():
        if world.ticks == 100:
            world.engine.show(state="HOLDING", latches={"STOPPED_BY_OTHER": "by a colleague"})
        elif world.ticks == 200:
            signal.raise_signal(signal.SIGINT)

    world.on_tick = happen
    ended = shell.run("enable")
    assert ended.status == 0
    assert "now FAULT, HOLDING\n  STOPPED_BY_OTHER: by a colleague -> " in ended.err


@pytest.mark.parametrize(
    ("changes", "code"),
    [({"latches": {"ESTOP": "by hand"}}, "ESTOP"), ({}, "NOT_ENABLED"), ({"latches": {"NEW_ONE": "x"}}, "NOT_ENABLED")],
)
def test_it_ends_when_nothing_is_held_any_more(shell, changes, code):
    """The gateway went down without us: status 1 with the cause."""
    when_enabled(shell, 50, lambda: shell.world.engine.show(**changes, state="IDLE"))
    ended = shell.run("enable")
    assert ended.status == 1 and not ended.out
    last = ended.err.splitlines()[-1]
    assert last.startswith(f"{code}: the arms are not held any more: the gateway is IDLE")


@pytest.mark.parametrize("owned", [True, False])
def test_it_ends_when_somebody_else_has_the_robot(shell, owned):
    """A takeover ends it: the new owner is named."""
    lease = replace(a_snapshot().lease, owned=owned, name="operator" if owned else "", client_id="x", pid=9, epoch=99)
    when_enabled(shell, 50, lambda: shell.world.engine.show(lease=lease))
    ended = shell.run("enable")
    assert ended.status == 1
    assert f"LEASE_LOST: {'' if not owned else chr(39)}{'operator' if owned else 'nobody'}" in ended.err


def test_the_loser_is_told_the_reason_of_who_took_the_robot(shell):
    """As the gateway told it."""
    lease = replace(a_snapshot().lease, owned=True, name="operator", client_id="x", pid=9, epoch=99)
    facts = {"epoch": "99"}
    told = Notice(code=Code.LEASE_CHANGED, level=Level.WARNING, message="operator took it: smoke", at_ns=1, facts=facts)

    def happen():
        shell.world.engine.notices.append(told)
        shell.world.engine.show(lease=lease)

    when_enabled(shell, 50, happen)
    ended = shell.run("enable")
    assert ended.status == 1 and "LEASE_LOST: operator took it: smoke" in ended.err


def test_what_keeps_it_from_enabling_is_told(shell):
    """The gateway's reason, status 1, and nothing is left held."""
    shell.world.engine.enable_outcome = "ENABLE_TIMEOUT"
    ended = shell.run("enable", "--take", "test")
    assert ended.status == 1 and "ENABLE_TIMEOUT: READY was not seen" in ended.err
    assert shell.world.engine.names()[:2] == ["Take", "Enable"]
