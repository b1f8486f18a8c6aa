"""A policy's server by openpi's WebSocket protocol: one binary metadata frame, then observation for action chunk.

Rules
    * Frames are MessagePack; an array is a map with bytes as keys: `__ndarray__`, `data`, `dtype`, `shape`.
    * A text frame is the server's traceback, after which it hangs up.
    * Every wait has an end. What was read is a copy, which may be written to.
    * No pings: a server that works on an answer does not answer them.

Libraries: websockets (extra `policy`), msgspec. Knows nothing of the robot.
"""

from __future__ import annotations

import logging
import math
import socket
import struct
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import msgspec
import numpy as np

from gateway.errors import Code, GatewayError, failure

__all__ = ["FIRST_ANSWER_S", "PolicyServer", "decoded", "encoded"]

_log = logging.getLogger(__name__)

FIRST_ANSWER_S = 60.0
"""Longest wait for the first answer of a connection [s]: servers compile their model then."""
NUMBERS = "biuf"
"""Kinds of arrays that are numbers: nothing else is read."""


def encoded(values: Mapping[str, Any]) -> bytes:
    """Return a map with arrays as a frame."""
    return msgspec.msgpack.Encoder(enc_hook=_as_map).encode(values)


def _as_map(value: object) -> Any:  # noqa: ANN401  a map, or a number as Python has it
    if isinstance(value, np.ndarray):
        data = np.ascontiguousarray(value)
        return {b"__ndarray__": True, b"data": data.tobytes(), b"dtype": data.dtype.str, b"shape": list(data.shape)}
    if isinstance(value, np.generic) and not isinstance(number := value.item(), np.generic):
        return number
    raise TypeError(f"{type(value).__name__} cannot be sent")


def decoded(frame: bytes) -> dict[Any, Any]:
    """Return the map of a frame, its arrays as arrays that may be written to.

    Raises:
        Rejected: BAD_REQUEST, it is no such map or holds arrays of other things than numbers; WRONG_SHAPE, data do not
            fit an array's shape.
    """
    try:
        found = _revived(msgspec.msgpack.decode(frame))
    except (msgspec.DecodeError, RecursionError) as error:
        raise _wrong(Code.BAD_REQUEST, f"the policy server sent what is no MessagePack: {error}") from None
    if not isinstance(found, dict):
        raise _wrong(Code.BAD_REQUEST, f"the policy server sent a {type(found).__name__}, a map is needed")
    return found


def _revived(value: Any) -> Any:  # noqa: ANN401  whatever a frame holds
    if isinstance(value, list):
        return [_revived(item) for item in value]
    if not isinstance(value, dict):
        return value
    if b"__ndarray__" in value:
        return _array(value)
    if b"__npgeneric__" in value:
        return value.get(b"data")
    return {key.decode(errors="replace") if isinstance(key, bytes) else key: _revived(v) for key, v in value.items()}


def _array(value: Mapping[Any, Any]) -> np.ndarray[Any, np.dtype[Any]]:
    wire: list[Any] = [value.get(key) for key in (b"dtype", b"shape", b"data")]
    name, shape, data = wire
    try:
        dtype = np.dtype(name if isinstance(name, str) else name.decode())
        sizes = [int(size) for size in shape]
    except (AttributeError, TypeError, ValueError):
        raise _wrong(Code.BAD_REQUEST, f"the policy server sent an array of type {name!r}, shape {shape!r}") from None
    if dtype.kind not in NUMBERS:
        raise _wrong(Code.BAD_REQUEST, f"the policy server sent an array of {dtype} ({name!r}); only numbers are read")
    size = len(data) if isinstance(data, bytes) else -1
    if min(sizes, default=0) < 0 or size != math.prod(sizes) * dtype.itemsize:
        wanted = f"{math.prod(sizes) * dtype.itemsize} bytes for shape {tuple(sizes)} of {dtype}"
        raise _wrong(Code.WRONG_SHAPE, f"the policy server sent an array of {size} bytes, {wanted} are needed")
    return np.frombuffer(data or b"", dtype).reshape(sizes).copy()


def _wrong(code: Code, message: str) -> GatewayError:
    hint = "is it an openpi server? see its log; other packages of arrays in MessagePack are not the same"
    return failure(code, message, field="server", hint=hint)


