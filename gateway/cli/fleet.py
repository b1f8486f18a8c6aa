"""`ta2 fleet`: the robots of a zenoh network at a glance, a stop for many, and being one of them.

A stop is sent first, to all at once, and asked about afterwards: what one robot does keeps no other's stop or answer. What
comes from the fleet is untrusted: names that are none are left out, and what cannot be read is none.
"""

from __future__ import annotations

import contextlib
import json
import re
import sys
import threading
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial

import zenoh
from rich.console import Console
from rich.live import Live
from rich.table import Table

from gateway.api import protocol
from gateway.api.listener import is_loopback
from gateway.cli.motion.stopping import signed
from gateway.cli.terminal.ending import ExitStatus, Interrupted, for_stopping
from gateway.cli.terminal.style import state_style
from gateway.client.blocking import opened
from gateway.client.connection.over_zenoh import Credentials, client_configuration
from gateway.errors import Code, GatewayError, failure

__all__ = ["carry_out", "demand_known"]

Views = Mapping[str, "protocol.Snapshot | None"]


def carry_out(options: Namespace) -> ExitStatus:
    """Do what `options.verb` says.

    Raises:
        GatewayError: Nobody answers at the router, or it is none; after a stop, nobody knows whether the robots stopped.
    """
    try:
        address = protocol.fleet_address(options.fleet)
        if options.verb == "join":
            return _join(options, address)
        with opened(partial(_open, address, options.timeout_s)) as session:
            return {"list": _list, "watch": _watch, "stop": _stop}[options.verb](options, session)
    except protocol.AddressRefused as error:
        raise failure(Code.BAD_REQUEST, str(error), field="target", hint="see `ta2 fleet --help`") from None
    except GatewayError as error:
        raise (for_stopping(error) if options.verb == "stop" else error) from None


def _open(address: protocol.Address, timeout_s: float) -> zenoh.Session:
    """Connect to a fleet's router. Raises `Disconnected` when it does not let us in."""
    try:
        return zenoh.open(client_configuration(address, Credentials(), timeout_s))
    except zenoh.ZError as error:
        message = f"the fleet's router does not answer at {address} ({str(error).partition(' at /')[0]})"
        raise failure(Code.DISCONNECTED, message, hint="check its address, users and certificates") from None


def _gateways(session: zenoh.Session, timeout_s: float) -> Counter[str]:
    """Return how many there are of each name. Raises `Disconnected` when the router has gone."""
    tokens = session.liveliness().get(f"{protocol.FLEET_ROOT}/*/{protocol.MEMBER_TOKENS}", timeout=timeout_s)
    names = [str(token.ok.key_expr).split("/")[1] for token in tokens if token.ok is not None]
    if not session.info.routers_zid():
        raise failure(Code.DISCONNECTED, "the fleet's router has gone", hint="look at its log")
    return Counter(sorted(name for name in names if protocol.ROBOT_NAME.fullmatch(name)))


def _asked(
    session: zenoh.Session, robots: Sequence[str], key: str, payload: bytes, timeout_s: float
) -> list[tuple[str, bytes]]:
    """Return which robots answered what; all are asked at once."""
    answers: list[tuple[str, bytes]] = []
    finished = threading.Semaphore(0)

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            answers.append((str(reply.ok.key_expr).split("/")[1], reply.ok.payload.to_bytes()))

    for robot in robots:
        session.get(
            f"{protocol.FLEET_ROOT}/{robot}/{key}",
            zenoh.handlers.Callback(take, finished.release, indirect=False),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            payload=payload,
            encoding=protocol.JSON if payload else protocol.MSGPACK,
            timeout=timeout_s,
            express=True,
        )
    until_s = time.monotonic() + timeout_s
    for _ in robots:
        finished.acquire(timeout=max(0.0, until_s - time.monotonic()))
    return [(name, answer) for name, answer in answers if protocol.ROBOT_NAME.fullmatch(name)]


