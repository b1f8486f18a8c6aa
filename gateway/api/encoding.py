"""Bytes to messages and back. What comes from outside is believed only after it was decoded here.

Rules
    * msgpack or JSON, as the zenoh encoding says; no encoding means msgpack.
    * Requests and targets above `MAX_PAYLOAD_BYTES` are refused before they are looked at.
    * Every failure to decode is a `Malformed` with the refusal that the sender is told, never another exception.

Import these names from `gateway.api.protocol`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Generic, TypeVar

import msgspec

from gateway.api.keys import JSON, MAX_PAYLOAD_BYTES, MSGPACK, PROTOCOL_VERSION
from gateway.errors import Code, Refusal
from gateway.messages.envelopes import Command, Notice, Reply, Target
from gateway.messages.facts import Info, Routes
from gateway.messages.requests import Estop, Stop
from gateway.messages.snapshot import RefusalMessage, Snapshot

__all__ = [
    "Malformed",
    "decode_command",
    "decode_info",
    "decode_notice",
    "decode_reply",
    "decode_routes",
    "decode_snapshot",
    "decode_target",
    "encode",
    "prepare",
    "refusal_of",
]

_T = TypeVar("_T")


class Malformed(ValueError):
    """A payload is no message of this protocol.

    Attributes:
        refusal: What the sender is told: BAD_REQUEST or UNSUPPORTED_VERSION.
    """

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.message)
        self.refusal = refusal


class _Envelope(msgspec.Struct, frozen=True):
    """What a command of any version has."""

    version: int


class _Reader(Generic[_T]):
    """Decodes one kind of message from both encodings.

    Args:
        what: What the message is called in a refusal.
        message: Its class.
        limit: Largest payload that is looked at [B]; None for what the daemon sends.
    """

    def __init__(self, what: str, message: type[_T], limit: int | None = None) -> None:
        self._what = what
        self._message = message
        self._limit = limit
        self._decoders: dict[str, Callable[[bytes], _T]] = {}

    def decoder(self, encoding: str) -> Callable[[bytes], _T] | None:
        """Return what decodes an encoding; None for an unknown one. Built at first use: it takes milliseconds."""
        if encoding not in self._decoders:
            if encoding == MSGPACK:
                self._decoders[MSGPACK] = msgspec.msgpack.Decoder(self._message).decode
            elif encoding == JSON:
                self._decoders[JSON] = msgspec.json.Decoder(self._message).decode
        return self._decoders.get(encoding)

    def read(self, payload: bytes, encoding: str) -> _T:
        """Return the message, or raise `Malformed`."""
        if self._limit is not None and len(payload) > self._limit:
            raise self._malformed(
                f"has {len(payload)} bytes, at most {self._limit} are taken",
                value=str(len(payload)),
                bound=str(self._limit),
                unit="B",
            )
        decode = self.decoder(encoding or MSGPACK)
        if decode is None:
            raise self._malformed(
                f"is encoded as {encoding[:64]!r}, {MSGPACK} and {JSON} are understood",
                value=encoding[:64],
                bound=f"{MSGPACK}, {JSON}",
            )
        try:
            return decode(payload)
        except (ValueError, RecursionError) as error:  # msgspec's errors and UnicodeDecodeError are ValueErrors
            raise self._malformed(f"cannot be read: {str(error)[:200]}") from None

    def _malformed(self, message: str, value: str = "", bound: str = "", unit: str = "") -> Malformed:
        return Malformed(
            Refusal(
                code=Code.BAD_REQUEST,
                message=f"the {self._what} {message}",
                field=self._what,
                value=value,
                bound=bound,
                unit=unit,
                hint="see the protocol in gateway/api/protocol.py",
            )
        )


_ENCODERS: Final = {MSGPACK: msgspec.msgpack.Encoder().encode, JSON: msgspec.json.Encoder().encode}

_COMMAND: Final = _Reader("command", Command, MAX_PAYLOAD_BYTES)
_ENVELOPE: Final = _Reader("command", _Envelope, MAX_PAYLOAD_BYTES)
_TARGET: Final = _Reader("target", Target, MAX_PAYLOAD_BYTES)
_REPLY: Final = _Reader("reply", Reply)
_SNAPSHOT: Final = _Reader("snapshot", Snapshot)
_NOTICE: Final = _Reader("notice", Notice)
_INFO: Final = _Reader("info", Info)
_ROUTES: Final = _Reader("routes", Routes)


def prepare() -> None:
    """Build what a daemon decodes with, before its loop runs: the first request must not stall it."""
    for reader in (_COMMAND, _ENVELOPE, _TARGET):
        for encoding in (MSGPACK, JSON):
            reader.decoder(encoding)


def encode(message: object, encoding: str = MSGPACK, *, escapes: bool = True) -> bytes:
    """Return the bytes of a message: a struct of this protocol.

    Half letters, which a path has where it is no UTF-8, are escaped: nobody misses a snapshot for the name of a file.

    Args:
        message: What to send.
        encoding: `MSGPACK` or `JSON` (where a NaN becomes null, which no reader of ours accepts); empty for msgpack.
        escapes: Whether half letters are.

    Raises:
        TypeError: The message holds something that has no form in the encoding.
        UnicodeEncodeError: Half letters, which are not escaped.
        KeyError: An unknown encoding.
    """
    encoder = _ENCODERS[encoding or MSGPACK]
    try:
        return encoder(message)
    except UnicodeEncodeError:
        if not escapes:
            raise
        return encoder(_escaped(msgspec.to_builtins(message, builtin_types=(bytes,))))


def _escaped(value: object) -> object:
    """Return a builtin value with the half letters in its texts escaped."""
    if isinstance(value, str):
        return value.encode(errors="backslashreplace").decode()
    if isinstance(value, dict):
        return {_escaped(key): _escaped(of_key) for key, of_key in value.items()}
    return [_escaped(one) for one in value] if isinstance(value, list | tuple) else value


def decode_command(payload: bytes, encoding: str = MSGPACK) -> Command:
    """Return the command in a payload.

    Args:
        payload: Untrusted bytes.
        encoding: zenoh encoding of the query; empty for msgpack.

    Raises:
        Malformed: Too large, neither msgpack nor JSON, another version, unknown type or field, wrong type or size.
    """
    try:
        command = _COMMAND.read(payload, encoding)
    except Malformed:
        _check_version(payload, encoding)
        raise
    # A stop means the same in every version, and is never refused.
    if command.version != PROTOCOL_VERSION and not isinstance(command.request, (Stop, Estop)):
        raise _other_version(command.version)
    return command


def decode_target(payload: bytes, encoding: str = MSGPACK) -> Target:
    """Return the target in a payload. Raises `Malformed` as `decode_command` does."""
    return _TARGET.read(payload, encoding)


def decode_reply(payload: bytes, encoding: str = MSGPACK) -> Reply:
    """Return the reply in a payload. Raises `Malformed`."""
    return _REPLY.read(payload, encoding)


def decode_snapshot(payload: bytes, encoding: str = MSGPACK) -> Snapshot:
    """Return the snapshot in a payload. Raises `Malformed`."""
    return _SNAPSHOT.read(payload, encoding)


def decode_notice(payload: bytes, encoding: str = MSGPACK) -> Notice:
    """Return the notice in a payload. Raises `Malformed`."""
    return _NOTICE.read(payload, encoding)


def decode_info(payload: bytes, encoding: str = MSGPACK) -> Info:
    """Return the daemon's facts in a payload. Raises `Malformed`."""
    return _INFO.read(payload, encoding)


