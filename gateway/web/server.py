"""The application: what there is under which path, and what goes back and forth with each page.

    GET  /                       the page; with ?token=... the secret becomes a cookie
    GET  /login                  where there are users: a page to log in and to stop; POST /api/login, /api/logout
    GET  /api/state, /api/why    what the gateway sees, what stands in the way; 503 while there is none
    POST /api/stop, /api/estop   everybody's stop, {"reason": ...} or any body
    POST /api/recover            clears latches, {"reason": ...}
    WS   /api/live               states and notices as they come; what the page asks for, and the replies
    GET  /api/video, .../VIEW    how the cameras are seen, and one of their views, where they are shown
    GET  /metrics                for Prometheus
    GET  /openapi.json           all of this, and of `beside.py`

A page is one WebSocket: closed, it is a lost client. See `access.py` for who may ask.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import logging
from collections.abc import AsyncIterator, Coroutine
from dataclasses import asdict
from math import inf
from pathlib import Path
from typing import Literal

import msgspec
from prometheus_client import CONTENT_TYPE_LATEST
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from gateway.api.protocol import Info, RefusalMessage
from gateway.client import aio
from gateway.client.state.reasons import why_of
from gateway.errors import Code, Disconnected, GatewayError, GatewayTimeout, OutcomeUnknown, Rejected, failure
from gateway.web import metrics, stopping
from gateway.web.access import SESSION, AccessControl, Keys, cookie_name
from gateway.web.beside import Beside
from gateway.web.logging_in import login_routes
from gateway.web.messages import BOUNDARY, Alive, Asked, CamerasSeen
from gateway.web.openapi import description
from gateway.web.owning import Owning
from gateway.web.viewer import Viewer

__all__ = ["application"]

_log = logging.getLogger(__name__)

NO_CAMERAS = "this page shows no cameras: ta2 web --video"
STATIC = Path(__file__).parent / "static"
MOST_PAGES = 100
BODY_S = 0.5
"""How long the body of a stop is waited for [s]; the stop goes on without it."""
SILENT_S = 5.0
"""A page that owns the robot and says nothing for so long is gone [s]."""
STALLED_S = 10.0
"""A page that takes nothing for so long is gone, owner or not [s]."""
AGAIN_S = 1.0
"""A page hears what is newest again where there is no news for so long [s]: who hears nothing knows that nobody is there."""
CLOSE_S = 1.0
"""How long a page is waited for that is closed [s]."""
MOST_WAITING = 32
"""Requests of one page that are not answered yet."""


def application(
    target: str | None,
    keys: Keys,
    port: int,
    *,
    opens_metrics: bool = False,
    video_port: int | None = None,
    beside: Beside | None = None,
) -> ASGIApp:
    """Return the application, to be served by uvicorn.

    Args:
        target: Where the gateway is; None finds its socket.
        keys: What all but stops take.
        port: Where it listens.
        opens_metrics: Whether `/metrics` takes no secret.
        video_port: Where the robot sends its pictures; None shows none.
        beside: What else is shown; None for nothing.
    """
    beside = Beside() if beside is None else beside
    server = _Server(target, keys, port, video_port)
    server.viewer.body = beside.body

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        viewing = asyncio.create_task(server.viewer.run())
        try:
            yield
        finally:
            viewing.cancel()
            await asyncio.gather(viewing, beside.close(), return_exceptions=True)

    routes = [
        Route("/", server.page),
        Mount("/static", StaticFiles(directory=STATIC)),
        Route("/api/state", server.state),
        Route("/api/why", server.why),
        Route("/api/stop", server.stop, methods=["POST"]),
        Route("/api/estop", server.estop, methods=["POST"]),
        Route("/api/recover", server.recover, methods=["POST"]),
        WebSocketRoute("/api/live", server.live),
        Route("/api/video", server.video),
        Route("/api/video/{view}", server.pictures),
        Route("/metrics", server.metrics),
        Route("/openapi.json", server.openapi),
        *beside.routes(),
        *login_routes(keys.logins, cookie_name(port, is_tls=keys.is_tls), is_tls=keys.is_tls),
    ]
    failed = {GatewayError: _failed, HTTPException: _not_there}
    return AccessControl(
        Starlette(routes=routes, lifespan=lifespan, exception_handlers=failed), keys, port, opens_metrics=opens_metrics
    )


class _Server:
    def __init__(self, target: str | None, keys: Keys, port: int, video_port: int | None) -> None:
        self._target = target
        self._keys = keys
        self._cookie = cookie_name(port, is_tls=keys.is_tls)
        self._pages = 0
        self._disk = metrics.Disk()
        self.viewer = Viewer(target)
        self._cameras = None
        if video_port is not None:
            from gateway.web.cameras import Cameras  # what decodes is another extra

            self._cameras = Cameras(lambda: self._info().robot, video_port)

    async def page(self, request: Request) -> Response:
        if self._keys.logins is not None:
            text, session = (STATIC / "index.html").read_text(encoding="utf-8"), request.scope.get(SESSION)
            way = "Log in" if session is None else f"Log out {session.name}"
            return HTMLResponse(text.replace("</header>", f'<p><a href="/login">{way}</a></p></header>', 1))
        said, token = request.query_params.get("token"), self._keys.token
        if said is None or token is None or not hmac.compare_digest(said.encode(), token.encode()):
            return FileResponse(STATIC / "index.html")
        response = RedirectResponse("/", status_code=303)  # the secret stays in no address line and no history
        response.set_cookie(self._cookie, token, httponly=True, samesite="strict", secure=self._keys.is_tls)
        return response

    async def state(self, _: Request) -> Response:
        self._require()
        return Response(self.viewer.state, media_type="application/json")

    async def why(self, _: Request) -> Response:
        robot = self._require()
        why = why_of(await robot.state())
        shown = {
            "state": why.state,
            "findings": why.findings,
            "latches": dict(why.latches),
            "refusals": dict(why.refusals),
        }
        return _json(shown)

    async def stop(self, request: Request) -> Response:
        return await self._stopped(request, "stop")

    async def estop(self, request: Request) -> Response:
        return await self._stopped(request, "estop")

    async def _stopped(self, request: Request, word: Literal["stop", "estop"]) -> Response:
        body = b""
        with contextlib.suppress(asyncio.TimeoutError, ClientDisconnect):  # no body keeps a stop
            body = await asyncio.wait_for(stopping.body_of(request), BODY_S)
        reason = f"{stopping.reason_of(body) or 'by the page'} ({_host(request)})"
        done = await stopping.stop(word, reason, self._target, self.viewer.robot)
        return _json(done)

    async def recover(self, request: Request) -> Response:
        reason = stopping.reason_of(await stopping.body_of(request))
        await self._require().recover(f"{reason} ({_host(request)})" if reason else "")
        return _json({})

    async def video(self, _: Request) -> Response:
        none = CamerasSeen(views=(), is_receiving=False, age_s=None, rate_hz=0.0, why=(NO_CAMERAS,))
        return _json(none if self._cameras is None else self._cameras.seen())

    async def pictures(self, request: Request) -> Response:
        cameras, view = self._cameras, request.path_params["view"]
        if cameras is None:
            raise HTTPException(404, NO_CAMERAS)
        cameras.require(view)
        pictures = cameras.pictures(view)
        first = await anext(pictures, b"")  # a port that is taken is refused before anything was said
        return StreamingResponse(_from(first, pictures), media_type=f"multipart/x-mixed-replace; boundary={BOUNDARY}")

    async def metrics(self, _: Request) -> Response:
        cameras = None if self._cameras is None else self._cameras.seen()
        page = metrics.text(self.viewer, cameras, await self._disk.free())
        return Response(page, headers={"Content-Type": CONTENT_TYPE_LATEST})

    async def openapi(self, _: Request) -> Response:
        return Response(description(), media_type="application/json")

    def _info(self) -> Info:
        self._require()
        if self.viewer.info is None:
            raise _no_gateway()
        return self.viewer.info

    def _require(self) -> aio.Robot:
        robot = self.viewer.robot
        if robot is None or self.viewer.view is None:
            raise _no_gateway()
        return robot

    async def live(self, socket: WebSocket) -> None:
        if self._pages >= MOST_PAGES:
            await socket.close(1013, f"{MOST_PAGES} pages are open already")
            return
        await socket.accept()
        self._pages += 1
        try:
            await _Page(socket, self.viewer, Owning(self._target, f"page of {_host(socket)}")).run()
        finally:
            self._pages -= 1


class _Page:
    """One WebSocket: what is told, and what is asked."""

    def __init__(self, socket: WebSocket, viewer: Viewer, owning: Owning) -> None:
        self._socket = socket
        self._viewer = viewer
        self._owning = owning
        self._sending = asyncio.Lock()
        self._waiting: set[asyncio.Task[None]] = set()
        self._heard_s = 0.0
        self._sends_s = inf
        """Since when a message has been on its way out [s]; inf while none is."""

    async def run(self) -> None:
        """Serve it until it is gone."""
        parts = {_begun(part) for part in (self._tell(), self._listen(), self._watch())}
        try:
            await asyncio.wait(parts, return_when=asyncio.FIRST_COMPLETED)
        finally:
            tasks = parts | self._waiting
            for task in tasks:
                task.cancel()  # nothing is begun any more that `lose` would not end
            await self._owning.lose()  # first: whatever else ends slowly, the robot is held
            await _ended(tasks)
            closing = _begun(self._socket.close())
            await asyncio.wait({closing}, timeout=CLOSE_S)  # whoever reads nothing is not waited for
            await _ended({closing})

    async def _send(self, message: bytes) -> None:
        async with self._sending:
            self._sends_s = asyncio.get_running_loop().time()
            await self._socket.send_text(message.decode())
            self._sends_s = inf

    async def _tell(self) -> None:
        shown, told = -1, 0
        while True:
            viewer = self._viewer
            if viewer.number != shown:
                shown = viewer.number
                await self._send(viewer.state)
            for number, message in tuple(viewer.notices):
                if number > told:
                    told = number
                    await self._send(message)
            if viewer.number == shown and (not viewer.notices or viewer.notices[-1][0] == told):
                try:
                    await asyncio.wait_for(viewer.news(), AGAIN_S)
                except asyncio.TimeoutError:
                    shown = -1

    async def _listen(self) -> None:
        while (heard := await self._socket.receive())["type"] == "websocket.receive":
            self._heard_s = asyncio.get_running_loop().time()
            self._take(heard.get("text") or heard.get("bytes") or "")  # a frame of either kind
            while len(self._waiting) >= 2 * MOST_WAITING:  # it asks, and takes no answers
                await asyncio.wait(self._waiting, return_when=asyncio.FIRST_COMPLETED)

    async def _watch(self) -> None:
        """End when a page takes nothing any more, or owns the robot and is silent: a frozen tab, a closed lid, a cut cable."""
        while True:
            now_s = asyncio.get_running_loop().time()
            if now_s - self._sends_s > STALLED_S or (self._owning.is_owner and now_s - self._heard_s >= SILENT_S):
                return
            await asyncio.sleep(min(SILENT_S, STALLED_S) / 10.0)

    def _take(self, text: str | bytes) -> None:
        try:
            asked = msgspec.json.decode(text, type=Asked)
        except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
            self._begin(
                self._reply(None, RefusalMessage(code=Code.BAD_REQUEST, message=str(error), hint="see /openapi.json"))
            )
            return
        if isinstance(asked, Alive):
            return
        if len(self._waiting) >= MOST_WAITING:
            message = f"{MOST_WAITING} requests of this page wait for their answers"
            self._begin(
                self._reply(asked.id, RefusalMessage(code=Code.BAD_REQUEST, message=message, hint="wait for one"))
            )
            return
        self._begin(self._carry_out(asked))

    def _begin(self, doing: Coroutine[None, None, None]) -> None:
        task = _begun(doing)
        self._waiting.add(task)
        task.add_done_callback(self._waiting.discard)

    async def _carry_out(self, asked: Asked) -> None:
        try:
            facts = await self._owning.carry_out(asked)
        except GatewayError as error:
            await self._reply(asked.id, failure_of(error))
        else:
            await self._send(msgspec.json.encode({"type": "reply", "id": asked.id, "ok": True, "facts": facts}))

    async def _reply(self, number: int | None, failure: RefusalMessage) -> None:
        await self._send(msgspec.json.encode({"type": "reply", "id": number, "ok": False, "error": failure}))


def _no_gateway() -> GatewayError:
    return failure(Code.DISCONNECTED, "no gateway answers", hint="start it: ta2 run")


def _begun(doing: Coroutine[None, None, None]) -> asyncio.Task[None]:
    """Begin what belongs to a page; where it ends otherwise than because the page is gone, or closed already, that is told."""

    def tell(task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None and not isinstance(error, (WebSocketDisconnect, RuntimeError)):
            _log.error("a page ended by an error", exc_info=error)

    task = asyncio.create_task(doing)
    task.add_done_callback(tell)
    return task


async def _ended(tasks: set[asyncio.Task[None]]) -> None:
    """End what belongs to a page."""
    for task in tasks:
        task.cancel()
    await asyncio.wait(tasks)


def failure_of(error: GatewayError) -> RefusalMessage:
    """Return an error as pages get it."""
    return msgspec.convert(asdict(error.refusal), RefusalMessage)


def _json(value: object, status: int = 200) -> Response:
    return Response(msgspec.json.encode(value), status_code=status, media_type="application/json")


async def _failed(_: Request, error: Exception) -> Response:
    assert isinstance(error, GatewayError)
    status = 409
    if isinstance(error, Rejected):
        status = 400
    elif isinstance(error, Disconnected):
        status = 503
    elif isinstance(error, (GatewayTimeout, OutcomeUnknown)):
        status = 504
    return _json({"error": failure_of(error)}, status)


async def _not_there(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    failure = RefusalMessage(code=Code.BAD_REQUEST, message=error.detail, hint="see /openapi.json")
    response = _json({"error": failure}, error.status_code)
    response.headers.update(error.headers or {})  # which methods there are
    return response


async def _from(first: bytes, rest: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    yield first
    async for part in rest:
        yield part


def _host(connection: Request | WebSocket) -> str:
    """Return who asks, by name where there is a login, and from where."""
    session, peer = connection.scope.get(SESSION), connection.client
    return f"{f'{session.name} at ' if session else ''}{f'{peer.host}:{peer.port}' if peer else 'unknown'}"
