"""Why the robot does not do what it is told, inferred: the robot itself gives no reasons (manual §4.10, §4.12).

    what is sent, what is measured, how old each topic is  ->  symptoms  ->  findings, each with code, words and numbers

Rules
    * It reads and never acts: findings change nothing. What acts on a condition is `conditions.py`.
    * Ten times a second for arms, five times for the rest, not on every tick: symptoms last, and the loop has better
      things to do.
    * A finding stands as long as its symptom does, and says since when. People hear of it once.
    * No alarm in nominal use: what may be lag, noise, the start of a link or a part that is switched off is none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from msgspec import Struct, field

from gateway.codes import Code
from gateway.core.messages.outputs import Level
from gateway.core.robot_state.following import JOINT_GRAIN, POSE_GRAIN, Following, Stall
from gateway.core.streams.heartbeat import Beat
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import State
from gateway.errors import CODES
from gateway.messages.snapshot import Finding, SlowingView
from gateway.robot.topics import (
    ARM_JOINTS,
    CHASSIS_STATE,
    FSM_ENABLE,
    MOTION_STATE_TOPICS,
    STATE_TOPICS,
    TOPICS,
    pose_command,
)
from gateway.values import FsmState, Side, Space, Vector

__all__ = ["PERIOD_NS", "Diagnosis", "Finding"]

MS = 1_000_000
S = 1_000_000_000

PERIOD_NS = 100 * MS
"""Looked this often [ns]; what is no arm's every other time."""
SILENT_NS = {topic: max(300 * MS, int(2.05 * S / TOPICS[topic].rate_hz)) for topic in STATE_TOPICS}
"""A topic without a believed sample for longer is silent [ns]."""
FIRST_NS = 3 * S
"""A fresh link gets this long to deliver a topic's first sample [ns]."""
HEARTBEAT_NS = 700 * MS
"""1.0 that the FSM has not answered for longer than this does nothing [ns]: it answers within a period of 50 ms."""
REMEMBER_NS = 60 * S
"""Why the last enabling found no answer is told this long, while nothing else has happened [ns]."""
ROUTE_NS = 500 * MS
"""A route must be said to be bad for this long [ns]: while it is looked into, it may seem so."""
LATE = 1 / 3
"""A gap of more than this part of the robot's watchdog, and of three periods, is late."""
SLOWED = 0.9
"""Poses are told to be followed slower below this part of the speed limits."""
QUIET_AGAIN_NS = 10 * S
"""The same finding is told again only after this long [ns]."""

POSES = frozenset(map(pose_command, Side))
MOVING = frozenset({State.ACTIVE, State.HOLDING, State.STOPPING})
"""States in which the robot follows setpoints."""
BAD_ROUTES = ("not announced", "inactive", "no match", "route dead")
"""How discovery begins when it knows that a route does not work."""
TOLD_ELSEWHERE = frozenset(
    {
        Code.MODE_VR,
        Code.ARM_DISABLED,
        Code.HEARTBEAT_NOT_EFFECTIVE,
        Code.FOREIGN_WRITER,
        Code.OTHER_GATEWAY,
        Code.OTHER_NAMESPACE,
        Code.TWO_ROBOTS,
    }
)
"""Findings that come with a notice of their own already."""


class _Symptom(Struct, frozen=True):
    """What is seen now.

    Attributes:
        code: What it means.
        subject: Arm or topic; one finding for each.
        message: One sentence.
        since_ns: When it began, as far as it can be seen [ns]; None: now.
        facts: Numbers, with units in their names.
    """

    code: Code
    subject: str
    message: str
    since_ns: int | None = None
    facts: Mapping[str, float] = field(default_factory=dict)


