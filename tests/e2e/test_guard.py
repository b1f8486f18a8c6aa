"""The guard with real processes: the daemon killed and frozen in mid-motion, restarted, the guard killed, both killed."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
import zenoh

from gateway.api.keys import ESTOP_KEY
from gateway.api.stop_pipe import drop_stop
from gateway.client import Robot, connect
from gateway.client.asking.guard_stop import stop_at_guard
from gateway.errors import Disconnected
from gateway.link.others.gateway_token import gateway_tokens, parse_gateway_token
from gateway.robot.topics import FSM_ENABLE, joint_command, pose_command, shoulder_frame
from gateway.settings.settings import RealtimeSettings
from gateway.values import Side
from tests.e2e.system import System, joint_topics, steady, wait_for
from tests.stranger import Stranger

pytestmark = pytest.mark.e2e

MOVER = """
with robot.control(on_loss='hold') as own:
    own.enable(timeout=10.0)
    own.left_gripper.grip(0.6)
    goals = [{'left': HOME['left'], 'right': HOME['right']}, {s: HOME[s] * 0.7 for s in HOME}]
    while True:
        for goal in goals:
            motion = own.move_to(goal, speed=0.6)
            while not motion.done:
                own.chassis.set_velocity(0.1, 0.0, 0.0)
                time.sleep(0.1)
"""
"""Both arms move, a gripper holds, the chassis drives."""

POSER = """
with robot.control(on_loss='hold') as own:
    own.enable(timeout=10.0)
    own.right_gripper.grip(0.6)
    start = robot.state.right_arm.pose
    x, y, z = start.p
    while True:
        for up in (0.06, 0.0):
            pose = own.right_arm.move_pose((x + up, y, z + up), start.quat_xyzw, frame='right_shoulder_base')
            joints = own.left_arm.move_by([0.3 if up else -0.3] + [0.0] * 6)
            while not (pose.done and joints.done):
                own.chassis.set_velocity(0.1, 0.0, 0.0)
                time.sleep(0.1)
"""
"""The left arm moves by its joints, the right one by its end effector, whose gripper holds; the chassis drives."""

CHASSIS = "/api/chassis/velocity"

SPINNER = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[3])))
end = time.monotonic() + float(sys.argv[2])
while time.monotonic() < end:
    pass
"""
"""Keeps a core from everybody for a while, as a host that gives it to another machine does."""


def spin(cores: Iterable[int], seconds: float, priority: int = 90) -> bool:
    """Keep cores from everybody who is not more urgent; return whether that was permitted."""
    words = [sys.executable, "-S", "-c", SPINNER]
    spun = [subprocess.Popen([*words, str(core), str(seconds), str(priority)]) for core in cores]
    return [process.wait(20) for process in spun] == [0] * len(spun)


