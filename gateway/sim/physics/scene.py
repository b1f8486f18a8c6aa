"""The whole scene in MJCF: ground, the robot, a table before it and things to grasp.

Places are ours (the manual describes no workplace): x forward, y left, z up, origin under the robot's base where it
starts. The table is out of the hands' reach there: who drives 0.5 m forward can grasp from above what lies on it.
Generated anew for each run; nothing of it is a file.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final
from xml.etree import ElementTree

from gateway.sim.physics.body_numbers import body_numbers
from gateway.sim.physics.elements import TOUCH, Element, Touch, add
from gateway.sim.physics.robot_xml import add_robot

__all__ = ["MARK_M", "STEP_NS", "TABLE_TOP_M", "THINGS", "scene_xml"]

STEP_NS: Final = 2_000_000
"""Time step [ns]: that of the vendor's MuJoCo example."""

TABLE_TOP_M: Final = 0.75
"""Height of the table's top [m]."""

MARK_M: Final = (0.94, 0.06)
"""Where the mark on the table is, x and y [m]."""

_TABLE: Final = ((0.86, 1.42), (-0.60, 0.60))
_THICK_M: Final = 0.02

# name: kind, half size [m], mass [kg], x, y [m], colour
THINGS: Final = {
    "block": ("box", (0.020, 0.020, 0.020), 0.060, 0.94, 0.22, (0.85, 0.25, 0.20, 1.0)),
    "can": ("cylinder", (0.020, 0.045), 0.120, 0.94, -0.22, (0.20, 0.45, 0.85, 1.0)),
    "ball": ("sphere", (0.025,), 0.050, 1.02, 0.00, (0.95, 0.75, 0.20, 1.0)),
}
"""Things on the table: kind, half size [m], mass [kg], x and y [m], colour."""


def scene_xml(*, has_lift: bool) -> str:
    """Return the scene as an MJCF document.

    Args:
        has_lift: Whether the robot is the lift model (§1.2).
    """
    root = Element("mujoco", {"model": "teleavatar2"})
    add(root, "compiler", angle="radian", autolimits="true")
    add(root, "option", timestep=STEP_NS / 1e9, integrator="implicitfast", cone="elliptic", impratio=10.0)
    visual = add(root, "visual")
    add(visual, "global", offwidth="1280", offheight="1280")
    add(visual, "quality", offsamples="0", shadowsize="0")  # drawn on the processor
    add(visual, "headlight", ambient=(0.35, 0.35, 0.35), diffuse=(0.5, 0.5, 0.5))
    _add_looks(root)
    world = add(root, "worldbody")
    add(world, "light", pos=(0.0, 0.0, 3.5), dir=(0.2, 0.0, -1.0), castshadow="false")
    _add_solid(world, name="ground", type="plane", size=(10.0, 10.0, 0.1), material="ground")
    _add_table(world)
    add_robot(root, world, body_numbers(), has_lift=has_lift)
    for name, (kind, size, mass_kg, x_m, y_m, colour) in THINGS.items():
        body = add(world, "body", name=name, pos=(x_m, y_m, TABLE_TOP_M + size[-1] + 0.001))
        add(body, "freejoint", name=name)
        _add_solid(
            body,
            name=name,
            type=kind,
            size=size,
            mass=mass_kg,
            rgba=colour,
            condim="6" if kind == "sphere" else "3",
            friction=(0.8, 0.01, 0.001),
        )
    return ElementTree.tostring(root, encoding="unicode")


def _add_looks(root: Element) -> None:
    assets = add(root, "asset")
    sky = {"rgb1": (0.62, 0.72, 0.82), "rgb2": (0.30, 0.38, 0.48)}
    add(assets, "texture", type="skybox", builtin="gradient", width="64", height="384", **sky)
    add(
        assets,
        "texture",
        name="ground",
        type="2d",
        builtin="checker",
        rgb1=(0.30, 0.33, 0.36),
        rgb2=(0.36, 0.40, 0.43),
        width="256",
        height="256",
    )
    add(assets, "material", name="ground", texture="ground", texrepeat=(20.0, 20.0))
    defaults = add(root, "default")
    add(defaults, "geom", contype="0", conaffinity="0")
    for name, colour in (
        ("shell", (0.92, 0.92, 0.94, 1.0)),
        ("arm", (0.75, 0.77, 0.80, 1.0)),
        ("metal", (0.35, 0.36, 0.38, 1.0)),
    ):
        add(add(defaults, "default", class_=name), "geom", rgba=colour)
    pads = add(defaults, "default", class_="pad")
    rubber = (0.97, 0.99, 0.001, 0.5, 2.0)
    add(
        pads,
        "geom",
        friction=(1.2, 0.02, 0.0),
        condim="4",
        solref=(0.006, 1.0),
        solimp=rubber,
        rgba=(0.15, 0.15, 0.16, 1.0),
    )


def _add_table(world: Element) -> None:
    (near_m, far_m), (right_m, left_m) = _TABLE
    middle = (0.5 * (near_m + far_m), 0.5 * (right_m + left_m), TABLE_TOP_M - _THICK_M)
    size = (0.5 * (far_m - near_m), 0.5 * (left_m - right_m), _THICK_M)
    wood = (0.66, 0.52, 0.38, 1.0)
    _add_solid(world, name="table", type="box", size=size, pos=middle, rgba=wood, friction=(0.8, 0.01, 0.0))
    for number, (x_m, y_m) in enumerate(((near_m, right_m), (near_m, left_m), (far_m, right_m), (far_m, left_m))):
        leg = (x_m + 0.03 * (1 if x_m == near_m else -1), y_m + 0.03 * (1 if y_m == right_m else -1))
        height_m = 0.5 * TABLE_TOP_M - _THICK_M
        _add_solid(
            world, name=f"leg{number + 1}", type="box", size=(0.02, 0.02, height_m), pos=(*leg, height_m), rgba=wood
        )
    place = (*MARK_M, TABLE_TOP_M + 0.0005)
    add(world, "geom", name="mark", type="cylinder", size=(0.035, 0.0005), rgba=(0.10, 0.60, 0.30, 1.0), pos=place)


def _add_solid(body: Element, **attributes: str | float | Sequence[float]) -> None:
    contype, conaffinity = TOUCH[Touch.THING]
    add(body, "geom", contype=contype, conaffinity=conaffinity, **attributes)
