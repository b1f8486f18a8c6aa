"""Tests of bags made of bags: what is copied is the same, what was said of episodes is true, and nothing is left half done."""

from __future__ import annotations

from functools import cache

import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_typestore

from gateway.errors import Rejected
from gateway.recording.bag_check import check
from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import BagWriter, bag_file
from gateway.recording.editing import cut, merge
from gateway.recording.episodes import as_message, episodes
from gateway.recording.topics import EPISODES
from gateway.robot.topics import arm_state
from gateway.values import Side
from tests.recording import bags
from tests.recording.bags import ARM, BEGIN_NS, TOPICS, joints, pressed, said, written

S = 1_000_000_000
LEFT = arm_state(Side.LEFT)
WORDS = (
    said("start", 1, 0.5, task="wave"),
    said("mark", 1, 0.75, text="early"),
    said("stop", 1, 1.5),
    said("start", 2, 2, task="lift"),
    said("stop", 2, 2.5),
    said("failure", 1, 2.75),
)


@cache
def qos(text):
    """Return the QoS of a topic, however it is spelt: a topic's many messages share it."""
    return repr(parse_qos(text))


def parts(folder, *, without=()):
    """Return everything of each message, with the schema and the QoS of its topic."""
    with bag_file(folder).open("rb") as file:
        return [
            (
                channel.topic,
                schema.name,
                schema.data,
                qos(channel.metadata["offered_qos_profiles"]),
                m.log_time,
                m.publish_time,
                m.data,
            )
            for schema, channel, m in make_reader(file).iter_messages()
            if channel.topic not in without
        ]


def made(make, *arguments, **options):
    """Return the bag that something made of the bags in the first argument."""
    folders = arguments[0] if isinstance(arguments[0], list) else [arguments[0]]
    bags = [Bag(folder) for folder in folders]
    try:
        return make(bags if isinstance(arguments[0], list) else bags[0], *arguments[1:], **options)
    finally:
        for bag in bags:
            bag.close()


def test_a_part_holds_the_same_messages(tmp_path):
    """Byte for byte, with both times, types and QoS; what was noted stays; progress is told to the end."""
    folder, shares = written(tmp_path / "bag", task="wave"), []
    found = made(cut, folder, tmp_path / "part", from_s=1.0, to_s=2.0, on_progress=shares.append)
    wanted = [part for part in parts(folder) if BEGIN_NS + S <= part[4] < BEGIN_NS + 2 * S]
    assert (
        sorted(parts(tmp_path / "part"), key=repr) == sorted(wanted, key=repr) and found.messages == len(wanted) > 1000
    )
    assert shares[0] == 0.0 and shares[-1] == 1.0
    with Bag(folder) as bag, Bag(tmp_path / "part") as part:
        assert part.facts() == bag.facts() and episodes(part)[0].task == "wave"
        assert check(part).ok


def test_an_episode_is_cut_out_with_what_was_said_of_it(tmp_path):
    """Also its verdict, which came later; of other episodes nothing. Times count from its begin."""
    folder = written(tmp_path / "bag", words=WORDS)
    assert made(cut, folder, tmp_path / "one", episode=1).episodes == 1
    with Bag(folder) as bag, Bag(tmp_path / "one") as one:
        assert episodes(one) == episodes(bag)[:1]
        assert one.begin_ns == BEGIN_NS + S // 2
    made(cut, folder, tmp_path / "late", episode=1, from_s=0.5)
    with Bag(tmp_path / "late") as late:
        (episode,) = episodes(late)
        assert (episode.begin_ns, episode.end_ns, episode.marks) == (BEGIN_NS + S, BEGIN_NS + 3 * S // 2, ())


def test_an_episode_that_is_cut_begins_and_ends_with_the_part(tmp_path):
    """Task and verdict stay."""
    folder = written(tmp_path / "bag", words=WORDS)
    assert made(cut, folder, tmp_path / "part", from_s=1.0, to_s=2.25).episodes == 2
    with Bag(tmp_path / "part") as part:
        first, second = episodes(part)
    assert (first.begin_ns, first.end_ns, first.outcome) == (BEGIN_NS + S, BEGIN_NS + 3 * S // 2, "failure")
    assert (second.begin_ns, second.end_ns, second.task) == (BEGIN_NS + 2 * S, BEGIN_NS + 9 * S // 4, "lift")


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"from_s": 2.0, "to_s": 1.0}, "nothing lies between 2 s and 1 s"),
        ({"from_s": 9.0}, r"nothing lies between 9 s and 2\.995 s"),
        ({"episode": 7}, "has no episode 7; there are: 1, 2"),
    ],
)
def test_a_part_that_is_not_there_is_refused(tmp_path, options, why):
    """And nothing is left behind."""
    folder = written(tmp_path / "bag", words=WORDS)
    with pytest.raises(Rejected, match=why):
        made(cut, folder, tmp_path / "part", **options)
    assert not (tmp_path / "part").exists()


