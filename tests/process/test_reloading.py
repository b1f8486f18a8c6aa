"""What reads the settings anew: a thread of its own that nobody waits for, whatever is asked of it or becomes of it."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gateway.core.messages.events import SettingsRead
from gateway.errors import Code, ConfigError, Refusal
from gateway.process.reloading import ENDED, MOST_TEXT, Reloader, has_terminal
from gateway.process.threads import take_lost
from gateway.settings.settings import ArmSettings, LocalSettings, Settings
from gateway.settings.toml_file import loads
from tests.changed import replace

DEADLINE_S = 20.0
SLOWER = Settings(arm=ArmSettings(v_radps=0.5))


class Panic(BaseException):
    """As a compiled part's."""


@contextmanager
def reading(read: Callable[[], Settings], settings: Settings | None = None, apart_s: float = 0.0) -> Iterator[Reloader]:
    """A reloader; nobody beside it hears of what it loses."""
    reloader = Reloader(settings or Settings(), read, apart_s)
    try:
        yield reloader
    finally:
        reloader.close()
        reloader._thread.join(DEADLINE_S)
        assert not reloader._thread.is_alive() and take_lost() == []


def found(reloader: Reloader) -> tuple[SettingsRead, Settings | None]:
    """Return the next outcome."""
    deadline = time.monotonic() + DEADLINE_S
    while not (outcomes := reloader.take()):
        assert time.monotonic() < deadline, "nothing was read"
        time.sleep(0.001)
    (outcome,) = outcomes
    return outcome


def test_nothing_is_read_before_it_is_asked_for_and_then_what_has_changed() -> None:
    """Once: the next reading of the same file has changed nothing."""
    read: list[int] = []

    def slower() -> Settings:
        read.append(1)
        return SLOWER

    with reading(slower) as reloader:
        assert reloader.take() == [] and read == []
        reloader.ask()
        event, settings = found(reloader)
        assert (event.values, event.message, event.is_refused) == ({"arm.v_radps": 0.5}, "arm.v_radps = 0.5", False)
        assert settings == SLOWER and event.at_ns <= time.monotonic_ns()
        reloader.ask()
        assert found(reloader)[0].values == {} and len(read) == 2


def test_what_was_refused_is_not_in_force() -> None:
    """The next reading is compared with what is; a limit is raised up to that of the start only."""
    files = iter(
        ["[arm]\nv_radps = 0.5\n", "[arm]\nv_radps = 0.4\nrate_hz = 90\n", "[arm]\nv_radps", "", "[arm]\nv_radps = 1.2"]
    )
    with reading(lambda: loads(next(files), "f.toml")) as reloader:
        seen = []
        for _ in range(5):
            reloader.ask()
            seen.append(found(reloader))
    events = [event for event, _ in seen]
    assert [event.is_refused for event in events] == [False, True, True, False, True]
    assert [settings is None for _, settings in seen] == [False, True, True, False, True]
    assert events[1].message.startswith("needs a restart: arm.rate_hz; start the gateway anew")
    assert events[2].message.startswith("f.toml: is not TOML")
    assert events[3].values == {"arm.v_radps": 1.0} and events[1].values == {}
    assert "arm.v_radps above the 1 of the start" in events[4].message


def test_a_file_that_the_settings_name_needs_a_restart_when_it_has_changed(tmp_path: Path) -> None:
    """A role that was taken away is not gone: nobody may believe so."""
    roles = tmp_path / "roles"
    roles.write_text("ann:admin\n")
    settings = replace(Settings(), local=LocalSettings(roles_file=str(roles)))
    with reading(lambda: settings, settings) as reloader:
        reloader.ask()
        assert not found(reloader)[0].is_refused
        roles.write_text("ann:viewer\n")
        reloader.ask()
        assert found(reloader)[0].message.startswith("needs a restart: the file of local.roles_file;")


def test_a_message_that_quotes_a_long_file_is_cut() -> None:
    """Every client gets it."""

    def read() -> Settings:
        raise ConfigError(Refusal(code=Code.BAD_CONFIG, message="x" * 100_000))

    with reading(read) as reloader:
        reloader.ask()
        assert found(reloader)[0].message == "x" * MOST_TEXT


