"""Arguments of `ta2 service` and `ta2 keys`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gateway.cli.command_line.adding import add_command
from gateway.cli.command_line.robot_arguments import endpoint

__all__ = ["add_keys", "add_service"]


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


def add_keys(keys: argparse.ArgumentParser) -> None:
    """Add the verbs of `keys`; `options.verb` says which one it is."""
    verbs = keys.add_subparsers(title="what to do", dest="verb", metavar="VERB", required=True)
    init = add_command(verbs, "init", "make the lab's certificate authority", "Whoever has its key can make admins.")
    server = add_command(verbs, "server", "make the gateway's certificate, and print its settings")
    server.add_argument("hosts", nargs="+", metavar="HOST", help="name or address at which clients reach the gateway")
    client = add_command(verbs, "client", "make a person's or a program's certificate, and note its role")
    client.add_argument("name", metavar="NAME", help="letters, digits and . _ @ -")
    client.add_argument("--role", choices=("viewer", "operator", "admin"), required=True, help="what it may do")
    shown = add_command(verbs, "list", "show who has a certificate, with which role, and until when")
    shown.add_argument("--json", action="store_true", help="print JSON on standard output")
    for sub, days in ((init, 3650), (server, 365), (client, 365)):
        sub.add_argument("--days", type=_days, default=days, help="how long it is good (default: %(default)s)")
        sub.add_argument("--replace", action="store_true", help="make it anew where there is one")
    for sub in (init, server, client, shown):
        sub.add_argument(
            "--dir", type=Path, metavar="DIR", help="where keys are (default: keys in the folder for state)"
        )


def _days(text: str) -> int:
    days = int(text)
    if not 1 <= days <= 36500:
        raise argparse.ArgumentTypeError(f"{days} days are outside [1, 36500]")
    return days
