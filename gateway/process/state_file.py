"""What survives a restart of the daemon: lease epochs that were given, latches, and sessions of ours. One JSON per robot.

Rules it obeys
    * The file is replaced as a whole (write, fsync, rename, fsync of the folder), mode 0600: a power cut leaves the
      old one or the new one.
    * Fail safe: a file that cannot be understood is kept aside and stands for a latch, STATE_LOST, that a person
      clears with `recover` like any other; a latch that this release does not know becomes the same. A folder that
      cannot be written refuses the start: a latch that would not survive is no latch.
    * An epoch is never given twice. Epochs are reserved in blocks: the file names the end of a block before the first
      epoch of it is given, so a grant waits for no disk. What a restart leaves of a block is lost. Behind a file that
      was lost the count goes on at a random height, since nobody knows how far it had come.
    * The control loop never waits for the disk: `StateWriter` has a thread of its own, and the latest state wins. A
      latch is on disk some milliseconds after it was set.
    * One daemon per robot: the file is locked while a daemon has it. The lock is the kernel's and dies with its
      process; a process forked from the daemon without exec would share it.

A robot is known by its endpoint in one spelling, and by the routers at which it was found: `recall.py`.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import logging
import os
import re
import secrets
import threading
from collections.abc import Callable, Set
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from gateway.core.messages.outputs import Remembered
from gateway.errors import CODES, Code, ConfigError, NotReady, Refusal
from gateway.process.threads import supervised
from gateway.robot.endpoint import robot_name

__all__ = ["EPOCH_BLOCK", "Started", "StateFile", "StateWriter", "path_of", "read_state"]

_log = logging.getLogger(__name__)

EPOCH_BLOCK = 1000
"""Epochs reserved at once; the next block is reserved when half of this one is given."""

VERSION = 1
LOST_EPOCH_LOW = 2**32
LOST_EPOCH_HIGH = 2**48
"""Behind a lost file the epoch goes on at a random height in between: far above any count, exact in JSON."""
RETRY_S = 1.0
"""How long the writer waits after the disk refused [s]."""


def path_of(folder: Path, endpoint: str, namespace: str = "") -> Path:
    """Return the state file of a robot: readable, and unlike that of any other endpoint.

    Two robots may stand behind one router: the namespace tells them apart.
    """
    name = robot_name(endpoint, namespace)
    digest = hashlib.sha256(name.encode()).hexdigest()[:8]
    return folder / f"{re.sub(r'[^A-Za-z0-9.]+', '_', name)[:80]}-{digest}.json"


def read_state(path: Path) -> Remembered:
    """Return what a state file says.

    Raises:
        OSError: It cannot be read.
        ValueError: It is not what `StateFile.save` writes.
    """
    return _parse(path.read_bytes())


class Started(Struct, frozen=True, kw_only=True):
    """What a daemon starts from.

    Attributes:
        remembered: For the engine: it may give epochs from `remembered.epoch + 1` on.
        reserved_epoch: Epoch up to which the file already reserves.
        report: One line for the log when something was wrong with the file; empty else.
    """

    remembered: Remembered
    reserved_epoch: int
    report: str = ""


class StateFile:
    """The file of one robot, locked for one daemon from `open` to `close`.

    Args:
        path: See `path_of`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock: int | None = None

    def __enter__(self) -> StateFile:
        """Open and lock it."""
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        """Let others have it."""
        self.close()

    def open(self) -> None:
        """Make the folder and lock the file.

        Raises:
            NotReady: OTHER_GATEWAY: a daemon for this robot runs on this host.
            ConfigError: The folder cannot be written.
        """
        lock_path = self.path.with_suffix(".lock")
        try:
            self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            descriptor = os.open(lock_path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise self._unwritable(error) from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        except BlockingIOError:
            owner = os.pread(descriptor, 32, 0).decode(errors="replace").strip() or "unknown"
            os.close(descriptor)
            message = f"a daemon for this robot runs on this host (pid {owner}, {self.path})"
            refusal = Refusal(code=Code.OTHER_GATEWAY, message=message, hint=CODES[Code.OTHER_GATEWAY].hint)
            raise NotReady(refusal) from None
        except OSError as error:
            os.close(descriptor)
            raise self._unwritable(error) from error
        self._lock = descriptor

    def close(self) -> None:
        """Let others have the file. The lock file stays: taking it away would race with the next daemon."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def start(self, block: int = EPOCH_BLOCK, least_epoch: int = 0) -> Started:
        """Read the file and reserve epochs, so that the first grants need no disk.

        Args:
            block: How many epochs to reserve.
            least_epoch: Nor was any up to this one to be given again.

        Returns:
            What the engine starts from, for `StateWriter` too.

        Raises:
            ConfigError: The file cannot be read or written.
        """
        try:
            remembered, report = self._read()
            remembered = replace(remembered, epoch=max(remembered.epoch, least_epoch))
            reserved = remembered.epoch + block
            self.save(replace(remembered, epoch=reserved))
        except OSError as error:
            raise self._unwritable(error) from error
        return Started(remembered=remembered, reserved_epoch=reserved, report=report)

    def save(self, remembered: Remembered) -> None:
        """Replace the file; on return it is on disk.

        Raises:
            OSError: The disk refused; the old file is still there.
        """
        latches = {code.value: message for code, message in remembered.latches.items()}
        document = {"version": VERSION, "epoch": remembered.epoch, "latches": latches}
        document |= {"zids": list(remembered.zids), "routers": list(remembered.routers)}
        fresh = self.path.with_suffix(".new")
        descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            os.fchmod(descriptor, 0o600)  # also when an earlier attempt left it otherwise
            json.dump(document, file, indent=1)
            file.write("\n")
            file.flush()
            os.fsync(file.fileno())
        os.replace(fresh, self.path)
        folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def _read(self) -> tuple[Remembered, str]:
        """Return what the file says, and what was wrong with it."""
        try:
            raw = self.path.read_bytes()
        except FileNotFoundError:
            return Remembered(), ""
        try:
            return _parse(raw), ""
        except (ValueError, RecursionError) as error:
            return self._lost(error)

    def _lost(self, error: Exception) -> tuple[Remembered, str]:
        """Keep a file that cannot be understood under another name, and start latched.

        It stays in its own place too until `start` has replaced it: were it moved away, a start that fails behind this
        (disk full, power cut) would let the next one find no file, and no latch.
        """
        names = (self.path.with_suffix(f".corrupt-{n}") for n in range(1, 1_000_000))
        aside = next(name for name in names if not name.exists() or name.samefile(self.path))
        if not aside.exists():
            try:
                os.link(self.path, aside)
            except OSError:  # a file system without hard links
                aside.write_bytes(self.path.read_bytes())
        message = f"the state file was unreadable ({error}) and is kept as {aside}: earlier latches are unknown"
        epoch = LOST_EPOCH_LOW + secrets.randbelow(LOST_EPOCH_HIGH - LOST_EPOCH_LOW)
        return Remembered(epoch=epoch, latches={Code.STATE_LOST: message}), message

    def _unwritable(self, error: OSError) -> ConfigError:
        reason = error.strerror or str(error)
        refusal = Refusal(
            code=Code.BAD_CONFIG,
            message=f"the state file {self.path} cannot be kept: {reason}",
            field="TA2_STATE_DIR",
            value=str(self.path.parent),
            hint="set TA2_STATE_DIR to a folder that this user may write",
        )
        return ConfigError(refusal)


def _parse(raw: bytes) -> Remembered:
    """Return what a file says.

    Raises:
        ValueError: It is not what `save` writes.
    """
    document = json.loads(raw)
    if not isinstance(document, dict) or document.get("version") != VERSION:
        raise ValueError(f"not a state file of version {VERSION}")
    epoch, latches = document.get("epoch"), document.get("latches")
    if type(epoch) is not int or not 0 <= epoch < 2**53:
        raise ValueError("its epoch is no count")
    if not isinstance(latches, dict) or not all(isinstance(message, str) for message in latches.values()):
        raise ValueError("its latches are no texts by code")
    lists = {name: document.get(name, []) for name in ("zids", "routers")}  # a file of an earlier release has none
    for name, texts in lists.items():
        if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
            raise ValueError(f"its {name} are no texts")
    known: dict[Code, str] = {}
    for name, message in latches.items():
        if name in Code.__members__:
            known[Code(name)] = message
        else:
            known[Code.STATE_LOST] = f"a latch of another release: {name}: {message}"
    return Remembered(epoch=epoch, latches=known, zids=tuple(lists["zids"]), routers=tuple(lists["routers"]))


class StateWriter:
    """Writes what must be remembered from a thread of its own. The latest state wins; `write` never waits for the disk.

    When the disk refuses, it is tried again every second and at every new state; the log has one line for the first
    refusal and one for the recovery.

    Args:
        file: Open.
        started: As `file.start` returned it.
        block: How many epochs to reserve at once.
        on_saved: Called in the thread with each state that is on disk, and the causes in those that were forgotten in line
            before it; may wait for the disk, too.
    """

    def __init__(
        self,
        file: StateFile,
        started: Started,
        block: int = EPOCH_BLOCK,
        on_saved: Callable[[Remembered, Set[Code]], None] | None = None,
    ) -> None:
        self._on_saved = on_saved
        self._file = file
        self._block = block
        self._written = replace(started.remembered, epoch=started.reserved_epoch)
        self._wanted: Remembered | None = None
        self._forgotten: frozenset[Code] = frozenset()
        self._closing = False
        self._failing = False
        self._change = threading.Condition()
        self._thread = supervised(self._run, "state-file", may_return=lambda: self._closing, again=True)
        self._thread.start()

    def write(self, remembered: Remembered) -> None:
        """Put a state in line; an older one that still waits is forgotten."""
        with self._change:
            if self._wanted is not None:
                self._forgotten |= self._wanted.latches.keys()
            self._wanted = remembered
            self._change.notify()

    def close(self, timeout_s: float) -> bool:
        """Write what still waits and end the thread; return whether the last state is on disk."""
        with self._change:
            self._closing = True
            self._change.notify()
        self._thread.join(timeout_s)
        with self._change:
            return self._wanted is None and not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._wanted is not None or self._closing)
                wanted, self._wanted = self._wanted, None
                forgotten, self._forgotten = self._forgotten, frozenset()
            if wanted is None:
                return
            if self._save(wanted, forgotten):
                continue
            with self._change:
                self._forgotten |= forgotten
                if self._wanted is not None:
                    self._forgotten |= wanted.latches.keys()
                    continue  # a newer state came meanwhile
                self._wanted = wanted
                if self._closing:
                    return
                self._change.wait(RETRY_S)

    def _save(self, wanted: Remembered, forgotten: Set[Code]) -> bool:
        """Write a state with its reserved epochs, if the file says something else; return whether it says so now."""
        reserved = self._written.epoch
        if reserved - wanted.epoch < self._block // 2:
            reserved = wanted.epoch + self._block
        document = replace(wanted, epoch=reserved)
        try:
            if document != self._written:
                self._file.save(document)
            elif not forgotten:
                return True
        except OSError as error:
            if not self._failing:
                _log.error("the state file %s cannot be written: %s; trying again", self._file.path, error)
            self._failing = True
            return False
        if self._failing:
            _log.warning("the state file %s is written again", self._file.path)
        self._failing = False
        self._written = document
        if self._on_saved is not None:
            self._on_saved(wanted, forgotten)
        return True
