"""Streams of the owner's targets: opened for one arm, fed at any rate, ended once.

Targets arrive in a latest-value slot. One is taken when its client, stream, epoch and sequence number are right and it
passes validation; it expires when no successor comes in time: the arm then brakes and holds, and the next target goes on.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from operator import attrgetter

from gateway.core.body.feeler import Feeler
from gateway.core.limits.pose_validation import check_pose
from gateway.core.limits.validation import check_goal
from gateway.core.messages.events import TargetArrived
from gateway.core.motion.poses.admittance import VirtualMass
from gateway.errors import Code, Refusal
from gateway.messages.incoming import OnLimit
from gateway.messages.snapshot import TargetView, TouchView
from gateway.settings.settings import ArmSettings, PoseSettings
from gateway.values import Side, Space, Vector

__all__ = ["TargetBook", "TargetStream"]

ENDED_KEPT = 8
"""So many ended streams stay visible."""


class TargetStream:
    """One stream's record."""

    def __init__(
        self,
        stream_id: int,
        side: Side,
        client_id: str,
        epoch: int,
        speed: float,
        on_limit: OnLimit,
        expiry_ns: int,
        space: Space = Space.JOINT,
    ) -> None:
        self.stream_id = stream_id
        self.side = side
        self.space = space
        self.client_id = client_id
        self.epoch = epoch
        self.speed = speed
        self.on_limit = on_limit
        self.expiry_ns = expiry_ns
        self.code: Code | None = None
        """Why it ended; None while open."""
        self.seq = 0
        self.mass: VirtualMass | None = None
        """What is followed where targets are its anchors; None where they are followed themselves."""
        self.received_ns: int | None = None
        """Arrival of the last accepted target [ns]; None when there is none or it has expired."""
        self.refused = 0
        self.refusal: Refusal | None = None
        self.limited = False
        self.feelers: Mapping[Side, Feeler] = {}
        """At what touch it ends, for its arm; empty for none."""
        self.touch: TouchView | None = None
        self.lead_ns: int | None = None
        """By how much the last target that is followed came before its first setpoint [ns]; None before there was one."""

    @property
    def is_open(self) -> bool:
        """Whether targets are taken."""
        return self.code is None

    def view(self) -> TargetView:
        """Return what the outside may see."""
        return TargetView(
            stream_id=self.stream_id,
            side=self.side.value,
            space=self.space.value,
            open=self.is_open,
            code=self.code.value if self.code else "",
            seq=self.seq,
            refused=self.refused,
            refusal_code=self.refusal.code.value if self.refusal else "",
            refusal_message=self.refusal.message if self.refusal else "",
            limited=self.limited,
            lead_ns=self.lead_ns,
            touch=self.touch,
        )


class TargetBook:
    """All streams of targets: at most one open per arm.

    Args:
        settings: Limits of joints and the default expiry.
        pose: The reach.
    """

    def __init__(self, settings: ArmSettings, pose: PoseSettings | None = None) -> None:
        self._settings = settings
        self._pose = pose or PoseSettings()
        self._next_id = 1
        self._open: list[TargetStream] = []
        self._ended: deque[TargetStream] = deque(maxlen=ENDED_KEPT)

    def renew(self, settings: ArmSettings) -> None:
        """Open streams by these from now on."""
        self._settings = settings

    def of(self, side: Side) -> TargetStream | None:
        """Return the open stream of an arm."""
        return next((s for s in self._open if s.side is side), None)

    def find(self, stream_id: int) -> TargetStream | None:
        """Return a stream that is open or still visible."""
        return next((s for s in (*self._open, *self._ended) if s.stream_id == stream_id), None)

    @property
    def running(self) -> tuple[TargetStream, ...]:
        """Open streams."""
        return tuple(self._open)

    def open(
        self,
        side: Side,
        client_id: str,
        epoch: int,
        speed: float,
        on_limit: OnLimit,
        expiry_ns: int | None,
        space: Space = Space.JOINT,
    ) -> TargetStream:
        """Record an opened stream; its arm must be free of others."""
        expiry = self._settings.target_expiry_ns if expiry_ns is None else expiry_ns
        stream = TargetStream(self._next_id, side, client_id, epoch, speed, on_limit, expiry, space)
        self._next_id += 1
        self._open.append(stream)
        return stream

    def end(self, stream: TargetStream, code: Code) -> None:
        """End an open stream; an ended one stays as it is."""
        if stream.is_open:
            stream.code = code
            stream.limited = False
            self._open.remove(stream)
            self._ended.append(stream)

    def accept(self, target: TargetArrived) -> tuple[TargetStream, Vector] | None:
        """Return the stream and the goal to follow, or None when the target is refused (the stream says why).

        Args:
            target: As it arrived; nothing about it is believed yet.
        """
        stream = self.find(target.stream_id)
        if stream is None or target.client_id != stream.client_id:
            return None  # nobody's stream, or not his: its owner must not be told of refusals that are not his own
        refusal = self._refusal(stream, target)
        if refusal is None:
            goal = self._goal(stream, target.values)
            if not isinstance(goal, Refusal):
                stream.seq, stream.received_ns = target.seq, target.received_ns
                return stream, goal
            refusal = goal
        stream.refused += 1
        stream.refusal = refusal
        return None

    def _goal(self, stream: TargetStream, values: Vector) -> Vector | Refusal:
        if stream.space is Space.POSE:
            goal = check_pose(stream.side, values, self._pose, stream.on_limit)
        else:
            goal = check_goal(stream.side, values, self._settings, stream.on_limit)
        return goal if isinstance(goal, Refusal) else goal.values

    def _refusal(self, stream: TargetStream, target: TargetArrived) -> Refusal | None:
        if not stream.is_open:
            return Refusal(code=Code.STREAM_ENDED, message=f"stream {stream.stream_id} ended with {stream.code}")
        if target.epoch != stream.epoch:
            return Refusal(
                code=Code.LEASE_STALE,
                message=f"stream {stream.stream_id} belongs to epoch {stream.epoch}, the target came with {target.epoch}",
                field="epoch",
                value=str(target.epoch),
                bound=str(stream.epoch),
            )
        if target.seq <= stream.seq:
            return Refusal(
                code=Code.BAD_REQUEST,
                message=f"target {target.seq} came after target {stream.seq}: an older one is never followed",
                field="seq",
                value=str(target.seq),
                bound=f"> {stream.seq}",
            )
        return None

    def expired(self, now_ns: int) -> list[TargetStream]:
        """Return the open streams whose last target has just expired; each is reported once."""
        late = [s for s in self._open if s.received_ns is not None and now_ns - s.received_ns > s.expiry_ns]
        for stream in late:
            stream.received_ns = None
        return late

    def views(self) -> tuple[TargetView, ...]:
        """Return open and lately ended streams, oldest first."""
        return tuple([s.view() for s in sorted((*self._ended, *self._open), key=attrgetter("stream_id"))])
