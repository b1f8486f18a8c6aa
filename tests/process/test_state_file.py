"""What survives a restart: a crash loses nothing, no epoch comes twice, the unreadable is a latch, nobody waits."""

from __future__ import annotations

import errno
import fcntl
import json
import logging
import os
import signal
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.messages.outputs import Remembered
from gateway.errors import Code, ConfigError, NotReady
from gateway.process import state_file
from gateway.process.state_file import EPOCH_BLOCK, Started, StateFile, StateWriter, path_of
from gateway.process.threads import take_lost
from tests.changed import replace

ENDPOINT = "tcp/192.168.1.20:9000"
LATCHED = Remembered(epoch=7, latches={Code.ESTOP: "by Ann", Code.FSM_ERROR: "état −1"})
DEADLINE_S = 10.0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A state file in a folder that does not exist yet."""
    return path_of(tmp_path / "state" / "ta2", ENDPOINT)


@pytest.fixture
def file(path: Path) -> Iterator[StateFile]:
    """The same, open."""
    with StateFile(path) as opened:
        yield opened


def _until(fact: Callable[[], bool]) -> None:
    """Poll with a deadline."""
    end = time.monotonic() + DEADLINE_S
    while not fact():
        assert time.monotonic() < end, "it never came true"
        time.sleep(0.001)


# ------------------------------------------------------------------------------------------------------------- the name


def test_a_robot_has_a_readable_file_of_its_own(tmp_path: Path) -> None:
    """By endpoint and namespace; letters that a file system dislikes are replaced, and yet no two share a file."""
    endpoints = ["tcp/a:9000", "tcp/a_9000", "tcp/a:9001", "udp/a:9000", "tcp/[::1]:9000", "tcp/ä:9000"]
    paths = {path_of(tmp_path, endpoint, name) for endpoint in endpoints for name in ("", "bot1", "bot2")}
    assert len(paths) == 3 * len(endpoints)
    assert path_of(tmp_path, ENDPOINT).name.startswith("tcp_192.168.1.20_9000-")
    assert all(p.parent == tmp_path and p.suffix == ".json" for p in paths)


def test_the_same_robot_has_the_same_file_however_its_namespace_is_spelt(tmp_path: Path) -> None:
    """`/bot1` and `bot1` are one namespace."""
    assert path_of(tmp_path, ENDPOINT, "/bot1") == path_of(tmp_path, ENDPOINT, "bot1")
    assert path_of(tmp_path, ENDPOINT, "") == path_of(tmp_path, ENDPOINT)


def test_a_long_endpoint_still_has_a_file(file: StateFile, tmp_path: Path) -> None:
    """File systems take 255 bytes for a name."""
    assert len(path_of(tmp_path, "tcp/" + "ä" * 300 + ":9000").name.encode()) < 200


# ------------------------------------------------------------------------------------------------ start and start again


def test_the_first_start_is_fresh_and_reserves_a_block(file: StateFile, path: Path) -> None:
    """Nothing is remembered, and the file already names the end of the first block of epochs."""
    assert file.start() == Started(remembered=Remembered(), reserved_epoch=EPOCH_BLOCK)
    assert json.loads(path.read_text()) == {
        "version": 1,
        "epoch": EPOCH_BLOCK,
        "latches": {},
        "zids": [],
        "routers": [],
    }


def test_file_and_folder_are_for_this_user_only(file: StateFile, path: Path) -> None:
    """0600 and 0700, also for a file that an older attempt left with other rights."""
    path.with_suffix(".new").write_text("left over")
    path.with_suffix(".new").chmod(0o644)
    file.start()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.with_suffix(".lock").stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


def test_no_epoch_of_one_run_is_given_in_the_next(path: Path) -> None:
    """Whatever a run gave of its block without telling the disk, the next one starts behind it."""
    for start in (0, 10, 20):
        with StateFile(path) as file:
            started = file.start(block=10)
        assert started == Started(remembered=Remembered(epoch=start), reserved_epoch=start + 10)


def test_latches_survive_a_restart(path: Path) -> None:
    """Only `recover` clears a latch, a restart does not."""
    with StateFile(path) as file:
        file.start()
        file.save(LATCHED)
    with StateFile(path) as file:
        started = file.start(block=10)
        assert started == Started(remembered=LATCHED, reserved_epoch=17)
    with StateFile(path) as file:
        assert file.start().remembered.latches == LATCHED.latches


CODES = st.sampled_from(Code)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)


@given(st.integers(0, 2**52), st.dictionaries(CODES, TEXTS, max_size=5))
def test_what_is_saved_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, epoch: int, latches: dict[Code, str]
) -> None:
    """Any epoch, any latches, any message."""
    path = tmp_path_factory.getbasetemp() / "same" / "robot.json"
    with StateFile(path) as file:
        file.save(Remembered(epoch=epoch, latches=latches))
        assert file.start().remembered == Remembered(epoch=epoch, latches=latches)


# ------------------------------------------------------------------------------------------------------------ fail safe

GOOD = {"version": 1, "epoch": 5, "latches": {}}
BROKEN = {
    "empty": b"",
    "half": b'{"version": 1, "epo',
    "no text": b"\xff\xfe\x00",
    "zeros": b"\x00" * 40,
    "no table": b"[]",
    "nested": b"[" * 100_000,
    "no version": json.dumps({k: v for k, v in GOOD.items() if k != "version"}).encode(),
    "later version": json.dumps({**GOOD, "version": 2}).encode(),
    "no epoch": json.dumps({k: v for k, v in GOOD.items() if k != "epoch"}).encode(),
    "negative epoch": json.dumps({**GOOD, "epoch": -1}).encode(),
    "epoch is a switch": json.dumps({**GOOD, "epoch": True}).encode(),
    "epoch is a fraction": json.dumps({**GOOD, "epoch": 1.5}).encode(),
    "epoch is endless": b'{"version": 1, "latches": {}, "epoch": ' + b"9" * 5000 + b"}",
    "epoch beyond exact": json.dumps({**GOOD, "epoch": 2**53}).encode(),
    "no latches": json.dumps({k: v for k, v in GOOD.items() if k != "latches"}).encode(),
    "latches are a list": json.dumps({**GOOD, "latches": ["ESTOP"]}).encode(),
    "zids are a text": json.dumps({**GOOD, "zids": "ab"}).encode(),
    "a zid is a number": json.dumps({**GOOD, "zids": [1]}).encode(),
    "message is a number": json.dumps({**GOOD, "latches": {"ESTOP": 1}}).encode(),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_file_that_cannot_be_understood_starts_latched_and_is_kept(name: str, path: Path) -> None:
    """Nobody knows what was latched, so it is latched; the file is there for whoever looks into it."""
    path.parent.mkdir(parents=True)
    path.write_bytes(BROKEN[name])
    with StateFile(path) as file:
        started = file.start()
    assert set(started.remembered.latches) == {Code.STATE_LOST}
    aside = path.with_suffix(".corrupt-1")
    assert aside.read_bytes() == BROKEN[name]
    assert str(aside) in started.report == started.remembered.latches[Code.STATE_LOST]
    assert len(started.report) < 600


def test_an_unreadable_file_is_kept_without_hard_links_too(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a file system that has none it is copied."""

    def refused(*_: object) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    path.parent.mkdir(parents=True)
    path.write_bytes(b"{")
    monkeypatch.setattr(state_file.os, "link", refused)
    with StateFile(path) as file:
        assert Code.STATE_LOST in file.start().remembered.latches
    assert path.with_suffix(".corrupt-1").read_bytes() == b"{"
    assert json.loads(path.read_text())["latches"]


