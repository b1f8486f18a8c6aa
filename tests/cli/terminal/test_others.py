"""Tests of how others on the robot are shown: in `ta2 status`, `ta2 topics` and among the next steps."""

from __future__ import annotations

import json

from gateway.cli.looking.status import lines
from gateway.cli.looking.topics import document, foreign_lines
from gateway.cli.terminal.advice import next_steps
from gateway.cli.terminal.others import foreign_on, other_text, others_in_order
from gateway.messages.snapshot import OthersView, OtherView
from tests.cli.views import INFO, MS, S, a_view

ARM = "/api/left_arm/joint_cmd"


def an_other(kind="data", **changes):
    """Return somebody, in the core's words."""
    facts = {"topic": ARM, "zid": "b0b", "link": "tcp/10.0.0.9:4711", "count": 0, "armed": False}
    facts |= {"kind": kind, "since_ns": 998 * S, "last_ns": None} | changes
    return OtherView(**facts)


def beside(*others):
    """Return a snapshot with these others."""
    return a_view(others=OthersView(zid="a1", armed=True, seen=others))


IDLE = an_other("gateway", topic="", zid="9", link="")
ARMED = an_other("gateway", topic="", zid="9", armed=True)
SENDING = an_other("data", count=12, last_ns=1000 * S - 5 * MS)
NAMELESS = an_other("data", zid="", link="", count=1)
ROS = an_other("token")
PUBLISHER = an_other("publisher", link="")


def test_everybody_is_one_line_with_who_where_what_and_since_when():
    """As far as it is known."""
    view = beside(IDLE, ARMED, SENDING, NAMELESS, ROS, PUBLISHER)
    assert [other_text(other, view.at_ns) for other in view.others.seen] == [
        "gateway 9 is connected, commands nothing, for 2.0 s",
        "gateway 9 at tcp/10.0.0.9:4711 commands the robot, for 2.0 s",
        "b0b at tcp/10.0.0.9:4711 has sent 12 commands on left_arm/joint_cmd for 2.0 s",
        "a session without a name has sent 1 commands on left_arm/joint_cmd for 2.0 s",
        "a ROS node behind b0b at tcp/10.0.0.9:4711 announces left_arm/joint_cmd, for 2.0 s",
        "a publisher of b0b announces left_arm/joint_cmd, for 2.0 s",
    ]


def test_whoever_is_in_the_way_comes_first():
    """A gateway that is only connected is in nobody's way."""
    view = beside(IDLE, SENDING, ARMED)
    assert [other.kind for other in others_in_order(view)] == ["data", "gateway", "gateway"]
    assert list(foreign_on(view, ARM)) == [view.others.seen[1]] and not list(foreign_on(view, "/fsm_state"))


def test_status_names_them():
    """One line each, up to four."""
    view = beside(IDLE, SENDING)
    text = "\n".join(line.plain for line in lines(INFO, view))
    assert "others     b0b at tcp/10.0.0.9:4711 has sent 12 commands" in text and "is connected" in text
    many = "\n".join(line.plain for line in lines(INFO, beside(*[SENDING] * 9)))
    assert many.count("has sent 12") == 4 + 1 and "and 5 more" in many  # once among the next steps
    alone = "\n".join(line.plain for line in lines(INFO, beside()))
    assert "others" not in alone


def test_topics_name_who_else_is_on_a_command():
    """In words, and for scripts as they are in the snapshot."""
    view = beside(SENDING, IDLE)
    assert [line.plain for line in foreign_lines(view) if line.plain][1:] == [
        f"  {ARM}: b0b at tcp/10.0.0.9:4711 has sent 12 commands on left_arm/joint_cmd for 2.0 s"
    ]
    assert list(foreign_lines(beside(IDLE))) == []
    routes = type("Routes", (), {"routes": {}})()
    rows = json.loads(json.dumps(document(INFO, view, routes)))
    assert rows[ARM]["foreign"] == [
        {
            "kind": "data", "topic": ARM, "zid": "b0b", "link": "tcp/10.0.0.9:4711", "since_ns": 998 * S,
            "last_ns": 1000 * S - 5 * MS, "count": 12, "armed": False,
        }
    ]  # fmt: skip
    assert rows["/api/fsm/enable"]["foreign"] == [] and "foreign" not in rows["/fsm_state"]


def test_the_next_step_is_to_end_the_other():
    """With the remedy of its code; nothing is said of a gateway that commands nothing."""
    told = [step.text for step in next_steps(beside(SENDING, ARMED), INFO) if step.level == "warning"]
    assert any("b0b" in text and "§3.3.2" in text for text in told)
    assert any("gateway 9" in text and "stop the other gateway" in text for text in told)
    assert not any("gateway 9" in step.text for step in next_steps(beside(IDLE), INFO))
