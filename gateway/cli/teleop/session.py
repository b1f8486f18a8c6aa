"""The loop of `ta2 teleop`: wishes in, targets and velocities out, fifty times a second. What is refused is told in one line.

Nothing goes on by itself: each step needs a wish that is due now, and every target and velocity expires. After a refusal and
after a stop, everything must be let go before something moves again; the next stream begins where the gateway has the arm.
A stop is heard while anything waits for the gateway or a recorder, too.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import NoReturn, TypeVar

from gateway.api.recorder_protocol import RecordingState
from gateway.cli.teleop.arms import Arm
from gateway.cli.teleop.jogging import HAND, LEVELS, Ramp, full_speeds
from gateway.cli.teleop.keyboard import Wish
from gateway.cli.terminal.ending import line_of
from gateway.cli.terminal.owning import lost
from gateway.cli.terminal.progress import Teller
from gateway.client import Control, MotionHandle, Robot, RobotState
from gateway.errors import Code, Disconnected, GatewayError, LeaseError, ProtocolError, failure
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.description import nominal
from gateway.process.threads import supervised
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side

__all__ = ["ENABLE_S", "Session"]

T = TypeVar("T")

PERIOD_S, LONGEST_S = 0.02, 0.04
"""Of a step, and the longest time that one stands for: one that comes later makes up for nothing [s]."""
DEAF_S = 0.1
"""What takes longer is waited for with an ear for a stop [s]."""
EXPIRY_S, RENEW_NS = 0.3, 80_000_000
"""Life of a target and of a velocity [s]; velocities of chassis and lift are sent anew after so long [ns]."""
OLD_S, IDLE_NS = 0.3, 600_000_000
"""Nothing moves by an older state [s]; a stream is closed when nothing moved for so long [ns]."""
ASKED_NS, LATE_NS = 3_000_000_000, 2_000_000_000
"""So long may a question be answered by yes, and so long after that a yes is none for an episode either [ns]."""
READY = ("ENABLING", "ACTIVE", "HOLDING", "STOPPING", "STALE")
"""In these states, with nothing latched, nobody needs to enable again."""
ENABLE_S, HOME_SPEED, FORCE = 12.0, 0.2, 0.5
"""Longest wait [s]; parts of the velocity limits on the way home, and of a gripper's greatest torque."""


