"""`ta2 web` as a process: everybody's stop, a page that owns the robot and is lost, pages that race, a browser."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from gateway.errors import Aborted, LeaseError
from tests.e2e.system import ROOT, Process, System, free_port, wait_for

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.sim_only("the page is a client of the gateway, whatever the robot is"),
]

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


class Web:
    """A running `ta2 web`."""

    def __init__(self, system: System, *options: str, verify: ssl.SSLContext | bool = True) -> None:
        self.port = free_port()
        arguments = ["-m", "gateway.cli", "web", "--at", system.target, "--port", str(self.port), "--json", *options]
        self.process = Process("web", arguments, system.folder)
        said = wait_for(lambda: self.process.text().splitlines(), "the address", tell=self.process.text)
        self.url, self.token = (json.loads(said[0])[name] for name in ("url", "token"))
        self.known = {"Authorization": f"Bearer {self.token}"}
        self._verify = verify
        wanted = 200 if self.token else 401
        wait_for(lambda: self.get("/api/state").status_code == wanted, "the page's gateway", tell=self.process.text)

    def get(self, path: str) -> httpx.Response:
        """Get something, as who knows the secret; 599 while nobody listens."""
        try:
            return httpx.get(f"{self.url}{path[1:]}", headers=self.known, timeout=20.0, verify=self._verify)
        except httpx.TransportError:
            return httpx.Response(599)

    def post(self, path: str, body: object) -> dict[str, Any]:
        """Ask for a stop, without the secret."""
        answer = httpx.post(f"{self.url}{path[1:]}", json=body, timeout=20.0)
        assert answer.status_code == 200, answer.text
        said: dict[str, Any] = answer.json()
        return said

    @contextlib.contextmanager
    def page(self) -> Iterator[Page]:
        """Open the socket of a page."""
        address = f"ws://127.0.0.1:{self.port}/api/live"
        with connect(address, additional_headers=self.known, max_size=None) as socket:
            yield Page(socket)


class Page:
    """What a page does, without a browser."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self._number = 0

    def ask(self, do: str, **values: object) -> dict[str, Any]:
        """Ask for something, and return the reply."""
        self._number += 1
        self.socket.send(json.dumps({"do": do, "id": self._number, **values}))
        deadline = time.monotonic() + 30.0
        while time.monotonic() < deadline:
            message: dict[str, Any] = json.loads(self.socket.recv(timeout=10.0))
            if message["type"] == "reply" and message["id"] == self._number:
                return message
        pytest.fail(f"no reply to {do}")


@pytest.fixture
def system(systems, tmp_path: Path, request: pytest.FixtureRequest) -> System:
    """A robot and its gateway; with a guard where the gateway dies or hangs."""
    made: System = systems(tmp_path, has_guard="hangs" in request.node.name)
    made.connect("first").close()
    return made


@pytest.fixture
def web(system: System) -> Iterator[Web]:
    """A page of it."""
    made = Web(system, "--recordings", str(system.folder))
    yield made
    made.process.end()


def test_everybody_stops_anybodys_motion(system: System, web: Web) -> None:
    """Without the secret; the owner is told by whom and why."""
    with system.connect("owner") as robot, robot.control(on_exit="hold") as own:
        own.enable()
        motion = own.left_arm.move_by(np.full(7, 0.2), speed=0.05)
        wait_for(lambda: robot.state.state == "ACTIVE", "motion")
        assert web.post("/api/stop", {"reason": "smoke"}) == {
            "confirmed": True,
            "dropped": True,
            "by_guard": False,
            "undelivered": False,
        }
        with pytest.raises(Aborted):
            motion.result(timeout=10.0)
        said = wait_for(lambda: dict(robot.state.latches), "the latch")
        assert any("ta2 web" in text and "smoke" in text for text in said.values())
        answer = httpx.post(f"{web.url}api/recover", json={}, headers=web.known, timeout=20.0)
        assert answer.status_code == 200
        wait_for(lambda: not robot.state.latches, "the recovery")