class Diagnosis:
    """Looks for symptoms."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator
        self._looked_ns: int | None = None
        self._following = {
            side: {Space.JOINT: Following(JOINT_GRAIN), Space.POSE: Following(POSE_GRAIN)} for side in Side
        }
        self._since_ns: dict[tuple[Code, str], int] = {}
        self._told_ns: dict[tuple[Code, str], int] = {}
        self._up_ns: int | None = None
        self._beating_ns: int | None = None
        self._unanswered: tuple[int, int, int] | None = None  # attempt, since, until
        self._bad_route_ns: int | None = None
        self._of_modes: list[_Symptom] = []
        self._of_silence: list[_Symptom] = []
        self.findings: tuple[Finding, ...] = ()
        """What stands now, worst guess first."""

    def look(self, now_ns: int) -> bool:
        """Look for symptoms when it is time; return whether it was."""
        if self._looked_ns is not None and now_ns // PERIOD_NS == self._looked_ns // PERIOD_NS:
            return False
        is_late = self._looked_ns is not None and now_ns - self._looked_ns > 2 * PERIOD_NS
        self._looked_ns = now_ns
        self._up_ns = (now_ns if self._up_ns is None else self._up_ns) if self._coordinator.transport_up else None
        symptoms = self._symptoms(now_ns, is_late=is_late)
        if not symptoms:
            self._since_ns, self.findings = {}, ()
            return True
        seen = {(symptom.code, symptom.subject): symptom for symptom in symptoms}
        self._since_ns = {
            key: self._since_ns.get(key, now_ns if symptom.since_ns is None else symptom.since_ns)
            for key, symptom in seen.items()
        }
        self.findings = tuple(
            [
                Finding(
                    code=code.value,
                    message=symptom.message,
                    hint=CODES[code].hint,
                    since_ns=self._since_ns[code, subject],
                    facts=dict(symptom.facts),
                )
                for (code, subject), symptom in seen.items()
            ]
        )
        self._tell(seen, now_ns)
        return True

    def _tell(self, seen: Mapping[tuple[Code, str], _Symptom], now_ns: int) -> None:
        for key, symptom in seen.items():
            told_ns = self._told_ns.get(key)
            is_new = told_ns is None or self._since_ns[key] - told_ns > QUIET_AGAIN_NS
            if is_new and symptom.code not in TOLD_ELSEWHERE:
                self._told_ns[key] = now_ns
                self._coordinator.notice(symptom.code, Level.WARNING, symptom.message, now_ns, subject=symptom.subject)

    def _symptoms(self, now_ns: int, *, is_late: bool) -> list[_Symptom]:
        """Return what is seen, causes before effects.

        Arms are looked at each time, of the rest one half in turn. A look that comes late says nothing about ages: ours
        are old.
        """
        if self._up_ns is None:
            self._of_modes, self._of_silence = [], []
            for following in self._following.values():
                for each in following.values():
                    each.forget()
            return []
        if now_ns // PERIOD_NS % 2:
            self._of_modes = [
                *self._others(now_ns),
                *self._mode(now_ns),
                *self._route(now_ns),
                *self._heartbeat(now_ns),
                *self._late(now_ns),
                *self._model(now_ns),
            ]
        elif not is_late:
            self._of_silence = list(self._silent(self._up_ns, now_ns))
        return [*self._of_modes, *self._of_silence, *(symptom for side in Side for symptom in self._arm(side, now_ns))]

    # ------------------------------------------------------------------------------------------------ others, modes

    def _others(self, now_ns: int) -> Iterator[_Symptom]:
        """Whoever else commands the robot, which obeys all of them in turn; under either policy, latched or not."""
        others, other = self._coordinator.others, self._coordinator.other_robot
        if other is not None and other.code is Code.TWO_ROBOTS:
            yield _Symptom(Code.TWO_ROBOTS, "", other.message)
        if others.is_alone:
            return
        for each in others.commanders(now_ns):
            text = f"{each.text}; the robot obeys everybody in turn (manual §3.3.2)"
            yield _Symptom(each.code, each.who, text, each.since_ns, {"samples": each.count} if each.count else {})

    def _mode(self, now_ns: int) -> Iterator[_Symptom]:
        mode = self._coordinator.store.mode(now_ns)
        if mode is None:
            return
        if not mode.api:
            yield _Symptom(Code.MODE_VR, "", "the robot is in VR mode and takes no API commands (manual §3.1.1)")
            return
        for side in Side:
            if not mode.arm_enabled[side]:
                yield _Symptom(
                    Code.ARM_DISABLED,
                    f"{side}_arm",
                    f"the {side} arm is disabled in the robot's system configuration: it takes no commands (manual §2.3)",
                )

    # ------------------------------------------------------------------------------------------------ ways in and out

    def _silent(self, up_ns: int, now_ns: int) -> Iterator[_Symptom]:
        """Topics of which nothing is believed any more while the link stands."""
        silent = {topic: silent_ns for topic in STATE_TOPICS if (silent_ns := self._silence_ns(topic, up_ns, now_ns))}
        why_not = self._coordinator.store.why_not_believed
        refused = {topic: why for topic in silent if (why := why_not(topic, SILENT_NS[topic], now_ns))}
        for topic, why in refused.items():
            text = f"{topic} comes, and no sample of it is believed: {why}"
            facts = {"silent_s": silent[topic] / S}
            yield _Symptom(Code.SAMPLE_REFUSED, topic, text, now_ns - silent[topic], facts)
        unheard = [topic for topic in silent if topic not in refused]
        if set(MOTION_STATE_TOPICS) <= set(unheard):
            silent_ns = min(silent[topic] for topic in MOTION_STATE_TOPICS)
            other = self._coordinator.other_robot
            if other is not None and other.code is Code.OTHER_NAMESPACE:
                yield _Symptom(Code.OTHER_NAMESPACE, "", other.message, now_ns - silent_ns)
                return
            text = "none of the robot's fast state topics comes while the link to its router stands"
            yield _Symptom(Code.ROUTE_SUSPECT, "", text, now_ns - silent_ns, {"silent_s": silent_ns / S})
            return
        never = [topic for topic in unheard if silent[topic] == now_ns - up_ns]
        if never:
            text = f"not heard since the link to the robot's router stands: {', '.join(never)}"
            yield _Symptom(Code.ROUTE_SUSPECT, "never", text, up_ns, {"silent_s": (now_ns - up_ns) / S})
        for topic in [topic for topic in unheard if topic not in never]:
            route = self._coordinator.routes.get(topic, "")
            text = f"{topic} is silent while the link to the robot's router stands{f' ({route})' if route else ''}"
            facts = {"silent_s": silent[topic] / S}
            yield _Symptom(Code.ROUTE_SUSPECT, topic, text, now_ns - silent[topic], facts)

    def _silence_ns(self, topic: str, up_ns: int, now_ns: int) -> int:
        """Return for how long nothing of a topic was believed; 0 when that is not long, or its part is switched off."""
        age_ns = self._coordinator.store.age_ns(topic, now_ns)
        if age_ns is None or now_ns - age_ns < up_ns:
            silent_ns, limit_ns = now_ns - up_ns, FIRST_NS
        else:
            silent_ns, limit_ns = age_ns, SILENT_NS[topic]
        return silent_ns if silent_ns > limit_ns and self._counts(topic, now_ns) else 0

    def _counts(self, topic: str, now_ns: int) -> bool:
        """Return whether a topic's part is switched on: what is off may be silent."""
        mode = self._coordinator.store.mode(now_ns)
        if mode is None:
            return True
        if topic == CHASSIS_STATE:
            return mode.chassis_enabled
        return all(mode.arm_enabled[side] for side in Side if topic.startswith(f"/{side}_"))

    def _route(self, now_ns: int) -> Iterator[_Symptom]:
        """What discovery says about the way of our heartbeat."""
        route = self._coordinator.routes.get(FSM_ENABLE, "")
        if not route.startswith(BAD_ROUTES):
            self._bad_route_ns = None
            return
        if self._bad_route_ns is None:
            self._bad_route_ns = now_ns
        if now_ns - self._bad_route_ns >= ROUTE_NS:
            text = f"{FSM_ENABLE} does not reach the robot's state machine: {route}"
            yield _Symptom(Code.ROUTE_SUSPECT, FSM_ENABLE, text, self._bad_route_ns)

    def _heartbeat(self, now_ns: int) -> Iterator[_Symptom]:
        """1.0 that the state machine does not answer; after a failed enabling, until something else happens."""
        coordinator = self._coordinator
        attempt, is_paused = coordinator.enable.attempt, coordinator.store.fsm(now_ns) == FsmState.PAUSE
        if coordinator.body.heartbeat.beat is not Beat.ONE:
            self._beating_ns = None
        elif self._beating_ns is None:
            self._beating_ns = now_ns
        if not is_paused:
            self._unanswered = None
        elif self._beating_ns is not None and now_ns - self._beating_ns > HEARTBEAT_NS:
            self._unanswered = attempt, self._beating_ns, now_ns
        if self._unanswered is None:
            return
        of_attempt, since_ns, until_ns = self._unanswered
        if of_attempt != attempt or now_ns - until_ns > REMEMBER_NS:
            self._unanswered = None
            return
        beats_s = (until_ns - since_ns) / S
        route = coordinator.routes.get(FSM_ENABLE, "nothing is known of its route")
        text = f"1.0 was sent to {FSM_ENABLE} for {beats_s:.1f} s and the FSM stayed PAUSE (manual §4.7); {route}"
        yield _Symptom(Code.HEARTBEAT_NOT_EFFECTIVE, "", text, since_ns, {"beats_s": beats_s})

    def _late(self, now_ns: int) -> Iterator[_Symptom]:
        """Gaps in our own streams, told as long as the streams' figures show them."""
        for stream in self._coordinator.body.streams:
            worst = stream.log.worst_gap(now_ns)
            row = TOPICS[stream.topic]
            if worst is None or row.watchdog_ns is None:
                continue
            at_ns, gap_ns = worst
            bound_ns = max(LATE * row.watchdog_ns, 3 * S / row.rate_hz)
            if gap_ns > bound_ns:
                section = "§4.3, of joint commands" if stream.topic in POSES else row.section
                text = (
                    f"nothing was sent to {stream.topic} for {gap_ns / MS:.0f} ms by this host: more than "
                    f"{bound_ns / MS:.0f} ms is late, {row.watchdog_ns / MS:.0f} ms ends the robot's patience "
                    f"(manual {section})"
                )
                facts = {"gap_ms": gap_ns / MS, "bound_ms": bound_ns / MS, "watchdog_ms": row.watchdog_ns / MS}
                yield _Symptom(Code.STREAM_LATE, stream.topic, text, at_ns - gap_ns, facts)

    def _model(self, now_ns: int) -> Iterator[_Symptom]:
        """Arms whose poses are not those of the model: what would move them by it is off."""
        model = self._coordinator.model
        if model is None:
            return
        for side in Side:
            verdict = model.verdict(side, now_ns)
            if verdict.is_differing:
                text = f"the {side} arm is not as modelled, and is not moved by the model: {verdict.reason}"
                facts = {"position_m": verdict.position_m or 0.0, "angle_rad": verdict.angle_rad or 0.0}
                yield _Symptom(Code.MODEL_DIFFERS, f"{side}_arm", text, facts=facts)

    # ------------------------------------------------------------------------------------------------ arms

    def _arm(self, side: Side, now_ns: int) -> Iterator[_Symptom]:
        slowing = self._coordinator.body.slowing.get(side)
        if slowing is not None and slowing.held and slowing.speed_ratio < SLOWED:
            yield _near_singularity(side, slowing)
        coordinator, following = self._coordinator, self._following[side]
        arm, measured = coordinator.body.arms[side], coordinator.measured(side)
        is_driven = arm.running and coordinator.state in MOVING
        if not is_driven or measured is None or not coordinator.part_fresh(side, now_ns):
            for each in following.values():
                each.forget()
        elif arm.space is Space.JOINT:
            stall = following[arm.space].look(arm.values, measured, now_ns)
            if stall is not None:
                yield _stalled_joints(side, stall)
        else:
            measured = _same_sign(arm.values, measured)
            stall = following[arm.space].look(arm.values, measured, now_ns)
            if stall is not None:
                yield _refused_pose(side, arm.values, measured, stall)


