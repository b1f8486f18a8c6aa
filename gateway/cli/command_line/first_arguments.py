"""What a person begins with, as data: the demo, and completion by the shell; part of `arguments.py`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gateway.cli.command_line.adding import add_command
from gateway.cli.command_line.numbers import factor

__all__ = ["PICTURES", "SHELLS", "add_first"]

PICTURES = (".png", ".svg")
"""Endings that the demo's plot may have."""
SHELLS = ("bash", "zsh", "fish")
"""Shells that completion is written for."""

PLACES = """where shells that are started next find it (write it anew after an update):
  ta2 completion bash > ~/.local/share/bash-completion/completions/ta2
  ta2 completion zsh > "${fpath[1]}/_ta2"
  ta2 completion fish > ~/.config/fish/completions/ta2.fish"""


def add_first(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `demo` and `completion`."""
    demo = add_command(
        commands,
        "demo",
        "start a simulated robot and a gateway of its own, move both arms there and back, and report",
        "Needs no robot and no running gateway. Status 0 only when every figure is within its bound.",
    )
    demo.add_argument(
        "--speed", type=factor, default=0.8, metavar="F", help="factor on the velocity limit (default %(default)s)"
    )
    demo.add_argument(
        "--plot",
        type=_picture,
        default=Path("out/demo.png"),
        metavar="FILE",
        help=f"where the plot goes, {' or '.join(PICTURES)} (default %(default)s)",
    )
    demo.add_argument("--seed", type=int, default=0, help="of the simulated robot's noise (default %(default)s)")
    completion = add_command(
        commands,
        "completion",
        "print a script by which a shell completes commands, options, choices and paths of `ta2`",
    )
    completion.formatter_class = argparse.RawDescriptionHelpFormatter
    completion.epilog = PLACES
    completion.add_argument("shell", choices=SHELLS, help="which shell")


def _picture(text: str) -> Path:
    path = Path(text)
    if path.suffix not in PICTURES:
        raise argparse.ArgumentTypeError(f"{text!r} ends in none of {', '.join(PICTURES)}")
    return path
