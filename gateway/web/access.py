"""Who may come in. On loopback any user of the host and any page of any site can knock, beyond it any host of the network.

Rules
    * The name in `Host` is one of loopback's, or one that the server was given: another site's name that was made to point
      here (DNS rebinding) is none.
    * What a browser sends for another site's page (`Origin`, `Sec-Fetch-Site`) is refused, whatever it asks for.
    * Everything but the page's own files and a stop takes the secret that `ta2 web` prints, or that of a login: as a cookie
      that no script and no other site gets, or as `Authorization: Bearer`. A stop takes none: nothing shall come between a
      person and a stop.
    * What goes on for long by a login ends with it.
    * Who sends a body that may be long is answered once: the rest of it would be read, chunk by chunk, for ever.
    * A page may load nothing from elsewhere, run no script but its own file, and be framed by nobody.
"""

from __future__ import annotations

import asyncio
import hmac
from collections.abc import Awaitable, Mapping
from urllib.parse import urlsplit

from msgspec import Struct
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.web.logins import Logins, Session
from gateway.web.stopping import MOST_BODY_BYTES

__all__ = ["OPEN_PATHS", "SESSION", "AccessControl", "Keys", "cookie_name"]

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
OPEN_PATHS = frozenset({"/", "/static/page.js", "/static/page.css", "/api/stop", "/api/estop"})
LOGIN_PATHS = frozenset({"/login", "/static/login.js", "/api/login"})
UNKNOWN = "the secret is missing or wrong"
SESSION = "ta2.session"
"""Under this name the application finds the session of who asks, where there is one."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src "
    "'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
TLS_HEADERS = {"Strict-Transport-Security": "max-age=2592000"}


class Keys(Struct, frozen=True, kw_only=True):
    """What lets a request in; either of the first two.

    Attributes:
        token: The secret that was printed.
        logins: Who is logged in.
        names: Of this server in `Host`, beside those of loopback.
        is_tls: Whether it is reached by TLS only.
    """

    token: str | None = None
    logins: Logins | None = None
    names: frozenset[str] = frozenset()
    is_tls: bool = False


def cookie_name(port: int, *, is_tls: bool = False) -> str:
    """Return the name of the cookie: browsers keep cookies of all ports of a host together.

    Nobody without TLS can set the one that is for TLS.
    """
    return f"{'__Host-' if is_tls else ''}ta2_web_{port}"


class AccessControl:
    """Lets requests in, or not. A part of the application (ASGI).

    Args:
        app: What is behind it.
        keys: What lets a request in.
        port: Where it listens, for the cookie's name.
        opens_metrics: Whether `/metrics` takes no secret.
    """

    def __init__(self, app: ASGIApp, keys: Keys, port: int, *, opens_metrics: bool) -> None:
        self._app = app
        self._keys = keys
        self._cookie = cookie_name(port, is_tls=keys.is_tls)
        self._names = LOOPBACK | keys.names
        self._headers = HEADERS | (TLS_HEADERS if keys.is_tls else {})
        self._open = OPEN_PATHS | ({"/metrics"} if opens_metrics else frozenset())
        if keys.logins is not None:
            self._open |= LOGIN_PATHS

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 401 or 403, or go on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return

        path, headers = scope["path"], Headers(scope=scope)
        is_long = "transfer-encoding" in headers or int(headers.get("content-length", 0)) > MOST_BODY_BYTES
        added = self._headers | ({"Connection": "close"} if is_long else {})

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(added)
            await send(message)

        known = self._known(headers)
        why_not = self._why_not(path, headers, is_known=known is not None)
        if isinstance(known, Session):
            scope[SESSION] = known
        if why_not is None and isinstance(known, Session) and (scope["type"] == "websocket" or "/video/" in path):
            await self._while_it_lasts(known, self._app(scope, receive, sent))
        elif why_not is None:
            await self._app(scope, receive, sent)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": why_not})
        else:
            hint = "open the address that `ta2 web` printed" if self._keys.logins is None else "log in at /login"
            error = {"error": {"code": "FORBIDDEN", "message": why_not, "hint": hint}}
            status, more = (401, {"WWW-Authenticate": "Bearer"}) if why_not == UNKNOWN else (403, None)
            await JSONResponse(error, status_code=status, headers=more)(scope, receive, sent)

    def _why_not(self, path: str, headers: Mapping[str, str], *, is_known: bool) -> str | None:
        host = headers.get("host", "")
        if _name(f"//{host}") not in self._names:
            return "the name in Host is none of this host's own"
        origin = headers.get("origin")
        ours = (f"https://{host}",) if self._keys.is_tls else (f"http://{host}", f"https://{host}")
        if origin is not None and origin not in ours:
            return "a page of another site may not ask for anything here"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin") and path not in ("/", "/login"):
            return "a page of another site may not ask for anything here"
        return None if path in self._open or is_known else UNKNOWN

    def _known(self, headers: Mapping[str, str]) -> Session | bool | None:
        """Return who asks: a session, or True by the printed secret; None when nobody knows."""
        scheme, _, bearer = headers.get("authorization", "").partition(" ")
        said = [bearer.strip()] if scheme.lower() == "bearer" else []
        # No `http.cookies`: what it would unquote it may take seconds for (CVE-2024-7592), and no word of ours is quoted.
        cookies = dict(part.strip().partition("=")[::2] for part in headers.get("cookie", "").split(";"))
        said += [cookies[self._cookie]] if self._cookie in cookies else []
        token, logins = self._keys.token, self._keys.logins
        if token is not None and any(hmac.compare_digest(word.encode(), token.encode()) for word in said):
            return True
        found = [] if logins is None else [logins.session(word) for word in said]
        return next((session for session in found if session is not None), None)

    async def _while_it_lasts(self, session: Session, serving: Awaitable[None]) -> None:
        """Serve until that is done or the session is over; a page then ends as one that was closed."""
        assert self._keys.logins is not None
        task = asyncio.ensure_future(serving)
        over = asyncio.ensure_future(session.over.wait())
        try:
            await asyncio.wait(
                {task, over}, timeout=self._keys.logins.left_s(session), return_when=asyncio.FIRST_COMPLETED
            )
        finally:
            over.cancel()
            task.cancel()
            await asyncio.wait({task})
        if not task.cancelled():
            task.result()


def _name(address: str) -> str | None:
    try:
        return urlsplit(address).hostname
    except ValueError:
        return None
