"""The robot in MJCF: the published joint tree, masses and inertias, with primitive shapes of our own.

* Arms: position servos of the vendor's MuJoCo example (kp 120, kv 8, armature 0.02) with gravity compensation, torque
  within the description's limits. The robot's zero-velocity command, which is no position hold (manual §4.10), is a
  damper instead; each arm has either switched on (`World.drive`). Stops are where both the description and §4.13 let a
  joint go, 0.02 rad beyond the wider of them.
* Lift: a servo that holds what the robot's own ramp says, within the description's force.
* Base: moves in the plane; three wheels push it where they touch the ground. **What an omni wheel is here:** a motor that
  holds its commanded speed, pulling along its rolling direction with what its share of the weight allows (friction 0.8),
  rolling freely across. No rollers, no suspension, no tipping, even ground.
* Shapes (capsules from joint to joint, boxes) and friction of the joints are ours. A part's mass never comes from its shape,
  except in the hands, for which none is published.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.sim.physics.body_numbers import BodyNumbers, Joint, transform
from gateway.sim.physics.elements import TOUCH, Element, Touch, add, placed
from gateway.sim.physics.hand_xml import MOVING_MASS_KG, add_hand
from gateway.sim.robot.lift import LOWEST_M
from gateway.sim.robot.manual import DOF, LOWER_RAD, UPPER_RAD, Side

__all__ = ["FIXED_LOWERED_M", "PADS_M", "SERVO_GROUPS", "add_robot", "arm_joint", "hand_link", "robot_mass_kg"]

Array = NDArray[np.float64]

FIXED_LOWERED_M: Final = 0.30
"""How far below the top the torso of a model without lift stands [m] (choice: where the simulated lift begins)."""

KP_NMPRAD: Final = 120.0
KV_NMSPRAD: Final = 8.0
ARMATURE_KGM2: Final = 0.02
BRAKE_NMSPRAD: Final = 40.0
"""Damping of a zero-velocity command [N m s/rad] (choice)."""

SERVO_GROUPS: Final = {Side.LEFT: (1, 2), Side.RIGHT: (3, 4)}
"""MuJoCo's groups of an arm's servos: those that follow, those that brake; all other motors are in group 0."""

PADS_M: Final = (0.185, -0.0068, -0.0210)
"""Where the pads hold a thing, in the left hand [m]."""

_FRICTION_PART: Final = 0.01  # dry friction of a joint as a part of its motor's torque (choice)
_BEYOND_RAD: Final = 0.02
_LIFT_KP_NPM, _LIFT_KV_NSPM = 2e5, 6e3
_GRIP_OF_WHEEL: Final = 0.8
_TRACTION_NSPM: Final = 8e3
_GRAVITY_MPS2: Final = 9.81
_RADII_M: Final = (0.060, 0.055, 0.055, 0.050, 0.048, 0.042)  # of an arm's links 1 to 6 (choice)
_OPTICAL: Final = np.diag([1.0, -1.0, -1.0, 1.0])  # from z forward, y down (appendix A) to MuJoCo's z back, y up

# Shapes that stand on a link: kind, half size or radius, where; in the link's frame [m] (choice).
_SHAPES: Final = {
    "base_link": (
        ("chassis", "cylinder", (0.36, 0.10), (-0.0223, 0.0, 0.06)),
        ("column", "box", (0.07, 0.09, 0.52), (-0.148, 0.0, 0.68)),
    ),
    "body_link": (
        ("torso", "box", (0.11, 0.075, 0.17), (0.0, -0.010, -0.06)),
        ("head", "box", (0.075, 0.055, 0.06), (0.0, 0.045, 0.1925)),
    ),
}


def arm_joint(side: Side, number: int) -> str:
    """Return the description's name of an arm's joint, numbered from 1."""
    return f"arm{side.value[0].upper()}{number}_joint"


def hand_link(side: Side) -> str:
    """Return the description's name of a hand's base."""
    return f"{side.value[0]}g_base_link"


def robot_mass_kg(numbers: BodyNumbers) -> float:
    """Return what the whole robot weighs: the published masses, and ours of the hands' moving parts [kg]."""
    return sum(inertia.mass_kg for inertia in numbers.inertias.values()) + len(Side) * MOVING_MASS_KG


def add_robot(mujoco: Element, world: Element, numbers: BodyNumbers, *, has_lift: bool) -> None:
    """Add the robot to a scene.

    In the world x is forward, z up, the ground at 0; without lift the torso stands at `FIXED_LOWERED_M`.
    """
    sections = _Sections(
        equality=add(mujoco, "equality"), actuator=add(mujoco, "actuator"), has_lift=has_lift, numbers=numbers
    )
    sections.add_base(world)