def decode_routes(payload: bytes, encoding: str = MSGPACK) -> Routes:
    """Return the state of the routes in a payload. Raises `Malformed`."""
    return _ROUTES.read(payload, encoding)


def refusal_of(message: RefusalMessage) -> Refusal:
    """Return the refusal in a reply. A code of a later release becomes INTERNAL with the code in its text."""
    try:
        code, text = Code(message.code), message.message
    except ValueError:
        code, text = Code.INTERNAL, f"{message.code}: {message.message}"
    return Refusal(
        code=code,
        message=text,
        field=message.field,
        value=message.value,
        bound=message.bound,
        unit=message.unit,
        hint=message.hint,
    )


def _check_version(payload: bytes, encoding: str) -> None:
    """Raise the better reason when a command could not be read because it is of another version."""
    try:
        envelope = _ENVELOPE.read(payload, encoding)
    except Malformed:
        return
    if envelope.version != PROTOCOL_VERSION:
        raise _other_version(envelope.version) from None


def _other_version(version: int) -> Malformed:
    return Malformed(
        Refusal(
            code=Code.UNSUPPORTED_VERSION,
            message=f"the command is of protocol version {version}, this daemon speaks {PROTOCOL_VERSION}",
            field="version",
            value=str(version),
            bound=str(PROTOCOL_VERSION),
        )
    )
