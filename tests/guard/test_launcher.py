"""The daemon's side of its guard: it is started, seen, missed, started again, and ended; with real processes, no robot."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gateway.core.messages.events import GuardSeen, PartEnded
from gateway.core.messages.held import Held, HeldArm
from gateway.guard import launcher as module
from gateway.guard.blackboard import Blackboard
from gateway.guard.launcher import GuardLauncher
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import joint_command
from gateway.settings.settings import GuardSettings, LinkSettings, LocalSettings, RealtimeSettings, Settings
from gateway.values import Side

DEADLINE_S = 30.0


@pytest.fixture
def settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """No robot listens there; nothing is asked of the kernel."""
    monkeypatch.setenv("TA2_STATE_DIR", str(tmp_path / "state"))
    return Settings(
        link=LinkSettings(endpoint="tcp/127.0.0.1:21599"),
        local=LocalSettings(socket=str(tmp_path / "gw.sock")),
        realtime=RealtimeSettings(fifo=False, lock_memory=False),
        guard=GuardSettings(hold_ns=1_000_000_000),
    )


@pytest.fixture
def launcher(settings: Settings) -> Iterator[GuardLauncher]:
    """A started one; its guard has ended in the end."""
    made = GuardLauncher(settings)
    made.start()
    yield made
    made.close(is_clean=True)


def seen(launcher: GuardLauncher, is_so: Callable[[GuardSeen], bool], write: Held | None = None) -> GuardSeen:
    """Poll until the launcher says so."""
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline:
        if write is not None:
            launcher.write(write)
        for event in launcher.poll(time.monotonic_ns()):
            assert isinstance(event, GuardSeen)
            if is_so(event):
                return event
        time.sleep(0.005)
    pytest.fail("not seen in time")


def is_alive(pid: int) -> bool:
    """Whether a process runs."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def wait_until(is_so: Callable[[], Any]) -> None:
    """Poll with a deadline."""
    deadline = time.monotonic() + DEADLINE_S
    while not is_so():
        assert time.monotonic() < deadline, "not within time"
        time.sleep(0.01)


def test_a_guard_is_started_and_another_one_when_it_dies(launcher: GuardLauncher) -> None:
    """The loss is told with the signal; the next guard has another process id, and watches the same page."""
    first = seen(launcher, lambda event: event.pid > 0)
    assert (first.is_linked, first.lost) == (False, "")
    os.kill(first.pid, signal.SIGKILL)
    lost = seen(launcher, lambda event: bool(event.lost))
    assert lost.lost == "signal 9"
    if lost.pid == 0:
        lost = seen(launcher, lambda event: event.pid > 0)
    assert lost.pid != first.pid
    wait_until(lambda: launcher._board.guard().pid == lost.pid)


def test_a_clean_end_ends_the_guard_without_a_word(launcher: GuardLauncher, settings: Settings) -> None:
    """Even with something on the wire in the last tick: the daemon has said that it ends."""
    pid = seen(launcher, lambda event: event.pid > 0).pid
    wait_until(lambda: launcher._board.guard().pid == pid)
    launcher.write(Held(at_ns=time.monotonic_ns(), state="ACTIVE", beat="one", is_owed=True))
    launcher.close(is_clean=True)
    launcher.close(is_clean=True)
    assert not is_alive(pid)
    assert not Path(f"{settings.local.socket}.guard").exists()


def test_a_guard_that_watches_leaves_the_socket_to_the_one_that_acts(settings: Settings) -> None:
    """A daemon that is started again, and ends again, hides no hold: stops and the next daemon still find it."""
    path = f"{settings.local.socket}.guard"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as acting:
        acting.bind(path)
        acting.listen(4)
        launcher = GuardLauncher(settings)
        launcher.start()
        pid = seen(launcher, lambda event: event.pid > 0).pid
        wait_until(lambda: launcher._board.guard().pid == pid)
        launcher.close(is_clean=True)
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as caller:
            caller.connect(path)


