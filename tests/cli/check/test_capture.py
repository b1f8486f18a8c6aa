"""What came is kept for as long as a trial needs it, and not for as long as a person thinks."""

from __future__ import annotations

from gateway.cli.check.capture import KEPT, Capture
from gateway.robot.topics import FSM_STATE


def test_of_each_topic_the_newest_are_kept() -> None:
    """While somebody is asked whether the robot may move, messages come and come."""
    capture = Capture([FSM_STATE])
    for at_ns in range(KEPT + 10):
        capture.take(0, at_ns, b"")
    kept = capture.arrivals(FSM_STATE)
    assert len(kept) == KEPT and kept[-1][0] == KEPT + 9
