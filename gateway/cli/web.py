"""`ta2 web`: the page and the HTTP API of `gateway.web`, until Ctrl-C: on loopback, or beyond it by TLS for users."""

from __future__ import annotations

import getpass
import json
import secrets
import socket
import ssl
import sys
from argparse import Namespace
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path

from gateway.cli.terminal.ending import ExitStatus, line_of
from gateway.errors import Code, GatewayError, failure
from gateway.recording.bag_writer import needed
from gateway.settings import toml_file

__all__ = ["carry_out"]

ENDING_S = 2
"""How long open pages are waited for at the end [s]."""
SELF = (sys.executable, "-m", "gateway.cli")
"""What this is a command of, for another one."""
MOST_MESSAGE_BYTES = 16_384
KEPT_BYTES = 8192
"""So much of what a peer sends is kept until it is read: one turn of the event loop goes through no more of each."""
UNTAKEN_MS = 15_000
"""Who takes nothing for so long is gone, with all that was kept for him [ms]."""
CIPHERS = "ECDHE+AESGCM:ECDHE+CHACHA20"
"""Of TLS 1.2; those of 1.3 are all good."""


def carry_out(options: Namespace) -> ExitStatus:
    """Serve until Ctrl-C or SIGTERM, or add a user.

    Raises:
        Rejected: BAD_REQUEST, the extra `web` is missing, the port is taken, the gateway's address makes no sense, or who
            may come is not settled: certificate, users and names, beyond loopback.
    """
    if options.add_user is not None:
        return _add_user(options)
    uvicorn = needed("uvicorn", "web")
    needed("prometheus_client", "web")
    needed("starlette", "web")
    if options.video:
        needed("av", "video")
        needed("PIL", "video")
    address = _address(options)
    from gateway.web.access import Keys
    from gateway.web.beside import Beside
    from gateway.web.body import Body
    from gateway.web.job import Job
    from gateway.web.listening import FairListener, PageProtocol, RequestProtocol, open_more_files
    from gateway.web.logins import Logins
    from gateway.web.server import application
    from gateway.web.users import is_password, read_users

    at = () if options.target is None else ("--at", options.target)
    jobs = {"check": Job(*SELF, "check", *at, "--json")}
    if options.recordings is not None:
        jobs["recordings"] = Job(*SELF, "bag", "list", str(options.recordings), "--json")
    body, why_no_body = None, ""
    try:
        body = Body(toml_file.load(options.config))
    except GatewayError as error:  # the page's stop needs no body
        why_no_body = line_of(error)
        print(f"the page shows the robot in no three dimensions: {why_no_body}", file=sys.stderr)
    beside = Beside(body=body, why_no_body=why_no_body, jobs=jobs)
    users = options.users
    if users is not None:
        read_users(users)
    if is_tls := options.certificate is not None:
        _require_certificate(options.certificate, options.key)
    token = secrets.token_urlsafe(24) if users is None else None

    def is_right(name: str, password: str) -> bool:
        return is_password(password, read_users(users).get(name))

    with _listening(address, options.port) as listening:
        port = listening.getsockname()[1]
        names = [name.lower().strip("[]") for name in options.name] + ([] if address.is_unspecified else [str(address)])
        keys = Keys(
            token=token,
            logins=None if users is None else Logins(is_right),
            names=frozenset(names),
            is_tls=is_tls,
        )
        video_port = options.video_port if options.video else None
        app = application(
            options.target, keys, port, opens_metrics=options.metrics, video_port=video_port, beside=beside
        )
        config = uvicorn.Config(
            app,
            loop="asyncio",
            log_level="warning",
            access_log=False,
            proxy_headers=False,  # who is in front of it could be anybody on loopback
            http=RequestProtocol,
            ws=PageProtocol,
            ws_max_size=MOST_MESSAGE_BYTES,
            server_header=False,
            ssl_certfile=options.certificate,
            ssl_keyfile=options.key,
            ssl_ciphers=CIPHERS,
            timeout_graceful_shutdown=ENDING_S,
        )
        host = names[0] if names else str(address)
        url = f"http{'s' if is_tls else ''}://{f'[{host}]' if ':' in host else host}:{port}/"
        if options.json:
            print(json.dumps({"ok": True, "url": url, "token": token}), flush=True)
        else:
            print(url if token is None else f"{url}?token={token}", flush=True)
            print("open that address; Ctrl-C ends it. A stop on the page needs no secret.", file=sys.stderr)
        open_more_files()
        listener = listening if address.is_loopback else FairListener(listening)
        with listener:
            uvicorn.Server(config).run(sockets=[listener])
    return ExitStatus.OK


