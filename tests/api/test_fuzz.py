"""Hostile payloads: whatever arrives is a request of the core, a target of the core, or a typed refusal.

Seeded, so that a red run can be repeated. Every case goes through both decoders and the translator.
"""

from __future__ import annotations

import math
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
def test_hostile_payloads_give_typed_answers_only():
    """A fifth of them outside CI: none raises anything but Malformed, and points become a whole motion or none."""
    rng = random.Random(20260802)
    no_motions = [(), (Q,), (Q, (*Q[:6], math.nan)), *((Q[:n], Q[:n]) for n in range(7))]
    misshapen = [protocol.Follow(epoch=1, points={"left": points}, dt_s=0.1) for points in no_motions]
    misshapen.append(protocol.Follow(epoch=1, points={}, dt_s=0.1))
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
            made = to_request(protocol.decode_command(payload, encoding).request)
        except protocol.Malformed as error:
            assert error.refusal.code in CODES and error.refusal.message
            codes.add(error.refusal.code)
            outcomes["malformed"] += 1
            continue
        if isinstance(made, Refusal):
            assert made.code in CODES
            codes.add(made.code)
            outcomes["refusal"] += 1
        else:
            request, chunk = made
            assert isinstance(request, get_args(requests.Request))
            if isinstance(request, (requests.Follow, requests.CheckFollow)):
                points = (request if isinstance(request, requests.Follow) else request.follow).points
                assert chunk is not None and points and set(chunk.trajectories) == set(points)
                assert all(len(row) == 7 for motion in chunk.trajectories.values() for row in motion.points)
            else:
                assert chunk is None
            outcomes["request"] += 1
    assert codes == CODES
    assert all(count > CASES // 1000 for count in outcomes.values()), outcomes
