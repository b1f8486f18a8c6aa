"""Hostile payloads: whatever arrives is a request of the core, a target of the core, or a typed refusal.

Seeded, so that a red run can be repeated. Every case goes through both decoders and the translator.
"""

from __future__ import annotations

import json
import random
import string
import struct

import msgspec
import pytest

from gateway.api import protocol
from gateway.api.translate import to_request, to_target
from gateway.core import events
from gateway.errors import Code, Refusal
from tests.api.samples import REQUESTS, Q, command

CASES = 100_000
CODES = {Code.BAD_REQUEST, Code.UNSUPPORTED_VERSION, Code.WRONG_SHAPE}
ODD = [None, True, -1, 2**62, 2**63, 2**64 - 1, -(2**63), 0.0, -0.0, 1e308, 5e-324, float("nan"), float("inf"), -float("inf"),
       "", "x" * 70, "\x00", "\x1b[2J", "left", "stop", b"\xff\xfe", [], {}, [[]], [0.0] * 7, {"left": [0.0] * 7}]  # fmt: skip


FLOATS = [odd for odd in ODD if isinstance(odd, float)]
COUNTS = [0, 1, 2**31, 2**62, 2**62 + 1, -1]


def mutated(rng, value):
    """Return a value with something about it changed, anywhere in it; half of the time it keeps its type."""
    if isinstance(value, float) and rng.random() < 0.5:
        return rng.choice(FLOATS)
    if type(value) is int and rng.random() < 0.5:
        return rng.choice(COUNTS)
    if isinstance(value, dict) and value and rng.random() < 0.8:
        value = dict(value)
        key = rng.choice(list(value))
        move = rng.random()
        if move < 0.15:
            del value[key]
        elif move < 0.3:
            value["".join(rng.choices(string.ascii_lowercase + "_", k=4))] = rng.choice(ODD)
        else:
            value[key] = mutated(rng, value[key])
        return value
    if isinstance(value, (list, tuple)) and value and rng.random() < 0.8:
        value = list(value)
        place = rng.randrange(len(value))
        move = rng.random()
        if move < 0.2:
            del value[place]
        elif move < 0.4:
            value *= rng.choice([2, 20])
        else:
            value[place] = mutated(rng, value[place])
        return value
    return rng.choice(ODD)


def scratched(rng, payload):
    """Return bytes with some of them cut, flipped, doubled or replaced."""
    data = bytearray(payload)
    for _ in range(rng.randint(1, 4)):
        if not data:
            break
        place = rng.randrange(len(data))
        move = rng.randrange(5)
        if move == 0:
            data[place] ^= 1 << rng.randrange(8)
        elif move == 1:
            del data[place:]
        elif move == 2:
            data[place:place] = data[: rng.randrange(16)]
        elif move == 3:
            data[place : place + 8] = struct.pack("<d", rng.choice([float("nan"), float("inf"), 1e300, -0.0]))
        else:
            data[place : place + 1] = rng.randbytes(rng.randrange(6))
    return bytes(data)


def as_json(value):
    """Return a value as JSON text, for what has a form there."""
    return json.dumps(value, default=lambda odd: odd.decode("latin-1")).encode("utf-8", "surrogatepass")


@pytest.mark.slow
def test_a_hundred_thousand_hostile_payloads_give_typed_answers_only():
    """Mutated and scratched requests and targets never raise anything but Malformed, and never become half a request."""
    rng = random.Random(20260801)
    misshapen = [protocol.Move(epoch=1, targets_rad={"left": Q[:n], "right": Q}) for n in range(7)]
    misshapen += [protocol.Move(epoch=1, targets_rad={}), protocol.Hold(epoch=1, sides=())]
    seeds = [msgspec.to_builtins(command(request)) for request in (*REQUESTS, *misshapen)]
    target = msgspec.to_builtins(protocol.Target(epoch=1, seq=1, q_rad=Q))
    outcomes = {"request": 0, "refusal": 0, "malformed": 0, "target": 0}
    codes = set()
    for case in range(CASES):
        encoding = (protocol.MSGPACK, protocol.JSON, "")[case % 3]
        is_target = case % 5 == 0
        value = target if is_target else rng.choice(seeds)
        if rng.random() < 0.6:
            value = mutated(rng, value)
        payload = as_json(value) if encoding == protocol.JSON else msgspec.msgpack.encode(value)
        if rng.random() < 0.3:
            payload = scratched(rng, payload)
        try:
            if is_target:
                arrived = to_target(protocol.decode_target(payload, encoding), "me", 1, 0)
                assert isinstance(arrived.q_rad, tuple) and all(type(q) is float for q in arrived.q_rad)
                assert len(arrived.q_rad) <= 64 and 0 <= arrived.seq <= 2**62
                outcomes["target"] += 1
                continue
            request = to_request(protocol.decode_command(payload, encoding).request)
        except protocol.Malformed as error:
            assert error.refusal.code in CODES and error.refusal.message
            codes.add(error.refusal.code)
            outcomes["malformed"] += 1
            continue
        if isinstance(request, Refusal):
            assert request.code in CODES
            codes.add(request.code)
            outcomes["refusal"] += 1
        else:
            assert type(request).__module__.startswith("gateway.core")
            if isinstance(request, events.Move):
                assert request.targets_rad and all(len(q) == 7 for q in request.targets_rad.values())
            outcomes["request"] += 1
    assert codes == CODES
    assert all(count > CASES // 1000 for count in outcomes.values()), outcomes
