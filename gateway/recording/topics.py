"""What is recorded: every topic of the robot's model, of the gateway, policies and episodes; with types, definitions and QoS.

A bag holds the names that ROS would show: `/left_arm/joint_states`, under the namespace of the robot's bridge if it has one.
"""

from __future__ import annotations

from msgspec import Struct

from cdr_types import CdrError, decode, encode
from cdr_types.keys import topic_to_key
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Float32
from cdr_types.schemas import ENCODING
from gateway.robot.topics import STATE_TOPICS, TOPICS, Direction, gripper_command, joint_command, pose_command
from gateway.robot.vector_layout import effort_of_command
from gateway.settings.settings import LinkSettings
from gateway.values import Side

__all__ = [
    "CONTACT",
    "EPISODES",
    "EVENTS",
    "GATEWAY",
    "NEVER_NS",
    "POLICY",
    "QOS",
    "STALE_NS",
    "RecordedTopic",
    "as_alias",
    "gap_ns",
    "recorded_topics",
]

EVENTS = "/ta2/events"
"""Notices of the gateway, as JSON: who owns the robot, what was refused, stopped, lost, and why."""
GATEWAY = "/ta2/gateway"
"""State, owner and latches of the gateway, as JSON, whenever one of them has changed."""
CONTACT = "/ta2/contact"
"""What pulls at each arm, as JSON (`ContactView`), ten times a second where the gateway estimates it."""
POLICY = "/ta2/policy"
"""What a policy wanted that somebody played, and what became of each chunk, as JSON; see docs/how-to/policy.md."""
EPISODES = "/ta2/episodes"
"""What the users of a recorder said: when an episode began and ended, what came of it; see `episodes.EpisodeEvent`."""
GAP_PERIODS = 5
LEAST_GAP_NS = 100_000_000
STALE_NS = 200_000_000
"""An older sample says nothing of now, and no row spans a longer silence [ns]: a state is sent forty times in it (§4.1.1)."""
NEVER_NS = 2**62
"""Longer than anything lasts [ns]."""
TEXT = "std_msgs/msg/String"
"""JSON in a message of its own type, since `ros2 bag` plays no file with two serialisations."""

QOS = """\
- history: 1
  depth: 10
  reliability: 1
  durability: 2
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: 1
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false
"""
"""Keep last 10, reliable, volatile, as all of them are (manual §4.1.1): rmw's numbers, in the form of rosbag2's version 5."""


class RecordedTopic(Struct, frozen=True, kw_only=True):
    """A topic of a bag.

    Attributes:
        name: ROS name with the leading slash and the namespace.
        type_name: ROS type.
        key: zenoh key; empty for what does not come from the robot.
        is_state: Whether the robot publishes it.
        is_stamped: Whether its messages begin with a header.
        rate_hz: Nominal rate; 0 where there is none.
        alias_of: Topic that it repeats under another name; empty for most.
        definition: Of a type that others defined, as its bag has it; empty for ours.
        encoding: Language of that.
        qos: As it is offered, in the form of rosbag2's version 5.
    """

    name: str
    type_name: str
    key: str = ""
    is_state: bool = False
    is_stamped: bool = False
    rate_hz: float = 0.0
    alias_of: str = ""
    definition: str = ""
    encoding: str = ENCODING
    qos: str = QOS


def gap_ns(rate_hz: float) -> int:
    """Return after how long a silence of a topic counts as a gap [ns]: five of its periods, and 0.1 s.

    Args:
        rate_hz: Nominal rate; 0 for a topic that may be silent for ever.
    """
    return max(LEAST_GAP_NS, int(GAP_PERIODS * 1e9 / rate_hz)) if rate_hz else NEVER_NS


ALIASES = {
    name: f"/{side}_{end}"
    for side in Side
    for name, end in (
        (joint_command(side), "arm/joint_cmd"),
        (pose_command(side), "arm/target_ee_pose"),
        (gripper_command(side), "gripper/joint_cmd"),
    )
}
"""What is commanded, by the names that it has inside the robot: its maker's converter of bags knows no others."""


def as_alias(topic: RecordedTopic, payload: bytes) -> bytes | None:
    """Return a message as its topic's alias has it: a gripper's command as torque [N·m] (manual §4.4), None for no command."""
    if topic.type_name != "std_msgs/msg/Float32":
        return payload
    try:
        effort_nm = effort_of_command(decode(payload, Float32).data)
    except (CdrError, ValueError):
        return None
    return encode(JointState(position=[0.0], velocity=[0.0], effort=[effort_nm]))


def recorded_topics(settings: LinkSettings, *, aliases: bool = False) -> tuple[RecordedTopic, ...]:
    """Return everything that is recorded of a robot, states first.

    Args:
        settings: Model and namespace.
        aliases: Whether commands are there under their names inside the robot, too, at the end.
    """
    robots = []
    for name in (*STATE_TOPICS, *settings.variant.command_topics):
        topic, key = TOPICS[name], topic_to_key(name, settings.namespace)
        robots.append(
            RecordedTopic(
                name=f"/{key}",
                type_name=topic.type_name,
                key=key,
                is_state=topic.direction is Direction.STATE,
                is_stamped=topic.type_name == "sensor_msgs/msg/JointState",
                rate_hz=topic.rate_hz if topic.direction is Direction.STATE else 0.0,
            )
        )
    own = [RecordedTopic(name=name, type_name=TEXT) for name in (EVENTS, GATEWAY, CONTACT, POLICY, EPISODES)]
    again = []
    for name, alias in ALIASES.items() if aliases else ():
        kind = "sensor_msgs/msg/JointState" if "gripper" in alias else TOPICS[name].type_name
        mine, its = (f"/{topic_to_key(one, settings.namespace)}" for one in (alias, name))
        if its in {topic.name for topic in robots}:
            again.append(RecordedTopic(name=mine, type_name=kind, alias_of=its))
    return (*robots, *own, *again)
