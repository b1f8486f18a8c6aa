"""Quality of service, as the last part of a topic's liveliness token spells it.

```
<K if keyed>:<reliability>:<durability>:[<history>,<depth>][:<user data>]
```

Every field may be empty: the DDS default, or not announced. `:1::0,10` is reliable, keep last 10, durability left out;
`:1:1:` is reliable and transient local (wire.md 4.1). Nothing here says what a QoS does to a stream.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeVar

from cdr_types.errors import BadName

__all__ = ["Durability", "History", "Qos", "Reliability", "format_qos", "parse_qos"]

_USER_DATA = re.compile(r"[^/*$?#]*")
_INTEGER = re.compile(r"-?[0-9]{1,10}")

E = TypeVar("E", bound=IntEnum)


class Reliability(IntEnum):
    """DDS reliability, with the numbers of the token."""

    BEST_EFFORT = 0
    RELIABLE = 1


class Durability(IntEnum):
    """DDS durability, with the numbers of the token; ROS 2 uses the first two."""

    VOLATILE = 0
    TRANSIENT_LOCAL = 1
    TRANSIENT = 2
    PERSISTENT = 3


class History(IntEnum):
    """DDS history, with the numbers of the token."""

    KEEP_LAST = 0
    KEEP_ALL = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Qos:
    """Quality of service of a DDS reader or writer; None is what the token leaves empty.

    Attributes:
        is_keyed: The DDS topic has a key; ROS topics have none.
        reliability: None means the default of the role.
        durability: None means volatile.
        history: None means keep last.
        depth: Samples kept, -1 unlimited; given exactly when `history` is. None means 1.
        user_data: What the bridge passes on since ROS Iron, e.g. the type hash.
    """

    is_keyed: bool = False
    reliability: Reliability | None = None
    durability: Durability | None = None
    history: History | None = None
    depth: int | None = None
    user_data: str | None = None

    def __post_init__(self) -> None:
        if (self.history is None) != (self.depth is None):
            raise BadName((self.history, self.depth), "history and depth are given together or not at all", field="qos")
        if self.user_data is not None and not _USER_DATA.fullmatch(self.user_data):
            raise BadName(self.user_data, "user data must not contain / * $ ? #", field="qos.user_data")


def format_qos(qos: Qos) -> str:
    """Return the last part of a topic's token."""

    def show(number: int | None) -> str:
        return "" if number is None else str(int(number))

    history = "" if qos.history is None else f"{show(qos.history)},{show(qos.depth)}"
    user_data = "" if qos.user_data is None else f":{qos.user_data}"
    return f"{'K' if qos.is_keyed else ''}:{show(qos.reliability)}:{show(qos.durability)}:{history}{user_data}"


def parse_qos(text: str) -> Qos:
    """Return the QoS that the last part of a topic's token spells.

    Raises:
        BadName: If it is not of the grammar above.
    """
    fields = text.split(":", 4)
    if len(fields) < 4:
        raise BadName(text, "a QoS has at least four fields between colons", field="qos")
    if fields[0] not in ("", "K"):
        raise BadName(fields[0], "K or empty", field="qos.is_keyed")
    history, comma, depth = fields[3].partition(",")
    if bool(fields[3]) != bool(comma):
        raise BadName(fields[3], "<history>,<depth> or empty", field="qos.history")
    return Qos(
        is_keyed=fields[0] == "K",
        reliability=_member(Reliability, fields[1]),
        durability=_member(Durability, fields[2]),
        history=_member(History, history),
        depth=_integer(depth, "qos.depth"),
        user_data=fields[4] if len(fields) > 4 else None,
    )


def _member(enum: type[E], text: str) -> E | None:
    field = f"qos.{enum.__name__.lower()}"
    number = _integer(text, field)
    if number is None:
        return None
    try:
        return enum(number)
    except ValueError:
        raise BadName(text, f"one of {', '.join(str(int(member)) for member in enum)} or empty", field=field) from None


def _integer(text: str, field: str) -> int | None:
    if not text:
        return None
    if not _INTEGER.fullmatch(text):
        raise BadName(text, "a decimal number or empty", field=field)
    return int(text)
