"""The daemon's composition root: its log never holds anybody up, and its end gives everything back."""

from __future__ import annotations

import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gateway.api.service import LocalPlane
from gateway.core.engine import Engine
from gateway.core.messages.events import ExitRequested, PartEnded, SettingsRead
from gateway.link.robot_link import RobotLink
from gateway.process import daemon
from gateway.process.log import JsonLines, LogWriter, RateLimit
from gateway.process.measures import Measures
from gateway.process.notify import Notifier
from gateway.process.reloading import Reloader
from gateway.process.state_file import StateWriter
from gateway.process.threads import supervised, take_lost
from gateway.settings.settings import (
    ChassisSettings,
    GuardSettings,
    LinkSettings,
    LocalSettings,
    RealtimeSettings,
    Settings,
)
from tests.changed import replace

ROOT = Path(__file__).resolve().parents[2]
DEADLINE_S = 20.0


def record(message: str, *, line: int = 1, code: str = "") -> logging.LogRecord:
    """Return a warning as the loop makes them."""
    made = logging.LogRecord("gateway.process.loop", logging.WARNING, "loop.py", line, message, (), None)
    if code:
        made.code = code
    return made


def test_a_log_that_nobody_reads_stops_nobody() -> None:
    """Ctrl-S in the terminal, or a pipe whose reader hangs: whoever logs goes on, and the process can end."""
    program = (
        "import logging\nfrom gateway.process.log import configure_log\nconfigure_log(is_json=False)\n"
        "for n in range(20):\n    logging.getLogger('x').warning('%d %s', n, 'x' * 8000)\n"
        "print('still here', flush=True)\n"
    )
    reader, writer = os.pipe()  # holds 64 KiB; 160 KiB are written
    try:
        done = subprocess.run(
            [sys.executable, "-c", program], cwd=ROOT, stdout=subprocess.PIPE, stderr=writer, timeout=DEADLINE_S,
            check=False,
        )  # fmt: skip
    finally:
        os.close(reader)
        os.close(writer)
    assert done.stdout == b"still here\n"
    assert done.returncode == 0


