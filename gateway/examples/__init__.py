"""The examples of the manual's §6, as short programs of ours: `ta2 example` lists them, `ta2 example 6.6` runs one.

Each is a program of its own that needs `gateway.client` and nothing else: copy one and change it. Here is only which there
are, and what each needs and does.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["EXAMPLES", "Example"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Example:
    """One of them.

    Attributes:
        module: Where it is; its `main(target)` runs it.
        title: What it is about.
        needs: What the robot must be configured to, besides API mode (manual §2.3).
        effect: What the robot then does.
    """

    module: str
    title: str
    needs: str
    effect: str


EXAMPLES: dict[str, Example] = {
    "6.1": Example(
        module="gateway.examples.example_6_1",
        title="end-effector mode",
        needs="the left arm enabled, in end-effector control",
        effect="the left hand moves straight to a pose; then the robot pauses",
    ),
    "6.2": Example(
        module="gateway.examples.example_6_2",
        title="grippers, in joint mode",
        needs="both arms enabled, in joint control",
        effect="both arms are held where they are, and both grippers open a little, for 3 s",
    ),
    "6.3": Example(
        module="gateway.examples.example_6_3",
        title="grippers, in end-effector mode",
        needs="both arms enabled, in end-effector control",
        effect="both hands are held where they are, and both grippers open with full torque, for 3 s",
    ),
    "6.4": Example(
        module="gateway.examples.example_6_4",
        title="joint mode",
        needs="both arms enabled, in joint control",
        effect="both arms go to a symmetric configuration and are held there for 3 s",
    ),
    "6.5": Example(
        module="gateway.examples.example_6_5",
        title="chassis",
        needs="the chassis enabled; free floor, 0.2 m ahead",
        effect="the chassis drives ahead at 0.05 m/s for 2 s and stops; no arm moves",
    ),
    "6.6": Example(
        module="gateway.examples.example_6_6",
        title="initial position",
        needs="both arms enabled, in joint control",
        effect="both arms go to the initial position; then the robot pauses",
    ),
    "6.7": Example(
        module="gateway.examples.example_6_7",
        title="lift",
        needs="the lift model, its servo enabled",
        effect="the lift goes up for 1.5 s, pauses, goes down for 1.5 s; then its servo is off",
    ),
}
"""By their section of the manual."""