def test_only_this_process_keeps_the_pipe_open(launcher: GuardLauncher) -> None:
    """A child of the daemon that inherited it would hide the daemon's end."""
    assert not os.get_inheritable(launcher._life_writer)
    pid = seen(launcher, lambda event: event.pid > 0).pid
    pipe = os.readlink(f"/proc/self/fd/{launcher._life_writer}")
    ways = set()
    for name in os.listdir(f"/proc/{pid}/fd"):
        with contextlib.suppress(OSError):  # a file that it had open while it started
            if os.readlink(f"/proc/{pid}/fd/{name}") == pipe:
                text = Path(f"/proc/{pid}/fdinfo/{name}").read_text()
                flags = next(line for line in text.splitlines() if line.startswith("flags:"))
                ways.add(int(flags.split()[1], 8) & os.O_ACCMODE)
    assert ways == {os.O_RDONLY}


def test_a_daemon_that_fails_leaves_the_guard_to_end_what_was_out(launcher: GuardLauncher) -> None:
    """Without a robot there is nothing to hold: it comes to its end by itself, and in time."""
    pid = seen(launcher, lambda event: event.pid > 0).pid
    wait_until(lambda: launcher._board.guard().pid == pid)
    arm = HeldArm(
        topic=joint_command(Side.LEFT), values=HOME_Q_RAD[Side.LEFT], rate=(0.0,) * 7, acceleration=(0.0,) * 7
    )
    now_ns = time.monotonic_ns()
    launcher.write(
        Held(at_ns=now_ns, state="HOLDING", beat="one", is_owed=True, last_frame_ns=now_ns, arms={Side.LEFT: arm})
    )
    launcher.close(is_clean=False)
    wait_until(lambda: not is_alive(pid))


