"""Tests of the contract as a whole: what it exports, what it stands on, and that it mirrors the core."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Mapping
from types import UnionType
from typing import Union, get_args, get_origin, get_type_hints

import msgspec
import pytest

from gateway.api import protocol
from gateway.core.messages import events, snapshot
from gateway.errors import Refusal
from gateway.values import ARM_DOF, FsmState

VIEWS = [name for name in snapshot.__all__]
OF_A_CHUNK = {"points", "space", "dt_s", "times_s", "stretch", "smoothing_s"}
MESSAGES = [request.__name__ for request in get_args(events.Request)]


def fields_of(cls):
    """Return field names with plain types, whichever kind of class it is."""
    return {name: plain(hint) for name, hint in get_type_hints(cls).items() if not name.startswith("_")}


def plain(hint):
    """Return a type as text that is the same for a dataclass of the core and its struct."""
    origin, args = get_origin(hint), get_args(hint)
    if hint is type(None):
        return "null"
    if origin in (Union, UnionType):
        return " | ".join(sorted(map(plain, args)))
    if origin in (dict, Mapping):
        return f"map[{plain(args[0])}, {plain(args[1])}]"
    if origin is tuple:
        return f"list[{plain(args[0])}]"
    if origin is not None:  # Literal and the like
        return "str"
    return "str" if issubclass(hint, str) else hint.__name__


@pytest.mark.parametrize("name", VIEWS)
def test_every_view_of_the_snapshot_has_its_struct(name):
    """Field names and types of core and wire are the same, class by class."""
    assert fields_of(getattr(protocol, name)) == fields_of(getattr(snapshot, name))


@pytest.mark.parametrize("name", MESSAGES)
def test_every_request_of_the_core_has_its_struct(name):
    """A request has the same fields on the wire, with the same defaults."""
    core, wire = getattr(events, name), getattr(protocol, name)
    if name == "Follow":  # what a chunk is made of on the wire is worked out on the way in
        kinds = {field: hint for field, hint in fields_of(wire).items() if field not in OF_A_CHUNK}
        assert {**kinds, "chunk": "Chunk"} == fields_of(core)
        return
    assert fields_of(wire) == fields_of(core)
    defaults = {field.name: field.default for field in dataclasses.fields(core)}
    for field in msgspec.structs.fields(wire):
        if field.required:
            assert defaults[field.name] is dataclasses.MISSING
        else:
            assert field.default == defaults[field.name]


def test_the_union_of_requests_is_complete():
    """What the core understands can be said, and nothing else."""
    assert {request.__name__ for request in get_args(protocol.Request)} == set(MESSAGES)


def test_a_refusal_and_a_notice_keep_their_fields():
    """Refusals and notices have the core's fields."""
    assert fields_of(protocol.RefusalMessage) == fields_of(Refusal)
    assert fields_of(protocol.Notice) == fields_of(events.Notice)


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
    assert protocol.target_key("ab", 3) == "ta2/1/target/ab/3"
    assert protocol.keepalive_key("ab") == "ta2/1/keepalive/ab"
    token = protocol.daemon_token("zid")
    assert (protocol.token_version(token), protocol.token_id(token)) == ("1", "zid")
    assert protocol.token_id(protocol.client_token("ab")) == "ab"


def test_the_contract_stands_on_msgspec_and_errors_alone():
    """Importing the protocol loads no zenoh, no numpy, no core: that is what lets the client be slim."""
    script = (
        "import sys; import gateway.api.protocol; "
        "print(sorted(m for m in sys.modules if m.split('.')[0] in ('zenoh', 'numpy', 'asyncio', 'pycdr2', 'ruckig') "
        "or m.startswith(('gateway.core', 'gateway.values', 'gateway.robot', 'gateway.settings', 'cdr_types'))))"
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
