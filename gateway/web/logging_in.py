"""The way in where there are users: a page that asks for name and password, and stops all the same; and out again.

GET  /login                  the page
POST /api/login              {"name": ..., "password": ...}; the session becomes a cookie. 401 wrong, 429 too many, 503 broken
POST /api/logout             ends it, and what is open by it: a page that owns the robot is lost
"""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

import msgspec
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Route

from gateway.errors import GatewayError
from gateway.web.access import SESSION
from gateway.web.logins import SESSION_S, WINDOW_S, Logins, TooMany
from gateway.web.messages import LoginAsked
from gateway.web.stopping import body_of

__all__ = ["login_routes"]

_log = logging.getLogger(__name__)

PAGE = Path(__file__).parent / "static" / "login.html"
BODY_S = 5.0


def login_routes(logins: Logins | None, cookie: str, *, is_tls: bool) -> list[BaseRoute]:
    """Return them.

    Args:
        logins: Sessions and failures; None where there are no users, and no way in.
        cookie: Its name.
        is_tls: Whether the cookie goes by TLS only.
    """

    async def page(_: Request) -> Response:
        _require(logins)
        return FileResponse(PAGE)

    async def login(request: Request) -> Response:
        there = _require(logins)
        try:
            asked = msgspec.json.decode(await asyncio.wait_for(body_of(request), BODY_S), type=LoginAsked)
        except (msgspec.MsgspecError, UnicodeError, RecursionError, asyncio.TimeoutError) as error:
            return _refused(400, "BAD_REQUEST", str(error) or "nothing came", "name and password as JSON")
        host = "unknown" if request.client is None else request.client.host
        try:
            word = await there.login(asked.name, asked.password, host)
        except TooMany:
            hint = "a stop needs no login; else wait some minutes"
            response = _refused(429, "FORBIDDEN", "too many logins failed, or wait", hint)
            response.headers["Retry-After"] = f"{WINDOW_S:.0f}"
            return response
        except (GatewayError, OSError, ValueError) as error:  # of the file of users: no stranger is told where it is
            _log.error("nobody can log in: %s", error)
            hint = "a stop needs no login; see the log of ta2 web"
            return _refused(503, "INTERNAL", "logins do not work now", hint)
        if word is None:
            return _refused(401, "FORBIDDEN", "name or password is wrong", "a stop needs no login")
        response = JSONResponse({})
        response.set_cookie(cookie, word, max_age=int(SESSION_S), secure=is_tls, httponly=True, samesite="strict")
        return response

    async def logout(request: Request) -> Response:
        there = _require(logins)
        if SESSION in request.scope:
            there.logout(request.scope[SESSION])
        response = JSONResponse({})
        response.delete_cookie(cookie, secure=is_tls, httponly=True, samesite="strict")
        return response

    return [
        Route("/login", page),
        Route("/api/login", login, methods=["POST"]),
        Route("/api/logout", logout, methods=["POST"]),
    ]


def _require(logins: Logins | None) -> Logins:
    if logins is None:
        raise HTTPException(404, "there are no users here")
    return logins


def _refused(status: int, code: str, message: str, hint: str) -> JSONResponse:
    return JSONResponse({"error": {"code": code, "message": message, "hint": hint}}, status_code=status)