@pytest.mark.parametrize("call", ["write", "replace"])
def test_a_start_that_fails_behind_an_unreadable_file_leaves_it_in_place(
    path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """Disk full, or a power cut, between finding the file unreadable and the new one: the next start is latched still."""
    path.parent.mkdir(parents=True)
    path.write_bytes(b"\x00" * 40)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as broken:
        if call == "write":
            broken.setattr(state_file.os, "fsync", full)
        else:
            broken.setattr(state_file.os, "replace", lambda *names: full() if names[1] == path else os.rename(*names))
        with StateFile(path) as file, pytest.raises(ConfigError):
            file.start()
    with StateFile(path) as file:
        started = file.start()
    assert Code.STATE_LOST in started.remembered.latches
    assert started.remembered.epoch >= 2**32
    assert len(list(path.parent.glob("*.corrupt-*"))) == 1, "one file, kept once"


def test_behind_a_lost_file_epochs_go_on_where_none_was(path: Path) -> None:
    """The old count is lost, so the new one starts at a random height far above any count, and another each time."""
    path.parent.mkdir(parents=True)
    epochs = set()
    for _ in range(5):
        path.write_bytes(b"?")
        with StateFile(path) as file:
            epochs.add(file.start().remembered.epoch)
    assert len(epochs) == 5
    assert all(2**32 <= epoch < 2**48 for epoch in epochs)
    assert len(list(path.parent.glob("*.corrupt-*"))) == 5


def test_the_latch_of_a_lost_file_survives_the_next_restart(path: Path) -> None:
    """It is a latch like any other: only `recover` clears it."""
    path.parent.mkdir(parents=True)
    path.write_bytes(b"?")
    with StateFile(path) as file:
        first = file.start()
    with StateFile(path) as file:
        second = file.start()
    assert second.remembered.latches == first.remembered.latches
    assert second.remembered.epoch == first.reserved_epoch
    assert second.report == ""


def test_a_latch_of_another_release_is_a_latch(path: Path) -> None:
    """A downgrade must not clear what it does not know; what it knows keeps its code."""
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps({**GOOD, "latches": {"ESTOP": "by Ann", "MELTDOWN": "hot"}}))
    with StateFile(path) as file:
        latches = file.start().remembered.latches
    assert latches[Code.ESTOP] == "by Ann"
    assert "MELTDOWN: hot" in latches[Code.STATE_LOST]


