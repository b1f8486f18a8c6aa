"""The simulated robot: messages in, messages out, in whatever time it is given.

Pure and deterministic: no clock, thread, socket or zenoh. Every watchdog trips at its exact instant and every motion
is solved exactly, so the same messages at the same times give the same robot however it is stepped.

What it obeys is said in the modules of its parts; here is what joins them. The MUX (§3.1.1): in VR mode API commands
are not taken, but `/api/fsm/enable` reaches the state machine in any mode. An arm takes only the commands of its
control mode and only when enabled (§4.1). A refusal leaves a line in the journal and nothing else (§4.10, §4.12).
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import Final, Protocol

from pycdr2 import IdlStruct

from cdr_types.messages import geometry_msgs, sensor_msgs, std_msgs
from cdr_types.registry import message_type
from gateway.sim.robot.arm import Drive, SimArm
from gateway.sim.robot.chassis import SimChassis
from gateway.sim.robot.clock import VIRTUAL_EPOCH_NS, RobotClock
from gateway.sim.robot.dynamics import dynamics_of
from gateway.sim.robot.faults import DelayLine, Fault, FaultBook, FaultError, parse_fault
from gateway.sim.robot.fsm import StateMachine
from gateway.sim.robot.gripper import SimGripper
from gateway.sim.robot.journal import Journal
from gateway.sim.robot.lift import SimLift
from gateway.sim.robot.manual import (
    CHASSIS_CMD,
    FSM_ENABLE,
    LIFT_CMD,
    MS,
    STATE_TOPICS,
    ArmMode,
    Fsm,
    S,
    Side,
    command_topics,
    gripper_cmd_topic,
    joint_cmd_topic,
)
from gateway.sim.robot.meter import MotionMeter, SetpointMeter, StreamMeter
from gateway.sim.robot.parts import Parts
from gateway.sim.robot.report import content, ee_pose, mode_json, sent_ns
from gateway.sim.robot.settings import SimSettings
from gateway.sim.robot.telemetry import Grid, Telemetry

__all__ = ["SimRobot"]


_SIDES: Final = tuple(Side)
_SIDE_OF: Final = {
    topic: side for topic in command_topics(has_lift=True) for side in Side if topic.startswith(f"/api/{side.value}_")
}


_DRIVES: Final = {Fsm.SLOW_START: Drive.APPROACH, Fsm.READY: Drive.FOLLOW}


class _Timed(Protocol):
    """Something that happens by itself at a known time."""

    @property
    def deadline_ns(self) -> int | None:
        """When [ns], None while nothing is due."""


class SimRobot:
    """A whole robot.

    Attributes:
        settings: What was chosen at the start.
        now_ns: How far it has been stepped [ns].
        fsm: State machine.
        arms: Arms by side.
        grippers: Grippers by side.
        chassis: Chassis.
        lift: Lift, None on models without one.
        dynamics: How its parts move: as lags and speeds, or as bodies with forces.
        clock: Stamps what it publishes.
        journal: The robot's own log and counters.
        api_mode: API mode (True) or VR mode.
        faults: The acting faults.
        states: State topics of this model's parts that are switched on, with their ROS types (§2.7.1).
        commands: Command topics of them, with their ROS types.
        meters: Arrivals per command topic.
        setpoints: How the arms were commanded, by side.
        motions: How the arms moved, by side.
    """

    def __init__(
        self, settings: SimSettings | None = None, start_ns: int = 0, epoch_ns: int = VIRTUAL_EPOCH_NS
    ) -> None:
        """Hang the arms and start publishing.

        Args:
            settings: What to simulate; the defaults are a standard robot ready for joint commands.
            start_ns: First point of the publishing grids [ns].
            epoch_ns: The wall clock minus the time that it is stepped with [ns].

        Raises:
            PhysicsMissing: The settings ask for MuJoCo, and it is not installed.
        """
        self.settings = settings or SimSettings()
        self.now_ns = start_ns
        self.journal = Journal()
        self.fsm = StateMachine()
        self.arms = {side: SimArm(side, self.settings, self.journal) for side in Side}
        self.grippers = {side: SimGripper(side, self.settings, self.journal) for side in Side}
        self.chassis = SimChassis(self.journal, is_enabled=self.settings.enable_chassis)
        self.lift: SimLift | None = None
        if self.settings.has_lift:
            is_configured, lowered_m = self.settings.enable_lift_servo, self.settings.start_lowered_m
            self.lift = SimLift(self.journal, start_ns, is_configured=is_configured, lowered_m=lowered_m)
        parts = Parts(
            arms=self.arms, grippers=self.grippers, chassis=self.chassis, lift=self.lift, journal=self.journal
        )
        self.dynamics = dynamics_of(self.settings, parts, start_ns)
        self.api_mode = self.settings.api_mode
        self.faults = FaultBook()
        offers, commands = self.settings.offers, command_topics(has_lift=self.settings.has_lift)
        self.states = {topic: name for topic, (name, _) in STATE_TOPICS.items() if offers(topic)}
        self.commands = {topic: name for topic, name in commands.items() if offers(topic)}
        self._types = {topic: message_type(name) for topic, name in commands.items()}
        self.meters = {topic: StreamMeter() for topic in commands}
        self.setpoints = {side: SetpointMeter() for side in Side}
        self.motions = {side: MotionMeter() for side in Side}
        self._timed: list[_Timed] = [self.fsm, self.faults, self.chassis, *self.arms.values(), *self.grippers.values()]
        if self.lift is not None:
            self._timed.append(self.lift)
        self.clock = RobotClock(epoch_ns, start_ns)
        self.clock.mistune(start_ns, self.settings.clock_offset_ns, self.settings.clock_drift_ppm)
        self._telemetry = Telemetry(self.settings, start_ns, self.clock)
        self._check_grid = Grid(start_ns, 50 * MS)
        self._outbox, self._inbox = DelayLine(), DelayLine()

    @property
    def next_state_ns(self) -> int:
        """Next point of the 200 Hz grid [ns]: when it is worth to be stepped next."""
        return self._telemetry.state_grid.next_ns

    # ------------------------------------------------------------------------------------------------------ messages

    def receive(self, topic: str, message: IdlStruct, now_ns: int) -> None:
        """Take a message from a user.

        Args:
            topic: Command topic of §4.1; any other is journalled and ignored.
            message: Message of the topic's type.
            now_ns: Arrival [ns]; a time before `now_ns` of the robot counts as now.
        """
        wanted = self._types.get(topic)
        if wanted is None or not isinstance(message, wanted):
            self.journal.note(now_ns, "NOT_A_COMMAND", topic, type(message).__name__)
            return
        self.meters[topic].add(now_ns, content(message), sent_ns(message))
        at_ns = max(now_ns, self.now_ns)
        self._step_to(at_ns)
        for due_ns, passed in self.faults.pass_through(topic, message, at_ns):
            if due_ns <= at_ns:
                self._obey(topic, passed, at_ns)
            else:
                self._inbox.push(due_ns, topic, passed)

    def advance(
        self, now_ns: int, *, latest_only: bool = False, topics: Container[str] = frozenset(STATE_TOPICS)
    ) -> list[tuple[str, IdlStruct]]:
        """Let time pass and return everything published on the way as (topic, message), in order.

        `latest_only` returns only the last due message of each topic: what a subscriber that looks once would keep,
        and much cheaper over long steps. Of `topics` those that this robot has.
        """
        topics = [topic for topic in self.states if topic in topics]
        published: list[tuple[str, IdlStruct]] = []
        if latest_only:
            self._telemetry.skip_to(now_ns)
        while True:
            delayed_ns = self._outbox.next_ns
            due_ns = self._telemetry.next_ns if delayed_ns is None else min(self._telemetry.next_ns, delayed_ns)
            if due_ns > now_ns:
                break
            self._step_to(due_ns)
            if self._telemetry.state_grid.next_ns <= due_ns:
                for side, arm in self.arms.items():
                    self.motions[side].add(due_ns, arm.q_rad)
            due = self._telemetry.collect(due_ns, self.arms, self.grippers, self.chassis, self._report, topics)
            if delayed_ns is None and self.faults.is_empty:
                published += due
                continue
            for topic, message in due:
                for out_ns, passed in self.faults.pass_through(topic, message, due_ns):
                    self._outbox.push(out_ns, topic, passed)
            published += self._outbox.pop_due(due_ns)
        self._step_to(now_ns)
        return published

    def _report(self) -> tuple[int, str]:
        return self.fsm.published, mode_json(self)

    # ------------------------------------------------------------------------------------------------------ commands

    def _obey(self, topic: str, message: IdlStruct, now_ns: int) -> None:
        """Act on a message that reached its node."""
        if topic == FSM_ENABLE and isinstance(message, std_msgs.Float32):
            self._enable(message.data, now_ns)
        elif not self.api_mode:
            self.journal.note(now_ns, "VR_MODE", topic, "API commands are not taken (§3.1.1)")
        elif isinstance(message, std_msgs.Float32MultiArray):
            self._obey_base(topic, message, now_ns)
        else:
            side = _SIDE_OF[topic]
            self._obey_arm(side, topic, message, now_ns)
            self._redrive((side,))  # whatever one arm is told, the other goes on as it was
            return
        self._redrive()

    def _enable(self, value: float, now_ns: int) -> None:
        was_paused = self.fsm.state is Fsm.PAUSE
        if not self.fsm.enable(value, now_ns):
            self.journal.note(now_ns, "ENABLE_VALUE", FSM_ENABLE, f"{value} is neither 1.0 nor 0.0 (§4.7)")
        if was_paused and self.fsm.is_started:
            for arm in self.arms.values():
                arm.start()

    def _obey_base(self, topic: str, message: std_msgs.Float32MultiArray, now_ns: int) -> None:
        if topic == LIFT_CMD and self.lift is not None:
            self.lift.command(message.data, now_ns)
        elif topic == CHASSIS_CMD and self.chassis.is_enabled:
            self.chassis.command(message.data, now_ns)
        else:
            self.journal.note(now_ns, "CHASSIS_DISABLED", topic, "not enabled in the configuration (§4.1)")

    def _obey_arm(self, side: Side, topic: str, message: IdlStruct, now_ns: int) -> None:
        arm = self.arms[side]
        if not arm.is_enabled:
            self.journal.note(now_ns, "ARM_DISABLED", topic, "not enabled in the configuration (§4.1)")
            return
        if topic == gripper_cmd_topic(side) and isinstance(message, std_msgs.Float32):
            self.grippers[side].command(message.data, now_ns)
            return
        needed = ArmMode.JOINT if topic == joint_cmd_topic(side) else ArmMode.POSE
        if arm.mode is not needed:
            self.journal.note(now_ns, "WRONG_MODE", topic, f"the arm is in {arm.mode.name.lower()} mode (§4.1)")
            return
        accepted = False
        if isinstance(message, sensor_msgs.JointState):
            accepted = arm.command_joints(message.position, now_ns)
        elif isinstance(message, geometry_msgs.Pose):
            accepted = arm.command_pose(ee_pose(message), now_ns)
        if accepted:
            self.grippers[side].arm_commanded(now_ns)
            self.setpoints[side].add(now_ns, arm.target_rad)

    def _redrive(self, sides: Iterable[Side] = _SIDES) -> None:
        """Let the state machine's state take hold of the motors."""
        state = self.fsm.state
        drive = _DRIVES.get(state, Drive.STILL)
        is_started = drive is not Drive.STILL
        for side in sides:
            arm = self.arms[side]
            arm.set_drive(drive)
            self.grippers[side].engage(
                is_started=is_started, is_paused=state is Fsm.PAUSE, is_enabled=arm.is_enabled and self.api_mode
            )
        if self.lift is not None:
            self.lift.has_error = state is Fsm.ERROR

    # ---------------------------------------------------------------------------------------------------------- time

    def _step_to(self, until_ns: int) -> None:
        """Let time pass, stopping at every instant at which something changes."""
        while self.now_ns < until_ns:
            event_ns = self._next_event_ns()
            next_ns = min(until_ns, event_ns)
            if next_ns > self.now_ns:
                self.dynamics.move(self.now_ns, next_ns - self.now_ns)
                self.now_ns = next_ns
            if event_ns <= self.now_ns:
                self._fire()

    def _next_event_ns(self) -> int:
        next_ns = self._check_grid.next_ns
        inbox_ns = self._inbox.next_ns
        if inbox_ns is not None and inbox_ns < next_ns:
            next_ns = inbox_ns
        for part in self._timed:
            deadline_ns = part.deadline_ns
            if deadline_ns is not None and deadline_ns < next_ns:
                next_ns = deadline_ns
        return next_ns

    def _fire(self) -> None:
        """Let happen what is due now."""
        now_ns = self.now_ns
        if self.faults.expire(now_ns):
            self._apply_faults()
        for topic, message in self._inbox.pop_due(now_ns):
            self._obey(topic, message, now_ns)
        if self.fsm.expire(now_ns):
            self.journal.note(now_ns, "HEARTBEAT_LOST", "fsm", "no 1.0 for 1 s, PAUSE (§4.7)")
        for side in Side:
            self.arms[side].expire(now_ns)
            self.grippers[side].expire(now_ns)
        self.chassis.expire(now_ns)
        if self.lift is not None:
            self.lift.expire(now_ns)
        if self._check_grid.next_ns <= now_ns:
            self._check_grid.advance()
            enabled = [arm for arm in self.arms.values() if arm.is_enabled]
            may = not self.settings.ready_needs_commands or all(arm.is_told for arm in enabled)
            self.fsm.check([arm.deviation_rad for arm in enabled] if may else [])
        self._redrive()

    # -------------------------------------------------------------------------------------------------------- faults

    def inject(self, command: str | Mapping[str, object] | Fault, now_ns: int) -> Fault:
        """Let a fault act from now on; return it.

        Args:
            command: A fault, or the text or mapping of one.
            now_ns: Time [ns].

        Raises:
            FaultError: If the command is not understood, or is about a process or a bridge, which this robot has not.
        """
        fault = command if isinstance(command, Fault) else parse_fault(command)
        if fault.scope == "node":
            raise FaultError(f"fault {fault.name} is about the process or the bridge: only a running node has it")
        self._step_to(max(now_ns, self.now_ns))
        self.journal.note(self.now_ns, "FAULT", fault.name, fault.details)
        if fault.name == "pause":
            self.fsm.pause()
        if fault.name != "pause" or fault.duration_s is not None:
            self.faults.add(fault, self.now_ns)
        self._apply_faults()
        return fault

    def clear(self, name: str | None = None, topic: str | None = None) -> int:
        """End all faults, those of a name or those on a topic, and restart the chassis node; return how many ended."""
        ended = self.faults.clear(name, topic)
        self.chassis.restart()
        self._apply_faults()
        return ended

    def _apply_faults(self) -> None:
        """Bring the robot in line with the faults that act now."""
        active = self.faults.active()
        pins = [
            int(fault.number) if fault.name == "fsm_value" else int(Fsm.ERROR)
            for fault in active
            if fault.name in ("fsm_value", "fsm_error")
        ]
        self.fsm.pin(pins[-1] if pins else None)
        self.fsm.is_held = any(fault.name == "pause" for fault in active)
        self.api_mode = self.settings.api_mode and not any(fault.name == "vr_mode" for fault in active)
        step_s = sum(fault.number for fault in active if fault.name == "clock_step")
        drift_ppm = sum(fault.number for fault in active if fault.name == "clock_drift")
        settings = self.settings
        offset_ns = settings.clock_offset_ns + round(step_s * S)
        self.clock.mistune(self.now_ns, offset_ns, settings.clock_drift_ppm + drift_ppm)
        for side, arm in self.arms.items():
            own = [fault for fault in active if fault.side == side.value]
            enabled = self.settings.arm_enabled(side) and not any(fault.name == "arm_disabled" for fault in own)
            modes = [ArmMode[fault.mode.upper()] for fault in own if fault.name == "control_mode"]
            mode = modes[-1] if modes else self.settings.arm_mode(side)
            if (enabled, mode) != (arm.is_enabled, arm.mode):
                arm.is_enabled, arm.mode = enabled, mode
                arm.drop_stream()
            arm.is_blocked = any(fault.name == "blocked" for fault in own)
            arm.load_kg = sum(fault.number for fault in own if fault.name == "load")
            arm.has_ik = not any(fault.name == "no_ik" for fault in own)
            arm.measured_offset_rad[:] = arm.margin_rad[:] = arm.zero_rad[:] = arm.stuck[:] = 0.0
            for fault in own:
                if fault.name == "jump":
                    arm.measured_offset_rad[fault.joint - 1] += fault.number
                elif fault.name == "tight_limit":
                    arm.margin_rad[fault.joint - 1] += fault.number
                elif fault.name == "joint_zero":
                    arm.zero_rad[fault.joint - 1] += fault.number
                elif fault.name == "stuck":
                    arm.stuck[fault.joint - 1] = True
        self._redrive()

    def reset_stats(self) -> None:
        """Start the figures of `report.stats` anew; the journal and its counts stay."""
        for meter in self.meters.values():
            meter.reset()
        for side, arm in self.arms.items():
            self.setpoints[side].reset()
            self.motions[side].reset()
            arm.accepted = arm.clips = arm.stream_losses = 0
