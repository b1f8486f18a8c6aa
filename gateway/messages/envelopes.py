"""What requests travel in, and what comes back: commands and targets going in, replies and notices coming out.

What goes in is strict, what comes out is tolerant: a later daemon may add fields, and know codes that this client does
not, so they are text here. Import these names from `gateway.api.protocol`.
"""

from __future__ import annotations

from typing import Any

from msgspec import Struct, field

from gateway.messages.incoming import ClientId, Count, Joints, Secret
from gateway.messages.requests import Request
from gateway.messages.snapshot import RefusalMessage

__all__ = ["Command", "Notice", "RefusalMessage", "Reply", "Target"]


class Command(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A request in its envelope: the payload of a query on the command key.

    Attributes:
        version: `PROTOCOL_VERSION` of the sender.
        client_id: Unique per client; the same as in its liveliness token, keepalives and targets.
        secret: What proves that `client_id` is this client, from its first command on; only a stop may lack it. No snapshot
            shows it.
        request_id: Unique per client. The same id again gets the first reply again: a lost reply can be asked for.
        request: What is asked.
    """

    version: Count
    client_id: ClientId
    secret: Secret = ""
    request_id: Count
    request: Request


class Target(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The newest target of a stream: the payload of a put on the target key. The newest wins; none is answered.

    Attributes:
        epoch: Lease epoch.
        seq: Strictly rising per stream.
        values: In the space of the stream: seven joints [rad], or x, y, z [m], qx, qy, qz, qw.
    """

    epoch: Count
    seq: Count
    values: Joints


class Reply(Struct, frozen=True, kw_only=True):
    """The one answer to a command.

    Attributes:
        request_id: Of the command.
        refusal: Why not; null when it was accepted.
        facts: What the caller needs to go on, e.g. `epoch`, `motion_id`, `stream_id`, `values`, `clipped`.
        after_seq: A snapshot with a greater `seq` shows the effect of the command; one with this or a smaller may not.
    """

    request_id: int
    refusal: RefusalMessage | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    after_seq: int = 0


class Notice(Struct, frozen=True, kw_only=True):
    """Something a person or a log should see.

    Attributes:
        code: Stable code.
        level: `info`, `warning` or `error`.
        message: One sentence.
        at_ns: When, on the daemon's monotonic clock [ns].
        facts: Further facts as text.
    """

    code: str
    level: str
    message: str
    at_ns: int
    facts: dict[str, str] = field(default_factory=dict)
