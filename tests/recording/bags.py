"""Bags for tests: a robot that says so much, written by our writer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from cdr_types import encode, message_type
from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Header
from gateway.recording.bag_writer import BagWriter
from gateway.recording.episodes import BUTTONS, EpisodeEvent, EventName, as_message
from gateway.recording.topics import EPISODES, RecordedTopic, recorded_topics
from gateway.robot.topics import arm_state, ee_pose
from gateway.settings.settings import LinkSettings
from gateway.values import Side

BEGIN_NS = 1_790_000_000_000_000_000
TOPICS = recorded_topics(LinkSettings())
ARM = next(n for n, topic in enumerate(TOPICS) if topic.name == arm_state(Side.LEFT))
POSE = next(n for n, topic in enumerate(TOPICS) if topic.name == ee_pose(Side.LEFT))
"""Numbers of a topic with stamps, and of one without."""
WORDS = next(n for n, topic in enumerate(TOPICS) if topic.name == EPISODES)


def joints(stamp_ns: int, width: int = 7, value: float = 0.5) -> bytes:
    """Return a JointState."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    values = [value] * width
    return encode(
        JointState(header=Header(stamp=Time(sec=sec, nanosec=nanosec)), position=values, velocity=values, effort=values)
    )


def payload(topic: RecordedTopic, stamp_ns: int) -> bytes:
    """Return a message of a topic."""
    return joints(stamp_ns) if topic.is_stamped else encode(message_type(topic.type_name)())


Change = Callable[[RecordedTopic, int, bytes], "tuple[int, bytes] | None"]
"""What becomes of a message: topic, arrival [ns], payload in; another arrival and payload out, or None for nothing."""


def said(event: EventName, episode: int, after_s: float, **fields: str) -> EpisodeEvent:
    """Return what was said of an episode so long after the begin [s]."""
    return EpisodeEvent(event=event, episode=episode, at_ns=BEGIN_NS + int(after_s * 1e9), **fields)


def written(
    folder: Path,
    seconds: float = 3.0,
    change: Change = lambda topic, at_ns, data: (at_ns, data),
    words: Sequence[EpisodeEvent] = (),
    task: str = "",
) -> Path:
    """Write a bag of a robot's whole state, and return its folder.

    Args:
        folder: Of the bag.
        seconds: How long [s].
        change: Applied to each message.
        words: What is said of episodes.
        task: Noted for the whole.
    """
    bag = BagWriter(folder, TOPICS)
    rows = []
    for number, topic in enumerate(TOPICS):
        if topic.rate_hz:
            for n in range(int(seconds * topic.rate_hz)):
                rows.append((int(n * 1e9 / topic.rate_hz), number))  # noqa: PERF401
    waiting = sorted(words, key=lambda word: word.at_ns)
    for after_ns, number in sorted(rows):
        while waiting and waiting[0].at_ns <= BEGIN_NS + after_ns:
            word = waiting.pop(0)
            bag.add(WORDS, word.at_ns, word.at_ns, as_message(word))
        topic, at_ns = TOPICS[number], BEGIN_NS + after_ns
        changed = change(topic, at_ns, payload(topic, at_ns - 1_000_000))
        if changed is not None:
            bag.add(number, changed[0], changed[0], changed[1])
    for word in waiting:
        bag.add(WORDS, word.at_ns, word.at_ns, as_message(word))
    bag.note({"model": "standard", "namespace": "", "lost": "0"} | ({"task": task} if task else {}))
    bag.finish()
    return folder


def pressed(folder: Path, presses: Sequence[str], plugin: StoragePlugin = StoragePlugin.MCAP) -> Path:
    """Write a bag of the robot's own recorder, and return its folder.

    Args:
        folder: Of the bag.
        presses: The buttons that are held, second by second: of `x` and `y`; `-` for a message with too few of them.
        plugin: How it is stored.
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    with Writer(folder, version=8, storage_plugin=plugin) as writer:
        states = writer.add_connection(arm_state(Side.LEFT), "sensor_msgs/msg/JointState", typestore=store)
        joy = writer.add_connection(BUTTONS, "sensor_msgs/msg/Joy", typestore=store)
        for n, held in enumerate(presses):
            buttons = np.array([0, 0, int("x" in held), int("y" in held)] if held != "-" else [1], np.int32)
            message = store.types["sensor_msgs/msg/Joy"](header=header, axes=np.zeros(0, np.float32), buttons=buttons)
            writer.write(joy, BEGIN_NS + n * 10**9, store.serialize_cdr(message, "sensor_msgs/msg/Joy"))
            writer.write(states, BEGIN_NS + n * 10**9, joints(1))
    return folder
