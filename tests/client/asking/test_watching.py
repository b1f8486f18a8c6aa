"""Tests of watching: states at a rate, fresh ones, notices with honest gaps; across restarts, until the client is closed."""

from __future__ import annotations

import asyncio
import itertools

import pytest

from gateway.client import aio, connect
from gateway.client.connection.news import KEPT
from gateway.core.messages.outputs import Level, Notice
from gateway.errors import Code, Disconnected, GatewayTimeout, Rejected, Stale
from gateway.messages.snapshot import LinkView
from tests.api.stand_in import a_snapshot
from tests.client.test_aio import play

DAEMONS = itertools.count(1)


def tell(world, *messages):
    """Let the engine tell something."""
    world.engine.notices += [
        Notice(code=Code.LINK_UP, level=Level.INFO, message=message, at_ns=n, facts={"a": "b"})
        for n, message in enumerate(messages)
    ]
    world.run(0.02)


def restart(world, gone_s=0.0):
    """Put another daemon in the place of the first."""
    world.plane.set_reachable(False)
    world.run(gone_s)
    world.plane._daemon_id = f"daemon-{next(DAEMONS)}"
    world.engine.snapshot = a_snapshot(seq=0, state="OFFLINE")
    world.plane._outbox._told = 0
    world.plane.set_reachable(True)


# ------------------------------------------------------------------------------------------------------- states


def test_states_are_new_ones_at_most_at_the_rate_asked_for(world, robot):
    """states() yields rising numbers, not faster than asked."""
    states = robot.states(max_rate=10.0)
    before_ns = world.time_ns
    seqs = [next(states).seq for _ in range(11)]
    assert seqs == sorted(set(seqs))
    assert (world.time_ns - before_ns) / 1e9 == pytest.approx(1.0, abs=0.05)


def test_a_rate_below_the_timeout_is_no_timeout(world, robot):
    """Whoever wants a state every ten seconds waits for it, although five without any would be too long."""
    states = robot.states(max_rate=0.1, timeout=5.0)
    next(states)
    before_ns = world.time_ns
    next(states)
    assert (world.time_ns - before_ns) / 1e9 == pytest.approx(10.0, abs=0.1)


def test_a_slow_reader_gets_the_newest_state_and_no_backlog(world, robot):
    """Latest wins: what came while the reader was busy is skipped, and the next one is not older than a tick."""
    states = robot.states()
    first = next(states)
    world.run(2.0)
    second = next(states)
    assert second.seq >= first.seq + 199 and second.age <= 0.011


def test_waiting_for_a_state_does_not_spin(world, robot, monkeypatch):
    """Between two states the reader looks once per change, not as fast as it can."""
    looks = []
    sighting = robot._session.sighting
    monkeypatch.setattr(robot._session, "sighting", lambda: looks.append(1) or sighting())
    states = robot.states(max_rate=1.0)
    next(states)
    before = len(looks)
    next(states)
    assert len(looks) - before <= 105  # a second has a hundred ticks, and with each a snapshot


def test_states_end_with_a_timeout_when_none_comes(world, robot):
    """A daemon that makes no snapshots does not hold its viewers for ever; the message says what was seen last."""
    states = robot.states(timeout=0.5)
    next(states)
    world.engine.frozen = True
    with pytest.raises(GatewayTimeout, match="READ_ONLY"):
        next(states)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), "5", True])
def test_a_rate_of_states_must_be_positive(robot, rate):
    """A rate that means nothing is refused."""
    with pytest.raises(Rejected):
        next(robot.states(max_rate=rate))


@pytest.mark.parametrize("gone_s", [0.0, 3.0])
def test_states_go_on_with_the_next_daemon(world, robot, gone_s):
    """A restart of the daemon is bridged: the same iterator goes on, although the numbers begin again."""
    states = robot.states(timeout=5.0)
    world.run(1.0)
    assert next(states).seq > 50
    restart(world, gone_s)
    state = next(states)
    assert state.state == "OFFLINE" and state.seq < 10


def test_states_end_as_disconnected_when_no_daemon_comes(world, robot):
    """A daemon that stays away ends the iterator in its own time, with the class that says so."""
    states = robot.states(timeout=2.0)
    next(states)
    world.plane.set_reachable(False)
    before_ns = world.time_ns
    with pytest.raises(Disconnected):
        next(states)
    assert 2.0 <= (world.time_ns - before_ns) / 1e9 < 2.2


