"""One arm that is jogged: the next target of its stream, or in a sentence why it stays where it is.

What is jogged from is the target that was told last, never what was measured. It goes ahead of the reference that the gateway
tells by no more than that needs to follow it: what holds the reference up (a limit, another part of the body) holds it up, too.

In end-effector mode the hand is told poses. In joint mode it is told joints; those for a pose of the hand come from the body
model, as near to the last ones as there are, and only while the gateway finds that the model agrees with the robot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gateway.api.protocol import Info
from gateway.cli.teleop.jogging import HAND, apart, moved
from gateway.client.handles import JointStream, PoseStream
from gateway.client.state.reading import RobotState
from gateway.kinematics.arm import ArmModel
from gateway.values import EePose, Vector

__all__ = ["Arm", "held_up"]

LEAD_S, LEAD, LATELY_S = 0.3, 0.004, 0.4
"""A target may be ahead of the told reference by what it did lately in so long [s], for the gateway's filter and the age of a
snapshot, and by so much [m, rad]."""
FAR_PART, JOINT_PART, EQUAL = 0.35, 0.8, 1e-9
"""An arm that is farther behind its reference than this part of what aborts a motion is not led on. No joint goes faster for
the hand than this part of its limit."""


class Arm:
    """An arm whose stream is open; in joint mode with its model, inside the gateway's limits, in end-effector mode without."""

    def __init__(self, out: JointStream | PoseStream, model: ArmModel | None, info: Info) -> None:
        self.out, self._model, self._info = out, model, info
        farthest = (info.tracking_pose_m, info.tracking_pose_rad) if model is None else (info.tracking_rad,)
        self._farthest = tuple(FAR_PART * far for far in farthest)
        self._returns = False  # to where the arm is, since that does not follow
        self._lately: Vector = (0.0,) * len(farthest)  # how fast the target went [m/s, rad/s]

    def advance(self, rates: Mapping[str, float], joint: int, dt_s: float, state: RobotState, *, in_hand: bool) -> str:
        """Set the next target, and return why it is not what was wished for; empty when it is.

        The rates are those of the hand [m/s, rad/s], along its own axes or those of its shoulder frame, and of the joint with
        that number, counted from 0 [rad/s]; the step stands for a time above 0 [s].
        """
        out, arm, why = self.out, state.arm(self.out.side), ""
        twist = tuple(rates[axis] for axis in HAND)
        if isinstance(out, PoseStream):
            here: Vector = (*out.p.tolist(), *out.quat_xyzw.tolist())
            told: Vector = (*arm.p_ref.tolist(), *arm.quat_ref_xyzw.tolist())
            measured: Vector = (*arm.pose.p.tolist(), *arm.pose.quat_xyzw.tolist())
            errors = [arm.tracking_error_m, arm.tracking_error]
            wanted = moved(here, twist, dt_s, in_hand=in_hand)
            if math.hypot(*wanted[:3]) > max(self._info.reach_m, math.hypot(*here[:3])):
                wanted, why = here, f"the hand is at the end of its reach, {self._info.reach_m:g} m"
            if rates["joint"]:
                why = "this arm is in end-effector mode: its joints cannot be jogged (manual §2.3)"
        else:
            here, told, measured = tuple(out.q.tolist()), tuple(arm.q_ref.tolist()), tuple(arm.q.tolist())
            errors, wanted = [arm.tracking_error], here
            if any(twist):
                wanted, why = self._solved(here, twist, dt_s, state, in_hand=in_hand)
            wanted = (*wanted[:joint], wanted[joint] + rates["joint"] * dt_s, *wanted[joint + 1 :])
        leads, steps = self._gaps(here, told or here), self._gaps(wanted, here)
        fade = 1.0 - dt_s / LATELY_S
        self._lately = tuple(max(step / dt_s, v * fade) for step, v in zip(steps, self._lately, strict=True))
        is_far = any((error or 0.0) > far for error, far in zip(errors, self._farthest, strict=True))
        self._returns |= is_far and self._gaps(wanted, measured) > self._gaps(here, measured)
        if self._returns:
            wanted, why = measured, "the arm does not follow, held up or out of reach: let go, then jog it another way"
            self._returns = any(rates.values())
        elif any(steps) and any(lead > LEAD_S * v + LEAD for lead, v in zip(leads, self._lately, strict=True)):
            wanted, why = here, held_up(state, out.side)
        if isinstance(out, PoseStream):
            out.set(wanted[:3], wanted[3:])
            return why
        for number, (sent, asked) in enumerate(zip(out.set(wanted).tolist(), wanted, strict=True), start=1):
            why = why or (f"joint {number} is at its limit, {sent:.2f} rad" if abs(sent - asked) > EQUAL else "")
        return why

    def _gaps(self, a: Sequence[float], b: Sequence[float]) -> tuple[float, ...]:
        """Return how far two targets are apart: [rad], or [m] and [rad]."""
        return apart(a, b) if self._model is None else (max(abs(x - y) for x, y in zip(a, b, strict=True)),)

    def _solved(self, q: Vector, twist: Vector, dt_s: float, state: RobotState, *, in_hand: bool) -> tuple[Vector, str]:
        """Return joints after a step of the hand, a shorter one where a joint would be too fast; or why there are none."""
        view, model, part = state.arm(self.out.side).model, self._model, 1.0
        if model is None or view is None or view.state != "agrees":
            why = "there is none" if view is None else view.reason
            return q, f"the hand takes a body model that agrees with the robot ({why}): jog joints"
        for _ in range(3):
            wanted = moved(model.forward(q).values, twist, part * dt_s, in_hand=in_hand)
            found = model.solution(EePose(p_m=wanted[:3], quat_xyzw=wanted[3:]), q)
            if found is None:
                break
            excess = self._gaps(found.q_rad, q)[0] / (JOINT_PART * self._info.v_radps * dt_s)
            if excess <= 1.0:
                return found.q_rad, ""
            part *= 0.9 / excess
        return q, "no joints take the hand on: a joint's limit, the end of its reach, or a singular posture"


def held_up(state: RobotState, side: str) -> str:
    """Return in a sentence what keeps an arm behind its target, as far as the gateway tells."""
    spacing, findings = state.spacing, state.view.findings
    if spacing is not None and side in spacing.held and spacing.gap_m is not None:
        gap = f"{spacing.gap_m * 1e3:.0f} mm apart, {spacing.margin_m * 1e3:.0f} mm have to stay free"
        return f"held back: {spacing.first} and {spacing.second} are {gap}"
    return (
        f"held up: {findings[0].code}: {findings[0].message}" if findings else "held up: the arm is behind its target"
    )