class Scene:
    """A system whose arms move for ever, with a linked guard.

    Args:
        folder: For sockets, state and logs.
        mover: What moves them.
        topics: Command topics of the arms.
        gripper: Which gripper holds.
        how: Of the system.
    """

    def __init__(
        self,
        folder: Path,
        *,
        mover: str = MOVER,
        topics: tuple[str, str] = joint_topics(),
        gripper: str = "left",
        **how: Any,
    ) -> None:
        self.topics, self.gripper = topics, gripper
        self.system = System(folder, **how)
        try:
            self._begin(mover)
        except BaseException:
            self.system.close()
            raise

    def _begin(self, mover: str) -> None:
        """Return when everything moves."""
        self.robot = self.system.connect()
        for pid in self.system.sim.pids:
            favour(pid)
        wait_for(lambda: self.view.guard.linked, "a linked guard")
        self.system.client("mover", mover)
        wait_for(lambda: self.view.state == "ACTIVE", "ACTIVE")
        wait_for(lambda: any(abs(v) > 0.1 for v in self.view.arms["left"].dq_ref_radps), "motion at speed")
        wait_for(lambda: self.chassis_mps() > 0.05, "a driving chassis")
        wait_for(lambda: self.grip_nm() < -0.5, "a grip")

    @property
    def view(self) -> Any:
        """What the daemon shows."""
        return self.robot.state.view

    @property
    def guard_pid(self) -> int:
        """Process id of the guard."""
        return int(self.view.guard.pid)

    def count(self) -> int:
        """How many setpoints have arrived, of the arm that got fewer."""
        return min(map(self.system.count, self.topics))

    def gap_ms(self) -> float:
        """The worst gap between setpoints at the robot [ms]."""
        commands = self.system.stats()["commands"]
        return max(float(commands[topic]["worst_gap_alive_ms"]) for topic in self.topics)

    def chassis_mps(self) -> float:
        """How fast the chassis really drives [m/s]."""
        return max(map(abs, self.system.robot_state()["chassis"]["velocity"][:2]))

    def grip_nm(self) -> float:
        """Torque of the holding gripper's motor [N·m]; closing is below zero."""
        return float(self.system.robot_state()["grippers"][self.gripper]["effort_nm"])

    def restart(self) -> Robot:
        """Start another daemon on the same socket; return a client of it."""
        self.system.daemon = self.system.start_daemon()
        return self.system.connect("second")

    def steps(self) -> list[str]:
        """Return which arms' setpoints broke their limits, as the robot saw them, in words."""
        bounds = {"peak_step_rad": 0.01, "peak_radps": 1.0, "peak_radps2": 3.0}
        return [
            f"{side} arm: {name} {arm['commanded'][name]}"
            for side, arm in self.system.stats()["arms"].items()
            for name, bound in bounds.items()
            if max(arm["commanded"][name]) > 1.05 * bound or arm["clips"]
        ]

    def close(self) -> None:
        """End it all, the guard as well."""
        with contextlib.suppress(Exception):
            self.robot.close()
        self.system.close()


def favour(pid: int) -> None:
    """Let the simulated robot run beside processes that start: the real one is a computer of its own."""
    for task in os.listdir(f"/proc/{pid}/task"):
        with contextlib.suppress(OSError):  # not permitted here
            os.sched_setscheduler(int(task), os.SCHED_FIFO, os.sched_param(30))


