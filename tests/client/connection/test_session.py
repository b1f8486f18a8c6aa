"""Tests of the session: what ends with its daemon, what is never sent again, and clients that nobody holds any more."""

from __future__ import annotations

import gc
import threading
import tracemalloc
import weakref

import numpy as np
import pytest

from gateway.client import connect
from gateway.errors import Code, Disconnected, LeaseError, OutcomeUnknown, failure
from tests.api.daemon import eventually
from tests.api.stand_in import START_Q, a_snapshot
from tests.client.asking.test_watching import restart
from tests.thoroughness import either


def sent(world, robot):
    """Return what this client asked for since the engine began anew."""
    return [type(request).__name__ for client, request in world.engine.requests if client == robot.client_id]


def begin_anew(world):
    """Put a fresh daemon in the place of the first, with an engine that knows nothing."""
    restart(world)
    world.engine.requests.clear()
    world.engine.targets.clear()
    world.engine.seen.clear()
    world.engine._answered.clear()
    world.engine.snapshot = a_snapshot(seq=1)


def test_what_was_owned_ends_with_its_daemon_and_nothing_is_sent(world, robot):
    """After a restart every command of the old control is LEASE_LOST here: nothing reaches the new daemon."""
    own = robot.control().acquire()
    own.enable()
    handle = own.left_arm.move_to(START_Q)
    stream = own.right_arm.stream()
    stream.__enter__()
    begin_anew(world)
    commands = (
        own.enable,
        own.disable,
        own.hold,
        lambda: own.left_arm.move_to(START_Q),
        own.left_arm.hold,
        lambda: stream.set(np.array(START_Q)),
        stream.tick,
        lambda: own.left_arm.stream(),
        lambda: own.epoch,
    )
    for command in commands:
        with pytest.raises(LeaseError) as caught:
            command()
        assert caught.value.code is Code.LEASE_LOST and "restarted" in str(caught.value)
    with pytest.raises(Disconnected) as gone:
        handle.result(timeout=5.0)
    assert "new control()" in gone.value.hint, "another daemon runs already"
    assert not own.is_open and handle.done
    own.release()
    own.leave()
    stream.__exit__(None, None, None)
    world.run(1.0)
    assert sent(world, robot) == [] and world.engine.seen == {} and world.engine.targets == []


def test_a_motion_of_a_daemon_that_is_gone_does_not_go_on_for_ever(world, robot):
    """Who polls a handle hears of it after a second, as from `robot.state`; of one that had ended it keeps what it knew."""
    own = robot.control().acquire()
    own.enable()
    ended, handle = own.right_arm.move_to(START_Q), own.left_arm.move_to(START_Q)
    world.plane.set_reachable(False)
    world.run(0.9)
    assert not handle.done and handle.state == "executing"
    world.run(0.2)
    for look in ("done", "state", "progress", "error_rad", "error_m"):
        with pytest.raises(Disconnected):
            getattr(handle, look)
    assert repr(handle) == f"<motion {handle.motion_id}: DISCONNECTED>"
    assert ended.done and ended.state == "superseded"


def test_cancelling_a_motion_of_an_earlier_daemon_does_not_look_like_success(world, robot):
    """Nothing was cancelled by it: the control has ended, whether or not there is a new one."""
    own = robot.control().acquire()
    own.enable()
    handle = own.left_arm.move_to(START_Q)
    begin_anew(world)
    assert handle.done and handle.state == "unknown"
    for prepare in (lambda: None, robot.control().acquire):
        prepare()
        with pytest.raises(LeaseError) as caught:
            handle.cancel()
        assert caught.value.code is Code.LEASE_LOST


def test_a_keepalive_is_not_put_while_the_daemon_is_away(world, robot, monkeypatch):
    """Whoever listens on the path next may be another daemon, to which this owner is nobody; the same one hears it again."""
    robot.control().acquire()
    put = []
    monkeypatch.setattr(robot._session.transport, "put", lambda key, payload: put.append(key))
    world.run(0.5)
    assert len(put) >= 5
    world.plane.set_reachable(False)
    put.clear()
    world.run(0.5)
    assert put == []
    world.plane.set_reachable(True)
    world.run(0.5)
    assert len(put) >= 5


def test_reading_goes_on_and_a_new_control_is_taken_by_hand(world, robot):
    """The same client reads the next daemon, and owns it when, and only when, its user says so."""
    robot.control().acquire().enable()
    begin_anew(world)
    assert robot.state.state == "READ_ONLY" and not robot.state.lease.owned
    with robot.control() as own:
        world.run(0.5)
        assert own.is_open and len(world.engine.seen[robot.client_id]) >= 10
    assert sent(world, robot) == ["Acquire", "Release"]


