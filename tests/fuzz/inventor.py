"""Makes requests of every kind from their own structs, so that a kind or a field that is new is attacked by itself.

What a field may hold is read from its type; what it should hold to get past decoder and validation (the epoch of now, a pose in
reach) is told by whoever knows: `hints`, by the name of the field. One without a hint gets whatever its type allows.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from typing import Any, get_args

from msgspec import inspect

from gateway.api import protocol

__all__ = ["KINDS", "Inventor"]

KINDS: Mapping[str, inspect.StructType] = {
    str(info.tag): info
    for info in map(inspect.type_info, get_args(protocol.Request))
    if isinstance(info, inspect.StructType)
}
"""By its tag, what each request of the protocol looks like."""

FLOATS = (0.0, 1.0, -1.0, 0.1, 0.5, -0.3, 2.0, 1e-9)
TEXTS = ("a", "left", "left_shoulder_base", "right_shoulder_base", "人", "x" * 64)


class Inventor:
    """Invents requests.

    Args:
        rng: Source of everything.
        hints: By the name of a field, what makes a good value of it.

    Attributes:
        made: Names of the fields that were filled, as `kind.field`.
    """

    def __init__(self, rng: random.Random, hints: Mapping[str, Callable[[], Any]]) -> None:
        self.rng = rng
        self.hints = hints
        self.made: set[str] = set()

    def request(self, kind: str) -> dict[str, Any]:
        """Return a request of a kind as an object; most of them mean something."""
        return self._struct(KINDS[kind])

    def _struct(self, info: inspect.StructType) -> dict[str, Any]:
        value: dict[str, Any] = {} if info.tag is None else {str(info.tag_field): info.tag}
        for field in info.fields:
            if not field.required and self.rng.random() < 0.4:
                continue
            hint = self.hints.get(field.encode_name)
            is_hinted = hint is not None and self.rng.random() < 0.95
            value[field.encode_name] = hint() if is_hinted and hint is not None else self._value(field.type)
            self.made.add(f"{info.tag}.{field.encode_name}")
        return value

    def _value(self, kind: inspect.Type) -> Any:
        rng = self.rng
        if isinstance(kind, inspect.StructType):
            return self._struct(kind)
        if isinstance(kind, inspect.UnionType):
            return self._value(rng.choice(kind.types))
        if isinstance(kind, inspect.EnumType):
            return rng.choice([choice.value for choice in kind.cls])
        if isinstance(kind, inspect.DictType):
            return {self._value(kind.key_type): self._value(kind.value_type) for _ in range(rng.randint(0, 2))}
        if isinstance(kind, (inspect.VarTupleType, inspect.ListType)):
            count = rng.choice((0, 1, 2, 7, 7, 7, kind.max_length or 3))
            return [self._value(kind.item_type) for _ in range(min(count, 64))]
        if isinstance(kind, inspect.IntType):
            low, high = kind.ge if kind.ge is not None else -(2**62), kind.le if kind.le is not None else 2**62
            return rng.choice((low, high, 1, 3, 10**9, rng.randint(low, high)))
        if isinstance(kind, inspect.FloatType):
            return rng.choice(FLOATS)
        if isinstance(kind, inspect.StrType):
            return rng.choice(TEXTS)
        if isinstance(kind, inspect.BoolType):
            return rng.random() < 0.5
        if isinstance(kind, inspect.NoneType):
            return None
        raise TypeError(f"nobody has said how to invent {kind}: add it here")
