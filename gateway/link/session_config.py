"""The zenoh configuration of the robot session, as wire.md 10.1 recommends it: settings in, JSON out.

Pure, but for the number of a network interface, which is asked of the kernel.

What it guarantees whatever the code above does:

* Client mode: the session never forwards anything, it has one link to one router (wire.md 9.1).
* Egress firewall: everything is denied but `put` on the exact command keys of this model, the subscriptions to its
  state, its own liveliness tokens, and the questions that discovery asks. A `delete`, which would stall a topic of the
  robot for half a second, or a key that this model does not have never leaves the process (wire.md 3.2, 9.3).
* Of the router's own tables only what is needed may be asked for: some answers hang it (`foreign_watch`).
* Fence: the announced lease makes the robot's end forget whatever of ours is still under way after that much silence
  (wire.md fact 2). The small send buffer bounds our own part of such a backlog.
* Room for one tick: an express message takes a whole batch until the sender thread has come round, and with one batch
  per priority (as in wire.md) the next frame of the same tick waits for it, or is dropped after half a millisecond.
  Measured with six frames per tick and 4 CPU hogs: 45 to 59 of 1,360 frames lost with one batch, 0 to 15 with eight;
  `put` 72 µs against 6 µs in the middle. What a stalled link holds back does not change, it sits in the kernel's
  buffers: 435 and 437 frames with one batch, 413 and 439 with eight.
* The fence stands before the robot's buffers are full. Its bridge routes state with congestion control `block`: when the
  link is silent and what it holds for us is full, its next put waits 5 s, whoever else listens, and our transport is not
  closed before that (seen on the real bridge, 1.10.2: state back up to 5 s after a drop of 0.4 s). The robot's whole state
  fills zenoh's batches of 64 KiB in 0.3 s, smaller ones sooner; the lease is shorter than that, and longer than the
  quarter of a second at most in which TCP repeats a lost packet. Small batches would cost 0.8 % of a core less, since
  zenoh reads each packet into a buffer of a whole one.
* Reconnecting is zenoh's, every 50 to 200 ms; the first `open` fails after 2 s and is the link's to repeat.
"""

from __future__ import annotations

import json
import re
import socket
from typing import Final

from cdr_types.keys import ALL_TOKENS, topic_to_key
from gateway.link.others.foreign_watch import publishers_of
from gateway.link.others.gateway_token import format_gateway_token, gateway_tokens
from gateway.robot.topics import STATE_TOPICS
from gateway.settings.settings import LinkSettings

__all__ = ["OPEN_TIMEOUT_MS", "session_config"]

OPEN_TIMEOUT_MS = 2000
"""How long the first `open` tries [ms]."""

SEND_BUFFER_BYTES = 16_384
BATCH_BYTES = 65_535
"""zenoh's largest; both ends keep to the smaller of their two."""
MAX_PAYLOAD_BYTES = 1024
"""No command is larger; the largest has 324 bytes."""
MAX_TAKEN_BYTES = 128 * 1024
"""Of larger samples, which the robot has none of, a thousand would wait for the loop: they end in zenoh. Smaller ones are
refused in words (`codec`)."""

# Chunks that begin with @ are beyond `**`: tokens and admin keys are named in full.
_OWN_TOKENS: Final = "@/*/@ros2_lv/MS/*/*/*"
_PRESENCE: Final = "@/*/@ros2_lv"
_ASKED: Final = [ALL_TOKENS, "@/*/ros2/**", "@/*/router"]
_PRIORITIES: Final = (
    "control",
    "real_time",
    "interactive_high",
    "interactive_low",
    "data_high",
    "data",
    "data_low",
    "background",
)


