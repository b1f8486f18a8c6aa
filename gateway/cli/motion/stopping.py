"""`ta2 stop`, `ta2 estop`, `ta2 recover`: what must work in a hurry. Imports the client and nothing else.

A stop that may not have stopped the robot says so with the only hint that counts, and with an exit status of its own.
"""

from __future__ import annotations

import contextlib
import getpass
import json
from argparse import Namespace

from gateway.api.keys import printable
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus, for_stopping, report, undelivered
from gateway.client import StopResult
from gateway.errors import Disconnected, GatewayError

__all__ = ["recover", "signed", "stop"]

DONE = {
    "stop": "stopped: arms brake and are held with their grip, chassis and lift stop",
    "estop": "stopped: the robot pauses, the grip is lost",
}


def stop(options: Namespace) -> ExitStatus:
    """Stop everything; `options.command` is `stop` or `estop`.

    Raises:
        GatewayError: Nobody knows whether it stopped.
    """
    command, target = options.command, options.target
    said = signed(" ".join(options.reason) or f"ta2 {command}")
    _drop(command, target, said)  # before anything else: to connect takes a while, and in a crowd a long one
    try:
        with connected(command, target, options.timeout_s, greet=False) as robot:
            result = robot.stop(said) if command == "stop" else robot.estop(said)
    except GatewayError as error:
        found = _by_guard(command, target, said) if isinstance(error, Disconnected) else None
        if found is None:
            raise for_stopping(error) from None
        result = found
    if result.undelivered:
        return report(undelivered(), as_json=options.json)
    who = "by the guard, the gateway itself is dead: " if result.by_guard else ""
    if options.json:
        print(json.dumps({"ok": True, "undelivered": False, "by_guard": result.by_guard}))
    else:
        print(f"{who}{DONE[command]}; motion is refused until `ta2 recover`")
    return ExitStatus.OK


def _drop(command: str, target: str | None, said: str) -> None:
    """Drop the stop into the gateway's pipe, where there is one."""
    from gateway.api import protocol
    from gateway.api.stop_pipe import drop_stop

    with contextlib.suppress(protocol.AddressRefused):  # told when it is to be connected to
        path = protocol.find_socket() if target is None else protocol.parse_address(target).path
        if path is not None:
            key = protocol.STOP_KEY if command == "stop" else protocol.ESTOP_KEY
            drop_stop(path, key, protocol.encode({"name": f"ta2 {command}", "reason": said}, protocol.JSON))


def _by_guard(command: str, target: str | None, said: str) -> StopResult | None:
    """Ask the guard of a daemon that is not there; None when no guard did anything."""
    from gateway.api import protocol
    from gateway.client.asking.guard_stop import stop_at_guard

    try:
        address = str(protocol.find_socket()) if target is None else target
    except protocol.AddressRefused:
        return None
    return stop_at_guard(address, "stop" if command == "stop" else "estop", said, f"ta2 {command}")


def signed(reason: str) -> str:
    """Return a reason with who gave it: of those who do not own the robot, the gateway knows no name.

    Whatever a shell was told, and whatever its user is called, keeps no stop away.
    """
    with contextlib.suppress(KeyError, OSError):  # neither variable nor account
        reason = f"{reason} ({getpass.getuser()})"
    return printable(reason)


def recover(options: Namespace) -> ExitStatus:
    """Clear what holds motion off, and say what it was.

    Raises:
        NotReady: LATCH_PERSISTS, or the robot cannot be seen; ENDPOINT_SILENT without a reason.
    """
    reason = " ".join(options.reason)
    with connected("recover", options.target, options.timeout_s) as robot:
        latches = dict(robot.state.latches)
        silent = [endpoint.name for endpoint in robot.state.endpoints if endpoint.is_silent]
        robot.recover(signed(reason) if reason else "")
    if options.json:
        print(json.dumps({"ok": True, "cleared": latches, "dismissed": silent}, ensure_ascii=False))
        return ExitStatus.OK
    for name in silent:
        print(f"stop endpoint {name!r} was let go")
    if latches:
        print("\n".join(["cleared; nothing moves by itself:", *(f"  {code}: {why}" for code, why in latches.items())]))
    elif not silent:
        print("nothing was held off")
    return ExitStatus.OK
