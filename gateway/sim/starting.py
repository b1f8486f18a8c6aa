"""From a command line's options to a running simulated robot: its settings, its camera's process, a window to look at it.

Nothing that only some robots need is imported for the others: no MuJoCo for a kinematic one, no encoder without a camera.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack

from gateway.sim.node import SimNode, main_sim
from gateway.sim.robot.dynamics import PhysicsMissing
from gateway.sim.robot.settings import SimSettings, settings_of

__all__ = ["CannotStart", "start"]


class CannotStart(Exception):
    """What was asked for cannot be had here; the text says what is missing and what to do."""


def start(options: Namespace) -> int:
    """Run a simulated robot until it is asked to end; return the exit code.

    Args:
        options: What `settings_of` needs, with listen, viewer, record (file of a film, or None) and camera_to (HOST:PORT
            of its pictures, or None).

    Raises:
        CannotStart: Settings that mean nothing together; MuJoCo, an encoder or a display missing.
    """
    try:
        settings = settings_of(options)
    except ValueError as error:
        raise CannotStart(str(error)) from error
    make = _viewed(settings) if options.viewer else None
    with ExitStack() as stack:
        if options.camera_to is not None:
            _send_pictures(stack, options, settings)
        if options.record is not None:
            _film(stack, options, settings)
        try:
            if make is None:
                return main_sim(options.listen, settings)
            return main_sim(options.listen, settings, make=make)
        except PhysicsMissing as error:
            raise CannotStart(str(error)) from error


def _film(stack: ExitStack, options: Namespace, settings: SimSettings) -> None:
    if settings.physics != "mujoco":
        raise CannotStart("a film shows bodies with forces: add --physics mujoco, or leave --record out")
    from gateway.sim.physics.film_process import FilmProcess

    try:
        stack.enter_context(FilmProcess(options.listen, options.record))
    except ValueError as error:
        raise CannotStart(str(error)) from error


def _send_pictures(stack: ExitStack, options: Namespace, settings: SimSettings) -> None:
    from gateway.sim.camera.camera_process import CameraProcess
    from gateway.sim.camera.hevc import EncoderMissing

    try:
        scene = options.listen if settings.physics == "mujoco" else None
        stack.enter_context(CameraProcess(options.camera_to, options.seed, scene))
    except (EncoderMissing, ValueError) as error:
        raise CannotStart(str(error)) from error


def _viewed(settings: SimSettings) -> Callable[[SimSettings, str], SimNode]:
    if settings.physics != "mujoco":
        raise CannotStart("a window shows bodies with forces: add --physics mujoco, or leave --viewer out")
    try:
        from gateway.sim.physics.viewed_node import DisplayMissing, ViewedNode, require_display
    except ImportError as error:
        raise CannotStart(f"--viewer needs {error.name}: pip install 'teleavatar-gateway[sim]'") from error
    try:
        require_display()
    except DisplayMissing as error:
        raise CannotStart(str(error)) from error
    return ViewedNode
