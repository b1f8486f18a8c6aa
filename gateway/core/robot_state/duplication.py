"""Whether the robot's bridge delivers every sample several times, as it does after restarts (wire.md 3.1).

Duplicates are skipped before they are decoded and change nothing; but each costs link and processor, and the count only
grows until the bridge is restarted. So it is told: once for each count, not for each sample.
"""

from __future__ import annotations

from gateway.core.messages.events import SampleArrived

__all__ = ["Duplication"]

WINDOW_SAMPLES = 200
"""So many samples of a topic are judged together: 1 s of a fast one. A retransmission is no duplication."""


class Duplication:
    """Counts how often samples arrive, over all topics that carry a stamp."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[int, int]] = {}
        """Per topic with duplicates lately, samples and duplicates in the present window."""
        self._times = 1

    def reset(self) -> None:
        """Forget what was counted and told: another transport."""
        self._seen.clear()
        self._times = 1

    def note(self, event: SampleArrived) -> str:
        """Count an arrival; return what is to be told about it, or nothing."""
        before = self._seen.get(event.topic)
        if before is None and not event.duplicates:
            return ""
        samples, duplicates = before or (0, 0)
        samples, duplicates = samples + event.count, duplicates + event.duplicates
        if samples < WINDOW_SAMPLES:
            self._seen[event.topic] = samples, duplicates
            return ""
        self._seen.pop(event.topic, None)
        times = 1 + round(duplicates / samples)
        if times <= self._times:
            return ""
        self._times = times
        return f"the robot's bridge delivers {event.topic} {times} times; duplicates are skipped; restart the robot's bridge"
