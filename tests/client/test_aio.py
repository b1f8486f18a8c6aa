"""Tests of the async twin: the same procedures, awaited; and what is special about asyncio: cancellation."""

from __future__ import annotations

import asyncio
import threading

import numpy as np
import pytest

from gateway.client import StopResult, aio
from gateway.core.messages.outputs import Level, Notice
from gateway.errors import Aborted, Code, Disconnected, LeaseError, OutcomeUnknown, Refusal, Rejected
from gateway.messages import requests
from gateway.messages.requests import MovePose
from tests.api.daemon import eventually
from tests.api.stand_in import START_Q
from tests.client.playing import play

GOAL = np.array([0.2, 0.6, -0.2, 1.0, 0.1, 0.0, 0.2])


def test_the_whole_way_works_as_in_the_blocking_client(world):
    """Connect, look, own, enable, move, stream, end: in the same requests, in the same order."""

    async def scene():
        async with aio.connect(transport=world.transport(), name="async") as robot:
            assert (await robot.info()).model == "standard" and "async" in repr(robot)
            assert np.allclose((await robot.state()).left_arm.q, START_Q)
            async with robot.control() as own:
                await own.enable()
                assert robot.health().lease_holder == "async" and own.is_open
                result = await (await own.left_arm.move_to(GOAL, speed=0.5))
                assert result.sides == ("left",)
                handle = await own.move_by({"right": np.zeros(7)})
                await handle.cancel()
                pose = {"frame": "left_shoulder_base"}
                for go in (own.left_arm.move_pose, own.left_arm.move_linear):
                    await (await go((0.3, 0.1, -0.2), (0.0, 0.0, 0.0, 1.0), **pose)).cancel()
                async with own.left_arm.stream(rate_hz=50) as out:
                    for _ in range(5):
                        assert np.allclose(out.set(out.q), out.q)
                        await out.tick()
                await own.right_arm.hold()
                await own.hold()
                await own.left_arm.move_by(np.zeros(7))
                await own.left_arm.follow(np.tile(START_Q, (3, 1)), 0.1)
                await own.disable()
            assert (await robot.state()).state == "READ_ONLY"
            assert (await robot.stop("enough")).undelivered is False
            await robot.estop()
            await robot.recover()

    play(world, scene)
    assert world.engine.names() == [
        *(
            "Acquire",
            "Enable",
            "Move",
            "Move",
            "Cancel",
            *("MovePose", "Cancel", "MovePose", "Cancel"),
            "OpenStream",
            "CloseStream",
            "Hold",
            "Hold",
            "Move",
            "Follow",
            "Disable",
        ),
        *("Release", "Stop", "Estop", "Recover"),
    ]
    poses = [request for _, request in world.engine.requests if isinstance(request, MovePose)]
    assert [request.straight for request in poses] == [False, True]
    assert len(world.engine.targets) == 5
    world.run(0.02)
    assert len(world.engine.gone) == 1


def test_connecting_can_be_awaited(world):
    """Without `async with`, the robot is awaited and closed by hand."""

    async def scene():
        robot = await aio.connect(transport=world.transport())
        await robot.close()
        with pytest.raises(Disconnected):
            await robot.stop()
        async with await aio.connect(transport=world.transport()) as robot:
            await robot.stop()
        with pytest.raises(Disconnected):
            await robot.stop()

    play(world, scene)


def test_a_connection_that_is_given_up_while_it_is_made_does_not_stay(world):
    """A cancelled connect() leaves nothing behind, although opening goes on in its thread until it is done."""
    transport, begun, let_go = world.transport(), threading.Event(), threading.Event()
    opening = transport.open

    def slowly(*arguments):
        begun.set()
        assert let_go.wait(10)
        opening(*arguments)

    transport.open = slowly

    async def scene():
        connecting = asyncio.ensure_future(aio.connect(transport=transport)._connect())
        while not begun.is_set():
            await asyncio.sleep(0)
        connecting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await connecting
        let_go.set()

    play(world, scene)
    eventually(lambda: world.plane._listeners == {})


def test_a_connection_that_is_given_up_is_not_closed_in_the_event_loop(world):
    """That waits for the network, and whoever else is in this event loop, with a stop perhaps, would wait for it."""
    world.plane.reachable = False
    transport, closed_by = world.transport(), []
    closing = transport.close

    def close():
        closed_by.append(threading.current_thread())
        closing()

    transport.close = close

    async def scene():
        loop_thread = threading.current_thread()
        with pytest.raises(Disconnected):
            await aio.connect(transport=transport, timeout_s=0.5)
        assert closed_by and loop_thread not in closed_by

    play(world, scene)


def test_connecting_to_nobody_is_disconnected(world):
    """The wait for a daemon ends in time."""
    world.plane.reachable = False

    async def scene():
        with pytest.raises(Disconnected):
            await aio.connect(transport=world.transport(), timeout_s=0.5)

    play(world, scene)


def test_an_exception_leaves_the_robot_held(world):
    """As in the blocking client: no release, but abandon."""

    async def scene():
        async with aio.connect(transport=world.transport()) as robot:
            with pytest.raises(ZeroDivisionError):
                async with robot.control() as own:
                    await own.enable()
                    _ = 1 / 0
            await asyncio.sleep(0.05)

    play(world, scene)
    assert world.engine.names() == ["Acquire", "Enable", "Abandon"]


