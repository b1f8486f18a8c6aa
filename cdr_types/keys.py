"""Topic <-> zenoh key, and the liveliness tokens of zenoh-plugin-ros2dds.

```
key       [namespace/]topic without the leading slash                       left_arm/joint_states
presence  @/<zid>/@ros2_lv                                                  a bridge is there
topics    @/<zid>/@ros2_lv/{MP|MS}/<key, / as §>/<type, / as §>/<qos>       publisher, subscriber
others    @/<zid>/@ros2_lv/{SS|SC|AS|AC}/<key, / as §>/<type, / as §>       service and action, server and client
```

The grammar of the QoS is in `qos`. `§` stands for `/` in tokens only; data keys are never escaped (wire.md 1.1, 4.1).
The parts of a name and of a type are those of ROS: letters, digits and _. A zenoh key may hold anything else, too, and a
stranger's token does: escapes of a terminal, a line of a log, a word for a shell. Nothing here opens a session.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum

from cdr_types.errors import BadName
from cdr_types.qos import Durability, History, Qos, Reliability, format_qos, parse_qos

__all__ = [
    "ALL_TOKENS",
    "Durability",
    "History",
    "Qos",
    "Reliability",
    "Token",
    "TokenKind",
    "format_token",
    "parse_token",
    "presence_key",
    "topic_to_key",
]

ALL_TOKENS = "@/*/@ros2_lv/**"
"""Key expression of every token of every bridge, presence included."""

_SLASH = "§"
_CHUNK = re.compile(r"[A-Za-z0-9_]+")
_ZID = re.compile(r"[0-9a-f]{1,32}")


class TokenKind(str, Enum):
    """What a token announces."""

    PRESENCE = ""
    MP = "MP"
    MS = "MS"
    SS = "SS"
    SC = "SC"
    AS = "AS"
    AC = "AC"

    @property
    def has_qos(self) -> bool:
        """Whether tokens of this kind end with a QoS: the two of topics do."""
        return self in (TokenKind.MP, TokenKind.MS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Token:
    """One liveliness token.

    Attributes:
        zid: Zenoh id of the bridge (or of whoever speaks its language), hexadecimal as zenoh prints it.
        kind: What is announced.
        topic: Name with the leading slash and, where the bridge has one, its namespace; empty for PRESENCE.
        type_name: ROS type name; empty for PRESENCE.
        qos: For topics; else None.
    """

    zid: str
    kind: TokenKind
    topic: str = ""
    type_name: str = ""
    qos: Qos | None = None

    def __post_init__(self) -> None:
        if not _ZID.fullmatch(self.zid):
            raise BadName(self.zid, "a zenoh id is 1 to 32 lower-case hexadecimal digits", field="zid")
        if (self.qos is not None) != self.kind.has_qos:
            raise BadName(self.qos, "MP and MS carry a QoS, the other kinds none", field="qos")
        if self.kind is TokenKind.PRESENCE:
            if self.topic or self.type_name:
                raise BadName(
                    self.topic or self.type_name, "a presence token names no topic and no type", field="topic"
                )
        else:
            _check_topic(self.topic)
            _check_chunks(self.type_name, "type_name")

    @property
    def key(self) -> str:
        """Data key of the topic, namespace included; empty for PRESENCE."""
        return self.topic[1:]


def topic_to_key(topic: str, namespace: str = "") -> str:
    """Return the zenoh key on which the bridge carries a topic.

    Args:
        topic: ROS name with the leading slash.
        namespace: The bridge's `namespace` option, slashes at the ends optional; it is put before every name.

    Raises:
        BadName: If topic or namespace is no concrete name.
    """
    _check_topic(topic)
    return _prefix(namespace) + topic[1:]


def presence_key(zid: str) -> str:
    """Return the token by which a bridge says that it is there.

    Raises:
        BadName: If the id is none.
    """
    return format_token(Token(zid=zid, kind=TokenKind.PRESENCE))


def format_token(token: Token) -> str:
    """Return the key expression of a token."""
    start = f"@/{token.zid}/@ros2_lv"
    if token.kind is TokenKind.PRESENCE:
        return start
    start = f"{start}/{token.kind.value}/{_escape(token.key)}/{_escape(token.type_name)}"
    return start if token.qos is None else f"{start}/{format_qos(token.qos)}"


def parse_token(keyexpr: str) -> Token:
    """Return the token that a key expression spells.

    Raises:
        BadName: If it is not of the grammar above.
    """
    head, *rest = keyexpr.split("/")
    if head != "@" or len(rest) < 2 or rest[1] != "@ros2_lv":
        raise BadName(keyexpr, "a token begins with @/<zid>/@ros2_lv", field="token")
    if len(rest) == 2:
        return Token(zid=rest[0], kind=TokenKind.PRESENCE)
    kind = _KINDS.get(rest[2])
    if kind is None:
        raise BadName(rest[2], f"one of {', '.join(_KINDS)}", field="token kind")
    parts = 6 if kind.has_qos else 5
    if len(rest) != parts:
        raise BadName(keyexpr, f"a token of kind {kind.value} has {parts + 1} parts", field="token")
    return Token(
        zid=rest[0],
        kind=kind,
        topic=f"/{_unescape(rest[3])}",
        type_name=_unescape(rest[4]),
        qos=parse_qos(rest[5]) if kind.has_qos else None,
    )


_KINDS = {kind.value: kind for kind in TokenKind if kind is not TokenKind.PRESENCE}


def _escape(name: str) -> str:
    return name.replace("/", _SLASH)


def _unescape(chunk: str) -> str:
    return chunk.replace(_SLASH, "/")


def _prefix(namespace: str) -> str:
    """Return the namespace as the beginning of a key: empty, or with a slash behind."""
    name = namespace.strip("/")
    if not name:
        return ""
    _check_chunks(name, "namespace")
    return f"{name}/"


def _check_topic(topic: str) -> str:
    if not topic.startswith("/"):
        raise BadName(topic, "a topic begins with a slash", field="topic")
    _check_chunks(topic[1:], "topic")
    return topic


def _check_chunks(name: str, field: str) -> None:
    """Accept what a name in ROS is made of: so no wildcard, no verbatim chunk (`@...`), and nothing that a terminal obeys."""
    for chunk in name.split("/"):
        if not _CHUNK.fullmatch(chunk):
            raise BadName(name, "its parts between slashes are letters, digits and _", field=field)
