"""Rules of `gateway.link.discovery.route_watch`: when a silent route is dead or lost, and how often to revive it."""

from __future__ import annotations

import pytest

from gateway.errors import Code
from gateway.link.discovery.route_watch import GONE_NS, MAX_REVIVALS, REVIVAL_WINDOW_NS, Evidence, RouteWatch
from gateway.robot.topics import CURRENT_MODE, FSM_STATE, TOPICS, arm_state
from gateway.values import Side

MS = 1_000_000
S = 1_000_000_000
ARM = TOPICS[arm_state(Side.LEFT)]
MODE = TOPICS[CURRENT_MODE]
DEAD = Evidence(has_reader=False)


@pytest.fixture
def watch() -> RouteWatch:
    """A watch on a fast topic."""
    return RouteWatch(ARM)


def test_a_route_that_delivers_is_never_talked_about(watch):
    """Samples come, announced or not: nothing to report."""
    for at_ns in range(0, 10 * S, 250 * MS):
        assert watch.observe(at_ns, 0, at_ns, is_announced=at_ns % S == 0) is None
    assert watch.code is None


@pytest.mark.parametrize(("topic", "limit_ns"), [(ARM, 500 * MS), (TOPICS[FSM_STATE], 500 * MS), (MODE, 3 * S)])
def test_silence_is_half_a_second_or_three_periods(topic, limit_ns):
    """A 1 Hz topic is not silent between two samples."""
    watch = RouteWatch(topic)
    assert not watch.is_silent(10 * S + limit_ns, 0, 10 * S)
    assert watch.is_silent(10 * S + limit_ns + 1, 0, 10 * S)


def test_a_fresh_connection_gets_two_seconds(watch):
    """First data may take a moment (wire.md 2.2); samples of the connection before do not count."""
    for newest_ns in (None, 4 * S):
        assert not watch.is_silent(7 * S, 5 * S, newest_ns)
        assert watch.is_silent(7 * S + 1, 5 * S, newest_ns)


def lose(watch, at_ns, newest_ns):
    """Let a topic be without announcement until it is called lost; return what is said then."""
    assert watch.observe(at_ns - GONE_NS, 0, newest_ns, is_announced=False) is None
    assert watch.observe(at_ns - 1, 0, newest_ns, is_announced=False) is None
    return watch.observe(at_ns, 0, newest_ns, is_announced=False)


def test_silence_without_an_announcement_is_a_lost_route(watch):
    """State dead, transport up, tokens gone: ROUTE_LOST, said once, with the remedy (wire.md 3.1 b2)."""
    seen = lose(watch, 3 * S, 2 * S)
    assert (seen.topic, seen.code, seen.at_ns) == (ARM.name, Code.ROUTE_LOST, 3 * S)
    assert "Restart" in seen.message
    assert watch.observe(4 * S, 0, 2 * S, is_announced=False) is None
    assert watch.code is Code.ROUTE_LOST


def test_the_end_of_a_transport_is_no_lost_route(watch):
    """It takes the tokens away before it is told, the next one brings them after: the half second counts on one transport."""
    assert watch.observe(3 * S, 0, 2 * S, is_announced=False) is None
    for at_ns, up_since_ns in ((3 * S + 250 * MS, 0), (3 * S + 500 * MS, 3 * S + 300 * MS)):
        assert watch.observe(at_ns, up_since_ns, 2 * S, is_announced=False) is None
    assert watch.observe(3 * S + 750 * MS, 3 * S + 300 * MS, 2 * S, is_announced=True) is None
    assert watch.observe(7 * S, 3 * S + 300 * MS, 2 * S, is_announced=False) is None, (
        "announced meanwhile: counted anew"
    )
    assert watch.code is None


@pytest.mark.parametrize("topic", [ARM, MODE])
def test_what_was_never_announced_since_the_transport_opened_is_no_lost_route(topic):
    """A part that is switched off announces nothing (§2.7.1): neither at the first connect, nor after another robot's."""
    watch = RouteWatch(topic)
    for at_ns in range(0, 20 * S, 250 * MS):
        assert watch.observe(at_ns, 0, None, is_announced=False) is None
    assert watch.code is None
    assert watch.observe(20 * S, 0, None, is_announced=True) is None
    for at_ns in range(20 * S + 250 * MS, 21 * S - 250 * MS, 250 * MS):
        assert watch.observe(at_ns, 0, None, is_announced=False) is None, "it came late, and may be starting anew"
    seen = watch.observe(21 * S, 0, None, is_announced=False)
    assert seen is not None and seen.code is Code.ROUTE_LOST and watch.code is Code.ROUTE_LOST, "it had been there"
    for at_ns in range(30 * S, 40 * S, 250 * MS):
        assert watch.observe(at_ns, 30 * S, None, is_announced=False) is None
    assert watch.code is None, "never there on this transport"