@pytest.mark.parametrize("where", ["in a wait", "while ending"])
def test_cancelling_the_task_that_owns_leaves_the_robot_held(world, where):
    """Ctrl-C under asyncio.run cancels the task: the robot is held, wherever the task was."""

    async def scene():
        async with aio.connect(transport=world.transport()) as robot:

            async def owner():
                async with robot.control() as own:
                    await own.enable()
                    if where == "in a wait":
                        await (await own.left_arm.move_to(GOAL)).result()
                    world.plane.reachable = False  # the release will wait for its reply

            task = asyncio.create_task(owner())
            awaited = requests.Move if where == "in a wait" else requests.Enable
            while not any(isinstance(request, awaited) for _, request in world.engine.requests):
                await asyncio.sleep(0)
            while where == "while ending" and world.plane.reachable:
                await asyncio.sleep(0)
            await asyncio.sleep(0)
            task.cancel()
            world.plane.reachable = True
            with pytest.raises(asyncio.CancelledError):
                await task
            await asyncio.sleep(0.05)

    play(world, scene)
    assert world.engine.names()[-1] == "Abandon" and "Release" not in world.engine.names()


def test_cancelling_one_wait_leaves_everything_as_it_is(world):
    """A timeout of the user's own around a wait ends the wait and nothing else."""

    async def scene():
        async with aio.connect(transport=world.transport()) as robot, robot.control() as own:
            await own.enable()
            handle = await own.left_arm.move_to(GOAL)
            world.engine._countdowns.clear()
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(handle.result(), timeout=0.05)
            assert own.is_open and not handle.done
            world.engine._moved(handle.motion_id)
            assert (await handle).motion_id == handle.motion_id

    play(world, scene)
    assert "Abandon" not in world.engine.names() and world.engine.names()[-1] == "Release"


def test_on_exit_hold_and_leave_and_release(world):
    """A control can end held, be left by hand, or be given back by hand."""

    async def scene():
        async with aio.connect(transport=world.transport()) as robot:
            async with robot.control(on_exit="hold"):
                pass
            own = await robot.control().acquire()
            await own.leave()
            own = await robot.control().acquire()
            await own.release()
            with pytest.raises(LeaseError):
                await own.enable()
            with pytest.raises(Rejected):
                robot.control(on_loss="drop")

    play(world, scene)
    assert world.engine.names() == ["Acquire", "Abandon", "Acquire", "Abandon", "Acquire", "Release"]


def test_states_and_events_are_async_iterators(world):
    """The same order, rate and end as in the blocking client."""

    async def scene():
        async with aio.connect(transport=world.transport()) as robot:
            world.engine.notices.append(Notice(code=Code.WALK, level=Level.INFO, message="hello", at_ns=1))
            before_ns, seqs = world.time_ns, []
            async for state in robot.states(max_rate=10):
                seqs.append(state.seq)
                if len(seqs) == 6:
                    break
            assert seqs == sorted(set(seqs)) and (world.time_ns - before_ns) / 1e9 >= 0.5
            assert [notice.message async for notice in robot.events(timeout=0.1)] == ["hello"]
            assert robot.client_id in world.plane._listeners

    play(world, scene)


def test_errors_come_out_of_the_await_they_belong_to(world):
    """A refusal, an ended stream and a failing close raise where the blocking client raises them."""

    async def scene():
        async with aio.connect(transport=world.transport()) as robot, robot.control() as own:
            await own.enable()
            with pytest.raises(Aborted):
                async with own.left_arm.stream() as out:
                    world.engine.end_streams("TARGET_EXPIRED")
                    for _ in range(5):
                        await out.tick()
            world.engine.refusals[requests.CloseStream] = Refusal(code=Code.LEASE_LOST, message="gone")
            with pytest.raises(LeaseError):
                async with own.left_arm.stream():
                    pass

    play(world, scene)


def test_the_first_state_of_a_new_daemon_is_waited_for(world):
    """After a restart of the daemon, state() waits for its first snapshot."""

    async def scene():
        async with aio.connect(transport=world.transport()) as robot:
            world.plane.set_reachable(False)
            world.plane._daemon_id = "second"
            world.plane.set_reachable(True)
            assert (await robot.state()).state == "READ_ONLY"

    play(world, scene)


@pytest.mark.parametrize("reason", ["\udcff", ValueError("smoke"), "x" * 5000], ids=["no-unicode", "exception", "long"])
def test_no_reason_keeps_a_stop_away_or_makes_it_a_strangers(world, reason):
    """As in the blocking client."""

    async def scene():
        async with aio.connect(transport=world.transport(), name="\udcff") as robot:
            await robot.control().acquire()
            for ask in (robot.stop, robot.estop):
                assert (await ask(reason)).undelivered is False
                assert world.engine.requests[-1][0] == robot.client_id

    play(world, scene)


def test_a_stop_of_a_dead_daemon_goes_to_its_guard(world, monkeypatch):
    """As in the blocking client, without holding up the event loop."""
    answers = [StopResult(undelivered=False, by_guard=True), None, None, StopResult(undelivered=False, by_guard=True)]
    monkeypatch.setattr("gateway.client.asking.guard_stop.stop_at_guard", lambda *_: answers.pop(0))

    async def scene():
        async with aio.connect(transport=world.transport()) as robot:
            world.plane.set_reachable(False)
            assert (await robot.estop("smoke")).by_guard
            with pytest.raises(
                (OutcomeUnknown, Disconnected), match="physical emergency stop"
            ):  # by how long it was away
                await robot.stop("smoke")
            assert (await robot.stop("smoke")).by_guard

    play(world, scene)