def test_states_end_when_the_client_is_closed(world):
    """Closing the client ends its iterators; nothing is raised, in the midst of a wait or before it."""
    robot = connect(transport=world.transport())
    states = robot.states(max_rate=1.0)
    next(states)
    world.on_tick = lambda: robot.close() if world.ticks > 50 else None
    assert [state.seq for state in states] == []
    assert list(robot.states()) == []


# -------------------------------------------------------------------------------------------------------- fresh


def test_a_fresh_state_is_waited_for(world, robot):
    """fresh_state() gives what is young enough at once, waits for it, and is Stale when none comes."""
    assert robot.fresh_state(max_age=0.1).link.age_ns == 2_000_000
    old = LinkView(up=True, router_zid="abc", fresh=False, age_ns=400_000_000)
    world.engine.show(link=old)
    world.run(0.02)
    assert robot.fresh_state(max_age=0.5).link.age_ns == 400_000_000
    world.engine.later(20, lambda: world.engine.show(link=a_snapshot().link))
    before_ns = world.time_ns
    assert robot.fresh_state().link.age_ns == 2_000_000
    assert (world.time_ns - before_ns) / 1e9 == pytest.approx(0.2, abs=0.03)
    for age_ns in (400_000_000, None):
        world.engine.show(link=LinkView(up=True, router_zid="abc", fresh=False, age_ns=age_ns))
        world.run(0.02)
        with pytest.raises(Stale) as caught:
            robot.fresh_state(timeout=0.1)
        assert caught.value.code is Code.STATE_STALE and caught.value.field == "max_age"


def test_a_snapshot_grows_old_while_it_is_held(world, robot):
    """The age of the robot's word counts on here: a snapshot of a daemon that fell silent does not stay fresh."""
    world.engine.frozen = True
    world.run(0.3)
    with pytest.raises(Stale):
        robot.fresh_state(max_age=0.1, timeout=0.1)
    assert robot.fresh_state(max_age=1.0)


def test_a_fresh_state_needs_a_daemon(world, robot):
    """Without a daemon, or closed, it is Disconnected, not Stale."""
    world.plane.set_reachable(False)
    world.run(1.5)
    with pytest.raises(Disconnected):
        robot.fresh_state(timeout=0.2)
    robot.close()
    with pytest.raises(Disconnected, match="closed"):
        robot.fresh_state(timeout=0.2)


# ------------------------------------------------------------------------------------------------------- notices


def test_events_come_in_order_and_end_with_silence(world, robot):
    """events() yields what was told since connect(), ends when the daemon is silent, and goes on when read again."""
    tell(world, "n0", "n1", "n2")
    events = robot.events(timeout=0.2)
    told = list(events)
    assert [notice.message for notice in told] == ["n0", "n1", "n2"]
    assert told[0].code == "LINK_UP" and told[0].level == "info" and told[0].facts == {"a": "b"}
    assert list(events) == []
    tell(world, "n3")
    assert [notice.message for notice in events] == ["n3"] and events.lost == 0


def test_every_reader_gets_every_notice(world, robot):
    """Readers do not take notices from one another; one may begin with what comes from now on."""
    tell(world, "before")
    first, second, late = (
        robot.events(timeout=0.0),
        robot.events(timeout=0.0),
        robot.events(timeout=0.0, backlog=False),
    )
    tell(world, "after")
    assert [notice.message for notice in first] == [notice.message for notice in second] == ["before", "after"]
    assert [notice.message for notice in late] == ["after"]


def test_a_slow_reader_is_told_how_many_it_missed(world, robot):
    """The newest thousand are kept; the gap stands between the notices, with its number."""
    slow, quick = robot.events(timeout=0.0), robot.events(timeout=0.0)
    for n in range(6):
        tell(world, *(str(200 * n + i) for i in range(200)))
        assert len(list(quick)) == 200
    told = list(slow)
    assert told[0].code == "NOTICES_LOST" and told[0].facts == {"lost": "200"} and told[0].level == "warning"
    assert [notice.message for notice in told[1:]] == [str(n) for n in range(200, 1200)]
    assert slow.lost == 200 and quick.lost == 0 and len(told) == KEPT + 1
    assert robot.health().notices_dropped == 0  # somebody here has read them


