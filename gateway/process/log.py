"""The log of the processes that must never wait for it: lines for people or JSON, written from a thread of their own."""

from __future__ import annotations

import contextlib
import faulthandler
import json
import logging
import os
import queue
import threading
import time
from collections.abc import Callable

from gateway.process.threads import supervised

__all__ = ["JsonLines", "LogWriter", "RateLimit", "configure_log"]

LOG_CAPACITY = 1000
"""Log lines that may wait to be written."""
LOG_TIMEOUT_S = 1.0
"""How long the end waits for the last log lines [s]."""
STDERR = 2


class JsonLines(logging.Formatter):
    """One JSON object a line: time, level, logger, message, and code and facts of a notice."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record."""
        line: dict[str, object] = {
            "t": round(record.created, 3),
            "level": record.levelname.lower(),
            "from": record.name,
            "message": record.getMessage(),
        }
        for key in ("code", "facts"):
            value = getattr(record, key, None)
            if value:
                line[key] = value
        if record.exc_info:
            line["error"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False)


class RateLimit(logging.Filter):
    """Lets a source line speak at most so often: warnings may repeat at the rate of the loop.

    Notices come from one line of the loop: each of their codes counts as a source of its own.

    The clock is monotonic [s]: a step of the wall clock silences nobody.
    """

    def __init__(self, burst: int = 20, window_s: float = 1.0, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._burst = burst
        self._window_s = window_s
        self._clock = clock
        self._seen: dict[tuple[str, int, str], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record passes."""
        source = (record.pathname, record.lineno, getattr(record, "code", ""))
        now = self._clock()
        since, count = self._seen.get(source, (now, 0))
        if now - since > self._window_s:
            since, count = now, 0
        self._seen[source] = (since, count + 1)
        return count < self._burst


class LogWriter(logging.Handler):
    """Writes records to a file descriptor from a thread of its own: who logs never waits for whoever reads the log.

    A terminal under Ctrl-S, a pipe whose reader hangs or a full disk would stop the control loop else, at its next
    notice and for as long as it lasts. What does not fit is left out, and counted in the log. The descriptor is written
    directly: a thread that hangs in `sys.stderr` holds a lock that the interpreter needs to end.

    Args:
        descriptor: Where to write; stays open.
        capacity: Records that may wait.
    """

    def __init__(self, descriptor: int = STDERR, capacity: int = LOG_CAPACITY) -> None:
        super().__init__()
        self._descriptor = descriptor
        self._capacity = capacity
        self._waiting: queue.SimpleQueue[logging.LogRecord | None] = queue.SimpleQueue()
        self._left_out = 0
        self._counting = threading.Lock()
        self._is_closed = False
        self._thread = supervised(self._run, "log", may_return=lambda: self._is_closed, again=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Put a record in line."""
        if self._is_closed or self._waiting.qsize() >= self._capacity:
            with self._counting:
                self._left_out += 1
        else:
            self._waiting.put(record)

    def close(self) -> None:
        """Write what waits, for a second at most. May be called again; logging does it when the process ends."""
        if not self._is_closed:
            self._is_closed = True
            self._waiting.put(None)
            self._thread.join(LOG_TIMEOUT_S)
        super().close()

    def _run(self) -> None:
        while (record := self._waiting.get()) is not None:
            try:
                line = self.format(record)
            except Exception as error:  # noqa: BLE001  whatever a message does when it is formatted: the next are told
                line = f"a record of {record.pathname}:{record.lineno} cannot be shown: {type(error).__name__}"
            self._write(line)
            if self._left_out:
                with self._counting:
                    lost, self._left_out = self._left_out, 0
                text = f"{lost} log lines were left out: nobody read the log"
                self._write(self.format(logging.LogRecord(__name__, logging.WARNING, __file__, 0, text, (), None)))

    def _write(self, line: str) -> None:
        rest = memoryview(f"{line}\n".encode(errors="backslashreplace"))
        with contextlib.suppress(OSError):  # nobody will ever read it: the terminal is gone, the disk is full
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]


def configure_log(*, is_json: bool) -> None:
    """Write the log to standard error, as JSON lines or as plain ones for people, without ever waiting for it.

    A process that is aborted (`kill -ABRT`, or by a compiled part) writes there where each of its threads stands.
    """
    faulthandler.enable(2)
    handler = LogWriter()
    handler.setFormatter(JsonLines() if is_json else logging.Formatter("%(asctime)s %(levelname)-7s %(message)s"))
    handler.addFilter(RateLimit())
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)
