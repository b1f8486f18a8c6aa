"""Each thread of daemon, guard, client and simulated robot ends in mid-motion, by a panic: what the robot sees of it.

One robot for all of them: after each daemon the next one takes the hold over, is recovered, and moves on. Beside them a
daemon of which nothing ends, and which answers nobody.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gateway.client import Robot
from gateway.client.asking.guard_stop import stop_at_guard
from gateway.client.control import Control
from gateway.errors import Code, GatewayError
from gateway.guard.api_watch import END_MISSES, PATIENCE_S
from gateway.values import Side
from tests.e2e.system import Process, System, joint_topics, steady, wait_for, worst_gap_ms
from tests.e2e.test_guard import MOVER, Scene, favour, gone, is_taken_over

pytestmark = [pytest.mark.e2e, pytest.mark.alone, pytest.mark.sim_only("threads of ours end, whatever the robot is")]

API = ("ta2-api-read", "ta2-api-send", "ta2-api-stop", "ta2-api-floods")
DAEMON = (*API, "state-file log", "guard-launcher robot-claim", "robot-link")
"""Those in one word end in one instant: each cycle costs some seconds."""
GUARD = ("robot-link", "robot-claim", "core-probe", "api-watch", "log", "MainThread")
HARMLESS = ("black-box", "settings")
"""With the first the recording ends and nothing else: tests/incident/test_recorder.py; what reads the settings anew is begun
again, in mid-motion in tests/e2e/test_reloading.py."""
PASSING = ("hear-commands",)
"""It ends by itself, in milliseconds."""
ZENOHS = ("Dummy-", "pyo3-closure")
"""Threads in which zenoh calls us: an error there ends the call, and nothing else."""
SILENT = "the API of this gateway does not answer its guard"
STOP_S = 1.0
"""A stop is answered within this time, by daemon or guard [s]; on a steady machine it takes some 10 ms."""

OWNER = """
from gateway.errors import LeaseError
with robot.control(on_loss='hold', take='the next one') as own:
    own.enable(timeout=10.0)
    goals = [HOME, {s: HOME[s] * 0.7 for s in HOME}]
    try:
        while True:
            for goal in goals:
                motion = own.move_to(goal, speed=0.6)
                while not motion.done:
                    own.chassis.set_velocity(0.1, 0.0, 0.0)
                    time.sleep(0.05)
    except LeaseError as error:
        print('ended:', error.code, error.message, flush=True)
