"""`ta2 link`: the state of the wire on one page, from a gateway that runs or by a look of its own. For scripts as JSON.

A gateway is asked first of all: it knows what it has seen for as long as it runs, and asking it costs the robot nothing.
Who has no gateway that starts names the robot (`--robot`, `--config`), and a session that can send nothing looks for some
seconds. Both give the same facts, and the same page is made of them.
"""

from __future__ import annotations

import json
import platform
from dataclasses import asdict, replace
from importlib.metadata import PackageNotFoundError, version

import msgspec
from rich.console import Console
from rich.text import Text

from gateway import __version__
from gateway.api.protocol import Wire
from gateway.cli.looking.link_findings import findings_of
from gateway.cli.looking.link_page import lines
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, Disconnected, failure, to_exception

__all__ = ["document", "show_link", "show_look"]

CHOICE = "OTHER_NAMESPACE"


def show_link(target: str | None, timeout_s: float, *, as_json: bool) -> ExitStatus:
    """Print what a gateway knows of its wire.

    Args:
        target: Where the gateway is; None finds its socket.
        timeout_s: Longest wait for it [s].
        as_json: Whether to print JSON.

    Raises:
        Disconnected: No gateway answers; how to look without one is the hint.
        ProtocolError: The gateway is of a release that does not tell.
    """
    try:
        with connected("link", target, timeout_s) as robot:
            info, wire = robot.info, robot.routes().wire
    except Disconnected as error:
        hint = f"{error.hint}; to look without one: `ta2 link --robot ADDRESS`"
        raise to_exception(replace(error.refusal, hint=hint)) from None
    if wire is None:
        message = f"the gateway is of release {info.version}, which does not tell the state of its wire"
        raise failure(Code.UNSUPPORTED_VERSION, message)
    seen_by = f"the gateway, release {info.version}, pid {info.pid}"
    _print(wire, seen_by, is_gateway=True, as_json=as_json)
    return ExitStatus.OK


def show_look(wire: Wire, *, as_json: bool) -> ExitStatus:
    """Print what a look without a gateway saw; NO_GATEWAY when nobody answers, REFUSED when there are several robots."""
    _print(wire, f"a look of {__version__} without a gateway", is_gateway=False, as_json=as_json)
    if not wire.is_up:
        return ExitStatus.NO_GATEWAY
    is_choice = len(wire.robots) > 1 and any(finding.code == CHOICE for finding in findings_of(wire))
    return ExitStatus.REFUSED if is_choice else ExitStatus.OK


def document(wire: Wire, seen_by: str, *, is_gateway: bool) -> dict[str, object]:
    """Return it for scripts: `ok` when nothing is wrong, findings, and all that was seen."""
    found = findings_of(wire)
    return {
        "ok": wire.is_up and all(finding.level == "info" for finding in found),
        "seen_by": seen_by,
        "is_gateway": is_gateway,
        "here": _here(),
        "findings": [asdict(finding) for finding in found],
        "wire": msgspec.to_builtins(wire),
    }


def _print(wire: Wire, seen_by: str, *, is_gateway: bool, as_json: bool) -> None:
    if as_json:
        print(json.dumps(document(wire, seen_by, is_gateway=is_gateway), ensure_ascii=False, indent=2))
        return
    console = Console(highlight=False)
    here = _here()
    said = f"ta2 link {here['ta2']}  zenoh {here['zenoh']}, Python {here['python']}, {here['system']}"
    for line in (Text(said, style="dim"), *lines(wire, seen_by, is_gateway)):
        line.rstrip()
        console.print(line, soft_wrap=True)


def _here() -> dict[str, str]:
    """Return what runs here: whoever is asked for help asks for it."""
    try:
        zenoh = version("eclipse-zenoh")
    except PackageNotFoundError:
        zenoh = "unknown"
    return {
        "ta2": __version__,
        "zenoh": zenoh,
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
    }
