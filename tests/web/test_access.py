"""Who may come in: names of this host, pages of this site, the secret; and what every answer says to a browser."""

from __future__ import annotations

import pytest
from msgspec import structs
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocket, WebSocketDisconnect

from gateway.web.access import OPEN_PATHS, SESSION, AccessControl, Keys, cookie_name
from gateway.web.logins import Logins

TOKEN = "the-secret"
HERE = "http://127.0.0.1:8700"
KNOWN = {"Authorization": f"Bearer {TOKEN}"}
PATHS = ("/", "/api/state", "/api/stop", "/api/estop", "/api/recover", "/metrics", "/openapi.json")


def client(*, opens_metrics: bool = False) -> TestClient:
    """Return a browser before access control, behind which everything answers."""

    async def answer(_):
        return PlainTextResponse("in")

    async def live(socket: WebSocket):
        await socket.accept()
        await socket.send_text("in")
        await socket.close()

    routes = [Route(path, answer, methods=["GET", "POST"]) for path in PATHS]
    inside = Starlette(routes=[*routes, WebSocketRoute("/api/live", live)])
    return TestClient(AccessControl(inside, Keys(token=TOKEN), 8700, opens_metrics=opens_metrics), base_url=HERE)


@pytest.mark.parametrize("path", PATHS)
def test_all_but_the_page_and_a_stop_takes_the_secret(path: str) -> None:
    """A stop takes none: nothing comes between a person and a stop."""
    with client() as browser:
        assert browser.get(path).status_code == (200 if path in OPEN_PATHS else 401)
        assert browser.get(path, headers=KNOWN).status_code == 200
        assert browser.get(path, headers={"Cookie": f"{cookie_name(8700)}={TOKEN}"}).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Authorization": "Bearer "},
        {"Authorization": f"Basic {TOKEN}"},
        {"Authorization": f"Bearer {TOKEN}x"},
        {"Authorization": TOKEN},
        {"Cookie": f"{cookie_name(8701)}={TOKEN}"},
        {"Cookie": f"{cookie_name(8700)}=; {TOKEN}"},
        {"Cookie": "\x01="},
    ],
)
def test_a_wrong_secret_is_none(headers: dict[str, str]) -> None:
    """Nor is the right one in the wrong place."""
    with client() as browser:
        answer = browser.get("/api/state", headers=headers)
    assert answer.status_code == 401 and "secret" in answer.json()["error"]["message"]


def test_a_cookie_is_compared_as_it_stands() -> None:
    """Nothing is unquoted: on many a Python that takes time by the square of the backslashes, and anybody may send them."""
    quoted = "".join(f"\\{ord(letter):03o}" for letter in TOKEN)
    with client() as browser:
        for word, status in ((TOKEN, 200), (f'"{TOKEN}"', 401), (f'"{quoted}"', 401)):
            cookies = f"other=1; {cookie_name(8700)}={word}; more"
            assert browser.get("/api/state", headers={"Cookie": cookies}).status_code == status