class _Sections:
    """Builds the tree from the base on."""

    def __init__(self, equality: Element, actuator: Element, *, has_lift: bool, numbers: BodyNumbers) -> None:
        self._equality, self._actuator = equality, actuator
        self._has_lift = has_lift
        self._numbers = numbers
        self._sides = {arm_joint(side, number): (side, number) for side in Side for number in range(1, DOF + 1)}

    def add_base(self, world: Element) -> None:
        height_m = self._numbers.axle_height_m
        base = add(world, "body", name="base_link", pos=(0.0, 0.0, height_m))
        for name, kind, axis in (("x", "slide", (1, 0, 0)), ("y", "slide", (0, 1, 0)), ("yaw", "hinge", (0, 0, 1))):
            add(base, "joint", name=f"base_{name}", type=kind, axis=axis)
        self._add_link(base, "base_link")

    # ---------------------------------------------------------------------------------------------------------- tree

    def _add_link(self, body: Element, link: str) -> None:
        """Add what is fixed to a link, then the links that hang on it."""
        inertia = self._numbers.inertias[link]
        xx, xy, xz, yy, yz, zz = inertia.inertia_kgm2
        add(body, "inertial", pos=inertia.com_m, mass=inertia.mass_kg, fullinertia=(xx, yy, zz, xy, xz, yz))
        for name, kind, size, pos in _SHAPES.get(link, ()):
            self._add_shape(body, Touch.TRUNK, name=name, type=kind, size=size, pos=pos, class_="shell")
        for side in Side:
            if link == hand_link(side):
                self._add_palm(body, side)
        self._add_cameras(body, link)
        self._add_children(body, link, np.eye(4))

    def _add_children(self, body: Element, link: str, body_T_link: Array) -> None:
        for joint in self._numbers.joints:
            if joint.parent != link:
                continue
            body_T_child = body_T_link @ joint.parent_T_child
            if joint.child in self._numbers.inertias:
                if joint.kind == "prismatic" and not self._has_lift:
                    lowered_m = FIXED_LOWERED_M * np.array(joint.axis)
                    body_T_child = body_T_child @ transform(lowered_m.tolist(), (0.0, 0.0, 0.0))
                child = add(
                    body, "body", name=joint.child, gravcomp=float(self._is_carried(joint)), **placed(body_T_child)
                )
                self._add_joint(child, joint)
                if joint.kind == "continuous":
                    self._add_pull(body, joint)
                self._add_link(child, joint.child)
            else:  # a frame: nothing but a place on its body
                add(body, "site", name=joint.child, **placed(body_T_child))
                self._add_children(body, joint.child, body_T_child)

    def _is_carried(self, joint: Joint) -> bool:
        """Return whether motors above the base carry a joint's link: arms, hands, and what the lift lifts."""
        return joint.kind in ("revolute", "prismatic") or joint.child == "body_link"

    def _add_joint(self, body: Element, joint: Joint) -> None:
        if joint.kind == "revolute":
            self._add_arm_joint(body, joint, *self._sides[joint.name])
        elif joint.kind == "continuous":
            self._add_wheel(body, joint)
        elif joint.kind == "prismatic" and self._has_lift:
            self._add_lift(body, joint)

    # --------------------------------------------------------------------------------------------------------- parts

    def _add_arm_joint(self, body: Element, joint: Joint, side: Side, number: int) -> None:
        lower = min(joint.lower, LOWER_RAD[side][number - 1]) - _BEYOND_RAD
        upper = max(joint.upper, UPPER_RAD[side][number - 1]) + _BEYOND_RAD
        bounds = (-joint.effort, joint.effort)
        add(
            body,
            "joint",
            name=joint.name,
            axis=joint.axis,
            range=(lower, upper),
            armature=ARMATURE_KGM2,
            frictionloss=_FRICTION_PART * joint.effort,
            actuatorgravcomp="true",
            actuatorfrcrange=bounds,
        )
        follow, brake = SERVO_GROUPS[side]
        add(
            self._actuator,
            "position",
            name=f"{joint.name}_follow",
            joint=joint.name,
            kp=KP_NMPRAD,
            kv=KV_NMSPRAD,
            forcerange=bounds,
            group=follow,
        )
        add(
            self._actuator,
            "velocity",
            name=f"{joint.name}_brake",
            joint=joint.name,
            kv=BRAKE_NMSPRAD,
            forcerange=bounds,
            group=brake,
        )
        if number < DOF:
            after = self._numbers.joint(arm_joint(side, number + 1)).parent_T_child[:3, 3]
            touch = (Touch.LEFT_UPPER if side is Side.LEFT else Touch.RIGHT_UPPER) if number <= 3 else _reaching(side)
            self._add_shape(
                body,
                touch,
                name=joint.child,
                type="capsule",
                fromto=(0.0, 0.0, 0.0, *after),
                size=_RADII_M[number - 1],
                class_="arm",
            )

    def _add_palm(self, hand: Element, side: Side) -> None:
        mirror = 1.0 if side is Side.LEFT else -1.0
        middle = (0.0425, -0.0068, -0.0215 * mirror)  # it ends before the wrist camera's picture begins
        self._add_shape(
            hand,
            _reaching(side),
            name=f"{side.value}_palm",
            type="box",
            size=(0.0425, 0.024, 0.050),
            pos=middle,
            class_="arm",
        )
        mount = self._numbers.cameras[f"{side.value}_wrist"]["xyz_m"]
        self._add_shape(
            hand,
            _reaching(side),
            name=f"{side.value}_wrist_camera",
            type="box",
            size=(0.012, 0.012, 0.045),
            pos=mount,
            class_="shell",
        )
        add_hand(hand, self._equality, self._actuator, side)
        load = add(hand, "body", name=f"{side.value}_load", pos=(*PADS_M[:2], PADS_M[2] * mirror))
        add(load, "inertial", pos=(0.0, 0.0, 0.0), mass=0.0, diaginertia=(0.0, 0.0, 0.0))

    def _add_lift(self, body: Element, joint: Joint) -> None:
        bounds = (-joint.effort, joint.effort)
        add(
            body,
            "joint",
            name="lift",
            type="slide",
            axis=joint.axis,
            range=(0.0, LOWEST_M),
            actuatorgravcomp="true",
            actuatorfrcrange=bounds,
        )
        add(self._actuator, "position", name="lift", joint="lift", kp=_LIFT_KP_NPM, kv=_LIFT_KV_NSPM, forcerange=bounds)

    def _add_wheel(self, body: Element, joint: Joint) -> None:
        name = _wheel(joint)
        add(body, "joint", name=name, axis=joint.axis, armature=0.01)
        bounds = (-joint.effort, joint.effort)
        add(self._actuator, "velocity", name=name, joint=name, kv=5.0, forcerange=bounds)
        size = (self._numbers.axle_height_m, 0.025)
        self._add_shape(body, Touch.NOTHING, name=name, type="cylinder", size=size, class_="metal")

    def _add_pull(self, base: Element, joint: Joint) -> None:
        """Add a wheel's pull on the base where it touches the ground, along the way that it rolls."""
        base_T_wheel = joint.parent_T_child
        axle = base_T_wheel[:3, :3] @ np.array(joint.axis)
        forward = np.array([axle[1], -axle[0], 0.0]) / np.hypot(axle[0], axle[1])
        ground = base_T_wheel[:3, 3] - (0.0, 0.0, self._numbers.axle_height_m)
        name = f"{_wheel(joint)}_pull"
        add(base, "site", name=name, pos=ground.tolist(), xyaxes=(*forward, -forward[1], forward[0], 0.0))
        greatest_n = _GRIP_OF_WHEEL * robot_mass_kg(self._numbers) * _GRAVITY_MPS2 / 3.0
        add(
            self._actuator,
            "general",
            name=name,
            site=name,
            gear=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            gainprm=_TRACTION_NSPM,
            biastype="affine",
            biasprm=(0.0, 0.0, -_TRACTION_NSPM),
            forcerange=(-greatest_n, greatest_n),
        )

    def _add_cameras(self, body: Element, link: str) -> None:
        """Add both eyes of each camera on a link, their baseline along x of the camera's frame."""
        for name, camera in self._numbers.cameras.items():
            if camera["mount_link"] != link:
                continue
            for eye, sign in (("left", -0.5), ("right", 0.5)):
                link_T_eye = transform(camera["xyz_m"], camera["rpy_rad"])
                link_T_eye = link_T_eye @ transform((sign * camera["baseline_m"], 0.0, 0.0), (0.0, 0.0, 0.0))
                fovy_deg = camera["field_of_view_deg"][1]
                add(body, "camera", name=f"{name}_{eye}_eye", fovy=fovy_deg, **placed(link_T_eye @ _OPTICAL))

    def _add_shape(self, body: Element, touch: Touch, **attributes: str | float | Sequence[float]) -> None:
        contype, conaffinity = TOUCH[touch]
        add(body, "geom", contype=contype, conaffinity=conaffinity, **attributes)


def _reaching(side: Side) -> Touch:
    return Touch.LEFT if side is Side.LEFT else Touch.RIGHT


def _wheel(joint: Joint) -> str:
    """Return `wheel1` of `wheel1_wheel_joint`."""
    return joint.name.partition("_")[0]