"""

SLOW_MOVER = MOVER.replace("speed=0.6", "speed=0.3")
"""What a tick covers that comes late on a busy host is no step, then."""


class Ending:
    """Ends threads of processes that were started after it was made.

    Args:
        folder: Where it leaves word.
        patch: For this process's environment, which all others inherit.
    """

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self._word = folder / "ending"
        paths = [str(Path(__file__).parent / "ending"), *filter(None, [os.environ.get("PYTHONPATH")])]
        patch.setenv("PYTHONPATH", os.pathsep.join(paths))
        patch.setenv("ENDING", str(self._word))

    def end(self, pid: int, name: str) -> None:
        """End a thread, or some; or with `hang` and `deaf` the work of the one that answers stops."""
        self._word.write_text(name)
        os.kill(pid, signal.SIGUSR2)

    def strangers(self, pid: int, known: tuple[str, ...]) -> set[str]:
        """Return the names of a process's threads that are neither known nor zenoh's."""
        names = self._word.with_suffix(f".{pid}")
        self.end(pid, "")
        found = wait_for(lambda: names.exists() and names.read_text().endswith("\n") and names.read_text(), "names")
        return {
            name
            for name in found.splitlines()
            if name not in {*known, *PASSING, "MainThread"} and not any(mark in name for mark in ZENOHS)
        }


class Moving:
    """A robot that is moved by this process, daemon after daemon.

    Args:
        folder: For sockets, state and logs.
    """

    def __init__(self, folder: Path) -> None:
        self.system = System(folder)
        self.robot: Robot | None = None
        self.broken: list[str] = []
        self._goals = 0

    @property
    def view(self) -> Any:
        """What the daemon shows."""
        assert self.robot is not None
        return self.robot.state.view

    def count(self) -> int:
        """How many setpoints have arrived, of the arm that got fewer."""
        return min(map(self.system.count, joint_topics()))

    def begin(self) -> Control:
        """Connect to the daemon that has just started, and return its owner when all moves."""
        self.robot = robot = self.system.connect()
        assert isinstance(robot, Robot)
        for pid in self.system.sim.pids:
            favour(pid)
        wait_for(lambda: self.view.guard.linked and not self.view.guard.earlier_holds, "a linked guard")
        robot.recover()
        own = robot.control(on_loss="hold").acquire()
        own.enable(timeout=10.0)
        own.left_gripper.grip(0.6)
        self.move(own)
        return own

    def move(self, own: Control) -> None:
        """Be in the middle of a motion of both arms and the chassis."""
        self._goals += 1
        by = 0.8 if self._goals % 2 else -0.8
        own.move_by({side.value: [by, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] for side in Side}, speed=0.3)
        own.chassis.set_velocity(0.1, 0.0, 0.0)
        wait_for(lambda: any(abs(v) > 0.1 for v in self.view.arms["left"].dq_ref_radps), "motion at speed")

    def leave(self) -> None:
        """Let the daemon be."""
        if self.robot is not None:
            with contextlib.suppress(Exception):
                self.robot.close()

    def judge(self, what: str) -> None:
        """Note what the robot saw that it must not see."""
        stats = self.system.stats()
        found = [f"arm gap {gap_ms} ms"] if (gap_ms := worst_gap_ms(stats)) >= 100.0 else []
        if stats["counts"].get("GRIPPER_WATCHDOG"):
            found.append("the grip was lost")
        if self.system.robot_state()["fsm"] != 2:
            found.append("the robot paused")
        for name, bound in {"peak_step_rad": 0.01, "peak_radps": 1.0, "peak_radps2": 3.0}.items():
            for side, arm in stats["arms"].items():
                if max(arm["commanded"][name]) > 1.05 * bound or arm["clips"]:
                    found.append(f"{side} arm: {name} {arm['commanded'][name]}")
        self.broken += [f"{what}: {word}" for word in found]


def timed(what: str, broken: list[str], ask: Callable[[], object]) -> None:
    """Judge that something is answered in time."""
    begun = time.monotonic()
    if ask() is None:
        broken.append(f"{what}: nobody answered the stop")
    elif (took_s := time.monotonic() - begun) > STOP_S:
        broken.append(f"{what}: the stop was answered after {took_s:.2f} s")


def end_daemon(moving: Moving, ending: Ending, name: str) -> None:
    """Lose a part of the daemon in mid-motion; return with the next daemon moving on."""
    moving.begin()
    daemon, robot, guard = moving.system.daemon, moving.robot, moving.view.guard.pid
    assert robot is not None
    strangers = ending.strangers(daemon.pid, (*" ".join(DAEMON).split(), *HARMLESS))
    assert not strangers, f"the daemon has threads that this test does not end: {strangers}"
    said = len(daemon.text())
    ending.end(daemon.pid, name)
    if name in API:  # while it brakes: what was lost is begun anew
        timed(name, moving.broken, lambda: robot.stop("test"))
    assert daemon.wait() == 1, daemon.text()[said:]
    before = moving.count()
    wait_for(lambda: moving.count() > before + 20, f"{name}: setpoints of the guard", tell=lambda: daemon.text()[said:])
    if name not in API:
        timed(name, moving.broken, lambda: stop_at_guard(moving.system.target, "stop", "test", "test"))
    moving.judge(name)
    wait_for(
        lambda: max(map(abs, moving.system.robot_state()["chassis"]["velocity"][:2])) == 0.0, "the chassis at rest", 3.0
    )
    words = [SILENT] if name == "hang" else [f"the thread {thread} ended unasked: " for thread in name.split()]
    text = daemon.text()[said:]
    assert all(f"GATEWAY_BROKEN: {word}" in text for word in words), text
    # Where a stop is asked for at once, that may come first.
    if name not in API and not any(f"ACTIVE -> HOLDING: {word}" in text for word in words):
        moving.broken.append(f"{name}: it was not in motion")
    moving.leave()
    moving.system.daemon = moving.system.start_daemon()
    with moving.system.connect("next") as watcher:
        wait_for(lambda: gone(guard), "the end of the earlier guard")
        assert any(word in watcher.state.latches[Code.GATEWAY_BROKEN.value] for word in words), watcher.state.latches


def end_guard(moving: Moving, ending: Ending) -> None:
    """Lose the threads of guards in mid-motion: another guard comes each time, and nothing else changes."""
    own = moving.begin()
    strangers = ending.strangers(moving.view.guard.pid, GUARD)
    assert not strangers, f"the guard has threads that this test does not end: {strangers}"
    for number, name in enumerate(GUARD, start=1):
        moving.move(own)
        first = moving.view.guard.pid
        ending.end(first, name)
        wait_for(lambda first=first: gone(first), f"the end of the guard without {name}")
        wait_for(lambda number=number: moving.view.guard.lost == number, "word of it")
        if moving.view.state != "ACTIVE":
            moving.broken.append(f"guard's {name}: the motion ended")
        wait_for(lambda first=first: moving.view.guard.linked and moving.view.guard.pid != first, "another guard")
        moving.judge(f"guard's {name}")
    moving.leave()


def end_client(moving: Moving, ending: Ending) -> None:
    """Lose the keepalive of a client in mid-motion: its user gets an error, the robot is braked and held."""
    moving.robot = moving.system.connect("watcher")
    moving.robot.recover()
    client = moving.system.client("owner", OWNER)
    wait_for(lambda: moving.view.state == "ACTIVE", "ACTIVE", tell=client.text)
    wait_for(lambda: any(abs(v) > 0.1 for v in moving.view.arms["left"].dq_ref_radps), "motion", tell=client.text)
    strangers = ending.strangers(client.pid, ("ta2-keepalive",))
    assert not strangers, f"a client has threads that this test does not end: {strangers}"
    ending.end(client.pid, "ta2-keepalive")
    assert client.wait() == 0, client.text()
    assert "ended: LEASE_LOST" in client.text() and "the thread ta2-keepalive ended unasked" in client.text()
    wait_for(lambda: moving.view.state == "HOLDING", "HOLDING", 2.0)
    moving.judge("client's keepalive")
    moving.leave()


def end_main(process: Process, ending: Ending) -> None:
    """Lose the one thread that a process is made of: it ends with its trace."""
    ending.end(process.pid, "MainThread")
    assert process.wait() not in {0, None}
    assert "Panic" in process.text()


@pytest.mark.thorough
def test_no_thread_ends_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Braked without a step, held by the guard with the grip, stopped in time, latched until a person says otherwise."""

    def attempt(folder: Path) -> list[str]:
        ending = Ending(folder, monkeypatch)
        moving = Moving(folder)
        try:
            for name in (*DAEMON, "hang"):
                end_daemon(moving, ending, name)
            end_guard(moving, ending)
            end_client(moving, ending)
            end_main(moving.system.daemon, ending)
            wait_for(lambda: moving.system.robot_state()["fsm"] == 0, "PAUSE by the daemon's last frames")
            moving.system.forget_control()
            end_main(moving.system.sim, ending)
            return moving.broken
        except GatewayError as error:  # a host that stands still, as `steady` finds out
            return [*moving.broken, str(error)]
        finally:
            moving.leave()
            moving.system.close()

    steady(attempt, tmp_path)


