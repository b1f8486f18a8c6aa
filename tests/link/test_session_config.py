"""Rules of `gateway.link.session_config`: what may leave the process, and that nothing else can."""

from __future__ import annotations

import json
import socket
from functools import partial

import pytest
import zenoh

from cdr_types.keys import topic_to_key
from gateway.link.codec import MAX_OTHER_BYTES, MAX_SAMPLE_BYTES
from gateway.link.connecting import connect
from gateway.link.robot_link import RobotLink
from gateway.link.session_config import MAX_TAKEN_BYTES, session_config
from gateway.robot.topics import STATE_TOPICS, VARIANTS
from gateway.settings.settings import LinkSettings
from tests.link.robot_process import RobotProcess, wait_until


def parsed(**settings):
    """Return the configuration for these settings."""
    return json.loads(session_config(LinkSettings(**settings)))


def rules(config):
    """Return the access-control rules by id."""
    return {rule["id"]: rule for rule in config["access_control"]["rules"]}


def test_the_zone_of_an_address_is_a_number_for_zenoh_whose_interface_was_named():
    """`%lo` as people type it: zenoh never connects to that, and does not say why."""
    number = socket.if_nametoindex("lo")
    for zone in ("lo", number):
        (endpoint,) = parsed(endpoint=f"tcp/[fe80::1%{zone}]:9000")["connect"]["endpoints"]
        assert endpoint.startswith(f"tcp/[fe80::1%{number}]:9000#")
    assert parsed(endpoint="tls/[fe80::1%lo]:9000")["connect"]["endpoints"] == [f"tls/[fe80::1%{number}]:9000"]


def test_an_interface_that_is_not_there_is_told_and_waited_for(caplog, monkeypatch):
    """Once, with its name and what to look at: an adapter may come later, or again under another number."""
    robot = LinkSettings(endpoint="tcp/[fe80::1%usb7]:9000")
    RobotLink(robot)
    wanted = iter([True] * 4 + [False])
    assert connect(partial(session_config, robot), robot.endpoint, lambda seconds: next(wanted)) is None
    assert caplog.text.count("no network interface 'usb7': `ip link` lists those it has") == 1
    monkeypatch.setattr("socket.if_nametoindex", {"usb7": 7}.__getitem__)
    assert "%7]" in session_config(robot)


@pytest.mark.parametrize("model", sorted(VARIANTS))
def test_only_the_exact_command_keys_of_the_model_may_be_put(model):
    """Everything else is denied: `put` is allowed by one rule, on as many exact keys as the model has commands."""
    config = parsed(model=model)
    assert config["access_control"]["default_permission"] == "deny"
    allowed = [rule for rule in rules(config).values() if "put" in rule["messages"] and "egress" in rule["flows"]]
    assert [rule["id"] for rule in allowed] == ["out"]
    assert sorted(allowed[0]["key_exprs"]) == sorted(topic[1:] for topic in VARIANTS[model].command_topics)
    assert not any("*" in key for key in allowed[0]["key_exprs"])


@pytest.mark.parametrize("model", sorted(VARIANTS))
def test_only_the_lift_model_may_command_the_lift(model):
    """`/api/servo/cmd` exists on the upgraded model alone (§4.6)."""
    has_lift = "api/servo/cmd" in rules(parsed(model=model))["out"]["key_exprs"]
    assert has_lift == (model == "lift")


def test_no_rule_lets_a_delete_out():
    """A delete would stall a topic of the robot for half a second (wire.md 3.2)."""
    for rule in rules(parsed()).values():
        assert not ("delete" in rule["messages"] and "egress" in rule["flows"])


def test_no_rule_has_both_directions():
    """One rule with ingress and egress would let others inject what we only read (wire.md 9.3)."""
    config = parsed()
    assert all(len(rule["flows"]) == 1 for rule in rules(config).values())
    assert config["access_control"]["policies"] == [
        {"rules": ["out", "sub", "tok", "in", "q", "r"], "subjects": ["all"]}
    ]
    assert all(rule["permission"] == "allow" for rule in rules(config).values())


def test_the_namespace_is_in_front_of_every_data_key():
    """With a namespace the bridge prefixes absolute names too (wire.md 1.1)."""
    config = parsed(namespace="/bot1", model="lift")
    data = rules(config)
    keys = [*data["out"]["key_exprs"], *data["sub"]["key_exprs"], *data["in"]["key_exprs"]]
    keys += config["low_pass_filter"][0]["key_exprs"]
    assert keys and all(key.startswith("bot1/") for key in keys)
    assert "bot1/api/left_arm/joint_cmd" in data["out"]["key_exprs"]


