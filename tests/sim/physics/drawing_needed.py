"""What tests with pictures of the scene take from the system: what draws without a display, and a display for a window.

Nobody else of this project needs either, so a developer's machine may be without; `.ci/run` installs both, and then
`TA2_DRAWING=required` lets the tests fail that do not find them. Debian: libegl1, libgl1-mesa-dri and xvfb.
"""

from __future__ import annotations

import functools
import shutil

from tests.leaving_out import leave_out

__all__ = ["demand_drawing", "demand_screen"]

VARIABLE = "TA2_DRAWING"


def demand_drawing() -> None:
    """Leave the test out where nothing can draw, see `leave_out`; to be called where MuJoCo is."""
    if what := _lacking():
        leave_out(what, VARIABLE)


def demand_screen() -> None:
    """Leave the test out where no display can be made to open a window on."""
    if shutil.which("Xvfb") is None:
        leave_out("no Xvfb here to open a window on: Debian has xvfb", VARIABLE)


@functools.cache
def _lacking() -> str:
    """Return why nothing can draw; empty when something can."""
    from gateway.sim.physics.drawing import Drawing, DrawingMissing  # MuJoCo is not everywhere

    try:
        Drawing(has_lift=False, width=16, height=16).close()
    except DrawingMissing as error:
        return str(error)
    return ""