def test_what_breaks_off_leaves_nothing_behind(tmp_path, monkeypatch):
    """Ctrl-C, a full disk in words; a part without messages; an existing folder is not touched."""
    folder = written(tmp_path / "bag", words=WORDS)

    def broken(error):
        def add(*_):
            raise error

        return add

    for error, raised in ((KeyboardInterrupt(), KeyboardInterrupt), (OSError(28, "No space left on device"), Rejected)):
        with monkeypatch.context() as patch:
            patch.setattr(BagWriter, "add", broken(error))
            with pytest.raises(raised):
                made(cut, folder, tmp_path / "part")
        assert not (tmp_path / "part").exists()
    with pytest.raises(Rejected, match="there is no message in it"):
        made(cut, written(tmp_path / "slow", 1.0), tmp_path / "part", from_s=0.0001, to_s=0.0002)
    with pytest.raises(Rejected, match="is not empty"):
        made(cut, folder, folder)


def other(folder, plugin, type_name="sensor_msgs/msg/JointState", topic=LEFT):
    """Write a bag of another recorder, with two messages."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(folder, version=8, storage_plugin=plugin) as writer:
        connection = writer.add_connection(topic, type_name, typestore=store)
        for n in range(2):
            writer.write(connection, BEGIN_NS + n * S, joints(5))
    return folder


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_bags_of_other_recorders_are_cut(tmp_path, plugin):
    """MCAP and SQLite, of types that are not ours, too: the result opens, with the same bytes and no notes of ours."""
    folder = other(tmp_path / "other", plugin, "sensor_msgs/msg/Imu", "/imu")
    made(cut, folder, tmp_path / "part", to_s=0.5)
    with Bag(folder) as bag, Bag(tmp_path / "part") as part:
        assert list(part.messages()) == list(bag.messages())[:1]
        assert part.topics[0].type_name == "sensor_msgs/msg/Imu" and part.facts() == {}


def test_bags_are_merged_in_the_order_of_arrival(tmp_path):
    """Whichever comes first on the command line; episodes are counted on, topics that only one has are kept."""
    first, both = (
        written(tmp_path / "first", 1.0, words=(said("start", 1, 0.5), said("stop", 1, 0.75))),
        tmp_path / "both",
    )
    made(cut, written(tmp_path / "bag", words=WORDS), tmp_path / "second", from_s=1.0)
    imu = other(tmp_path / "imu", StoragePlugin.SQLITE3, "sensor_msgs/msg/Imu", "/imu")
    assert made(merge, [tmp_path / "second", first, imu], both).episodes == 3
    times = [part[4] for part in parts(both)]
    assert times == sorted(times)
    wanted = sorted(parts(first, without=[EPISODES]) + parts(tmp_path / "second", without=[EPISODES]), key=repr)
    assert sorted(parts(both, without=[EPISODES, "/imu"]), key=repr) == wanted
    with Bag(both) as bag:
        assert [(one.number, one.task) for one in episodes(bag)] == [(1, ""), (2, "wave"), (3, "lift")]
        assert {topic.name: topic.count for topic in bag.topics}["/imu"] == 2


def test_a_bag_without_words_is_one_episode_among_those_of_others(tmp_path):
    """With the task that was noted for it; in words of others alone it would be in none."""
    silent, told = written(tmp_path / "silent", task="bow"), written(tmp_path / "told", words=WORDS)
    assert made(merge, [silent, told], tmp_path / "both").episodes == 3
    with Bag(silent) as one, Bag(tmp_path / "both") as both:
        assert episodes(both)[0] == episodes(one)[0]
        assert [(one.number, one.task) for one in episodes(both)] == [(1, "bow"), (2, "wave"), (3, "lift")]
    assert made(merge, [silent, silent], tmp_path / "twice").episodes == 0


def test_what_buttons_tell_of_is_cut_and_merged_as_what_was_said(tmp_path):
    """In bags of the robot's own recorder: numbered as a dataset numbers them, discarded ones too; from then on words count."""
    marked = pressed(tmp_path / "marked", ["", "x", "", "x", "", "y", "", "x", "y"])
    assert made(cut, marked, tmp_path / "second", episode=2).episodes == 1
    told = written(tmp_path / "told", words=(said("start", 1, 0.5, task="wave"), said("stop", 1, 1.5)))
    assert made(merge, [told, marked], tmp_path / "both").episodes == 4
    with Bag(marked) as bag, Bag(tmp_path / "second") as second, Bag(tmp_path / "both") as both:
        wanted = [(one.begin_ns, one.end_ns, one.is_discarded) for one in episodes(bag)]
        assert len(wanted) == 3 and episodes(second) == episodes(bag)[1:2]
        assert (second.begin_ns, second.end_ns) == (BEGIN_NS + 3 * S, BEGIN_NS + 5 * S + 1)
        found = [(one.begin_ns, one.end_ns, one.is_discarded) for one in episodes(both) if not one.task]
        assert sorted(found) == wanted and [one.task for one in episodes(both)].count("wave") == 1
    with pytest.raises(Rejected, match="has no episode 4; there are: 1, 2, 3"):
        made(cut, marked, tmp_path / "fourth", episode=4)