def test_a_stop_reaches_the_robot_while_the_gateway_hangs(system: System, web: Web) -> None:
    """Its guard takes over and reads what lies in the pipe; the robot is held, and the stop latched for whoever comes next."""
    with system.connect("owner") as robot:
        own = robot.control(on_exit="hold").acquire()
        own.enable()
        own.left_arm.move_by(np.full(7, 0.3), speed=0.05)
        wait_for(lambda: robot.state.state == "ACTIVE", "motion")
        system.daemon.send(signal.SIGSTOP)
        try:
            done = web.post("/api/stop", {"reason": "smoke"})
            assert done["dropped"] or done["by_guard"]
            wait_for(lambda: "smoke" in system.logs() or done["by_guard"], "the guard", tell=system.logs)
        finally:
            with contextlib.suppress(ProcessLookupError):
                system.daemon.send(signal.SIGCONT)


def test_a_page_enables_moves_and_gives_back(system: System, web: Web) -> None:
    """Each word is answered when it was accepted; what is out of bounds is refused with the bound, and nothing moves."""
    with system.connect("watcher") as robot, web.page() as page:
        assert page.ask("enable")["error"]["code"] == "NOT_OWNER"
        assert page.ask("acquire")["ok"]
        assert page.ask("enable")["ok"]
        before = robot.fresh_state().left_arm.q[0]
        assert page.ask("jog", side="left", joint=1, step_rad=0.05)["ok"]
        wait_for(lambda: abs(robot.state.left_arm.q[0] - before - 0.05) < 0.01, "the step", tell=system.logs)
        refused = page.ask("drive", vx_mps=99.0, vy_mps=0.0, wz_radps=0.0)
        assert not refused["ok"] and refused["error"]["bound"]
        assert page.ask("drive", vx_mps=0.1, vy_mps=0.0, wz_radps=0.0)["ok"]
        wait_for(lambda: not robot.state.view.drive.driven, "the end of a drive that nobody says again")
        assert page.ask("grip", side="left", force=0.3)["ok"]
        assert page.ask("home")["ok"]
        assert page.ask("hold")["ok"]
        assert page.ask("release")["ok"]
        wait_for(lambda: not robot.state.view.lease.owned, "the release")


@pytest.mark.parametrize("how", ["closed", "killed"])
def test_a_page_that_is_lost_leaves_the_robot_held(system: System, web: Web, how: str) -> None:
    """Closed, or its server killed: as a client that dies. Held, and free for others after its time."""
    with system.connect("watcher") as robot:
        with contextlib.ExitStack() as stack:
            page = stack.enter_context(web.page())
            assert page.ask("acquire")["ok"] and page.ask("enable")["ok"]
            assert page.ask("jog", side="left", joint=1, step_rad=0.2)["ok"]
            wait_for(lambda: robot.state.state == "ACTIVE", "motion")
            if how == "killed":
                web.process.send(signal.SIGKILL)
                stack.pop_all()
        state = wait_for(lambda: robot.state if robot.state.state == "HOLDING" else None, "the hold", tell=system.logs)
        assert state.view.lease.lost_ns is not None and state.view.fsm is not None


@pytest.mark.thorough
def test_a_page_that_says_nothing_for_long_is_lost(system: System, web: Web) -> None:
    """A frozen tab, a closed lid: its socket is open still."""
    with system.connect("watcher") as robot, web.page() as page:
        assert page.ask("acquire")["ok"]
        wait_for(lambda: robot.state.view.lease.lost_ns is not None, "the loss", seconds=20.0)


