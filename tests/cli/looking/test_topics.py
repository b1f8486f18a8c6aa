"""Tests of `ta2 topics`."""

from __future__ import annotations

from msgspec.structs import replace

from gateway.api import protocol
from gateway.cli.looking.topics import document, lines, route_lines
from gateway.messages.snapshot import StreamView
from gateway.robot.topics import STATE_TOPICS, TOPICS, VARIANTS
from tests.cli.views import INFO, MS, S, a_view, all_topics

ROUTES = protocol.Routes(routes={"/fsm_state": "ready"}, bridge_version="1.10.2", undelivered=0)


def test_routes_are_one_line_when_all_is_well_and_one_each_when_not():
    """What keeps a command from arriving is said in words; nothing is said before anybody knows."""
    assert list(route_lines(protocol.Routes(routes={}, bridge_version="", undelivered=0))) == []
    (_, well) = route_lines(ROUTES)
    assert well.plain == "the robot's bridge (1.10.2): all 1 routes are ready"
    ill = {"/fsm_state": "ready", "/api/fsm/enable": "nobody listens"}
    told = list(route_lines(protocol.Routes(routes=ill, bridge_version="", undelivered=4)))
    assert [line.plain for line in told[1:]] == [
        "the robot's bridge: 1 of 2 routes are not ready",
        "  /api/fsm/enable: nobody listens",
        "  4 frames were not sent for want of a transport",
    ]


def rows(**changes):
    """Return the lines by their first word."""
    return {line.plain.split()[0]: line for line in lines(INFO, a_view(**changes)) if line.plain}


def test_every_topic_of_the_model_has_a_row(shell):
    """All state topics and all commands of this model, with type and nominal rate; no lift without a lift."""
    ended = shell.run("topics")
    assert ended.status == 0 and shell.names == ["ta2 topics"]
    for name in (*STATE_TOPICS, *VARIANTS["standard"].command_topics):
        (row,) = [line for line in ended.out.splitlines() if line.startswith(f"{name} ")]
        assert TOPICS[name].type_name.rpartition("/")[2] in row and f" {TOPICS[name].rate_hz:g} " in row
    assert "/api/servo/cmd" not in ended.out
    assert all(len(line) <= 100 for line in ended.out.splitlines())


def test_topics_as_json(shell):
    """The same for scripts: seconds and hertz, null for what was never heard."""
    topics = shell.run("topics", "--json").json
    assert set(topics) == {*STATE_TOPICS, *VARIANTS["standard"].command_topics}
    assert topics["/fsm_state"]["age_s"] == 0.02 and topics["/fsm_state"]["rate_hz"] == 20.0
    assert topics["/chassis/joint_states"]["age_s"] is None
    assert topics["/api/fsm/enable"]["running"] is True and topics["/api/fsm/enable"]["sent"] == 3
    assert "rate_hz" not in topics["/api/left_gripper/cmd"]
    assert document(INFO, a_view(), ROUTES)["/fsm_state"]["section"] == "§4.11.1"
    assert document(INFO, a_view(), ROUTES)["/fsm_state"]["route"] == "ready"


def test_rows_tell_what_is_wrong():
    """Old is red, slow or repeated is yellow, a stream beyond the robot's watchdog is red."""
    topics = all_topics()
    topics["/fsm_state"] = replace(topics["/fsm_state"], age_ns=S)
    topics["/left_arm/joint_states"] = replace(topics["/left_arm/joint_states"], rate_hz=100.0)
    topics["/right_arm/joint_states"] = replace(topics["/right_arm/joint_states"], duplicates=3)
    topics["/chassis/joint_states"] = replace(topics["/chassis/joint_states"], age_ns=None)
    del topics["/left_gripper/joint_states"]
    streams = {
        "/api/left_arm/joint_cmd": StreamView(running=True, sent=9, rate_hz=100.0, worst_gap_ns=160 * MS),
        "/api/right_arm/joint_cmd": StreamView(running=True, sent=9, rate_hz=100.0, worst_gap_ns=12 * MS),
        "/api/left_gripper/cmd": StreamView(running=True, sent=9, rate_hz=50.0, worst_gap_ns=160 * MS),
        "/api/fsm/enable": StreamView(running=False, sent=9, rate_hz=0.0, worst_gap_ns=50 * MS),
    }
    shown = rows(topics=topics, streams=streams)
    styles = {name: str(line.style) for name, line in shown.items()}
    assert styles["/fsm_state"] == styles["/chassis/joint_states"] == styles["/left_gripper/joint_states"] == "red"
    assert styles["/left_arm/joint_states"] == styles["/right_arm/joint_states"] == "yellow"
    assert styles["/left_arm/current_ee_pose"] == ""
    assert styles["/api/left_arm/joint_cmd"] == "red" and styles["/api/right_arm/joint_cmd"] == "green"
    assert "never" in shown["/chassis/joint_states"].plain
    assert shown["/api/fsm/enable"].plain.endswith("off") and "50 ms" in shown["/api/fsm/enable"].plain
    assert styles["/api/left_gripper/cmd"] == "green", "the robot keeps its last command (§4.4)"
    assert shown["/api/right_gripper/cmd"].plain.endswith("unused")
