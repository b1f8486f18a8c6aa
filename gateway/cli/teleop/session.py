"""The loop of `ta2 teleop`: wishes in, targets and velocities out, fifty times a second. What is refused is told in one line.

Nothing goes on by itself: each step needs a wish that is due now, and every target and velocity expires. After a refusal and after
a stop, everything must be let go before something moves again; the next stream begins where the gateway has the arm.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NoReturn

from gateway.cli.teleop.arms import Arm
from gateway.cli.teleop.jogging import HAND, LEVELS, Ramp, full_speeds
from gateway.cli.teleop.keyboard import Device, Wish
from gateway.cli.terminal.ending import line_of
from gateway.client import Control, MotionHandle, Robot, RobotState
from gateway.errors import (
    Code,
    Disconnected,
    GatewayError,
    LeaseError,
    OutcomeUnknown,
    ProtocolError,
    Refusal,
    to_exception,
)
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import Description
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side

__all__ = ["ENABLE_S", "Session"]

PERIOD_S, LONGEST_S = 0.02, 0.04
"""Of a step, and the longest time that one stands for: one that comes later makes up for nothing [s]."""
EXPIRY_S, RENEW_NS = 0.3, 80_000_000
"""Life of a target and of a velocity [s]; velocities of chassis and lift are sent anew after so long [ns]."""
IDLE_NS = 600_000_000
"""A stream is closed when nothing moved for so long [ns]."""
OLD_S = 0.3
"""Nothing moves by a state that is older [s]."""
ENABLE_S = 12.0
HOME_SPEED, FORCE = 0.2, 0.5
"""Parts of the velocity limits on the way home, and of a gripper's greatest torque."""


