"""Who may come in. The server listens on loopback alone, where any user of the host and any page of any site can knock.

Rules
    * The name in `Host` is one of loopback's: another site's name that was made to point here (DNS rebinding) is none.
    * What a browser sends for another site's page (`Origin`, `Sec-Fetch-Site`) is refused, whatever it asks for.
    * Everything but the page's own files and a stop takes the secret that `ta2 web` prints: as a cookie that no script and no
      other site gets, or as `Authorization: Bearer`. A stop takes none: nothing shall come between a person and a stop.
    * A page may load nothing from elsewhere, run no script but its own file, and be framed by nobody.
"""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["OPEN_PATHS", "Door", "cookie_name"]

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
OPEN_PATHS = frozenset({"/", "/static/page.js", "/static/page.css", "/api/stop", "/api/estop"})
UNKNOWN = "the secret is missing or wrong"
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src "
    "'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


def cookie_name(port: int) -> str:
    """Return the name of the cookie: browsers keep cookies of all ports of a host together."""
    return f"ta2_web_{port}"


class Door:
    """Lets requests in, or not. A part of the application (ASGI).

    Args:
        app: What is behind it.
        token: The secret.
        port: Where it listens, for the cookie's name.
        opens_metrics: Whether `/metrics` takes no secret.
    """

    def __init__(self, app: ASGIApp, token: str, port: int, *, opens_metrics: bool) -> None:
        self._app = app
        self._token = token.encode()
        self._cookie = cookie_name(port)
        self._open = OPEN_PATHS | ({"/metrics"} if opens_metrics else frozenset())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 401 or 403, or go on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        why_not = self._why_not(scope["path"], Headers(scope=scope))
        if why_not is None:
            await self._app(scope, receive, sent)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": why_not})
        else:
            error = {
                "error": {"code": "FORBIDDEN", "message": why_not, "hint": "open the address that `ta2 web` printed"}
            }
            status, more = (401, {"WWW-Authenticate": "Bearer"}) if why_not == UNKNOWN else (403, None)
            await JSONResponse(error, status_code=status, headers=more)(scope, receive, sent)

    def _why_not(self, path: str, headers: Mapping[str, str]) -> str | None:
        host = headers.get("host", "")
        if _name(f"//{host}") not in LOOPBACK:
            return "the name in Host is none of this host's own"
        origin = headers.get("origin")
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            return "a page of another site may not ask for anything here"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin") and path != "/":
            return "a page of another site may not ask for anything here"
        if path in self._open or self._is_known(headers):
            return None
        return UNKNOWN

    def _is_known(self, headers: Mapping[str, str]) -> bool:
        scheme, _, bearer = headers.get("authorization", "").partition(" ")
        said = [bearer.strip()] if scheme.lower() == "bearer" else []
        try:
            morsel = SimpleCookie(headers.get("cookie", "")).get(self._cookie)
            said += [] if morsel is None else [morsel.value]
        except CookieError:
            pass
        return any(hmac.compare_digest(word.encode(), self._token) for word in said)


def _name(address: str) -> str | None:
    try:
        return urlsplit(address).hostname
    except ValueError:
        return None