def test_every_state_topic_may_be_subscribed_and_come_in():
    """The rules include each state key."""
    for namespace in ("", "bot1"):
        data = rules(parsed(namespace=namespace))
        for topic in STATE_TOPICS:
            key = zenoh.KeyExpr(f"{namespace}{topic}".strip("/"))
            for name in ("sub", "in"):
                assert any(zenoh.KeyExpr(rule).includes(key) for rule in data[name]["key_exprs"]), (name, topic)


def test_the_fence_and_the_reconnect_are_as_recommended():
    """Announced lease with four keepalives, small send buffer, fast retry, no shared memory (wire.md 10.1)."""
    config = parsed(lease_ms=300)
    transmission = config["transport"]["link"]["tx"]
    assert (transmission["lease"], transmission["keep_alive"], transmission["batch_size"]) == (300, 4, 65_535)
    assert transmission["queue"]["congestion_control"] == {
        "drop": {"wait_before_drop": 500},
        "block": {"wait_before_close": 500000},
    }
    sizes = transmission["queue"]["size"]
    assert (sizes["interactive_high"], sizes["real_time"]) == (8, 2)  # a whole tick of frames without waiting
    assert config["mode"] == "client"
    assert config["connect"]["endpoints"] == ["tcp/127.0.0.1:9000#so_sndbuf=16384"]
    assert config["connect"]["retry"] == {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5}
    assert config["listen"]["endpoints"] == []
    assert config["scouting"] == {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
    assert config["timestamping"] == {"enabled": True}
    assert config["transport"]["shared_memory"] == {"enabled": False}
    assert config["low_pass_filter"][0] == {
        "id": "size",
        "flows": ["egress"],
        "messages": ["put"],
        "key_exprs": ["api/**"],
        "size_limit": 1024,
    }
    taken = config["low_pass_filter"][1]
    assert taken["flows"] == ["ingress"] and taken["size_limit"] > max(MAX_OTHER_BYTES, *MAX_SAMPLE_BYTES.values())
    keys = [zenoh.KeyExpr(key) for key in taken["key_exprs"]]
    assert all(any(key.includes(zenoh.KeyExpr(topic_to_key(topic))) for key in keys) for topic in STATE_TOPICS)


@pytest.mark.parametrize(
    ("endpoint", "expected"),
    [
        ("tcp/10.0.0.1:9000", "tcp/10.0.0.1:9000#so_sndbuf=16384"),
        ("tcp/10.0.0.1:9000#iface=eth0", "tcp/10.0.0.1:9000#iface=eth0;so_sndbuf=16384"),
        ("tcp/10.0.0.1:9000#so_sndbuf=4096", "tcp/10.0.0.1:9000#so_sndbuf=4096"),
        ("udp/10.0.0.1:9000", "udp/10.0.0.1:9000"),
    ],
)
def test_the_send_buffer_is_added_to_tcp_endpoints_only(endpoint, expected):
    """What somebody wrote into the endpoint stays."""
    assert parsed(endpoint=endpoint)["connect"]["endpoints"] == [expected]


@pytest.mark.parametrize("namespace", ["", "a/b"])
@pytest.mark.parametrize("model", sorted(VARIANTS))
def test_zenoh_accepts_the_configuration(model, namespace):
    """Every field has a name and a type that zenoh knows."""
    zenoh.Config.from_json5(session_config(LinkSettings(model=model, namespace=namespace)))


@pytest.mark.e2e
def test_an_answer_longer_than_a_batch_arrives_whole(port):
    """A bridge with many routes says more about them than fits into 8 KiB: zenoh cuts it up and puts it together."""
    endpoint = f"tcp/127.0.0.1:{port}"
    listener = {"mode": "router", "listen": {"endpoints": [endpoint]}, "scouting": {"multicast": {"enabled": False}}}
    key, long = "@/a1/ros2/tall", bytes(range(256)) * 400
    with zenoh.open(zenoh.Config.from_json5(json.dumps(listener))) as router:
        held = router.declare_queryable(key, lambda query: query.reply(key, long))
        with zenoh.open(zenoh.Config.from_json5(session_config(LinkSettings(endpoint=endpoint)))) as session:

            def answers():
                return [reply.ok.payload.to_bytes() for reply in session.get(key) if reply.ok is not None]

            assert wait_until(answers, what="the answer") == [long]
        held.undeclare()


@pytest.mark.e2e
def test_only_the_keys_of_the_profile_leave_the_process(port):
    """Puts elsewhere, deletes and oversized payloads stay here; with access control off all of them arrive."""
    settings = LinkSettings(endpoint=f"tcp/127.0.0.1:{port}", model="standard")
    guarded = json.loads(session_config(settings))
    open_config = {k: v for k, v in guarded.items() if k not in ("access_control", "low_pass_filter")}
    robot_process = RobotProcess(port).start()
    try:
        arrived = {}
        for name, config in (("guarded", guarded), ("open", open_config)):
            robot_process.ask("clear")
            session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
            try:
                session.put("api/servo/cmd", b"lift")  # not on this model
                session.put("api/current_mode", b"mode")  # the robot's own
                session.delete("api/fsm/enable")
                session.put("api/chassis/velocity", bytes(2000))
                session.put("api/left_arm/joint_cmd", b"allowed")
                session.put("api/fsm/enable", b"last")
                received = wait_until(lambda: _last_has_come(robot_process), what=f"the last put, {name}")
            finally:
                session.close()
            arrived[name] = {key: [entry.split()[0] for entry in entries] for key, entries in received.items()}
        assert arrived["guarded"] == {"api/left_arm/joint_cmd": ["put"], "api/fsm/enable": ["put"]}
        assert arrived["open"] == {
            "api/servo/cmd": ["put"],
            "api/current_mode": ["put"],
            "api/fsm/enable": ["delete", "put"],
            "api/chassis/velocity": ["put"],
            "api/left_arm/joint_cmd": ["put"],
        }
    finally:
        robot_process.kill()


def _last_has_come(robot_process):
    received = robot_process.ask("stats")["received"]
    return received if any(b"last".hex() in entry for entry in received.get("api/fsm/enable", [])) else None


@pytest.mark.e2e
def test_a_sample_larger_than_any_of_the_robots_ends_in_zenoh(port):
    """A thousand of them would wait for the loop. What comes in is not what goes out: the link stays as it is."""
    endpoint = f"tcp/127.0.0.1:{port}"
    listener = {"mode": "router", "listen": {"endpoints": [endpoint]}, "scouting": {"multicast": {"enabled": False}}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(listener))) as router:
        with zenoh.open(zenoh.Config.from_json5(session_config(LinkSettings(endpoint=endpoint)))) as session:
            heard = []
            take = zenoh.handlers.Callback(lambda sample: heard.append(len(sample.payload)), indirect=False)
            subscriber = session.declare_subscriber("left_arm/joint_states", take)
            wait_until(lambda: (router.put("left_arm/joint_states", bytes(5)), heard)[1], what="a sample")
            for size in (400, MAX_TAKEN_BYTES + 1, 10_000_000, 401):
                router.put("left_arm/joint_states", bytes(size))
            wait_until(lambda: 401 in heard, what="the last one")
            assert [size for size in heard if size != 5] == [400, 401]
            subscriber.undeclare()