@dataclass(kw_only=True)
class Session:
    """A person's turn with the robot.

    Attributes:
        robot: Connected.
        own: The right to command it, with the arms enabled.
        device: What is wished with.
        body: Numbers of the body, for the hand of an arm in joint mode.
        say: Prints a line that stays.
        show: Shows the line of status.
        help: What is said when help is asked for.
        side: The arm that is jogged.
        task: Of the episodes.
        now_ns: The clock [ns].
        pause: What waits [s].
    """

    robot: Robot
    own: Control
    device: Device
    body: Description
    say: Callable[[str], None]
    show: Callable[[str], None]
    help: str = ""
    side: str = "left"
    task: str = ""
    now_ns: Callable[[], int] = time.monotonic_ns
    pause: Callable[[float], None] = time.sleep
    _ramp: Ramp = field(default_factory=Ramp)
    _level: int = 2
    _joint: int = 0
    _in_hand: bool = False
    _arm: Arm | None = None
    _moved_ns: int = 0
    _driven_ns: dict[str, int] = field(default_factory=dict)
    _must_let_go: bool = False
    _home: MotionHandle | None = None
    _asked: str = ""
    _note: str = ""
    _episode: str = "no episode"

    def run(self) -> None:
        """Go on until `quit`.

        Raises:
            GatewayError: CANCELLED, the device is gone; LEASE_LOST, somebody else owns the robot; the gateway is lost.
        """
        last_ns = self.now_ns()
        while "quit" not in (wish := self.device.read(self.now_ns())).actions:
            now_ns = self.now_ns()
            if wish.gone:
                _fail(Code.CANCELLED, wish.gone)
            try:
                self._step(wish, now_ns, min(max((now_ns - last_ns) / 1e9, 1e-3), LONGEST_S))
            except (Disconnected, LeaseError, OutcomeUnknown, ProtocolError):
                raise
            except GatewayError as error:
                self._rest(line_of(error))
            last_ns = now_ns

    def _step(self, wish: Wish, now_ns: int, dt_s: float) -> None:
        state = self.robot.state
        if state.lease.client_id != self.robot.client_id:
            _fail(Code.LEASE_LOST, f"{state.lease.name or 'nobody'!r} owns the robot now")
        if wish.missing:
            self._tell(wish.missing)
        if self._home is not None:
            self._watch(self._home, is_over=bool(wish.actions or wish.demand))
        else:
            for action in wish.actions:
                self._act(action, state)
        self._must_let_go &= bool(wish.demand)
        is_off = self._must_let_go or self._home is not None or state.age > OLD_S
        parts, full = self._ramp.step({} if is_off else wish.demand, dt_s), full_speeds(self.robot.info, self._level)
        rates = {axis: part * full[axis] for axis, part in parts.items()}
        if self._is_due("chassis", any(rates[axis] for axis in ("vx", "vy", "wz")), now_ns):
            self.own.chassis.set_velocity(rates["vx"], rates["vy"], rates["wz"], expiry=EXPIRY_S)
        if self._is_due("lift", bool(rates["lift"]), now_ns):
            self.own.lift.set_velocity(rates["lift"], expiry=EXPIRY_S)
        self._jog(rates, state, now_ns, dt_s, wished=bool(wish.demand) and not is_off)
        mode, axes = state.arm(self.side).space, "hand" if self._in_hand else "shoulder"
        speed = f"{full['x'] * 100:.3g} cm/s {full['yaw']:.2g} rad/s, joint {self._joint + 1}, axes of {axes}"
        told = (f"{self.side} arm, {mode} mode, {speed}", f"{state.shown} {state.fsm_name}", self._episode, self._note)
        self.show(" | ".join(filter(None, told)))

    def _jog(self, rates: Mapping[str, float], state: RobotState, now_ns: int, dt_s: float, *, wished: bool) -> None:
        """Set the next target and wait for its successor's instant."""
        moves = any(rates[axis] for axis in (*HAND, "joint"))
        if moves:
            self._moved_ns = now_ns
            self._arm = self._arm or self._opened(state)
        elif self._arm is not None and now_ns - self._moved_ns > IDLE_NS:
            self._close()
        if self._arm is None:
            self.pause(PERIOD_S)
            return
        why = self._arm.advance(rates, self._joint, dt_s, state, in_hand=self._in_hand)
        if wished:
            self._tell(why)
        self._arm.out.tick()

    def _opened(self, state: RobotState) -> Arm:
        side, info = self.side, self.robot.info
        arm = self.own.left_arm if side == "left" else self.own.right_arm
        if state.mode is not None and not state.mode.joint_mode[side]:
            poses = arm.stream("pose", frame=f"{side}_shoulder_base", on_limit="clip", expiry=EXPIRY_S)
            return Arm(poses.__enter__(), None, info)
        model = ArmModel(self.body, Side(side), info.lower_rad[side], info.upper_rad[side])
        return Arm(arm.stream(on_limit="clip", expiry=EXPIRY_S).__enter__(), model, info)

    def _close(self) -> None:
        """End the stream: the arm brakes and is held."""
        arm, self._arm = self._arm, None
        if arm is not None:
            arm.out.__exit__(None, None, None)

    def _is_due(self, what: str, moves: bool, now_ns: int) -> bool:
        """Return whether a velocity has to be sent: every now and then while there is one, and once at its end."""
        if not moves:
            return self._driven_ns.pop(what, None) is not None
        is_due = now_ns - self._driven_ns.get(what, 0) >= RENEW_NS
        self._driven_ns |= {what: now_ns} if is_due else {}
        return is_due

    def _rest(self, why: str) -> None:
        """Let everything go, and say why."""
        self._ramp, self._must_let_go = Ramp(), True
        self._driven_ns.clear()  # their velocities expire, unless they have ended already
        with suppress(GatewayError):  # what has ended it is told
            self._close()
        self._tell(why)

    def _act(self, action: str, state: RobotState) -> None:
        name, _, number = action.partition(" ")
        asked, self._asked = self._asked, ""
        if name == "stop":
            self.robot.stop("teleop")
            self._rest("stopped: the arms are held")
        elif name == "arm":
            self.side = "right" if self.side == "left" else "left"
            self._rest(f"the {self.side} arm")
        elif name == "frame":
            self._in_hand = not self._in_hand
        elif name == "joint":
            self._joint = int(number) - 1
        elif name in ("faster", "slower"):
            self._level = min(max(self._level + (1 if name == "faster" else -1), 0), len(LEVELS) - 1)
        elif name in ("grip", "open", "relax"):
            gripper = self.own.left_gripper if self.side == "left" else self.own.right_gripper
            gripper.relax() if name == "relax" else (gripper.grip if name == "grip" else gripper.open)(FORCE)
        elif name == "enable":
            if state.latches:
                self.robot.recover("teleop")
            self.own.enable(timeout=ENABLE_S)
            self._rest("enabled")
        elif asked and name not in ("home", "yes"):
            self._tell("no, then")
        elif asked:
            self._rest(f"the {self.side} arm goes home: anything ends it")
            self._home = self.own.move_to({self.side: HOME_Q_RAD[Side(self.side)]}, speed=HOME_SPEED)
        elif name == "home":
            self._asked = name
            self._tell(
                f"the {self.side} arm to its initial position (manual §6.6)? y or home again: yes; anything else: no"
            )
        elif name == "help":
            self.say(self.help)
        else:
            self._judge(name)

    def _judge(self, name: str) -> None:
        """Begin, end or judge an episode of the recording."""
        recording = self.robot.recording
        if name == "episode":
            found = recording.stop() if recording.state().is_running else recording.start(self.task)
        else:
            found = {"yes": recording.success, "failure": recording.failure, "discard": recording.discard}[name]()
        word = {"yes": "success", "episode": "begun" if found.is_running else "ended"}.get(name, name)
        self._episode = f"episode {found.episode} {word}"
        self.say(self._episode)

    def _watch(self, motion: MotionHandle, *, is_over: bool) -> None:
        """End a way home that nobody wants any more; tell of one that has ended."""
        if is_over and not motion.done:
            motion.cancel()
        if motion.done:
            self._home, self._must_let_go = None, True
            motion.result()
            self._tell(f"the {self.side} arm is at its initial position")

    def _tell(self, note: str) -> None:
        """Say what is new; figures alone are nothing new."""
        if note and note.partition(":")[0] != self._note.partition(":")[0]:
            self.say(note)
        self._note = note


def _fail(code: Code, message: str) -> NoReturn:
    raise to_exception(Refusal(code=code, message=message, hint="start it again when that is over"))
