"""Trials of `ta2 check`: moves a little through the client, as any program, and kills a gateway to see the robot stop by itself.

Whatever fails, nothing is tried any more, the robot is left held or paused, and processes that were started have ended.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import gateway.client
from gateway.cli.check import moved
from gateway.cli.check.capture import Capture, Span
from gateway.cli.check.rows import MOVING, Row, row, skipped
from gateway.cli.terminal.ending import line_of
from gateway.cli.terminal.progress import Teller
from gateway.client import Control, PoseTarget, Robot
from gateway.errors import Code, Disconnected, GatewayError, GatewayTimeout, Refusal
from gateway.process.own_module import own_module
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import CHASSIS_STATE, FSM_STATE
from gateway.settings.settings import LinkSettings
from gateway.values import Side

__all__ = ["Trials", "own_gateway", "step_of"]

S = 1_000_000_000
STEP_S = 0.02
HOLD_S = 1.0
"""How long arms are held, a gripper pulls, or the chassis drives [s]."""
REACT_S = 4.0
"""Longest wait for what the robot shall do by itself: the longest of its watchdogs, and then some [s]."""
START_S, END_S = 30.0, 10.0
"""Longest wait for a gateway that starts, and ends [s]."""
SPEED = 0.3
"""Factor on the velocity limits."""
FORCE = 0.2
"""Part of a gripper's greatest torque."""
LIFT = 0.1
"""Part of the lift's full speed."""
KILLING = ("heartbeat", "chassis_timeout")
"""Rows for which a gateway of our own is killed."""

Own = tuple[Robot, "subprocess.Popen[bytes]"]
Rows = Generator[Row, None, None]


@contextmanager
def own_gateway(settings: LinkSettings, config: str | None) -> Iterator[Own]:
    """Run a gateway without a guard while the block runs; then it brakes and pauses the robot, unless it was killed.

    Args:
        settings: Where the robot is.
        config: File of further settings.

    Raises:
        GatewayTimeout: It was not there in time; the end of its log is in the message.
    """
    with tempfile.TemporaryDirectory(prefix="ta2-check-") as place:
        log, target = Path(place, "run.log"), str(Path(place, "gw.sock"))
        words = ["run", "--no-guard", "--robot", settings.endpoint, "--socket", target, "--model", settings.model]
        words += ["--namespace", settings.namespace, *(("--config", config) if config else ())]
        with log.open("w") as stream:
            process = subprocess.Popen(
                own_module("gateway.cli", *words),
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env={**os.environ, "TA2_STATE_DIR": place},
                start_new_session=True,  # Ctrl-C shall end this command in order, and then the gateway
            )
        try:
            robot = _connected(target, log)
            try:
                yield robot, process
            finally:
                with suppress(GatewayError):  # it was killed
                    robot.close()
        finally:
            process.terminate()
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _connected(target: str, log: Path) -> Robot:
    end_s = time.monotonic() + START_S
    while True:
        with suppress(Disconnected, GatewayTimeout):
            robot = gateway.client.connect(target, name="ta2 check", timeout_s=1.0)
            if _until(lambda: robot.state.link.fresh and robot.state.mode is not None, end_s - time.monotonic()):
                return robot
            robot.close()
        if time.monotonic() > end_s:
            message = f"no gateway within {START_S:g} s: {log.read_text(errors='replace')[-300:].strip()}"
            raise GatewayTimeout(Refusal(code=Code.TIMEOUT, message=message, hint="`ta2 run` says more"))
        time.sleep(STEP_S)


def _until(is_so: Callable[[], bool], longest_s: float) -> bool:
    end_s = time.monotonic() + longest_s
    while not is_so():
        if time.monotonic() > end_s:
            return False
        time.sleep(STEP_S)
    return True


def step_of(side: Side, q_rad: Sequence[float]) -> tuple[int, float]:
    """Return the joint with the most room to one of its limits (manual §4.13), and a step that way [rad]."""
    room = {
        (joint, sign): sign * ((JOINT_UPPER_RAD if sign > 0 else JOINT_LOWER_RAD)[side][joint] - q)
        for joint, q in enumerate(q_rad)
        for sign in (1, -1)
    }
    joint, sign = max(room, key=lambda each: room[each])
    return joint, sign * moved.STEP_RAD


