"""Hostile input, seeded: values that mean no good, and what an accident or an attacker does to good messages.

Every function takes its own `random.Random`, so that a red run can be repeated. Knows the two encodings of the local
API and the shape of a CDR payload; knows nothing of requests, topics or the packages under test.
"""

from __future__ import annotations

import json
import math
import random
import string
import struct
from collections.abc import Callable
from typing import Any

import msgspec

FLOATS = (0.0, -0.0, 5e-324, 2.2250738585072014e-308, 1e-12, 1e308, -1e308, 3.5e38, math.nan, math.inf, -math.inf)
INTS = (0, 1, -1, 2**31 - 1, 2**31, 2**53 + 1, 2**62, 2**62 + 1, 2**63 - 1, 2**64 - 1, -(2**31) - 1, -(2**63))
TEXTS = ("", " ", "\x00", "\x1b[2J\n", "left", "stop", "move", "NaN", "٣", "\u202e", "\U0010ffff", "人" * 70, "x" * 600)
ODD: tuple[Any, ...] = (
    None, True, False, *FLOATS, *INTS, *TEXTS, b"", b"\xff\xfe", [], {}, [[]], [0.0] * 7, [math.nan] * 7,
    ["left"] * 9, {"left": [0.0] * 7}, {"left": None}, {"": {}},
)  # fmt: skip
"""Values that no field wants, or that only another field wants."""

WORDS = tuple(struct.pack("<I", word) for word in (0, 1, 7, 8, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x01000000, 65_536))
"""Hostile counts and lengths, for where a CDR payload has them."""


def mutated(rng: random.Random, value: Any) -> Any:
    """Return a value with one thing about it changed, anywhere in it; half of the numbers stay numbers."""
    if isinstance(value, float) and rng.random() < 0.5:
        return rng.choice(FLOATS)
    if type(value) is int and rng.random() < 0.5:
        return rng.choice(INTS)
    if isinstance(value, dict) and value and rng.random() < 0.85:
        return _mutated_object(rng, value)
    if isinstance(value, (list, tuple)) and value and rng.random() < 0.85:
        return _mutated_array(rng, value)
    return rng.choice(ODD)


def twisted(rng: random.Random, value: Any) -> Any:
    """Return a value of the same form with other numbers in one place, and perhaps another count of them.

    What decodes, but may not pass: the layers behind the decoder see it.
    """
    if isinstance(value, float):
        return rng.choice(FLOATS)
    if type(value) is int:
        return rng.choice(INTS[:7])
    if isinstance(value, dict) and value:
        name = rng.choice([key for key, item in value.items() if isinstance(item, (dict, list))] or list(value))
        return {**value, name: twisted(rng, value[name])}
    if isinstance(value, list) and value:
        place = rng.randrange(len(value))
        if rng.random() < 0.3:
            return (value * 2)[: rng.choice((0, 1, 6, 8, 14))]
        return [*value[:place], twisted(rng, value[place]), *value[place + 1 :]]
    return value


def _mutated_object(rng: random.Random, value: dict[Any, Any]) -> dict[Any, Any]:
    fields = dict(value)
    name = rng.choice(list(fields))
    move = rng.random()
    if move < 0.12:
        del fields[name]
    elif move < 0.22:
        fields["".join(rng.choices(string.ascii_lowercase + "_", k=4))] = rng.choice(ODD)
    elif move < 0.27:
        fields[rng.choice(TEXTS)] = fields.pop(name)
    else:
        fields[name] = mutated(rng, fields[name])
    return fields


def _mutated_array(rng: random.Random, value: list[Any] | tuple[Any, ...]) -> list[Any]:
    items = list(value)
    place = rng.randrange(len(items))
    move = rng.random()
    if move < 0.15:
        del items[place]
    elif move < 0.3:
        items *= rng.choice([0, 2, 9, 20])
    else:
        items[place] = mutated(rng, items[place])
    return items


def scratched(rng: random.Random, payload: bytes, words: tuple[bytes, ...] = ()) -> bytes:
    """Return bytes after one to four accidents: cut, flipped, doubled, overwritten or filled.

    Args:
        rng: Source of everything.
        payload: What was good.
        words: Four-byte words that may be laid over aligned places.
    """
    data = bytearray(payload)
    for _ in range(rng.randint(1, 4)):
        if not data:
            break
        place = rng.randrange(len(data))
        move = rng.randrange(7 if words else 6)
        if move == 0:
            data[place] ^= 1 << rng.randrange(8)
        elif move == 1:
            del data[place:]
        elif move == 2:
            data[place:place] = data[: rng.randrange(16)]
        elif move == 3:
            data[place : place + 8] = struct.pack("<d", rng.choice(FLOATS))
        elif move == 4:
            data[place : place + 1] = rng.randbytes(rng.randrange(6))
        elif move == 5:
            data[place] = rng.choice([0x00, 0x7F, 0x80, 0xC0, 0xC1, 0xFF])
        else:
            place -= place % 4
            data[place : place + 4] = rng.choice(words)
    return bytes(data)