@pytest.mark.parametrize("call", ["open", "fdopen", "fsync", "replace"])
def test_a_write_that_fails_leaves_the_old_state(
    call: str, file: StateFile, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Full disk, lost disk, at any step: what was there is still there and whole."""
    file.start()
    file.save(LATCHED)
    before = path.read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, call, full)
        with pytest.raises(OSError, match="No space"):
            file.save(Remembered(epoch=99))
    assert path.read_bytes() == before
    file.save(Remembered(epoch=99))
    assert json.loads(path.read_text())["epoch"] == 99


def test_a_state_is_on_disk_before_it_replaces_the_old_one(
    file: StateFile, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Contents first, then the name, then the folder: a power cut at any instant leaves one whole file."""
    steps: list[str] = []
    fsync, rename = os.fsync, os.replace

    def note_fsync(descriptor: int) -> None:
        is_folder = stat.S_ISDIR(os.fstat(descriptor).st_mode)
        steps.append("folder" if is_folder else f"contents {os.fstat(descriptor).st_size > 0}")
        fsync(descriptor)

    def note_replace(old: Path, new: Path) -> None:
        steps.append(f"name {Path(new) == path}")
        rename(old, new)

    monkeypatch.setattr(os, "fsync", note_fsync)
    monkeypatch.setattr(os, "replace", note_replace)
    file.save(LATCHED)
    assert steps == ["contents True", "name True", "folder"]


@pytest.mark.parametrize("obstacle", ["folder is a file", "file is a folder", "lock is a folder"])
def test_a_place_that_cannot_be_used_refuses_the_start(obstacle: str, path: Path) -> None:
    """A latch that would not survive is no latch; the remedy is named."""
    if obstacle == "folder is a file":
        path.parent.parent.mkdir(parents=True)
        path.parent.write_text("in the way")
    else:
        (path if obstacle == "file is a folder" else path.with_suffix(".lock")).mkdir(parents=True)
    file = StateFile(path)
    with pytest.raises(ConfigError) as refused:
        file.open()
        file.start()
    file.close()
    assert refused.value.code is Code.BAD_CONFIG
    assert str(path) in refused.value.message
    assert "TA2_STATE_DIR" in refused.value.hint


def test_a_disk_that_is_full_at_the_start_refuses_it(file: StateFile, monkeypatch: pytest.MonkeyPatch) -> None:
    """The block of epochs must be on disk before the first grant."""

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigError, match="No space left"):
        file.start()