def _address(options: Namespace) -> IPv4Address | IPv6Address:
    """Return where to listen; refuse what would let somebody in unknown, or be overheard."""
    try:
        address = ip_address(options.host)
    except ValueError:
        hint = "an address of this host, 0.0.0.0 or [::] for all; names that it is called by: --name"
        raise failure(Code.BAD_REQUEST, f"{options.host!r} is no IP address", field="--host", hint=hint) from None
    given = {"--certificate": options.certificate, "--key": options.key, "--users": options.users}
    missing = [] if address.is_loopback else [name for name, value in given.items() if value is None]
    if missing:
        message = f"beyond loopback passwords and motion go by TLS, for users who log in: {', '.join(missing)} missing"
        hint = "see docs/how-to/web.md, or let them come by ssh: ssh -L 8700:127.0.0.1:8700 HOST"
        raise failure(Code.BAD_REQUEST, message, field="--host", value=str(address), hint=hint)
    if (options.certificate is None) != (options.key is None):
        raise failure(Code.BAD_REQUEST, "a certificate and its key belong together", hint="--certificate and --key")
    if address.is_unspecified and not options.name:
        message = "the names and addresses by which browsers call this host are needed"
        raise failure(Code.BAD_REQUEST, message, field="--name", hint="--name robot.lab --name 192.168.1.9")
    return address


def _require_certificate(certificate: Path, key: Path) -> None:
    try:
        ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(certificate, key, password=lambda: "")
    except (OSError, ValueError) as error:  # of which SSLError is one
        message = f"no certificate and key of a server: {certificate}, {key}: {error}"
        hint = "PEM files that belong together, the key without a passphrase"
        raise failure(Code.BAD_REQUEST, message, field="--certificate", hint=hint) from None


def _add_user(options: Namespace) -> ExitStatus:
    from gateway.web.users import add_user

    if options.users is None:
        raise failure(Code.BAD_REQUEST, "in which file?", field="--users", hint="--users FILE")
    try:
        if sys.stdin.isatty():
            password = getpass.getpass(f"Password of {options.add_user}: ")
            again = getpass.getpass("Once more: ")
        else:
            password = again = sys.stdin.readline().rstrip("\r\n")
    except (EOFError, UnicodeError):
        password = again = ""
    if password != again:
        raise failure(Code.BAD_REQUEST, "both passwords differ", hint="type it again; nothing was written")
    add_user(options.users, options.add_user, password)
    print(f"{options.users}: {options.add_user} may log in")
    return ExitStatus.OK


def _listening(address: IPv4Address | IPv6Address, port: int) -> socket.socket:
    try:
        family = socket.AF_INET if address.version == 4 else socket.AF_INET6
        both = family == socket.AF_INET6 and address.is_unspecified and socket.has_dualstack_ipv6()
        listening = socket.create_server((str(address), port), family=family, dualstack_ipv6=both)
    except OSError as error:
        message = f"{address}:{port} cannot be listened on: {error.strerror}"
        hint = "take another one: --port N, --host ADDR"
        raise failure(Code.BAD_REQUEST, message, field="--port", value=str(port), hint=hint) from None
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, KEPT_BYTES)  # what it accepts has both, too
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
        listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNTAKEN_MS)
    return listening
