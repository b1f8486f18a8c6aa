"""`ta2 check` without a robot: what it prints, when it asks, and that nothing moves unless somebody said so."""

from __future__ import annotations

import socket
import time

import pytest

from gateway.api.protocol import Wire
from gateway.cli.check import command
from gateway.cli.check.capture import Capture
from gateway.cli.check.rows import MOVING, POINTS, row
from gateway.cli.check.trials import Trials
from gateway.errors import Code, Disconnected, Refusal
from tests.cli.check.seen import NAMES, START_NS, Bench

NOWHERE = "tcp/127.0.0.1:9"


@pytest.fixture
def nobody(monkeypatch):
    """Nobody answers at the robot's address."""
    monkeypatch.setattr(
        "gateway.link.surveyor.look", lambda settings, **_: Wire(endpoint=settings.endpoint, namespace="", model="lift")
    )
    monkeypatch.setattr(command, "knock", lambda endpoint: (None, f"{endpoint}: Connection refused"))


@pytest.fixture
def robot(monkeypatch):
    """A healthy robot, as it was seen; nothing is connected to. What trials are made of is returned."""
    bench = Bench()
    bench.run(3.2)
    seen = bench.seen()
    tried = []

    class Tap:
        """Has heard everything already."""

        def __init__(self, settings, topics, take):
            later_ns = time.monotonic_ns() - START_NS
            for number, name in enumerate(NAMES):
                for at_ns, payload in bench.capture.arrivals(name):
                    take(number, at_ns + later_ns, payload)

        def open(self):
            """There is nothing to open."""

        def close(self):
            """Nor to close."""

    def all_of(self, running):
        tried.append((self.parts, running))
        return [row(name, True, "") for name in MOVING]

    monkeypatch.setattr("gateway.link.surveyor.look", lambda *_, **__: seen.wire)
    monkeypatch.setattr(command, "knock", lambda _: (0.001, ""))
    monkeypatch.setattr(command, "Tap", Tap)
    monkeypatch.setattr(command, "LEAST_S", 0.0)
    monkeypatch.setattr(Trials, "all", all_of)
    return tried


def test_a_robot_that_is_not_there_is_one_row(shell, nobody, tmp_path):
    """What depends on it is skipped; the same as JSON, and as a page that needs nothing else and escapes everything."""
    page = tmp_path / "report.html"
    ended = shell.run("check", "--robot", NOWHERE, "--json", "--html", str(page))
    rows = {each["name"]: each for each in ended.json["rows"]}
    assert ended.status == 1 and not ended.json["ok"] and set(rows) == set(POINTS)
    assert {name for name, each in rows.items() if each["verdict"] == "fail"} == {"network"}
    assert {each["verdict"] for each in rows.values()} == {"fail", "skipped"} and rows["network"]["remedy"]
    text = page.read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>") and "&lt;= 3" in text and "<script" not in text and "http" not in text
    ended = shell.run("check", "--robot", NOWHERE)
    assert ended.status == 1 and "fail" in ended.out and "1 fail" in ended.out


def test_a_page_that_cannot_be_written_is_refused(shell, nobody, tmp_path):
    """Before anything is looked at, and long before anything moves; one that cannot be in the end loses no report."""
    ended = shell.run("check", "--robot", NOWHERE, "--html", str(tmp_path / "nowhere" / "a.html"))
    assert ended.status == 2 and "argument --html" in ended.err and not ended.out
    (tmp_path / "a.html").symlink_to(tmp_path / "gone" / "a.html")
    ended = shell.run("check", "--robot", NOWHERE, "--html", str(tmp_path / "a.html"))
    assert ended.status == 2 and "network" not in ended.err and "--html FILE" in ended.err and "1 fail" in ended.out


def test_without_a_gateway_it_says_that_none_is_needed(shell, monkeypatch):
    """Where the robot is can be said here."""

    def none(*_, **__):
        raise Disconnected(Refusal(code=Code.DISCONNECTED, message="there is no socket"))

    monkeypatch.setattr("gateway.client.connect", none)
    ended = shell.run("check")
    assert ended.status == 3 and "or name the robot with --robot" in ended.err


