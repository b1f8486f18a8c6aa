"""Client and daemon one minor version apart: what a release said is kept as it went over the wire, and is understood on.

`tests/api/wire/VERSION.json` is recorded once at a release and never changed; a test that cannot be kept green says that
`PROTOCOL_VERSION` must rise.
"""

from __future__ import annotations

import base64
import json
from pathlib import Path

import msgspec
import pytest

from gateway.api import protocol

RECORDED = [json.loads(path.read_bytes()) for path in sorted((Path(__file__).parent / "wire").glob("*.json"))]
COMMANDS = [command for release in RECORDED for command in release["commands"]]
DECODERS = {
    "snapshot": protocol.decode_snapshot,
    "info": protocol.decode_info,
    "reply": protocol.decode_reply,
    "notice": protocol.decode_notice,
}
TOLD = [
    (what, base64.b64decode(payload)) for release in RECORDED for what in DECODERS for payload in release.get(what, ())
]


def whole(value):
    """Return a message with all of its fields, those at their defaults too."""
    if isinstance(value, msgspec.Struct):
        tag = {"type": value.__struct_config__.tag} if value.__struct_config__.tag else {}
        return tag | {name: whole(getattr(value, name)) for name in value.__struct_fields__}
    if isinstance(value, dict):
        return {name: whole(of) for name, of in value.items()}
    return [whole(of) for of in value] if isinstance(value, (list, tuple)) else msgspec.to_builtins(value)


def holds(value, wanted) -> bool:
    """Tell whether a message says all that another one does, and maybe more."""
    if isinstance(wanted, dict):
        return isinstance(value, dict) and all(name in value and holds(value[name], wanted[name]) for name in wanted)
    if isinstance(wanted, list):
        return len(value) == len(wanted) and all(map(holds, value, wanted))
    return value == wanted


def extended(value):
    """Return a message as a later release might send it: with one more field in each part of a fixed shape."""
    if isinstance(value, dict):
        made = {name: extended(of) for name, of in value.items()}
        return made | {"a_later_field": [1, {}]} if "at_ns" in value or "seq" in value or "protocol" in value else made
    return [extended(of) for of in value] if isinstance(value, list) else value


def test_something_was_recorded() -> None:
    """Of every kind, every request among it."""
    assert {what for what, _ in TOLD} == set(DECODERS)
    kinds = {command["means"]["request"]["type"] for command in COMMANDS}
    assert {"acquire", "move", "follow", "open_stream", "drive_chassis", "stop", "recover"} <= kinds


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command["means"]["request"]["type"])
def test_an_older_client_is_understood_as_it_meant_it(command) -> None:
    """Defaults included: what it left out means what it meant then. So does what says all of it, as another language may."""
    means = command["means"]
    told = protocol.decode_command(base64.b64decode(command["payload"]))
    assert holds(whole(told), means)
    assert protocol.decode_command(json.dumps(means).encode(), protocol.JSON) == told


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command["means"]["request"]["type"])
def test_an_older_daemon_is_told_nothing_that_it_does_not_know(command) -> None:
    """It refuses fields that it has never heard of: what has its default is not sent, so new ones are not."""
    payload = base64.b64decode(command["payload"])
    now = msgspec.msgpack.decode(protocol.encode(protocol.decode_command(payload)))
    assert now == msgspec.msgpack.decode(payload)


@pytest.mark.parametrize(("what", "payload"), TOLD, ids=[what for what, _ in TOLD])
def test_an_older_daemon_is_read_and_an_older_client_finds_all_it_knows(what: str, payload: bytes) -> None:
    """Nothing that was told is missing, renamed or of another type today."""
    read = DECODERS[what](payload)
    assert holds(msgspec.msgpack.decode(protocol.encode(read)), msgspec.msgpack.decode(payload))


@pytest.mark.parametrize(("what", "payload"), TOLD, ids=[what for what, _ in TOLD])
def test_what_a_later_daemon_tells_besides_is_passed_over(what: str, payload: bytes) -> None:
    """What comes out is tolerant."""
    said = msgspec.msgpack.decode(payload)
    more = msgspec.msgpack.encode({**extended(said), "another": None})
    assert DECODERS[what](more) == DECODERS[what](payload)