@dataclass(slots=True, kw_only=True)
class Trials:
    """Tries what a person has agreed to, one after the other.

    Attributes:
        capture: What comes meanwhile.
        parts: Which parts are there, and enabled.
        tell: Who is told.
    """

    capture: Capture
    parts: dict[str, bool]
    tell: Teller

    def through(self, robot: Robot) -> Rows:
        """Try what any gateway can; an error leaves the robot held, a row that fails paused.

        Args:
            robot: Connected, and free.
        """
        sides = [side for side in Side if self.parts.get(f"{side}_arm")]
        with robot.control(on_loss="pause") as own:
            if sides:
                self.tell.advance("enable", None, "waiting for READY")
                own.enable()
                yield moved.echoed(self.capture, sides, self._while("echo", lambda: time.sleep(HOLD_S)))
                for side in sides:
                    yield self._moved(robot, own, side)
                for side in sides:
                    yield self._gripped(own, side)
                yield moved.disabled(self.capture, self._while("disable", own.disable, HOLD_S))
            if self.parts.get("chassis"):
                span = self._while("chassis_stop", lambda: self._drive(own), HOLD_S)
                yield moved.rolled_out("chassis_stop", self.capture, span)
            if self.parts.get("lift_servo"):
                yield moved.lifted(
                    self.capture, self._while("lift_stop", lambda: own.lift.drive_for(LIFT, HOLD_S), HOLD_S)
                )

    def _while(self, name: str, do: Callable[[], object], more_s: float = 0.0) -> Span:
        """Do something; return when, with some time behind it."""
        self.tell.advance(name, None, "")
        begin_ns = time.monotonic_ns()
        do()
        time.sleep(more_s)
        self.tell.advance(name, 1.0, "")
        return Span(begin_ns, time.monotonic_ns())

    def _moved(self, robot: Robot, own: Control, side: Side) -> Row:
        state = robot.state
        arm, is_joint = state.arm(side.value), state.mode is None or state.mode.joint_mode[side.value]
        if is_joint:
            joint, step = step_of(side, tuple(map(float, arm.q)))
            offset = [step if number == joint else 0.0 for number in range(len(arm.q))]

            def go() -> None:
                own.move_by({side.value: offset}, speed=SPEED).result()
                own.move_by({side.value: [-by for by in offset]}, speed=SPEED).result()

            return moved.moved_back(self.capture, side, joint, step, self._while(f"move_{side}", go, STEP_S))
        pose = arm.pose
        reach_m = float((pose.p @ pose.p) ** 0.5)
        near = PoseTarget(pose.p * (1.0 - moved.STEP_M / reach_m), pose.quat_xyzw, pose.frame)

        def go_straight() -> None:
            for goal in (near, PoseTarget(pose.p, pose.quat_xyzw, pose.frame)):
                own.move_pose({side.value: goal}, speed=SPEED).result()

        span = self._while(f"move_{side}", go_straight, STEP_S)
        return moved.moved_back(self.capture, side, None, -moved.STEP_M, span)

    def _gripped(self, own: Control, side: Side) -> Row:
        hand = own.left_gripper if side is Side.LEFT else own.right_gripper

        def pull() -> None:
            hand.open(FORCE)
            time.sleep(HOLD_S)
            hand.relax()

        return moved.gripped(self.capture, side, self._while(f"gripper_{side}", pull))

    def _drive(self, own: Control) -> None:
        own.chassis.set_velocity(moved.DRIVE_MPS, 0.0, 0.0, expiry=HOLD_S + REACT_S / 2)
        time.sleep(HOLD_S)
        own.chassis.stop()

    def without_its_gateway(self, settings: LinkSettings, config: str | None) -> Rows:
        """Kill a gateway of our own in mid-hold, another in mid-drive, and see what the robot does by itself."""
        if any(self.parts.get(f"{side}_arm") for side in Side):
            with own_gateway(settings, config) as (robot, process):
                own = robot.control(on_loss="hold").acquire()
                own.enable()
                span = self._while("heartbeat", process.kill, 0.0)
                _until(lambda: not self.is_started(span.begin_ns + S // 2), REACT_S)
                time.sleep(STEP_S)
                yield moved.paused_alone(self.capture, Span(span.begin_ns - S, time.monotonic_ns()))
        if self.parts.get("chassis"):
            with own_gateway(settings, config) as (robot, process):
                own = robot.control(on_loss="hold").acquire()
                begin_ns = time.monotonic_ns()
                own.chassis.set_velocity(moved.DRIVE_MPS, 0.0, 0.0, expiry=HOLD_S + REACT_S / 2)
                _until(lambda: self._is_rolling(begin_ns), REACT_S / 2)
                self._while("chassis_timeout", process.kill, REACT_S / 2)
                yield moved.rolled_out("chassis_timeout", self.capture, Span(begin_ns, time.monotonic_ns()))

    def is_started(self, since_ns: int = 0) -> bool:
        """Return whether the robot's newest state, or its silence since then, leaves its arms enabled."""
        newest = self.capture.numbers(FSM_STATE)[-1:]
        return not newest or newest[0][0] < since_ns or int(newest[0][1]) != moved.PAUSE

    def _is_rolling(self, since_ns: int) -> bool:
        newest = self.capture.motors(CHASSIS_STATE, Span(max(since_ns, time.monotonic_ns() - S // 5)))[-1:]
        return bool(newest) and max(map(abs, newest[0].dq_radps)) > moved.ROLLING_RADPS * 2

    def all(self, mine: Robot | None, settings: LinkSettings, config: str | None) -> list[Row]:
        """Return all rows that move, those too that were not tried.

        Args:
            mine: A gateway that runs; None for one of our own.
            settings: Where the robot is.
            config: File of further settings of our own.
        """
        rows: list[Row] = []
        why = "the part is not there, or disabled"
        try:
            if mine is not None:
                rows += _while_good(self.through(mine))
                rows += skipped(KILLING, "needs a gateway of its own", "end yours, then `ta2 check --robot ADDRESS`")
            else:
                with own_gateway(settings, config) as (robot, _):
                    rows += _while_good(self.through(robot))
                if all(each.verdict != "fail" for each in rows):
                    rows += _while_good(self.without_its_gateway(settings, config))
        except GatewayError as error:
            reached = [each.name for each in rows]
            name = next((each for each in MOVING if each not in reached and self._is_wanted(each)), "home")
            rows.append(row(name, False, line_of(error), remedy="`ta2 why` says more while a gateway runs"))
        if any(each.verdict == "fail" for each in rows):
            why = "an earlier one failed"
            if mine is None and self.is_started():  # it did not pause by itself
                with suppress(GatewayError), own_gateway(settings, config) as (robot, _):
                    robot.estop("ta2 check: the robot did not pause")
        rest = [name for name in MOVING if name not in {each.name for each in rows}]
        if "home" in rest:
            rows += skipped(("home",), "left to you", "`ta2 home`, with the arms' way in sight")
        rows += skipped(tuple(name for name in rest if name != "home"), why)
        return sorted(rows, key=lambda each: MOVING.index(each.name))

    def _is_wanted(self, name: str) -> bool:
        side = name.rpartition("_")[2]
        part = f"{side}_arm" if side in ("left", "right") else "chassis" if name.startswith("chassis") else "lift_servo"
        arms = any(self.parts.get(f"{each}_arm") for each in Side)
        return arms if name in ("echo", "disable", "heartbeat") else bool(self.parts.get(part))


def _while_good(rows: Rows) -> Iterator[Row]:
    """Yield rows until one fails; the rest is not tried, and what is owned is left as after an error."""
    for each in rows:
        yield each
        if each.verdict == "fail":
            rows.close()
            return
