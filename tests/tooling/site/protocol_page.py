"""The reference of the local protocol, from the messages that client and daemon share."""

from __future__ import annotations

import re
from typing import Any, get_args

import msgspec

from gateway.api import protocol
from gateway.messages import requests
from gateway.messages.envelopes import Command, Notice, Reply, Target
from gateway.messages.facts import Info, Routes
from gateway.messages.incoming import Admittance, Until
from gateway.messages.requests import Request
from gateway.messages.snapshot import Snapshot
from tests.tooling.site.markdown import attributes, cell, prose, table

__all__ = ["page"]

SHORT = {"integer": "whole number", "number": "number", "string": "text", "boolean": "true or false", "null": "null"}

EXAMPLE = Command(
    version=protocol.PROTOCOL_VERSION,
    client_id="me-1",
    secret="s3cret",
    request_id=1,
    request=protocol.Acquire(name="my program", pid=4711),
)


def page() -> str:
    """Return the page."""
    lines = [
        "# Protocol",
        "",
        prose(protocol.__doc__ or "").replace("```\n", "```text\n", 1),
        "",
        f"A payload is at most {protocol.MAX_PAYLOAD_BYTES} bytes. A command is answered within "
        f"{protocol.REPLY_WITHIN_NS / 1e9:g} s. An owner shows that it lives every {protocol.KEEPALIVE_PERIOD_NS // 10**6} ms.",
        "",
        "A command in JSON, which asks for the lease:",
        "",
        "```json",
        msgspec.json.format(protocol.encode(EXAMPLE, protocol.JSON), indent=2).decode(),
        "```",
        "",
        "## Envelopes",
        "",
        *_structs([Command, Target, Reply, Notice]),
        "## Requests",
        "",
        prose(requests.__doc__ or ""),
        "",
        *_structs([*get_args(Request), Until, Admittance]),
        "## What is published",
        "",
        *_structs(_reached([Snapshot, Info, Routes])),
    ]
    return "\n".join(lines)


def _reached(roots: list[type[msgspec.Struct]]) -> list[type[msgspec.Struct]]:
    """Return structs and those that they are made of, each once."""
    found: dict[type[msgspec.Struct], None] = {}
    todo: list[Any] = list(roots)
    while todo:
        kind = todo.pop(0)
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct) and kind not in found:
            found[kind] = None
            todo += [field.type for field in msgspec.structs.fields(kind)]
        else:
            todo += get_args(kind)
    return list(found)


def _structs(kinds: Any) -> list[str]:
    """Return a heading, the words and the fields of each."""
    lines = []
    for kind in kinds:
        tag = kind.__struct_config__.tag
        title = f"`{tag}`" if tag else kind.__name__
        told = attributes(kind.__doc__ or "")
        lines += [f"### {title}", "", prose(kind.__doc__ or ""), ""]
        fields = msgspec.structs.fields(kind)
        rows = [
            (f"`{field.name}`", _type(field.type), _default(field), cell(told.get(field.name, ""))) for field in fields
        ]
        has_defaults, has_words = (any(row[column] for row in rows) for column in (2, 3))
        columns = [0, 1, *([2] if has_defaults else []), *([3] if has_words else [])]
        head = ["Field", "Type", "Default", "Means"]
        if rows:
            lines += [table([head[c] for c in columns], [[row[c] for c in columns] for row in rows]), ""]
    return lines


def _default(field: msgspec.structs.FieldInfo) -> str:
    if field.required:
        return ""
    value = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()
    return f"`{msgspec.json.encode(value).decode()}`"


def _type(kind: Any) -> str:
    (schema,), components = msgspec.json.schema_components([kind])
    return cell(_shown(schema, components))


def _shown(schema: dict[str, Any], components: dict[str, Any]) -> str:
    """Return a JSON schema in few words."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        target = components[name]
        return _shown(target, components) if "enum" in target else f"[{name}](#{_anchor(target, name)})"
    if "anyOf" in schema:
        if len(schema["anyOf"]) > 5:
            return "one of the [requests](#requests)"
        return " or ".join(_shown(part, components) for part in schema["anyOf"])
    if "enum" in schema:
        return " or ".join(f"`{msgspec.json.encode(value).decode()}`" for value in schema["enum"])
    if schema.get("type") == "array":
        return f"list of {_many(_shown(schema.get('items') or {}, components))}"
    if schema.get("type") == "object":
        return f"object of {_many(_shown(schema.get('additionalProperties') or {}, components))}"
    return SHORT.get(schema.get("type", ""), "anything")


def _many(shown: str) -> str:
    return re.sub(r"^(whole number|number|text|list|object)\b", r"\1s", shown)


def _anchor(target: dict[str, Any], name: str) -> str:
    tag = target.get("properties", {}).get("type", {}).get("enum", [name.lower()])
    return str(tag[0])