@pytest.mark.thorough
def test_two_pages_race_for_the_robot(system: System, web: Web) -> None:
    """One gets it, the other hears who has it; with a reason it takes it, and the first is told at its next word."""
    with web.page() as first, web.page() as second:
        assert first.ask("acquire")["ok"]
        refused = second.ask("acquire")
        assert refused["error"]["code"] == "LEASE_HELD" and "page of" in refused["error"]["message"]
        assert second.ask("acquire", take="my turn")["ok"]
        assert not first.ask("hold")["ok"]
        assert second.ask("release")["ok"]
    with system.connect("program") as robot, pytest.raises(LeaseError), web.page() as page:
        assert page.ask("acquire")["ok"]
        robot.control().acquire()


def test_without_the_secret_there_is_nothing_to_see(web: Web) -> None:
    """Any user of this host can reach the port."""
    assert httpx.get(f"{web.url}api/state", timeout=20.0).status_code == 401
    assert httpx.get(f"{web.url}metrics", timeout=20.0).status_code == 401
    with pytest.raises(InvalidStatus, match="403"), connect(f"ws://127.0.0.1:{web.port}/api/live"):
        pass


def test_beyond_this_host_a_user_logs_in_and_everybody_stops(system: System, tmp_path: Path) -> None:
    """By TLS; a peer that takes all the connections it gets keeps no other from a stop; logging out is losing the robot."""
    for verb in (["init"], ["server", "localhost", "127.0.0.1"]):
        make = [sys.executable, "-m", "gateway.cli", "keys", *verb, "--dir", str(tmp_path)]
        subprocess.run(make, cwd=ROOT, check=True, capture_output=True, timeout=60)
    users, certificate, key = (tmp_path / name for name in ("users", "server/certificate.pem", "server/key.pem"))
    add = [sys.executable, "-m", "gateway.cli", "web", "--add-user", "ann", "--users", str(users)]
    subprocess.run(add, cwd=ROOT, input="correct horse\n", text=True, check=True, capture_output=True, timeout=60)
    tls = ssl.create_default_context(cafile=tmp_path / "server" / "ca.pem")
    known = ("--users", str(users), "--certificate", str(certificate), "--key", str(key))
    web = Web(system, "--host", "0.0.0.0", "--name", "localhost", "--name", "127.0.0.1", *known, verify=tls)
    with contextlib.ExitStack() as stack:
        stack.callback(web.process.end)
        assert web.token is None and web.url.startswith("https://localhost:")
        browser = stack.enter_context(httpx.Client(base_url=web.url, verify=tls, timeout=20.0))
        assert browser.get("api/state").status_code == 401
        assert browser.post("api/login", json={"name": "ann", "password": "wrong"}).status_code == 401
        assert browser.post("api/login", json={"name": "ann", "password": "correct horse"}).status_code == 200
        wait_for(lambda: browser.get("api/state").status_code == 200, "the page's gateway", tell=web.process.text)
        cookie = {"Cookie": "; ".join(f"{name}={value}" for name, value in browser.cookies.items())}
        robot = stack.enter_context(system.connect("watcher"))
        address = f"wss://127.0.0.1:{web.port}/api/live"
        page = Page(stack.enter_context(connect(address, additional_headers=cookie, ssl=tls, max_size=None)))
        assert page.ask("acquire")["ok"]
        wait_for(lambda: "page of ann at 127.0.0.1" in str(robot.state.view.lease), "the lease", tell=web.process.text)
        for _ in range(100):  # says nothing at all
            with contextlib.suppress(OSError):
                stack.enter_context(socket.create_connection(("127.0.0.1", web.port), 5.0, ("127.0.0.3", 0)))
        answer = httpx.post(f"{web.url}api/stop", json={"reason": "smoke"}, verify=tls, timeout=20.0)
        assert answer.status_code == 200 and answer.json()["confirmed"]
        assert browser.post("api/logout").status_code == 200
        wait_for(lambda: robot.state.view.lease.lost_ns is not None, "the loss", tell=web.process.text)
        assert "ann logged in from 127.0.0.1" in web.process.text() and "wrong password" in web.process.text()