def test_a_new_control_right_after_the_restart_keeps_its_keepalive(world, robot):
    """The end of the old lease's keepalive does not take the new one's with it."""
    robot.control().acquire()
    begin_anew(world)
    own = robot.control().acquire()  # before any beat could see that the old lease is over
    world.run(0.5)
    assert len(world.engine.seen[robot.client_id]) >= 10 and own.is_open


def test_leaving_a_block_by_an_exception_after_a_restart_sends_nothing(world, robot):
    """Neither an abandon nor a release of an old epoch goes to a daemon that never gave it."""
    with pytest.raises(ZeroDivisionError), robot.control():
        begin_anew(world)
        _ = 1 / 0
    robot.close()
    world.run(0.5)
    assert world.engine.requests == []


def test_a_request_under_way_is_not_repeated_to_another_daemon(world, robot):
    """A reply that is lost with its daemon is an unknown outcome; the next daemon is never asked the same again."""
    ask = world.plane.ask

    def die(key, payload, encoding, on_done):
        world.plane.ask = ask
        begin_anew(world)
        on_done(None)

    world.plane.ask = die
    with pytest.raises(OutcomeUnknown) as caught:
        robot.recover()
    assert "may or may not have run" in str(caught.value) and "restarted" in str(caught.value)
    world.run(1.0)
    assert world.engine.requests == []


def test_a_client_that_nobody_holds_any_more_is_closed(world):
    """A notebook cell that runs again replaces its robot: the first one goes, by itself and without its users' help."""
    robot = connect(transport=world.transport(), name="first")
    first, session = robot.client_id, weakref.ref(robot._session)
    robot = connect(transport=world.transport(), name="second")
    gc.collect()
    assert session() is None
    eventually(lambda: first not in world.plane._listeners)
    assert robot.client_id in world.plane._listeners and robot.state.state == "READ_ONLY"


def test_an_owner_that_nobody_holds_any_more_leaves_the_robot_held(world):
    """Nobody can command by it: its keepalive ends and its token goes, as if the process had died."""
    own = connect(transport=world.transport()).control().acquire()
    gc.collect()
    world.run(0.2)
    assert own.is_open  # the control holds its connection
    client_id = own._session.client_id
    del own
    gc.collect()
    eventually(lambda: client_id not in world.plane._listeners)
    beats = len(world.engine.seen[client_id])
    world.run(0.5)
    assert len(world.engine.seen[client_id]) == beats and world.engine.gone == [client_id]
    assert world.engine.names() == ["Acquire"]


def test_handles_and_iterators_keep_their_connection(world):
    """Whatever can still be used keeps what it needs."""
    own = connect(transport=world.transport()).control().acquire()
    own.enable()
    handle = own.left_arm.move_to(START_Q)
    states = connect(transport=world.transport()).states()
    del own
    gc.collect()
    assert handle.result(timeout=5.0).sides == ("left",) and next(states).state == "ACTIVE"


def test_a_lease_held_by_this_very_process_says_so(world, robot):
    """A cell that acquires again while its earlier control lives is told what happened, instead of looking for others."""
    first = connect(transport=world.transport()).control().acquire()
    with pytest.raises(LeaseError) as caught:
        robot.control().acquire()
    assert caught.value.code is Code.LEASE_HELD and "this process" in caught.value.hint
    first.release()
    robot.control().acquire()


def test_a_stale_abandon_does_not_wait_for_a_dead_daemon(world, robot):
    """close() of an owner whose daemon is gone ends at once."""
    robot.control().acquire()
    world.plane.set_reachable(False)
    before_ns = world.time_ns
    robot.close()
    assert world.time_ns == before_ns


@pytest.mark.slow
def test_memory_is_flat_over_thousands_of_reconnects(world, robot):
    """One reader through three thousand restarts of its daemon, 1,600 outside CI: nothing is kept of those that are gone."""
    own = robot.control().acquire()

    def reconnect(times):
        for _ in range(times):
            begin_anew(world)
            world.engine.gone.clear()
            assert robot.state.state == "READ_ONLY"
            gc.collect(0)

    tracemalloc.start()
    try:
        reconnect(1000)  # until everything that is bounded is full
        gc.collect()
        before, _ = tracemalloc.get_traced_memory()
        reconnect(either(600, 2000))
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 20_000, f"{after - before} B more after so many reconnects"
    assert not own.is_open and len(robot._session._listeners) == 0 and robot._session._motions == {}


