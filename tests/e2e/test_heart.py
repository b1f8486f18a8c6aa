"""The heart end to end: losses of the client, the daemon, the router and the link while both arms move."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from gateway.api.guard_protocol import guard_socket
from gateway.client import MotionHandle, Robot
from gateway.errors import Code, LeaseError
from tests.e2e.system import ROOT, System, joint_topics, steady, wait_for, worst_gap_ms

pytestmark = pytest.mark.e2e

Systems = Callable[..., System]

SLOW_MOVE = """
with robot.control() as own:
    own.enable(timeout=12.0)
    print("enabled", flush=True)
    own.move_to(HOME, speed=0.15)
    time.sleep(60)
"""
"""Owns the robot and moves both arms slowly (about 8 s) to the initial position."""

QUICK_STAGES = "[loss]\nfree_after_s = 1.5\ndown_after_s = 3.5\n"


def moving(system: System, watcher: Robot) -> None:
    """Wait until the motion is well under way."""
    wait_for(lambda: watcher.state.state == "ACTIVE", f"ACTIVE ({system.clients[-1].text()} {watcher.state})")
    wait_for(
        lambda: any(m.state == "executing" and m.progress > 0.15 for m in watcher.state.motions), "a motion under way"
    )


@pytest.mark.alone
@pytest.mark.sim_only("the demo starts a robot of its own")
def test_the_demo_moves_both_arms_there_and_back_and_ends_well(tmp_path: Path) -> None:
    """The main job: `bin/demo` without its set-up; exit status 0 says that every figure of its report is good."""
    plot = tmp_path / "plot.png"
    done = subprocess.run(
        [sys.executable, "-m", "gateway.cli", "demo", "--plot", str(plot)],
        cwd=ROOT, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "all good" in done.stdout
    assert plot.stat().st_size > 10_000


@pytest.mark.alone
def test_a_killed_client_leaves_the_arms_held_and_the_stages_fire_on_time(tmp_path: Path, systems: Systems) -> None:
    """SIGKILL in mid-move: brake and hold, arm gap < 100 ms, heartbeat on; free and down after their times (R1)."""

    def attempt(folder: Path) -> list[str]:
        system = systems(folder, config=QUICK_STAGES)
        with system.connect("watcher") as watcher:
            client = system.client("owner", SLOW_MOVE)
            moving(system, watcher)
            client.send(signal.SIGKILL)
            lost = time.monotonic()
            wait_for(lambda: watcher.state.state == "HOLDING", "HOLDING", 2.0)
            held_after = time.monotonic() - lost
            wait_for(lambda: system.is_still(), "arms at rest", 3.0)
            motion = watcher.state.motions[-1]
            assert (motion.state, motion.code) == ("aborted", Code.CLIENT_LOST.value)
            beats, frames = system.count("/api/fsm/enable"), system.count(joint_topics()[0])
            wait_for(lambda: not watcher.state.lease.owned, "a free lease", 4.0)
            free_after = time.monotonic() - lost
            assert system.count("/api/fsm/enable") > beats, "the heartbeat ended with the client"
            assert system.count(joint_topics()[0]) > frames, "the hold ended with the client"
            gap_ms = worst_gap_ms(system.stats())
            wait_for(lambda: watcher.state.state == "READ_ONLY", "everything down", 5.0)
            down_after = time.monotonic() - lost
            wait_for(lambda: system.robot_state()["fsm"] == 0, "PAUSE", 2.0)
        system.close()
        broken = []
        if held_after > 0.6:
            broken.append(f"held only after {held_after:.2f} s")
        if not 1.3 < free_after < 2.3:
            broken.append(f"lease free after {free_after:.2f} s, 1.5 was configured")
        if not 3.3 < down_after < 4.4:
            broken.append(f"down after {down_after:.2f} s, 3.5 was configured")
        if gap_ms >= 100.0:
            broken.append(f"arm gap of {gap_ms} ms at the robot")
        return broken

    steady(attempt, tmp_path)


@pytest.mark.alone
def test_a_frozen_client_is_lost_and_comes_back(tmp_path: Path, systems: Systems) -> None:
    """SIGSTOP in mid-move: the keepalive decides within 250 ms; SIGCONT before 10 s ends the clocks, nothing moves."""

    def attempt(folder: Path) -> list[str]:
        system = systems(folder)
        with system.connect("watcher") as watcher:
            client = system.client("owner", SLOW_MOVE)
            moving(system, watcher)
            client.send(signal.SIGSTOP)
            frozen = time.monotonic()
            wait_for(lambda: watcher.state.state == "HOLDING", "HOLDING", 3.0)
            held_after = time.monotonic() - frozen
            wait_for(lambda: system.is_still(), "arms at rest", 3.0)
            assert watcher.state.lease.free_in_ns is not None, "no clock runs"
            client.send(signal.SIGCONT)
            wait_for(lambda: watcher.state.lease.free_in_ns is None, "the clocks to end", 3.0)
            assert watcher.state.lease.owned
            before = system.arm_q()
            wait_for(lambda: system.count(joint_topics()[0]) % 50 == 0, "half a second of hold frames")
            drift = max(abs(a - b) for a, b in zip(before, system.arm_q(), strict=True))
            assert drift < 0.01, "the arm moved without a new command"
            gap_ms = worst_gap_ms(system.stats())
        system.close()
        broken = [] if held_after < 0.7 else [f"held only after {held_after:.2f} s"]
        return broken if gap_ms < 100.0 else [*broken, f"arm gap of {gap_ms} ms at the robot"]

    steady(attempt, tmp_path)


def test_sigterm_brakes_pauses_and_ends_within_five_seconds(tmp_path: Path, systems: Systems) -> None:
    """SIGTERM of the daemon in mid-move: brake, 0.0, exit status 0 in less than 5 s (BEHAVIOUR, SIGTERM)."""
    system = systems(tmp_path)
    with system.connect("watcher") as watcher:
        system.client("owner", SLOW_MOVE)
        moving(system, watcher)
        asked = time.monotonic()
        system.daemon.send(signal.SIGTERM)
        assert system.daemon.wait(6.0) == 0, system.daemon.text()[-1500:]
        assert time.monotonic() - asked < 5.0
    last = system.stats()["commands"]["/api/fsm/enable"]["last"]
    assert last == 0.0, "the heartbeat did not end with 0.0"
    wait_for(lambda: system.robot_state()["fsm"] == 0 and system.is_still(), "a paused robot at rest", 2.0)
    assert all(arm["stream_losses"] <= 1 for arm in system.stats()["arms"].values())


@pytest.mark.alone
def test_a_router_that_dies_and_returns_moves_nothing(tmp_path: Path, systems: Systems) -> None:
    """Router killed in mid-move and started again: OFFLINE, state back < 1 s after it listens, no motion by itself."""
    system = systems(tmp_path)
    with system.connect("watcher") as watcher:
        system.client("owner", SLOW_MOVE)
        moving(system, watcher)
        system.sim.send(signal.SIGKILL)
        system.sim.wait()
        system.forget_control()
        wait_for(lambda: watcher.state.state == "OFFLINE", "OFFLINE", 3.0)
        system.sim = system.start_sim()
        wait_for(lambda: system.control, "the robot's router")
        heard = time.monotonic()
        wait_for(lambda: watcher.state.link.fresh, "fresh state", 5.0)
        assert time.monotonic() - heard < 1.0, "state came back too late"
        start = system.arm_q()
        wait_for(lambda: watcher.state.state in {"IDLE", "READ_ONLY"}, "the base state", 3.0)
        seq = watcher.state.seq
        wait_for(lambda: watcher.state.seq > seq + 50, "a second of snapshots")
        assert system.count(joint_topics()[0]) == 0, "setpoints left although nobody enabled"
        assert system.count("/api/fsm/enable") == 0, "a heartbeat left although nobody enabled"
        assert max(abs(a - b) for a, b in zip(start, system.arm_q(), strict=True)) < 0.01


@pytest.mark.alone
def test_a_link_that_stalls_for_two_seconds_delivers_nothing_late(tmp_path: Path, systems: Systems) -> None:
    """Link stalled 2 s in mid-move: STALE at once, at most gate x rate late setpoints, PAUSE, no motion until asked."""
    system = systems(tmp_path, has_relay=True)
    with system.connect("watcher") as watcher:
        system.client("owner", SLOW_MOVE)
        moving(system, watcher)
        assert system.relay is not None
        system.relay.stall()
        stalled = time.monotonic()
        before = {topic: system.count(topic) for topic in joint_topics()}
        wait_for(lambda: watcher.state.state in {"STALE", "OFFLINE"}, "STALE", 1.0)
        wait_for(lambda: time.monotonic() - stalled > 2.0, "two seconds")
        system.relay.go_on()
        wait_for(lambda: watcher.state.link.fresh, "fresh state", 8.0)
        wait_for(lambda: watcher.state.state == "IDLE", f"IDLE, not {watcher.state.state}", 4.0)
        late = {topic: system.count(topic) - before[topic] for topic in joint_topics()}
        assert all(count <= 12 for count in late.values()), f"late setpoints: {late}"
        wait_for(lambda: system.robot_state()["fsm"] == 0 and system.is_still(), "a paused robot at rest", 3.0)
        q = system.arm_q()
        seq = watcher.state.seq
        wait_for(lambda: watcher.state.seq > seq + 50, "a second of snapshots")
        assert max(abs(a - b) for a, b in zip(q, system.arm_q(), strict=True)) < 0.01


RACER = """
import json
from gateway.errors import LeaseError
held = []
end = time.monotonic() + 6.0
while time.monotonic() < end and len(held) < 25:
    control = robot.control()
    try:
        control.acquire()
    except LeaseError:
        continue
    got = time.monotonic_ns()
    epoch = robot.state.lease.epoch
    lost = time.monotonic_ns()
    control.release()
    held.append([got, lost])
