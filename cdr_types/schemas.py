"""The `.msg` text of each message type, as ROS 2 tools and MCAP files want it.

The text is written from the class's layout, so it cannot disagree with what is on the wire. A definition is the text
of the type itself, then the text of each type that it uses, once, each behind a line of 80 `=` and a line
`MSG: package/Name` (MCAP schema encoding `ros2msg`).
"""

from __future__ import annotations

from functools import cache

from cdr_types.layout import Kind, Number, Sequence, Struct, Text, layout_of
from cdr_types.registry import message_type, type_name

__all__ = ["ENCODING", "definition", "text"]

ENCODING = "ros2msg"
"""Name of this schema language in MCAP."""

_SEPARATOR = "=" * 80


@cache
def text(name: str) -> str:
    """Return the fields of one type, a line each, without those of the types that it uses.

    Args:
        name: ROS type name, e.g. `std_msgs/msg/Header`.

    Raises:
        UnknownType: If no class here has this name.
    """
    fields = layout_of(message_type(name)).fields
    return "".join(f"{_word(kind)} {field}\n" for field, kind in fields)


@cache
def definition(name: str) -> str:
    """Return the self-contained definition of one type: its text and that of every type it uses.

    Args:
        name: ROS type name, e.g. `sensor_msgs/msg/JointState`.

    Raises:
        UnknownType: If no class here has this name.
    """
    used: dict[str, None] = {}
    _collect(layout_of(message_type(name)), used)
    parts = [f"{_SEPARATOR}\nMSG: {_short(other)}\n{text(other)}" for other in used]
    return text(name) + "".join(parts)


def _collect(layout: Struct, used: dict[str, None]) -> None:
    """Add the names of all nested types, each before the types that it uses itself."""
    for _, kind in layout.fields:
        nested = kind.element if isinstance(kind, Sequence) else kind
        if isinstance(nested, Struct):
            used[type_name(nested.message_type)] = None
            _collect(nested, used)


def _word(kind: Kind) -> str:
    if isinstance(kind, Number):
        return kind.name
    if isinstance(kind, Text):
        return "string"
    if isinstance(kind, Sequence):
        return f"{_word(kind.element)}[]"
    return _short(type_name(kind.message_type))


def _short(name: str) -> str:
    """Return `package/Name`, the form that `.msg` text uses."""
    package, _, plain = name.split("/")
    return f"{package}/{plain}"
