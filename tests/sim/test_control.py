"""Rules of the control channel's requests, without a wire."""

from __future__ import annotations

import json

import pytest

from cdr_types.messages import std_msgs
from gateway.sim.control import Control
from gateway.sim.robot.faults import FAULTS
from gateway.sim.robot.manual import S
from gateway.sim.robot.model import SimRobot
from tests.sim.drivers import joints


class FakeNode:
    """Remembers what it was told."""

    def __init__(self) -> None:
        self.begun: list[str] = []
        self.cleared: list[tuple] = []
        self.is_ended = False

    def begin(self, fault, now_ns):
        self.begun.append(fault.name)

    def clear(self, name, topic):
        self.cleared.append((name, topic))
        return 1

    def shut_down(self):
        self.is_ended = True


class Desk:
    """A robot, a node and the requests to both."""

    def __init__(self) -> None:
        self.robot, self.node = SimRobot(), FakeNode()
        self._control = Control(self.robot, self.node)

    def ask(self, **request) -> dict:
        """Send a request as JSON and read the answer."""
        return json.loads(self._control.answer(json.dumps(request), self.robot.now_ns))

    def raw(self, text: str) -> dict:
        """Send any text."""
        return json.loads(self._control.answer(text, 0))


def test_ping_tells_which_robot_this_is():
    """Model and commands."""
    answer = Desk().ask(do="ping")
    assert (answer["ok"], answer["model"]) == (True, "standard")
    assert "/api/fsm/enable" in answer["commands"]


def test_stats_state_and_reset():
    """What was seen, what is true, and a new beginning."""
    desk = Desk()
    desk.robot.receive("/api/left_arm/joint_cmd", joints([0.0] * 7), 0)
    assert desk.ask(do="stats")["commands"]["/api/left_arm/joint_cmd"]["count"] == 1
    assert desk.ask(do="state")["arms"]["left"]["is_streamed"] is True
    assert desk.ask(do="reset_stats") == {"ok": True}
    assert desk.ask(do="stats")["commands"] == {}


def test_log_is_followed_by_number():
    """Only entries after the given number come back."""
    desk = Desk()
    desk.robot.receive("/api/left_arm/joint_cmd", joints([0.0]), 0)
    desk.robot.receive("/api/fsm/enable", std_msgs.Float32(data=3.0), 0)
    entries = desk.ask(do="log")["entries"]
    assert [entry["code"] for entry in entries] == ["REFUSED_SHORT", "ENABLE_VALUE"]
    assert [entry["code"] for entry in desk.ask(do="log", since=1)["entries"]] == ["ENABLE_VALUE"]
    assert "since" in desk.ask(do="log", since="x")["error"]


def test_faults_go_to_the_robot_or_to_the_node():
    """Each to the one that has it; both can be cleared together."""
    desk = Desk()
    assert desk.ask(do="fault", fault="vr_mode") == {"ok": True, "fault": "vr_mode"}
    assert desk.ask(do="fault", fault="router_stop", duration_s=0.5)["ok"]
    assert (desk.robot.api_mode, desk.node.begun) == (False, ["router_stop"])
    listed = desk.ask(do="faults")
    assert (set(listed["known"]), listed["active"]) == (set(FAULTS), ["vr_mode"])
    assert desk.ask(do="clear", fault="vr_mode")["ended"] == 2
    assert desk.node.cleared == [("vr_mode", None)]
    assert desk.robot.api_mode


def test_shutdown_ends_the_node():
    """Orderly, after the answer."""
    desk = Desk()
    assert desk.ask(do="shutdown")["ok"]
    assert desk.node.is_ended


@pytest.mark.parametrize("text", ["", "[]", "{}", '"stats"', '{"do":"fly"}', '{"do":["x"]}', "\x00", '{"do":null}'])
def test_what_is_not_a_request_is_answered_with_the_known_ones(text):
    """Never silence, never an exception."""
    answer = Desk().raw(text)
    assert answer["ok"] is False
    assert answer["error"]


@pytest.mark.parametrize(
    "request_",
    [{"do": "fault", "fault": "x"}, {"do": "clear", "fault": 3}, {"do": "clear", "fault": "x"}, {"do": "fault"}],
)
def test_wrong_parameters_are_errors(request_):
    """The text says what was wrong."""
    answer = Desk().ask(**request_)
    assert answer["ok"] is False
    assert "fault" in answer["error"] and len(answer["error"]) < 500


def test_a_fault_acts_from_the_time_of_the_request():
    """Durations count from then on."""
    desk = Desk()
    desk.robot.advance(3 * S)
    desk.ask(do="fault", fault="vr_mode", duration_s=1.0)
    desk.robot.advance(4 * S - 1)
    assert not desk.robot.api_mode
    desk.robot.advance(4 * S)
    assert desk.robot.api_mode
