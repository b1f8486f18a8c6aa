"""`ta2 teleop` in a real terminal: keys move the hand, and whatever ends them, or it, leaves the arm held without a step."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from gateway.client import Robot
from tests.e2e.system import ATTEMPTS, ROOT, STALLED, Process, System, wait_for

pytestmark = [pytest.mark.e2e, pytest.mark.wire_free("keys and the motion they make are the matter")]

Systems = Callable[..., System]
PATIENCE_S = 60.0
"""For what a machine that is busy or slow does in the end."""
UP = b"r"
KEYS = "held: w s"
"""Of its first words, once the arms are enabled."""


class Terminal:
    """A terminal with `ta2 teleop` in it, and somebody who types.

    Args:
        system: Whose gateway.
        options: Further ones.
    """

    def __init__(self, system: System, *options: str) -> None:
        self.ours, self._theirs = pty.openpty()
        self.before = termios.tcgetattr(self._theirs)
        theirs = self._theirs

        def take() -> None:
            os.setsid()
            fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

        arguments = [sys.executable, "-m", "gateway.cli", "teleop", "--socket", system.target, "--yes", *options]
        self.process = subprocess.Popen(
            arguments, cwd=ROOT, stdin=theirs, stdout=theirs, stderr=theirs, preexec_fn=take, pass_fds=[theirs]
        )
        self.text = ""
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while data := os.read(self.ours, 65536):
                self.text += data.decode(errors="replace")

    def is_given_back(self) -> bool:
        """Whether the terminal is as it was."""
        return termios.tcgetattr(self._theirs) == self.before

    def says(self, *words: str) -> str:
        """Wait until it says one of these, and return which."""
        found: str = wait_for(
            lambda: next((said for said in words if said in self.text), ""),
            words[0],
            PATIENCE_S,
            lambda: self.text[-2000:],
        )
        return found

    def type(self, keys: bytes) -> None:
        """Press keys, one after the other."""
        os.write(self.ours, keys)

    def hold(self, key: bytes, until: Callable[[], bool]) -> None:
        """Hold a key as a terminal repeats it, until something is so; let go and try again where nothing comes of it."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            pressed = time.monotonic()
            self.type(key)
            while time.monotonic() < pressed + 6.0:
                time.sleep(0.03)
                if until():
                    return
                if time.monotonic() > pressed + 0.4:
                    self.type(key)
            time.sleep(1.0)
        pytest.fail(f"nothing came of {key!r}: {self.text[-2000:]}")

    def close_window(self) -> None:
        """Close the terminal, as by the cross of its window."""
        os.close(self._theirs)
        os.close(self.ours)
        self.ours = self._theirs = -1

    def end(self) -> None:
        """End it all."""
        self.process.kill()
        self.process.wait()
        for end in (self._theirs, self.ours):
            if end >= 0:
                os.close(end)
        self._reading.join(5.0)


@pytest.fixture
def terminals() -> Iterator[Callable[..., Terminal]]:
    """Makes terminals that end with the test."""
    made: list[Terminal] = []

    def make(system: System, *options: str) -> Terminal:
        for _ in range(ATTEMPTS):
            made.append(Terminal(system, *options))
            if made[-1].says(KEYS, *STALLED) == KEYS:
                return made[-1]
        pytest.fail(made[-1].text)

    yield make
    for terminal in made:
        terminal.end()


def ready(system: System, name: str = "watcher") -> Robot:
    """Return a client that watches, once the gateway knows the arm's body."""
    robot = system.connect(name)
    told = system.logs
    wait_for(lambda: (m := robot.state.left_arm.model) is not None and m.state == "agrees", "a model", PATIENCE_S, told)
    return robot


def hand(robot: Robot) -> np.ndarray:
    """Return where the left hand is [m]."""
    return np.array(robot.state.left_arm.pose.p)


def rests(robot: Robot) -> bool:
    """Whether no reference of the left arm goes on."""
    arm = robot.state.view.arms["left"]
    return not any(abs(v) > 1e-3 for v in (*arm.dq_ref_radps, *arm.ref_v_mps, *arm.ref_w_radps))


@pytest.mark.parametrize("mode", ["joint", "pose"])
def test_keys_move_the_hand_their_way_and_released_keys_stop_it(
    tmp_path: Path, systems: Systems, terminals: Callable[..., Terminal], mode: str
) -> None:
    """Up by the key for up, in either control mode; `q` pauses the robot and gives the terminal back."""
    system = systems(tmp_path, has_guard=False, sim_options=("--mode", mode))
    with ready(system) as robot:
        before = hand(robot)
        terminal = terminals(system)
        terminal.type(b"]")
        terminal.hold(UP, lambda: bool(hand(robot)[2] > before[2] + 0.05))
        wait_for(lambda: rests(robot), "rest", PATIENCE_S)
        wait_for(lambda: not any(view.open for view in robot.state.view.targets), "the end of the stream", PATIENCE_S)
        stopped = hand(robot)
        assert np.abs(stopped - before)[:2].max() < 0.02 and stopped[2] < before[2] + 0.25
        seen = [robot.fresh_state() for _ in range(50)]
        assert all(abs(state.left_arm.pose.p[2] - stopped[2]) < 0.01 for state in seen)
        terminal.type(b"q")
        assert terminal.process.wait(PATIENCE_S) == 0, terminal.text
        assert terminal.is_given_back()
        wait_for(lambda: robot.state.fsm_name == "PAUSE" and not robot.state.lease.owned, "PAUSE", PATIENCE_S)


