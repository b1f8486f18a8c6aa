"""An incident read again, and the engine run on it in virtual time: it must give the same frames, bit by bit.

An engine is thawed where a piece follows nothing (the first one, one behind a gap) and goes on through those that follow it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from msgspec import Struct

from gateway.core.engine import Engine
from gateway.incident.freezing import thaw
from gateway.incident.records import HEADER_VERSION, Latched, Start, Tick
from gateway.incident.ring import SUFFIX, Piece, piece, records

__all__ = ["Cause", "Difference", "Incident", "Replayed", "incident", "replay", "ticks"]


class Cause(NamedTuple):
    """What an incident was kept for.

    Attributes:
        code: Of what was latched, of why a motion was aborted, or of the takeover; DIED for a process that ended so.
        message: In words.
        at_ns: Monotonic time [ns]; 0 where it is not known.
    """

    code: str
    message: str
    at_ns: int


class Incident(Struct, frozen=True, kw_only=True):
    """What was kept.

    Attributes:
        path: Its folder.
        causes: What for, the first one first.
        kept_ns: Wall time at which it was kept [ns].
        pieces: What is known, in order.
    """

    path: Path
    causes: tuple[Cause, ...]
    kept_ns: int
    pieces: tuple[Piece, ...]

    @property
    def release(self) -> Mapping[str, str]:
        """Whose engine it was, as `recorder.release` has it; empty where nothing is known."""
        found = self.pieces[-1].header.get("release") if self.pieces else None
        return {str(key): str(value) for key, value in found.items()} if isinstance(found, dict) else {}

    @property
    def wall_ns(self) -> int:
        """What to add to a monotonic time for the wall time [ns]."""
        header = self.pieces[-1].header if self.pieces else {}
        wall, mono = header.get("wall_ns"), header.get("mono_ns")
        return wall - mono if isinstance(wall, int) and isinstance(mono, int) else 0


class Difference(NamedTuple):
    """Where a replay is not what was recorded.

    Attributes:
        now_ns: Of the tick [ns].
        what: `frames`, `state`, `notices`, `replies` or `claim`; `raised` where the engine cannot go on.
        recorded: What it was.
        replayed: What it is.
    """

    now_ns: int
    what: str
    recorded: str
    replayed: str


@dataclass(slots=True, kw_only=True)
class Replayed:
    """How a replay went.

    Attributes:
        ticks: That were run.
        frames: That they gave.
        gaps: Pieces that did not follow the one before.
        difference: The first one; None when there is none.
    """

    ticks: int = 0
    frames: int = 0
    gaps: int = 0
    difference: Difference | None = field(default=None)


def incident(path: Path) -> Incident:
    """Read what an incident is; its records are read by `ticks` and `replay`.

    Raises:
        OSError: It cannot be read.
        ValueError: It is none.
    """
    note = json.loads((path / "incident.json").read_bytes())
    if not isinstance(note, dict) or note.get("form") != HEADER_VERSION:
        raise ValueError("it is of another release")
    try:
        causes = tuple(Cause(str(c["code"]), str(c["message"]), int(c["at_ns"])) for c in note["causes"])
        kept_ns = int(note["kept"])
    except (KeyError, TypeError) as error:
        raise ValueError(f"its note lacks {error}") from error
    pieces: list[Piece] = []
    for box in sorted(path.glob(f"*{SUFFIX}"), reverse=True):
        try:
            pieces.append(piece(box))
        except (json.JSONDecodeError, UnicodeDecodeError):
            if pieces:  # else its process died there, or the power failed before it reached the disk
                raise
    return Incident(path=path, causes=causes, kept_ns=kept_ns, pieces=tuple(reversed(pieces)))


def _is_gap(pieces: Sequence[Piece], number: int) -> bool:
    """Return whether something is missing between a piece and the one before it."""
    if number == 0:
        return False
    before, box = pieces[number - 1 : number + 1]
    return bool(box.header.get("is_gap")) or int(box.path.stem) != int(before.path.stem) + 1


def ticks(found: Incident) -> Iterator[tuple[bool, Tick]]:
    """Yield each tick that was recorded, and whether it follows a gap.

    Raises:
        OSError: A piece cannot be read.
        ValueError: Something else is in it.
    """
    for number, box in enumerate(found.pieces):
        is_gap = _is_gap(found.pieces, number)
        for record in records(box.path):
            if isinstance(record, Tick):
                yield is_gap, record
                is_gap = False


def replay(found: Incident) -> Replayed:
    """Run the engine on an incident, up to the first difference.

    Raises:
        OSError: A piece cannot be read.
        ValueError: Something else is in it, or another release's engine.
    """
    done = Replayed()
    engine: Engine | None = None
    for number, box in enumerate(found.pieces):
        is_gap = _is_gap(found.pieces, number)
        done.gaps += is_gap
        if is_gap:
            engine = None
        for record in records(box.path):
            if isinstance(record, Start):
                engine = engine or _thawed(record)
            elif engine is not None:
                done.difference = _run(engine, record)
                done.ticks += 1
                done.frames += len(record.frames)
                if done.difference is not None:
                    return done
    return done


def _thawed(start: Start) -> Engine:
    try:
        return thaw(start.parts, start.state)
    except Exception as error:  # whatever another release's state does to this one's classes
        raise ValueError(f"the engine's state is not understood ({type(error).__name__}: {error})") from error


def _run(engine: Engine, tick: Tick) -> Difference | None:
    engine.is_watched = tick.is_watched
    try:
        for event in tick.heard:
            if isinstance(event, Latched):
                engine.takeover.latch(event.code, event.message, event.at_ns)
            else:
                engine.receive(event, tick.now_ns)
        output = engine.tick(tick.now_ns, tick.late_ns)
    except Exception as error:  # noqa: BLE001  the very bug that is looked for
        end = f"the tick ended in {tick.state}" if tick.state else "it raised"
        return Difference(tick.now_ns, "raised", end, f"{type(error).__name__}: {error}")
    pairs = (
        ("frames", tick.frames, output.frames),
        ("state", tick.state, engine.state.value),
        ("notices", tick.notices, output.notices),
        ("replies", tick.replies, output.replies),
        ("claim", tick.claim, output.claim),
    )
    for what, recorded, replayed in pairs:
        if (was := repr(recorded)) != (now := repr(replayed)):  # also tells -0.0 from 0.0, and every last bit
            return Difference(tick.now_ns, what, was, now)
    return None