def test_a_guard_that_cannot_be_started_is_no_reason_to_stop(
    settings: Settings, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It is told and tried again."""
    tries: list[object] = []

    def refuse(*arguments: object, **_: object) -> None:
        tries.append(arguments)
        raise OSError("no more processes")

    monkeypatch.setattr(module.subprocess, "Popen", refuse)
    monkeypatch.setattr(module, "AGAIN_S", 0.01)
    launcher = GuardLauncher(settings)
    launcher.start()
    wait_until(lambda: len(tries) >= 3)
    assert launcher.poll(1) == [GuardSeen(pid=0, zid="", is_linked=False, at_ns=1)]
    assert launcher.poll(2) == []
    assert launcher.poll(1 + module.LOOK_NS) == []
    launcher.close(is_clean=True)
    assert "no more processes" in caplog.text


def test_without_a_pidfd_there_is_a_guard_all_the_same(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It cannot end a frozen daemon, and that is said."""

    def refuse(_: int) -> int:
        raise OSError("not implemented")

    monkeypatch.setattr(os, "pidfd_open", refuse)
    assert module._own_pidfd() == -1
    assert "cannot end a frozen daemon" in caplog.text


def test_a_guard_that_finds_the_api_silent_is_believed_once(launcher: GuardLauncher) -> None:
    """It is a part of the daemon that ended; what a guard of before said counts no more."""
    first = seen(launcher, lambda event: event.pid > 0)
    os.kill(first.pid, signal.SIGSTOP)  # it says nothing itself any more
    board = Blackboard(os.dup(launcher._board.descriptor))
    try:
        for number, (pid, told) in enumerate(((first.pid + 1, 0), (first.pid, 1), (first.pid, 0)), start=1):
            board.say(pid, 1, "", is_linked=False, is_api_silent=True)
            events = launcher.poll(time.monotonic_ns() + number * 1_000_000_000)
            assert [type(event) for event in events].count(PartEnded) == told
    finally:
        board.close()
        os.kill(first.pid, signal.SIGCONT)


def stopped(launcher: GuardLauncher) -> tuple[int, Blackboard]:
    """Stop a guard that has said that it reaches the robot; return its process id and the page that it writes to."""
    pid = seen(launcher, lambda event: event.pid > 0).pid
    wait_until(lambda: launcher._board.guard().pid == pid)
    os.kill(pid, signal.SIGSTOP)
    wait_until(lambda: Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "T")
    board = Blackboard(os.dup(launcher._board.descriptor))
    board.say(pid, time.monotonic_ns(), "ab", is_linked=True)
    return pid, board


def test_a_guard_that_hangs_is_none_and_is_ended(launcher: GuardLauncher) -> None:
    """Its last word stays on the page: nobody would hold the robot, and nobody would know."""
    pid, board = stopped(launcher)
    begin_ns = now_ns = time.monotonic_ns()
    told: list[tuple[int, bool, str]] = []
    while now_ns - begin_ns <= module.KILL_NS + 2 * module.LOOK_NS:
        told += [(now_ns - begin_ns, event.is_linked, event.lost) for event in launcher.poll(now_ns)]
        now_ns += module.LOOK_NS
    board.close()
    (first, was_linked, _), (after_ns, is_linked, _) = told[:2]
    assert (first, was_linked, is_linked) == (0, True, False) and after_ns <= module.HUNG_NS + 2 * module.LOOK_NS
    wait_until(lambda: not is_alive(pid))
    lost = [lost for _, _, lost in told if lost] or [seen(launcher, lambda event: bool(event.lost)).lost]
    assert lost == ["signal 9"]


def test_a_guard_that_hangs_before_its_first_look_is_ended(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has longer than one that has looked: an interpreter starts. What an earlier guard said on the page is not its look."""
    launcher, kills = GuardLauncher(settings), list[int]()
    board = Blackboard(os.dup(launcher._board.descriptor))
    board.say(6, 1, "ab", is_linked=True)
    begin_ns = time.monotonic_ns()
    for pid in (7, 8):
        monkeypatch.setattr(launcher, "_process", SimpleNamespace(pid=pid, kill=partial(kills.append, pid)))
        for now_ns in range(begin_ns, begin_ns + module.START_NS + 2 * module.LOOK_NS, module.LOOK_NS):
            assert not kills or now_ns - begin_ns > module.START_NS
            launcher.poll(now_ns)
        assert kills == [pid]
        kills.clear()
        begin_ns = now_ns + module.LOOK_NS
    monkeypatch.undo()
    board.close()
    launcher.close(is_clean=True)


def test_a_guard_that_hangs_and_cannot_be_ended_stays_none(launcher: GuardLauncher) -> None:
    """Its process waits for a disk that does not answer: it is ended again and again, and is not believed in between."""
    pid, board = stopped(launcher)
    real, kills = launcher._process, []
    launcher._process = SimpleNamespace(pid=pid, kill=lambda: kills.append(pid))  # type: ignore[assignment]  # as much as is used
    begin_ns, told = time.monotonic_ns(), []
    for now_ns in range(begin_ns, begin_ns + 3 * module.KILL_NS, module.LOOK_NS):
        told += [event.is_linked for event in launcher.poll(now_ns)]
    board.close()
    launcher._process = real
    os.kill(pid, signal.SIGCONT)
    assert told == [True, False] and len(kills) == 2


def test_a_guard_is_not_said_to_hang_by_who_was_kept_from_looking_himself(launcher: GuardLauncher) -> None:
    """Both were stopped, or the host was: the guard is given the time to look."""
    pid, board = stopped(launcher)
    now_ns = time.monotonic_ns()
    assert [event.is_linked for event in launcher.poll(now_ns)] == [True]
    for _ in range(5):
        now_ns += 10 * module.KILL_NS
        assert launcher.poll(now_ns) == []
        assert launcher.poll(now_ns + module.LOOK_NS) == []
        now_ns += module.LOOK_NS
    board.close()
    assert is_alive(pid)
    os.kill(pid, signal.SIGCONT)