def gone(pid: int) -> bool:
    """Whether a process has ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def is_taken_over(scene: Scene, guard: int, broken: list[str]) -> Robot | None:
    """Start another daemon; return a client of it once it holds, None when it does not.

    Args:
        scene: With a guard that holds.
        guard: That one's process id.
        broken: What was broken on the way is added.
    """
    second = scene.restart()
    wait_for(lambda: second.state.view.state in {"HOLDING", "READ_ONLY"}, "the next daemon's hold")
    wait_for(lambda: not second.state.view.guard.earlier_holds, "the end of the earlier hold")
    if second.state.view.state != "HOLDING":
        second.close()
        broken.append(f"the hold was not taken over: {scene.system.daemon.text()[-600:]}")
        return None
    wait_for(lambda: gone(guard), "the end of the earlier guard")
    if (gap_ms := scene.gap_ms()) >= 100.0:
        broken.append(f"arm gap {gap_ms} ms at the handover")
    if scene.grip_nm() > -0.5 or scene.system.stats()["counts"].get("GRIPPER_WATCHDOG"):
        broken.append("the grip was lost at the handover")
    return second


@pytest.mark.alone
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "frozen"])
def test_a_dead_daemon_is_followed_by_a_hold_and_the_next_daemon_takes_it(tmp_path: Path, number: int) -> None:
    """Arm gaps below 100 ms at the robot, no step, grip never lost, chassis zeros within 150 ms; a new owner moves on."""

    def attempt(folder: Path) -> list[str]:
        scene = Scene(folder)
        broken: list[str] = []
        try:
            guard = scene.guard_pid
            scene.system.daemon.send(number)
            before = scene.count()
            wait_for(lambda: scene.count() > before + 50, "setpoints of the guard")
            if (gap_ms := scene.gap_ms()) >= 100.0:
                broken.append(f"arm gap {gap_ms} ms")
            if (gap_ms := scene.system.stats()["commands"][CHASSIS]["worst_gap_alive_ms"]) >= 150.0:
                broken.append(f"chassis zeros after {gap_ms} ms")
            if scene.system.robot_state()["fsm"] != 2:
                return [*broken, f"the robot paused: {scene.system.daemon.text()[-600:]}"]
            wait_for(lambda: scene.chassis_mps() == 0.0, "the chassis at rest", 3.0)
            if (grip_nm := scene.grip_nm()) > -0.5 or scene.system.stats()["counts"].get("GRIPPER_WATCHDOG"):
                broken.append(f"the grip was lost: {grip_nm} N·m")
            assert scene.system.daemon.wait() == -signal.SIGKILL
            second = is_taken_over(scene, guard, broken)
            if second is None:
                return broken
            try:
                with second.control() as own:
                    own.enable(timeout=10.0)
                    own.move_to({"left": [0.2, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0]}, speed=0.5).result(timeout=20.0)
                broken += scene.steps()
            finally:
                second.close()
            return broken
        finally:
            scene.close()

    steady(attempt, tmp_path)


@pytest.mark.alone
def test_an_arm_in_each_control_mode_is_held_and_handed_over(tmp_path: Path) -> None:
    """Joints on the left, an end effector on the right: gaps below 100 ms, no clip, the grip kept, and on it moves."""
    topics = (joint_command(Side.LEFT), pose_command(Side.RIGHT))
    options = ("--left-mode", "joint", "--right-mode", "pose")

    def attempt(folder: Path) -> list[str]:
        scene = Scene(folder, mover=POSER, topics=topics, gripper="right", sim_options=options)
        broken: list[str] = []
        try:
            guard = scene.guard_pid
            scene.system.daemon.send(signal.SIGKILL)
            before = scene.count()
            wait_for(lambda: scene.count() > before + 50, "setpoints of the guard in both spaces")
            if (gap_ms := scene.gap_ms()) >= 100.0:
                broken.append(f"arm gap {gap_ms} ms")
            scene.system.daemon.wait()
            second = is_taken_over(scene, guard, broken)
            if second is None:
                return broken
            with second, second.control() as own:
                own.enable(timeout=10.0)
                there = second.state.right_arm.pose
                x, y, z = there.p
                own.right_arm.move_pose((x, y + 0.03, z), there.quat_xyzw, frame=shoulder_frame(Side.RIGHT)).result(
                    timeout=20.0
                )
            arms = scene.system.stats()["arms"]
            return broken + [f"{side} arm clipped: {arm['clips']}" for side, arm in arms.items() if arm["clips"]]
        finally:
            scene.close()

    steady(attempt, tmp_path)


@pytest.mark.thorough
@pytest.mark.alone
def test_a_hold_outlives_a_daemon_that_dies_before_it_has_taken_it(tmp_path: Path) -> None:
    """Started and killed again: the guard that holds is found by the third daemon, and by whoever stops meanwhile."""

    def attempt(folder: Path) -> list[str]:
        scene = Scene(folder)
        try:
            first = scene.guard_pid
            scene.system.daemon.send(signal.SIGKILL)
            before = scene.count()
            wait_for(lambda: scene.count() > before + 50, "setpoints of the guard")
            scene.system.daemon.wait()
            scene.system.daemon = scene.system.start_daemon()
            wait_for(
                lambda: "acts: HOLDING" in scene.system.daemon.text() or gone(first), "a daemon that sees the hold"
            )
            scene.system.daemon.send(signal.SIGKILL)
            scene.system.daemon.wait()
            if gone(first):
                return ["the hold was over before it could be left: a daemon needed 10 s to start"]
            broken: list[str] = []
            third = is_taken_over(scene, first, broken)
            if third is not None:
                third.close()
            return broken
        finally:
            scene.close()

    steady(attempt, tmp_path)


DRIVER = """
with robot.control(on_loss='hold') as own:
    while True:
        own.chassis.set_velocity(0.1, 0.0, 0.0)
        time.sleep(0.05)