def session_config(settings: LinkSettings, *, is_reader: bool = False, is_heard: bool = False) -> str:
    """Return the configuration as JSON.

    Args:
        settings: Endpoint, namespace, model and lease.
        is_reader: Whether nothing but questions and subscriptions may leave.
        is_heard: Whether a reader may announce its subscriptions, too.

    Raises:
        OSError: The endpoint names a network interface that this host does not have, or not yet.
    """
    api = f"{topic_to_key('/api', settings.namespace)}/**"
    return json.dumps(
        {
            "mode": "client",
            "connect": {
                "endpoints": [_with_send_buffer(_with_zone_number(settings.endpoint))],
                "timeout_ms": OPEN_TIMEOUT_MS,
                "exit_on_failure": True,
                "retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5},
            },
            "listen": {"endpoints": []},
            "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "timestamping": {"enabled": True},
            "queries_default_timeout": 1000,
            "transport": {
                "unicast": {"open_timeout": 1500},
                "link": {"tx": _transmission(settings.lease_ms)},
                "shared_memory": {"enabled": False},
            },
            "access_control": _access_control(
                commands=[topic_to_key(topic, settings.namespace) for topic in settings.variant.command_topics],
                data=[*_state_keys(settings.namespace), api],
                namespace=settings.namespace,
                is_reader=is_reader,
                is_heard=is_heard,
            ),
            "low_pass_filter": [
                _rule("size", "egress", ["put"], [api], size_limit=MAX_PAYLOAD_BYTES),
                _rule("taken", "ingress", ["put"], [*_state_keys(settings.namespace), api], size_limit=MAX_TAKEN_BYTES),
            ],
        }
    )


def _with_zone_number(endpoint: str) -> str:
    """Return an endpoint whose IPv6 zone is a number: zenoh takes names of interfaces, and never connects."""
    zone = re.search(r"%([\w.-]+)\]", endpoint)
    if zone is None or zone[1].isdecimal():
        return endpoint
    try:
        return endpoint.replace(zone[0], f"%{socket.if_nametoindex(zone[1])}]")
    except OSError:
        raise OSError(f"this host has no network interface {zone[1]!r}: `ip link` lists those it has") from None


def _with_send_buffer(endpoint: str) -> str:
    if not endpoint.startswith("tcp/") or "so_sndbuf=" in endpoint:
        return endpoint
    return f"{endpoint}{';' if '#' in endpoint else '#'}so_sndbuf={SEND_BUFFER_BYTES}"


def _transmission(lease_ms: int) -> dict[str, object]:
    sizes = dict.fromkeys(_PRIORITIES, 1) | {"data": 2, "real_time": 2, "interactive_high": 8}
    congestion = {"drop": {"wait_before_drop": 500}, "block": {"wait_before_close": 500_000}}  # [µs]
    queue = {"size": sizes, "congestion_control": congestion}
    return {"lease": lease_ms, "keep_alive": 4, "batch_size": BATCH_BYTES, "queue": queue}


def _state_keys(namespace: str) -> list[str]:
    """Return one key expression per group of state topics: `left_arm/**`, `fsm_state`, ...; `api` is not among them."""
    groups = dict.fromkeys(topic.split("/")[1] for topic in STATE_TOPICS)
    alone = {topic[1:] for topic in STATE_TOPICS}
    keys = {name: topic_to_key(f"/{name}", namespace) for name in groups if name != "api"}
    return [key if name in alone else f"{key}/**" for name, key in keys.items()]


def _access_control(
    commands: list[str], data: list[str], namespace: str, *, is_reader: bool, is_heard: bool
) -> dict[str, object]:
    presence = (
        [] if is_reader else [format_gateway_token("*", namespace, is_armed=is_armed) for is_armed in (False, True)]
    )
    own = [] if is_reader and not is_heard else [_OWN_TOKENS, *presence]
    gateways = gateway_tokens(namespace)
    asked = [*_ASKED, f"@/*/router/{publishers_of(namespace)}"]
    rules = [
        *([] if is_reader else [_rule("out", "egress", ["put"], commands, permission="allow")]),
        _rule("sub", "egress", ["declare_subscriber"], data, permission="allow"),
        *([_rule("tok", "egress", ["liveliness_token"], own, permission="allow")] if own else []),
        _rule("in", "ingress", ["put", "delete", "declare_subscriber"], data, permission="allow"),
        _rule(
            "q",
            "egress",
            ["query", "liveliness_query", "declare_liveliness_subscriber"],
            [*asked, gateways],
            permission="allow",
        ),
        _rule(
            "r",
            "ingress",
            ["reply", "liveliness_token", "declare_queryable"],
            [*asked, _PRESENCE, gateways],
            permission="allow",
        ),
    ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": "all"}],
        "policies": [{"rules": [rule["id"] for rule in rules], "subjects": ["all"]}],
    }


def _rule(name: str, flow: str, messages: list[str], keys: list[str], **more: object) -> dict[str, object]:
    return {"id": name, "flows": [flow], "messages": messages, "key_exprs": keys, **more}
