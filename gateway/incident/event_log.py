"""What was told and refused, one line of JSON an event, in a file that `ta2 why --since` reads.

Bounded: at a size the file is put aside as the one before, of which there is one. A refusal that is repeated is written
once a second, with how many came. Of one thread, which may wait for the disk.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

from gateway.incident.folders import own_folder
from gateway.incident.records import Tick

__all__ = ["EventLog", "read_events"]

S = 1_000_000_000
MOST_BYTES = 4 * 2**20
NAME, BEFORE = "events.jsonl", "events.1.jsonl"


class EventLog:
    """Writes it.

    Args:
        folder: Of one robot; is there.
    """

    def __init__(self, folder: Path) -> None:
        self._path, self._before = folder / NAME, folder / BEFORE
        self._refused: dict[tuple[str, str], tuple[int, int]] = {}

    def note(self, tick: Tick, wall_ns: int) -> bytes:
        """Return the lines of a tick, none for most.

        Args:
            tick: Which one.
            wall_ns: Wall time of its `now_ns` [ns].
        """
        t = round(wall_ns / S, 3)
        lines: list[dict[str, object]] = [
            {"t": t, "event": "notice", "level": told.level.value, "code": told.code.value, "message": told.message}
            | ({"facts": dict(told.facts)} if told.facts else {})
            for told in tick.notices
        ]
        for reply in tick.replies:
            if reply.refusal is not None:
                key = reply.client_id, reply.refusal.code.value
                since_ns, count = self._refused.get(key, (0, 0))
                if tick.now_ns - since_ns < S:
                    self._refused[key] = since_ns, count + 1
                    continue
                self._refused[key] = tick.now_ns, 0
                who, code = key
                line = {"t": t, "event": "refused", "client": who, "code": code, "message": reply.refusal.message}
                lines.append(line | ({"more": count} if count else {}))
        if len(self._refused) > 256:
            self._refused.clear()
        return b"".join(f"{json.dumps(line, ensure_ascii=False)}\n".encode(errors="replace") for line in lines)

    def write(self, lines: bytes) -> None:
        """Append lines.

        Raises:
            OSError: The disk refuses.
        """
        own_folder(self._path.parent)
        if self._path.exists() and self._path.stat().st_size > MOST_BYTES:
            self._path.replace(self._before)
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        with open(os.open(self._path, flags, 0o600), "ab") as file:
            file.write(lines)


def read_events(folder: Path, since_s: float) -> Iterator[dict[str, object]]:
    """Yield the events from a wall time on [s], the oldest first; lines that are none are passed over.

    Raises:
        OSError: A file is there and cannot be read.
    """
    for path in (folder / BEFORE, folder / NAME):
        if not path.exists():
            continue
        with path.open("rb") as file:
            for line in file:
                try:
                    event = json.loads(line)
                except ValueError:  # half a line: a process died there
                    continue
                if isinstance(event, dict) and isinstance(t := event.get("t"), (int, float)) and t >= since_s:
                    yield event
