"""Tests of the episodes of a bag: what was said about them, and what comes of it."""

from __future__ import annotations

import pytest
from rosbags.rosbag2 import StoragePlugin

from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import BagWriter
from gateway.recording.episodes import Episode, EpisodeEvent, Mark, as_message, episodes, events, events_of
from gateway.recording.topics import EPISODES
from tests.recording.bags import ARM, BEGIN_NS, TOPICS, joints, pressed

S = 1_000_000_000
WORDS = next(n for n, topic in enumerate(TOPICS) if topic.name == EPISODES)


def bag_of(folder, *said, task="", seconds=10):
    """Return an open bag with a message a second, in which this was said: event, episode, second, other fields."""
    writer = BagWriter(folder, TOPICS)
    rows = [(BEGIN_NS + n * S, ARM, joints(1)) for n in range(seconds)]
    for name, number, at_s, *rest in said:
        fields = rest[0] if rest else {}
        event = EpisodeEvent(event=name, episode=number, at_ns=BEGIN_NS + int(at_s * S), **fields)
        rows.append((event.at_ns, WORDS, as_message(event)))
    for at_ns, number, data in sorted(rows, key=lambda row: row[0]):
        writer.add(number, at_ns, at_ns, data)
    writer.note({"task": task} if task else {})
    writer.finish()
    return Bag(folder)


def test_an_episode_is_what_was_said_of_it(tmp_path):
    """Task, begin, end, marks, and the verdict, which may come after its end."""
    said = (
        ("start", 1, 1, {"task": "wave"}),
        ("mark", 1, 1.5, {"text": "touched"}),
        ("stop", 1, 3),
        ("start", 2, 4),
        ("stop", 2, 5),
        ("success", 1, 6),
        ("discard", 2, 7),
    )
    with bag_of(tmp_path / "bag", *said, task="noted") as bag:
        first, second = episodes(bag)
    assert first == Episode(
        number=1,
        task="wave",
        begin_ns=BEGIN_NS + S,
        end_ns=BEGIN_NS + 3 * S,
        outcome="success",
        marks=(Mark(BEGIN_NS + S * 3 // 2, "touched"),),
    )
    assert (second.task, second.outcome, second.is_discarded) == ("noted", "", True)


def test_the_last_verdict_counts(tmp_path):
    """A success takes a discard back."""
    said = (("start", 1, 1), ("stop", 1, 2), ("success", 1, 3), ("discard", 1, 4), ("failure", 1, 5))
    with bag_of(tmp_path / "bag", *said) as bag:
        (episode,) = episodes(bag)
    assert (episode.outcome, episode.is_discarded) == ("failure", False)


def test_a_bag_in_which_nobody_said_anything_is_one_episode(tmp_path):
    """Over its whole length, with the task that was noted."""
    with bag_of(tmp_path / "bag", task="pick") as bag:
        assert episodes(bag) == (Episode(number=1, task="pick", begin_ns=BEGIN_NS, end_ns=BEGIN_NS + 9 * S + 1),)
    with bag_of(tmp_path / "empty", seconds=0) as bag:
        assert episodes(bag) == ()


def test_an_unfinished_episode_ends_with_the_bag(tmp_path):
    """As one does whose recorder was killed."""
    with bag_of(tmp_path / "bag", ("start", 3, 4)) as bag:
        (episode,) = episodes(bag)
        assert (episode.number, episode.end_ns, episode.is_finished) == (3, bag.end_ns, False)


def test_what_belongs_to_no_episode_makes_none(tmp_path):
    """The end of one that began before the bag did; words that nobody can read."""
    with bag_of(tmp_path / "bag", ("stop", 7, 1), ("success", 7, 2)) as bag:
        assert episodes(bag) == ()
    writer = BagWriter(tmp_path / "other", TOPICS)
    writer.add(WORDS, BEGIN_NS, BEGIN_NS, b"\x00")
    writer.finish()
    with Bag(tmp_path / "other") as bag:
        assert list(events(bag)) == [] and len(episodes(bag)) == 1


@pytest.mark.parametrize("is_finished", [True, False])
def test_events_of_an_episode_make_it_again(tmp_path, is_finished):
    """All that is known of it comes back."""
    end_ns = BEGIN_NS + 5 * S if is_finished else BEGIN_NS + 9 * S + 1
    wanted = Episode(
        number=2,
        task="stack",
        begin_ns=BEGIN_NS + S,
        end_ns=end_ns,
        outcome="failure",
        is_discarded=True,
        marks=(Mark(BEGIN_NS + 2 * S, "slipped"),),
        is_finished=is_finished,
    )
    writer = BagWriter(tmp_path / "bag", TOPICS)
    for n in range(10):
        writer.add(ARM, BEGIN_NS + n * S, BEGIN_NS + n * S, joints(1))
    for event in events_of(wanted):
        at_ns = min(event.at_ns, BEGIN_NS + 9 * S)
        writer.add(WORDS, at_ns, at_ns, as_message(event))
    writer.finish()
    with Bag(tmp_path / "bag") as bag:
        assert episodes(bag) == (wanted,)


def seen(folder):
    """Return begin and end [s] of each episode, and whether it is to be used."""
    with Bag(folder) as bag:
        return [
            ((e.begin_ns - BEGIN_NS) // 10**9, (e.end_ns - BEGIN_NS) // 10**9, not e.is_discarded)
            for e in episodes(bag)
        ]


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_x_begins_and_y_ends_an_episode(tmp_path, plugin):
    """Held buttons count once, those with too few buttons not at all."""
    presses = ["", "x", "x", "", "y", "y", "-", "", "x", "", "y"]
    assert seen(pressed(tmp_path / "bag", presses, plugin)) == [(1, 4, True), (8, 10, True)]


def test_x_again_throws_away_what_was_begun(tmp_path):
    """As the maker's converter does."""
    assert seen(pressed(tmp_path / "bag", ["", "x", "", "x", "", "y"])) == [(1, 3, False), (3, 5, True)]


def test_what_is_still_open_at_the_end_is_not_used(tmp_path):
    """Nor is a button that was held from the begin on."""
    assert seen(pressed(tmp_path / "bag", ["x", "", "x", ""])) == [(2, 3, False)]
    assert seen(pressed(tmp_path / "held", ["x", "y", ""])) == [(0, 2, True)]