def _look(session: zenoh.Session, timeout_s: float) -> tuple[Counter[str], Views]:
    gateways, views = _gateways(session, timeout_s), {}
    for name, payload in _asked(session, ["*"], protocol.SNAPSHOT_KEY, b"", timeout_s):
        with contextlib.suppress(protocol.Malformed):
            views[name] = protocol.decode_snapshot(payload)
    return gateways, {name: views.get(name) for name in gateways}


def _list(options: Namespace, session: zenoh.Session) -> ExitStatus:
    gateways, views = _look(session, options.timeout_s)
    if options.json:
        rows = [
            {"name": name, "gateways": gateways[name], "answers": view is not None}
            | ({} if view is None else {"state": view.shown, "linked": view.link.fresh, "owner": view.lease.name})
            for name, view in views.items()
        ]
        print(json.dumps({"ok": True, "robots": rows}, ensure_ascii=False))
    else:
        Console(highlight=False, markup=False).print(_table(gateways, views))
    return ExitStatus.OK


def _watch(options: Namespace, session: zenoh.Session) -> ExitStatus:
    with Live(console=Console(highlight=False, markup=False), auto_refresh=False) as live:
        try:
            while True:
                live.update(_table(*_look(session, options.timeout_s)), refresh=True)
                time.sleep(options.period_s)
        except Interrupted:
            raise
        except KeyboardInterrupt:
            return ExitStatus.OK


def _table(gateways: Counter[str], views: Views) -> Table:
    table = Table("robot", "state", "link", "owner", "what to look at")
    for name, view in views.items():
        if view is None:
            cells, style = ("?", "?", "", "its gateway does not answer"), "bold red"
        else:
            trouble = ", ".join(view.latches) or ", ".join(finding.code for finding in view.findings[:1])
            cells = (view.shown, "fresh" if view.link.fresh else "stale", view.lease.name, trouble)
            style = state_style(view)
        if gateways[name] > 1:
            cells, style = (*cells[:3], f"{gateways[name]} gateways have this name: rename all but one"), "bold red"
        table.add_row(name, *("".join(c if c.isprintable() else "?" for c in cell) for cell in cells), style=style)
    return table


def _stop(options: Namespace, session: zenoh.Session) -> ExitStatus:
    wrong = next((name for name in options.names if protocol.ROBOT_NAME.fullmatch(name) is None), None)
    if wrong is not None:
        raise protocol.AddressRefused(f"{wrong!r} is no name of a robot")
    robots = ["*"] if options.all else options.names
    said = signed(options.reason or "ta2 fleet stop")
    payload = protocol.encode({"name": "ta2 fleet stop", "reason": said}, protocol.JSON)
    for robot in robots:
        key = f"{protocol.FLEET_ROOT}/{robot}/{protocol.STOP_KEY}"
        session.put(
            key, payload, encoding=protocol.JSON, express=True, congestion_control=zenoh.CongestionControl.BLOCK
        )
    gateways = _gateways(session, options.timeout_s)  # now: one that is frozen is forgotten in 2 s
    answers = _asked(session, robots, protocol.STOP_KEY, payload, options.timeout_s)
    names = sorted({*(gateways if options.all else options.names), *(name for name, _ in answers)})
    why = {name: _unconfirmed(gateways[name], [answer for whose, answer in answers if whose == name]) for name in names}
    is_ok = bool(names) and not any(why.values())
    if options.json:
        rows = [{"name": name, "confirmed": not why[name], "why": why[name]} for name in names]
        print(json.dumps({"ok": is_ok, "robots": rows}))
    else:
        for name in names:
            print(
                f"{name}: NOT CONFIRMED, {why[name]}" if why[name] else f"{name}: stopped; refused until `ta2 recover`"
            )
    if not is_ok:
        who = ", ".join(name for name in names if why[name]) or "no robot is in the fleet"
        print(f"use the physical emergency stop: {who}", file=sys.stderr)
    return ExitStatus.OK if is_ok else ExitStatus.UNKNOWN if names else ExitStatus.NO_GATEWAY


