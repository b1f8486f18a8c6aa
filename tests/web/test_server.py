"""The application without a gateway: what is there, what is answered, and that a stop waits for nothing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from threading import Event

import pytest
from starlette.testclient import TestClient

from gateway.web.access import Keys, cookie_name
from gateway.web.logins import Logins
from gateway.web.server import application
from gateway.web.users import read_users

TOKEN = "the-secret"
KNOWN = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[TestClient]:
    """A browser at a server whose gateway never comes."""
    app = application(str(tmp_path / "gw.sock"), Keys(token=TOKEN), 8700)
    with TestClient(app, base_url="http://127.0.0.1:8700", raise_server_exceptions=False) as client:
        yield client


def test_the_page_and_its_files_are_there(browser: TestClient) -> None:
    """And nothing of them comes from elsewhere."""
    page = browser.get("/")
    assert page.status_code == 200 and 'id="stop"' in page.text and "://" not in page.text
    for name in ("page.js", "page.css"):
        assert browser.get(f"/static/{name}").status_code == 200


def test_the_secret_in_the_address_becomes_a_cookie_that_no_script_reads(browser: TestClient) -> None:
    """And leaves the address line; a wrong one does nothing."""
    answer = browser.get(f"/?token={TOKEN}", follow_redirects=False)
    assert answer.status_code == 303 and answer.headers["location"] == "/"
    cookie = answer.headers["set-cookie"]
    assert cookie.startswith(f"{cookie_name(8700)}={TOKEN};") and "HttpOnly" in cookie and "SameSite=strict" in cookie
    assert "set-cookie" not in browser.get("/?token=other").headers


@pytest.mark.parametrize(("method", "path"), [("GET", "/api/state"), ("GET", "/api/why"), ("POST", "/api/recover")])
def test_without_a_gateway_that_is_said(browser: TestClient, method: str, path: str) -> None:
    """With the command that starts one."""
    answer = browser.request(method, path, headers=KNOWN)
    assert answer.status_code == 503
    assert answer.json()["error"]["code"] == "DISCONNECTED" and "ta2 run" in answer.json()["error"]["hint"]


NESTED = b'{"x":' + b"[" * 4000
"""Brackets in brackets: more than a parser goes into."""


@pytest.mark.parametrize("body", [b"", b"{}", b"\x00" * 100_000, b'{"reason": 1}', NESTED])
def test_a_stop_without_a_gateway_tells_the_only_remedy(browser: TestClient, body: bytes) -> None:
    """Whatever came with it."""
    answer = browser.post("/api/estop", content=body)
    assert answer.status_code == 503 and "physical emergency stop" in answer.json()["error"]["hint"]


def test_a_stop_cannot_be_got(browser: TestClient) -> None:
    """A link or a picture on some page is a GET, and must not stop the robot."""
    assert browser.get("/api/stop").status_code == 405
    assert browser.get("/api/nothing", headers=KNOWN).json()["error"]["code"] == "BAD_REQUEST"


def test_a_page_hears_that_the_gateway_is_away_and_that_it_owns_nothing(
    browser: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it asks for wrongly is answered with the reason, what it cannot with the remedy."""
    monkeypatch.setattr("gateway.web.server.AGAIN_S", 60.0)
    with browser.websocket_connect("ws://127.0.0.1:8700/api/live", headers=KNOWN) as socket:
        assert socket.receive_json() == {"type": "gone"}
        socket.send_text("nonsense")
        assert socket.receive_json()["error"]["code"] == "BAD_REQUEST"
        socket.send_text(NESTED.decode())
        assert socket.receive_json()["error"]["code"] == "BAD_REQUEST"
        socket.send_text('{"do": "alive", "id": 1}')
        socket.send_text('{"do": "hold", "id": 2}')
        reply = socket.receive_json()
        assert (reply["id"], reply["ok"], reply["error"]["code"]) == (2, False, "NOT_OWNER")