def _near_singularity(side: Side, slowing: SlowingView) -> _Symptom:
    name = ARM_JOINTS[side][slowing.joint - 1]
    text = (
        f"poses of the {side} arm are followed at {slowing.speed_ratio:.0%} of the speed limits: at all of it joint "
        f"{slowing.joint} ({name}) would have to go {slowing.joint_radps:.1f} rad/s, up to {slowing.bound_radps:g} is allowed"
    )
    facts = {"speed_ratio": slowing.speed_ratio, "joint": slowing.joint, "joint_radps": slowing.joint_radps}
    return _Symptom(Code.SINGULARITY_NEAR, f"{side}_arm", text, facts=facts)


def _stalled_joints(side: Side, stall: Stall) -> _Symptom:
    joint, name = stall.worst + 1, ARM_JOINTS[side][stall.worst]
    where = (
        f"{side} arm joint {joint} ({name}) stays at {stall.measured:.3f} rad, its setpoint is {stall.setpoint:.3f} rad"
    )
    facts = {"joint": joint, "setpoint_rad": stall.setpoint, "measured_rad": stall.measured, "off_rad": stall.off}
    if stall.others_follow:
        why = "the robot clips it there (manual §4.10), something holds it, or what is told of it is old (manual §4.8)"
        text = f"{where}, and the other joints follow: {why}"
        return _Symptom(Code.CLIPPED_BY_ROBOT, f"{side}_arm", text, stall.since_ns, facts)
    text = f"{where}: the setpoints moved and the arm did not, or what is told of it is old (manual §4.8)"
    return _Symptom(Code.TRACKING_STALL, f"{side}_arm", text, stall.since_ns, facts)


def _same_sign(setpoint: Vector, measured: Vector) -> Vector:
    """Return a measured pose with its quaternion on the setpoint's hemisphere: the other one is the same orientation."""
    if sum(a * b for a, b in zip(setpoint[3:], measured[3:], strict=True)) >= 0.0:
        return measured
    return (*measured[:3], *(-part for part in measured[3:]))


def _refused_pose(side: Side, setpoint: Vector, measured: Vector, stall: Stall) -> _Symptom:
    off_m = math.dist(setpoint[:3], measured[:3])
    cosine = sum(a * b for a, b in zip(setpoint[3:], measured[3:], strict=True))
    off_rad = 2.0 * math.acos(min(1.0, cosine))
    text = (
        f"the {side} end effector stays {off_m:.3f} m and {off_rad:.3f} rad from its setpoint, which moved: the robot's IK "
        "refuses such a pose without a word (manual §4.10), or something holds the arm"
    )
    return _Symptom(Code.IK_REFUSED, f"{side}_arm", text, stall.since_ns, {"off_m": off_m, "off_rad": off_rad})
