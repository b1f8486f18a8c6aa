"""Episodes of a bag: the parts of a recording in which one task is shown once, as whoever recorded it said.

Each word is a JSON text on `EPISODES`, at the time at which it was said: nothing of it is lost with a recorder that is killed.

    {"event": "start", "episode": 1, "task": "wave", "text": "", "at_ns": 1790000000000000000}

Rules
    * An episode ends with its stop. One that has none is unfinished, and ends with the bag.
    * The last verdict counts: a success or failure after a discard takes that back.
    * Where nobody said anything, the buttons of a VR controller count (bags of the robot's own recorder; its public converter).
    * A bag without either is one episode, with the task that was noted for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, Literal, NamedTuple

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from cdr_types import CdrError, decode, encode
from cdr_types.messages.std_msgs import String
from gateway.recording.bag_reader import Bag
from gateway.recording.topics import EPISODES

__all__ = [
    "BUTTONS",
    "Episode",
    "EpisodeEvent",
    "EventName",
    "Mark",
    "Outcome",
    "as_message",
    "episodes",
    "events",
    "events_of",
    "told_episodes",
]

BUTTONS: Final = "/xr/left_hand_inputs"
X: Final = 2
"""Pressed: an episode begins; once more: what was begun is not used, and another begins."""
Y: Final = 3
"""Pressed: it ends."""

EventName = Literal["start", "stop", "mark", "success", "failure", "discard"]
Outcome = Literal["success", "failure", ""]


class EpisodeEvent(msgspec.Struct, frozen=True, kw_only=True):
    """One word about an episode, as it lies in a bag.

    Attributes:
        event: What was said.
        episode: Of which episode, from 1.
        at_ns: When, by the clock of the bag's arrivals [ns].
        task: Of a start: what is shown, in words.
        text: Of a mark, or the reason of a verdict.
    """

    event: EventName
    episode: int
    at_ns: int
    task: str = ""
    text: str = ""


class Mark(NamedTuple):
    """An instant that somebody marked: when, by the clock of the bag's arrivals [ns], and what was said."""

    at_ns: int
    text: str


class Episode(Struct, frozen=True, kw_only=True):
    """An episode of a bag: the messages whose arrival is in [begin_ns, end_ns).

    Attributes:
        number: From 1, as it was counted while recording.
        task: What is shown, in words; empty where nobody said.
        begin_ns: Its first instant, by the clock of the bag's arrivals [ns].
        end_ns: The first instant after it [ns].
        outcome: What came of it; empty where nobody judged.
        is_discarded: Whether it is not to be used.
        marks: What was marked in it, in that order.
        is_finished: Whether it was stopped; else it ends with the bag.
    """

    number: int
    task: str
    begin_ns: int
    end_ns: int
    outcome: Outcome = ""
    is_discarded: bool = False
    marks: tuple[Mark, ...] = ()
    is_finished: bool = True


def episodes(bag: Bag) -> tuple[Episode, ...]:
    """Return the episodes of a bag in the order of their begins; the whole bag where nobody told of any."""
    found = told_episodes(bag)
    if found is not None:
        return found
    task = bag.facts().get("task", "")
    return (Episode(number=1, task=task, begin_ns=bag.begin_ns, end_ns=bag.end_ns),) if bag.message_count else ()


def told_episodes(bag: Bag) -> tuple[Episode, ...] | None:
    """Return the episodes that words, or else buttons, tell of, in the order of their begins; None where neither was used.

    What is said of an episode whose start is not in the bag is passed over.
    """
    task = bag.facts().get("task", "")
    latest: dict[int, int] = {}
    found: list[Episode] = []
    is_told = False
    for event in events(bag):
        is_told = True
        if event.event == "start":
            latest[event.episode] = len(found)
            found.append(
                Episode(
                    number=event.episode,
                    task=event.task or task,
                    begin_ns=event.at_ns,
                    end_ns=bag.end_ns,
                    is_finished=False,
                )
            )
        elif event.episode in latest:
            place = latest[event.episode]
            found[place] = _with(found[place], event)
    if not is_told:
        return _pressed(bag) or None
    return tuple(sorted(found, key=lambda episode: episode.begin_ns))


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


def _with(episode: Episode, event: EpisodeEvent) -> Episode:
    match event.event:
        case "stop":
            return replace(episode, end_ns=event.at_ns, is_finished=True)
        case "mark":
            return replace(episode, marks=(*episode.marks, Mark(event.at_ns, event.text)))
        case "success" | "failure":
            return replace(episode, outcome=event.event, is_discarded=False)
        case _:
            return replace(episode, is_discarded=True)


def events(bag: Bag) -> Iterator[EpisodeEvent]:
    """Yield what was said about episodes, in the order of its arrival; what cannot be read is passed over."""
    for message in bag.messages([EPISODES]):
        try:
            yield msgspec.json.decode(decode(message.payload, String).data, type=EpisodeEvent)
        except (CdrError, msgspec.MsgspecError):  # `ta2 bag check` counts it
            continue


def as_message(event: EpisodeEvent) -> bytes:
    """Return an event as the CDR of its topic."""
    return encode(String(data=msgspec.json.encode(event).decode()))


def events_of(episode: Episode) -> Iterator[EpisodeEvent]:
    """Yield events that make this episode, in the order of their times; verdicts at its end."""

    def event(name: EventName, at_ns: int, task: str = "", text: str = "") -> EpisodeEvent:
        return EpisodeEvent(event=name, episode=episode.number, at_ns=at_ns, task=task, text=text)

    yield event("start", episode.begin_ns, task=episode.task)
    for mark in episode.marks:
        yield event("mark", mark.at_ns, text=mark.text)
    if episode.is_finished:
        yield event("stop", episode.end_ns)
    if episode.outcome:
        yield event(episode.outcome, episode.end_ns)
    if episode.is_discarded:
        yield event("discard", episode.end_ns)
