"""The link to the robot is lost in mid-move: what reaches the robot's DDS graph afterwards, and what moves.

Both arms move towards the initial position, each through its own topic. What is late is told by the stamps of the
setpoints as DDS delivers them. The bounds are those of a 100 ms stale gate with an announced lease of 500 ms.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.client import Robot
from tests.e2e.system import Process, System, joint_topics, wait_for
from tests.e2e.test_heart import moving
from tests.interop.bridge_process import bridge_program, demand
from tests.interop.cable import FarSystem, demand_cable
from tests.thoroughness import either

pytestmark = [pytest.mark.e2e, pytest.mark.interop]

GATE_FRAMES = 12
"""Setpoints of one topic that may have been sent before the state was seen to be stale: 100 ms at 100 Hz, and a tick on
either side."""
LONGEST_STEP_RAD = 0.01
"""A joint's speed limit of 1 rad/s over one period."""

OWNER = """
from pathlib import Path
from gateway.errors import Aborted, GatewayError, Stale
WORD = Path({word!r})
with robot.control() as own:
    own.enable(timeout=15.0)
    print("enabled", flush=True)
    try:
        own.move_to(HOME, speed=0.15).result(timeout=60.0)
    except GatewayError as error:
        print("ended by", error.code.value, flush=True)
    while not WORD.exists():
        time.sleep(0.01)
    for attempt in range(50):
        try:
            own.enable(timeout=15.0)
            own.move_to(HOME, speed=0.5).result(timeout=30.0)
            print("there", flush=True)
            break
        except (Aborted, Stale):  # the machine is busy
            time.sleep(0.1)
"""
"""Moves both arms slowly; whatever ends that, it goes on only when a file says so."""


@pytest.fixture
def far(tmp_path: Path) -> Iterator[Callable[[], FarSystem]]:
    """Give a maker of systems with a cable between robot and daemon."""
    demand()
    demand_cable()
    made: list[FarSystem] = []

    def make() -> FarSystem:
        made.append(FarSystem(tmp_path))
        return made[-1]

    yield make
    for system in made:
        system.close()


class Move:
    """An owner who moves both arms, and the robot's view of it.

    Args:
        system: Robot and daemon.
        watcher: A client.
    """

    def __init__(self, system: System, watcher: Robot) -> None:
        self._system, self._watcher = system, watcher
        self._word = system.folder / "go on"
        self.owner = system.client("owner", OWNER.format(word=str(self._word)))
        moving(system, watcher)

    def commands(self) -> dict[str, dict[str, Any]]:
        """Return what the robot saw on the topics of both arms."""
        commands = self._system.stats()["commands"]
        return {topic: commands[topic] for topic in joint_topics()}

    def late(self) -> dict[str, int]:
        """Return how many setpoints of each topic were older than 100 ms when DDS delivered them."""
        return {topic: int(seen["late"]) for topic, seen in self.commands().items()}

    def steps(self) -> dict[str, float]:
        """Return the longest step of each arm's setpoints [rad]."""
        return {side: max(arm["commanded"]["peak_step_rad"]) for side, arm in self._system.stats()["arms"].items()}

    def is_back_after_s(self, mended: float) -> float:
        """Return how long after the link was mended fresh state came for good [s]: some queued one may come before."""
        since: list[float] = []

        def is_back() -> bool:
            state = self._watcher.state
            if not (state.link.up and state.link.fresh):
                since.clear()
            elif not since:
                since.append(time.monotonic())
            return bool(since) and time.monotonic() - since[0] > 0.5

        wait_for(is_back, f"fresh state ({self._watcher.state})", 10.0)
        return since[0] - mended

    def rests(self, *, most_late: int) -> None:
        """Judge a link that is good again from this moment on: state is back, and what came late was little and no step.

        Args:
            most_late: So many setpoints of a topic may have been older than 100 ms.
        """
        back_s = self.is_back_after_s(time.monotonic())
        assert back_s < 3.0, f"state came back after {back_s:.1f} s"
        wait_for(lambda: self._watcher.state.state in {"HOLDING", "IDLE"}, f"rest ({self._watcher.state.state})", 3.0)
        late = self.late()
        print(f"late setpoints: {late}, at most {most_late}; state back after {back_s:.2f} s")
        assert max(late.values()) <= most_late, (late, self.commands())
        assert max(self.steps().values()) <= 1.05 * LONGEST_STEP_RAD, self.steps()

    def stays(self, snapshots: int = 75) -> None:
        """Fail when an arm moves during so many snapshots at 50 Hz."""
        wait_for(lambda: self._system.is_still(), "arms at rest", 3.0)
        before, seq = self._system.arm_q(), self._watcher.state.seq
        wait_for(lambda: self._watcher.state.seq > seq + snapshots, "snapshots")
        after = self._system.arm_q()
        assert max(abs(a - b) for a, b in zip(before, after, strict=True)) < 0.01

    def goes_on(self) -> None:
        """Let the owner enable and move: nothing but his word was missing."""
        self._word.write_text("")
        wait_for(lambda: "there" in self.owner.text() or not self.owner.is_running, "the owner's arrival", 40.0)
        assert "there" in self.owner.text(), self.owner.text()