def test_a_daemon_that_moves_on_and_answers_nobody_is_ended_by_its_guard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not before 15 unanswered questions: arm gaps below 100 ms, no step, the grip kept, a stop answered by the guard."""

    def attempt(folder: Path) -> list[str]:
        ending = Ending(folder, monkeypatch)
        scene = Scene(folder, mover=SLOW_MOVER)
        daemon, guard, broken = scene.system.daemon, scene.guard_pid, []
        try:
            begun = time.monotonic()
            ending.end(daemon.pid, "deaf")
            wait_for(
                lambda: f"({END_MISSES - 1})" in daemon.text(), "the last question but one", 4 * END_MISSES * PATIENCE_S
            )
            scene.system.control.ask("reset_stats")  # what a busy host does to a motion of 15 s is not the matter here
            status = daemon.wait()
            took_s = time.monotonic() - begun
            before = scene.count()
            wait_for(lambda: scene.count() > before + 20, "setpoints of the guard", tell=daemon.text)
            timed("deaf", broken, lambda: stop_at_guard(scene.system.target, "stop", "test", "test"))
            text = daemon.text()
            if "has not ticked" in text:
                return [*broken, "the daemon stood still for 80 ms"]
            asked = text.partition(": it is ended")[0]
            missed = [int(number) for number in re.findall(r"did not answer within 1 s \((\d+)\)", asked)]
            assert status == -signal.SIGKILL and missed[-END_MISSES:] == list(range(1, END_MISSES + 1)), text
            assert f"has not answered {END_MISSES} questions" in text and took_s > (END_MISSES - 1) * PATIENCE_S
            assert "the daemon has ended without a word; it was in ACTIVE" in text, text
            if (gap_ms := scene.gap_ms()) >= 100.0:
                broken.append(f"arm gap {gap_ms} ms")
            if scene.system.robot_state()["fsm"] != 2:
                broken.append("the robot paused")
            if scene.grip_nm() > -0.5 or scene.system.stats()["counts"].get("GRIPPER_WATCHDOG"):
                broken.append("the grip was lost")
            wait_for(lambda: scene.chassis_mps() == 0.0 and scene.system.is_still(), "a robot at rest", 3.0)
            broken += scene.steps()
            second = is_taken_over(scene, guard, broken)
            if second is not None:
                second.close()
            return broken
        finally:
            scene.close()

    steady(attempt, tmp_path)