def test_notices_that_nobody_reads_are_dropped_and_counted(world, robot):
    """A client that never reads its events keeps the newest thousand and knows how many it lost."""
    tell(world, *(str(n) for n in range(1200)))
    assert robot.health().notices_dropped == 200
    events = robot.events()
    assert next(events).code == "NOTICES_LOST" and next(events).message == "200" and events.lost == 200


def test_what_was_lost_on_the_way_is_told_in_its_place(world, robot):
    """The daemon numbers its notices: a gap in the numbers is told where it is; a repeated one is not told twice."""
    events = robot.events(timeout=0.0)
    tell(world, "one")
    world.plane._outbox._told += 3  # so many were dropped by the daemon, or by the transport
    tell(world, "five")
    world.plane._outbox._told -= 1
    tell(world, "five again")
    told = list(events)
    assert [notice.code for notice in told] == ["LINK_UP", "NOTICES_LOST", "LINK_UP"]
    assert [notice.message for notice in told] == ["one", "3 notices were lost before the next one", "five"]
    assert events.lost == 3 == robot.health().notices_dropped


def test_events_go_on_across_a_restart_and_say_so(world, robot):
    """The connection that broke and the daemon that came stand between the notices; so does what it told before us."""
    tell(world, "old")
    events = robot.events(timeout=None)
    assert next(events).message == "old"
    restart(world, 2.0)
    world.plane._outbox._told = 2  # what the new one told before we were there
    tell(world, "new")
    told = [next(events) for _ in range(4)]
    assert [notice.code for notice in told] == ["DISCONNECTED", "CONNECTED", "NOTICES_LOST", "LINK_UP"]
    assert told[1].facts == {"daemon": "another"} and told[2].facts == {"lost": "2"}


def test_a_hiccup_is_told_as_one(world, robot):
    """The same daemon back after a moment: told as such, with what was missed meanwhile."""
    events = robot.events(timeout=0.0)
    tell(world, "before")
    world.plane.set_reachable(False)
    tell(world, "unheard")
    world.plane.set_reachable(True)
    tell(world, "after")
    told = list(events)
    assert [notice.code for notice in told] == ["LINK_UP", "DISCONNECTED", "CONNECTED", "NOTICES_LOST", "LINK_UP"]
    assert told[2].facts == {"daemon": "same"} and told[2].level == "info"


def test_silence_for_lack_of_a_daemon_is_disconnected(world, robot):
    """An end of the events with no daemon there is told apart from a daemon that has nothing to say."""
    world.plane.set_reachable(False)
    world.run(1.5)
    events = robot.events(timeout=0.1)
    assert next(events).code == "DISCONNECTED"
    with pytest.raises(Disconnected):
        next(events)


def test_events_end_when_the_client_is_closed(world):
    """What was told is still given, then the iteration ends; endless ones too."""
    robot = connect(transport=world.transport())
    tell(world, "last")
    events = robot.events(timeout=None)
    robot.close()
    assert [notice.message for notice in events] == ["last"]


def test_the_same_is_true_for_asyncio(world):
    """Async iterators of states and notices end with the client, too, and survive a restart."""

    async def scene():
        robot = await aio.connect(transport=world.transport())
        assert (await robot.fresh_state()).link.fresh
        states = robot.states()
        assert (await states.__anext__()).state == "READ_ONLY"
        restart(world)
        while (await states.__anext__()).state != "OFFLINE":
            pass
        events = robot.events(timeout=None, backlog=True)
        assert [(await events.__anext__()).code for _ in range(2)] == ["DISCONNECTED", "CONNECTED"]
        waiting = asyncio.gather(events.__anext__(), states.__anext__(), return_exceptions=True)
        await asyncio.sleep(0)
        world.engine.frozen = True
        await robot.close()
        results = await waiting
        assert isinstance(results[0], StopAsyncIteration)
        assert isinstance(results[1], StopAsyncIteration) or results[1].state == "OFFLINE"
        assert [state async for state in robot.states()] == []

    play(world, scene)