def test_a_keepalive_that_ends_unasked_ends_the_control_loudly(world, robot):
    """The robot is held at once, by word of us; whoever goes on commanding hears why, or who ends his block without."""
    own = robot.control().acquire()
    epoch = own.epoch
    robot._session._lose_beat("the thread ta2-keepalive ended unasked: Panic: boom")
    world.run(0.1)
    assert sent(world, robot)[-1] == "Abandon" and not own.is_open
    own.__exit__(KeyError, KeyError(), None)  # an error of the user's own is not covered by ours
    for call in (lambda: own.__exit__(None, None, None), lambda: own.epoch):
        with pytest.raises(LeaseError, match="ended unasked: Panic: boom") as caught:
            call()
        assert caught.value.code is Code.LEASE_LOST
    own.__exit__(None, None, None)  # who has heard of it may end well
    with robot.control() as again:
        assert again.epoch > epoch


def test_a_keepalive_that_ends_with_nothing_owned_ends_nothing(world, robot):
    """It is begun with the next lease."""
    robot._session._lose_beat("why")
    with robot.control() as own:
        assert own.is_open


def test_the_keepalive_is_begun_by_one_at_a_time(robot, monkeypatch):
    """Nobody else gets as far as that while it is being begun: one of two would never be ended."""
    session, seen = robot._session, []

    def every(*_):
        def look():
            seen.append(session.changed.acquire(blocking=False))
            if seen[0]:
                session.changed.release()

        other = threading.Thread(target=look)
        other.start()
        other.join()
        return lambda: None

    monkeypatch.setattr(session.transport, "every", every)
    session.keep_alive()
    assert seen == [False]
    with pytest.raises(LeaseError, match="asks for the robot already") as caught:
        session.keep_alive()
    assert caught.value.code is Code.LEASE_HELD


def test_whoever_asks_while_this_client_asks_already_is_refused_and_ends_nothing(world, robot):
    """Of two that ask at once one owns the robot and stays alive, and the other one hears that he does not."""

    def ask_too():
        world.on_tick = None
        with pytest.raises(LeaseError, match="asks for the robot already"):
            robot.control().acquire()

    world.on_tick = ask_too
    own = robot.control().acquire()
    assert world.on_tick is None and own.is_open
    world.run(0.5)
    assert len(world.engine.seen[robot.client_id]) >= 10


@pytest.mark.parametrize("ending", ["cancelled", "refused", "late"])
def test_whoever_asks_in_vain_lets_go_of_nothing_that_another_got(world, robot, ending):
    """Given up, refused, or late: the lease that another control of this client has got meanwhile stays alive."""
    session = robot._session
    info, session.info = session.info, None
    second = robot.control()._acquire()
    next(second)  # it has begun, and waits for the daemon's facts
    own = robot.control().acquire()
    if ending == "cancelled":
        second.close()
    elif ending == "refused":
        with pytest.raises(Disconnected):
            second.throw(failure(Code.DISCONNECTED, "gone"))
    else:
        with pytest.raises(LeaseError, match="owns the robot already"):
            second.send(info)
    assert own.is_open
    world.run(0.5)
    assert len(world.engine.seen[robot.client_id]) >= 10 and sent(world, robot) == ["Acquire"]


def test_the_end_of_a_lease_that_was_lost_is_not_the_next_ones(world, robot):
    """A reply that comes late ends what it was about and nothing newer."""
    first = robot.control().acquire()
    ending = first._release()
    next(ending)
    robot._session.let_go(first._lease)  # as when a snapshot shows that it is over
    own = robot.control().acquire()
    with pytest.raises(StopIteration):
        ending.throw(failure(Code.LEASE_STALE, "over"))
    assert own.is_open
    world.run(0.5)
    assert len(world.engine.seen[robot.client_id]) >= 10


def test_a_lease_that_nobody_gets_is_left_and_not_the_one_that_took_its_place(world, robot):
    """Cancelled while it waits for the arms to rest, an acquire leaves the robot held; the lease of another stays."""
    for is_replaced in (False, True):
        asking = robot.control(take="mine")._acquire()
        wait = next(asking)
        while (reply := wait.poll(world.time_ns)) is None:
            world.pump()
        asking.send(reply)  # it is its own now, and waits for rest
        own = None
        if is_replaced:
            robot._session.let_go(robot._session.lease)
            own = robot.control().acquire()
        asking.close()
        world.run(0.1)
        assert (sent(world, robot)[-1] == "Abandon") is not is_replaced
        assert robot._session._beating == [] if own is None else own.is_open