print("HELD " + json.dumps(held), flush=True)
"""


def test_two_clients_that_race_for_the_lease_never_own_it_together(tmp_path: Path, systems: Systems) -> None:
    """R4: of two clients that acquire and release as fast as they can, at most one owns the robot at any time."""
    system = systems(tmp_path)
    with system.connect("watcher"):
        racers = [system.client(f"racer{n}", RACER) for n in range(2)]
        for racer in racers:
            assert racer.wait(30.0) == 0, racer.text()
    held = [json.loads(racer.text().split("HELD ")[1]) for racer in racers]
    assert all(len(spans) > 2 for spans in held), f"a racer never got it: {held}"
    spans = sorted(span for both in held for span in both)
    assert all(a[1] < b[0] for a, b in pairwise(spans)), "two owners at once"


def test_a_second_daemon_refuses_to_start(tmp_path: Path, systems: Systems) -> None:
    """One daemon per robot and per socket: the second one says who holds it and ends with a status of its own."""
    system = systems(tmp_path)
    with system.connect("watcher") as watcher:
        second = system.start_daemon()
        assert second.wait(10.0) != 0
        wait_for(lambda: str(system.daemon.pid) in second.text(), "the pid of the first")
        assert "OTHER_GATEWAY" in second.text()
        assert watcher.state.link.fresh, "the first daemon suffered"


def test_an_estop_survives_the_daemons_death(tmp_path: Path, systems: Systems) -> None:
    """Latches live in the state file: kill -9, start again, still ESTOP; `recover` clears it (invariant 7)."""
    system = systems(tmp_path)
    with system.connect("watcher") as watcher:
        watcher.estop("test")
        wait_for(lambda: watcher.state.shown == "ESTOP", "ESTOP")
        state_files = list((tmp_path / "state").glob("*.json"))
        wait_for(lambda: any("ESTOP" in file.read_text() for file in state_files), "the latch on disk")
    system.daemon.send(signal.SIGKILL)
    system.daemon.wait()
    system.daemon = system.start_daemon()
    with system.connect("owner") as robot:
        assert robot.state.shown == "ESTOP"
        with robot.control() as own, pytest.raises(Exception, match="ESTOP") as refused:
            own.enable(timeout=5.0)
        assert getattr(refused.value, "code", None) is Code.LATCHED
        robot.recover()
        wait_for(lambda: robot.state.shown != "ESTOP", "the end of the latch")


def test_an_estop_survives_another_address_of_the_robot(tmp_path: Path, systems: Systems) -> None:
    """Another port of another name: the router says who it is. Cleared there, it is cleared under the first address, too.

    The first daemon's guard still says the e-stop's 0.0 for a second; who starts under its address meanwhile takes its latch
    over, as after any death.
    """
    system = systems(tmp_path, has_relay=True)
    addresses = system.robot_endpoint, f"tcp/localhost:{system.sim_port}"

    def latched() -> list[bool]:
        return ["ESTOP" in file.read_text() for file in (tmp_path / "state").glob("*.json")]

    with system.connect("watcher") as watcher:
        wait_for(lambda: watcher.state.view.guard.linked, "the first daemon's guard")
        watcher.estop("test")
        wait_for(lambda: any(latched()), "the latch on disk")
    for address, shown in ((addresses[1], "ESTOP"), (addresses[0], "")):
        system.daemon.send(signal.SIGKILL)
        system.daemon.wait()
        system.robot_endpoint = address
        system.daemon = system.start_daemon()
        with system.connect("owner") as robot:
            assert ("ESTOP" in robot.state.latches) is bool(shown)
            if shown:
                assert "known from" in robot.state.latches["ESTOP"]
                robot.recover()
                wait_for(lambda: latched() == [False, False], "a latch that is cleared in both files")
                wait_for(lambda: not guard_socket(tmp_path / "gw.sock").exists(), "the end of the first daemon's guard")


def test_a_takeover_brakes_and_ends_the_old_owner(tmp_path: Path, systems: Systems) -> None:
    """`take` in mid-move: the old owner's handle ends LEASE_LOST, the arms brake and are held, the new owner goes on."""
    system = systems(tmp_path)
    with system.connect("boss") as boss:
        client = system.client(
            "owner", SLOW_MOVE.replace("own.move_to(HOME, speed=0.15)", "own.move_to(HOME, speed=0.15).result(60)")
        )
        moving(system, boss)
        with boss.control(take="test") as own:
            assert client.wait(10.0) != 0
            assert "LEASE_LOST" in client.text(), client.text()
            wait_for(lambda: boss.state.state == "HOLDING" and system.is_still(), "a held robot")
            wait_for(lambda: _can_hold(own.left_arm.move_by), "the new owner's motion")


def _can_hold(move_by: Callable[..., MotionHandle]) -> bool:
    try:
        move_by([0.01] * 7, speed=0.5).result(10.0)
    except LeaseError as braking:
        assert braking.code is Code.TAKEOVER_BRAKING
        return False
    return True
