"""Who may come in: names of this host, pages of this site, the secret; and what every answer says to a browser."""

from __future__ import annotations

import pytest
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocket, WebSocketDisconnect

from gateway.web.door import OPEN_PATHS, Door, cookie_name

TOKEN = "the-secret"
HERE = "http://127.0.0.1:8700"
KNOWN = {"Authorization": f"Bearer {TOKEN}"}
PATHS = ("/", "/api/state", "/api/stop", "/api/estop", "/api/recover", "/metrics", "/openapi.json")


def client(*, opens_metrics: bool = False) -> TestClient:
    """Return a browser before a door, behind which everything answers."""

    async def answer(_):
        return PlainTextResponse("in")

    async def live(socket: WebSocket):
        await socket.accept()
        await socket.send_text("in")
        await socket.close()

    routes = [Route(path, answer, methods=["GET", "POST"]) for path in PATHS]
    inside = Starlette(routes=[*routes, WebSocketRoute("/api/live", live)])
    return TestClient(Door(inside, TOKEN, 8700, opens_metrics=opens_metrics), base_url=HERE)


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
