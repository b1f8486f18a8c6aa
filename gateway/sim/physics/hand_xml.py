"""A hand in MJCF: rotor, two cranks, two couplers, two fingers, closed by equality constraints.

The four-bar of the manual's §4.4.2 as it is built: each coupler hangs on its crank and is pinned to the rotor by a
`connect` constraint; each finger keeps its direction by a `joint` constraint, which stands for the parallel bar. The
motor is a torque on the rotor (the table of §4.4 belongs to the robot's rules, not to physics).

Choices, since the description gives neither: masses of the moving parts, the pads' shape (60 mm beyond the finger's pin,
meeting in the hand's middle when closed), the motor's damping (2 N·m open it in half a second), friction (§4.8 shows
0.06 N·m at rest).
"""

from __future__ import annotations

from typing import Final

from gateway.sim.physics.elements import TOUCH, Element, Touch, add
from gateway.sim.physics.linkage import OPEN_RAD, FingerPins, HandPins, hand_pins
from gateway.sim.robot.manual import Side

__all__ = ["MOVING_MASS_KG", "add_hand"]

_ROTOR_KG: Final = 0.030
_CRANK_KG: Final = 0.030
_COUPLER_KG: Final = 0.010
_FINGER_KG: Final = 0.040

MOVING_MASS_KG: Final = _ROTOR_KG + 2.0 * (_CRANK_KG + _COUPLER_KG + _FINGER_KG)
"""What the moving parts of one hand weigh [kg] (choice)."""

_MOTOR: Final = {"armature": 0.002, "damping": 1.0, "frictionloss": 0.06}
_PIN: Final = {"armature": 2e-5, "damping": 0.002}
_HARD_STOP: Final = {"solreflimit": (0.004, 1.0), "solimplimit": (0.99, 0.9999, 0.0005, 0.5, 2.0)}
_STIFF: Final = {"solref": (0.004, 1.0), "solimp": (0.98, 0.999, 0.0005, 0.5, 2.0)}
_PAD_M: Final = (0.030, 0.011, 0.005)  # half a pad along u, y, v


def add_hand(hand: Element, equality: Element, actuator: Element, side: Side) -> None:
    """Add the moving parts of a hand.

    The right hand is the mirror image in its own plane.
    """
    pins, touch = hand_pins(), Touch.LEFT if side is Side.LEFT else Touch.RIGHT
    plane = _Plane(pins, 1.0 if side is Side.LEFT else -1.0)
    name = side.value
    rotor = add(hand, "body", name=f"{name}_rotor", pos=plane.at(pins.rotor_m), gravcomp=1.0)
    add(rotor, "joint", name=f"{name}_rotor", axis=plane.motor_axis, range=(0.0, OPEN_RAD), **_HARD_STOP, **_MOTOR)
    shape = {"size": (0.017, 0.006), "zaxis": (0.0, 1.0, 0.0)}
    add(rotor, "geom", name=f"{name}_rotor", type="cylinder", mass=_ROTOR_KG, class_="metal", **shape)
    for number, finger in enumerate(pins.fingers, start=1):
        _add_finger(hand, equality, plane, f"{name}_%s{number}", finger, touch)
    add(actuator, "motor", name=f"{name}_gripper", joint=f"{name}_rotor", forcerange=(-2.0, 2.0))


def _add_finger(hand: Element, equality: Element, plane: _Plane, name: str, finger: FingerPins, touch: Touch) -> None:
    crank = add(hand, "body", name=name % "crank", pos=plane.at(finger.pivot_m), gravcomp=1.0)
    add(crank, "joint", name=name % "crank", axis=plane.turn_axis, **_PIN)
    arms = ((0.0, 0.0, 0.0), plane.way(finger.pivot_m, finger.finger_m))
    _add_bar(crank, name % "crank", arms[0], arms[1], _CRANK_KG)

    coupler = add(crank, "body", name=name % "coupler", pos=plane.way(finger.pivot_m, finger.crank_pin_m), gravcomp=1.0)
    add(coupler, "joint", name=name % "coupler", axis=plane.turn_axis, **_PIN)
    bar = plane.way(finger.crank_pin_m, finger.rotor_pin_m)
    _add_bar(coupler, name % "coupler", arms[0], bar, _COUPLER_KG)
    rotor = name.partition("_")[0] + "_rotor"
    add(equality, "connect", name=name % "pin", body1=name % "coupler", body2=rotor, anchor=bar, **_STIFF)

    body = add(crank, "body", name=name % "finger", pos=arms[1], gravcomp=1.0)
    add(body, "joint", name=name % "finger", axis=plane.turn_axis, **_PIN)
    joints = {"joint1": name % "finger", "joint2": name % "crank"}
    add(equality, "joint", name=name % "bar", polycoef=(0.0, -1.0, 0.0, 0.0, 0.0), **joints, **_STIFF)
    # Closed, the pads meet in the hand's middle: where the rotor is across.
    inwards = plane.pins.rotor_m[1] - finger.finger_m[1] + finger.opens * _PAD_M[2]
    contype, conaffinity = TOUCH[touch]
    add(
        body,
        "geom",
        name=name % "pad",
        type="box",
        size=_PAD_M,
        pos=(_PAD_M[0], 0.0, plane.mirror * inwards),
        mass=_FINGER_KG,
        contype=contype,
        conaffinity=conaffinity,
        class_="pad",
    )
    add(
        body, "site", name=name % "tip", pos=(2.0 * _PAD_M[0], 0.0, plane.mirror * (inwards - finger.opens * _PAD_M[2]))
    )


def _add_bar(body: Element, name: str, from_m: tuple[float, ...], to_m: tuple[float, ...], mass_kg: float) -> None:
    ends = (*from_m, *to_m)
    add(body, "geom", name=name, type="capsule", fromto=ends, size=0.005, mass=mass_kg, class_="metal")


class _Plane:
    """The linkage's plane in a hand's base: points (u, v) to (x, y, z)."""

    def __init__(self, pins: HandPins, mirror: float) -> None:
        self.pins, self.mirror = pins, mirror
        # u to v is x to z of the left hand, about -y; the motor opens the other way round.
        self.turn_axis = (0.0, -mirror, 0.0)
        self.motor_axis = (0.0, mirror, 0.0)

    def at(self, point_m: tuple[float, float]) -> tuple[float, float, float]:
        return (point_m[0], self.pins.y_m, self.mirror * point_m[1])

    def way(self, a_m: tuple[float, float], b_m: tuple[float, float]) -> tuple[float, float, float]:
        return (b_m[0] - a_m[0], 0.0, self.mirror * (b_m[1] - a_m[1]))
