"""Collects the frames that are due, has the gate look at each, and reports what the gate refuses.

Arms come first in a tick, so that a heartbeat never overtakes the setpoint it belongs to. A frame that fails the last look
is a bug or a fault: nothing of that tick leaves but stop frames, and GATE_VIOLATION is latched.
"""

from __future__ import annotations

from msgspec import Struct

from gateway.core.messages.outputs import Frame, FrameKind, Notice, Remembered, Reply
from gateway.core.separation.slowing import Slowing
from gateway.core.separation.spacing import Spacing
from gateway.core.streams.gate import Cleared, Gate, GateContext
from gateway.core.streams.stream import Stream
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import Trigger
from gateway.errors import Refusal
from gateway.messages.snapshot import Snapshot
from gateway.values import Vector

__all__ = ["FrameCollector", "Output"]


class Output(Struct, frozen=True, kw_only=True):
    """What one tick gives.

    Attributes:
        frames: For the robot, in the order in which they must leave.
        replies: For clients.
        notices: For people and logs.
        snapshot: When one is due, else None.
        remembered: When it changed, else None: must reach the disk.
        done: True when the daemon may end.
        claim: Number of our claim to command the robot, for other gateways to see; 0 when nothing is claimed.
    """

    frames: tuple[Cleared, ...]
    replies: tuple[Reply, ...]
    notices: tuple[Notice, ...]
    snapshot: Snapshot | None
    remembered: Remembered | None
    done: bool
    claim: int = 0


class FrameCollector:
    """Where frames leave the engine.

    Args:
        coordinator: Streams, and what the gate must know.
        gate: The last look.
    """

    def __init__(self, coordinator: Coordinator, gate: Gate) -> None:
        self._coordinator = coordinator
        self._gate = gate
        self._spacing = Spacing(coordinator)
        self._slowing = Slowing(coordinator)

    def resume(self, topic: str, values: Vector, step: Vector) -> None:
        """Let a stream go on with the last frame of another process's: values, and its step from the one before."""
        self._gate.resume(topic, values, step)

    def frames(self, now_ns: int, *, stops_only: bool) -> tuple[Cleared, ...]:
        """Return the frames that are due and may leave, in the order in which they must."""
        if not stops_only:
            self._spacing.look(now_ns)
            self._slowing.look(now_ns)
        cleared: list[Cleared] = []
        context = self._context(now_ns)
        coordinator = self._coordinator
        # A drive begins when other gateways have seen that the robot is commanded; arms wait for that in ENABLING.
        waiting = (
            () if coordinator.claim.is_confirmed else tuple(g for g in coordinator.body.drives if not g.is_stopping)
        )
        for stream in self._coordinator.body.streams:
            if not stream.running:
                self._gate.forget(stream.topic)
                stream.log.end()
                continue
            if (stops_only and not self._is_stopping(stream)) or stream in waiting:
                continue
            frame = stream.frame(now_ns)
            if frame is None:
                continue
            if frame.kind is FrameKind.ECHO and (stream.log.last_ns is None or stream.log.is_anew):
                self._gate.forget(stream.topic)
            passed = self._gate.clear(frame, context)
            if isinstance(passed, Refusal):
                return self._violation(passed, frame, now_ns)
            stream.log.note(now_ns)
            cleared.append(passed)
        return tuple(cleared)

    def _is_stopping(self, stream: Stream) -> bool:
        body = self._coordinator.body
        is_ground_stop = any(stream is ground and ground.is_stopping for ground in body.drives)
        return is_ground_stop or (stream is body.heartbeat and body.heartbeat.is_ending)

    def _violation(self, refusal: Refusal, frame: Frame, now_ns: int) -> tuple[Cleared, ...]:
        """A frame failed the last look: nothing of this tick leaves but stop frames, and the fault is latched."""
        self._coordinator.fire(Trigger.GATE_VIOLATION, now_ns, f"{frame.topic}: {refusal.message}")
        self._coordinator.body.ground_stop(now_ns)
        return self.frames(now_ns, stops_only=True)

    def _context(self, now_ns: int) -> GateContext:
        coordinator = self._coordinator
        return GateContext(
            state=coordinator.state,  # a state is its name
            epoch=coordinator.lease.valid_epoch,
            fresh=coordinator.transport_up and coordinator.store.is_fresh(now_ns),
            stale_hold=coordinator.stale_hold,
            resuming=coordinator.resuming,
            latched=bool(coordinator.supervisor.latches),
        )
