"""The simulated bridge shows a user what the real one shows (wire reference §1, §2, §4, §5)."""

from __future__ import annotations

import json

import pytest
import zenoh

from cdr_types.keys import Token, TokenKind, format_token, parse_token
from cdr_types.messages import std_msgs
from gateway.sim.bridge import QOS, Bridge, bridge_config
from gateway.sim.robot.manual import FLOAT32, FSM_ENABLE, FSM_STATE, INT32
from tests.sim.wire import until, user_session

pytestmark = pytest.mark.e2e

ENDPOINT = "tcp/127.0.0.1:19130"
STATES, COMMANDS = {FSM_STATE: INT32}, {FSM_ENABLE: FLOAT32}


@pytest.fixture
def bridge():
    """A bridge with one state and one command topic; its clock always says 42."""
    made = Bridge(ENDPOINT, STATES, COMMANDS, lambda: 42)
    yield made
    made.close()


@pytest.fixture
def user(bridge):
    """A user's session."""
    session = user_session(ENDPOINT)
    yield session
    session.close()


def admin(bridge, user, selector: str) -> dict:
    """Ask the admin space, answering for the bridge's owner."""
    replies: list[zenoh.Reply] = []
    done: list[bool] = []
    user.get(selector, zenoh.handlers.Callback(replies.append, lambda: done.append(True), indirect=False), timeout=5.0)

    def answer():
        while bridge.queries:
            with bridge.queries.popleft() as query:
                bridge.answer(query)

    until(lambda: done, pump=answer)
    return {str(reply.ok.key_expr): json.loads(reply.ok.payload.to_string()) for reply in replies}


def tokens(user) -> set[str]:
    """All tokens that a user sees."""
    return {str(reply.ok.key_expr) for reply in user.liveliness().get("@/*/@ros2_lv/**", timeout=5.0)}


def test_a_namespace_is_before_every_key_and_in_every_token_and_entry():
    """As a bridge with that option has it; topics keep their names inside (wire reference §1.1)."""
    bridge = Bridge(ENDPOINT, STATES, COMMANDS, lambda: 42, "/bot1")
    try:
        user = user_session(ENDPOINT)
        try:
            kinds = {parse_token(key).kind: parse_token(key).topic for key in tokens(user)}
            assert kinds[TokenKind.MP] == f"/bot1{FSM_STATE}" and kinds[TokenKind.MS] == f"/bot1{FSM_ENABLE}"
            got: list[bytes] = []
            kept = user.declare_subscriber(f"bot1{FSM_STATE}", lambda sample: got.append(sample.payload.to_bytes()))
            until(lambda: bridge.wanted() == {FSM_STATE})
            bridge.publish(FSM_STATE, std_msgs.Int32(data=2))
            until(lambda: got)
            user.put(f"bot1{FSM_ENABLE}", b"hi")
            until(lambda: bridge.arrivals)
            assert bridge.arrivals.popleft().topic == FSM_ENABLE and kept is not None
            told = Token(zid="ab", kind=TokenKind.MS, topic=f"/bot1{FSM_STATE}", type_name=INT32, qos=QOS)
            token = user.liveliness().declare_token(format_token(told))
            root = f"@/{bridge.zid}/ros2"
            entry = f"{root}/route/topic/pub/bot1{FSM_STATE}"
            until(lambda: admin(bridge, user, f"{root}/**")[entry]["remote_routes"] == [f"ab:bot1{FSM_STATE}"])
            assert admin(bridge, user, f"{root}/config")[f"{root}/config"]["namespace"] == "/bot1" and token is not None
        finally:
            user.close()
    finally:
        bridge.close()


def test_configuration_is_a_router_with_ten_seconds_of_lease():
    """Scouting off, admin space readable and not writable, timestamps on (wire reference §1.3, §5.2, §6)."""
    config = json.loads(str(bridge_config(ENDPOINT)))
    assert config["mode"] == "router"
    assert config["transport"]["link"]["tx"]["lease"] == 10_000
    assert config["scouting"]["multicast"]["enabled"] is False
    assert config["adminspace"]["permissions"] == {"read": True, "write": False}


def test_tokens_announce_presence_publishers_and_subscribers(bridge, user):
    """One token per topic with the QoS of a Fast DDS node, and the bridge's own (§4.1 there)."""
    root = f"@/{bridge.zid}/@ros2_lv"
    assert tokens(user) == {
        root,
        f"{root}/MP/fsm_state/std_msgs§msg§Int32/:1::",
        f"{root}/MS/api§fsm§enable/std_msgs§msg§Float32/:1::",
    }
    assert all(parse_token(token).zid == bridge.zid for token in tokens(user))


def test_a_route_is_active_only_while_somebody_remote_subscribes(bridge, user):
    """No subscriber, no reader; with one there is (§2.2 there)."""
    assert bridge.wanted() == frozenset()
    subscriber = user.declare_subscriber("fsm_state")
    until(lambda: bridge.wanted() == {FSM_STATE})
    subscriber.undeclare()
    until(lambda: bridge.wanted() == frozenset())


def test_samples_are_plain_cdr_stamped_by_the_bridge(bridge, user):
    """Payload verbatim, no attachment, no source info, HLC id = zid of the bridge (§1.2, §1.3 there)."""
    subscriber = user.declare_subscriber("fsm_state", zenoh.handlers.FifoChannel(10))
    until(bridge.wanted)
    bridge.publish(FSM_STATE, std_msgs.Int32(data=2))
    sample = subscriber.recv()
    assert sample.payload.to_bytes() == b"\x00\x01\x00\x00\x02\x00\x00\x00"
    assert sample.attachment is None
    assert sample.source_info is None
    assert (sample.priority, sample.congestion_control) == (zenoh.Priority.DATA, zenoh.CongestionControl.BLOCK)
    assert bytes(sample.timestamp.get_id()).rstrip(b"\0")[::-1].hex().lstrip("0") == bridge.zid


