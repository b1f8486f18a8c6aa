"""Broken payloads, 20,000 of them: each gives a CdrError or a message, and none an answer that the generic path would not.

Before a release 100,000. The loop is seeded, so each run tries the same payloads. It starts from good payloads of every type,
in both byte orders, and cuts, extends, flips, overwrites and splices them; hostile lengths are put where lengths are.
"""

from __future__ import annotations

import random

from cdr_types.codec import decode, encode
from cdr_types.encapsulation import peek_stamp
from cdr_types.errors import CdrError, DecodeError
from cdr_types.generic import decode_generic
from cdr_types.messages.geometry_msgs import Pose
from cdr_types.messages.sensor_msgs import JointState
from cdr_types.messages.std_msgs import Float32MultiArray, MultiArrayDimension, MultiArrayLayout, String
from cdr_types.registry import MESSAGE_TYPES
from tests.cdr_types.oracle import arm_state, ros_encode
from tests.thoroughness import either

PAYLOADS = either(20_000, 100_000)
HOSTILE = [b"\xff\xff\xff\xff", b"\x00\x00\x00\x00", b"\xff\xff\xff\x7f", b"\x01\x00\x00\x00", b"\x00\x00\x00\x80"]

GOOD = [
    *(cls() for cls in MESSAGE_TYPES),
    arm_state(),
    JointState(name=["l_joint8"], position=[0.5], velocity=[0.0], effort=[0.1]),
    JointState(name=["a", "bc", "def"], velocity=[1.0]),
    Pose(),
    String(data='{"left_arm": "joint_mode"}'),
    Float32MultiArray(data=[0.1, 0.2, 0.3]),
    Float32MultiArray(layout=MultiArrayLayout(dim=[MultiArrayDimension(label="row", size=2, stride=2)]), data=[1.0]),
]
SEEDS = [ros_encode(message, little_endian=little) for message in GOOD for little in (True, True, False)]


def mutate(rng: random.Random) -> bytes:
    """Return a good payload after one to three accidents."""
    data = bytearray(rng.choice(SEEDS))
    for _ in range(rng.randint(1, 3)):
        match rng.randrange(6):
            case 0:
                del data[rng.randint(0, len(data)) :]
            case 1:
                data += rng.randbytes(rng.randint(1, 8))
            case 2 if data:
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            case 3:
                at = 4 * rng.randint(0, len(data) // 4)
                data[at : at + 4] = rng.choice(HOSTILE)
            case 4:
                other = rng.choice(SEEDS)
                data[rng.randint(0, len(data)) :] = other[rng.randint(0, len(other)) :]
            case _:
                data = bytearray(data[:4] + rng.randbytes(rng.randint(0, 64)))
    return bytes(data)


def outcome(data, cls, path):
    """What a path answers: the message as text (NaN compares), or the whole error."""
    try:
        return repr(path(data, cls))
    except CdrError as error:
        return type(error), str(error)


def test_broken_payloads_give_typed_errors_or_messages():
    """Any other exception fails the test; what decodes can be encoded again and then means the same."""
    rng = random.Random(20_240_601)
    decoded = refused = 0
    for number in range(PAYLOADS):
        cls = MESSAGE_TYPES[number % len(MESSAGE_TYPES)]
        data = mutate(rng)
        try:
            message = decode(data, cls)
        except DecodeError:
            refused += 1
            if number % 10 == 0:
                assert outcome(data, cls, decode) == outcome(data, cls, decode_generic)
        else:
            decoded += 1
            again = encode(message)
            assert repr(decode(again, cls)) == repr(message) == repr(decode_generic(data, cls))
    assert decoded + refused == PAYLOADS
    assert min(decoded, refused) > PAYLOADS // 50, "the accidents are one-sided: they try only one outcome"


def test_broken_payloads_have_a_stamp_or_a_typed_error():
    """The stamp is peeked at before anything is checked, so it meets all of them."""
    rng = random.Random(20_240_602)
    for _ in range(10_000):
        data = mutate(rng)
        try:
            assert isinstance(peek_stamp(data), int)
        except DecodeError:
            assert len(data) < 12 or data[:2] not in (b"\x00\x00", b"\x00\x01")
