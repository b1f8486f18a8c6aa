"""Bags made of bags: a part cut out by time, several put together. Messages are copied byte for byte, with both of their times.

    bags -> rows in the order of their arrival -> bag writer

Types, QoS and noted facts stay. What was told of episodes is written anew, so that it is true of the new bag: an episode that
is cut begins and ends with the part; those of several bags are counted on, one of ours without any among them as one.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from gateway.errors import Code, GatewayError, failure
from gateway.recording.bag_reader import Bag, BagCopy
from gateway.recording.bag_writer import OFFSET, BagWriter
from gateway.recording.episodes import Episode, as_message, episodes, events_of, told_episodes
from gateway.recording.topics import EPISODES, TEXT, RecordedTopic

__all__ = ["Made", "cut", "merge"]

TELL_EACH = 5000

OnProgress = Callable[[float], None]


class Made(Struct, frozen=True, kw_only=True):
    """A bag that was made: its file, messages, and episodes that somebody told of."""

    file: Path
    messages: int
    episodes: int


def cut(
    bag: Bag,
    out: Path,
    *,
    from_s: float = 0.0,
    to_s: float | None = None,
    episode: int | None = None,
    on_progress: OnProgress = lambda share: None,
) -> Made:
    """Copy a part of a bag.

    Args:
        bag: Open.
        out: Folder of the new bag.
        from_s: Its begin, after that of the bag or of the episode [s].
        to_s: Its end, likewise; None for theirs [s].
        episode: Only this episode.
        on_progress: Called now and then with the part that is done, 0..1.

    Raises:
        Rejected: BAD_REQUEST, there is no such part or episode, or it cannot be written; nothing is left behind.
    """
    told = told_episodes(bag) or ()
    begin_ns, end_ns = bag.begin_ns, bag.end_ns
    if episode is not None:
        there = told or episodes(bag)
        wanted = tuple(one for one in there if one.number == episode)
        if not wanted:
            numbers = ", ".join(str(one.number) for one in there) or "none"
            raise _refused(f"{bag.path} has no episode {episode}; there are: {numbers}", "episode")
        told = wanted[-1:] if told else ()
        begin_ns, end_ns = wanted[-1].begin_ns, wanted[-1].end_ns
    first_ns = begin_ns + max(round(from_s * 1e9), 0)
    last_ns = end_ns if to_s is None else min(end_ns, begin_ns + round(to_s * 1e9))
    if first_ns >= last_ns:
        length_s = (end_ns - begin_ns) / 1e9
        raise _refused(f"nothing lies between {from_s:g} s and {to_s or length_s:g} s of {length_s:.3f} s", "from")
    kept = [part for one in told if (part := _clipped(one, first_ns, last_ns)) is not None]
    rows = (row for row in bag.copies(first_ns, last_ns) if row.topic != EPISODES)
    return _written(out, bag.recorded_topics(), bag.facts(), [rows], kept, (first_ns, last_ns), on_progress)


def merge(bags: Sequence[Bag], out: Path, on_progress: OnProgress = lambda share: None) -> Made:
    """Put bags together, in the order of their messages' arrival.

    Of what was noted, what was lost is added up, and the smallest distance of the clocks counts; else the first bag's word.

    Args:
        bags: Open.
        out: Folder of the new bag.
        on_progress: Called now and then with the part that is done, 0..1.

    Raises:
        Rejected: BAD_REQUEST, a topic has two types, there are episodes and robots of two namespaces, or it cannot be written;
            nothing is left behind.
    """
    bags = sorted(bags, key=lambda bag: bag.begin_ns)
    topics: dict[str, RecordedTopic] = {}
    kept: list[Episode] = []
    told = [told_episodes(bag) or () for bag in bags]
    spaces = {facts["namespace"].strip("/") for bag in bags if "namespace" in (facts := bag.facts())}
    if any(told) and len(spaces) > 1:
        names = " and ".join(space or "none" for space in sorted(spaces))
        message = (
            f"the namespaces of the robots are {names}: each episode would hold the motion of the first robot alone"
        )
        raise _refused(message, "bag", "name the bags themselves to `ta2 dataset build`, which takes several")
    span = min(bag.begin_ns for bag in bags), max(bag.end_ns for bag in bags)
    for bag, its in zip(bags, told, strict=True):
        for topic in bag.recorded_topics():
            known = topics.setdefault(topic.name, topic)
            if known.type_name != topic.type_name:
                message = f"{topic.name} is a {known.type_name} in one bag, and a {topic.type_name} in {bag.path}"
                raise _refused(message, "bag", "merge bags of the same topics, or cut what you need")
        so_far = max((one.number for one in kept), default=0)
        own = its or (episodes(bag) if any(told) and bag.facts() else ())
        for one in own:  # an unfinished one ends with its bag: that has to be said where another goes on
            is_finished = one.is_finished or one.end_ns < span[1]
            kept.append(replace(one, number=one.number + so_far, is_finished=is_finished))
    rows = [(row for row in bag.copies() if row.topic != EPISODES) for bag in bags]
    return _written(out, list(topics.values()), _facts([bag.facts() for bag in bags]), rows, kept, span, on_progress)


def _clipped(episode: Episode, begin_ns: int, end_ns: int) -> Episode | None:
    """Return what of an episode lies in a part of its bag; None where nothing does."""
    if episode.end_ns <= begin_ns or episode.begin_ns >= end_ns:
        return None
    return replace(
        episode,
        begin_ns=max(episode.begin_ns, begin_ns),
        end_ns=min(episode.end_ns, end_ns),
        marks=tuple(mark for mark in episode.marks if begin_ns <= mark.at_ns < end_ns),
    )


def _facts(facts: Sequence[Mapping[str, str]]) -> dict[str, str]:
    known = [one for one in facts if one]
    found = {name: value for one in reversed(known) for name, value in one.items()}
    for name in found:
        values = [one[name] for one in known if name in one]
        if name.startswith(OFFSET):
            found[name] = str(min(map(int, values)))
        elif name == "lost":
            found[name] = str(sum(map(int, values)))
        elif name == "error":
            found[name] = "; ".join(filter(None, values))
    if len({one.get("task", "") for one in facts}) > 1:
        found.pop("task", None)  # no word of one bag is true of the whole
    if any("lost" not in one for one in known):
        found.pop("lost", None)  # one was killed
    return found


def _written(
    out: Path,
    topics: list[RecordedTopic],
    facts: Mapping[str, str],
    rows: Sequence[Iterable[BagCopy]],
    kept: Sequence[Episode],
    span: tuple[int, int],
    on_progress: OnProgress,
) -> Made:
    if kept and all(topic.name != EPISODES for topic in topics):
        topics = [*topics, RecordedTopic(name=EPISODES, type_name=TEXT)]
    numbers = {topic.name: number for number, topic in enumerate(topics)}
    writer = BagWriter(out, topics)
    try:
        for count, row in enumerate(heapq.merge(*rows, _words(kept), key=lambda row: row.log_ns)):
            if count % TELL_EACH == 0:
                on_progress(min(max((row.log_ns - span[0]) / (span[1] - span[0]), 0.0), 1.0))
            writer.add(numbers[row.topic], row.log_ns, row.publish_ns, row.payload)
        if not sum(writer.counts):
            raise _refused("there is no message in it", "bag")
        if facts:
            writer.note(facts)
        file = writer.finish()
    except BaseException as error:
        writer.discard()
        if isinstance(error, Exception) and not isinstance(error, GatewayError):
            raise _refused(
                f"{out} cannot be made: {error}", "out", "name a folder with more room with --out"
            ) from error
        raise
    on_progress(1.0)
    return Made(file=file, messages=sum(writer.counts), episodes=len(kept))


def _words(kept: Iterable[Episode]) -> Iterator[BagCopy]:
    words = sorted((event for one in kept for event in events_of(one)), key=lambda event: event.at_ns)
    yield from (BagCopy(word.at_ns, word.at_ns, EPISODES, as_message(word)) for word in words)


def _refused(message: str, field: str, hint: str = "`ta2 bag info` shows what there is") -> GatewayError:
    return failure(Code.BAD_REQUEST, message, field=field, hint=hint)
