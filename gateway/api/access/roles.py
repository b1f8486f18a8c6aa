"""Who may ask for what over the network: users, or certificates by their common name, each with a role.

Rules
    * zenoh does not say who sent a query. So each user has a command key of his own, which zenoh's access control lets him
      alone ask on: what arrives there is his, and has his role. Which key is his he knows by a token that he alone sees.
    * Rules of zenoh can only add to what everybody may (of several subjects that fit, one that is allowed is enough). So
      everybody is what nobody has named: a viewer.
    * Stops are on no list. Whoever gets in may stop.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from msgspec import Struct

from gateway.api import protocol
from gateway.errors import Code, GatewayError, Refusal, failure
from gateway.messages.requests import Estop, LeaveEndpoint, RegisterEndpoint, Request, Stop
from gateway.values import Role

__all__ = ["MAX_USERS", "USER_NAME", "Asker", "access_control", "allow", "not_permitted", "read_roles"]

USER_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")
"""A name of a user that can be a part of a zenoh key."""
MAX_USERS = 256
"""Each has a key of its own in zenoh."""
FOR_EVERYBODY = (Stop, Estop, RegisterEndpoint, LeaveEndpoint)
"""What a viewer may ask for: nothing of it moves the robot. A stop endpoint is somebody who watches."""


class Asker(Struct, frozen=True, kw_only=True):
    """Who asks, as far as the way tells by which he came.

    Attributes:
        door: `socket`, `network` or `pipe`.
        user: Name for which zenoh vouches; empty where it knows none.
        role: What he may ask for.
    """

    door: str = "socket"
    user: str = ""
    role: Role = Role.ADMIN


def not_permitted(asker: Asker, request: Request) -> Refusal | None:
    """Refuse to a viewer whatever is no stop. What an operator may not, the core knows: it depends on the others."""
    if asker.role is not Role.VIEWER or isinstance(request, FOR_EVERYBODY):
        return None
    who = f"{asker.user} is a viewer" if asker.user else "who has no role here is a viewer"
    message = f"{who}, who may look and stop, not ask for {type(request).__name__}"
    return Refusal(code=Code.NOT_PERMITTED, message=message, field="role", value="viewer", bound="operator")


def read_roles(path: str) -> dict[str, Role]:
    """Return who has which role, from a file of `NAME:ROLE` a line; lines that begin with # say nothing.

    Raises:
        ConfigError: BAD_CONFIG. It cannot be read, or a line of it, which is named.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise _wrong(path, f"cannot be read: {error}") from None
    roles: dict[str, Role] = {}
    for number, line in enumerate(lines, 1):
        name, _, word = (part.strip() for part in line.partition(":"))
        if not line.strip() or name.startswith("#"):
            continue
        if USER_NAME.fullmatch(name) is None:
            raise _wrong(path, f"line {number}: {name!r} is no name: letters, digits and . _ @ -, 64 at most")
        if name in roles:
            raise _wrong(path, f"line {number}: {name!r} has a role already")
        if word not in list(Role):
            raise _wrong(path, f"line {number}: {word!r} is no role: {', '.join(Role)}")
        roles[name] = Role(word)
    if len(roles) > MAX_USERS:
        raise _wrong(path, f"{len(roles)} users are named, {MAX_USERS} are the most")
    return roles


def access_control(
    rules: list[dict[str, Any]], moving: dict[str, Any], roles: Mapping[str, Role] | None, kind: str
) -> dict[str, Any]:
    """Return zenoh's access control.

    Args:
        rules: Of everybody.
        moving: Of operators and admins on top.
        roles: Who has which; None where everybody may do all of it.
        kind: By what zenoh knows them: `usernames` or `cert_common_names`.
    """
    given = {"everybody": rules if roles is not None else [*rules, moving]}
    subjects: list[dict[str, Any]] = [{"id": "everybody"}]
    for name, role in (roles or {}).items():
        command = [protocol.command_key(name)]
        given[f"user {name}"] = [
            allow(f"ask_as {name}", "ingress", ["query"], command),
            allow(f"answer {name}", "egress", ["reply", "declare_queryable"], command),
            allow(f"tell {name}", "egress", ["reply", "liveliness_token"], [protocol.user_token(name)]),
            *([] if role is Role.VIEWER else [moving]),
        ]
        subjects.append({"id": f"user {name}", kind: [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": list({rule["id"]: rule for own in given.values() for rule in own}.values()),
        "subjects": subjects,
        "policies": [{"rules": [rule["id"] for rule in own], "subjects": [who]} for who, own in given.items()],
    }


def allow(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    """Return a rule of zenoh's access control: of one flow, for what is allowed in both a viewer could inject."""
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}


def _wrong(path: str, message: str) -> GatewayError:
    hint = "write NAME:ROLE a line, e.g. ann:operator"
    message = f"local.roles_file = {path!r}: {message}"
    return failure(Code.BAD_CONFIG, message, field="local.roles_file", value=path, hint=hint)
