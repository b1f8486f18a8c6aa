"""Whether a virtual mass may pass: bounds within which it cannot swing (`motion/poses/admittance.py` says why)."""

from __future__ import annotations

from gateway.core.motion.bounds import within, wrong_count
from gateway.errors import Code, Refusal
from gateway.messages.incoming import Admittance
from gateway.values import Space

__all__ = ["LEAST_DAMPING", "check_admittance"]

AXES = ("x", "y", "z", "about x", "about y", "about z")
MASS_UNITS, DAMPING_UNITS, STIFFNESS_UNITS = ("kg", "kg·m²"), ("N·s/m", "N·m·s/rad"), ("N/m", "N·m/rad")
"""Of shifts, then of turns."""

MASSES = ((1.0, 30.0), (0.02, 1.0))
"""Least and greatest mass: a hand's inertia is about 5 kg, of which the model may not know a fifth. What it does not know it
feels as a force; that must be less than the mass that it pushes."""
LAG_S = 0.3
"""How late a force is felt and answered [s]: the observer's 0.03, the robot's 0.1, and what setpoints lag at full speed."""
HELD = (500.0, 50.0)
"""Stiffness of what may hold the hand [N/m, N·m/rad]: a stiff arm; or the simulated robot's own servos, against a table."""
LEAST_DAMPING = tuple(LAG_S * stiffness for stiffness in HELD)
"""D >= E T."""
MOST_DAMPING = (2000.0, 100.0)


def check_admittance(wish: Admittance, space: Space) -> Refusal | None:
    """Refuse what is not of poses, has no six axes, none that is free, or a mass, damping or stiffness outside its bounds."""
    if space is not Space.POSE:
        return Refusal(
            code=Code.BAD_REQUEST,
            message="an arm yields along the axes of its hand's pose, not joint by joint",
            field="space",
            value=space.value,
            bound=Space.POSE.value,
            hint="open a stream of poses",
        )
    for name in ("mass", "damping", "stiffness"):
        values = getattr(wish, name)
        if len(values) != len(AXES):
            return wrong_count(name, len(values), len(AXES), f"admittance.{name}", "x, y, z, and about them")
    if all(mass is None for mass in wish.mass):
        return Refusal(
            code=Code.BAD_REQUEST,
            message="all six axes are locked: there is nothing to push",
            field="admittance.mass",
            hint="give a mass for the axes that shall yield",
        )
    for n, (mass, damping, stiffness) in enumerate(zip(wish.mass, wish.damping, wish.stiffness, strict=True)):
        kind = n // 3
        if mass is not None:
            refusal = (
                _judged("mass", n, mass, MASSES[kind], MASS_UNITS[kind])
                or _judged("damping", n, damping, (LEAST_DAMPING[kind], MOST_DAMPING[kind]), DAMPING_UNITS[kind])
                or _judged("stiffness", n, stiffness, (0.0, damping * damping / (4.0 * mass)), STIFFNESS_UNITS[kind])
            )
            if refusal is not None:
                return refusal
    return None


HINTS = {
    "mass": "a lighter one would swing on what the model does not know, a heavier one nobody moves",
    "damping": "with less it swings when somebody holds it, with more nobody moves it",
    "stiffness": "at most damping² / (4 mass), or it swings: give it more damping, less mass or a softer spring",
}


def _judged(name: str, axis: int, value: float, bounds: tuple[float, float], unit: str) -> Refusal | None:
    where = f"admittance.{name}[{axis}]"
    return within(f"the {name} {AXES[axis]}", value, *bounds, unit, field=where, hint=HINTS[name])
