"""What one may ask a running simulation over its control channel: JSON objects in, JSON objects out.

| request | answer |
|---|---|
| `{"do": "ping"}` | which robot this is and which commands it takes |
| `{"do": "stats"}` | what the robot saw of its users (`report.stats`) |
| `{"do": "reset_stats"}` | these figures start anew |
| `{"do": "state"}` | the robot's true state (`report.state`) |
| `{"do": "world"}` | where everything of the scene is, for who draws it (physics only) |
| `{"do": "log", "since": 0}` | entries of the robot's own log with a larger number |
| `{"do": "fault", "fault": "freeze", ...}` | a fault begins (grammar in `faults`) |
| `{"do": "faults"}` | the known faults and the acting ones |
| `{"do": "clear", "fault": ..., "topic": ...}` | all faults end, or those of a name or topic |
| `{"do": "shutdown"}` | the node ends orderly |

Every answer has `"ok"`; a request that is not understood gets `false` and an `"error"` that says what is known.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Protocol

from gateway.sim.robot import report
from gateway.sim.robot.faults import FAULTS, Fault, FaultError, parse_fault, unknown_fault
from gateway.sim.robot.model import SimRobot

__all__ = ["Control", "NodeFaults"]

Answer = dict[str, object]


class NodeFaults(Protocol):
    """Who has the faults of scope `node`, and the power to end."""

    def begin(self, fault: Fault, now_ns: int) -> None:
        """Let a node fault act."""

    def clear(self, name: str | None, topic: str | None) -> int:
        """End node faults; return how many ended."""

    def shut_down(self) -> None:
        """End the node."""


class Control:
    """Understands requests and carries them out on the robot and its node."""

    def __init__(self, robot: SimRobot, node: NodeFaults) -> None:
        self._robot, self._node = robot, node
        self._requests: dict[str, Callable[[Mapping[str, object], int], Answer]] = {
            "ping": self._ping,
            "stats": self._stats,
            "reset_stats": self._reset_stats,
            "state": self._state,
            "world": self._world,
            "log": self._log,
            "fault": self._fault,
            "faults": self._faults,
            "clear": self._clear,
            "shutdown": self._shutdown,
        }

    def answer(self, text: str, now_ns: int) -> str:
        """Return the answer to a request."""
        try:
            request = json.loads(text)
            wanted = self._requests.get(str(request.get("do"))) if isinstance(request, dict) else None
            if wanted is None:
                raise FaultError(f"unknown request {text[:200]!r}; 'do' is one of {', '.join(self._requests)}")
            return json.dumps({"ok": True, **wanted(request, now_ns)})
        except (ValueError, TypeError) as error:  # FaultError and JSONDecodeError are ValueErrors
            return json.dumps({"ok": False, "error": str(error)})

    def _ping(self, _: Mapping[str, object], now_ns: int) -> Answer:
        return {"now_ns": now_ns, "model": self._robot.settings.model, "commands": self._robot.commands}

    def _stats(self, _: Mapping[str, object], __: int) -> Answer:
        return report.stats(self._robot)

    def _reset_stats(self, _: Mapping[str, object], __: int) -> Answer:
        self._robot.reset_stats()
        return {}

    def _state(self, _: Mapping[str, object], __: int) -> Answer:
        return report.state(self._robot)

    def _world(self, _: Mapping[str, object], __: int) -> Answer:
        positions = self._robot.dynamics.positions()
        if positions is None:
            raise FaultError("world: this robot has no scene; start one with --physics mujoco")
        return {"positions": positions}

    def _log(self, request: Mapping[str, object], _: int) -> Answer:
        since = request.get("since", 0)
        if not isinstance(since, int):
            raise FaultError(f"log: since must be a whole number, not {since!r}")
        return {"entries": [asdict(entry) for entry in self._robot.journal.since(since)]}

    def _faults(self, _: Mapping[str, object], __: int) -> Answer:
        known = {name: {"takes": list(kind.required), "help": kind.help} for name, kind in FAULTS.items()}
        return {"known": known, "active": [fault.name for fault in self._robot.faults.active()]}

    def _fault(self, request: Mapping[str, object], now_ns: int) -> Answer:
        fault = parse_fault({key: value for key, value in request.items() if key != "do"})
        if fault.scope == "node":
            self._node.begin(fault, now_ns)
        else:
            self._robot.inject(fault, now_ns)
        return {"fault": fault.name}

    def _clear(self, request: Mapping[str, object], _: int) -> Answer:
        name, topic = request.get("fault"), request.get("topic")
        if not (isinstance(name, (str, type(None))) and isinstance(topic, (str, type(None)))):
            raise FaultError(f"clear: fault and topic must be texts, not {name!r}, {topic!r}")
        if name is not None and name not in FAULTS:
            raise unknown_fault(name)
        return {"ended": self._robot.clear(name, topic) + self._node.clear(name, topic)}

    def _shutdown(self, _: Mapping[str, object], __: int) -> Answer:
        self._node.shut_down()
        return {}