@pytest.mark.parametrize("host", ["127.0.0.1:8700", "localhost:9000", "[::1]:8700", "LOCALHOST"])
def test_names_of_this_host_are_served_under_any_port(host: str) -> None:
    """A tunnel has another port at its near end."""
    with client() as browser:
        assert browser.get("/", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize("host", ["robot.example", "127.0.0.1.robot.example", "10.0.0.7:8700", "", "[", "localhost."])
@pytest.mark.parametrize("path", ["/", "/api/stop", "/api/state"])
def test_a_name_that_was_made_to_point_here_is_not_served(host: str, path: str) -> None:
    """DNS rebinding: another site's page under its own name, at our address, with our secret even."""
    with client() as browser:
        assert browser.post(path, headers={"Host": host, **KNOWN}).status_code == 403


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://robot.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:9999"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
@pytest.mark.parametrize("path", ["/api/stop", "/api/state", "/metrics"])
def test_a_page_of_another_site_gets_and_does_nothing(headers: dict[str, str], path: str) -> None:
    """Not even a stop, which needs no secret: else any site that somebody reads could stop the robot all day."""
    with client(opens_metrics=True) as browser:
        assert browser.post(path, headers={**headers, **KNOWN}).status_code == 403


def test_our_own_page_may() -> None:
    """Its own origin, also at the near end of a tunnel; and whatever is no browser and says none."""
    with client() as browser:
        for host in ("127.0.0.1:8700", "localhost:9000"):
            headers = {"Host": host, "Origin": f"http://{host}", "Sec-Fetch-Site": "same-origin", **KNOWN}
            assert browser.post("/api/recover", headers=headers).status_code == 200
        assert browser.post("/api/recover", headers=KNOWN).status_code == 200


def test_a_socket_is_let_in_by_the_same_rules() -> None:
    """Browsers let every page open sockets to everywhere, and send its cookies: the origin is what tells."""
    with client() as browser:
        with browser.websocket_connect("ws://127.0.0.1:8700/api/live", headers=KNOWN) as socket:
            assert socket.receive_text() == "in"
        for headers in ({}, {"Origin": "http://robot.example", **KNOWN}, {"Host": "robot.example", **KNOWN}):
            with (
                pytest.raises(WebSocketDisconnect),
                browser.websocket_connect("ws://127.0.0.1:8700/api/live", headers=headers),
            ):
                pass


def test_metrics_can_be_opened() -> None:
    """For a Prometheus on this host, which has no secret; nothing else is opened with them."""
    with client(opens_metrics=True) as browser:
        assert browser.get("/metrics").status_code == 200
        assert browser.get("/api/state").status_code == 401


@pytest.mark.parametrize("path", ["/", "/api/state"])
def test_every_answer_forbids_what_no_page_of_ours_needs(path: str) -> None:
    """Scripts and styles from its own files alone, framed by nobody, kept by no cache."""
    with client() as browser:
        headers = browser.get(path).headers
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy and "unsafe" not in policy and "frame-ancestors 'none'" in policy
    assert headers["Cache-Control"] == "no-store" and headers["X-Content-Type-Options"] == "nosniff"


# ------------------------------------------------------------------------------------------------------ beyond loopback

AWAY = "https://robot.lab:8700"
BEYOND = Keys(names=frozenset({"robot.lab", "10.0.0.7", "fd00::7"}), is_tls=True)


def beyond(logins: Logins | None = None) -> TestClient:
    """Return a browser on another host."""

    async def answer(_):
        return PlainTextResponse("in")

    inside = Starlette(routes=[Route(path, answer, methods=["GET", "POST"]) for path in (*PATHS, "/login")])
    keys = structs.replace(BEYOND, logins=logins or Logins(lambda *_: False))
    return TestClient(AccessControl(inside, keys, 8700, opens_metrics=False), base_url=AWAY)


@pytest.mark.parametrize("host", ["robot.lab:8700", "ROBOT.lab", "10.0.0.7:8700", "[fd00::7]:8700", "localhost:8700"])
def test_names_that_the_server_was_given_are_served(host: str) -> None:
    """And no others: a name that was made to point here is not there."""
    with beyond() as browser:
        assert browser.post("/api/stop", headers={"Host": host, "Origin": f"https://{host}"}).status_code == 200
        for other in ("robot.lab.evil.example", "10.0.0.8", "[fd00::8]"):
            assert browser.post("/api/stop", headers={"Host": other}).status_code == 403


@pytest.mark.parametrize("path", [*PATHS, "/login"])
def test_without_a_login_there_are_the_page_a_stop_and_the_way_in(path: str) -> None:
    """And no printed secret: there is none that opens it."""
    with beyond() as browser:
        for headers in ({}, KNOWN, {"Authorization": "Bearer "}, {"Authorization": "Bearer None"}):
            open_paths = {"/", "/api/stop", "/api/estop", "/login"}
            assert browser.post(path, headers=headers).status_code == (200 if path in open_paths else 401)


def test_a_page_that_came_without_tls_is_another_site() -> None:
    """Somebody on the way made it: it may not even stop. A link from elsewhere leads to the page and the way in, no further."""
    with beyond() as browser:
        assert browser.post("/api/stop", headers={"Origin": "http://robot.lab:8700"}).status_code == 403
        link = {"Sec-Fetch-Site": "cross-site"}
        assert [browser.get(path, headers=link).status_code for path in ("/", "/login", "/metrics")] == [200, 200, 403]
        assert "max-age" in browser.get("/").headers["Strict-Transport-Security"]


def test_a_cookie_for_tls_cannot_be_set_without_it() -> None:
    """Browsers keep that name for it."""
    assert cookie_name(8700, is_tls=True).startswith("__Host-")


def test_a_login_opens_and_what_is_open_by_it_ends_with_it() -> None:
    """A page's socket is closed as one that was lost; one without a login was never opened."""
    logins = Logins(lambda _, password: password == "right")
    ended = []

    async def live(socket: WebSocket):
        await socket.accept()
        await socket.send_text(socket.scope[SESSION].name)
        try:
            await socket.receive_text()
        finally:
            ended.append(True)
            await socket.close()

    async def out(request):
        logins.logout(request.scope[SESSION])
        return PlainTextResponse("out")

    inside = Starlette(routes=[WebSocketRoute("/api/live", live), Route("/api/logout", out, methods=["POST"])])
    control = AccessControl(inside, structs.replace(BEYOND, logins=logins), 8700, opens_metrics=False)
    with TestClient(control, base_url=AWAY) as browser:
        portal = browser.portal
        assert portal is not None
        word = portal.call(logins.login, "ann", "right", "10.0.0.9")
        assert word is not None
        cookie = {"Cookie": f"{cookie_name(8700, is_tls=True)}={word}"}
        with browser.websocket_connect("wss://robot.lab:8700/api/live", headers=cookie) as socket:
            assert socket.receive_text() == "ann"
            assert browser.post("/api/logout", headers=cookie).status_code == 200
            with pytest.raises(WebSocketDisconnect):
                socket.receive_text()
        assert ended == [True]
        with (
            pytest.raises(WebSocketDisconnect),
            browser.websocket_connect("wss://robot.lab:8700/api/live", headers=cookie),
        ):
            pass
        assert browser.post("/api/logout", headers=cookie).status_code == 401


@pytest.mark.parametrize("fails", [False, True])
def test_what_ends_by_itself_before_its_login_does(fails: bool) -> None:
    """As without one: its error is told."""
    logins = Logins(lambda *_: True)

    async def look(_):
        if fails:
            raise OverflowError
        return PlainTextResponse("in")

    inside = Starlette(routes=[Route("/api/video/x", look)])
    control = AccessControl(inside, structs.replace(BEYOND, logins=logins), 8700, opens_metrics=False)
    with TestClient(control, base_url=AWAY) as browser:
        portal = browser.portal
        assert portal is not None
        known = {"Authorization": f"Bearer {portal.call(logins.login, 'ann', 'right', '10.0.0.9')}"}
        if fails:
            with pytest.raises(OverflowError):
                browser.get("/api/video/x", headers=known)
        else:
            assert browser.get("/api/video/x", headers=known).text == "in"