def test_a_route_that_comes_late_is_alive_and_lost_when_it_goes(watch):
    """Absent at connect, then announced with samples, then silent without a token."""
    assert watch.observe(9 * S, 0, None, is_announced=False) is None
    assert watch.observe(10 * S, 0, 10 * S, is_announced=True) is None
    seen = lose(watch, 12 * S, 10 * S)
    assert seen.code is Code.ROUTE_LOST
    assert watch.observe(20 * S, 15 * S, 10 * S, is_announced=False) is None
    assert watch.observe(25 * S, 15 * S, 10 * S, is_announced=False) is None and watch.code is None
    seen = watch.observe(26 * S, 15 * S, 26 * S, is_announced=True)
    assert seen is not None and seen.code is None, "what was told is over"


def test_a_route_that_delivers_again_is_told_once(watch):
    """After a loss the first new sample ends the observation."""
    lose(watch, 3 * S, 2 * S)
    seen = watch.observe(5 * S, 0, 5 * S - 1, is_announced=True)
    assert (seen.code, seen.topic) == (None, ARM.name)
    assert watch.observe(6 * S, 0, 6 * S, is_announced=True) is None


def test_a_reconnect_alone_does_not_clear_a_loss(watch):
    """Until the first sample of the new connection nothing is known."""
    lose(watch, 3 * S, 2 * S)
    assert watch.observe(4 * S, 4 * S - 1, 2 * S, is_announced=True) is None
    assert watch.code is Code.ROUTE_LOST


def test_a_silent_announced_route_without_a_reader_is_dead_and_revived(watch):
    """State dead, transport up, tokens there, no DDS reader: ROUTE_DEAD, and the subscription is declared again."""
    assert watch.observe(3 * S, 0, 2 * S, is_announced=True) is None
    seen, may_revive = watch.judge(3 * S, DEAD)
    assert (seen.code, may_revive) == (Code.ROUTE_DEAD, True)
    assert "restart the robot's bridge" in seen.message


def test_the_remedy_names_who_else_subscribes(watch):
    """Re-declaring does nothing while somebody else subscribes (wire.md 3.1 b): a person must know whom to ask."""
    seen, _ = watch.judge(3 * S, Evidence(has_reader=False, others=("abc at tcp/10.0.0.7:5000", "def")))
    assert "abc at tcp/10.0.0.7:5000, def" in seen.message


def test_a_route_with_a_reader_is_not_dead(watch):
    """The robot's node is silent by itself: re-declaring would only load the bridge."""
    assert watch.judge(3 * S, Evidence(has_reader=True)) == (None, False)
    assert watch.code is None


def test_a_revived_route_whose_node_is_silent_is_no_longer_dead(watch):
    """The reader is back: what is missing now is not the route's fault."""
    watch.judge(3 * S, DEAD)
    seen, may_revive = watch.judge(5 * S, Evidence(has_reader=True))
    assert (seen.code, may_revive) == (None, False)
    assert "silent" in seen.message


def test_an_unreadable_admin_space_means_unknown(watch):
    """No answer is no evidence: nothing is said, nothing is done (wire.md 5.2)."""
    assert watch.judge(3 * S, Evidence(has_reader=None)) == (None, False)
    watch.judge(4 * S, DEAD)
    assert watch.judge(9 * S, Evidence(has_reader=None)) == (None, False)
    assert watch.code is Code.ROUTE_DEAD


def revivals(watch, until_ns, *, flapping: bool) -> list[int]:
    """Return when the watch asks for a revival of a route that stays dead, or delivers for a moment in between."""
    times = []
    for now_ns in range(0, until_ns, 250 * MS):
        if watch.wants_evidence(now_ns):
            _, may_revive = watch.judge(now_ns, DEAD)
            if may_revive:
                times.append(now_ns)
                if flapping:
                    watch.observe(now_ns, -1, now_ns, is_announced=True)
    return times


def test_attempts_back_off(watch):
    """2, 6, 18 s, then a minute: fast create and destroy of a subscriber degrades the bridge (wire.md 3.1 g)."""
    assert revivals(watch, 100 * S, flapping=False) == [0, 2 * S, 8 * S, 26 * S, 80 * S]


@pytest.mark.parametrize("flapping", [False, True])
def test_never_more_than_four_revivals_a_minute(watch, flapping):
    """Not even when the route delivers a sample after each of them and the back-off begins anew."""
    times = revivals(watch, 600 * S, flapping=flapping)
    assert len(times) >= MAX_REVIVALS
    for first, later in zip(times, times[MAX_REVIVALS:], strict=False):
        assert later - first >= REVIVAL_WINDOW_NS


def test_a_healthy_route_is_looked_up_every_five_seconds_at_most(watch):
    """The admin space of a robot whose node is silent is not asked four times a second."""
    looks = 0
    for now_ns in range(0, 60 * S, 250 * MS):
        if watch.wants_evidence(now_ns):
            looks += 1
            watch.judge(now_ns, Evidence(has_reader=True))
    assert looks == 12
