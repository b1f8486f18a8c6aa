"""The commands that stop, and the one that ends a stop, as data; part of `arguments.py`."""

from __future__ import annotations

from typing import Any

from gateway.apps.ground_arguments import AddCommand

__all__ = ["add_stops"]


def add_stops(commands: Any, add: AddCommand) -> None:  # noqa: ANN401  argparse's private class
    """Add `stop`, `estop` and `recover`."""
    latched = "Anybody may. Motion is refused until `ta2 recover`."
    for name, text in (
        ("stop", "stop everything; arms and grip are held"),
        ("estop", "stop everything and pause the robot; the grip is lost"),
    ):
        sub = add(commands, name, text, latched)
        sub.add_argument("reason", nargs="*", help="shown to the owner and in the log")
    add(commands, "recover", "clear what holds motion off, if its cause is gone", "Never moves or enables.")
