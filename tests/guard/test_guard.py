"""What the guard itself does beside its parts; what it does to a robot is in tests/e2e/test_guard.py."""

from __future__ import annotations

import logging
import threading
from types import SimpleNamespace

import pytest

from gateway.core.handover.freeze import FreezeWatch
from gateway.core.messages.outputs import Remembered
from gateway.errors import Code
from gateway.guard import guard as guard_module
from gateway.guard.guard import Guard
from gateway.process.state_file import StateFile, path_of
from gateway.settings.settings import Settings

MS = 1_000_000


@pytest.fixture
def guard(tmp_path, monkeypatch):
    """A guard that only writes latches, and the file of its robot."""
    monkeypatch.setattr(guard_module, "state_dir", lambda: tmp_path)
    made = Guard.__new__(Guard)
    made._settings, made._one_writer, made._writers = Settings(), threading.Lock(), []
    made._is_handing = False
    link = made._settings.link
    return made, path_of(tmp_path, link.endpoint, link.namespace)


def kept(path) -> Remembered:
    """Return what the next daemon finds."""
    with StateFile(path) as file:
        return file.start().remembered


def test_a_latch_waits_for_the_file_of_a_daemon_that_is_not_quite_dead(guard, monkeypatch, caplog):
    """A killed process keeps its locks until the kernel has freed its memory: a latch must not be lost to that."""
    made, path = guard
    tried = threading.Event()

    class Tried(StateFile):
        def open(self) -> None:
            try:
                super().open()
            finally:
                tried.set()

    monkeypatch.setattr(guard_module, "StateFile", Tried)
    with StateFile(path):
        made._remember({Code.ESTOP: "smoke"})
        assert tried.wait(10.0)
    made._finish_writing()
    assert kept(path).latches == {Code.ESTOP: "smoke"} and caplog.text == ""


def test_a_file_that_stays_anothers_is_told_and_waited_for_no_longer(guard, monkeypatch, caplog):
    """The daemon that has it takes the latches over with the hold."""
    made, path = guard
    monkeypatch.setattr(guard_module, "DISK_TIMEOUT_S", 0.0)
    with StateFile(path), caplog.at_level(logging.WARNING):
        made._keep({Code.ESTOP: "smoke"})
    assert "could not be written" in caplog.text and kept(path).latches == {}


def test_what_others_command_is_heard_from_the_first_doubt_on(guard):
    """Not while the daemon ticks, which listens itself; 30 ms before the verdict a hold may be near, and 50 ms are a doubt."""
    made, _ = guard
    heard, held = [], SimpleNamespace(at_ns=0, is_sending=True)
    made._board = SimpleNamespace(read=lambda: held, known_zid="a1")
    made._link = SimpleNamespace(zid="a1", hear_commands=lambda: heard.append(now_ms))
    made._guardian = SimpleNamespace(freeze=FreezeWatch(80 * MS))
    made._probe = SimpleNamespace(ran_ns=lambda: 0, ask=lambda: None)
    made._api = SimpleNamespace(misses=0)
    made._asked_ns, made._is_killed = None, False
    for now_ms in range(151):
        held.at_ns = min(now_ms, 100) * MS  # it ticks for 100 ms
        made._watch(now_ms * MS, is_daemon_gone=False)
    assert heard == [150]
