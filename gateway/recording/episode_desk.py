"""The episodes of a recording that goes on: what may be said of them now, and what is then written. For any thread.

Knows no key, no socket and no clock.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from gateway.api.recorder_protocol import RecorderAsk, RecordingState
from gateway.errors import Code, failure

__all__ = ["EpisodeDesk"]

Say = Callable[[Mapping[str, object]], bool]
"""Takes an `EpisodeEvent` but for its time; returns whether it is written."""


class EpisodeDesk:
    """Keeps the one episode that goes on.

    Args:
        folder: Of the bag.
        task: Of episodes whose start names none.
        say: Called with each event, in its order; must not wait.
    """

    def __init__(self, folder: Path, task: str, say: Say) -> None:
        self._task = task
        self._say = say
        self._state = RecordingState(bag=str(folder.resolve()))
        self._lock = threading.Lock()

    @property
    def state(self) -> RecordingState:
        """How the recording is."""
        return self._state

    def carry_out(self, ask: RecorderAsk, task: str = "", text: str = "") -> RecordingState:
        """Do what was asked, and return how the recording is then.

        Args:
            ask: What; a verdict ends an episode that goes on.
            task: Of a start.
            text: Of a mark or a verdict.

        Raises:
            Rejected: It cannot be done now.
        """
        with self._lock:
            now = self._state
            if ask == "start":
                if now.is_running:
                    raise _refused(f"episode {now.episode} goes on", "stop or judge it first")
                self._write("start", now.episode + 1, True, task or self._task, text)
            elif ask in ("stop", "mark"):
                if not now.is_running:
                    raise _refused("no episode goes on", "start one first")
                self._write(ask, now.episode, ask == "mark", now.task, text)
            elif ask != "status":
                if not now.episode:
                    raise _refused("there was no episode yet", "start one first")
                if now.is_running:
                    self._write("stop", now.episode, False, now.task)
                self._write(ask, now.episode, False, now.task, text)
            return self._state

    def end(self) -> None:
        """End the episode that goes on, if one does: the recording ends well."""
        if self._state.is_running:
            self.carry_out("stop")

    def _write(self, event: RecorderAsk, episode: int, is_running: bool, task: str, text: str = "") -> None:
        said = {"event": event, "episode": episode, "task": task if event == "start" else "", "text": text}
        if not self._say(said):
            raise _refused("the recorder's queue is full: it was not noted", "record on a faster disk")
        self._state = RecordingState(bag=self._state.bag, episode=episode, is_running=is_running, task=task)


def _refused(message: str, hint: str) -> Exception:
    return failure(Code.BAD_REQUEST, message, field="episode", hint=hint)
