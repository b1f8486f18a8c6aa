"""`ta2 example`: lists the examples of the manual's §6, shows one, or runs one as a program of its own would run."""

from __future__ import annotations

import importlib
import inspect
import sys
from argparse import Namespace

from gateway.cli.terminal.asking import confirmed
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, failure
from gateway.examples import EXAMPLES

__all__ = ["carry_out"]


def carry_out(options: Namespace) -> ExitStatus:
    """List them, print the program of one, or run it.

    Raises:
        GatewayError: There is no such example; what the robot or the gateway refused, or what became of a motion.
    """
    if options.number is None:
        for number, example in EXAMPLES.items():
            print(f"{number}  {example.title}: {example.effect}\n     needs {example.needs}")
        print("\n`ta2 example NUMBER` runs one, with --show it is printed; each is a program to copy.")
        return ExitStatus.OK
    module = _module_of(options.number)
    if options.show:
        print(inspect.getsource(importlib.import_module(module)), end="")
        return ExitStatus.OK
    example = EXAMPLES[options.number]
    print(f"example {options.number}: {example.effect}\n  needs {example.needs}", file=sys.stderr)
    if not (options.yes or confirmed()):
        print("nothing was done", file=sys.stderr)
        return ExitStatus.REFUSED
    importlib.import_module(module).main(options.target)
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
