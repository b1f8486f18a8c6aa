"""Tests of bytes to messages and back."""

from __future__ import annotations

import json
import math

import msgspec
import pytest
from msgspec import structs

from gateway.api import protocol
from gateway.errors import CODES, Code, Refusal, to_exception
from tests.api.samples import REQUESTS, command
from tests.api.stand_in import a_snapshot

ENCODINGS = (protocol.MSGPACK, protocol.JSON)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("request_", REQUESTS, ids=lambda request: type(request).__name__)
def test_every_request_comes_back(request_, encoding):
    """What was encoded decodes to the same, in both encodings."""
    sent = command(request_)
    assert protocol.decode_command(protocol.encode(sent, encoding), encoding) == sent


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_what_comes_out_comes_back(encoding):
    """Targets, replies, notices and snapshots decode to what was encoded; a core snapshot needs no copy."""
    target = protocol.Target(epoch=1, seq=2, values=(0.0,) * 7)
    assert protocol.decode_target(protocol.encode(target, encoding), encoding) == target
    refusal = protocol.RefusalMessage(code="LEASE_HELD", message="m", hint="h")
    reply = protocol.Reply(request_id=3, refusal=refusal, facts={"epoch": 7, "q_rad": [0.5]}, after_seq=9)
    assert protocol.decode_reply(protocol.encode(reply, encoding), encoding) == reply
    notice = protocol.Notice(code="WALK", level="info", message="m", at_ns=1, facts={"a": "b"})
    assert protocol.decode_notice(protocol.encode(notice, encoding), encoding) == notice
    snapshot = protocol.decode_snapshot(protocol.encode(a_snapshot(), encoding), encoding)
    assert snapshot == msgspec.convert(msgspec.to_builtins(a_snapshot()), protocol.Snapshot)
    assert protocol.decode_snapshot(protocol.encode(snapshot, encoding), encoding) == snapshot


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_path_that_is_no_utf_8_keeps_nothing_from_being_told(encoding):
    """It is escaped, in a latch as in a fact and its key; the rest of the message is what it was."""
    lost = "kept as /st\udce4te/\xe4"
    snapshot = protocol.decode_snapshot(protocol.encode(a_snapshot(latches={"STATE_LOST": lost}), encoding), encoding)
    plain = protocol.decode_snapshot(protocol.encode(a_snapshot(), encoding), encoding)
    assert snapshot == structs.replace(plain, latches={"STATE_LOST": "kept as /st\\udce4te/\xe4"})
    reply = protocol.Reply(request_id=3, facts={"a\udcff": ["\udce4"], "n": 0.5})
    told = protocol.decode_reply(protocol.encode(reply, encoding), encoding)
    assert told == protocol.Reply(request_id=3, facts={"a\\udcff": ["\\udce4"], "n": 0.5})


def test_json_is_what_a_person_would_write():
    """A request can be typed by hand: type beside its fields, defaults left out, integers where floats are meant."""
    typed = {
        "version": 1,
        "client_id": "me",
        "request_id": 1,
        "request": {"type": "move", "epoch": 2, "targets_rad": {"left": [0, 1, 0, 1, 0, 0, 0]}},
    }
    decoded = protocol.decode_command(json.dumps(typed).encode(), protocol.JSON)
    assert decoded.request == protocol.Move(epoch=2, targets_rad={"left": (0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0)})


def test_nan_passes_msgpack_and_not_json():
    """Msgpack carries NaN (the core refuses it with a reason); JSON has none."""
    payload = protocol.encode(protocol.Target(epoch=1, seq=1, values=(math.nan,) * 7))
    assert math.isnan(protocol.decode_target(payload).values[0])
    with pytest.raises(protocol.Malformed):
        protocol.decode_target(
            protocol.encode(protocol.Target(epoch=1, seq=1, values=(math.nan,)), protocol.JSON), protocol.JSON
        )


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"extra": 1}, "extra"),
        ({"client_id": ""}, "client_id"),
        ({"client_id": "a/b"}, "client_id"),
        ({"client_id": "a" * 65}, "client_id"),
        ({"client_id": "a\n"}, "client_id"),
        ({"request_id": -1}, "request_id"),
        ({"request_id": 2**63}, "request_id"),
        ({"request": {"type": "dance"}}, "type"),
        ({"request": {"epoch": 1}}, "type"),
        ({"request": {"type": "enable"}}, "epoch"),
        ({"request": {"type": "enable", "epoch": "1"}}, "epoch"),
        ({"request": {"type": "enable", "epoch": 1.5}}, "epoch"),
        ({"request": {"type": "enable", "epoch": 1, "now": True}}, "now"),
        ({"request": {"type": "open_stream", "epoch": 1, "side": "middle"}}, "side"),
        ({"request": {"type": "move", "epoch": 1, "targets_rad": {"up": []}}}, "targets_rad"),
        ({"request": {"type": "move", "epoch": 1, "targets_rad": {"left": [None]}}}, "targets_rad"),
        ({"request": {"type": "move", "epoch": 1, "targets_rad": {"left": [0.0] * 65}}}, "targets_rad"),
        ({"request": {"type": "acquire", "name": "", "pid": 1}}, "name"),
        ({"request": {"type": "acquire", "name": "n" * 65, "pid": 1}}, "name"),
        ({"request": {"type": "acquire", "name": "n", "pid": 1, "on_loss": "drop"}}, "on_loss"),
    ],
)
def test_what_is_wrong_is_named(change, part):
    """A malformed command is BAD_REQUEST, the message names the place, and the hint where it stands what is well formed."""
    typed = {"version": 1, "client_id": "me", "request_id": 1, "request": {"type": "recover"}} | change
    with pytest.raises(protocol.Malformed) as caught:
        protocol.decode_command(json.dumps(typed).encode(), protocol.JSON)
    assert caught.value.refusal.code is Code.BAD_REQUEST and part in caught.value.refusal.message
    assert "gateway/api/protocol.py" in caught.value.refusal.hint


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    "payload", [b"", b"\x00", b"\xff", b"{", b"[]", b"null", b"\xc1", b"[" * 60_000, b"\x91" * 60_000, b'"\xff"']
)
def test_what_is_no_message_is_a_bad_request(payload, encoding):
    """Rubbish of any kind, deep nesting and bad UTF-8 included, is one typed refusal."""
    for decode in (protocol.decode_command, protocol.decode_target):
        with pytest.raises(protocol.Malformed) as caught:
            decode(payload, encoding)
        assert caught.value.refusal.code is Code.BAD_REQUEST