class PolicyServer:
    """A connection to a policy's server, made by `connect`; used by one thread, closed by any.

    Args:
        url: `ws://HOST:PORT`, or `wss://`.
        api_key: Sent as `Authorization: Api-Key ...`; empty for none.
        connect_s: Longest wait for the connection, and for its metadata [s].
        answer_s: Longest wait for an answer [s] ...
        first_answer_s: ... and for the first one of a connection.

    Raises:
        Rejected: BAD_REQUEST, websockets is not installed.
    """

    def __init__(
        self,
        url: str,
        *,
        api_key: str = "",
        connect_s: float = 5.0,
        answer_s: float = 5.0,
        first_answer_s: float = FIRST_ANSWER_S,
    ) -> None:
        try:
            import websockets.exceptions
            import websockets.sync.client
        except ImportError as error:
            message = f"policy servers are asked with websockets, which is not installed ({error})"
            hint = "install it: pip install 'teleavatar-gateway[policy]'"
            raise failure(Code.BAD_REQUEST, message, hint=hint) from None
        self.url = url
        self.metadata: Mapping[Any, Any] = {}
        """What the server said of itself when it was connected to."""
        self._connect, self._errors = websockets.sync.client.connect, websockets.exceptions
        self._headers = {"Authorization": f"Api-Key {api_key}"} if api_key else {}
        self._connect_s, self._answer_s, self._first_answer_s = connect_s, answer_s, first_answer_s
        self._connection: Any = None
        self._has_answered = False

    @property
    def is_connected(self) -> bool:
        """Whether there is a connection that was not lost yet."""
        return self._connection is not None

    def connect(self) -> None:
        """Connect, and read the metadata.

        Raises:
            Rejected: BAD_REQUEST, the address is none, or what came is none of this protocol.
            Disconnected: Nobody answers there, or the server does not take us.
            GatewayTimeout: No metadata came.
            Aborted: POLICY_FAILED, the server says that it failed.
        """
        self.close()
        try:
            self._connection = self._connect(
                self.url,
                compression=None,
                max_size=None,
                additional_headers=self._headers,
                open_timeout=self._connect_s,
                ping_interval=None,
                close_timeout=0.5,
                proxy=None,
            ).__enter__()  # how every release connects without a warning; `close` is its other end
        except (self._errors.InvalidURI, ValueError) as error:
            message = f"{self.url!r} is no address of a policy server: {error}"
            hint = "ws://HOST:PORT is one, e.g. ws://127.0.0.1:8000"
            raise failure(Code.BAD_REQUEST, message, field="target", value=self.url, hint=hint) from None
        except (OSError, EOFError, self._errors.WebSocketException) as error:
            raise self._gone(str(error) or type(error).__name__) from None
        until_s = struct.pack("ll", *divmod(round(self._answer_s * 1e6), 1_000_000))
        with suppress(
            OSError
        ):  # one that stands still takes no picture; what one that hung up said is still there to be read
            self._connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, until_s)
        self._has_answered = False
        self.metadata = self._received(self._connect_s, "metadata")

    def ask(self, observation: Mapping[str, Any]) -> dict[Any, Any]:
        """Return the server's answer to an observation.

        Raises:
            Disconnected: The connection was lost, or never made.
            GatewayTimeout: TIMEOUT, no answer came; the connection is closed.
            Aborted: POLICY_FAILED, with the last line of the server's traceback.
            Rejected: The answer is none of this protocol.
        """
        connection = self._connection
        if connection is None:
            raise self._gone("there is no connection")
        try:
            connection.send(encoded(observation))
        except (OSError, self._errors.ConnectionClosed):
            pass  # what it said before it hung up is still there to be read
        answer = self._received(self._answer_s if self._has_answered else self._first_answer_s, "answer")
        self._has_answered = True
        return answer

    def close(self) -> None:
        """Hang up; nothing when there is no connection."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(OSError, self._errors.WebSocketException):
                connection.close()

    def _received(self, timeout_s: float, what: str) -> dict[Any, Any]:
        connection = self._connection
        try:
            if connection is None:  # closed by another thread
                raise EOFError("hung up")
            frame = connection.recv(timeout=timeout_s)
        except TimeoutError:
            self.close()
            message = f"no {what} came from the policy server {self.url} in {timeout_s:g} s"
            hint = "see whether it still works; wait longer with --timeout"
            raise failure(Code.TIMEOUT, message, field="server", hint=hint) from None
        except (OSError, EOFError, self._errors.ConnectionClosed) as error:
            self.close()
            raise self._gone(str(error) or type(error).__name__) from None
        if isinstance(frame, str):
            self.close()
            _log.info("the policy server %s failed:\n%s", self.url, frame)
            last = next((line.strip() for line in reversed(frame.splitlines()) if line.strip()), "nothing was said")
            raise failure(Code.POLICY_FAILED, f"the policy server {self.url} failed: {last[:300]}", field="server")
        return decoded(frame)

    def _gone(self, why: str) -> GatewayError:
        message, hint = f"the policy server {self.url} is not there: {why}", "start it, and see its log"
        return failure(Code.DISCONNECTED, message, field="server", hint=hint)
