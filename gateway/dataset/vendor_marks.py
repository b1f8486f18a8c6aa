"""Episodes in bags of the robot's own recorder: marked with the buttons of a VR controller (the vendor's public converter)."""

from __future__ import annotations

from typing import Final

from gateway.recording.bag_reader import Bag
from gateway.recording.episodes import Episode, episodes
from gateway.recording.topics import EPISODES

__all__ = ["BUTTONS", "all_episodes"]

BUTTONS: Final = "/xr/left_hand_inputs"
X: Final = 2
"""Pressed: an episode begins; once more: what was begun is not used, and another begins."""
Y: Final = 3
"""Pressed: it ends."""


def all_episodes(bag: Bag) -> tuple[Episode, ...]:
    """Return a bag's episodes: as was said while recording, else as buttons were pressed, else the whole bag."""
    topics = {topic.name for topic in bag.topics}
    pressed = () if EPISODES in topics or BUTTONS not in topics else _pressed(bag)
    return pressed or episodes(bag)


def _pressed(bag: Bag) -> tuple[Episode, ...]:
    """Return what buttons mark; a button counts as pressed only after it was seen released."""
    task = bag.facts().get("task", "")
    found: list[Episode] = []
    begin_ns, before = 0, [1] * 4

    def episode(end_ns: int, *, is_finished: bool, is_discarded: bool = False) -> Episode:
        return Episode(
            number=len(found) + 1,
            task=task,
            begin_ns=begin_ns,
            end_ns=end_ns,
            is_finished=is_finished,
            is_discarded=is_discarded,
        )

    for _, log_ns, message in bag.decoded([BUTTONS]):
        buttons = [] if message is None else list(message.buttons)
        if len(buttons) <= Y:
            continue
        if buttons[X] and not before[X]:
            if begin_ns:
                found.append(episode(log_ns, is_finished=True, is_discarded=True))
            begin_ns = log_ns
        elif buttons[Y] and not before[Y] and begin_ns:
            found.append(episode(log_ns, is_finished=True))
            begin_ns = 0
        before = buttons
    if begin_ns:
        found.append(episode(bag.end_ns, is_finished=False, is_discarded=True))
    return tuple(found)