def send(number: int) -> Callable[[Terminal], None]:
    """Return what sends a signal."""
    return lambda terminal: terminal.process.send_signal(number)


ENDS = {
    "killed": send(signal.SIGKILL),
    "frozen": send(signal.SIGSTOP),
    "asked to end": send(signal.SIGTERM),
    "interrupted": lambda terminal: terminal.type(b"\x03"),
    "its window closed": lambda terminal: terminal.close_window(),
}
STATUS = {"asked to end": 128 + signal.SIGTERM, "interrupted": 128 + signal.SIGINT}


@pytest.mark.parametrize("mode", ["joint", pytest.param("pose", marks=pytest.mark.thorough)])
def test_whatever_ends_it_in_mid_jog_leaves_the_arm_held_without_a_step(
    tmp_path: Path, systems: Systems, terminals: Callable[..., Terminal], mode: str
) -> None:
    """Killed, frozen, ended, interrupted, its window closed: braked on its way, READY, and no setpoint ever too far."""
    system = systems(tmp_path, has_guard=False, sim_options=("--mode", mode))
    with ready(system) as robot:
        bound_mps, v_radps = 1.2 * robot.info.pose_v_mps, 1.02 * robot.info.v_radps
        for number, (name, end) in enumerate(ENDS.items()):
            key, sign = (UP, 1.0) if number % 2 == 0 else (b"f", -1.0)
            terminal = terminals(system, "--take", f"the last one was {name}")
            terminal.type(b"]")
            begun = hand(robot)
            terminal.hold(
                key, lambda sign=sign, begun=begun: bool(sign * (hand(robot) - begun)[2] > 0.02) and not rests(robot)
            )
            end(terminal)
            ended, view = hand(robot), robot.state.view
            last, at = view.arms["left"], view.at_ns
            deadline = time.monotonic() + PATIENCE_S
            for state in robot.states(timeout=PATIENCE_S):
                arm, dt_s = state.view.arms["left"], (state.view.at_ns - at) / 1e9
                if mode == "joint" and arm.q_ref_rad and last.q_ref_rad:
                    step = max(abs(a - b) for a, b in zip(arm.q_ref_rad, last.q_ref_rad, strict=True))
                    assert step <= v_radps * (dt_s + 0.02), f"a step of {step:.4f} rad after it was {name}"
                elif arm.ref_p_m and last.ref_p_m:
                    step = float(np.linalg.norm(np.subtract(arm.ref_p_m, last.ref_p_m)))
                    assert step <= bound_mps * (dt_s + 0.02), f"a step of {step:.4f} m after it was {name}"
                last, at = arm, state.view.at_ns
                if state.state == "HOLDING" and rests(robot):
                    break
                assert time.monotonic() < deadline, f"{name}: {state}, {terminal.text[-1000:]}"
            wait_for(system.is_still, "an arm that stands", PATIENCE_S)
            way = sign * (hand(robot) - ended)[2]
            assert -0.01 < way < 0.08, f"went on for {way:.3f} m after it was {name}"
            assert robot.state.fsm_name == "READY" and not robot.state.latches
            if name == "frozen":
                terminal.process.kill()
            status = terminal.process.wait(PATIENCE_S)
            assert status == STATUS.get(name, status), terminal.text
            assert name not in STATUS or "the arms are held" in terminal.text
        for side, arm in system.stats()["arms"].items():
            assert arm["clips"] == 0, side
            if mode == "joint":
                assert (
                    max(arm["commanded"]["peak_step_rad"]) <= 0.0105 and max(arm["commanded"]["peak_radps"]) <= v_radps
                )


@pytest.mark.thorough
@pytest.mark.body_free("what a person is told is the matter")
@pytest.mark.sim_only("gateway and recorder are the same whatever the wire is")
def test_episodes_are_told_to_the_recorder_and_a_lost_gateway_ends_it(
    tmp_path: Path, systems: Systems, terminals: Callable[..., Terminal]
) -> None:
    """Begun with the task and judged by keys; when the gateway dies, it says so and ends with status 3."""
    system = systems(tmp_path, has_guard=False)
    with ready(system):
        arguments = ["-m", "gateway.cli", "record", "--socket", system.target, "--out", str(tmp_path / "bag")]
        recorder = Process("recorder", arguments, tmp_path)
        system.clients.append(recorder)
        wait_for(lambda: "record:" in recorder.text(), "a recording", PATIENCE_S, recorder.text)
        terminal = terminals(system, "--task", "wave", "--arm", "right")
        for keys, words in (
            (b"e", "episode 1 begun"),
            (b"y", "episode 1 success"),
            (b"e", "episode 2 begun"),
            (b"e", "episode 2 ended"),
            (b"\x7f", "episode 2 discard"),
        ):
            terminal.type(keys)
            terminal.says(words)
        system.daemon.send(signal.SIGKILL)
        assert terminal.process.wait(PATIENCE_S) == 3, terminal.text
        assert "DISCONNECTED" in terminal.text and terminal.is_given_back()
