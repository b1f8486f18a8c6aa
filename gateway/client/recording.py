"""`robot.recording`: episodes of a recording that another process makes, in the blocking client."""

from __future__ import annotations

from gateway.api.recorder_protocol import RecordingState
from gateway.client.connection.recorder import ask_recorder

__all__ = ["Recording", "RecordingState"]


class Recording:
    """The recording of this robot by `ta2 record` on this host. Made by `Robot.recording`; owns and moves nothing.

    Each call waits for the recorder, at most 2 s, and returns how the recording is then. Each raises NotReady (NO_RECORDER)
    where nobody records, and OutcomeUnknown where the recorder does not answer.
    """

    def __init__(self, address: str) -> None:
        self._address = address

    def state(self) -> RecordingState:
        """Return how it is: its bag, the newest episode, and whether that goes on."""
        return ask_recorder(self._address, "status")

    def start(self, task: str = "") -> RecordingState:
        """Begin an episode.

        Args:
            task: What is shown, in words; empty for the task of the recording.

        Raises:
            Rejected: One goes on.
        """
        return ask_recorder(self._address, "start", task=task)

    def stop(self) -> RecordingState:
        """End the episode.

        Raises:
            Rejected: None goes on.
        """
        return ask_recorder(self._address, "stop")

    def mark(self, text: str = "") -> RecordingState:
        """Mark this instant of the episode, with a text.

        Raises:
            Rejected: None goes on.
        """
        return ask_recorder(self._address, "mark", text=text)

    def success(self, text: str = "") -> RecordingState:
        """Judge the newest episode, and end it if it goes on; the last verdict counts.

        Raises:
            Rejected: There was none.
        """
        return ask_recorder(self._address, "success", text=text)

    def failure(self, text: str = "") -> RecordingState:
        """As `success`: what was to be shown was not."""
        return ask_recorder(self._address, "failure", text=text)

    def discard(self, text: str = "") -> RecordingState:
        """As `success`: the episode is not to be used. It stays in the bag."""
        return ask_recorder(self._address, "discard", text=text)
