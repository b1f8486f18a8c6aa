"""The commands that stop, and the one that ends a stop, as data; part of `arguments.py`."""

from __future__ import annotations

from typing import Any

from gateway.cli.command_line.adding import add_client_command

__all__ = ["add_stops"]


def add_stops(commands: Any) -> None:  # noqa: ANN401  argparse's private class
    """Add `stop`, `estop`, `stop-endpoint` and `recover`."""
    latched = "Anybody may. Motion is refused until `ta2 recover`."
    for name, text in (
        ("stop", "stop everything; arms and grip are held"),
        ("estop", "stop everything and pause the robot; the grip is lost"),
    ):
        sub = add_client_command(commands, name, text, latched)
        sub.add_argument("reason", nargs="*", help="shown to the owner and in the log")
    watch = add_client_command(
        commands,
        "stop-endpoint",
        "watch over the robot from this terminal: without it, nothing moves",
        "Enter or space stops the robot, q leaves in order. Whatever else ends or stops this command holds the robot.",
    )
    watch.add_argument(
        "--within",
        type=float,
        default=0.5,
        metavar="S",
        help="the robot is held when this terminal was not heard for longer, 0.1 to 10 [s] (default 0.5)",
    )
    watch.add_argument("--pause", action="store_true", help="then pause the robot; the grip is lost")
    recover = add_client_command(
        commands, "recover", "clear what holds motion off, if its cause is gone", "Never moves or enables."
    )
    recover.add_argument("reason", nargs="*", help="needed to let stop endpoints go that are silent; told to everybody")