# ----------------------------------------------------------------------------------------------------- one daemon only


def test_a_second_daemon_for_the_same_robot_is_refused_with_the_pid_of_the_first(file: StateFile, path: Path) -> None:
    """Two daemons with one file would give the same epochs."""
    with pytest.raises(NotReady) as refused:
        StateFile(path).open()
    assert refused.value.code is Code.OTHER_GATEWAY
    assert f"pid {os.getpid()}" in refused.value.message
    assert refused.value.hint
    other = path_of(path.parent, "tcp/192.168.1.21:9000")
    with StateFile(other):
        assert other.with_suffix(".lock").exists()


def test_the_file_is_free_when_its_daemon_has_closed_it(path: Path) -> None:
    """In order, and closing twice does no harm."""
    first = StateFile(path)
    first.open()
    first.close()
    first.close()
    with StateFile(path) as second:
        assert second.start().remembered == Remembered()


def test_the_file_is_free_when_its_daemon_was_killed(path: Path) -> None:
    """The lock is the kernel's: no stale lock file keeps a robot from starting."""
    hold = "import sys; from pathlib import Path; from gateway.process.state_file import StateFile as F; "
    hold += "F(Path(sys.argv[1])).open(); print('locked', flush=True); sys.stdin.read()"
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", hold, str(path)], stdin=pipe, stdout=pipe, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "locked\n"
            with pytest.raises(NotReady, match=f"pid {process.pid}"):
                StateFile(path).open()
        finally:
            process.send_signal(signal.SIGKILL)
    with StateFile(path) as file:
        assert file.start().remembered == Remembered()


