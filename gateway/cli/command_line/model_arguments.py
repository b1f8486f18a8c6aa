"""The command that checks the body's numbers, as data; part of `arguments.py`, which gives it its parser."""

from __future__ import annotations

import argparse

__all__ = ["add_model"]


def add_model(model: argparse.ArgumentParser) -> None:
    """Add what can be done with the model.

    Args:
        model: Parser of `model`.
    """
    acts = model.add_subparsers(title="what to do", dest="act", metavar="ACT", required=True)
    text = "work the manual's and the published figures out again, and say where the numbers differ"
    check = acts.add_parser(
        "check",
        help=text,
        description=f"{text[0].upper()}{text[1:]}. Status 1 when one differs. Needs no robot and no gateway.",
        allow_abbrev=False,
    )
    check.add_argument(
        "--urdf", metavar="FILE", help="check this description instead of our own numbers, and compare it with them"
    )
    check.add_argument("--json", action="store_true", help="print JSON on standard output")
