"""Bags of a robot that moves in a way that is known at every instant, heard over a network that is late now and then."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import numpy as np

from cdr_types import encode
from cdr_types.messages.builtin_interfaces import Time
from cdr_types.messages.geometry_msgs import Point, Pose, Quaternion
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Float32, Header
from gateway.recording.bag_writer import BagWriter
from gateway.recording.topics import RecordedTopic
from gateway.robot.topics import COMMAND_TOPICS, ee_pose, gripper_command
from gateway.values import Side
from gateway.video.recording.index import index_path, read_index
from gateway.video.recording.take import Take
from tests.recording.bags import BEGIN_NS, TOPICS
from tests.video.coded import units

OWN = """
[[feature]]
name = "observation.state"
[[feature.part]]
names = ["a", "b", "c"]
unit = "rad"
source = [{ topic = "/left_arm/joint_states", field = "position", rule = "linear" }]
[[feature]]
name = "action"
[[feature.part]]
names = ["a", "b", "c"]
unit = "rad"
source = [{ topic = "/api/left_arm/joint_cmd", field = "position" }]
"""
"""A layout: three joints, and what they were told."""
CLOCK_NS = 5_000_000_000
"""The robot's clock is so far behind [ns]."""
DELAY_NS = 1_000_000
"""From the robot's stamp to its arrival, where nothing is late [ns]."""
COMMANDED = ("/api/left_arm/joint_cmd", "/api/right_arm/joint_cmd", *(gripper_command(side) for side in Side))


def position(name: str, joint: int, t_s: float) -> float:
    """Return where a joint is [rad], t after the bag's begin."""
    return 0.4 * math.sin(1.3 * t_s + joint + (0.5 if "right" in name else 0.0))


def angle(t_s: float) -> float:
    """Return how far a hand is turned about z [rad]."""
    return 0.8 * math.sin(0.9 * t_s)


def grip(t_s: float) -> float:
    """Return a gripper's command 0..1."""
    return 0.5 + 0.5 * math.sin(t_s)


NAMESPACE = "robot1"


def payload(topic: RecordedTopic, t_s: float, stamp_ns: int) -> bytes | None:
    """Return what the robot, or who commands it, says at a time; nothing on topics that nobody uses."""
    name = topic.name.removeprefix(f"/{NAMESPACE}")
    if name in COMMAND_TOPICS and name not in COMMANDED:
        return None
    if topic.type_name == "sensor_msgs/msg/JointState":
        width = 3 if "chassis" in name else 1 if "gripper" in name else 7
        sec, nanosec = divmod(stamp_ns, 1_000_000_000)
        values = [position(name, joint, t_s) for joint in range(width)]
        zeros = [0.0] * width
        return encode(
            JointState(
                header=Header(stamp=Time(sec=sec, nanosec=nanosec)), position=values, velocity=zeros, effort=zeros
            )
        )
    if name in {ee_pose(side) for side in Side}:
        half = angle(t_s) / 2
        turn = Quaternion(x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
        return encode(Pose(position=Point(x=t_s, y=0.1, z=0.2), orientation=turn))
    if name in COMMANDED:
        return encode(Float32(data=grip(t_s)))
    return None


Change = Callable[[RecordedTopic, float], bool]
"""Whether a message is in the bag: topic, seconds after the begin."""


def moving(
    folder: Path,
    seconds: float = 3.0,
    is_there: Change = lambda topic, t_s: True,
    more: Sequence[tuple[RecordedTopic, int, bytes]] = (),
    facts: dict[str, str] | None = None,
    topics: Sequence[RecordedTopic] = TOPICS,
    late_ns: int = 4_000_000,
    clock_ns: int = CLOCK_NS,
) -> Path:
    """Write a bag, and return its folder.

    Args:
        folder: Of the bag.
        seconds: How long [s].
        is_there: What is in it.
        more: Topics, times after the begin [ns] and messages that are in it, too.
        facts: Noted in it.
        topics: Of the robot.
        late_ns: Messages are late by up to so much [ns], but for the first of each topic.
        clock_ns: The robot's clock is so far behind [ns]; what it is told has the stamps of this host.
    """
    every = [*topics, *(topic for topic in dict.fromkeys(topic for topic, _, _ in more) if topic not in topics)]
    random, rows = np.random.default_rng(3), []
    for number, topic in enumerate(topics):
        rate_hz = topic.rate_hz or 100.0
        for n in range(int(seconds * rate_hz)):
            t_s = n / rate_hz
            at_ns = BEGIN_NS + round(t_s * 1e9)
            data = payload(topic, t_s, at_ns - clock_ns - DELAY_NS if topic.is_state else at_ns)
            if data is not None and is_there(topic, t_s):
                is_late = n > 0 and topic.is_stamped and topic.is_state and late_ns > 0
                late = int(random.integers(0, late_ns)) if is_late else 0
                rows.append((at_ns + late, number, data))
    rows += [(BEGIN_NS + after_ns, every.index(topic), data) for topic, after_ns, data in more]
    bag = BagWriter(folder, every)
    for at_ns, number, data in sorted(rows):
        bag.add(number, at_ns, at_ns, data)
    bag.note({"model": "standard", "namespace": "", "task": "wave", "lost": "0"} | (facts or {}))
    bag.finish()
    return folder


COUNT = 80
PERIOD_NS = round(1e9 / 45.0)
FIRST_NS = BEGIN_NS + 100_000_000
"""How many pictures there are, how far apart, and when the first one arrived."""


def taken(path, change=lambda picture: picture, count=COUNT):
    """Record pictures that count, from a tenth of a second after the bag's begin on; return the file."""
    take = Take(path)
    for unit in units(count):
        take.write(unit)
    take.end("it was ended")
    index = read_index(index_path(path))
    lines = [index.header]
    for picture in index.pictures:
        lines.append(change(msgspec.structs.replace(picture, arrival_wall_ns=FIRST_NS + picture.n * PERIOD_NS)))  # noqa: PERF401
    index_path(path).write_bytes(b"".join(msgspec.json.encode(line) + b"\n" for line in [*lines, index.end]))
    return path


def filmed(folder, name, change=lambda picture: picture, count=COUNT, seconds=2.0, **more):
    """Return a bag with a recording of the cameras in its folder."""
    bag = moving(folder / name, seconds, **more)
    taken(bag / "video.mkv", change, count)
    return bag
