"""Hostile payloads: whatever arrives is a request of the core, a target of the core, or a typed refusal.

Seeded, so that a red run can be repeated. Every case goes through both decoders and the translator.
"""

from __future__ import annotations

import random
from typing import get_args

import msgspec
import pytest

from gateway.api import protocol
from gateway.api.translate import to_request, to_target
from gateway.errors import Code, Refusal
from gateway.messages import requests
from tests.api.samples import REQUESTS, Q, command
from tests.fuzz.hostile import as_json, mutated, scratched
from tests.thoroughness import either

CASES = either(20_000, 100_000)
CODES = {Code.BAD_REQUEST, Code.UNSUPPORTED_VERSION, Code.WRONG_SHAPE, Code.NOT_FINITE, Code.OUT_OF_RANGE}


@pytest.mark.slow
def test_a_hundred_thousand_hostile_payloads_give_typed_answers_only():
    """A fifth of them outside CI: none raises anything but Malformed, and none becomes half a request."""
    rng = random.Random(20260802)
    misshapen = [protocol.Move(epoch=1, targets_rad={"left": Q[:n], "right": Q}) for n in range(7)]
    misshapen += [protocol.Move(epoch=1, targets_rad={}), protocol.Hold(epoch=1, sides=())]
    seeds = [msgspec.to_builtins(command(request)) for request in (*REQUESTS, *misshapen)]
    target = msgspec.to_builtins(protocol.Target(epoch=1, seq=1, values=Q))
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
                assert isinstance(arrived.values, tuple) and all(type(value) is float for value in arrived.values)
                assert len(arrived.values) <= 64 and 0 <= arrived.seq <= 2**62
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
            assert isinstance(request[0], get_args(requests.Request))
            if isinstance(request, requests.Move):
                assert request.targets_rad and all(len(q) == 7 for q in request.targets_rad.values())
            outcomes["request"] += 1
    assert codes == CODES
    assert all(count > CASES // 1000 for count in outcomes.values()), outcomes
