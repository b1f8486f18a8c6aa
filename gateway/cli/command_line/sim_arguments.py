"""How a simulated robot moves, whether one looks at it, its clock and camera, as arguments of `ta2 sim`; not what they do."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from gateway.cli.command_line.numbers import between

__all__ = ["add_camera", "add_clock", "add_physics", "add_readings"]

_offset = partial(between, least=-1e8, most=1e8, what="offset [s]")
_percent = partial(between, least=0.0, most=30.0, what="part [%]")
_zero = partial(between, least=-3.2, most=3.2, what="angle [rad]")
_drift = partial(between, least=-1000.0, most=1000.0, what="drift [ppm]")


def add_physics(sim: argparse.ArgumentParser) -> None:
    """Add `--physics`, `--differs`, `--viewer`, `--headless` and `--record`."""
    sim.add_argument(
        "--physics",
        choices=("kinematic", "mujoco"),
        default="kinematic",
        help="how it moves: as lags and speeds, or with forces, contacts and a table of things (default %(default)s)",
    )
    sim.add_argument(
        "--differs",
        type=_percent,
        default=0.0,
        metavar="PERCENT",
        help="how far the arms' masses and friction are from the published numbers, drawn with --seed; efforts get noise "
        "(default %(default)g); needs --physics mujoco",
    )
    sight = sim.add_mutually_exclusive_group()
    sight.add_argument(
        "--viewer", action="store_true", help="show it in a window; needs --physics mujoco and a display"
    )
    sight.add_argument("--headless", dest="viewer", action="store_false", help="show no window (default)")
    sim.add_argument(
        "--record",
        type=Path,
        metavar="FILE",
        help="film the scene from the side, *.mp4; needs --physics mujoco, no display",
    )


def add_clock(sim: argparse.ArgumentParser) -> None:
    """Add `--clock-offset-s` and `--clock-drift-ppm`."""
    sim.add_argument(
        "--clock-offset-s",
        type=_offset,
        default=0.0,
        metavar="S",
        help="how far its clock, which stamps its state, is ahead of this host's at the start [s] (default %(default)g)",
    )
    sim.add_argument(
        "--clock-drift-ppm",
        type=_drift,
        default=0.0,
        metavar="PPM",
        help="how much faster than this host's its clock runs [ppm] (default %(default)g)",
    )


def add_readings(sim: argparse.ArgumentParser) -> None:
    """Add `--gripper-zero-rad`, `--pose-silence` and `--ready-needs-commands`."""
    sim.add_argument(
        "--gripper-zero-rad",
        type=_zero,
        default=0.0,
        metavar="RAD",
        help="what a closed gripper's motor angle is told as [rad] (manual §4.4.2: 0; §4.8 shows 1.13; default %(default)g)",
    )
    sim.add_argument(
        "--pose-silence",
        choices=("stops", "pursues"),
        default="stops",
        help="what an arm in end-effector mode does when poses cease: stop after 0.15 s as one in joint mode (manual §4.3), "
        "or go on to the last one, of which §4.2 says nothing (default %(default)s)",
    )
    sim.add_argument(
        "--ready-needs-commands",
        action="store_true",
        help="its FSM becomes READY only after a valid command of each enabled arm (manual §6.10; §6.1 needs none)",
    )


def add_camera(sim: argparse.ArgumentParser) -> None:
    """Add `--camera` and `--camera-to`."""
    sim.add_argument("--camera", action="store_true", help="send its camera's pictures too, as RTP/H.265 (manual §5.1)")
    sim.add_argument(
        "--camera-to", metavar="HOST:PORT", help="where to; turns --camera on (default 127.0.0.1:8890, as the robot's)"
    )
