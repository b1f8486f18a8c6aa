"""Tests of what is recorded."""

from __future__ import annotations

import pytest

from gateway.recording.topics import CONTACT, EPISODES, EVENTS, GATEWAY, NEVER_NS, POLICY, gap_ns, recorded_topics
from gateway.robot.topics import STATE_TOPICS, TOPICS, VARIANTS
from gateway.settings.settings import LinkSettings


@pytest.mark.parametrize("model", VARIANTS)
def test_every_topic_of_the_model_is_recorded_and_the_gateways_own(model):
    """States first; a lift's command only where there is a lift."""
    topics = recorded_topics(LinkSettings(model=model))
    names = [topic.name for topic in topics]
    assert names == [*STATE_TOPICS, *VARIANTS[model].command_topics, EVENTS, GATEWAY, CONTACT, POLICY, EPISODES]
    assert [topic.name for topic in topics if topic.is_state] == list(STATE_TOPICS)
    assert all(topic.type_name == TOPICS[topic.name].type_name for topic in topics if topic.key)
    assert {topic.rate_hz for topic in topics if not topic.is_state} == {0.0}


def test_names_have_the_namespace_of_the_robots_bridge():
    """As ROS would show them there; the gateway's have none."""
    topics = recorded_topics(LinkSettings(namespace="/lab/seven"))
    assert topics[0].name == f"/lab/seven{STATE_TOPICS[0]}" and topics[0].key == topics[0].name[1:]
    assert topics[-1].name == EPISODES and not topics[-1].key


def test_only_messages_with_a_header_have_a_stamp():
    """A pose has none (manual §4.0.2)."""
    assert {t.type_name for t in recorded_topics(LinkSettings()) if t.is_stamped} == {"sensor_msgs/msg/JointState"}


def test_a_gap_is_five_periods_and_a_tenth_of_a_second():
    """A command may be silent for ever."""
    assert [gap_ns(rate_hz) for rate_hz in (200.0, 20.0, 1.0)] == [100_000_000, 250_000_000, 5_000_000_000]
    assert gap_ns(0.0) == NEVER_NS