def test_an_unfinished_episode_ends_with_its_own_bag(tmp_path):
    """Its recorder was killed; what a later bag holds is not of it. One that ends with the whole stays unfinished."""
    killed = written(tmp_path / "killed", 1.0, words=(said("start", 1, 0.5, task="wave"),))
    later = written(tmp_path / "later", 2.0, lambda topic, at_ns, data: (at_ns + 5 * S, data))
    made(merge, [later, killed], tmp_path / "both")
    with Bag(killed) as one, Bag(later) as two, Bag(tmp_path / "both") as both:
        first, second = episodes(both)
        assert (first.task, first.begin_ns, first.end_ns) == ("wave", BEGIN_NS + S // 2, one.end_ns)
        assert (second.begin_ns, second.end_ns) == (two.begin_ns, two.end_ns)
    longer = written(tmp_path / "longer", 3.0, words=(said("start", 1, 1.5),))
    made(merge, [killed, longer], tmp_path / "open")
    with Bag(longer) as bag, Bag(tmp_path / "open") as both:
        assert episodes(both)[1].end_ns == bag.end_ns and not episodes(both)[1].is_finished


def test_what_was_noted_of_several_bags_is_true_of_the_whole(tmp_path):
    """Losses are added up, the smallest distance of clocks counts; a task only where all have it; of one killed no sum."""
    notes = [
        {"model": "lite", "lost": "2", "error": "", "task": "wave", "arrival_minus_stamp_ns/x": "700"},
        {"model": "lite", "lost": "3", "error": "the disk is full", "task": "lift", "arrival_minus_stamp_ns/x": "-5"},
        {"model": "lite", "task": "wave"},
    ]
    folders = []
    for n, facts in enumerate(notes):
        bag = BagWriter(tmp_path / f"bag{n}", TOPICS)
        bag.add(ARM, BEGIN_NS + n, BEGIN_NS + n, joints(1))
        bag.note(facts)
        folders.append(bag.finish().parent)
    made(merge, folders[:2], tmp_path / "two")
    made(merge, folders[::2], tmp_path / "killed")
    with Bag(tmp_path / "two") as two, Bag(tmp_path / "killed") as killed:
        assert two.facts() == {
            "model": "lite",
            "lost": "5",
            "error": "the disk is full",
            "arrival_minus_stamp_ns/x": "-5",
        }
        assert killed.facts()["task"] == "wave" and "lost" not in killed.facts()


def test_a_topic_of_two_types_is_refused_by_its_name(tmp_path):
    """No reader could open the result."""
    folder = other(tmp_path / "other", StoragePlugin.MCAP, "sensor_msgs/msg/Imu")
    with pytest.raises(Rejected, match=rf"{LEFT} is a sensor_msgs/msg/.* in one bag, and a sensor_msgs/msg/"):
        made(merge, [written(tmp_path / "bag"), folder], tmp_path / "both")
    assert not (tmp_path / "both").exists()


def test_episodes_are_not_merged_with_those_of_a_robot_of_another_namespace(tmp_path):
    """A dataset would take the motion of the first for all. Without episodes, or of other recorders, nothing is refused."""

    def noted(name, namespace, *words):
        bag = BagWriter(tmp_path / name, TOPICS)
        bag.add(ARM, BEGIN_NS, BEGIN_NS, joints(1))
        for word in words:
            bag.add(bags.WORDS, word.at_ns, word.at_ns, as_message(word))
        bag.note({"namespace": namespace})
        return bag.finish().parent

    words = (said("start", 1, 0.5), said("stop", 1, 1.0))
    told, same, silent = noted("told", "one", *words), noted("same", "/one", *words), noted("silent", "")
    for n, pair in enumerate(([told, silent], [silent, told], [silent, noted("two", "two", *words)])):
        with pytest.raises(Rejected, match=r"the namespaces of the robots are none and (one|two): "):
            made(merge, pair, tmp_path / f"both{n}")
        assert not (tmp_path / f"both{n}").exists()
    imu = other(tmp_path / "imu", StoragePlugin.SQLITE3, "sensor_msgs/msg/Imu", "/imu")
    assert made(merge, [told, same, imu], tmp_path / "alike").episodes == 2
    assert made(merge, [silent, noted("third", "three")], tmp_path / "quiet").episodes == 0
