"""What is shown beside the state: there only where it was asked for, and answered at once."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from gateway.settings.settings import Settings
from gateway.web.access import Keys
from gateway.web.beside import Beside
from gateway.web.body import Body
from gateway.web.job import Job
from gateway.web.server import application

KNOWN = {"Authorization": "Bearer the-secret"}


def browser(tmp_path: Path, beside: Beside | None) -> TestClient:
    """Return a browser at a server of a gateway that never comes."""
    app = application(str(tmp_path / "gw.sock"), Keys(token="the-secret"), 8700, beside=beside)
    return TestClient(app, base_url="http://127.0.0.1:8700", headers=KNOWN)


def test_what_was_not_asked_for_says_how_to(tmp_path: Path) -> None:
    """And runs nothing."""
    with browser(tmp_path, None) as page:
        assert page.get("/api/body").json() == {"parts": [], "frames": {}, "why": ""}
        assert "ta2 web --recordings" in page.post("/api/recordings").json()["error"]
        assert not page.post("/api/check").json()["is_running"]


def test_the_shape_of_the_body_is_there_before_any_gateway(tmp_path: Path) -> None:
    """It is the settings'."""
    with browser(tmp_path, Beside(body=Body(Settings()))) as page:
        shape = page.get("/api/body").json()
        assert {"name": "left_palm", "side": "left", "radius_m": 0.055} in shape["parts"] and "virtual_base" in shape[
            "frames"
        ]


def test_a_look_is_begun_at_once_and_its_report_is_fetched(tmp_path: Path) -> None:
    """No connection of a browser waits for it: there are six, and a stop needs one. A link cannot begin it."""
    one = Job(sys.executable, "-c", "import sys; print('{\"rows\": []}') if not sys.stdin.read() else None")
    with browser(tmp_path, Beside(jobs={"check": one})) as page:
        assert page.get("/api/check").json() == {"is_running": False, "report": None, "error": ""}
        assert page.post("/api/check").json()["is_running"]
        deadline = time.monotonic() + 40.0
        while page.get("/api/check").json()["is_running"]:
            assert time.monotonic() < deadline
        assert page.get("/api/check").json()["report"] == {"rows": []}


@pytest.mark.parametrize("path", ["body", "recordings", "check"])
def test_nothing_of_it_is_for_strangers(tmp_path: Path, path: str) -> None:
    """A recording's name, a robot's address."""
    with browser(tmp_path, None) as page:
        assert page.get(f"/api/{path}", headers={"Authorization": "Bearer other"}).status_code == 401
        assert page.post(f"/api/{path}", headers={"Origin": "http://elsewhere"}).status_code == 403