def test_a_request_may_come_in_a_frame_of_either_kind(browser: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """JSON from a program is bytes; what is no request is answered, too, and ends nothing."""
    monkeypatch.setattr("gateway.web.server.AGAIN_S", 60.0)
    with browser.websocket_connect("ws://127.0.0.1:8700/api/live", headers=KNOWN) as socket:
        assert socket.receive_json() == {"type": "gone"}
        for said in (b"", b"\xff\xfe", b"nonsense"):
            socket.send_bytes(said)
            assert socket.receive_json()["error"]["code"] == "BAD_REQUEST"
        socket.send_bytes(b'{"do": "hold", "id": 2}')
        socket.send_text('{"do": "hold", "id": 3}')
        assert [(reply["id"], reply["error"]["code"]) for reply in (socket.receive_json(), socket.receive_json())] == [
            (2, "NOT_OWNER"),
            (3, "NOT_OWNER"),
        ]


def test_a_page_hears_something_while_there_is_no_news(browser: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else it could not tell a gateway that is away from a server that hangs, or a network that is cut."""
    monkeypatch.setattr("gateway.web.server.AGAIN_S", 0.01)
    with browser.websocket_connect("ws://127.0.0.1:8700/api/live", headers=KNOWN) as socket:
        assert [socket.receive_json() for _ in range(3)] == [{"type": "gone"}] * 3


def test_metrics_say_that_the_gateway_is_away(browser: TestClient) -> None:
    """So that an alarm can be made of it."""
    assert "ta2_up 0.0" in browser.get("/metrics", headers=KNOWN).text
    assert browser.get("/openapi.json", headers=KNOWN).json()["openapi"].startswith("3.")


def test_a_disk_that_hangs_keeps_no_stop_waiting(browser: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its room is left out until it answers; one look at it goes on, however often it is asked for."""
    assert "ta2_disk_free_bytes" in browser.get("/metrics", headers=KNOWN).text
    answers, asked, waited = Event(), [], []

    def hang(folder: Path) -> None:
        asked.append(folder)
        waited.append(answers.wait(10.0))
        raise OSError(5, "the server is away")

    monkeypatch.setattr("gateway.web.metrics.shutil.disk_usage", hang)
    try:
        for _ in range(3):
            page = browser.get("/metrics", headers=KNOWN).text
            assert "ta2_up 0.0" in page and "ta2_disk_free_bytes" not in page
        assert "physical emergency stop" in browser.post("/api/stop").json()["error"]["hint"]
        assert len(asked) == 1 and waited == []
    finally:
        answers.set()


def test_cameras_are_shown_where_that_was_asked_for(browser: TestClient) -> None:
    """Else the answer says how."""
    seen = browser.get("/api/video", headers=KNOWN).json()
    assert seen["views"] == [] and "ta2 web --video" in seen["why"][0]
    answer = browser.get("/api/video/head_left_eye", headers=KNOWN)
    assert answer.status_code == 404 and "ta2 web --video" in answer.json()["error"]["message"]


# ------------------------------------------------------------------------------------------------------------- users


@pytest.fixture
def abroad(tmp_path: Path) -> Iterator[TestClient]:
    """A browser on another host, at a server with one user, ann."""
    logins = Logins(lambda name, password: (name, password) == ("ann", "right"))
    keys = Keys(logins=logins, names=frozenset({"robot.lab"}), is_tls=True)
    app = application(str(tmp_path / "gw.sock"), keys, 8700)
    with TestClient(app, base_url="https://robot.lab:8700", raise_server_exceptions=False) as client:
        yield client


def test_a_user_logs_in_and_out(abroad: TestClient) -> None:
    """The cookie is for TLS, this very host, no script and no other site; the page says who it is."""
    assert abroad.get("/api/state").status_code == 401
    assert "Log in" in abroad.get("/").text and 'id="password"' in abroad.get("/login").text
    assert abroad.get("/static/login.js").status_code == 200
    answer = abroad.post("/api/login", json={"name": "ann", "password": "right"})
    assert answer.status_code == 200 and answer.json() == {}
    cookie = answer.headers["set-cookie"]
    for word in ("__Host-ta2_web_8700=", "HttpOnly", "Secure", "SameSite=strict", "Path=/", "Max-Age=43200"):
        assert word in cookie
    assert abroad.get("/api/state").status_code == 503  # let in; there is no gateway
    assert "Log out ann" in abroad.get("/").text
    assert abroad.post("/api/logout").status_code == 200
    assert abroad.get("/api/state").status_code == 401


def test_a_stranger_is_not_told_what_is_wrong_with_the_file_of_users(tmp_path: Path, caplog) -> None:
    """Nor where it is: the log says so, and how to stop is said all the same."""
    users = tmp_path / "users"
    users.touch(mode=0o644)
    users.chmod(0o644)
    logins = Logins(lambda name, password: name in read_users(users))
    app = application(str(tmp_path / "gw.sock"), Keys(logins=logins, names=frozenset({"robot.lab"}), is_tls=True), 8700)
    with TestClient(app, base_url="https://robot.lab:8700", raise_server_exceptions=False) as client:
        answer = client.post("/api/login", json={"name": "ann", "password": "right"})
    assert answer.status_code == 503 and str(users) not in answer.text and "644" not in answer.text
    assert "logins do not work now" in answer.text and "a stop needs no login" in answer.text
    assert str(users) in caplog.text and "644" in caplog.text


def test_wrong_passwords_are_refused_then_not_even_tried(abroad: TestClient) -> None:
    """A stop goes on working all the while."""
    said = [abroad.post("/api/login", json={"name": "ann", "password": "wrong"}) for _ in range(11)]
    assert [answer.status_code for answer in said] == [*[401] * 10, 429]
    assert "no login" in said[-1].json()["error"]["hint"] and said[-1].headers["Retry-After"] == "300"
    assert "physical emergency stop" in abroad.post("/api/stop").json()["error"]["hint"]


@pytest.mark.parametrize("body", [b"", b"{}", b"[]", b'{"name": "ann"}', b"\xff", b" " * 100_000, NESTED])
def test_what_is_no_login_is_refused(abroad: TestClient, body: bytes) -> None:
    """Without trying anything."""
    assert abroad.post("/api/login", content=body).status_code == 400


def test_where_there_are_no_users_there_is_no_way_in(browser: TestClient) -> None:
    """Only the secret."""
    assert browser.get("/login", headers=KNOWN).status_code == 404
    for path in ("/api/login", "/api/logout"):
        assert browser.post(path, headers=KNOWN).status_code == 404