def test_a_large_payload_is_refused_unread():
    """What is larger than any request can be is not even parsed; the bound is named."""
    payload = protocol.encode(command(protocol.Stop(reason="x" * protocol.MAX_PAYLOAD_BYTES)))
    with pytest.raises(protocol.Malformed) as caught:
        protocol.decode_command(payload)
    assert caught.value.refusal.bound == "65536" and caught.value.refusal.unit == "B"


@pytest.mark.parametrize("encoding", ["text/plain", "application/cbor", "x" * 200])
def test_an_unknown_encoding_is_refused_by_name(encoding):
    """An encoding that we do not speak is refused, and the ones that we do are named."""
    with pytest.raises(protocol.Malformed) as caught:
        protocol.decode_command(b"{}", encoding)
    assert caught.value.refusal.field == "command" and protocol.JSON in caught.value.refusal.bound


def test_no_encoding_means_msgpack():
    """A sender that says nothing is taken to speak msgpack."""
    sent = command(protocol.Recover())
    assert protocol.decode_command(protocol.encode(sent, ""), "") == sent


def test_another_version_is_told_as_that():
    """A command of another version says so, whether or not its form is ours; only a stop is obeyed all the same."""
    for payload in (
        protocol.encode(command(protocol.Recover(), version=2)),
        msgspec.msgpack.encode({"version": 2, "client": "x", "what": {"verb": "dance"}}),
    ):
        with pytest.raises(protocol.Malformed) as caught:
            protocol.decode_command(payload)
        assert caught.value.refusal.code is Code.UNSUPPORTED_VERSION and caught.value.refusal.value == "2"
    for request in (protocol.Stop(reason="now"), protocol.Estop()):
        assert protocol.decode_command(protocol.encode(command(request, version=2))).request == request


@pytest.mark.parametrize("code", list(Code))
def test_every_code_comes_back_as_its_class(code):
    """A refusal of any code survives the wire: the client raises the class of the table, with the same facts."""
    refusal = Refusal(code=code, message="m", field="f", value="v", bound="b", unit="u", hint="h")
    reply = protocol.Reply(
        request_id=1, refusal=protocol.RefusalMessage(**{n: str(getattr(refusal, n)) for n in Refusal.__slots__})
    )
    for encoding in ENCODINGS:
        message = protocol.decode_reply(protocol.encode(reply, encoding), encoding).refusal
        back = protocol.refusal_of(message)
        assert back == refusal
        assert type(to_exception(back)) is type(to_exception(refusal))
        if code in CODES:
            assert type(to_exception(back)) is CODES[code].error


def test_a_code_of_a_later_release_is_kept_in_words():
    """A code that this client does not know becomes INTERNAL and stays readable."""
    back = protocol.refusal_of(protocol.RefusalMessage(code="SOLAR_FLARE", message="wait"))
    assert back.code is Code.INTERNAL and back.message == "SOLAR_FLARE: wait"


def test_what_comes_out_may_grow():
    """Fields that a later daemon adds to a reply or a snapshot do not disturb this client."""
    raw = msgspec.to_builtins(a_snapshot()) | {"weather": "fine"}
    assert protocol.decode_snapshot(msgspec.msgpack.encode(raw)).seq == 1
    assert protocol.decode_reply(msgspec.msgpack.encode({"request_id": 1, "mood": "good"})).request_id == 1


def test_an_encoding_that_is_none_cannot_be_written():
    """Encoding for an unknown reader is a mistake of ours and raises."""
    with pytest.raises(KeyError):
        protocol.encode(protocol.Recover(), "text/plain")
