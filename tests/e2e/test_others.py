"""Somebody else on the robot, end to end: a foreign writer in mid-motion, two daemons for one robot, and our own restart."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.client import Robot, connect
from gateway.client.control import Control
from gateway.errors import Code, GatewayError, NotReady
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import joint_command
from gateway.values import Side
from tests.e2e.system import Process, Relay, System, steady, wait_for
from tests.stranger import Stranger

pytestmark = [pytest.mark.e2e, pytest.mark.body_free("who else commands is the matter")]

Systems = Callable[..., System]

LEFT = joint_command(Side.LEFT)
HOME = {side.value: HOME_Q_RAD[side] for side in Side}
SLOW_MOVE = """
with robot.control() as own:
    own.enable(timeout=12.0)
    own.move_to(HOME, speed=0.15)
    time.sleep(60)
"""


def moving(system: System, watcher: Robot) -> None:
    """Wait until a motion is well under way."""
    wait_for(
        lambda: any(m.state == "executing" and m.progress > 0.1 for m in watcher.state.motions),
        f"a motion under way ({system.clients[-1].text()})",
    )


def enabled(own: Control) -> bool:
    """Enable; return False while the guard of the former daemon still has the robot."""
    try:
        own.enable(timeout=12.0)
    except NotReady as error:
        if error.code is not Code.HELD_BY_GUARD:
            raise
        return False
    return True


class Second:
    """A second daemon for the same robot, as of another computer: address of the robot, socket and state of its own.

    Args:
        system: The robot's.
        folder: For its files.
    """

    def __init__(self, system: System, folder: Path) -> None:
        folder.mkdir()
        self.target = str(folder / "gw.sock")
        self.relay = Relay(system.sim_port)
        endpoint = f"tcp/127.0.0.1:{self.relay.port}"
        arguments = ["-m", "gateway.cli", "run", "--robot", endpoint, "--socket", self.target]
        self.process = Process("daemon", arguments, folder, {"TA2_STATE_DIR": str(folder / "state")})
        system.clients.append(self.process)

    def close(self) -> None:
        """End it."""
        self.process.end()
        self.relay.close()

    def connect(self, name: str) -> Robot:
        """Connect a client as soon as the daemon sees a live robot."""
        robot = wait_for(lambda: connect(self.target, name=name, timeout_s=1.0), self.process.text())
        wait_for(lambda: robot.state.link.fresh and robot.state.mode is not None, "a live robot")
        assert isinstance(robot, Robot)
        return robot


def refusal_of(action: Callable[[], object]) -> GatewayError | None:
    """Return why an action was refused; None when it was not."""
    try:
        action()
    except GatewayError as error:
        return error
    return None


@pytest.mark.alone
def test_a_foreign_writer_in_mid_motion_ends_ours_at_once_and_everybody_is_told(
    tmp_path: Path, systems: Systems
) -> None:
    """A second session puts setpoints at 100 Hz: 0.0 once, no frame of ours 100 ms later; named; recover waits for its end."""

    def attempt(folder: Path) -> list[str]:
        system = systems(folder)
        with system.connect("watcher") as watcher:
            stranger = Stranger(system.endpoint, stamps=True)
            system.client("owner", SLOW_MOVE)
            moving(system, watcher)
            pose = [float(q) for q in watcher.state.left_arm.q]
            begun_ns = time.monotonic_ns()
            deadline = begun_ns + 600_000_000
            while time.monotonic_ns() < deadline:
                stranger.put(LEFT, pose)
                time.sleep(0.01)
            assert watcher.state.state == "IDLE" and watcher.state.shown == "FAULT"
            assert stranger.zid in watcher.state.latches[Code.FOREIGN_WRITER.value]
            told = [n for n in watcher.events(timeout=0.2) if n.code == Code.FOREIGN_WRITER.value]
            (latch,) = [n for n in watcher.events(timeout=0.2) if n.code == Code.LATCH_CHANGED.value]
            assert told and told[0].facts["zid"] == stranger.zid and told[0].facts["topic"] == LEFT
            (seen,) = watcher.state.others.seen
            assert (seen.kind, seen.topic, seen.zid) == ("data", LEFT, stranger.zid)
            frames = watcher.state.view.streams[LEFT].sent
            assert watcher.state.motions[-1].code == Code.FOREIGN_WRITER.value
            persists = refusal_of(watcher.recover)
            assert persists is not None and persists.code is Code.LATCH_PERSISTS
            wait_for(lambda: refusal_of(watcher.recover) is None, "recover after its end", 5.0)
            assert watcher.state.view.streams[LEFT].sent == frames, "frames of ours after it"
            delay_ms = (latch.at_ns - begun_ns) / 1e6
        stranger.close()
        system.close()
        return [] if delay_ms <= 100.0 else [f"ended {delay_ms:.0f} ms after the first foreign sample"]

    steady(attempt, tmp_path)


def test_the_second_gateway_is_refused_by_name_until_the_first_is_done(tmp_path: Path, systems: Systems) -> None:
    """Two daemons, one robot: its owner keeps it undisturbed; who comes later reads OTHER_GATEWAY and gets its turn."""
    system = systems(tmp_path)
    second = Second(system, tmp_path / "second")
    with system.connect("ann") as first, second.connect("bob") as other, first.control() as own:
        own.enable(timeout=12.0)
        first_zid = first.state.others.zid
        wait_for(lambda: any(seen.armed for seen in other.state.others.seen), "the armed token of the first", 2.0)
        with other.control() as late:
            refused = refusal_of(lambda: late.enable(timeout=5.0))
            assert refused is not None and refused.code is Code.OTHER_GATEWAY and first_zid in str(refused)
            assert first.state.state == "ACTIVE" and not first.state.latches, "the first one suffered"
            assert {(seen.kind, seen.armed) for seen in first.state.others.seen} == {
                ("gateway", False)
            }  # and its guard
            own.release()
            wait_for(lambda: not any(seen.armed for seen in other.state.others.seen), "the end of its claim", 8.0)
            wait_for(lambda: other.state.fsm == 0, "PAUSE", 5.0)
            late.enable(timeout=12.0)
            assert other.state.state == "ACTIVE"
    second.close()


ENABLE = """
from gateway.errors import GatewayError
try:
    with robot.control() as own:
        print("GO", flush=True)
        own.enable(timeout=12.0)
        print("PROCEEDS", flush=True)
        time.sleep(3)
