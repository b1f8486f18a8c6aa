"""The engine as the control loop sees it, with all that it hears and gives noted for the black box.

Rules
    * The loop notes references in memory and waits for nobody: a thread of its own packs and writes them. When that one
      does not keep up (a disk that hangs), records are left out whole; what follows begins with a new state, after a gap.
    * A piece begins with the engine's state. It is frozen every 15 s at the end of a cycle that was in time, when its frames
      have left; where it cannot be then, some moments later.
    * Whatever fails here ends the recording, for a while or for good, and nothing else. An engine that takes long to freeze
      is frozen once a minute, and its pieces are as long; one that takes two ticks is recorded no more: the loop comes first.
    * Latches, takeovers and aborted motions keep what the ring has, and the next 3 s. What anybody can bring about again and
      again (an aborted motion, another owner) is kept once a minute, and never in place of a latch.
"""

from __future__ import annotations

import hashlib
import io
import logging
import pickle
import platform
import threading
import time
from collections import deque
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from gateway import __version__
from gateway.core.engine import Engine, Output
from gateway.core.messages.events import Event
from gateway.core.messages.outputs import Level, Notice
from gateway.core.streams.gate import Cleared
from gateway.errors import Code
from gateway.incident.event_log import EventLog
from gateway.incident.freezing import Frozen, Unfrozen, freeze, packed
from gateway.incident.records import HEADER_VERSION, Heard, Latched, Start, Tick
from gateway.incident.ring import Ring
from gateway.process.threads import supervised

__all__ = ["Recorder", "release"]

_log = logging.getLogger(__name__)

MS = 1_000_000
S = 1_000_000_000

PIECE_NS = 15 * S
AGAIN_NS = 200 * MS
"""How long after an engine that could not be frozen the next try is [ns]."""
RETRY_NS = 5 * S
"""How long after the disk refused [ns]."""
MOST_FREEZE_NS = 5 * MS
"""What costs the loop more twice in a row is not done again for `SELDOM_NS` [ns]; of its own time, not what others take."""
WORST_FREEZE_NS = 20 * MS
"""What costs the loop more, likewise, is never done again [ns]."""
SELDOM_NS = 60 * S
LATE_NS = 2 * MS
"""After a tick that was later than this the next one must not wait for us [ns]."""
AFTER_NS = 3 * S
MOST_WAITING = 1000
"""Ticks that may wait to be written: 10 s at full rate."""
WRITTEN_S = 0.25
MOST_CAUSES, MOST_MINOR = 100, 50
"""Causes of one incident, and those before it that are not grave."""
MINOR_NS = 60 * S
"""How far apart incidents without anything grave are kept [ns]."""


ROOMS = ("core", "kinematics", "messages", "robot", "settings")
"""Whose code decides what the engine does."""


class _Begin(NamedTuple):
    frozen: Frozen
    now_ns: int
    is_gap: bool


