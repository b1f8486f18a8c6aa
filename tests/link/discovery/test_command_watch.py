"""Command topics that the robot stops listening to, by tokens alone and in virtual time."""

from __future__ import annotations

from gateway.errors import Code
from gateway.link.discovery.command_watch import LOST_AFTER_NS, CommandWatch

ROBOT, HOST = "aa", "bb"
ENABLE, LEFT = "/api/fsm/enable", "/api/left_arm/joint_cmd"
BOTH = {ENABLE: {ROBOT}, LEFT: {ROBOT}}
MS = 1_000_000


def test_topics_that_were_listened_to_and_are_no_more_are_lost_and_told_once() -> None:
    """All together in one sentence with the remedy, although the bridge itself announces nothing any more either."""
    watch = CommandWatch()
    assert watch.observe(0, BOTH, {ROBOT}) is None
    assert watch.observe(1, {}, ()) is None
    assert watch.observe(LOST_AFTER_NS, {}, ()) is None, "half a second is not over"
    seen = watch.observe(LOST_AFTER_NS + 1, {}, ())
    assert seen is not None and seen.code is Code.ROUTE_LOST and seen.topic == ENABLE
    assert ENABLE in seen.message and LEFT in seen.message and "Restart" in seen.message
    assert watch.observe(2 * LOST_AFTER_NS, {}, ()) is None


def test_a_short_absence_is_no_loss() -> None:
    """A node that leaves and comes back in time: nothing is told, and the next absence is measured anew."""
    watch = CommandWatch()
    for at_ns, listening in ((0, BOTH), (1, {}), (400 * MS, BOTH), (600 * MS, {}), (1000 * MS, {})):
        assert watch.observe(at_ns, listening, {ROBOT}) is None


def test_what_nobody_ever_listened_to_is_not_lost() -> None:
    """A robot without a lift, and a subscriber behind somebody's host bridge, are none of it."""
    watch = CommandWatch()
    watch.observe(0, {ENABLE: {ROBOT, HOST}, LEFT: {HOST}}, {ROBOT})
    watch.observe(1, {ENABLE: {HOST}}, {ROBOT})
    seen = watch.observe(LOST_AFTER_NS + 1, {ENABLE: {HOST}}, {ROBOT})
    assert seen is not None and ENABLE in seen.message and LEFT not in seen.message


def test_a_topic_that_is_lost_later_is_told_with_the_others() -> None:
    """A growing loss is told again; a shrinking one is said to be over for what came back."""
    watch = CommandWatch()
    watch.observe(0, BOTH, {ROBOT})
    watch.observe(1, {LEFT: {ROBOT}}, {ROBOT})
    first = watch.observe(600 * MS, {LEFT: {ROBOT}}, {ROBOT})
    assert first is not None and LEFT not in first.message
    watch.observe(700 * MS, {}, {ROBOT})
    second = watch.observe(1300 * MS, {}, {ROBOT})
    assert second is not None and second.code is Code.ROUTE_LOST and LEFT in second.message
    third = watch.observe(1400 * MS, {LEFT: {ROBOT}}, {ROBOT})
    assert third is not None and third.code is None and third.message == f"the robot listens again to {LEFT}"
    last = watch.observe(1500 * MS, BOTH, {ROBOT})
    assert last is not None and last.code is None and ENABLE in last.message


def test_another_transport_begins_anew() -> None:
    """What another robot listened to is not missed on this one."""
    watch = CommandWatch()
    watch.observe(0, BOTH, {ROBOT})
    watch.forget()
    assert watch.observe(1, {}, ()) is None and watch.observe(LOST_AFTER_NS + 1, {}, ()) is None
