"""Trials of `ta2 check`: moves a little through the client, and kills a gateway to see the robot stop by itself.

Whatever fails, nothing is tried any more, the robot is left held or paused, and processes that were started have ended.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gateway.cli.check import moved
from gateway.cli.check.capture import Capture, Span
from gateway.cli.check.rows import DRIVE_MPS, MOVING, Row, row, skipped
from gateway.cli.terminal.children import child, when_live
from gateway.cli.terminal.ending import line_of
from gateway.cli.terminal.progress import Teller
from gateway.client import Control, PoseTarget, Robot
from gateway.errors import GatewayError
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import FSM_STATE
from gateway.settings.settings import LinkSettings
from gateway.values import Side

__all__ = ["Trials", "step_of"]

S = 1_000_000_000
LOOK_S = 0.02
HOLD_S = 1.0
"""How long arms are held, a gripper pulls, or chassis and lift go [s]."""
EXPIRY_S = 3.0
"""How long a velocity counts, longer than it takes to kill who sent it [s]."""
REACT_S = 4.0
"""Longest wait for what the robot shall do by itself: its watchdogs, and then some [s]."""
SPEED, FORCE, LIFT = 0.3, 0.2, 0.1
"""Parts of the velocity limits, of a gripper's greatest torque, and of the lift's full speed."""
KILLING = ("heartbeat", "chassis_timeout")
"""Rows for which a gateway of our own is killed."""
Rows = Generator[Row, None, None]


def step_of(side: Side, q_rad: Sequence[float]) -> tuple[int, float]:
    """Return the joint that is furthest inside its limits (manual §4.13), and a step to the farther one [rad]."""
    limits = zip(q_rad, JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)
    _, joint, is_up = max((min(q - low, high - q), n, high - q > q - low) for n, (q, low, high) in enumerate(limits))
    return joint, moved.STEP_RAD if is_up else -moved.STEP_RAD


@dataclass(slots=True, kw_only=True)
class Trials:
    """Tries what a person has agreed to, one after the other.

    Attributes:
        capture: What comes meanwhile.
        parts: Which parts are there, and enabled.
        tell: Who is told.
        settings: Where the robot is.
        config: File of further settings of a gateway of our own.
    """

    capture: Capture
    parts: dict[str, bool]
    tell: Teller
    settings: LinkSettings
    config: str | None = None
    now: str = "echo"
    """The row that is tried."""

    def all(self, running: Robot | None) -> list[Row]:
        """Return all rows that move, those too that were not tried; by a gateway that runs, or one of our own."""
        rows: list[Row] = []
        try:
            if running is not None:
                _take(self.commanded(running), rows)
            else:
                with self._own_gateway() as (robot, _):
                    _take(self.commanded(robot), rows)
                _take(self.abandoned(), rows)
        except GatewayError as error:
            rows = [each for each in rows if each.name != self.now]
            rows.append(row(self.now, False, line_of(error), remedy="`ta2 why` says more while a gateway runs"))
        has_failed = any(each.verdict == "fail" for each in rows)
        if has_failed and running is None and self._is_started():  # it did not pause by itself
            with suppress(GatewayError), self._own_gateway() as (robot, _):
                robot.estop("ta2 check: the robot did not pause")
            if self._is_started():
                self.tell.say("nobody knows whether the robot has paused: use the physical emergency stop")
        rows += skipped(("home",), "left to you", "`ta2 home`, with the arms' way in sight")
        if running is not None:
            rows += skipped(KILLING, "needs a gateway of its own", "end yours, then `ta2 check --robot ADDRESS`")
        done = {each.name for each in rows}
        why = "an earlier one failed" if has_failed else "the part is not there, or disabled"
        rows += skipped((name for name in MOVING if name not in done), why)
        return sorted(rows, key=lambda each: MOVING.index(each.name))

    def _sides(self) -> list[Side]:
        return [side for side in Side if self.parts.get(f"{side}_arm")]

    @contextmanager
    def _own_gateway(self) -> Iterator[tuple[Robot, subprocess.Popen[bytes]]]:
        """Run a gateway without a guard; at the end it brakes and pauses the robot, unless it was killed."""
        link = self.settings
        with tempfile.TemporaryDirectory(prefix="ta2-check-") as place:
            log, target = Path(place, "run.log"), str(Path(place, "gw.sock"))
            words = ["run", "--no-guard", "--robot", link.endpoint, "--socket", target, "--model", link.model]
            words += ["--namespace", link.namespace, *(("--config", self.config) if self.config else ())]
            with child("the gateway of this check", words, log) as process:
                robot = when_live(target, "ta2 check", log)
                try:
                    yield robot, process
                finally:
                    with suppress(GatewayError):  # it may have been killed
                        robot.close()

    def commanded(self, robot: Robot) -> Rows:
        """Try what any gateway can. An error, and an end before the last row, leave the robot held."""
        capture, sides = self.capture, self._sides()
        with robot.control(on_loss="pause") as own:
            if sides:
                yield moved.echoed(capture, sides, self._while("echo", own.enable, HOLD_S))
                for side in sides:
                    yield self._moved(robot, own, side)
                for side in sides:
                    span = self._while(f"gripper_{side}", partial(_pull, own, side))
                    yield moved.gripped(capture, side, span)
                yield moved.paused("disable", capture, self._while("disable", own.disable, HOLD_S))
            if self.parts.get("chassis"):
                span = self._while("chassis_stop", lambda: _drive(own), HOLD_S)
                yield moved.rolled_out("chassis_stop", capture, span)
            if self.parts.get("lift_servo"):
                yield moved.lifted(capture, self._while("lift_stop", lambda: own.lift.drive_for(LIFT, HOLD_S), HOLD_S))

    def abandoned(self) -> Rows:
        """Kill a gateway of our own in mid-hold, another in mid-drive, and see what the robot does by itself."""
        if self._sides():
            with self._own_gateway() as (robot, process):
                robot.control().acquire().enable()
                killed = self._while("heartbeat", process.kill)
                end_s = time.monotonic() + REACT_S
                while self._is_started(killed.end_ns + S // 5) and time.monotonic() < end_s:
                    time.sleep(LOOK_S)
                yield moved.paused("heartbeat", self.capture, Span(killed.begin_ns - S, time.monotonic_ns()))
        if self.parts.get("chassis"):
            with self._own_gateway() as (robot, process):
                begin_ns = time.monotonic_ns()
                robot.control().acquire().chassis.set_velocity(DRIVE_MPS, 0.0, 0.0, expiry=EXPIRY_S)
                time.sleep(HOLD_S)
                span = self._while("chassis_timeout", process.kill, EXPIRY_S)
                yield moved.rolled_out("chassis_timeout", self.capture, Span(begin_ns, span.end_ns))

    def _while(self, name: str, do: Callable[[], object], more_s: float = LOOK_S) -> Span:
        """Do something for a row; return when that was, with some time behind it."""
        self.now = name
        self.tell.advance(name, None, "")
        begin_ns = time.monotonic_ns()
        do()
        time.sleep(more_s)
        self.tell.advance(name, 1.0, "")
        return Span(begin_ns, time.monotonic_ns())

    def _moved(self, robot: Robot, own: Control, side: Side) -> Row:
        mode, arm = robot.state.mode, robot.state.arm(side.value)
        joint, step = step_of(side, tuple(map(float, arm.q)))
        offset = [step if number == joint else 0.0 for number in range(len(arm.q))]

        def by_joint() -> None:
            for sign in (1.0, -1.0):
                own.move_by({side.value: [sign * by for by in offset]}, speed=SPEED).result()

        def by_pose() -> None:
            pose = arm.pose
            part = 1.0 - moved.STEP_M / float((pose.p @ pose.p) ** 0.5)
            for p_m in (pose.p * part, pose.p):
                own.move_pose({side.value: PoseTarget(p_m, pose.quat_xyzw, pose.frame)}, speed=SPEED).result()

        if mode is None or mode.joint_mode[side.value]:
            return moved.moved_back(self.capture, side, joint, step, self._while(f"move_{side}", by_joint))
        return moved.moved_back(self.capture, side, None, -moved.STEP_M, self._while(f"move_{side}", by_pose))

    def _is_started(self, since_ns: int = 0) -> bool:
        """Return whether the robot's newest state, or its silence since then, leaves its arms enabled."""
        newest = self.capture.messages(FSM_STATE, Span(since_ns))[-1:]
        return not newest or newest[0][1].data != moved.PAUSE


def _take(trials: Rows, rows: list[Row]) -> None:
    """Take rows until one fails: the rest is not tried, and whoever owns the robot ends as by an error."""
    if any(each.verdict == "fail" for each in rows):
        return
    for each in trials:
        rows.append(each)
        if each.verdict == "fail":
            trials.close()


def _pull(own: Control, side: Side) -> None:
    hand = own.left_gripper if side is Side.LEFT else own.right_gripper
    hand.open(FORCE)
    time.sleep(HOLD_S)
    hand.relax()


def _drive(own: Control) -> None:
    own.chassis.set_velocity(DRIVE_MPS, 0.0, 0.0, expiry=EXPIRY_S)
    time.sleep(HOLD_S)
    own.chassis.stop()