def test_commands_are_stamped_at_arrival_in_order(bridge, user):
    """Puts and deletes on command keys are handed over with the time of their arrival."""
    for number in range(3):
        user.put("api/fsm/enable", bytes([number]))
    user.delete("api/fsm/enable")
    until(lambda: len(bridge.arrivals) == 4)
    assert [arrival.payload for arrival in bridge.arrivals] == [b"\0", b"\1", b"\2", None]
    assert {(arrival.topic, arrival.now_ns) for arrival in bridge.arrivals} == {(FSM_ENABLE, 42)}


def test_admin_space_tells_version_config_and_routes(bridge, user):
    """The entries that the gateway reads, with the plugin's field names (§5.1 there)."""
    root = f"@/{bridge.zid}/ros2"
    assert admin(bridge, user, "@/*/ros2/version") == {f"{root}/version": "v1.10.2 (simulated)"}
    assert admin(bridge, user, "@/*/ros2/config")[f"{root}/config"]["domain"] == 29
    sub = admin(bridge, user, f"{root}/route/topic/sub/api/fsm/enable")[f"{root}/route/topic/sub/api/fsm/enable"]
    assert (sub["is_active"], sub["ros2_name"], sub["ros2_type"]) == (True, FSM_ENABLE, FLOAT32)
    assert set(admin(bridge, user, f"{root}/route/topic/**")) == {
        f"{root}/route/topic/pub/fsm_state",
        f"{root}/route/topic/sub/api/fsm/enable",
    }


def publisher_route(bridge, user) -> dict:
    """The admin entry of the state route."""
    return next(iter(admin(bridge, user, "@/*/ros2/route/topic/pub/fsm_state").values()))


def test_admin_space_shows_the_reader_and_the_remote_routes(bridge, user):
    """`dds_reader` is empty without a subscriber; foreign MS tokens are listed as remote routes (§3.1 there)."""
    idle = publisher_route(bridge, user)
    assert (idle["dds_reader"], idle["remote_routes"], idle["priority"]) == ("", [], 5)
    zid = str(user.zid())
    own = Token(zid=zid, kind=TokenKind.MS, topic=FSM_STATE, type_name=INT32, qos=QOS)
    token = user.liveliness().declare_token(format_token(own))
    subscriber = user.declare_subscriber("fsm_state")
    until(bridge.wanted)
    until(lambda: publisher_route(bridge, user)["remote_routes"] == [f"{zid}:fsm_state"])
    assert len(publisher_route(bridge, user)["dds_reader"]) == 32
    token.undeclare()
    until(lambda: publisher_route(bridge, user)["remote_routes"] == [])
    subscriber.undeclare()


def test_a_foreign_command_publisher_is_a_remote_route_of_the_command(bridge, user):
    """MP tokens of others on command keys are listed there; other tokens are ignored."""
    zid = str(user.zid())
    declared = [
        user.liveliness().declare_token(format_token(token))
        for token in (
            Token(zid=zid, kind=TokenKind.MP, topic=FSM_ENABLE, type_name=FLOAT32, qos=QOS),
            Token(zid=zid, kind=TokenKind.MP, topic="/somewhere", type_name=FLOAT32, qos=QOS),
            Token(zid=zid, kind=TokenKind.PRESENCE),
        )
    ]
    declared.append(user.liveliness().declare_token(f"@/{zid}/@ros2_lv/XX/a/b"))
    until(
        lambda: (
            next(iter(admin(bridge, user, "@/*/ros2/route/topic/sub/api/fsm/enable").values()))["remote_routes"]
            == [f"{zid}:api/fsm/enable"]
        )
    )


def test_a_dead_route_comes_back_with_a_new_first_subscriber(bridge, user):
    """The reader is gone although a subscriber matches; subscribing anew revives it (§3.1 b there)."""
    subscriber = user.declare_subscriber("fsm_state")
    until(bridge.wanted)
    bridge.set_dead(FSM_STATE, is_dead=True)
    assert bridge.wanted() == frozenset()
    assert publisher_route(bridge, user)["dds_reader"] == ""
    subscriber.undeclare()
    until(lambda: not bridge._routes[FSM_STATE].is_matched)
    subscriber = user.declare_subscriber("fsm_state")
    until(bridge.wanted)
    bridge.set_dead("*", is_dead=True)
    bridge.set_dead("*", is_dead=False)
    assert bridge.wanted() == {FSM_STATE}
    subscriber.undeclare()


def test_a_retired_node_leaves_only_the_bridge(bridge, user):
    """The robot's node away: no tokens, no routes, commands vanish; announced again, all is back (§3.1 b2 there)."""
    subscriber = user.declare_subscriber("fsm_state")
    until(bridge.wanted)
    bridge.retire()
    until(lambda: tokens(user) == {f"@/{bridge.zid}/@ros2_lv"})
    assert bridge.wanted() == frozenset()
    assert admin(bridge, user, "@/*/ros2/route/topic/**") == {}
    bridge.announce()
    bridge.announce()
    until(lambda: len(tokens(user)) == 3)
    until(bridge.wanted)
    subscriber.undeclare()


def test_closing_twice_is_harmless(bridge):
    """An end is an end."""
    bridge.close()
    bridge.close()


def test_a_port_in_use_is_an_error(bridge):
    """The second router on the same endpoint is refused."""
    with pytest.raises(zenoh.ZError):
        Bridge(ENDPOINT, STATES, COMMANDS, lambda: 0)