def release() -> dict[str, str]:
    """Return what must be the same for a replay to be the same, bit by bit: our own code, and what it calculates with."""
    root = Path(__file__).parents[1]
    code = hashlib.sha256()
    for path in sorted(path for room in ROOMS for path in (root / room).rglob("*.py")):
        code.update(path.read_bytes())
    found = {"ta2": __version__, "code": code.hexdigest()[:16], "machine": platform.machine()}
    found["python"] = platform.python_version()
    for name in ("ruckig", "numpy", "msgspec", "pin"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = ""
    return found


class Recorder:
    """Stands between the loop and its engine.

    Args:
        engine: What is recorded.
        folder: Of one robot, see `ring.py`.
        robot: Its name, for people.
    """

    def __init__(self, engine: Engine, folder: Path, robot: str = "") -> None:
        self._engine = engine
        self._robot = robot
        self._heard: list[Heard] = []
        self._begun: tuple[int, int, bool] | None = None
        """Of a tick that has not come back: its time and lateness [ns], and whether anybody watched."""
        self._waiting: deque[Tick | _Begin] = deque()
        self._is_on = False
        self._is_gap = False
        self._late_ns = 0
        self._due_ns = self._pause_ns = 0
        self._is_begin_wanted = True
        self.left_out = 0
        """Ticks that were not recorded because too many waited."""
        self._is_slow = self._is_seldom = False
        self._ring, self._events = Ring(folder), EventLog(folder)
        self._causes: list[tuple[str, str, int]] = []
        self._is_grave = False
        self._minor_ns: int | None = None
        self._is_known = False
        self._is_failing = False
        self._release: dict[str, str] = {}
        self._closing = threading.Event()
        self._is_clean = False
        self._thread = supervised(self._run, "black-box", on_lost=lambda lost: self._lost())

    def start(self) -> None:
        """Begin."""
        self._is_on = True
        self._thread.start()

    def close(self, timeout_s: float, *, is_clean: bool) -> bool:
        """Write what waits and end; return whether all is written.

        Args:
            timeout_s: How long to wait for the disk [s].
            is_clean: Whether the process ends as it was asked to: what is left of one that does not is kept by the next.
        """
        self._is_on, self._is_clean = False, is_clean
        self._closing.set()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _lost(self) -> None:
        self._off()
        self._waiting.clear()

    def _off(self) -> None:
        self._is_on = False  # what waits is the writer's
        _log.error("the black box has ended: what happens from now on is not recorded")

    # ------------------------------------------------------------------------------------------------ the loop's engine

    def receive(self, event: Event, now_ns: int) -> None:
        """Hand an event on."""
        if self._is_on:
            self._heard.append(event)
        self._engine.receive(event, now_ns)

    def latch(self, code: Code, message: str, now_ns: int) -> None:
        """Hand a latch on that another process had set."""
        if self._is_on:
            self._heard.append(Latched(code, message, now_ns))
        self._engine.takeover.latch(code, message, now_ns)

    def tick(self, now_ns: int, *, late_ns: int) -> Output:
        """Run one cycle of the engine."""
        engine = self._engine
        is_watched = engine.is_watched
        self._begun = now_ns, late_ns, is_watched
        output = engine.tick(now_ns, late_ns)
        self._begun = None
        if self._is_on:
            heard, self._heard = self._heard, []
            self._late_ns = late_ns
            if len(self._waiting) >= MOST_WAITING:
                self._is_begin_wanted = self._is_gap = True
            if self._is_gap:
                self.left_out += 1
            else:
                self._waiting.append(
                    Tick(
                        now_ns,
                        late_ns,
                        is_watched,
                        tuple(heard),
                        output.frames,
                        engine.state.value,
                        output.notices,
                        output.replies,
                        output.claim,
                    )
                )
        return output

    def next_due_ns(self) -> int | None:
        """Return when the earliest stream wants a tick."""
        return self._engine.next_due_ns()

    @property
    def rest_ns(self) -> int:
        """How far apart ticks may be [ns]."""
        return self._engine.rest_ns

    def panic_frames(self, now_ns: int) -> tuple[Cleared, ...]:
        """Return the stop frames of an engine that cannot go on; what it raised at is noted, with them and without a state."""
        frames = self._engine.panic_frames(now_ns)
        with suppress(Exception):  # nobody knows what is broken, and the frames have to leave
            if self._is_on and not self._is_gap and (self._heard or self._begun):
                begun = self._begun or (now_ns, 0, self._engine.is_watched)
                self._waiting.append(Tick(*begun, tuple(self._heard), frames, "", (), (), 0))
        return frames

    def look(self, now_ns: int) -> None:
        """Freeze the engine if it is time to; called at the end of a cycle."""
        is_due = self._is_begin_wanted or now_ns >= self._due_ns
        if not (self._is_on and is_due) or now_ns < self._pause_ns or self._late_ns >= LATE_NS:
            return
        if len(self._waiting) > MOST_WAITING // 2:
            return
        self._pause_ns = now_ns + RETRY_NS
        begun_ns = time.thread_time_ns()
        frozen = None
        try:
            frozen = freeze(self._engine)
        except Unfrozen:
            self._pause_ns = now_ns + AGAIN_NS
        except Exception:  # noqa: BLE001  whatever it was: the robot needs no black box
            _log.exception("the engine cannot be frozen")
            self._off()
            return
        was_slow, took_ns = self._is_slow, time.thread_time_ns() - begun_ns
        self._is_slow = took_ns > MOST_FREEZE_NS
        if was_slow and took_ns > WORST_FREEZE_NS:
            _log.error("freezing the engine holds the control loop up for %.1f ms", took_ns / MS)
            self._off()
            return
        if was_slow and self._is_slow:
            self._pause_ns = now_ns + SELDOM_NS
            if not self._is_seldom:
                _log.warning("freezing the engine takes the control loop %.1f ms: done once a minute", took_ns / MS)
            self._is_seldom = True
        if frozen is None:
            return
        self._waiting.append(_Begin(frozen, now_ns, self._is_gap))
        self._due_ns = now_ns + PIECE_NS
        self._is_begin_wanted = self._is_gap = False

    # ------------------------------------------------------------------------------------------------ the writer

    def _run(self) -> None:
        self._release = release()
        try:
            found = self._ring.open()
            if found is not None:
                _log.warning("the gateway before this one ended without a word: ta2 incident show %s", found.name)
        except OSError as error:
            self._fail(error)
        while not self._closing.wait(WRITTEN_S):
            self._write()
        self._write()
        if self._causes:
            self._keep()
        self._ring.close()
        if self._is_clean:
            self._ring.clear()

    def _write(self) -> None:
        try:
            self._write_waiting()
            self._is_failing = False
        except (OSError, Unfrozen, pickle.PicklingError, TypeError, ValueError) as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self._is_known = False
        self._is_begin_wanted = True
        if not self._is_failing:
            _log.error("the black box cannot be written: %s; trying again", error)
        self._is_failing = True

    def _write_waiting(self) -> None:
        file = io.BytesIO()
        pickler = pickle.Pickler(file, 5)
        lines, newest_ns = b"", 0
        wall_ns = time.time_ns() - time.monotonic_ns()
        try:
            for _ in range(len(self._waiting)):
                record = self._waiting.popleft()
                newest_ns = record.now_ns
                if isinstance(record, _Begin):
                    self._ring.write(file.getvalue())
                    self._ring.begin(self._header(record, wall_ns), record.now_ns)
                    file = io.BytesIO()
                    pickler = pickle.Pickler(file, 5)
                    pickler.dump(Start(*packed(record.frozen)))
                    self._is_known = True
                    continue
                lines += self._events.note(record, wall_ns + record.now_ns)
                for notice in record.notices:
                    if (cause := _cause(notice)) is not None:
                        is_grave = _is_grave(notice)
                        self._is_grave |= is_grave
                        if len(self._causes) < (MOST_CAUSES if is_grave else MOST_MINOR):
                            self._causes.append(cause)
                if self._is_known:
                    pickler.dump(record)
        finally:  # what was told stands nowhere else, whatever became of the ring
            if lines:
                self._events.write(lines)
        if self._is_known:
            self._ring.write(file.getvalue())
            if self._ring.is_full:
                raise OSError(27, "too much happens for one piece")
        if self._causes and (newest_ns >= self._causes[0][2] + AFTER_NS or not (self._is_on or self._waiting)):
            self._keep()

    def _header(self, begin: _Begin, wall_ns: int) -> dict[str, object]:
        return {
            "form": HEADER_VERSION,
            "robot": self._robot,
            "mono_ns": begin.now_ns,
            "wall_ns": wall_ns + begin.now_ns,
            "is_gap": begin.is_gap or not self._is_known,
            "release": self._release,
        }

    def _keep(self) -> None:
        causes, self._causes = self._causes, []
        is_grave, self._is_grave = self._is_grave, False
        if not is_grave:
            if self._minor_ns is not None and causes[0][2] < self._minor_ns + MINOR_NS:
                return
            self._minor_ns = causes[0][2]
        try:
            kept = self._ring.keep(causes, is_grave=is_grave)
        except OSError as error:
            _log.error("an incident (%s) cannot be kept: %s", causes[0][0], error)
        else:
            if kept.exists():
                _log.info("an incident is kept: ta2 incident show %s", kept.name)
            else:
                _log.info("an incident (%s) is not kept: graver ones take the room", causes[0][0])


def _is_grave(notice: Notice) -> bool:
    return notice.code in (Code.LATCH_CHANGED, Code.TAKEN_OVER)


def _cause(notice: Notice) -> tuple[str, str, int] | None:
    """Return what an incident is kept for; None for what is none."""
    is_latch = notice.code is Code.LATCH_CHANGED and notice.level is Level.ERROR
    is_taken = notice.code is Code.LEASE_CHANGED and "epoch" in notice.facts
    is_aborted = notice.code is Code.MOTION_ENDED and notice.facts.get("state") == "aborted"
    if not (is_latch or is_taken or is_aborted or notice.code is Code.TAKEN_OVER):
        return None
    code = notice.facts.get("code") if is_latch or is_aborted else None
    return code or notice.code.value, notice.message, notice.at_ns
