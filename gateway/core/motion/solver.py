"""Solver: one calculation of ruckig, with what it needs to find the plans that exist.

ruckig 0.19.4 finds none where the shape of a profile is on the border between two: from rest over exactly 2·a³/j² it
fails in 1 of 50 cases (0.135 rad with 3 rad/s², 20 rad/s³), and goes on failing there, since a reference at rest
stays where it is. With a hair less jerk the border is elsewhere.
"""

from __future__ import annotations

from ruckig import InputParameter, Ruckig, RuckigError, Trajectory

__all__ = ["LONGEST_S", "NoPlan", "Plan", "solve"]

JERK_FACTORS = (1.0 - 1e-9, 1.0 - 1e-6)
"""Parts of the jerk limit to try when the whole finds no plan; the velocity may grow by as little for it."""

LONGEST_S = 3600.0
"""Plans up to this duration can be found [s]; ruckig refuses those above 7600 s."""


class Plan(Trajectory):  # type: ignore[misc]  # ruckig has no types
    """What ruckig found, and from what: its own object does not tell, and the same input gives the same plan, bit by bit."""

    entry: InputParameter | None = None
    """What it was calculated from last; None before. A plan that is kept has one to itself."""


class NoPlan(Exception):
    """There is no plan, or ruckig does not find it. The message says why."""


def solve(ruckig: Ruckig, entry: InputParameter, trajectory: Plan) -> None:
    """Calculate the trajectory of an input.

    Args:
        ruckig: For the same number of joints.
        entry: Checked by the caller: ruckig takes short vectors and any goal without a word.
        trajectory: Takes the result; of no use when there is none.

    Raises:
        NoPlan: ruckig finds none.
    """
    trajectory.entry = entry
    try:
        ruckig.calculate(entry, trajectory)
    except RuckigError as error:
        reason = str(error).strip()
    except ValueError as error:
        # A result that the Python bindings have no name for: the duration is beyond ruckig's numbers.
        raise NoPlan(f"the motion would take longer than ruckig can plan, about 2 h ({error})") from error
    else:
        return
    jerk = entry.max_jerk
    for factor in JERK_FACTORS:
        entry.max_jerk = [j * factor for j in jerk]
        try:
            ruckig.calculate(entry, trajectory)
        except RuckigError:
            continue
        finally:
            entry.max_jerk = jerk
        return
    raise NoPlan(reason)