"""
"""The chassis drives; the arms were never enabled, so that nothing is held."""


def test_other_gateways_are_kept_away_until_the_last_stop_frame(tmp_path: Path) -> None:
    """Of a daemon that dies while it drives: its guard shows that the robot is commanded for as long as zeros are sent."""

    def attempt(folder: Path) -> list[str]:
        system = System(folder)
        armed: set[str] = set()
        config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{system.endpoint}"]}}}}')

        def note(sample: zenoh.Sample) -> None:
            token = parse_gateway_token(str(sample.key_expr), "")
            if token is not None and token.is_armed:
                (armed.add if sample.kind == zenoh.SampleKind.PUT else armed.discard)(token.zid)

        try:
            with system.connect() as robot, zenoh.open(config) as looker:
                looker.liveliness().declare_subscriber(gateway_tokens(""), note, history=True)
                wait_for(lambda: robot.state.view.guard.linked, "a linked guard")
                system.client("driver", DRIVER)
                guard = robot.state.view.guard.pid
                wait_for(lambda: len(armed) == 2 or not system.daemon.is_running, "both claims")
                system.daemon.send(signal.SIGKILL)
                wait_for(lambda: "TAKEN_OVER" in system.daemon.text(), "zeros of the guard")
                if "not ticked" in system.daemon.text():
                    return ["the daemon stood still for 80 ms"]
                before = system.count(CHASSIS)
                wait_for(lambda: not armed, "the end of the guard's claim")
                after = system.count(CHASSIS)
                assert after >= before + 10, "the claim ended while zeros were sent"
                wait_for(lambda: gone(guard), "the end of the guard")
                assert system.count(CHASSIS) == after
                return []
        finally:
            system.close()

    steady(attempt, tmp_path)


def test_a_guard_that_holds_lets_go_when_somebody_else_commands(tmp_path: Path) -> None:
    """It hears nobody's commands while it waits, since its daemon does; as soon as it acts it must."""

    def attempt(folder: Path) -> list[str]:
        scene = Scene(folder)
        stranger = None
        try:
            guard = scene.guard_pid
            system = scene.system
            system.daemon.send(signal.SIGKILL)
            wait_for(lambda: "TAKEN_OVER" in system.daemon.text(), "a hold")
            if "not ticked" in system.daemon.text():
                return ["the daemon stood still for 80 ms"]
            stranger = Stranger(system.endpoint)
            begun = scene.count()
            wait_for(lambda: scene.count() > begun + 20, "hold frames")

            def is_heard() -> bool:
                stranger.put(CHASSIS, (0.0, 0.0, 0.0))
                stranger.put(FSM_ENABLE, (0.0,))
                return "commands that we did not send" in system.daemon.text()

            wait_for(is_heard, "the guard hears somebody else", 5.0)
            wait_for(lambda: gone(guard), "the end of the guard", 5.0)
            return []
        finally:
            if stranger is not None:
                stranger.close()
            scene.close()

    steady(attempt, tmp_path)


@pytest.mark.alone
@pytest.mark.sim_only("what stands still is a core of this host")
@pytest.mark.parametrize("priority", [90, RealtimeSettings().fifo_priority], ids=["core", "turn"])
def test_a_core_that_stands_still_is_no_frozen_daemon(tmp_path: Path, priority: int) -> None:
    """A busy host takes the daemon's core away for 120 ms, or another daemon does: the guard waits, the daemon goes on."""
    scene = Scene(tmp_path)
    try:
        daemon, guard = scene.system.daemon, scene.guard_pid
        cores = os.sched_getaffinity(daemon.pid)
        if len(cores) != 1:  # real time is not permitted here, so that the daemon runs wherever there is room
            pytest.skip(f"the daemon runs on {len(cores)} cores")
        for _ in range(3):
            assert spin(cores, 0.12, priority)
            seq = scene.robot.state.seq
            wait_for(lambda seq=seq: scene.robot.state.seq > seq + 10, "snapshots after the standstill")
        assert daemon.is_running and (scene.guard_pid, scene.view.guard.lost) == (guard, 0)
        assert "it is ended" not in daemon.text()
    finally:
        scene.close()


