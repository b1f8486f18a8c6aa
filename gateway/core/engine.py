"""The brain: takes events and `now_ns`, gives frames, replies, notices and snapshots. Pure and sequential.

Access must be serialised by the caller; `loop.py` is the only one. One tick is:

    samples (already in the store)  ->  conditions of the robot  ->  stop and estop  ->  other requests and targets
    ->  phases (what takes time)  ->  streams  ->  gate  ->  frames

so a request is judged by the newest state, a stop comes before everything that arrived with it, and nothing leaves that
the gate did not clear. A tick that comes too late sends stop frames only: nothing is caught up.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from gateway.core.handover.takeover import Takeover
from gateway.core.messages.events import (
    ClientGone,
    ClientSeen,
    CommandRequested,
    EndpointHeard,
    Event,
    GuardSeen,
    HeldElsewhere,
    LinkDown,
    LinkUp,
    RobotsAnnounced,
    RouteObserved,
    SampleArrived,
    SampleRefused,
    SettingsRead,
    Suspended,
    TakenOver,
    TargetArrived,
)
from gateway.core.messages.outputs import Level, Remembered, Reply, found_at
from gateway.core.messages.sightings import Sighting
from gateway.core.others.other_robots import other_namespace, two_robots
from gateway.core.output.diagnosis import Diagnosis
from gateway.core.output.frame_collector import FrameCollector, Output
from gateway.core.output.pace import TICK_NS, Pace, is_idle
from gateway.core.output.view import build
from gateway.core.requests.answers import Answers
from gateway.core.requests.handler import RequestHandler
from gateway.core.requests.preconditions import Preconditions
from gateway.core.robot_state.duplication import Duplication
from gateway.core.streams.gate import Cleared, Gate
from gateway.core.supervision.conditions import Conditions
from gateway.core.supervision.coordinator import AT_BASE, Coordinator
from gateway.core.supervision.drives import Drives
from gateway.core.supervision.loss import Loss
from gateway.core.supervision.phases import Phases
from gateway.core.supervision.reloading import take_settings
from gateway.core.supervision.rivalry import Rivalry
from gateway.core.supervision.supervisor import State, Trigger
from gateway.errors import Code, Refusal
from gateway.messages.requests import Abandon, Estop, Stop
from gateway.messages.snapshot import Snapshot
from gateway.robot.limits import ARM_WATCHDOG_NS
from gateway.robot.topics import FSM_STATE
from gateway.settings.settings import Settings
from gateway.values import FsmState, Side, Vector

if TYPE_CHECKING:
    from gateway.core.robot_state.body_model import BodyModel

__all__ = ["Engine", "Output"]

MS = 1_000_000
S = 1_000_000_000


class Engine:
    """Joins store, lease, supervisor, validation, motion, streams and gate.

    A guard's engine commands only in a dead daemon's place.
    """

    def __init__(
        self,
        settings: Settings,
        remembered: Remembered | None = None,
        model: BodyModel | None = None,
        *,
        is_guard: bool = False,
    ) -> None:
        self._settings = settings
        self._coordinator = Coordinator(settings, remembered or Remembered(), model)
        self._conditions = Conditions(self._coordinator)
        self._loss = Loss(self._coordinator)
        self._rivalry = Rivalry(self._coordinator)
        self._phases = Phases(self._coordinator, self._conditions)
        self._drives = Drives(self._coordinator)
        self._handler = RequestHandler(self._coordinator, self._phases)
        self._collector = FrameCollector(
            self._coordinator, Gate(settings.arm, settings.link.variant, settings.chassis, settings.pose)
        )
        self.takeover = Takeover(self._coordinator, self._collector.resume, is_guard=is_guard)
        """What is on the wire, and going on in another process's place."""
        self._duplication = Duplication()
        self._is_guard = is_guard
        self._diagnosis = Diagnosis(self._coordinator)
        self._preconditions = Preconditions(self._coordinator, self._handler)
        self._commands: list[CommandRequested] = []
        self._targets: dict[tuple[int, str], TargetArrived] = {}
        self._replies: list[Reply] = []
        self._answered = Answers()
        self._refused: dict[str, int] = {}
        """How many requests were refused, by code."""
        self._saved = self._coordinator.remembered()
        self._pace = Pace(settings.local.snapshot_hz)
        self.is_watched = True
        """Whether anybody listens to snapshots; when nobody does, few are made (for those who ask)."""

    @property
    def state(self) -> State:
        """The supervisor's state."""
        return self._coordinator.state

    @property
    def is_broken(self) -> bool:
        """Whether a part of this process has ended: once done, it must end as one that died, not as one that was asked to."""
        return self._phases.is_broken

    @property
    def is_posing(self) -> bool:
        """Whether an enabled arm is in end-effector mode: its pose decides about motion."""
        return self._coordinator.is_posing

    @property
    def is_streaming(self) -> bool:
        """Whether setpoints are being sent."""
        return bool(self._coordinator.body.running_arms)

    @property
    def rest_ns(self) -> int:
        """How far apart ticks may be [ns] while nobody owns the robot or asks, nothing is sent, owed, under way; else 0."""
        is_busy = bool(self._commands) or not is_idle(self._coordinator)
        return 0 if is_busy else self._pace.rest_ns(is_watched=self.is_watched)

    @property
    def latches(self) -> Mapping[Code, str]:
        """Causes that refuse motion, with their messages."""
        return dict(self._coordinator.supervisor.latches)

    @property
    def running_topics(self) -> tuple[str, ...]:
        """Command topics whose streams are running."""
        return tuple(stream.topic for stream in self._coordinator.body.streams if stream.running)

    @property
    def owner_id(self) -> str | None:
        """Client id of the owner; None when nobody owns the robot."""
        owner = self._coordinator.lease.owner
        return owner.client_id if owner else None

    @property
    def heeded(self) -> frozenset[str]:
        """Client ids of the owner and of the stop endpoints: nobody else's signs of life and targets count."""
        owner = self._coordinator.lease.owner
        return self._coordinator.endpoints.client_ids | ({owner.client_id} if owner else set())

    @property
    def stopper_id(self) -> str:
        """Who alone left the stop that is latched, and may undo it; empty when nobody, or nobody alone, did."""
        return self._coordinator.supervisor.stopper

    @property
    def open_stream_id(self) -> int | None:
        """Id of the stream of targets that was opened last; None when none is open."""
        streams = self._coordinator.body.targets.running
        return streams[-1].stream_id if streams else None

    # ------------------------------------------------------------------------------------------------ events in

    def receive(self, event: Event, now_ns: int) -> None:
        """Take one event. Samples and link events act at once; requests wait for the tick."""
        coordinator = self._coordinator
        if isinstance(event, (SampleArrived, SampleRefused)):
            jumped = coordinator.store.receive(event, now_ns)
            if jumped:
                coordinator.notice(Code.STATE_JUMPED, Level.WARNING, jumped, now_ns, topic=event.topic)
            if isinstance(event, SampleArrived):
                if coordinator.model is not None and coordinator.store.value(event.topic) is event.value:  # believed
                    coordinator.model.hear(event, now_ns, coordinator.body.chassis.commanded)
                if event.topic == FSM_STATE and event.value == FsmState.PAUSE:
                    coordinator.body.heartbeat.fsm_zero_seen(event.received_ns)
                told = self._duplication.note(event)
                if told:
                    coordinator.notice(Code.STATE_DUPLICATED, Level.WARNING, told, now_ns, topic=event.topic)
        elif isinstance(event, CommandRequested):
            self._commands.append(event)
        elif isinstance(event, TargetArrived):
            slot = event.stream_id, event.client_id  # one client cannot push another's target out
            latest = self._targets.get(slot)
            if latest is None or event.seq > latest.seq:
                self._targets[slot] = event
        elif isinstance(event, ClientSeen):
            coordinator.lease.seen(event.client_id, event.at_ns)
        elif isinstance(event, ClientGone):
            coordinator.lease.gone(event.client_id, event.at_ns)
            coordinator.endpoints.gone(event.client_id, event.at_ns)
        elif isinstance(event, EndpointHeard):
            coordinator.endpoints.heard(event.client_id, event.at_ns)
        elif isinstance(event, LinkUp):
            self._link_up(event, now_ns)
        elif isinstance(event, LinkDown):
            self._link_down(now_ns)
        elif isinstance(event, RouteObserved):
            coordinator.routes[event.topic] = event.message
            if event.code is not None:
                coordinator.notice(event.code, Level.WARNING, event.message, now_ns, topic=event.topic)
        elif isinstance(event, RobotsAnnounced):
            self._see_robots(event, now_ns)
        elif isinstance(event, Sighting):
            self._rivalry.receive(event)
        elif isinstance(event, Suspended):
            coordinator.forget_state()  # CLOCK_MONOTONIC stood still: what was heard before looks younger than it is
            coordinator.store.disturb(now_ns)
            coordinator.notice(
                Code.SUSPENDED, Level.WARNING, f"this host stood still for {event.slept_ns / S:.1f} s", now_ns
            )
            coordinator.fire(Trigger.SUSPENDED, now_ns, "this host was suspended")
        elif isinstance(event, (TakenOver, HeldElsewhere, GuardSeen)):
            self.takeover.hear(event, now_ns)
        elif isinstance(event, SettingsRead):
            take_settings(coordinator, event)
        else:
            self._phases.end(event, now_ns)

    def _see_robots(self, event: RobotsAnnounced, now_ns: int) -> None:
        coordinator = self._coordinator
        own = coordinator.settings.link.namespace
        coordinator.other_robot = refusal = two_robots(event.twins, own) or other_namespace(event.elsewhere, own)
        if refusal is not None:
            coordinator.notice(refusal.code, Level.WARNING, f"{refusal.message}; {refusal.hint}".strip("; "), now_ns)

    def _link_up(self, event: LinkUp, now_ns: int) -> None:
        coordinator = self._coordinator
        before = coordinator.router_zid
        self._link_down(now_ns)  # another transport, whoever is at its end: what was under way on the old one is lost
        coordinator.transport_up, coordinator.router_zid = True, event.router_zid
        coordinator.routers = found_at(coordinator.routers, event.router_zid, self._settings.link.namespace)
        self._rivalry.link_up(event.own_zid, now_ns)
        coordinator.forget_state()
        coordinator.body.find_transport(now_ns)
        coordinator.notice(Code.LINK_UP, Level.INFO, f"linked to the robot's router {event.router_zid}", now_ns)
        if before and before != event.router_zid:
            text = f"the robot's router is another one than before ({before})"
            coordinator.notice(Code.ROBOT_RESTARTED, Level.WARNING, text, now_ns)

    def _link_down(self, now_ns: int) -> None:
        coordinator = self._coordinator
        coordinator.other_robot = None
        if coordinator.transport_up:
            coordinator.transport_up = False
            coordinator.claim.link_down()
            coordinator.forget_state()
            self._duplication.reset()
            coordinator.notice(Code.LINK_DOWN, Level.WARNING, "the link to the robot's router is down", now_ns)
            coordinator.fire(Trigger.TRANSPORT_LOST, now_ns, "the link to the robot's router is down")
            coordinator.body.lose_transport(now_ns)

    # ------------------------------------------------------------------------------------------------ one tick

    def tick(self, now_ns: int, late_ns: int = 0) -> Output:
        """Run one cycle; return everything that must leave, in order."""
        self._pace.tick(now_ns, late_ns)
        is_late = late_ns > self._settings.enable.late_ns
        if is_late:
            self._coordinator.store.disturb(now_ns)
            text = f"a tick came {late_ns / MS:.0f} ms late and was skipped, not caught up"
            self._coordinator.notice(Code.TICK_LATE, Level.WARNING, text, now_ns)
        gap_ns = max(late_ns + TICK_NS, self._pace.gap_ns(now_ns, is_late=is_late))
        if gap_ns > ARM_WATCHDOG_NS:
            # The robot has stopped the arms meanwhile: no setpoint at speed must meet them.
            text = f"a tick came {late_ns / MS:.0f} ms late, {gap_ns / MS:.0f} ms after the last that was in time"
            self._coordinator.fire(Trigger.LONG_GAP, now_ns, text)
        self._loss.look(now_ns, late_ns)
        self._handler.watch.look(now_ns, late_ns)
        self.takeover.step(now_ns)
        self._rivalry.step(now_ns)
        self._look_at_robot(now_ns)
        if self._coordinator.state in AT_BASE:  # requests are judged by what is known now
            self._coordinator.go(self._coordinator.base(now_ns), now_ns, "the robot's condition")
        if self._answer_requests(now_ns):
            self._loss.look(now_ns, 0)  # an owner that abandons is lost in this tick, not in the next
        self._move_on(now_ns)
        frames = self._collector.frames(now_ns, stops_only=is_late)
        remembered = self._to_remember()
        if not self._is_guard:  # nobody asks a guard for reasons, and it hears only what decides
            self._diagnosis.look(now_ns)
            self._preconditions.look(now_ns)
        snapshot = self._snapshot(now_ns, late_ns)
        notices, self._coordinator.notices = tuple(self._coordinator.notices), []
        replies, self._replies = tuple(self._replies), []
        return Output(
            frames=frames,
            replies=replies,
            notices=notices,
            snapshot=snapshot,
            remembered=remembered,
            done=self._phases.is_done(now_ns),
            claim=self._coordinator.claim.number,
        )

    def next_due_ns(self) -> int | None:
        """Return the next instant at which a stream is due [ns]; None when all are silent.

        Instants are multiples of the streams' periods, so a base grid of multiples of 10 ms shares its wake-ups with them.
        """
        return self._coordinator.body.next_due_ns()

    def panic_frames(self, now_ns: int) -> tuple[Cleared, ...]:
        """Return the stop frames that must leave when the engine itself has failed: 0.0 if owed, chassis zeros."""
        body = self._coordinator.body
        body.silence_arms()
        if body.heartbeat.is_owed:
            body.heartbeat.zeros(now_ns, is_estop=True)
        body.ground_stop(now_ns)
        return self._collector.frames(now_ns, stops_only=True)

    def _look_at_robot(self, now_ns: int) -> None:
        for _ in range(4):  # a trigger may lead to a state in which others matter
            state = self._coordinator.state
            for trigger, message in self._conditions.look(now_ns):
                self._coordinator.fire(trigger, now_ns, message)
                if self._coordinator.state is not state:
                    break
            else:
                return

    def _answer_requests(self, now_ns: int) -> bool:
        """Answer what was asked, stops first, and follow targets; return whether anything was asked."""
        commands, self._commands = self._commands, []
        commands.sort(key=lambda c: not isinstance(c.request, (Stop, Estop)))  # stable: stops first
        for command in commands:
            reply = self._answered.again(command)
            if reply is None:
                answer = self._handler.answer(command, now_ns)
                if isinstance(answer, Refusal):
                    self._refused[answer.code.value] = self._refused.get(answer.code.value, 0) + 1
                    reply = Reply(client_id=command.client_id, request_id=command.request_id, refusal=answer)
                else:
                    reply = Reply(client_id=command.client_id, request_id=command.request_id, facts=dict(answer))
                self._answered.keep(command, reply)
            self._replies.append(reply)
            if isinstance(
                command.request, Abandon
            ):  # lost now, though its next request may take the robot again at once
                self._loss.look(now_ns, 0)
        targets, self._targets = self._targets, {}
        for target in targets.values():
            self._handler.take_target(target, now_ns)
        return bool(commands)

    def _move_on(self, now_ns: int) -> None:
        coordinator = self._coordinator
        self._phases.step(now_ns)
        self._drives.step(now_ns)
        self._handler.move_on(now_ns)
        for side in coordinator.body.expire_targets(now_ns):
            text = f"no target came in time: the {side} arm brakes and holds"
            coordinator.notice(Code.TARGET_EXPIRED, Level.WARNING, text, now_ns, side=side.value)
        for stream in coordinator.body.targets.running:
            stream.limited = coordinator.body.arms[stream.side].reference.is_limited
        if coordinator.body.motions.running:
            coordinator.report_ended(coordinator.body.advance_motions(self._measured(now_ns), now_ns), now_ns)

    def _measured(self, now_ns: int) -> Mapping[Side, Vector | None]:
        coordinator = self._coordinator
        return {side: coordinator.measured(side) if coordinator.part_fresh(side, now_ns) else None for side in Side}

    # ------------------------------------------------------------------------------------------------ views out

    def _to_remember(self) -> Remembered | None:
        """Return what must reach the disk, when it has changed."""
        coordinator, saved = self._coordinator, self._saved
        latches = coordinator.endpoints.beside(coordinator.supervisor.latches)
        names = coordinator.others.friends, coordinator.routers
        if saved.epoch == coordinator.lease.epoch and saved.latches == latches and (saved.zids, saved.routers) == names:
            return None
        self._saved = coordinator.remembered()
        return self._saved

    def _snapshot(self, now_ns: int, late_ns: int) -> Snapshot | None:
        number = None if self._is_guard else self._pace.snapshot_due(now_ns, is_watched=self.is_watched)
        if number is None:
            return None
        why = self._diagnosis.findings, self._preconditions.refusals
        return build(self._coordinator, *why, self._pace.view(late_ns), number, now_ns, self._refused.copy())