@pytest.mark.thorough
def test_a_page_outlives_its_gateway(system: System, web: Web) -> None:
    """It says that the gateway is away, and finds the next one."""
    system.daemon.end()
    wait_for(lambda: web.get("/api/state").status_code == 503, "the gap")
    assert "ta2_up 0.0" in web.get("/metrics").text
    system.daemon = system.start_daemon()
    wait_for(lambda: web.get("/api/state").status_code == 200, "the next one", seconds=40.0, tell=system.logs)


def complaints(page) -> list[str]:
    """Return what a page of Chromium will have complained of; not a driver's words on drawing without a GPU."""
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text) if "WebGL" not in message.text else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    return said


@contextlib.contextmanager
def opened(web: Web) -> Iterator[tuple[Any, Callable[..., Any], list[str]]]:
    """The page in a browser; what it is asked to show, and what it complained of."""
    playwright = pytest.importorskip("playwright.sync_api", reason="no Playwright: pip install playwright")
    with (
        playwright.sync_playwright() as play,
        play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]) as browser,
    ):
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        said = complaints(page)
        playwright.expect.set_options(timeout=30_000)
        page.goto(f"{web.url}?token={web.token}")
        yield page, playwright.expect, said


in_a_browser = pytest.mark.skipif(
    CHROMIUM is None and os.environ.get("TA2_BROWSER") != "required",
    reason="no Chromium here (Debian: apt install chromium)",
)


@in_a_browser
def test_in_a_browser_a_person_takes_it_moves_it_and_stops_it(system: System, web: Web) -> None:
    """Debian's Chromium: the page obeys its own policy, its buttons do what they say, Escape stops, a closed tab is a loss."""
    with system.connect("watcher") as robot, opened(web) as (page, see, said):
        see(page.locator("#place")).to_contain_text("tcp/127.0.0.1")
        assert "token" not in page.url
        page.get_by_role("button", name="Take control").click()
        see(page.locator("#owner")).to_have_text("you own the robot")
        page.get_by_role("button", name="Enable", exact=True).click()
        see(page.locator("#state")).to_have_text(re.compile("ACTIVE|HOLDING"))
        before = robot.fresh_state().left_arm.q[0]
        page.get_by_label("left joint 1 plus").click()
        wait_for(lambda: robot.state.left_arm.q[0] > before + 0.03, "the step", tell=system.logs)
        page.keyboard.press("Escape")
        wait_for(lambda: robot.state.latches, "the stop", tell=system.logs)
        see(page.locator("#stopped")).to_contain_text("stopped")
        page.get_by_role("button", name="Recover").click()
        wait_for(lambda: not robot.state.latches, "the recovery")
        page.get_by_role("button", name="Give back").click()
        see(page.locator("#owner")).to_have_text("nobody owns it")
        with robot.control(on_exit="hold"):
            see(page.locator("#owner")).to_have_text("owner: watcher")
            page.get_by_role("button", name="Take control").click()
            see(page.locator("#answer")).to_contain_text("say why you take it")
            page.get_by_label("Reason").fill("my turn")
            page.get_by_role("button", name="Take control").click()
            see(page.locator("#owner")).to_have_text("you own the robot")
            with robot.control(take="mine again", on_exit="hold"):
                see(page.locator("#owner")).to_have_text("owner: watcher")
                see(page.get_by_role("button", name="Enable", exact=True)).to_be_disabled()
                page.get_by_role("button", name="Take control").click()
                page.get_by_label("Reason").fill("once more")
                page.get_by_role("button", name="Take control").click()
                see(page.locator("#owner")).to_have_text("you own the robot")
        if folder := os.environ.get("TA2_ARTEFACTS"):
            Path(folder).mkdir(parents=True, exist_ok=True)
            page.screenshot(path=str(Path(folder) / "web-page.png"), full_page=True)
        page.close()
        wait_for(lambda: robot.state.view.lease.lost_ns is not None, "the loss of a closed tab", tell=system.logs)
        assert said == []


