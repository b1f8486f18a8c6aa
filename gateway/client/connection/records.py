"""What a session keeps: a snapshot that was seen, a lease of ours, a motion of ours."""

from __future__ import annotations

from msgspec import Struct

from gateway.api import protocol

__all__ = ["Lease", "Motion", "Sighting"]


class Sighting(Struct, frozen=True):
    """A snapshot, when it arrived here [ns], and from which daemon."""

    view: protocol.Snapshot
    received_ns: int
    daemon: str


class Lease(Struct, frozen=True, kw_only=True):
    """That we own the robot.

    Attributes:
        epoch: Of the lease; every command carries it.
        daemon: Which daemon gave it.
        holding: Rises with each lease of this client: an earlier `with control()` is over although its epoch may live.
    """

    epoch: int
    daemon: str
    holding: int


class Motion(Struct):
    """A motion of ours: what the snapshots last said of it.

    Attributes:
        motion_id: Of the reply.
        daemon: Which one carries it out.
        after_seq: Snapshots up to this one may not know it yet.
        view: Last known state; None before the first.
        missing: A snapshot that must know it does not, or its daemon is gone: nothing more will be heard of it.
    """

    motion_id: int
    daemon: str
    after_seq: int
    view: protocol.MotionView | None = None
    missing: bool = False

    @property
    def ended(self) -> bool:
        """Whether it will not change any more."""
        return self.missing or (self.view is not None and self.view.state not in ("queued", "executing"))
