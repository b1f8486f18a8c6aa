"""Stops and owners as strangers meet them: bare zenoh programs at the gateway's socket and at the robot's router."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from cdr_types.codec import decode, encode
from cdr_types.messages.sensor_msgs import JointState
from gateway.client import Control, Robot
from gateway.errors import Aborted, Code, GatewayError, MotionEnded
from tests.changed import replace
from tests.e2e.system import System, wait_for
from tests.fuzz.attacker import connect as connect_raw

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("what strangers say to the gateway is the matter, not the robot")]

JSON = "application/json"
S = 1_000_000_000

OWNER = """
with robot.control() as own:
    own.enable(timeout=12.0)
    print("SECRET", robot._session.secret, flush=True)
    own.move_to(HOME, speed=0.1)
    time.sleep(60)
"""
"""Owns the robot and moves both arms for some ten seconds."""


@contextmanager
def stranger(system: System) -> Iterator[zenoh.Session]:
    """Give a bare zenoh session at the gateway's socket."""
    with connect_raw(f"unixsock-stream/{system.target}") as session:
        yield session


def asked(session: zenoh.Session, key: str, message: dict[str, Any] | None = None) -> dict[str, Any]:
    """Ask in JSON, as any program can, and return the answer."""
    payload = b"" if message is None else json.dumps(message).encode()
    for reply in session.get(key, payload=payload, encoding=JSON, timeout=5.0):
        if reply.ok is not None:
            answer: dict[str, Any] = json.loads(reply.ok.payload.to_bytes())
            return answer
    pytest.fail(f"no answer on {key}")


Stopping = Callable[[zenoh.Session, System], object]


def put(key: str, payload: bytes = b"", **how: Any) -> Stopping:
    """Return what puts it; zenoh lets what has many pieces fall at its sender, on a busy host, unless that may wait."""
    return lambda session, system: session.put(key, payload, **how)


def shell(command: str) -> Stopping:
    """Return what runs a line of a shell that knows nothing but the socket's place."""
    return lambda session, system: subprocess.run(["sh", "-c", command.format(system.target)], check=True, timeout=10)


LATER_RELEASE = json.dumps({"version": 99, "client_id": "a.b" * 40, "unknown": [1], "reason": None}).encode()

STOPS: dict[str, Stopping] = {
    "nothing": put("ta2/stop"),
    "ten bytes": put("ta2/stop", b"smoke here"),
    "no text": put("ta2/stop", b"\xff\xfe\x80"),
    "a later release": put("ta2/stop", LATER_RELEASE),
    "a lone surrogate": put("ta2/stop", b'{"name": "\\ud800", "reason": "\\udfff"}'),
    "60,000 bytes": put("ta2/stop", b"[" * 60_000, congestion_control=zenoh.CongestionControl.BLOCK),
    "a deletion": lambda session, system: session.delete("ta2/stop"),
    "a question": lambda session, system: asked(session, "ta2/stop"),
    "an e-stop": put("ta2/estop", b"smoke here"),
    "an e-stop that is asked": lambda session, system: asked(session, "ta2/estop", {"name": "Ann", "reason": "smoke"}),
    "an empty line of a shell": shell("echo > {0}.stop"),
    "a shell's e-stop": shell("echo smoke | dd of={0}.estop oflag=nonblock conv=nocreat"),
}


SMOKE = ("ten bytes", "an e-stop", "an e-stop that is asked", "a shell's e-stop")
"""Those that say why."""


def test_whatever_arrives_on_the_keys_of_stops_ends_motion_and_latches(tmp_path: Path, systems: Any) -> None:
    """Of a session that shares nothing with our client but the socket, or of none; each in mid-move."""
    system = systems(tmp_path, has_guard=False)
    with system.connect("owner") as robot, stranger(system) as session, robot.control() as own:
        for name, stop in STOPS.items():
            wait_for(lambda: can_enable(own), "enabled")
            motion = own.left_arm.move_by(np.full(7, 0.2), speed=0.05)
            wait_for(lambda motion=motion: motion.progress > 0.0, "motion")
            stop(session, system)
            with pytest.raises(MotionEnded):
                motion.result(timeout=10.0)
            latch = Code.ESTOP if "e-stop" in name else Code.STOPPED_BY_OTHER
            wait_for(lambda latch=latch: list(robot.state.latches) == [latch], f"the latch after {name}")
            assert name not in SMOKE or "smoke" in robot.state.latches[latch]
            wait_for(lambda name=name: robot.state.fsm == 0 if "e-stop" in name else system.is_still(), "rest")
            robot.recover()


@pytest.fixture
def owned(tmp_path: Path, systems: Any) -> Iterator[tuple[System, Robot, Any]]:
    """Give a system whose owner, a process, moves both arms, a watcher, and the owner's process."""
    system = systems(tmp_path, has_guard=False)
    with system.connect("watcher") as watcher:
        client = system.client("owner", OWNER)
        wait_for(
            lambda: any(m.state == "executing" and m.progress > 0.05 for m in watcher.state.motions),
            "a motion under way", tell=client.text,
        )  # fmt: skip
        yield system, watcher, client


def lost_after_ns(watcher: Robot, since_ns: int) -> int:
    """Wait until the owner is lost and return how long after `since_ns` that was [ns]."""
    told = wait_for(
        lambda: next((n for n in watcher.events() if n.code == Code.LOSS_STAGE and n.facts["stage"] == "lost"), None),
        "the loss of the owner", 5.0,
    )  # fmt: skip
    return int(told.at_ns) - since_ns