@in_a_browser
def test_in_a_browser_a_server_that_is_frozen_is_told_and_a_stop_that_nobody_answers(system: System, web: Web) -> None:
    """As behind a cut network: nothing is closed, nothing comes. The stop goes on, and is made when it can be."""
    with system.connect("watcher") as robot, opened(web) as (page, see, _):
        page.get_by_role("button", name="Take control").click()
        see(page.locator("#owner")).to_have_text("you own the robot")
        web.process.send(signal.SIGSTOP)
        try:
            page.keyboard.press("Escape")
            see(page.locator("#stopped")).to_contain_text("nobody has answered yet: use the physical emergency stop")
            see(page.locator("#state")).to_contain_text("what is shown is old")
            see(page.get_by_role("button", name="Enable", exact=True)).to_be_disabled()
        finally:
            web.process.send(signal.SIGCONT)
        wait_for(lambda: robot.state.latches, "the stop", tell=system.logs)
        see(page.locator("#stopped")).to_contain_text("stopped")
        see(page.locator("#why")).to_contain_text("STOPPED_BY_OTHER")
        see(page.locator("#state")).not_to_contain_text("old")


@in_a_browser
def test_in_a_browser_nothing_stays_that_is_not_so_any_more(system: System, web: Web) -> None:
    """No stop that somebody else has undone; neither numbers nor findings of a gateway that is gone, until the next one's."""
    with opened(web) as (page, see, _):
        see(page.locator("#left-1")).to_contain_text("rad")
        see(page.locator("#why")).to_have_text("nothing")
        page.keyboard.press("Escape")
        see(page.locator("#stopped")).to_contain_text("Recover lets it move again")
        see(page.locator("#why")).to_contain_text("STOPPED_BY_OTHER")
        with system.connect("somebody else") as robot:
            robot.recover()
        see(page.locator("#stopped")).to_be_empty()
        see(page.locator("#why")).to_have_text("nothing")
        system.daemon.end()
        see(page.locator("#state")).to_contain_text("no gateway answers")
        see(page.locator("#left-1")).to_have_text("–")
        see(page.locator("#right-gripper")).to_have_text("–")
        for place in ("#why", "#owner", "#wire tbody"):
            see(page.locator(place)).to_be_empty()
        if folder := os.environ.get("TA2_ARTEFACTS"):
            Path(folder).mkdir(parents=True, exist_ok=True)
            page.screenshot(path=str(Path(folder) / "web-page-gone.png"), full_page=True)
        system.daemon = system.start_daemon()
        see(page.locator("#left-1")).to_contain_text("rad")
        see(page.locator("#why")).not_to_be_empty()


