"""The command for the frames, as data."""

from __future__ import annotations

from typing import Any

from gateway.cli.command_line.adding import add_client_command

__all__ = ["add_frames"]


def add_frames(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `frames`."""
    frames = add_client_command(
        commands,
        "frames",
        "show the frames of manual appendix A: the tree, where each frame is, and whether that is this robot's own",
        "Needs no gateway: without --live the arms are at the joints given, else at the initial position of manual §6.6.",
    )
    frames.add_argument("--live", action="store_true", help="take the joints from the gateway, with their stamps")
    for side in ("left", "right"):
        frames.add_argument(
            f"--{side}", nargs=7, type=float, metavar="Q", help=f"seven joints of the {side} arm [rad] (manual §4.0.3)"
        )
    frames.add_argument("--calibration", metavar="FILE", help="what was calibrated on this robot (.json, .toml)")
    frames.add_argument("--urdf", metavar="FILE", help="kinematics of this URDF in place of our own numbers")
    frames.add_argument("--serial", metavar="S", help="serial number of this robot (default: as configured)")
    frames.add_argument("--config", metavar="FILE", help="settings with serial number and model of this robot")
    frames.add_argument(
        "--chain", nargs=2, metavar=("PARENT", "CHILD"), help="only where CHILD is in PARENT, and by which transforms"
    )
    frames.add_argument("--plot", metavar="FILE", help="draw them to FILE (.png, .svg, .pdf); needs matplotlib")
