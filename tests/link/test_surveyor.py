"""Rules of `gateway.link.surveyor`: a look without a gateway sees everything, sends nothing and names what it cannot reach."""

from __future__ import annotations

import json
import socket
import threading

import pytest
import zenoh

from cdr_types.keys import Qos, Reliability, Token, TokenKind, format_token, topic_to_key
from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.streams.gate import Cleared
from gateway.link.codec import BadFrame
from gateway.link.robot_link import RobotLink
from gateway.link.surveyor import look
from gateway.robot.topics import FSM_ENABLE, FSM_STATE, STATE_TOPICS, TOPICS
from gateway.settings.settings import LinkSettings
from tests.link.robot_process import RobotProcess, wait_until

pytestmark = pytest.mark.e2e


@pytest.fixture
def start(port):
    """Starts a stand-in robot under a namespace, and ends it."""
    started = []

    def begin(namespace: str = "") -> RobotProcess:
        started.append(RobotProcess(port, namespace).start())
        return started[-1]

    yield begin
    for process in started:
        process.kill()


def test_a_look_sees_a_healthy_robot_and_leaves_no_trace(start):
    """Every topic that comes is active at its rate; the robot saw no token and no command of it."""
    process = start()
    wire = look(LinkSettings(endpoint=process.endpoint), is_named=False, listen_s=2.5)
    assert wire.is_up and wire.router_zid == process.zid and wire.robots == ("",) and wire.trouble == ""
    assert {topic.name for topic in wire.topics if topic.route == "active"} >= {*STATE_TOPICS}
    by_name = {topic.name: topic for topic in wire.topics}
    assert by_name[FSM_STATE].rate_hz == pytest.approx(20.0, rel=0.5)
    assert by_name[FSM_ENABLE].route == "active"
    assert wire.bridges[0].version == "9.9.9" and wire.router_version.startswith("v1.")
    assert [who.kind for who in wire.neighbours] == ["self", "robot"] and wire.clock_ns is not None
    seen = process.ask("stats")
    assert seen["received"] == {} and seen["foreign_tokens"] == []


def test_the_only_robot_is_looked_at_whatever_its_namespace_unless_one_was_named(start):
    """Found by its tokens; a namespace that was asked for is kept, and the other robot is named."""
    process = start("bot1")
    found = look(LinkSettings(endpoint=process.endpoint), is_named=False, listen_s=1.0)
    assert found.namespace == "bot1" and found.topics[0].route == "active"
    named = look(LinkSettings(endpoint=process.endpoint, namespace="bot2"), is_named=True, listen_s=0.5)
    assert (named.namespace, named.robots) == ("bot2", ("bot1",)) and named.topics[0].route == "unannounced"


def test_of_several_robots_none_is_taken(start):
    """They are listed."""
    process = start("bot1")
    config = {"mode": "client", "connect": {"endpoints": [process.endpoint]}}
    config["scouting"] = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as other:
        tokens = [
            other.liveliness().declare_token(
                format_token(
                    Token(
                        zid=str(other.zid()),
                        kind=TokenKind.MP,
                        topic=f"/{topic_to_key(topic, 'bot2')}",
                        type_name=TOPICS[topic].type_name,
                        qos=Qos(reliability=Reliability.RELIABLE),
                    )
                )
            )
            for topic in STATE_TOPICS
        ]
        wire = look(LinkSettings(endpoint=process.endpoint), is_named=False, listen_s=1.0)
        assert (wire.namespace, wire.robots) == ("", ("bot1", "bot2")) and len(tokens) == len(STATE_TOPICS)


def test_who_only_looks_can_send_nothing(start):
    """Not even what a gate has cleared."""
    link = RobotLink(LinkSettings(endpoint=start().endpoint), is_reader=True)
    link.open()
    try:
        wait_until(lambda: link.is_up, what="a transport")
        with pytest.raises(BadFrame):
            link.publish(Cleared(Frame(topic=FSM_ENABLE, values=(0.0,), kind=FrameKind.STOP, epoch=0, due_ns=0)))
    finally:
        assert link.close()


def test_nothing_listens_there(port):
    """The host is there, its port is closed."""
    wire = look(LinkSettings(endpoint=f"tcp/127.0.0.1:{port}"), is_named=False)
    assert not wire.is_up and f"nothing listens on its port {port}" in wire.trouble


def test_a_host_that_nobody_knows():
    """A name with a slip of the keyboard in it."""
    wire = look(LinkSettings(endpoint="tcp/no-such-robot.invalid:9000"), is_named=False)
    assert wire.trouble == "nobody knows a host named no-such-robot.invalid"


def test_something_else_listens_there(port):
    """A port that accepts and says nothing is no router."""
    ending = threading.Event()
    with socket.create_server(("127.0.0.1", port)) as server:
        server.settimeout(0.1)
        kept = []

        def accept() -> None:
            while not ending.is_set():
                try:
                    kept.append(server.accept()[0])
                except TimeoutError:
                    continue

        thread = threading.Thread(target=accept)
        thread.start()
        try:
            wire = look(LinkSettings(endpoint=f"tcp/127.0.0.1:{port}"), is_named=False)
        finally:
            ending.set()
            thread.join()
            for end in kept:
                end.close()
    assert "does not answer as a zenoh router does" in wire.trouble