@in_a_browser
def test_in_a_browser_the_body_is_drawn_an_episode_judged_and_a_stop_goes_past_all_of_it(
    system: System, web: Web
) -> None:
    """The view can be worked by keys and keeps no stop away, however busy; what nobody sees or knows any more is not drawn."""
    bag = str(system.folder / "wave")
    recorder = Process("record", ["-m", "gateway.cli", "record", "--at", system.target, "--out", bag], system.folder)
    try:
        with system.connect("watcher") as robot, opened(web) as (page, see, said):
            see(page.locator("#near")).to_contain_text(re.compile(r"Nearest: .* and .*, [\d.]+ cm"))
            page.locator("#body").focus()
            before = page.evaluate("scene.turn")
            page.keyboard.press("ArrowRight")
            assert page.evaluate("scene.turn") > before
            page.keyboard.press("Tab")
            see(page.get_by_role("button", name="Reset")).to_be_focused()
            page.locator("#body").focus()
            if page.locator("#no-3d").is_hidden():  # whether a browser can draw is its machine's matter
                wait_for(lambda: page.evaluate("byId('body').dataset.drawn > 3"), "pictures", seconds=60.0)
                page.evaluate("scrollTo(0, document.body.scrollHeight)")
                wait_for(lambda: page.evaluate("!scene.visible && !scene.asked"), "the end of pictures")
                drawn = page.evaluate("[byId('body').dataset.drawn, history.left.at(-1)[0]]")
                wait_for(lambda: page.evaluate("history.left.at(-1)[0]") > drawn[1] + 1.0, "more states")
                assert page.evaluate("byId('body').dataset.drawn") == drawn[0]
                page.locator("#body").focus()
            busy = "const end = performance.now() + 100; while (performance.now() < end) orbit(0.01, 0); render();"
            page.evaluate(f"window.busy = setInterval(() => {{ {busy} }}, 0); null")
            page.keyboard.press("Escape")
            wait_for(lambda: robot.state.latches, "the stop", tell=system.logs)
            page.evaluate("clearInterval(window.busy)")
            see(page.locator("#recording")).to_contain_text("no episode yet")
            page.get_by_role("button", name="Take control").click()
            page.get_by_label("Task, or a note").fill("wave")
            page.get_by_role("button", name="Start episode").click()
            see(page.locator("#recording")).to_contain_text("episode 1 goes on: wave")
            page.get_by_role("button", name="Success").click()
            see(page.locator("#recording")).to_contain_text("episode 1 has ended")
            recorder.send(signal.SIGTERM)
            recorder.wait(60.0)
            see(page.locator("#recording")).to_contain_text("Nobody records")
            page.get_by_role("button", name="List recordings").click()
            see(page.get_by_role("row", name="wave")).to_contain_text("1 success")
            see(page.locator("#right-1")).to_contain_text("rad")
            system.control.fault("drop", topic="/right_arm/joint_states")
            see(page.locator("#right-1")).to_have_text("–")
            see(page.locator("#near")).to_contain_text("not known now")
            assert said == []
    finally:
        recorder.end()


@pytest.mark.thorough
def test_a_check_from_the_page_looks_and_moves_nothing(web: Web) -> None:
    """Asked for it is begun at once; rows for which something moves are left out, whatever else there is."""
    began = httpx.post(f"{web.url}api/check", headers=web.known, timeout=20.0).json()
    assert began["is_running"] and began["report"] is None
    seen = wait_for(
        lambda: None if (now := web.get("/api/check").json())["is_running"] else now, "the report", seconds=80.0
    )
    verdicts = {row["name"]: row["verdict"] for row in seen["report"]["rows"]}
    assert verdicts["network"] == verdicts["types"] == "pass" and verdicts["move_left"] == verdicts["echo"] == "skipped"


@pytest.mark.thorough
def test_the_cameras_are_shown_and_nothing_is_received_for_nobody(systems, tmp_path: Path) -> None:
    """A view as motion JPEG; when nobody looks any more, the port is free for others."""
    pytest.importorskip("av")
    image = pytest.importorskip("PIL.Image")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    system = systems(tmp_path, has_guard=False, sim_options=("--camera-to", f"127.0.0.1:{port}"))
    system.connect("first").close()
    wait_for(lambda: "SSRC" in system.sim.text(), "cameras that send", 200.0, system.sim.text)  # encoded once, slowly
    web = Web(system, "--video", "--video-port", str(port))
    try:
        assert web.get("/api/video/ceiling").status_code == 400
        assert not web.get("/api/video").json()["is_receiving"]
        url = f"{web.url}api/video/head_left_eye"
        with httpx.stream("GET", url, headers=web.known, timeout=60.0) as answer:
            assert answer.headers["content-type"].startswith("multipart/x-mixed-replace")
            coming, parts = answer.iter_bytes(), b""
            while parts.count(b"image/jpeg") <= 3:
                parts += next(coming)
            assert web.get("/api/video").json()["is_receiving"]
        picture = parts.split(b"\r\n\r\n")[1].split(b"\r\n--")[0]
        assert max(image.open(io.BytesIO(picture)).size) == 640
        wait_for(lambda: not web.get("/api/video").json()["is_receiving"], "the end", tell=web.process.text)
    finally:
        web.process.end()
