"""The simulated robot as a node: stepped by hand here, and as a process."""

from __future__ import annotations

import itertools
import math
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import zenoh

from cdr_types.messages import std_msgs
from gateway.sim.node import SimNode, main_sim, run
from gateway.sim.remote import SimControl
from gateway.sim.robot.faults import parse_fault
from gateway.sim.robot.manual import MS, STATE_TOPICS, Fsm, S, Side
from gateway.sim.robot.settings import HANGING_RAD, SimSettings
from tests.sim.drivers import joints
from tests.sim.wire import User, sim_process, until

pytestmark = pytest.mark.e2e

BENCH, PROCESS, OTHER = "tcp/127.0.0.1:19140", "tcp/127.0.0.1:19141", "tcp/127.0.0.1:19142"
STATE = "/left_arm/joint_states"


@pytest.fixture
def node():
    """A node that is stepped by the test."""
    made = SimNode(SimSettings(), BENCH)
    yield made
    made.close()


@pytest.fixture
def user(node):
    """A user of it, connected to every state topic."""
    made = User(BENCH)
    until(lambda: node._bridge.wanted() == frozenset(STATE_TOPICS))
    yield made
    made.close()


def step(node: SimNode) -> None:
    """One cycle at the present time."""
    node.step(time.monotonic_ns())


def seen(user: User) -> set[str]:
    """Topics that have arrived since the last look."""
    return {topic for topic, _ in user.messages()}


def test_every_topic_arrives_and_commands_act(node, user):
    """All state topics decode at the user; a heartbeat over the wire starts the robot."""
    arrived: set[str] = set()
    until(lambda: arrived.update(seen(user)) or arrived == set(STATE_TOPICS), pump=lambda: step(node))
    user.put("/api/fsm/enable", std_msgs.Float32(data=1.0))
    until(lambda: node.robot.fsm.state is Fsm.SLOW_START, pump=lambda: step(node))
    user.put("/api/left_arm/joint_cmd", joints(HANGING_RAD[Side.LEFT]))
    until(lambda: node.robot.arms[Side.LEFT].accepted == 1, pump=lambda: step(node))


@pytest.mark.parametrize("payload", [b"", b"\0", b"\xff\xff\xff\xff", b"\0\1\0\0\0\0", b"\0\1\0\0" + b"\0" * 16])
def test_bytes_that_are_no_message_are_ignored(node, user, payload):
    """Nothing of it reaches the robot; the next good message does (wire reference §3.2)."""
    user.put("/api/fsm/enable", payload)
    until(lambda: node.robot.journal.counts["INVALID_CDR"] == 1, pump=lambda: step(node))
    user.put("/api/fsm/enable", std_msgs.Float32(data=1.0))
    until(lambda: node.robot.fsm.state is Fsm.SLOW_START, pump=lambda: step(node))


def test_stamps_are_the_hosts_wall_clock_and_follow_it_when_it_is_set(node, user):
    """A subscriber on this host sees them as old as their way; an hour's step of the host's clock is one of the robot's."""
    heard: list[int] = []
    hour_ns = 3600 * S

    def ago_ns() -> int:
        """How old the newest stamp is by this host's clock, within what one look takes."""
        heard.extend(
            message.header.stamp.sec * S + message.header.stamp.nanosec
            for topic, message in user.messages()
            if topic == STATE
        )
        return time.time_ns() - heard[-1] if heard else -S

    until(lambda: 0 <= ago_ns() < 200 * MS, pump=lambda: step(node))
    node._wall_clock = lambda: time.time_ns() + hour_ns
    until(lambda: 0 <= ago_ns() + hour_ns < 200 * MS, pump=lambda: step(node))


def test_looks_at_the_clocks_that_took_long_set_nothing(node):
    """Whoever is kept from running between two looks knows only that time has passed."""
    late_ns = itertools.count(0, 50 * MS)
    before_ns = node.robot.clock.epoch_ns
    node._clock = lambda: time.monotonic_ns() + next(late_ns)
    step(node)
    assert node.robot.clock.epoch_ns == before_ns


def test_a_delete_is_ignored(node, user):
    """A zenoh DELETE on a command key is no message."""
    user.session.delete("api/fsm/enable")
    until(lambda: node.robot.journal.counts["DELETE_ON_COMMAND"] == 1, pump=lambda: step(node))