def test_nobody_commands_under_the_owners_id(owned: tuple[System, Robot, Any]) -> None:
    """What a snapshot shows is not enough to move, to release, to end his connection, or to keep him alive."""
    system, watcher, client = owned
    with stranger(system) as session:
        lease = asked(session, "ta2/1/snapshot")["lease"]
        owner, epoch = lease["client_id"], lease["epoch"]
        assert client.text().split("SECRET")[1].split()[0] not in json.dumps(asked(session, "ta2/1/snapshot"))
        home = {"type": "move", "epoch": epoch, "targets_rad": {"left": [0.0] * 7}}
        for request in (home, {"type": "release", "epoch": epoch}, {"type": "disable", "epoch": epoch}):
            for number, secret in enumerate(({}, {"secret": ""}, {"secret": "guess"})):
                message = {"version": 1, "client_id": owner, "request_id": 2**40 + number, "request": request, **secret}
                refusal = asked(session, "ta2/1/command", message)["refusal"]
                assert refusal["code"] == Code.NOT_OWNER and repr(owner) in refusal["message"]
        token = session.liveliness().declare_token(f"ta2/1/alive/client/{owner}")
        token.undeclare()
        session.put(
            f"ta2/1/target/{owner}/1/guess", json.dumps({"epoch": epoch, "seq": 1, "values": [0.0] * 7}).encode()
        )
        seen = watcher.fresh_state()
        assert seen.state == "ACTIVE" and [m.state for m in seen.motions] == ["executing"] and seen.lease.epoch == epoch
        frozen_ns = time.monotonic_ns()
        client.send(signal.SIGSTOP)
        keys = [f"ta2/1/keepalive/{owner}{rest}" for rest in ("", "/guess")]

        def is_held() -> bool:
            for key in keys:
                session.put(key, b"")
            return watcher.state.state == "HOLDING"

        wait_for(is_held, "HOLDING while somebody else says that the owner lives", 5.0)
        assert lost_after_ns(watcher, frozen_ns) < S // 2


def test_a_daemon_that_is_always_late_loses_a_vanished_owner_in_time(owned: tuple[System, Robot, Any]) -> None:
    """It runs for 10 ms of each 55: lateness is no sign of life."""
    system, watcher, client = owned
    is_over = threading.Event()

    def hold_up() -> None:
        while not is_over.wait(0.01):
            os.kill(system.daemon.pid, signal.SIGSTOP)
            is_over.wait(0.045)
            os.kill(system.daemon.pid, signal.SIGCONT)

    hindrance = threading.Thread(target=hold_up)
    frozen_ns = time.monotonic_ns()
    client.send(signal.SIGSTOP)
    hindrance.start()
    try:
        wait_for(lambda: watcher.state.state == "HOLDING", "HOLDING", 5.0)
    finally:
        is_over.set()
        hindrance.join()
    held = next(n for n in watcher.events() if n.code == Code.STATE_CHANGED and "HOLDING" in n.message)
    assert held.at_ns - frozen_ns < S // 2


def test_a_robot_that_pauses_by_itself_takes_its_references_along(tmp_path: Path, systems: Any) -> None:
    """In mid-move at full speed; in each snapshot of the pause the reference is where the arm is measured."""
    system = systems(tmp_path, has_guard=False)
    with system.connect("owner") as robot, robot.control() as own:
        own.enable()
        motion = own.left_arm.move_by(0.5 * np.array([0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
        wait_for(lambda: float(np.abs(robot.state.left_arm.dq_ref).max()) > 0.5, "speed")
        system.control.fault("pause", duration_s=1.0)
        with pytest.raises(Aborted):
            motion.result(timeout=10.0)
        paused = robot.fresh_state()
        until_ns = paused.view.at_ns + S // 2
        while (seen := robot.fresh_state()).view.at_ns < until_ns:
            if seen.state == "PAUSED":
                apart = float(np.abs(seen.left_arm.q_ref - seen.left_arm.q).max())
                assert apart <= 0.02, f"the reference stands {apart:.3f} rad from the arm"
        wait_for(lambda: can_enable(own), "enabled again")
        assert system.stats()["arms"]["left"]["clips"] == 0


def can_enable(own: Control) -> bool:
    """Return whether the robot may run again: its pause may not be over."""
    try:
        own.enable(timeout=3.0)
    except GatewayError:
        return False
    return True


def test_a_forged_sample_with_a_stamp_ahead_moves_no_arm(tmp_path: Path, systems: Any) -> None:
    """Somebody on the robot's network says all the while that a joint is 0.6 rad away, by a clock that is 10 s ahead."""
    system = systems(tmp_path, has_guard=False)
    with system.connect("owner") as robot, connect_raw(system.endpoint) as session, robot.control() as own:
        before = np.array(system.arm_q())
        heard: list[bytes] = []
        listening = session.declare_subscriber(
            "left_arm/joint_states", lambda sample: heard.append(sample.payload.to_bytes())
        )
        good = decode(wait_for(lambda: heard[-1:], "a sample")[0], JointState)
        listening.undeclare()
        stamp = replace(good.header.stamp, sec=good.header.stamp.sec + 10)
        q_rad = [good.position[0] + 0.6, *good.position[1:]]
        forged = encode(replace(good, header=replace(good.header, stamp=stamp), position=q_rad))
        is_over = threading.Event()

        def lie() -> None:
            while not is_over.wait(0.02):
                session.put("left_arm/joint_states", forged)

        liar = threading.Thread(target=lie)
        liar.start()
        try:
            for _ in range(3):
                can_enable(own)
                worst = float(np.abs(np.array(system.arm_q()) - before).max())
                assert worst < 0.01, f"an arm moved by {worst:.3f} rad"
        finally:
            is_over.set()
            liar.join()
        wait_for(lambda: can_enable(own), "enabled once the lies ended")
        assert float(np.abs(np.array(system.arm_q()) - before).max()) < 0.01
