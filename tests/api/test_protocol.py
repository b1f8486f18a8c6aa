"""Tests of the contract as a whole: what it exports and what it stands on."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from typing import get_args

import msgspec
import pytest

from gateway.api import protocol
from gateway.core.messages import outputs
from gateway.errors import Refusal
from gateway.values import ARM_DOF, FsmState


def test_a_refusal_and_a_notice_keep_their_fields():
    """What the engine says with codes of this release is told in words, under the same names."""
    for told, said in ((protocol.RefusalMessage, Refusal), (protocol.Notice, outputs.Notice)):
        assert told.__struct_fields__ == (said.__slots__ if dataclasses.is_dataclass(said) else said.__struct_fields__)


def test_requests_are_strict_and_frozen():
    """Every request but a stop refuses unknown fields; none can be changed."""
    for request in (*get_args(protocol.Request), protocol.Command, protocol.Target):
        config = request.__struct_config__
        assert config.frozen
        assert config.forbid_unknown_fields is (request not in (protocol.Stop, protocol.Estop))
    tags = [request.__struct_config__.tag for request in get_args(protocol.Request)]
    assert "open_stream" in tags and len(set(tags)) == len(tags)


def test_facts_of_the_robot_are_the_robots():
    """The few facts that a client needs without the daemon's modules are the same."""
    assert {state.value: state.name for state in FsmState} == protocol.FSM_NAMES
    assert protocol.ARM_DOF == ARM_DOF


def test_keys_name_version_and_owner():
    """Keys carry the version and give back whose they are."""
    assert protocol.target_key("ab", 3, "s") == "ta2/1/target/ab/3/s"
    assert protocol.keepalive_key("ab", "s") == "ta2/1/keepalive/ab/s"
    token = protocol.daemon_token("zid")
    assert (protocol.token_version(token), protocol.token_id(token)) == ("1", "zid")
    assert protocol.token_id(protocol.client_token("ab")) == "ab"


def test_the_contract_stands_on_msgspec_and_values_alone():
    """Importing the protocol loads no zenoh, no numpy, no core: that is what lets the client be slim."""
    script = (
        "import sys; import gateway.api.protocol; "
        "print(sorted(m for m in sys.modules if m.split('.')[0] in ('zenoh', 'numpy', 'asyncio', 'pycdr2', 'ruckig') "
        "or m.startswith(('gateway.core', 'gateway.robot', 'gateway.settings', 'cdr_types'))))"
    )
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=30)
    assert loaded.stdout.strip() == "[]"


def test_a_stop_is_not_refused_for_what_a_later_release_adds():
    """A stop is never refused; every other request is strict."""
    fields = {"version": protocol.PROTOCOL_VERSION, "client_id": "ann", "request_id": 1}
    for name in ("Stop", "Estop"):
        told = {**fields, "request": {"type": name.lower(), "reason": "now", "softly": True}}
        assert protocol.decode_command(msgspec.json.encode(told), protocol.JSON).request.reason == "now"
    with pytest.raises(protocol.Malformed):
        protocol.decode_command(
            msgspec.json.encode({**fields, "request": {"type": "recover", "softly": 1}}), protocol.JSON
        )
