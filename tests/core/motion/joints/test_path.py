"""Paths as functions of their own time: leads, trajectories, ends."""

from __future__ import annotations

import pytest
from ruckig import InputParameter, Ruckig, Trajectory

from gateway.core.motion.joints.braking import REST, Braking, JointLimits
from gateway.core.motion.joints.path import Path
from gateway.core.motion.space import State

LIMITS = JointLimits(
    v_radps=1.0,
    a_radps2=3.0,
    j_radps3=20.0,
    lower_rad=(-1.8, 0.0, -2.6, 0.25, -1.8, -1.4, -0.7),
    upper_rad=(1.8, 1.9, 1.3, 2.2, 1.8, 1.4, 0.7),
)
BRAKING = Braking(LIMITS, 0.01)
HOME = (0.41, 1.16, -0.47, 0.90, 0.23, -0.15, 0.60)
MOVING = State(HOME, (0.8, -0.8, 0.2, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0))
RESTING = State(HOME, REST, REST)


# -------------------------------------------------------------------------------------------------------- paths


def trajectory_to(start_rad, goal_rad) -> Trajectory:
    """From rest to rest, for two arms: the other one stays."""
    entry, trajectory = InputParameter(14), Trajectory(14)
    entry.current_position, entry.target_position = [0.0] * 7 + list(start_rad), [0.0] * 7 + list(goal_rad)
    entry.max_velocity, entry.max_acceleration, entry.max_jerk = [1.0] * 14, [3.0] * 14, [20.0] * 14
    Ruckig(14).calculate(entry, trajectory)
    return trajectory


def test_a_path_is_its_arms_part_of_the_trajectory_and_ends_at_rest():
    """The second arm of a plan reads joints 8 to 14, and from the duration on exactly its end."""
    goal = (0.0, 1.0, 0.0, 0.5, 0.0, 0.0, 0.0)
    trajectory = trajectory_to(HOME, goal)
    path = Path(
        start=RESTING,
        lead=None,
        lead_s=0.0,
        trajectory=trajectory,
        first=7,
        duration_s=trajectory.duration,
        end_rad=goal,
    )
    assert path.duration_ns == round(trajectory.duration * 1e9)
    assert path.at(0.0) == (HOME, REST, REST)
    assert path.at(0.3) == tuple(tuple(column[7:]) for column in trajectory.at_time(0.3))
    assert path.at(trajectory.duration) == (goal, REST, REST)
    assert path.at(trajectory.duration + 5.0) == (goal, REST, REST)


def test_a_lead_comes_before_the_trajectory_and_joins_it():
    """Until `lead_s` the joints slow down; then the trajectory begins where they are."""
    stop = BRAKING.halt(MOVING)
    rest_rad = stop.at(stop.duration_s)[0]
    trajectory = trajectory_to(rest_rad, HOME)
    lead_s = stop.duration_s + 0.1  # the other arm needs longer
    duration_s = lead_s + trajectory.duration
    path = Path(
        start=MOVING, lead=stop, lead_s=lead_s, trajectory=trajectory, first=7, duration_s=duration_s, end_rad=HOME
    )
    assert path.at(0.1) == stop.at(0.1)
    assert path.at(lead_s - 1e-9)[0] == pytest.approx(path.at(lead_s)[0], abs=1e-12)
    assert path.at(lead_s) == (rest_rad, REST, REST)
    assert path.at(duration_s) == (HOME, REST, REST)