def test_nothing_moves_unless_somebody_said_the_word(shell, robot):
    """Not in a script without it, nor by another word; `move` is the word."""
    for options in ((), ("--consent", "yes"), ("--consent", "MOVE")):
        ended = shell.run("check", "--robot", NOWHERE, "--json", *options)
        assert ended.status == 0 and ended.json["ok"]
        assert {each["verdict"] for each in ended.json["rows"] if each["name"] in MOVING} == {"skipped"}
    assert not robot
    ended = shell.run("check", "--robot", NOWHERE, "--json", "--consent", "move")
    assert ended.status == 0 and robot == [({"left_arm": True, "right_arm": True, "chassis": True}, None)]


@pytest.mark.parametrize(("typed", "moves"), [("move\n", True), ("y\n", False), ("\n", False), ("", False)])
def test_a_person_is_asked_at_a_terminal(shell, robot, monkeypatch, typed, moves):
    """With what will happen; anything but the word leaves it."""
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setattr("sys.stdin.readline", lambda: typed, raising=False)
    monkeypatch.setattr("gateway.cli.check.command.termios.tcflush", lambda *_: None)
    ended = shell.run("check", "--robot", NOWHERE)
    assert bool(robot) == moves and "MOVES the robot" in ended.err and ended.status == 0


def test_nothing_moves_while_something_is_wrong(shell, robot):
    """Whoever agreed: the saved mode is another one."""
    ended = shell.run("check", "--robot", NOWHERE, "--json", "--consent", "move", "--mode", "pose")
    assert ended.status == 1 and not robot
    assert [each["name"] for each in ended.json["rows"] if each["verdict"] == "fail"] == ["control"]


def test_a_gateway_that_runs_says_where_the_robot_is_and_moves_it(shell, robot):
    """Its client is called after the command."""
    ended = shell.run("check", "--json", "--consent", "move")
    assert ended.status == 0 and robot[0][1] is not None and shell.names == ["ta2 check", "ta2 check"]


def test_the_cameras_are_rows_of_their_own(shell, robot, monkeypatch):
    """Judged by `ta2 video check`; without its extra the row says what to install."""
    from gateway.cli.cameras.check import Point, Report
    from gateway.video.errors import VideoCode, VideoError

    points = (
        Point(name="first picture", ok=True, found="1 s"),
        Point(name="views", ok=False, found="5", why=("short",)),
    )
    nothing = {"first_s": 1.0, "fps": 45.0, "frames": 9, "decoder": "", "counts": {}, "findings": (), "recording": None}
    report = Report(ok=False, points=points, folder=None, **nothing)
    monkeypatch.setattr("gateway.cli.cameras.check.examined", lambda *_, **__: report)
    ended = shell.run("check", "--robot", NOWHERE, "--json", "--video")
    rows = {each["name"]: each for each in ended.json["rows"]}
    assert ended.status == 1 and (rows["video_1"]["verdict"], rows["video_2"]["verdict"]) == ("pass", "fail")
    assert rows["video_2"]["title"] == "views" and rows["video_2"]["remedy"] == "short"

    def fail(*_, **__):
        raise VideoError(VideoCode.NOT_INSTALLED, "av is not installed", "pip install")

    monkeypatch.setattr("gateway.cli.cameras.check.examined", fail)
    ended = shell.run("check", "--robot", NOWHERE, "--json", "--video")
    (row_,) = [each for each in ended.json["rows"] if each["name"] == "video"]
    assert row_["verdict"] == "fail" and row_["remedy"] == "pip install"


def test_only_a_tcp_port_is_knocked_at():
    """Whoever does not answer is told why."""
    assert command.knock("serial//dev/ttyUSB0") == (None, "")
    assert command.knock("tcp/[::1]") == (None, "")
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
        assert command.knock(f"tcp/127.0.0.1:{port}#iface=lo") == (
            None,
            f"tcp/127.0.0.1:{port}#iface=lo: Connection refused",
        )
        closed.listen()
        took_s, error = command.knock(f"tcp/127.0.0.1:{port}")
        assert took_s is not None and not error


def test_listening_ends_when_each_state_has_come_or_the_time_is_over(monkeypatch):
    """As the manual says (§2.7.1)."""
    from tests.cli.check.test_trials import Told

    bench = Bench()
    bench.run(1.2)
    monkeypatch.setattr(command, "LEAST_S", 0.0)
    command._listen(bench.capture, bench.seen().wire, Told())
    monkeypatch.setitem(command.POINTS, "states", command.POINTS["states"]._replace(most=0.0))
    command._listen(Capture(NAMES), bench.seen().wire, Told())