def test_a_nan_is_decoded_and_left_to_the_robot(node, user):
    """NaN is a value for CDR; the robot's own rule deals with it."""
    user.put("/api/fsm/enable", std_msgs.Float32(data=math.nan))
    until(lambda: node.robot.journal.counts["ENABLE_VALUE"] == 1, pump=lambda: step(node))


def test_the_router_can_stop_and_listen_again_while_the_robot_lives_on(node, user):
    """Users lose the link and get it back; the robot's heartbeat watchdog runs meanwhile."""
    user.put("/api/fsm/enable", std_msgs.Float32(data=1.0))
    until(lambda: node.robot.fsm.state is Fsm.SLOW_START, pump=lambda: step(node))
    zid = node._bridge.zid
    node.begin(parse_fault({"fault": "router_stop", "duration_s": 0.3}), time.monotonic_ns())
    step(node)
    assert node._bridge is None
    user.messages()
    until(lambda: node._bridge is not None, pump=lambda: step(node))
    assert node._bridge.zid != zid
    until(lambda: STATE in seen(user), pump=lambda: step(node))
    until(lambda: node.robot.fsm.state is Fsm.PAUSE, pump=lambda: step(node))


def test_a_dead_route_and_a_lost_node_end_in_time_or_when_cleared(node, user):
    """State of the dead topic stops, the rest goes on; a lost node is silent altogether."""
    now_ns = time.monotonic_ns()
    node.begin(parse_fault({"fault": "route_dead", "topic": STATE, "duration_s": 5.0}), now_ns)
    assert node._bridge.wanted() == frozenset(STATE_TOPICS) - {STATE}
    assert node.clear("route_dead", None) == 1
    assert node._bridge.wanted() == frozenset(STATE_TOPICS)
    node.begin(parse_fault({"fault": "node_lost", "duration_s": 0.2}), now_ns)
    assert node._bridge.wanted() == frozenset()
    until(lambda: node._bridge.wanted() == frozenset(STATE_TOPICS), pump=lambda: step(node))
    assert node.clear(None, None) == 0


def test_a_lost_node_stays_lost_over_a_restart_of_the_router(node, user):
    """The bridge comes back without the robot's node."""
    node.begin(parse_fault({"fault": "node_lost"}), time.monotonic_ns())
    node.begin(parse_fault({"fault": "router_stop", "duration_s": 0.01}), time.monotonic_ns())
    step(node)
    assert node.clear("route_dead", None) == 0
    until(lambda: node._bridge is not None, pump=lambda: step(node))
    assert node._bridge.wanted() == frozenset()
    node.clear(None, None)
    until(lambda: node._bridge.wanted() == frozenset(STATE_TOPICS), pump=lambda: step(node))


def test_a_node_fault_that_is_cleared_without_a_router_is_over(node):
    """Clearing while the router is away does not trip over the missing bridge."""
    node.begin(parse_fault({"fault": "node_lost"}), time.monotonic_ns())
    node.begin(parse_fault({"fault": "router_stop", "duration_s": 0.01}), time.monotonic_ns())
    step(node)
    assert node.clear("node_lost", None) == 1
    until(lambda: node._bridge is not None, pump=lambda: step(node))


def test_run_follows_the_grid_and_says_what_happens():
    """The loop says where it listens, calls `ready`, tells log entries and ends when asked."""
    lines: list[str] = []
    stop = threading.Event()
    ready = threading.Event()
    thread = threading.Thread(
        target=run,
        args=(SimSettings(), OTHER),
        kwargs={"should_stop": stop.is_set, "ready": ready.set, "write": lines.append},
    )
    thread.start()
    try:
        assert ready.wait(10.0)
        with SimControl(OTHER) as control:
            control.fault("vr_mode")
            until(lambda: len(lines) > 1)
            for number in range(30):
                control.fault("jump", side="left", joint=1, delta_rad=number / 1000)
    finally:
        stop.set()
        thread.join(10.0)
    assert not thread.is_alive()
    assert lines[0] == f"listening on {OTHER}"
    assert lines[1].startswith("FAULT: vr_mode")
    assert len(lines) < 20


