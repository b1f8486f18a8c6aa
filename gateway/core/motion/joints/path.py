"""Path: one arm's part of a planned motion: its state as a function of the path's own time.

A path begins at the exact state of a reference (which may be moving), is continuous in position, velocity and
acceleration from there on, and ends at rest. It may begin with a *lead*, in which each joint slows down on its own,
before ruckig's trajectory. `planner.py` sees to it that its setpoints are inside the position limits, and stoppable.
"""

from __future__ import annotations

from msgspec import Struct
from ruckig import Trajectory

from gateway.core.motion.joints.braking import REST, Slowing
from gateway.core.motion.space import State
from gateway.values import ARM_DOF, Vector

__all__ = ["Path"]


class Path(Struct, frozen=True, kw_only=True):
    """One arm's part of a plan. The trajectory is shared by all arms of it; each arm keeps its own time.

    Attributes:
        start: The state at time 0; only a reference in exactly this state may enter.
        lead: What comes before the trajectory; None when it begins at once.
        lead_s: Duration of the lead, the longest of all arms [s].
        trajectory: ruckig's plan from the end of the lead on.
        first: Index of this arm's first joint in it.
        duration_s: Time from the start to rest, the same for all arms [s].
        end_rad: Where this arm comes to rest [rad].
    """

    start: State
    lead: Slowing | None
    lead_s: float
    trajectory: Trajectory
    first: int
    duration_s: float
    end_rad: Vector

    @property
    def duration_ns(self) -> int:
        """Time from the start to rest [ns]."""
        return round(self.duration_s * 1e9)

    def at(self, time_s: float) -> State:
        """Return the state `time_s` after the start; exactly at rest from `duration_s` on."""
        if time_s >= self.duration_s:
            return State(self.end_rad, REST, REST)
        if self.lead is not None and time_s < self.lead_s:
            return self.lead.at(time_s)
        q_rad, dq_radps, ddq_radps2 = self.trajectory.at_time(time_s - self.lead_s)
        arm = slice(self.first, self.first + ARM_DOF)
        return State(tuple(q_rad[arm]), tuple(dq_radps[arm]), tuple(ddq_radps2[arm]))