@pytest.fixture
def unfavoured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Daemons and their guards may not run in real time."""
    if shutil.which("setpriv") is None:
        pytest.skip("no setpriv to start a daemon with")
    monkeypatch.setattr(System, "daemon_place", ("setpriv", "--bounding-set=-sys_nice", "--inh-caps=-sys_nice"))


@pytest.mark.alone
@pytest.mark.sim_only("what is busy is a core of this host")
@pytest.mark.usefixtures("unfavoured")
def test_a_daemon_without_real_time_that_is_starved_is_no_frozen_one(tmp_path: Path) -> None:
    """Others keep it from both its cores for 0.2 s, three times: the guard sees that it could not run, and waits."""
    cores = sorted(os.sched_getaffinity(0))[-2:]
    if len(cores) < 2 or not spin(cores, 0.001):
        pytest.skip("one core only, or no permission to keep cores from a daemon")
    scene = Scene(tmp_path)
    try:
        daemon, guard = scene.system.daemon, scene.guard_pid
        favour(guard)  # whatever keeps the daemon from running does not keep the guard
        for task in os.listdir(f"/proc/{daemon.pid}/task"):
            os.sched_setaffinity(int(task), set(cores))
        assert os.sched_getscheduler(daemon.pid) == os.SCHED_OTHER and "SCHED_FIFO: not taken" in daemon.text()
        for _ in range(3):
            assert spin(cores, 0.2, 20)
            seq = scene.robot.state.seq
            wait_for(lambda seq=seq: scene.robot.state.seq > seq + 10, "snapshots after the burst")
        assert daemon.is_running and (scene.guard_pid, scene.view.guard.lost) == (guard, 0)
        assert "it is ended" not in daemon.text()
    finally:
        scene.close()


@pytest.mark.alone
@pytest.mark.sim_only("what is stopped is a process of this host")
@pytest.mark.usefixtures("unfavoured")
def test_a_daemon_without_real_time_that_stands_still_is_ended_in_time(tmp_path: Path) -> None:
    """Nothing keeps it from its core: at 80 ms, as ever, and its log tells what was asked."""

    def attempt(folder: Path) -> list[str]:
        scene = Scene(folder)
        try:
            daemon = scene.system.daemon
            daemon.send(signal.SIGSTOP)
            assert daemon.wait() == -signal.SIGKILL
            found = wait_for(
                lambda: re.search(r"its last tick ([0-9.]+) ms ago, asked .* could run", daemon.text()), "why"
            )
            age_ms = float(found[1])
            return [] if 80.0 <= age_ms < 110.0 else [f"it was ended after {age_ms} ms"]
        finally:
            scene.close()

    steady(attempt, tmp_path)


def test_stop_and_estop_work_while_the_daemon_is_dead(tmp_path: Path) -> None:
    """By a client that was connected, and by one that was not; an e-stop pauses the robot, and the guard ends."""
    scene = Scene(tmp_path)
    try:
        pid = scene.guard_pid
        scene.system.daemon.send(signal.SIGKILL)
        scene.system.daemon.wait()
        with contextlib.suppress(Disconnected):  # a machine too busy for the hold must not hang an e-stop either
            assert scene.robot.stop("test").by_guard
        result = stop_at_guard(scene.system.target, "estop", "smoke", "test")
        if result is not None:
            assert (result.by_guard, result.undelivered) == (True, False)
        wait_for(lambda: scene.system.robot_state()["fsm"] == 0, "PAUSE")
        wait_for(lambda: gone(pid), "the guard's end")
        with pytest.raises(Disconnected):
            scene.robot.stop("nobody is left")
        if result is not None:  # the e-stop of the guard holds motion off in the next daemon
            second = scene.restart()
            assert "ESTOP" in second.state.latches
            second.close()
    finally:
        scene.close()


@pytest.mark.alone
@pytest.mark.sim_only("what is stopped is a process of this host")
def test_an_estop_that_a_frozen_daemon_did_not_read_is_its_guards(tmp_path: Path) -> None:
    """Dropped into the pipe of a daemon that stands still, it is carried out by the guard, and latched in the next daemon."""

    def attempt(folder: Path) -> list[str]:
        scene = Scene(folder)
        try:
            pid = scene.guard_pid
            scene.system.daemon.send(signal.SIGSTOP)
            assert drop_stop(Path(scene.system.target), ESTOP_KEY, b"smoke")
            scene.system.daemon.wait()
            wait_for(lambda: scene.system.robot_state()["fsm"] == 0, "PAUSE")
            wait_for(lambda: gone(pid), "the guard's end")
            with scene.restart() as second:
                latches = second.state.latches
            return [] if "smoke" in latches.get("ESTOP", "") else [f"latched is {latches}"]
        finally:
            scene.close()

    steady(attempt, tmp_path)


@pytest.mark.alone
def test_a_killed_guard_is_told_another_is_started_and_control_goes_on(tmp_path: Path) -> None:
    """The motion does not notice."""
    scene = Scene(tmp_path)
    try:
        first = scene.guard_pid
        notices = scene.robot.events(timeout=20.0)
        os.kill(first, signal.SIGKILL)
        assert next(n for n in notices if n.code == "GUARD_LOST")
        wait_for(lambda: scene.view.guard.linked and scene.guard_pid not in {0, first}, "another guard")
        assert (scene.view.state, scene.view.guard.lost) == ("ACTIVE", 1)
        before = scene.count()
        wait_for(lambda: scene.count() > before + 100, "setpoints")
    finally:
        scene.close()


def test_with_both_killed_the_robots_own_watchdogs_act(tmp_path: Path) -> None:
    """As the manual says: no setpoint any more, the FSM stays as it is; the next daemon begins as ever."""
    scene = Scene(tmp_path)
    try:
        guard = scene.guard_pid
        os.kill(guard, signal.SIGSTOP)  # so that it cannot act between the two
        scene.system.daemon.send(signal.SIGKILL)
        scene.system.daemon.wait()
        os.kill(guard, signal.SIGKILL)
        wait_for(lambda: gone(guard), "the guard's end")
        after = scene.count()
        wait_for(lambda: scene.grip_nm() == 0.0, "the loss of the grip", 2.0)
        wait_for(lambda: scene.chassis_mps() == 0.0, "the end of the chassis' own watchdog", 3.0)
        assert scene.count() == after
        second = scene.restart()
        assert second.state.view.state == "READ_ONLY"
        assert not second.state.view.guard.earlier_holds
        second.close()
    finally:
        scene.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.thorough)])
def test_a_normal_end_is_no_reason_to_hold(tmp_path: Path, number: int) -> None:
    """The daemon brakes and pauses the robot itself; the guard goes with it and sends nothing."""
    scene = Scene(tmp_path)
    try:
        guard = scene.guard_pid
        scene.system.daemon.send(number)
        assert scene.system.daemon.wait() == 0
        wait_for(lambda: gone(guard), "the guard's end")
        wait_for(lambda: scene.system.robot_state()["fsm"] == 0, "PAUSE")
        assert "TAKEN_OVER" not in scene.system.daemon.text()
        with pytest.raises(Disconnected):
            connect(scene.system.target, timeout_s=0.5)
    finally:
        scene.close()