def _unconfirmed(gateways: int, answers: Sequence[bytes]) -> str:
    """Return why nobody knows whether a robot has stopped; empty when all gateways of its name said that the stop left."""
    if not (gateways or answers):
        return "no robot of that name is in the fleet"
    if len(answers) < gateways:
        return f"{len(answers)} of {gateways} gateways of that name answered" if gateways > 1 else "no answer came"
    try:
        replies = [protocol.decode_reply(answer, protocol.JSON) for answer in answers]
    except protocol.Malformed:
        return "its answer cannot be read"
    left = all(reply.refusal is None and reply.facts.get("stop_undelivered") is False for reply in replies)
    return "" if left else "its gateway has no transport to the robot"


def _join(options: Namespace, fleet: protocol.Address) -> ExitStatus:
    from msgspec.structs import replace

    from gateway.fleet.member import Member
    from gateway.process.log import configure_log

    if protocol.ROBOT_NAME.fullmatch(options.name) is None:
        raise protocol.AddressRefused(
            f"{options.name!r} is no name: up to 63 letters, digits, _, . and -, first no mark"
        )
    gateway = protocol.parse_address(options.socket or str(protocol.find_socket())).path
    if gateway is None:
        raise protocol.AddressRefused(f"{options.socket!r} is no path of a gateway's socket, beside which it must be")
    demand_known(fleet, is_open=options.open_to_every_user_of_this_host)
    configure_log(is_json=options.json_log)
    member = Member(replace(fleet, robot=options.name), options.name, gateway, as_admin=options.as_admin)
    try:
        member.run()
    finally:
        member.close()
    return ExitStatus.OK


def demand_known(fleet: protocol.Address, *, is_open: bool) -> None:
    """Refuse a router at which strangers could drive the robot; the rules are those of a gateway's own port.

    Args:
        fleet: The router.
        is_open: Whether it was said in words that every user of this host may.

    Raises:
        Rejected: BAD_REQUEST. It is beyond this host without TLS, or nobody there is asked who he is.
    """
    try:
        config = client_configuration(fleet, Credentials(), 1.0)
        said = {key: json.loads(config.get_json(key)) for key in ("connect/endpoints", "transport")}
    except (zenoh.ZError, ValueError) as error:
        raise protocol.AddressRefused(f"{fleet} is no configuration of zenoh: {error}") from None
    routers = said["connect/endpoints"] if isinstance(said["connect/endpoints"], list) else []
    tls, user = said["transport"]["link"]["tls"] or {}, said["transport"]["auth"]["usrpwd"] or {}
    is_known = bool(user.get("user") or (tls.get("enable_mtls") and tls.get("connect_certificate")))
    hosts = [re.split(r"[/?#]", str(router) + "//")[1].rpartition(":")[0] for router in routers]
    is_here = bool(hosts) and all(map(is_loopback, hosts))
    if not is_here and not (routers and all(str(router).startswith("tls/") for router in routers)):
        why = "beyond this host a router needs TLS, tls/HOST:PORT in connect.endpoints"
    elif not is_here and not tls.get("root_ca_certificate"):
        why = "TLS needs root_ca_certificate: the router could be anybody"
    elif is_open and (is_known or not is_here):
        why = "--open-to-every-user-of-this-host is for a router on loopback that knows nobody"
    elif not (is_known or is_open):
        why = "a user, or a certificate with enable_mtls, is needed: everybody could drive the robot from there"
    else:
        return
    hint = "see docs/how-to/fleets.md; on loopback --open-to-every-user-of-this-host says that all may"
    raise failure(Code.BAD_REQUEST, f"{fleet}: {why}", field="target", value=str(fleet), hint=hint)