def test_who_only_looks_can_put_nothing_and_is_no_token():
    """No rule lets a sample or a token of ours out; questions and subscriptions are as ever; zenoh accepts it."""
    text = session_config(LinkSettings(model="lift"), is_reader=True)
    config = json.loads(text)
    egress = [rule for rule in rules(config).values() if "egress" in rule["flows"]]
    assert {message for rule in egress for message in rule["messages"]} == {
        "declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber",
    }  # fmt: skip
    assert config["access_control"]["default_permission"] == "deny"
    assert set(rules(config)) == set(rules(parsed(model="lift"))) - {"out", "tok"}
    zenoh.Config.from_json5(text)


def test_a_reader_that_is_heard_may_announce_its_subscriptions_and_nothing_else():
    """A recorder: without its tokens a gateway that leaves would end what it hears; it is no gateway to others."""
    config = json.loads(session_config(LinkSettings(model="lift"), is_reader=True, is_heard=True))
    assert set(rules(config)) == set(rules(parsed(model="lift"))) - {"out"}
    assert rules(config)["tok"]["key_exprs"] == ["@/*/@ros2_lv/MS/*/*/*"]
    egress = [rule for rule in rules(config).values() if "egress" in rule["flows"]]
    assert "put" not in {message for rule in egress for message in rule["messages"]}
