"""Duplication: a bridge that delivers every sample several times is told once for each count."""

from __future__ import annotations

from gateway.core.messages.events import SampleArrived
from gateway.core.robot_state.duplication import WINDOW_SAMPLES, Duplication
from gateway.robot.topics import arm_state
from gateway.values import Side

LEFT, RIGHT = (arm_state(side) for side in Side)


def arrivals(duplication: Duplication, duplicates: int, topic: str = LEFT, samples: int = WINDOW_SAMPLES) -> list[str]:
    """Let samples arrive in pairs, each with so many duplicates; return what was told."""
    event = SampleArrived(topic=topic, value=0, received_ns=0, count=2, duplicates=2 * duplicates)
    return [told for _ in range(samples // 2) if (told := duplication.note(event))]


def test_every_sample_three_times_is_told_once_with_the_count():
    """STATE_DUPLICATED with N, however long it lasts and on however many topics."""
    duplication = Duplication()
    (told,) = arrivals(duplication, 2)
    assert f"{LEFT} 3 times" in told and "restart the robot's bridge" in told
    assert arrivals(duplication, 2) + arrivals(duplication, 2, RIGHT) == []


def test_a_higher_count_is_told_again():
    """The count grows with each restart of somebody's bridge."""
    duplication = Duplication()
    assert len(arrivals(duplication, 1)) == 1
    assert "4 times" in arrivals(duplication, 3)[0]
    assert arrivals(duplication, 1) == []


def test_a_retransmission_is_no_duplication():
    """A few duplicates in a window are a network at work."""
    duplication = Duplication()
    burst = SampleArrived(topic=LEFT, value=0, received_ns=0, count=1, duplicates=20)
    assert duplication.note(burst) == "" and arrivals(duplication, 0) == []


def test_a_bridge_in_order_is_never_judged():
    """Samples that arrive once, of a topic that never had duplicates, are not even counted."""
    duplication = Duplication()
    assert arrivals(duplication, 0, samples=10 * WINDOW_SAMPLES) == [] and not duplication._seen


def test_less_than_a_window_is_not_judged():
    """One sample that came twice says nothing."""
    assert arrivals(Duplication(), 5, samples=WINDOW_SAMPLES - 2) == []


def test_after_a_reset_it_is_told_again():
    """Another transport, perhaps another bridge."""
    duplication = Duplication()
    arrivals(duplication, 1)
    arrivals(duplication, 1, samples=100)
    duplication.reset()
    assert len(arrivals(duplication, 1)) == 1
