"""Faults on command: their grammar, how long they last, and what the ones on topics do to messages.

A fault is a JSON object: `{"fault": "freeze", "topic": "/left_arm/joint_states", "duration_s": 1.0}`. Without
`duration_s` it lasts until it is cleared. Unknown names, unknown or missing parameters and values of the wrong kind
are errors that list what is known. Everything is deterministic.

Three scopes: `topic` faults act here; `robot` faults are read by the model from the active ones; `node` faults are
about the process or the bridge and mean nothing to the pure model.
"""

from __future__ import annotations

import heapq
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from pycdr2 import IdlStruct

from cdr_types.messages import geometry_msgs, sensor_msgs
from gateway.sim.robot.manual import COMMAND_TOPICS, DOF, JOINT_STATE, POSE, STATE_TOPICS, S

__all__ = ["FAULTS", "DelayLine", "Fault", "FaultBook", "FaultError", "FaultKind", "parse_fault", "unknown_fault"]


class FaultError(ValueError):
    """A fault command that cannot be understood; the text lists what can."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultKind:
    """What a fault takes.

    Attributes:
        scope: `topic`, `robot` or `node`.
        required: Parameter -> the kinds of value it takes; `duration_s` [s] is always allowed beside.
        types: ROS types that a topic fault can act on; empty for any.
        on_commands: Whether a topic fault can act on command topics too.
        help: One line for the list of known faults.
    """

    scope: str
    required: Mapping[str, tuple[object, ...]] = field(default_factory=dict)
    types: tuple[str, ...] = ()
    on_commands: bool = False
    help: str = ""


_NUMBER: Final = ("a number",)
_TOPIC: Final = {"topic": ("a topic",)}
_SIDE: Final = {"side": ("left", "right")}

FAULTS: Final[Mapping[str, FaultKind]] = {
    "drop": FaultKind(scope="topic", required=_TOPIC, on_commands=True, help="nothing on this topic"),
    "freeze": FaultKind(scope="topic", required=_TOPIC, help="the same message again and again, old stamp included"),
    "delay": FaultKind(
        scope="topic", required={**_TOPIC, "delay_s": _NUMBER}, on_commands=True, help="every message this much later"
    ),
    "duplicate": FaultKind(scope="topic", required={**_TOPIC, "copies": _NUMBER}, help="every message this many times"),
    "reorder": FaultKind(
        scope="topic", required=_TOPIC, help="every second message comes before the first of its pair"
    ),
    "nan": FaultKind(scope="topic", required=_TOPIC, types=(JOINT_STATE, POSE), help="positions are NaN"),
    "short": FaultKind(scope="topic", required=_TOPIC, types=(JOINT_STATE,), help="the last joint is missing"),
    "wrong_names": FaultKind(scope="topic", required=_TOPIC, types=(JOINT_STATE,), help="names in reverse order"),
    "fsm_error": FaultKind(scope="robot", help="FSM in ERROR; cleared, it goes to PAUSE"),
    "pause": FaultKind(scope="robot", help="FSM to PAUSE; with duration_s, 1.0 does not end it sooner"),
    "fsm_value": FaultKind(scope="robot", required={"value": _NUMBER}, help="/fsm_state pinned to a value"),
    "vr_mode": FaultKind(scope="robot", help="VR mode: API commands but /api/fsm/enable are not taken"),
    "arm_disabled": FaultKind(scope="robot", required=_SIDE, help="the arm is switched off in the configuration"),
    "control_mode": FaultKind(scope="robot", required={**_SIDE, "mode": ("joint", "pose")}, help="other control mode"),
    "jump": FaultKind(
        scope="robot", required={**_SIDE, "joint": _NUMBER, "delta_rad": _NUMBER}, help="measured joint 1-7 is off"
    ),
    "joint_zero": FaultKind(
        scope="robot",
        required={**_SIDE, "joint": _NUMBER, "delta_rad": _NUMBER},
        help="joint 1-7 really is this far from the angle that it reports and takes: the end effector is elsewhere",
    ),
    "tight_limit": FaultKind(
        scope="robot",
        required={**_SIDE, "joint": _NUMBER, "margin_rad": _NUMBER},
        help="joint 1-7 of this robot is clipped this much inside both limits of the manual",
    ),
    "no_ik": FaultKind(scope="robot", required=_SIDE, help="the robot's IK finds no joint angles for any pose"),
    "blocked": FaultKind(scope="robot", required=_SIDE, help="something holds the arm: it does not follow"),
    "stuck": FaultKind(
        scope="robot",
        required={**_SIDE, "joint": _NUMBER},
        help="what is told of joint 1-7 stays, under fresh stamps; the joint follows, unless the arm is blocked too",
    ),
    "load": FaultKind(
        scope="robot",
        required={**_SIDE, "kg": _NUMBER},
        help="its hand holds so much between its pads; only with forces",
    ),
    "clock_step": FaultKind(scope="robot", required={"step_s": _NUMBER}, help="the robot's clock is off by this"),
    "clock_drift": FaultKind(
        scope="robot", required={"drift_ppm": _NUMBER}, help="the robot's clock runs fast by this; what it gained stays"
    ),
    "router_stop": FaultKind(scope="node", help="the router ends and listens again after duration_s (1 s)"),
    "frozen": FaultKind(scope="node", help="the whole process stands still for duration_s (1 s): a frozen link"),
    "route_dead": FaultKind(scope="node", required=_TOPIC, help="the bridge has lost its reader of a state topic"),
    "node_lost": FaultKind(scope="node", help="the robot's node is away: no tokens, no state, commands vanish"),
}
"""Every fault by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One understood fault.

    Attributes:
        name: Key of `FAULTS`.
        scope: Scope of its kind.
        topic: The topic it acts on; `*` for every state topic; empty for other scopes.
        side: Left or right; empty where it does not matter.
        mode: Control mode; empty where it does not matter.
        number: Its one figure: delay_s, copies, value, delta_rad, margin_rad, kg, step_s or drift_ppm.
        joint: Joint number from 1.
        duration_s: How long, None until cleared [s].
    """

    name: str
    scope: str
    topic: str = ""
    side: str = ""
    mode: str = ""
    number: float = 0.0
    joint: int = 0
    duration_s: float | None = None

    @property
    def details(self) -> str:
        """Its parameters in one line, for the log."""
        given = {"topic": self.topic, "side": self.side, "mode": self.mode, "joint": self.joint, "number": self.number}
        words = [f"{key} {value}" for key, value in given.items() if value]
        words.append("until cleared" if self.duration_s is None else f"for {self.duration_s} s")
        return ", ".join(words)

    def covers(self, topic: str) -> bool:
        """Return whether it acts on a topic."""
        return self.topic == topic or (self.topic == "*" and topic in STATE_TOPICS)


def unknown_fault(name: object) -> FaultError:
    """Return the error of a name that is none of `FAULTS`, not raised."""
    return FaultError(f"unknown fault {name!r}; known: {', '.join(FAULTS)}")


def _number(name: str, key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise FaultError(f"fault {name}: {key} must be a finite number, not {value!r}")
    return float(value)


def parse_fault(command: str | Mapping[str, object]) -> Fault:
    """Return the fault of a command in JSON or as a mapping.

    Raises:
        FaultError: If it is not one; the text says what is known.
    """
    if isinstance(command, str):
        try:
            command = json.loads(command)
        except json.JSONDecodeError as error:
            raise FaultError(f"not JSON: {error}") from error
    if not isinstance(command, Mapping):
        raise FaultError(f"a fault is an object with the key 'fault', not {command!r}")
    name = command.get("fault")
    kind = FAULTS.get(name) if isinstance(name, str) else None
    if not isinstance(name, str) or kind is None:
        raise unknown_fault(name)
    given = {key: value for key, value in command.items() if key != "fault"}
    allowed = {*kind.required, "duration_s"}
    if unknown := set(given) - allowed:
        raise FaultError(f"fault {name}: unknown parameter {sorted(unknown)}; it takes {sorted(allowed)}")
    if missing := set(kind.required) - set(given):
        raise FaultError(f"fault {name}: {sorted(missing)} missing")
    values: dict[str, object] = {"name": name, "scope": kind.scope}
    for key, value in given.items():
        takes = {**kind.required, "duration_s": _NUMBER}[key]
        if takes is _NUMBER:
            number = _number(name, key, value)
            values[key if key in ("joint", "duration_s") else "number"] = int(number) if key == "joint" else number
        elif key == "topic":
            values["topic"] = _topic(name, kind, value)
        elif value in takes:
            values[key] = value
        else:
            raise FaultError(f"fault {name}: {key} must be one of {', '.join(map(str, takes))}, not {value!r}")
    fault = Fault(**values)  # type: ignore[arg-type]  # each value was checked against its kind above
    if fault.duration_s is not None and fault.duration_s <= 0.0:
        raise FaultError(f"fault {name}: duration_s must be positive, not {fault.duration_s}")
    if "joint" in kind.required and not 1 <= fault.joint <= DOF:
        raise FaultError(f"fault {name}: joint must be 1 to {DOF}, not {fault.joint}")
    if name in ("delay", "duplicate", "tight_limit", "load") and fault.number <= 0.0:
        raise FaultError(f"fault {name}: its number must be positive, not {fault.number}")
    return fault


def _topic(name: str, kind: FaultKind, topic: object) -> str:
    """Return a topic that a fault can act on."""
    states = {key: value[0] for key, value in STATE_TOPICS.items()}
    types = {**states, **(COMMAND_TOPICS if kind.on_commands else {})}
    possible = [key for key, ros_type in types.items() if not kind.types or ros_type in kind.types]
    if not isinstance(topic, str) or (topic not in possible and (topic != "*" or kind.types)):
        raise FaultError(f"fault {name}: topic {topic!r} is not one of {', '.join(possible)} (or * for every state)")
    return topic


class FaultBook:
    """The faults that act now, and what they do to messages."""

    def __init__(self) -> None:
        self._active: list[tuple[Fault, int | None]] = []
        self._frozen: dict[str, IdlStruct] = {}
        self._held: dict[str, IdlStruct] = {}
        """First messages of pairs that come in the wrong order."""

    def add(self, fault: Fault, now_ns: int) -> None:
        """Let a fault act from now on."""
        until_ns = None if fault.duration_s is None else now_ns + round(fault.duration_s * S)
        self._active.append((fault, until_ns))

    def clear(self, name: str | None = None, topic: str | None = None) -> int:
        """End faults: all, those of a name, those on a topic; return how many."""
        kept = [
            (fault, until_ns)
            for fault, until_ns in self._active
            if (name is not None and fault.name != name) or (topic is not None and fault.topic != topic)
        ]
        ended = len(self._active) - len(kept)
        self._active = kept
        self._forget_frozen()
        return ended

    def expire(self, now_ns: int) -> bool:
        """End what has lasted long enough; return whether something ended."""
        kept = [(fault, until_ns) for fault, until_ns in self._active if until_ns is None or until_ns > now_ns]
        changed = len(kept) != len(self._active)
        if changed:
            self._active = kept
            self._forget_frozen()
        return changed

    def _forget_frozen(self) -> None:
        still = [fault for fault, _ in self._active if fault.name == "freeze"]
        self._frozen = {
            topic: message for topic, message in self._frozen.items() if any(fault.covers(topic) for fault in still)
        }
        self._held.clear()

    @property
    def is_empty(self) -> bool:
        """Whether no fault acts."""
        return not self._active

    @property
    def deadline_ns(self) -> int | None:
        """When the next fault ends by itself, if one does [ns]."""
        if not self._active:
            return None
        return min((until_ns for _, until_ns in self._active if until_ns is not None), default=None)

    def active(self, name: str | None = None) -> list[Fault]:
        """Return the acting faults, or those of a name."""
        return [fault for fault, _ in self._active if name is None or fault.name == name]

    def pass_through(self, topic: str, message: IdlStruct, now_ns: int) -> list[tuple[int, IdlStruct]]:
        """Return what becomes of a message: none, one or several, each with the time it goes out [ns]."""
        if not self._active:
            return [(now_ns, message)]
        due_ns, copies, after = now_ns, 1, None
        for fault, _ in self._active:
            if fault.scope != "topic" or not fault.covers(topic):
                continue
            if fault.name == "drop":
                return []
            if fault.name == "freeze":
                message = self._frozen.setdefault(topic, message)
            elif fault.name == "delay":
                due_ns += round(fault.number * S)
            elif fault.name == "duplicate":
                copies = max(1, int(fault.number))
            elif fault.name == "reorder":
                after = self._held.pop(topic, None)
                if after is None:
                    self._held[topic] = message
                    return []
            else:
                message = _corrupted(fault.name, message)
        return [(due_ns, message)] * copies + ([] if after is None else [(due_ns, after)])


class DelayLine:
    """Messages under way, in the order in which they are due."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, str, IdlStruct]] = []
        self._order = 0

    @property
    def next_ns(self) -> int | None:
        """When the first one is due [ns]."""
        return self._heap[0][0] if self._heap else None

    def push(self, due_ns: int, topic: str, message: IdlStruct) -> None:
        """Send a message on its way."""
        self._order += 1
        heapq.heappush(self._heap, (due_ns, self._order, topic, message))

    def pop_due(self, now_ns: int) -> list[tuple[str, IdlStruct]]:
        """Return and forget the messages that are due."""
        due = []
        while self._heap and self._heap[0][0] <= now_ns:
            _, _, topic, message = heapq.heappop(self._heap)
            due.append((topic, message))
        return due


def _corrupted(name: str, message: IdlStruct) -> IdlStruct:
    """Return a copy of a message with wrong content."""
    if isinstance(message, geometry_msgs.Pose):
        return replace(message, position=geometry_msgs.Point(x=math.nan, y=math.nan, z=math.nan))
    if not isinstance(message, sensor_msgs.JointState):
        return message
    if name == "nan":
        return replace(message, position=[math.nan] * len(message.position))
    if name == "wrong_names":
        return replace(message, name=message.name[::-1])
    return replace(
        message,
        name=message.name[:-1],
        position=message.position[:-1],
        velocity=message.velocity[:-1],
        effort=message.effort[:-1],
    )