class Session:
    """A person's turn with a robot that is owned and enabled: which arm first, the task of the episodes, what `help` says."""

    def __init__(self, robot: Robot, own: Control, read: Callable[[int], Wish], tell: Teller) -> None:
        self.side, self.task, self.help = "left", "", ""
        self._robot, self._own, self._read, self._tell = robot, own, read, tell
        self._ramp, self._level, self._joint, self._in_hand = Ramp(), 2, 0, False
        self._arm: Arm | None = None
        self._home: MotionHandle | None = None
        self._moved_ns, self._driven_ns = 0, dict[str, int]()
        self._must_let_go = self._quits = self._is_down = False
        self._asked_ns = self._late_ns = 0  # since when home is asked for; till when a yes is too late
        self._note, self._episode = "", "no episode"

    def run(self) -> None:
        """Go on until `quit`.

        Raises:
            GatewayError: CANCELLED, the device is gone; LEASE_LOST, somebody else owns the robot; the gateway is lost.
        """
        last_ns = time.monotonic_ns()
        while not self._quits and "quit" not in (wish := self._read(time.monotonic_ns())).actions:
            now_ns = time.monotonic_ns()
            if wish.gone:
                _fail(Code.CANCELLED, wish.gone)
            try:
                self._step(wish, now_ns, min(max((now_ns - last_ns) / 1e9, 1e-3), LONGEST_S))
            except (Disconnected, LeaseError, ProtocolError):
                raise
            except GatewayError as error:
                self._rest(line_of(error))
            last_ns = now_ns

    def _step(self, wish: Wish, now_ns: int, dt_s: float) -> None:
        if "stop" in wish.actions:  # before anything else, which may wait or fail
            self._home, self._asked_ns = None, 0
            self._robot.stop("teleop")
            self._rest("stopped: the arms are held")
            return
        state = self._robot.state
        if state.lease.client_id != self._robot.client_id:
            raise lost(self._robot, state)
        if wish.missing:
            self._say(wish.missing)
        is_over = bool(wish.actions or wish.demand or wish.missing)
        is_homing = self._home is not None and self._is_homing(self._home, is_over=is_over)
        is_late = now_ns - self._asked_ns > ASKED_NS
        if self._asked_ns and (wish.demand or wish.missing or is_late):
            self._asked_ns, self._late_ns = 0, now_ns + LATE_NS if is_late else 0
            self._say("no, then")
        for action in () if is_homing else wish.actions:
            self._act(action, state, now_ns)
        self._must_let_go = bool(wish.missing or (self._must_let_go and wish.demand))
        is_off = self._must_let_go or self._home is not None or state.age > OLD_S
        parts, full = self._ramp.step({} if is_off else wish.demand, dt_s), full_speeds(self._robot.info, self._level)
        rates = {axis: part * full[axis] for axis, part in parts.items()}
        if self._is_due("chassis", any(rates[axis] for axis in ("vx", "vy", "wz")), now_ns):
            wanted = rates["vx"], rates["vy"], rates["wz"]
            self._aside(lambda: self._own.chassis.set_velocity(*wanted, expiry=EXPIRY_S), goes_on=True)
        if self._is_due("lift", bool(rates["lift"]), now_ns):
            self._aside(lambda: self._own.lift.set_velocity(rates["lift"], expiry=EXPIRY_S), goes_on=True)
        self._jog(rates, state, now_ns, dt_s, wished=bool(wish.demand) and not is_off)
        mode, axes = state.arm(self.side).space, "hand" if self._in_hand else "shoulder"
        speed = f"{full['x'] * 100:.3g} cm/s {full['yaw']:.2g} rad/s, joint {self._joint + 1}, axes of {axes}"
        stands = f"{state.shown} {state.fsm_name}, {self.side} arm"  # what matters most first: a narrow terminal cuts the rest
        told = (stands, self._note, self._episode, f"{mode} mode, {speed}")
        self._tell.advance("teleop", None, " | ".join(filter(None, told)))
        was_down, self._is_down = self._is_down, bool(state.latches) or state.state not in READY
        if self._is_down and not was_down:
            self._tell.say(f"{state.shown}: enter enables again (start on a gamepad)")

    def _jog(self, rates: Mapping[str, float], state: RobotState, now_ns: int, dt_s: float, *, wished: bool) -> None:
        moves = any(rates[axis] for axis in (*HAND, "joint"))
        if moves:
            self._moved_ns = now_ns
            if self._arm is None:
                self._aside(lambda: self._open(state), goes_on=True)
                return  # what is held now is what moves it
        elif self._arm is not None and now_ns - self._moved_ns > IDLE_NS:
            self._close()
        if self._arm is None:
            time.sleep(PERIOD_S)
            return
        why = self._arm.advance(rates, self._joint, dt_s, state, in_hand=self._in_hand)
        if wished:
            self._say(why)
        self._arm.out.tick()

    def _open(self, state: RobotState) -> None:
        """Open a stream; it is ours at once, so that whatever ends the wait for it closes it."""
        side, info = self.side, self._robot.info
        arm = self._own.left_arm if side == "left" else self._own.right_arm
        if state.mode is not None and not state.mode.joint_mode[side]:
            poses = arm.stream("pose", frame=f"{side}_shoulder_base", on_limit="clip", expiry=EXPIRY_S)
            self._arm = Arm(poses.__enter__(), None, info)
            return
        model = ArmModel(nominal(), Side(side), info.lower_rad[side], info.upper_rad[side])
        self._arm = Arm(arm.stream(on_limit="clip", expiry=EXPIRY_S).__enter__(), model, info)

    def _close(self) -> None:
        arm, self._arm = self._arm, None
        if arm is not None:
            self._aside(lambda: arm.out.__exit__(None, None, None), goes_on=True)

    def _is_due(self, what: str, moves: bool, now_ns: int) -> bool:
        """Return whether a velocity is to be sent: now and then while there is one, and once at its end."""
        if not moves:
            return self._driven_ns.pop(what, None) is not None
        is_due = now_ns - self._driven_ns.get(what, 0) >= RENEW_NS
        self._driven_ns |= {what: now_ns} if is_due else {}
        return is_due

    def _rest(self, why: str) -> None:
        self._ramp, self._must_let_go = Ramp(), True
        self._driven_ns.clear()  # their velocities expire, unless they have ended already
        try:
            self._close()
        except GatewayError as error:  # what has ended it is told; a stop while it closes is news
            why = line_of(error) if error.code is Code.CANCELLED else why
        self._say(why)

    def _act(self, action: str, state: RobotState, now_ns: int) -> None:
        name, _, number = action.partition(" ")
        is_asked, self._asked_ns = self._asked_ns > 0, 0
        if name == "arm":
            self.side = "right" if self.side == "left" else "left"
            self._rest(f"the {self.side} arm")
        elif name == "frame":
            self._in_hand = not self._in_hand
        elif name == "joint":
            self._joint = int(number) - 1
        elif name in ("faster", "slower"):
            self._level = min(max(self._level + (1 if name == "faster" else -1), 0), len(LEVELS) - 1)
        elif name in ("grip", "open", "relax"):
            gripper = self._own.left_gripper if self.side == "left" else self._own.right_gripper
            ask = gripper.grip if name == "grip" else gripper.open
            self._aside(gripper.relax if name == "relax" else lambda: ask(FORCE))
        elif name == "enable":
            if state.latches:
                self._aside(lambda: self._robot.recover("teleop"))
            self._aside(lambda: self._own.enable(timeout=ENABLE_S))
            self._rest("enabled")
        elif is_asked and name not in ("home", "yes"):
            self._say("no, then")
        elif is_asked:
            self._rest(f"the {self.side} arm goes home: anything ends it")
            goal = {self.side: HOME_Q_RAD[Side(self.side)]}
            self._home = self._aside(lambda: self._own.move_to(goal, speed=HOME_SPEED))
        elif name == "home":
            self._asked_ns = now_ns
            self._say(f"the {self.side} arm to its initial position (manual §6.6)? y or home again: go; others: no")
        elif name == "yes" and now_ns < self._late_ns:
            self._late_ns = 0
            self._say("too late: home asks again, another yes is for the episode")
        elif name == "help":
            self._tell.say(self.help)
        else:
            self._judge(name)

    def _judge(self, name: str) -> None:
        recording = self._robot.recording

        def ask() -> RecordingState:
            if name == "episode":
                return recording.stop() if recording.state().is_running else recording.start(self.task)
            return {"yes": recording.success, "failure": recording.failure, "discard": recording.discard}[name]()

        found = self._aside(ask)
        word = {"yes": "success", "episode": "begun" if found.is_running else "ended"}.get(name, name)
        self._episode = f"episode {found.episode} {word}"
        self._tell.say(self._episode)

    def _aside(self, work: Callable[[], T], *, goes_on: bool = False) -> T:
        """Do what may wait in a thread; nothing but stop and quit is heard until it has ended.

        After a wait everything must be let go, unless the work is a part of jogging, which `goes_on` while a key is held.

        Raises:
            GatewayError: As it does; CANCELLED, it was stopped meanwhile.
        """
        found, failed, is_stopped = list[T](), list[GatewayError](), False

        def do() -> None:
            try:
                found.append(work())
            except GatewayError as error:
                failed.append(error)

        thread = supervised(
            do, "ta2-teleop-aside", on_lost=lambda lost: failed.append(failure(Code.INTERNAL, str(lost)))
        )
        thread.start()
        thread.join(DEAF_S)
        if thread.is_alive() and not goes_on:  # what was wished before is an old wish when it has ended
            self._ramp, self._must_let_go = Ramp(), True
        while thread.is_alive():
            actions = self._read(time.monotonic_ns()).actions
            self._quits |= "quit" in actions
            if "stop" in actions:
                is_stopped = True
                self._robot.stop("teleop")
            thread.join(PERIOD_S)
        if is_stopped:
            self._home = None
            self._robot.stop("teleop")  # what it began after the first one
            raise failure(Code.CANCELLED, "stopped: the arms are held")
        if failed:
            raise failed[0]
        return found[0]

    def _is_homing(self, motion: MotionHandle, *, is_over: bool) -> bool:
        """End a way home that nobody wants any more, tell of one that has ended; return whether it went on until now."""
        if is_over and not motion.done:
            self._aside(motion.cancel)
        if motion.done:
            self._home, self._must_let_go = None, True
            motion.result()
            self._say(f"the {self.side} arm is at its initial position")
        return True

    def _say(self, note: str) -> None:
        """Say what is new; figures alone are nothing new."""
        if note and note.partition(":")[0] != self._note.partition(":")[0]:
            self._tell.say(note)
        self._note = note


def _fail(code: Code, message: str) -> NoReturn:
    raise failure(code, message, hint="start it again when that is over")