def test_a_file_system_without_locks_refuses_the_start(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Better no daemon than two."""

    def no_locks(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", no_locks)
    with pytest.raises(ConfigError, match="No locks available"):
        StateFile(path).open()


# ----------------------------------------------------------------------------------------------------------- the writer


ALWAYS = 10**9


class Disk(StateFile):
    """A file whose disk obeys the test: it can hang, its first `fails` writes fail, and it tells what was written."""

    def __init__(self) -> None:
        super().__init__(Path("/nowhere/robot.json"))
        self.saved: list[Remembered] = []
        self.attempts = 0
        self.failures = 0
        self.fails = 0
        self.free = threading.Event()
        self.free.set()

    def save(self, remembered: Remembered) -> None:
        """Wait until the disk is free, then take it or fail."""
        self.attempts += 1
        assert self.free.wait(DEADLINE_S)
        if self.failures < self.fails:
            self.failures += 1
            raise OSError(errno.EIO, "Input/output error")
        self.saved.append(remembered)


STARTED = Started(remembered=Remembered(), reserved_epoch=EPOCH_BLOCK)


def _latched(n: int) -> Remembered:
    return Remembered(epoch=1, latches={Code.ESTOP: f"number {n}"})


def test_writing_never_waits_for_the_disk_and_the_latest_state_wins() -> None:
    """While the disk hangs, a hundred states pass; then only the first, which was under way, and the last are saved."""
    disk = Disk()
    disk.free.clear()
    writer = StateWriter(disk, STARTED)
    writer.write(_latched(0))
    _until(lambda: disk.attempts == 1)
    for n in range(1, 100):
        writer.write(_latched(n))
    assert disk.saved == []
    disk.free.set()
    assert writer.close(DEADLINE_S)
    assert disk.saved == [replace(_latched(n), epoch=EPOCH_BLOCK) for n in (0, 99)]


def test_closing_writes_what_still_waits() -> None:
    """The last state before the exit is on disk, or `close` says that it is not."""
    disk = Disk()
    writer = StateWriter(disk, STARTED)
    writer.write(_latched(1))
    assert writer.close(DEADLINE_S)
    assert disk.saved == [replace(_latched(1), epoch=EPOCH_BLOCK)]


def test_closing_an_idle_writer_writes_nothing() -> None:
    """There is nothing to write, and the thread ends."""
    disk = Disk()
    before = threading.active_count()
    writer = StateWriter(disk, STARTED)
    assert threading.active_count() == before + 1
    assert writer.close(DEADLINE_S)
    assert threading.active_count() == before
    assert disk.attempts == 0


def test_closing_does_not_wait_longer_than_it_was_told() -> None:
    """A disk that hangs must not keep the daemon from ending (SIGTERM: < 5 s)."""
    disk = Disk()
    disk.free.clear()
    writer = StateWriter(disk, STARTED)
    writer.write(_latched(1))
    assert not writer.close(0.05)
    disk.free.set()
    _until(lambda: len(disk.saved) == 1)


def test_closing_says_when_the_disk_refused_the_last_state() -> None:
    """The caller learns that the last state is not on disk, at once and not after a retry."""
    disk = Disk()
    disk.fails = ALWAYS
    writer = StateWriter(disk, STARTED)
    writer.write(_latched(1))
    _until(lambda: disk.failures == 1)
    assert not writer.close(DEADLINE_S)
    assert disk.saved == []


def test_a_failing_disk_is_tried_again_and_told_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line when it begins, one when it is over, and the state is not forgotten in between."""
    monkeypatch.setattr(state_file, "RETRY_S", 0.001)
    disk = Disk()
    disk.fails = ALWAYS
    writer = StateWriter(disk, STARTED)
    with caplog.at_level(logging.INFO, logger="gateway.process.state_file"):
        writer.write(_latched(1))
        _until(lambda: disk.attempts >= 3)
        disk.fails = 0
        _until(lambda: len(disk.saved) == 1)
        assert writer.close(DEADLINE_S)
    assert disk.saved == [replace(_latched(1), epoch=EPOCH_BLOCK)]
    assert [record.levelname for record in caplog.records] == ["ERROR", "WARNING"]
    assert "Input/output error" in caplog.records[0].getMessage()


def test_a_panic_in_the_writers_thread_keeps_no_later_state_from_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """The latch that tells of it is one."""
    disk = Disk()
    save, panics = disk.save, [SystemExit("as a panic, none of the errors that a disk has")]

    def panic_once(remembered: Remembered) -> None:
        if panics:
            raise panics.pop()
        save(remembered)

    monkeypatch.setattr(disk, "save", panic_once)
    take_lost()
    writer = StateWriter(disk, STARTED)
    writer.write(_latched(1))
    _until(lambda: not panics)
    writer.write(_latched(2))
    assert writer.close(DEADLINE_S)
    assert disk.saved == [replace(_latched(2), epoch=EPOCH_BLOCK)]
    assert [lost.name for lost in take_lost()] == ["state-file"]


def test_a_new_state_does_not_wait_for_the_retry_of_an_old_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """However long the pause after a failure, a newer state is tried at once."""
    monkeypatch.setattr(state_file, "RETRY_S", 10 * DEADLINE_S)
    disk = Disk()
    disk.fails = ALWAYS
    writer = StateWriter(disk, STARTED)
    writer.write(_latched(1))
    _until(lambda: disk.failures == 1)
    disk.free.clear()
    writer.write(_latched(2))
    _until(lambda: disk.attempts == 2)
    disk.fails = 0
    disk.free.set()
    _until(lambda: len(disk.saved) == 1)
    assert disk.saved[0].latches == _latched(2).latches
    assert writer.close(DEADLINE_S)


def test_a_state_that_came_while_an_older_one_failed_is_tried_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The older one is forgotten, as anywhere, and nobody waits for its retry."""
    monkeypatch.setattr(state_file, "RETRY_S", 10 * DEADLINE_S)
    disk = Disk()
    disk.fails = 1
    disk.free.clear()
    writer = StateWriter(disk, STARTED)
    writer.write(_latched(1))
    _until(lambda: disk.attempts == 1)
    writer.write(_latched(2))
    disk.free.set()
    _until(lambda: len(disk.saved) == 1)
    assert disk.saved[0].latches == _latched(2).latches
    assert writer.close(DEADLINE_S)


@pytest.mark.parametrize("block", [2, 10, EPOCH_BLOCK])
def test_a_grant_inside_the_first_half_of_its_block_touches_no_disk(block: int) -> None:
    """A new epoch is already reserved; only when half of the block is given is the next one reserved."""
    disk = Disk()
    writer = StateWriter(disk, Started(remembered=Remembered(), reserved_epoch=block), block=block)
    for epoch in range(1, block // 2 + 1):
        writer.write(Remembered(epoch=epoch))
    assert writer.close(DEADLINE_S)
    assert disk.saved == []
    writer = StateWriter(disk, Started(remembered=Remembered(), reserved_epoch=block), block=block)
    writer.write(Remembered(epoch=block // 2 + 1))
    assert writer.close(DEADLINE_S)
    assert disk.saved == [Remembered(epoch=block // 2 + 1 + block)]


@given(st.lists(st.integers(0, 3), max_size=60))
def test_the_file_always_reserves_more_than_was_given(steps: list[int]) -> None:
    """Whenever the daemon dies, the next one starts behind every epoch of this one."""
    disk = Disk()
    block = 10
    writer = StateWriter(disk, Started(remembered=Remembered(), reserved_epoch=block), block=block)
    epoch = 0
    for step in steps:
        epoch += step
        writer.write(Remembered(epoch=epoch))
    assert writer.close(DEADLINE_S)
    on_disk = disk.saved[-1].epoch if disk.saved else block
    assert on_disk >= epoch + block // 2


def test_a_state_that_is_already_on_disk_is_not_written_again() -> None:
    """Latches that came and went between two writes cost nothing."""
    disk = Disk()
    writer = StateWriter(disk, STARTED)
    writer.write(_latched(1))
    _until(lambda: len(disk.saved) == 1)
    writer.write(_latched(1))
    assert writer.close(DEADLINE_S)
    assert len(disk.saved) == 1


def test_clearing_a_latch_is_written_as_setting_it_is(path: Path) -> None:
    """With a real file: what `recover` cleared stays cleared after a restart."""
    with StateFile(path) as file:
        writer = StateWriter(file, file.start())
        writer.write(LATCHED)
        writer.write(Remembered(epoch=7))
        assert writer.close(DEADLINE_S)
    with StateFile(path) as file:
        assert file.start().remembered == Remembered(epoch=EPOCH_BLOCK)


def test_sessions_of_ours_survive_a_restart_and_an_earlier_release_left_none(path: Path) -> None:
    """Their tokens and late data are not foreign to the next run."""
    with StateFile(path) as file:
        file.save(Remembered(epoch=3, zids=("a1", "b2")))
        assert file.start().remembered.zids == ("a1", "b2")
    path.write_text(json.dumps(GOOD))
    with StateFile(path) as file:
        assert file.start().remembered == Remembered(epoch=5)
