"""`ta2 web`: the page and the HTTP API of `gateway.web`, on loopback alone, until Ctrl-C."""

from __future__ import annotations

import json
import secrets
import socket
import sys
from argparse import Namespace

from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, failure
from gateway.recording.bag_writer import needed
from gateway.settings import toml_file

__all__ = ["carry_out"]

HOST = "127.0.0.1"
ENDING_S = 2
"""How long open pages are waited for at the end [s]."""
SELF = (sys.executable, "-m", "gateway.cli")
"""What this is a command of, for another one."""
MOST_MESSAGE_BYTES = 16_384


def carry_out(options: Namespace) -> ExitStatus:
    """Serve until Ctrl-C or SIGTERM.

    Raises:
        ConfigError: The settings are wrong.
        Rejected: BAD_REQUEST, the extra `web` is missing, the port is taken, or the gateway's address makes no sense.
    """
    uvicorn = needed("uvicorn", "web")
    needed("prometheus_client", "web")
    needed("starlette", "web")
    if options.video:
        needed("av", "video")
        needed("PIL", "video")
    from gateway.web.beside import Beside
    from gateway.web.body import Body
    from gateway.web.errand import Errand
    from gateway.web.server import application

    at = () if options.target is None else ("--at", options.target)
    errands = {"check": Errand(*SELF, "check", *at, "--json")}
    if options.recordings is not None:
        errands["recordings"] = Errand(*SELF, "bag", "list", str(options.recordings), "--json")
    beside = Beside(body=Body(toml_file.load(options.config)), errands=errands)
    token = secrets.token_urlsafe(24)
    with _listening(options.port) as listener:
        port = listener.getsockname()[1]
        video_port = options.video_port if options.video else None
        app = application(
            options.target, token, port, opens_metrics=options.metrics, video_port=video_port, beside=beside
        )
        config = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            ws="websockets-sansio",
            ws_max_size=MOST_MESSAGE_BYTES,
            server_header=False,
            timeout_graceful_shutdown=ENDING_S,
        )
        url = f"http://{HOST}:{port}/"
        if options.json:
            print(json.dumps({"ok": True, "url": url, "token": token}), flush=True)
        else:
            print(f"{url}?token={token}", flush=True)
            print("open that address; Ctrl-C ends it. A stop on the page needs no secret.", file=sys.stderr)
        uvicorn.Server(config).run(sockets=[listener])
    return ExitStatus.OK


def _listening(port: int) -> socket.socket:
    try:
        return socket.create_server((HOST, port))
    except OSError as error:
        message = f"{HOST}:{port} cannot be listened on: {error.strerror}"
        hint = "take another one: --port N"
        raise failure(Code.BAD_REQUEST, message, field="--port", value=str(port), hint=hint) from None
