"""A motion as its commander sees it: number, progress, error, end. Shared by the blocking and the async handle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.client.asking.procedures import Procedure, cancel, result
from gateway.client.asking.requests import seconds
from gateway.client.asking.results import MotionResult
from gateway.client.connection.session import Lease, Motion, Session

__all__ = ["MotionRecord"]


class MotionRecord:
    """What is known of a motion; reading it sends nothing and never waits."""

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
        self._session.sighting()
        if self._motion.missing:
            return "unknown"
        return "queued" if self._motion.view is None else self._motion.view.state

    @property
    def done(self) -> bool:
        """Whether it has ended, however it did."""
        self._session.sighting()
        return self._motion.ended

    @property
    def progress(self) -> float:
        """Part of the path's duration that is behind us, 0..1."""
        self._session.sighting()
        return 0.0 if self._motion.view is None else self._motion.view.progress

    @property
    def error_rad(self) -> float | None:
        """Largest measured joint distance, or angle, to the goal [rad]; None when it is not known."""
        self._session.sighting()
        return None if self._motion.view is None else self._motion.view.error_rad

    @property
    def error_m(self) -> float | None:
        """Largest measured distance of an end effector to the goal [m]; None when it is not known, and for joints."""
        self._session.sighting()
        return None if self._motion.view is None else self._motion.view.error_m

    def __repr__(self) -> str:
        """Show number, state and progress."""
        return f"<motion {self.motion_id}: {self.state}, {self.progress:.0%}>"

    def _result(self, timeout: float) -> Procedure[MotionResult]:
        return result(self._session, self._motion, seconds("timeout", timeout))

    def _cancel(self, timeout: float) -> Procedure[None]:
        return cancel(self._session, self._lease, self._motion, seconds("timeout", timeout))
