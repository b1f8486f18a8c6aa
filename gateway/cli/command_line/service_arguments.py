"""Arguments of `ta2 service`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gateway.cli.command_line.adding import add_command
from gateway.cli.command_line.robot_arguments import endpoint

__all__ = ["add_service"]


def add_service(service: argparse.ArgumentParser) -> None:
    """Add the verbs of `service`; `options.verb` says which one it is."""
    verbs = service.add_subparsers(title="what to do", dest="verb", metavar="VERB", required=True)
    install = add_command(
        verbs,
        "install",
        "write the units, and start the gateway at every boot; as root",
        "Options are those of the units: give them again to change one. What runs goes on as it is.",
    )
    install.add_argument("--print", dest="prints", action="store_true", help="print the units and write nothing")
    install.add_argument("--user", metavar="NAME", help="whose services they are (default: who typed sudo, else ta2)")
    install.add_argument("--robot", type=endpoint, metavar="ROBOT", help="the robot's router (default: as configured)")
    install.add_argument("--config", type=Path, metavar="FILE", help="the gateway's settings")
    install.add_argument(
        "--recorder", type=Path, metavar="DIR", help="record into DIR at every boot (default: only when it is started)"
    )
    install.add_argument(
        "--web", type=Path, metavar="FILE", help="serve the page on 127.0.0.1 at every boot, to the users in FILE"
    )
    status = add_command(verbs, "status", "show state, since when, watchdog, and where the units are")
    status.add_argument("--json", action="store_true", help="print JSON on standard output")
    remove = add_command(verbs, "remove", "end the services and take their units away; data and bags stay")
    for sub in (install, remove):
        sub.add_argument("--root", type=Path, metavar="DIR", help="of an image or a package (default: this system)")