def test_rates_at_the_user_are_those_of_the_manual():
    """200, 20 and 1 Hz at a subscriber; a busy machine may skip grid points but never adds any."""
    with sim_process(PROCESS):
        user = User(PROCESS)
        try:
            until(lambda: STATE in seen(user))
            time.sleep(0.2)
            user.messages()
            begin = time.monotonic()
            time.sleep(2.0)
            published = user.messages()
            elapsed_s = time.monotonic() - begin
        finally:
            user.close()
    stamps = [m.header.stamp.sec * S + m.header.stamp.nanosec for topic, m in published if topic == STATE]
    steps = np.diff(stamps)
    assert np.all(steps % 5_000_000 == 0)
    assert np.all(steps > 0)
    counts = {topic: sum(1 for name, _ in published if name == topic) for topic in STATE_TOPICS}
    for topic, (_, rate) in STATE_TOPICS.items():
        assert 0.5 * rate * elapsed_s - 1 <= counts[topic] <= rate * elapsed_s + 2


def test_a_frozen_process_sends_nothing_and_goes_on_afterwards():
    """Stopped as a whole for half a second, it lives on with the time that has passed."""
    with sim_process(PROCESS), SimControl(PROCESS) as control:
        user = User(PROCESS)
        try:
            until(lambda: STATE in seen(user))
            control.fault("frozen", duration_s=0.6)
            arrivals: list[float] = []
            end = time.monotonic() + 1.5
            while time.monotonic() < end:
                arrivals += [time.monotonic() for topic in seen(user) if topic == STATE]
                time.sleep(0.002)
            assert 0.4 < float(np.max(np.diff(arrivals))) < 1.4
        finally:
            user.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_ends_by_signal_with_a_user_connected(number):
    """Exit code 0 within seconds, whoever is still subscribed."""
    with sim_process(PROCESS) as process:
        user = User(PROCESS)
        try:
            until(lambda: STATE in seen(user))
            process.send_signal(number)
            assert process.wait(5.0) == 0
        finally:
            user.close()


def test_it_ends_when_asked_over_the_control_channel():
    """An orderly end without a signal."""
    with sim_process(PROCESS) as process:
        with SimControl(PROCESS) as control:
            control.ask("shutdown")
            assert process.wait(5.0) == 0


def test_a_port_in_use_is_said_and_ends_with_one(node, capsys):
    """The second simulation on a port says so and gives up."""
    assert main_sim(BENCH) == 1
    assert "cannot listen on tcp/127.0.0.1:19140" in capsys.readouterr().err
    command = [sys.executable, "-m", "gateway.cli", "sim", "--listen", BENCH]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20.0, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert "Another simulation" in done.stderr and ".rs:" not in done.stderr


def test_only_a_port_that_is_in_use_is_said_to_be_in_use(capsys):
    """An address that is not this host's is another matter."""
    assert main_sim("tcp/192.0.2.1:9000") == 1
    said = capsys.readouterr().err
    assert "cannot listen on tcp/192.0.2.1:9000" in said and "already" not in said and ".rs" not in said


def test_main_sim_ends_by_signal_in_this_process(capsys):
    """`main_sim` blocks until SIGTERM, returns 0 and gives the signals back."""
    before = signal.getsignal(signal.SIGTERM)
    assert main_sim(OTHER, ready=lambda: os.kill(os.getpid(), signal.SIGTERM)) == 0
    assert signal.getsignal(signal.SIGTERM) is before
    assert capsys.readouterr().out == f"listening on {OTHER}\n"


def test_the_router_gives_up_when_its_port_stays_taken(node, monkeypatch):
    """A port that somebody else took meanwhile is tried for a while, then it is an error."""
    node.begin(parse_fault({"fault": "router_stop", "duration_s": 0.01}), time.monotonic_ns())
    step(node)

    def refuse():
        raise zenoh.ZError("taken")

    monkeypatch.setattr(node, "_open", refuse)
    now_ns = time.monotonic_ns() + S
    with pytest.raises(zenoh.ZError, match="taken"):
        for number in range(200):
            node.step(now_ns + number * S)
    assert node._reopen_tries == 100