except GatewayError as error:
    print("REFUSED", error.code, flush=True)
"""


def test_of_two_gateways_that_enable_at_once_exactly_one_proceeds(tmp_path: Path, systems: Systems) -> None:
    """Whoever it is, the other's frames never reach the robot: every setpoint comes from one of them."""
    system = systems(tmp_path)
    second = Second(system, tmp_path / "second")
    with system.connect("watcher"), second.connect("watcher2"):
        racers = []
        for name, target in (("racer1", system.target), ("racer2", second.target)):
            program = f"import time\nfrom gateway.client import connect\nrobot = connect({target!r}, timeout_s=10.0)\n"
            racers.append(Process(name, ["-u", "-c", program + ENABLE], tmp_path))
        system.clients += racers
        for racer in racers:
            racer.wait(30.0)
    second.close()
    words = [racer.text() for racer in racers]
    assert sum("PROCEEDS" in text for text in words) == 1, words
    assert sum("REFUSED OTHER_GATEWAY" in text for text in words) == 1, words


@pytest.mark.parametrize("has_guard", [True, pytest.param(False, marks=pytest.mark.thorough)])
def test_our_own_restart_is_no_alarm(tmp_path: Path, systems: Systems, has_guard: bool) -> None:
    """Kill -9 in mid-motion and start again at once: no foreign writer, no other gateway, for guard and next daemon."""
    system = systems(tmp_path, config=f"[guard]\nenabled = {str(has_guard).lower()}\n")
    with system.connect("watcher") as watcher:
        system.client("owner", SLOW_MOVE)
        moving(system, watcher)
        if has_guard:
            wait_for(lambda: watcher.state.view.guard.linked, "a guard that can take over")
        former = watcher.state.others.zid
        states = list((tmp_path / "state").glob("*.json"))
        assert any(former in file.read_text() for file in states)
    system.daemon.send(signal.SIGKILL)
    system.daemon.wait()
    system.daemon = system.start_daemon()
    with system.connect("ann") as robot:
        assert robot.state.others.zid not in ("", former)
        if has_guard:
            # On a machine too busy for 100 ms of fresh state the guard pauses the robot instead.
            wait_for(
                lambda: robot.state.state == "HOLDING" or robot.state.fsm == 0, "the end of the guard's hold", 12.0
            )
        else:
            wait_for(lambda: robot.state.fsm == 0, "PAUSE", 5.0)
        with robot.control() as own:
            wait_for(lambda: enabled(own), "the end of the guard's hold", 15.0)
            assert not robot.state.latches and robot.state.others.seen == ()
        told = {notice.code for notice in robot.events(timeout=0.2)}
        assert not told & {Code.FOREIGN_WRITER.value, Code.OTHER_GATEWAY.value}
    log = system.daemon.text()
    assert "FOREIGN_WRITER" not in log and "commands the robot, or is about to" not in log
