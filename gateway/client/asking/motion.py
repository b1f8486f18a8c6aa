"""A motion as its commander sees it: number, progress, error, end. Shared by the blocking and the async handle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.api import protocol
from gateway.client.asking.procedures import Procedure, cancel, result
from gateway.client.asking.requests import seconds
from gateway.client.asking.results import MotionResult
from gateway.client.connection.session import Lease, Motion, Session
from gateway.errors import GatewayError

__all__ = ["MotionRecord"]


class MotionRecord:
    """What is known of a motion; reading it sends nothing and never waits.

    Raises:
        Disconnected: The daemon is gone, and nobody knows how far the motion came.
    """

    def __init__(self, session: Session, lease: Lease, motion: Motion, facts: Mapping[str, Any]) -> None:
        self._session = session
        self._lease = lease
        self._motion = motion
        self._facts = facts

    @property
    def motion_id(self) -> int:
        """Number of the motion; unique for this daemon."""
        return self._motion.motion_id

    @property
    def clipped(self) -> tuple[str, ...]:
        """Joints that were clipped to a limit, e.g. `left_arm[3]`; empty unless `on_limit="clip"`."""
        sides: Mapping[str, list[int]] = self._facts.get("clipped") or {}
        return tuple(f"{side}_arm[{joint}]" for side, joints in sides.items() for joint in joints)

    @property
    def begins(self) -> float | None:
        """When the first point of a chunk is passed, as `time.monotonic()` of the daemon's host [s]; None for others."""
        begins_ns = self._facts.get("begins_ns")
        return None if begins_ns is None else int(begins_ns) / 1e9

    @property
    def skipped(self) -> int:
        """Points of a chunk that were left out because their time had passed when it arrived."""
        return int(self._facts.get("skipped") or 0)

    @property
    def moved(self) -> float:
        """How far smoothing moved a number of a chunk at most [rad, m]."""
        return float(self._facts.get("moved") or 0.0)

    @property
    def goal(self) -> Mapping[str, tuple[float, ...]]:
        """Where it really goes: per side seven joints [rad], or x, y, z [m], qx, qy, qz, qw; after clipping and offsets."""
        goals: Mapping[str, list[float]] = self._facts.get("q_rad") or self._facts.get("values") or {}
        return {side: tuple(values) for side, values in goals.items()}

    @property
    def state(self) -> str:
        """`queued`, `executing`, `reached`, `touched`, `cancelled`, `superseded`, `aborted`, or `unknown` (not listed)."""
        view = self._seen()
        if self._motion.missing:
            return "unknown"
        return "queued" if view is None else view.state

    @property
    def done(self) -> bool:
        """Whether it has ended, however it did."""
        self._seen()
        return self._motion.ended

    @property
    def progress(self) -> float:
        """Part of the path's duration that is behind us, 0..1."""
        view = self._seen()
        return 0.0 if view is None else view.progress

    @property
    def error_rad(self) -> float | None:
        """Largest measured joint distance, or angle, to the goal [rad]; None when it is not known."""
        view = self._seen()
        return None if view is None else view.error_rad

    @property
    def error_m(self) -> float | None:
        """Largest measured distance of an end effector to the goal [m]; None when it is not known, and for joints."""
        view = self._seen()
        return None if view is None else view.error_m

    def __repr__(self) -> str:
        """Show number, state and progress."""
        try:
            return f"<motion {self.motion_id}: {self.state}, {self.progress:.0%}>"
        except GatewayError as error:
            return f"<motion {self.motion_id}: {error.code}>"

    def _seen(self) -> protocol.MotionView | None:
        """Look at the newest snapshot, and return what it says; None before the first that may."""
        self._session.sighting()
        if not self._motion.ended:
            self._session.require_daemon(self._motion.daemon)
        return self._motion.view

    def _result(self, timeout: float) -> Procedure[MotionResult]:
        return result(self._session, self._motion, seconds("timeout", timeout))

    def _cancel(self, timeout: float) -> Procedure[None]:
        return cancel(self._session, self._lease, self._motion, seconds("timeout", timeout))
