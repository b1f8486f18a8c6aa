"""Arguments of `ta2 service`, `ta2 keys` and `ta2 fleet`."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from gateway.cli.command_line.adding import add_command
from gateway.cli.command_line.numbers import integer, seconds
from gateway.cli.command_line.robot_arguments import endpoint

__all__ = ["add_fleet", "add_keys", "add_service"]

_days = partial(integer, least=1, most=36500, what="number of days")


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


def add_fleet(fleet: argparse.ArgumentParser) -> None:
    """Add the verbs of `fleet`; `options.verb` says which one it is."""
    verbs = fleet.add_subparsers(title="what to do", dest="verb", metavar="VERB", required=True)
    looks = add_command(verbs, "list", "show the robots of the fleet, and how each is")
    watch = add_command(verbs, "watch", "show them again and again, until Ctrl-C")
    watch.add_argument(
        "--period", dest="period_s", type=seconds, default=1.0, metavar="S", help="between looks (default 1)"
    )
    stop = add_command(
        verbs,
        "stop",
        "stop robots of the fleet, all at once; arms and grip are held",
        "Anybody in the fleet may. Status 4 when any did not say that it stopped: use the physical emergency stop there.",
    )
    which = stop.add_mutually_exclusive_group(required=True)
    which.add_argument("names", nargs="*", default=[], metavar="NAME", help="of the robots")
    which.add_argument("--all", action="store_true", help="all robots of the fleet")
    stop.add_argument("--reason", default="", metavar="REASON", help="shown to the owners and in the logs")
    join = add_command(verbs, "join", "be a robot of the fleet, beside its gateway, until Ctrl-C")
    join.add_argument("name", metavar="NAME", help="of the robot, which no other in the fleet has")
    join.add_argument("--socket", metavar="PATH", help="the gateway (default: found by itself)")
    join.add_argument("--json-log", action="store_true", help="write the log as JSON lines")
    join.add_argument(
        "--open-to-every-user-of-this-host",
        action="store_true",
        help="be there though the router, on loopback, asks nobody who he is: all may then drive the robot",
    )
    join.add_argument(
        "--as-admin",
        action="store_true",
        help="let everybody in the fleet take the robot from its owner, and recover it",
    )
    for sub in (looks, watch, stop, join):
        sub.add_argument(
            "--fleet",
            metavar="FILE",
            help="its router, as tcp/HOST:PORT, tls/HOST:PORT or a file of zenoh's configuration (default: TA2_FLEET)",
        )
    for sub in (looks, watch, stop):
        sub.add_argument(
            "--timeout", dest="timeout_s", type=seconds, default=3.0, metavar="S", help="longest wait [s] (default 3)"
        )
    for sub in (looks, stop):
        sub.add_argument("--json", action="store_true", help="print JSON on standard output")