def test_a_process_that_is_aborted_leaves_where_each_of_its_threads_stood() -> None:
    """Whatever hangs: the stacks are written without the interpreter's lock."""
    program = (
        "import threading\nfrom gateway.process.log import configure_log\nconfigure_log(is_json=True)\n"
        "def waits_for_ever():\n    print('waits', flush=True)\n    threading.Event().wait()\n"
        "threading.Thread(target=waits_for_ever, daemon=True).start()\nthreading.Event().wait()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None and process.stdout.readline() == "waits\n"
        process.send_signal(signal.SIGABRT)
        _, said = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == -signal.SIGABRT
    assert said.startswith("Fatal Python error: Aborted") and said.count("in waits_for_ever") == 1
    assert said.count("hread 0x") == 3  # the log's own as well


@contextmanager
def piped() -> Iterator[tuple[LogWriter, int]]:
    """A writer into a pipe that holds one page, and the pipe's other end."""
    reader, end = os.pipe()
    writer = LogWriter(end, capacity=10)
    writer.setFormatter(logging.Formatter("%(message)s"))
    try:
        yield writer, reader
    finally:
        os.close(reader)  # a write that still hangs fails now
        writer.close()
        writer._thread.join(20.0)  # what it still has would go to whatever has this number next
        os.close(end)


def test_lines_come_in_order_and_whole() -> None:
    """What is logged arrives line by line in its order, also lines longer than a pipe takes at once."""
    with piped() as (writer, reader):
        wanted = [f"{n} {'x' * 30_000}" for n in range(8)]
        for line in wanted:
            writer.handle(record(line))
        text = b""
        while text.count(b"\n") < len(wanted):
            text += os.read(reader, 65536)
    assert text.decode().splitlines() == wanted


def accounted(text: str) -> int:
    """Return how many records a log shows, and says that it left out."""
    lines = text.splitlines()
    said = [int(line.split()[0]) for line in lines if "were left out" in line]
    return lines.count("x" * 30_000) + sum(said)


def test_lines_that_had_to_be_left_out_are_counted_in_the_log() -> None:
    """When more waits than fits, lines are left out; the log says how many as soon as it is read again."""
    with piped() as (writer, reader):
        for _ in range(200):
            writer.handle(record("x" * 30_000))
        text = ""
        while accounted(text) < 200:
            text += os.read(reader, 65536).decode()
    assert accounted(text) == 200


def test_closing_waits_for_what_was_logged_but_not_for_ever() -> None:
    """The last lines before the end are written; a reader that hangs holds the end up for a second at most."""
    with piped() as (writer, reader):
        writer.handle(record("the end"))
        writer.close()
        assert os.read(reader, 100) == b"the end\n"
    with piped() as (writer, _):
        for _ in range(5):
            writer.handle(record("x" * 30_000))
        began = time.monotonic()
        writer.close()
        assert time.monotonic() - began < 5.0


def test_a_closed_descriptor_ends_no_thread() -> None:
    """Nobody reads any more (the terminal is gone): lines are dropped, logging goes on."""
    reader, end = os.pipe()
    os.close(reader)
    others = set(threading.enumerate())
    writer = LogWriter(end)
    try:
        for n in range(3):
            writer.handle(record(str(n)))
        writer.handle(record("text that no encoding has: \ud800"))
    finally:
        writer.close()
        os.close(end)
    assert not any(thread.name == "log" for thread in set(threading.enumerate()) - others)


def test_a_record_that_cannot_be_shown_does_not_end_the_log() -> None:
    """A message whose text cannot be made is told as such, and the next one comes."""
    with piped() as (writer, reader):
        bad = record("%d")
        bad.args = ("no number",)
        writer.handle(bad)
        writer.handle(record("next"))
        text = b""
        while text.count(b"\n") < 2:
            text += os.read(reader, 65536)
    assert "cannot be shown: TypeError" in text.decode().splitlines()[0]
    assert text.decode().splitlines()[1] == "next"


def test_a_panic_in_the_logs_own_thread_is_in_the_log(capfd: pytest.CaptureFixture[str]) -> None:
    """It is begun anew: who else could tell of it?"""

    class Panic(BaseException):
        pass

    class Bad(logging.LogRecord):
        def getMessage(self) -> str:
            raise Panic("boom")

    take_lost()
    with piped() as (writer, reader):
        handlers, logging.getLogger("gateway.process.threads").handlers = (
            logging.getLogger("gateway.process.threads").handlers,
            [writer],
        )
        try:
            writer.handle(Bad("x", logging.INFO, __file__, 1, "bad", (), None))
            text = b""
            while b"Panic: boom\n" not in text:
                text += os.read(reader, 65536)
            writer.handle(record("next"))
            while b"next\n" not in text:
                text += os.read(reader, 65536)
        finally:
            logging.getLogger("gateway.process.threads").handlers = handlers
    assert b"the thread log ended unasked" in text and [lost.name for lost in take_lost()] == ["log"]


def test_one_source_may_speak_twenty_times_a_second() -> None:
    """The limit is per line of source and code: a flood of one notice does not hide another one."""
    now = [100.0]
    limit = RateLimit(clock=lambda: now[0])
    assert sum(limit.filter(record("a", code="TICK_LATE")) for _ in range(50)) == 20
    assert limit.filter(record("b", code="LATCH_CHANGED"))
    assert limit.filter(record("c", line=2))
    now[0] += 1.1
    assert limit.filter(record("a", code="TICK_LATE"))


def test_a_wall_clock_that_is_set_back_silences_nobody() -> None:
    """BEHAVIOUR, a wall clock jumps: nothing. Also not the log, for as long as the jump was."""
    now = [100.0]
    limit = RateLimit(clock=lambda: now[0])
    for n in range(25):
        limit.filter(record(str(n)))
    late = record("an hour earlier")
    late.created -= 3600.0
    now[0] += 2.0
    assert limit.filter(late)


def test_json_lines_have_code_and_facts() -> None:
    """A notice becomes one JSON object with its code and facts."""
    made = record("latched", code="ESTOP")
    made.facts = {"by": "x"}
    line = json.loads(JsonLines().format(made))
    assert (line["message"], line["code"], line["facts"], line["level"]) == ("latched", "ESTOP", {"by": "x"}, "warning")


# ---------------------------------------------------------------------------------------------------------- the end


class Parts:
    """Stands for plane, link, measures and state writer of a daemon; writes down how they end."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, *, link_closes: bool = True) -> None:
        self.ended: list[str] = []
        self.status: list[int] = []
        self.on_plane_close: Callable[[], None] = lambda: None
        self.in_loop: Callable[[], None] = lambda: None
        parts = self

        class Plane(LocalPlane):
            def close(self, timeout_s: float = 2.0) -> None:
                super().close(timeout_s)
                if "plane" not in parts.ended:
                    parts.ended.append("plane")
                    parts.on_plane_close()

        class Link(RobotLink):
            def open(self) -> None:
                pass

            def close(self, timeout_ns: int = 2_000_000_000) -> bool:
                closed = super().close(timeout_ns)
                if timeout_ns:
                    parts.ended.append("link")
                return closed and link_closes

        class Writer(StateWriter):
            def close(self, timeout_s: float) -> bool:
                parts.ended.append("writer")
                return super().close(timeout_s)

        class RealTime(Measures):
            def undo(self) -> None:
                parts.ended.append("real time")
                super().undo()

        class Loop:
            def __init__(self, *_: object, **__: object) -> None:
                pass

            def run(self, stop: Callable[[], bool]) -> None:
                parts.in_loop()

        monkeypatch.setenv("TA2_STATE_DIR", str(tmp_path / "state"))
        stand_ins = {"LocalPlane": Plane, "RobotLink": Link, "Measures": RealTime, "StateWriter": Writer, "Loop": Loop}
        for name, part in stand_ins.items():
            monkeypatch.setattr(daemon, name, part)
        monkeypatch.setattr(os, "_exit", self.status.append)
        monkeypatch.setattr(logging, "shutdown", lambda: None)
        self.settings = Settings(
            # A robot that no other process of the tests has, which may run this file as well.
            link=LinkSettings(endpoint=f"tcp/127.0.0.1:{10_000 + os.getpid() % 50_000}"),
            local=LocalSettings(socket=str(tmp_path / "s")),
            realtime=RealtimeSettings(fifo=False, lock_memory=False),
            guard=GuardSettings(enabled=False),
        )


def test_impatience_at_the_end_skips_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A further Ctrl-C or SIGTERM while the daemon closes: link and state file are still closed in order."""
    parts = Parts(monkeypatch, tmp_path)
    parts.on_plane_close = lambda: [os.kill(os.getpid(), number) for number in (signal.SIGINT, signal.SIGTERM)]
    assert daemon.run(parts.settings) == 0
    assert parts.ended == ["plane", "link", "real time", "writer"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


class Manager(Notifier):
    """A service manager's ear, and what was said there."""

    def __init__(self) -> None:
        super().__init__("/nobody")
        self.heard: list[str] = []

    def ready(self, now_ns: int, status: Callable[[], str]) -> None:
        self.heard.append(f"ready, {status()}")

    def stopping(self, now_ns: int) -> None:
        self.heard.append("stopping")

    def close(self) -> None:
        super().close()
        self.heard.append("closed")


def test_a_service_manager_hears_when_clients_can_connect(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With the state as the line for people; not before the plane is open, and nothing after all has been closed."""
    parts, manager = Parts(monkeypatch, tmp_path), Manager()
    parts.on_plane_close = lambda: manager.heard.append("plane closed")
    daemon.run(parts.settings, lambda socket: manager.heard.append("clients can connect"), notifier=manager)
    assert manager.heard == ["clients can connect", "ready, OFFLINE", "plane closed", "closed"]


def test_a_service_manager_hears_that_the_end_was_asked_for(tmp_path: Path) -> None:
    """Once, before the engine is told."""
    settings = Settings(
        link=LinkSettings(endpoint=f"tcp/127.0.0.1:{10_000 + os.getpid() % 50_000}"),
        local=LocalSettings(socket=str(tmp_path / "s")),
    )
    plane, manager = LocalPlane(settings, tmp_path), Manager()
    try:
        watched = daemon._Watched(plane, Engine(settings), manager)
        watched.take_signal(signal.SIGTERM)
        assert [type(event) for event in watched.poll()] == [ExitRequested]
        assert list(watched.poll()) == [] and manager.heard == ["stopping"]
    finally:
        plane.close()
        manager.close()


def test_one_part_that_fails_to_close_keeps_no_other_open(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The robot's session and the state file are closed whatever the local plane does; its error is told."""
    parts = Parts(monkeypatch, tmp_path)

    def fail() -> None:
        raise OSError("the plane")

    parts.on_plane_close = fail
    with pytest.raises(OSError, match="the plane"):
        daemon.run(parts.settings)
    assert parts.ended == ["plane", "link", "real time", "writer"]


def test_a_session_that_hangs_does_not_keep_a_dead_daemon_alive(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The loop failed and zenoh hangs: the process ends with status 1, or nothing would start it again."""
    parts = Parts(monkeypatch, tmp_path, link_closes=False)

    def fail() -> None:
        raise ZeroDivisionError("a bug")

    parts.in_loop = fail
    with pytest.raises(ZeroDivisionError):  # `_exit` does not exit here
        daemon.run(parts.settings)
    assert parts.status == [1]
    assert "a bug" in caplog.text
    assert parts.ended == ["plane", "link", "real time", "writer"]


def test_a_daemon_that_lost_a_thread_ends_as_one_that_died(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """With status 1 and its state on disk, without a wait for anything else: whatever it is may hang."""
    parts = Parts(monkeypatch, tmp_path)
    monkeypatch.setattr(daemon.Engine, "is_broken", True)

    def leave(status: int) -> None:
        assert parts.ended == ["writer"]
        raise SystemExit(status)

    monkeypatch.setattr(os, "_exit", leave)
    with pytest.raises(SystemExit) as ended:
        daemon.run(parts.settings)
    assert ended.value.code == 1 and "start it anew" in caplog.text


def test_a_lost_thread_is_an_event_of_the_daemons_like_its_end(tmp_path: Path) -> None:
    """With its trace, once, before what clients ask."""
    settings = Settings(
        link=LinkSettings(endpoint=f"tcp/127.0.0.1:{10_000 + os.getpid() % 50_000}"),
        local=LocalSettings(socket=str(tmp_path / "s")),
    )
    take_lost()
    plane = LocalPlane(settings, tmp_path)
    try:
        watched = daemon._Watched(plane, Engine(settings))
        thread = supervised(lambda: 1 / 0, "ta2-api-read")
        thread.start()
        thread.join()
        (lost,) = watched.poll()
        assert isinstance(lost, PartEnded) and "ZeroDivisionError" in lost.trace
        assert lost.message == "the thread ta2-api-read ended unasked: ZeroDivisionError: division by zero"
        assert list(watched.poll()) == []
    finally:
        plane.close()


def test_a_session_that_hangs_after_a_clean_end_is_left_behind(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """All was sent and written: the process ends with status 0 without waiting for zenoh."""
    parts = Parts(monkeypatch, tmp_path, link_closes=False)
    daemon.run(parts.settings)
    assert parts.status == [0]


def test_a_signal_that_the_starter_ignores_stays_ignored(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`nohup ta2 run &`: the end of the terminal must not pause the robot; SIGTERM still ends the daemon."""
    parts = Parts(monkeypatch, tmp_path)
    seen: list[object] = []
    parts.in_loop = lambda: seen.extend(signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGTERM))
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        daemon.run(parts.settings)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    assert seen[0] is signal.SIG_IGN
    assert callable(seen[1])


def test_a_terminal_that_is_gone_is_an_end_and_the_same_signal_else_a_reading(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """SIGHUP with the terminal there, or never there, asks for a reading; without what reads it ends the daemon, as SIGTERM."""
    settings = Settings(
        link=LinkSettings(endpoint=f"tcp/127.0.0.1:{10_000 + os.getpid() % 50_000}"),
        local=LocalSettings(socket=str(tmp_path / "s"), audit_log=str(tmp_path / "audit")),
    )
    slower = replace(settings, chassis=ChassisSettings(v_mps=0.1))
    plane, reloader = LocalPlane(settings, tmp_path), Reloader(settings, lambda: slower, apart_s=0.0)
    try:
        for had, is_there in ((True, True), (False, False), (False, True)):
            monkeypatch.setattr(daemon, "has_terminal", lambda had=had: had)
            watched = daemon._Watched(plane, Engine(settings), None, reloader)
            monkeypatch.setattr(daemon, "has_terminal", lambda is_there=is_there: is_there)
            watched.take_signal(signal.SIGHUP)
            events = list(watched.poll())
            deadline = time.monotonic() + DEADLINE_S
            while not events and time.monotonic() < deadline:
                events += watched.poll()
            assert [type(event) for event in events] == [SettingsRead] and plane.info.chassis_v_mps == 0.1
        watched.take_signal(signal.SIGHUP)
        watched.take_signal(signal.SIGTERM)
        assert [type(event) for event in watched.poll()].count(ExitRequested) == 1
        monkeypatch.setattr(daemon, "has_terminal", lambda: True)
        for kept in (reloader, None):
            watched = daemon._Watched(plane, Engine(settings), None, kept)
            monkeypatch.setattr(daemon, "has_terminal", lambda: False)
            watched.take_signal(signal.SIGHUP)
            assert ExitRequested in {type(event) for event in watched.poll()}
    finally:
        reloader.close()
        plane.close()
