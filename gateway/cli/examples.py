"""`ta2 example`: lists the examples of the manual's §6, shows one, or runs one as a program of its own would run."""

from __future__ import annotations

import importlib
import inspect
import sys

from gateway.cli.terminal.asking import confirmed
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, failure
from gateway.examples import EXAMPLES

__all__ = ["list_examples", "run_example", "show_example"]


def list_examples() -> ExitStatus:
    """Print which examples there are, what each needs and does."""
    for number, example in EXAMPLES.items():
        print(f"{number}  {example.title}: {example.effect}\n     needs {example.needs}")
    print("\n`ta2 example NUMBER` runs one, with --show it is printed; each is a program to copy.")
    return ExitStatus.OK


def show_example(number: str) -> ExitStatus:
    """Print the program of an example."""
    print(inspect.getsource(importlib.import_module(_module_of(number))), end="")
    return ExitStatus.OK


def run_example(number: str, target: str | None, *, asks: bool) -> ExitStatus:
    """Run an example.

    Args:
        number: Section of the manual.
        target: Where the gateway is; None finds its socket.
        asks: Whether a person at a terminal is asked first.

    Raises:
        GatewayError: What the robot or the gateway refused, or what became of a motion.
    """
    module = _module_of(number)
    example = EXAMPLES[number]
    print(f"example {number}: {example.effect}\n  needs {example.needs}", file=sys.stderr)
    if asks and not confirmed():
        print("nothing was done", file=sys.stderr)
        return ExitStatus.REFUSED
    importlib.import_module(module).main(target)
    return ExitStatus.OK


def _module_of(number: str) -> str:
    if number not in EXAMPLES:
        known = ", ".join(EXAMPLES)
        raise failure(
            Code.BAD_REQUEST,
            f"there is no example {number!r}, there are {known}",
            field="example",
            value=number,
            bound=known,
            hint="`ta2 example` lists them",
        )
    return EXAMPLES[number].module