def test_however_often_it_is_asked_for_one_more_reading_is_enough() -> None:
    """A storm while one is read: that one, and one after it."""
    begun, may_go, read = threading.Event(), threading.Event(), []

    def slowly() -> Settings:
        read.append(1)
        begun.set()
        assert may_go.wait(DEADLINE_S)
        return SLOWER

    with reading(slowly) as reloader:
        reloader.ask()
        assert begun.wait(DEADLINE_S)
        for _ in range(1000):
            reloader.ask()
        may_go.set()
        outcomes: list[object] = []
        deadline = time.monotonic() + DEADLINE_S
        while len(outcomes) < 2 and time.monotonic() < deadline:
            outcomes += reloader.take()
            time.sleep(0.001)
        reloader.close()
        reloader._thread.join(DEADLINE_S)
        assert len(outcomes) == len(read) == 2 and reloader.take() == []


def test_readings_are_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """A storm takes the control loop's processor once a second, not all of it."""
    waited: list[float] = []
    with reading(lambda: SLOWER, apart_s=3.0) as reloader:
        monkeypatch.setattr(reloader._is_closing, "wait", waited.append)  # as if the time had passed
        for number in (1, 2):
            reloader.ask()
            found(reloader)
            deadline = time.monotonic() + DEADLINE_S
            while len(waited) < number and time.monotonic() < deadline:
                time.sleep(0.001)
    assert waited[:2] == [3.0, 3.0]


def test_under_real_time_it_reads_below_all_other_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of its own thread alone, and above other processes; without real time nothing is asked of the kernel."""
    asked: list[tuple[int, int, int]] = []
    policies = [os.SCHED_OTHER, os.SCHED_FIFO]
    monkeypatch.setattr("gateway.process.reloading.os.sched_getscheduler", lambda pid: policies.pop(0))
    monkeypatch.setattr(
        "gateway.process.reloading.os.sched_setscheduler",
        lambda pid, policy, param: asked.append((pid, policy, param.sched_priority)),
    )
    while policies:
        with reading(lambda: SLOWER) as reloader:
            reloader.ask()
            found(reloader)
    assert asked == [(0, os.SCHED_FIFO, 1)]


def test_a_disk_that_hangs_keeps_nobody_waiting() -> None:
    """Asking, taking and closing come back."""
    may_go, begun = threading.Event(), threading.Event()

    def hang() -> Settings:
        begun.set()
        assert may_go.wait(DEADLINE_S)
        return SLOWER

    with reading(hang) as reloader:
        reloader.ask()
        assert begun.wait(DEADLINE_S)
        reloader.ask()
        assert reloader.take() == []
        reloader.close()
        assert reloader._thread.is_alive() and reloader._thread.daemon
        may_go.set()


def test_what_ends_the_thread_is_told_and_it_is_begun_anew_once() -> None:
    """The next file is read; after a second loss who asks is told that nobody reads any more. No robot stops by it."""
    panics = iter([True, False, True])

    def read() -> Settings:
        if next(panics):
            raise Panic("boom")
        return SLOWER

    with reading(read) as reloader:
        reloader.ask()
        event, settings = found(reloader)
        assert event.is_refused and settings is None and "the thread settings ended unasked: " in event.message
        assert event.message.endswith("Panic: boom")
        reloader.ask()
        assert found(reloader)[0].values == {"arm.v_radps": 0.5}
        reloader.ask()
        assert "Panic: boom" in found(reloader)[0].message
        reloader._thread.join(DEADLINE_S)
        reloader.ask()
        event, settings = found(reloader)
        assert (event.is_refused, event.message, settings) == (True, ENDED, None)


@pytest.mark.parametrize("is_there", [True, False])
def test_a_terminal_is_there_or_it_is_not(is_there: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What cannot be opened is none."""
    tty = tmp_path / "tty"
    if is_there:
        tty.touch()
    opened = os.open
    monkeypatch.setattr("gateway.process.reloading.os.open", lambda path, flags: opened(tty, flags))
    assert has_terminal() is is_there