def passes(seconds: float) -> None:
    """Let real time pass: a link is away for that long."""
    until = time.monotonic() + seconds
    wait_for(lambda: time.monotonic() >= until, "the time", seconds + 5.0)


@pytest.mark.parametrize("drop_s", [0.2, 0.4, 2.0, 5.0])
def test_a_link_that_drops_delivers_nothing_old_and_nothing_moves_until_asked(
    far: Callable[[], FarSystem], drop_s: float
) -> None:
    """From 0.4 s on nothing older than 100 ms, below at most gate x rate; then rest until the owner says otherwise."""
    system = far()
    with system.connect("watcher") as watcher:
        move = Move(system, watcher)
        assert not any(move.late().values()), "the link was good"
        system.cable.cut()
        passes(drop_s)
        system.cable.mend()
        move.rests(most_late=GATE_FRAMES if drop_s < 0.4 else 0)
        wait_for(lambda: "ended by" in move.owner.text(), "the owner knows")
        if drop_s >= 0.8:
            wait_for(lambda: watcher.state.state == "IDLE" and system.robot_state()["fsm"] == 0, "a paused robot", 3.0)
        move.stays()
        if drop_s >= 0.8:
            assert system.robot_state()["fsm"] == 0, "it stays in PAUSE until somebody enables it"
        move.goes_on()


def bridge_of(system: System) -> int:
    """Return the process id of the robot's bridge."""
    program = str(bridge_program())
    for pid in system.sim.pids:
        if Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")[0].decode() == program:
            return pid
    pytest.fail(f"no bridge among {system.sim.pids}")


@pytest.mark.parametrize("freeze_s", [0.8, 2.0])
def test_a_frozen_bridge_delivers_at_most_what_left_before_the_state_was_stale(
    far: Callable[[], FarSystem], freeze_s: float
) -> None:
    """Whether its lease timer or its socket comes first is a race; either way steps stay small and nothing moves."""
    system = far()
    with system.connect("watcher") as watcher:
        move = Move(system, watcher)
        bridge = bridge_of(system)
        os.kill(bridge, signal.SIGSTOP)
        try:
            passes(freeze_s)
        finally:
            os.kill(bridge, signal.SIGCONT)
        move.rests(most_late=GATE_FRAMES)
        move.stays()
        move.goes_on()


@pytest.mark.alone
def test_a_busy_computer_is_no_lost_link(far: Callable[[], FarSystem]) -> None:
    """Four processes that never rest beside robot and daemon: the announced lease of 500 ms is kept all the time."""
    system = far()
    hogs: list[Process] = []
    with system.connect("watcher") as watcher:
        router = watcher.state.link.router_zid
        try:
            hogs += [Process(f"hog{n}", ["-c", "while True: pass"], system.folder) for n in range(4)]
            passes(either(10.0, 60.0))
        finally:
            for hog in hogs:
                os.kill(hog.pid, signal.SIGKILL)
                hog.end()
        lost = [notice for notice in watcher.events(timeout=0.1) if notice.code == "LINK_DOWN"]
        assert not lost and watcher.state.link.router_zid == router


BYSTANDER = """
import json, signal, sys, time, zenoh
config = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}, "scouting": {"multicast": {"enabled": False}}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
last_s, worst_s = None, 0.0
def take(sample):
    global last_s, worst_s
    now_s = time.monotonic()
    if last_s is None:
        print("hears", flush=True)
    else:
        worst_s = max(worst_s, now_s - last_s)
    last_s = now_s
def tell(*_):
    print("worst", max(worst_s, time.monotonic() - last_s), flush=True)
    session.close()
    sys.exit(0)
signal.signal(signal.SIGTERM, tell)
held = session.declare_subscriber("left_arm/joint_states", take)
while True:
    time.sleep(0.1)
"""
"""Somebody else at the robot's router, beside the robot: hears the left arm, and tells the longest silence [s]."""


@pytest.mark.alone
def test_a_gateway_whose_link_is_cut_does_not_hold_up_the_robots_bridge_for_others(
    far: Callable[[], FarSystem],
) -> None:
    """The bridge waits 5 s for whoever takes nothing when its buffers are full: our lease ends before they are."""
    system = far()
    with system.connect("watcher"):
        other = Process("other", ["-u", "-c", BYSTANDER, system.endpoint], system.folder, before=system.robot_place)
        try:
            wait_for(lambda: "hears" in other.text(), "somebody else")
            system.cable.cut()
            passes(3.0)
            other.send(signal.SIGTERM)
            other.wait()
        finally:
            system.cable.mend()
            other.end()
    assert float(other.text().split()[-1]) < 1.0, other.text()