# ------------------------------------------------------------------------------------------------ the local API


def as_json(value: Any) -> bytes:
    """Return a value as JSON text; with NaN and Infinity, which are no JSON, and bytes as text."""
    text = json.dumps(value, ensure_ascii=False, default=lambda odd: odd.decode("latin-1"))
    return text.encode("utf-8", "surrogatepass")


def as_msgpack(value: Any) -> bytes:
    """Return a value as msgpack."""
    return msgspec.msgpack.encode(value)


def monster(rng: random.Random, message: dict[str, Any], *, is_json: bool) -> bytes:
    """Return a payload that is hostile as a whole: too deep, too long, twice the same, of another encoding, nothing.

    Args:
        rng: Source of everything.
        message: A good message as an object.
        is_json: Whether it will be said to be JSON; else msgpack.
    """
    good = as_json(message) if is_json else as_msgpack(message)
    kinds = _JSON_MONSTERS if is_json else _MSGPACK_MONSTERS
    return rng.choice(kinds)(rng, message, good)


_Monster = Callable[[random.Random, dict[str, Any], bytes], bytes]


def _long_text(rng: random.Random, message: dict[str, Any]) -> dict[str, Any]:
    return {**message, rng.choice(list(message)): rng.choice(["y", "\x00", "é"]) * rng.choice([3_000, 60_000, 70_000])}


_ANY_MONSTERS: tuple[_Monster, ...] = (
    lambda rng, message, good: b"",
    lambda rng, message, good: good[: rng.randrange(len(good))],
    lambda rng, message, good: good + good,
    lambda rng, message, good: good + rng.randbytes(rng.randint(1, 40)),
    lambda rng, message, good: rng.randbytes(rng.randrange(200)),
    lambda rng, message, good: bytes(rng.choice([100, 64 * 1024, 64 * 1024 + 1])),
)
_JSON_MONSTERS: tuple[_Monster, ...] = (
    *_ANY_MONSTERS,
    lambda rng, message, good: as_msgpack(message),
    lambda rng, message, good: as_json(_long_text(rng, message)),
    lambda rng, message, good: b"[" * 5_000,
    lambda rng, message, good: b'{"version":' * 5_000,
    lambda rng, message, good: good[:-1] + b',"z":' + b"[" * 5_000 + b"]" * 5_000 + b"}",
    lambda rng, message, good: good[:-1] + b"," + good[1:],  # every key twice
    lambda rng, message, good: good[:-1] + b',"version":99}',
    lambda rng, message, good: good.decode("utf-8", "replace").encode("utf-16"),
    lambda rng, message, good: b"\xef\xbb\xbf" + good,
    lambda rng, message, good: good.replace(b"1", b"1e999", 1),
    lambda rng, message, good: good.replace(b"1", b"1" * 5_000, 1),
    lambda rng, message, good: good.replace(b'"', b'"\\ud800', 3),
    lambda rng, message, good: good.replace(b'"', b"'"),
    lambda rng, message, good: b'"' + good.replace(b'"', b'\\"') + b'"',
)
_MSGPACK_MONSTERS: tuple[_Monster, ...] = (
    *_ANY_MONSTERS,
    lambda rng, message, good: as_json(message),
    lambda rng, message, good: as_msgpack(_long_text(rng, message)),
    lambda rng, message, good: b"\x91" * 5_000,
    lambda rng, message, good: as_msgpack({**message, "z": 0})[:-1] + b"\x81\xa1z" * 5_000 + b"\xc0",
    lambda rng, message, good: _twice(good),
    lambda rng, message, good: as_msgpack({**message, rng.choice(list(message)): [0.5] * 6_000}),
    lambda rng, message, good: b"\xdf\xff\xff\xff\xff" + good[1:],  # a map of four thousand million
    lambda rng, message, good: b"\xdd\xff\xff\xff\xff",
    lambda rng, message, good: b"\xc6\xff\xff\xff\xff" + good,
    lambda rng, message, good: as_msgpack(good),
    lambda rng, message, good: as_msgpack({1: good, None: 2}),
    lambda rng, message, good: good.replace(b"\xa7version", b"\xd9\x07version"),  # legal, and unusual
)


def _twice(good: bytes) -> bytes:
    """Return a small map with every key twice."""
    count = good[0] & 0x0F
    return bytes([0xDE, 0, 2 * count]) + good[1:] + good[1:]
