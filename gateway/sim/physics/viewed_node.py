"""A simulated robot in a window: MuJoCo's own viewer, fed thirty times a second by the node. Closing it ends the robot.

The window draws in a thread of its own, without a graphics card on the processor: then it takes what a core can give.
"""

from __future__ import annotations

import threading
import warnings
from typing import Any, Final

import glfw
import mujoco.viewer

from gateway.sim.node import DEFAULT_LISTEN, SimNode
from gateway.sim.physics.bodies import Bodies
from gateway.sim.robot.manual import S
from gateway.sim.robot.settings import SimSettings

__all__ = ["DisplayMissing", "ViewedNode", "require_display"]

_PERIOD_NS: Final = S // 30
_PATIENCE_S: Final = 10.0


class DisplayMissing(RuntimeError):
    """There is no display to open a window on."""


def require_display() -> None:
    """Make sure that a window can be opened: the viewer itself would wait for one for ever.

    Raises:
        DisplayMissing: There is no display; the text says why, and what to do.
    """
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        is_there = bool(glfw.init())
    if not is_there:
        reason = str(told[-1].message) if told else "GLFW does not start"
        raise DisplayMissing(f"no display for a window ({reason}): use --headless, or run it where there is a desktop")


class ViewedNode(SimNode):
    """A node whose robot is seen."""

    def __init__(self, settings: SimSettings, listen: str = DEFAULT_LISTEN) -> None:
        """Listen, announce the robot and open the window.

        Raises:
            TypeError: The settings are without physics: there is nothing to see.
            zenoh.ZError: If the endpoint cannot be listened on.
        """
        super().__init__(settings, listen)
        dynamics = self.robot.dynamics
        if not isinstance(dynamics, Bodies):
            self.close()
            raise TypeError(f"physics {settings.physics!r} has no bodies to show")
        world = dynamics.world
        before = set(threading.enumerate())
        self._viewer: Any = mujoco.viewer.launch_passive(
            world.model, world.data, show_left_ui=False, show_right_ui=False
        )
        self._drawing = set(threading.enumerate()) - before
        self._shown_ns = 0

    def step(self, now_ns: int) -> None:
        """Take a cycle, and show the world when it is time."""
        super().step(now_ns)
        if now_ns - self._shown_ns >= _PERIOD_NS:
            self._shown_ns = now_ns
            if self._viewer.is_running():
                self._viewer.sync()
            else:
                self.shut_down()

    def close(self) -> None:
        """Close the window and end the session; safe to call twice."""
        viewer, self._viewer = getattr(self, "_viewer", None), None
        if viewer is not None:
            viewer.close()
            for thread in self._drawing:  # it must not draw any more when the interpreter ends
                thread.join(_PATIENCE_S)
        super().close()
