"""A server of LeRobot's asynchronous inference for tests: gRPC on loopback, scripted answers, pickles as torch makes them."""

from __future__ import annotations

import io
import pickle
import sys
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import Any
from unittest import mock

import grpc
import numpy as np

__all__ = ["Scripted", "as_answer", "loaded", "pickled"]

HELPERS = "lerobot.async_inference.helpers"
KINDS = {"<f4": "FloatStorage", "<f8": "DoubleStorage", "<f2": "HalfStorage", "<i8": "LongStorage"}


def _stand_in(module: str, name: str) -> type:
    """Return a class that pickles by the name of one of torch's or LeRobot's."""
    return type(name, (), {"__module__": module, "__qualname__": name})


TimedAction = _stand_in(HELPERS, "TimedAction")
rebuild, load = _stand_in("torch._utils", "_rebuild_tensor_v2"), _stand_in("torch.storage", "_load_from_bytes")
STORAGES = {kind: _stand_in("torch", name) for kind, name in KINDS.items()}


class _Reduced:
    """Pickles as a call."""

    def __init__(self, by: Any, *of: Any) -> None:
        self._how = by, of

    def __reduce__(self) -> Any:
        return self._how


class _StoragePickler(pickle.Pickler):
    def persistent_id(self, one: Any) -> Any:
        return one[1:] if isinstance(one, tuple) and one[:1] == ("persistent",) else None


def _named() -> Any:
    """Let pickle find the stand-ins for a while."""
    modules: dict[str, ModuleType] = {}
    for one in (TimedAction, rebuild, load, *STORAGES.values()):
        parts = one.__module__.split(".")
        for end in range(1, len(parts) + 1):
            modules.setdefault(".".join(parts[:end]), ModuleType(parts[end - 1]))
        setattr(modules[one.__module__], one.__name__, one)
    return mock.patch.dict(sys.modules, modules)


def _storage(values: np.ndarray[Any, Any], **wrong: Any) -> bytes:
    flat = values.ravel()
    persistent = ("persistent", "storage", STORAGES[flat.dtype.str], "94", "cpu", wrong.get("numel", flat.size), None)
    stream = io.BytesIO()
    for part in (0x1950A86A20F9469CFC6C, 1001, {"little_endian": wrong.get("little_endian", True)}, persistent, ["94"]):
        _StoragePickler(stream, 2).dump(part)
    return stream.getvalue() + wrong.get("count", flat.size).to_bytes(8, "little") + flat.tobytes()


def pickled(rows: Any, first: int = 0, *, size: Any = None, stride: Any = None, off: int = 0, **wrong: Any) -> bytes:
    """Return a list of TimedAction as torch pickles it: each tensor a view of a storage that comes with all of them.

    Args:
        rows: Of actions, shape (H, N).
        first: Number of the first one.
        size: Of each tensor, in place of its own ...
        stride: ... and its stride ...
        off: ... and how much later it begins.
        wrong: In the storage: `count`, `numel` (the same in its pickle), `little_endian`; `timesteps` of the actions.
    """
    actions = []
    with _named():
        for n, row in enumerate(rows):
            one, at = TimedAction(), off + n * len(row)
            shape = (len(row),) if size is None else size
            steps = (1,) if stride is None else stride
            tensor = _Reduced(rebuild, _Reduced(load, _storage(rows, **wrong)), at, shape, steps, False, OrderedDict())
            one.__dict__.update(
                timestamp=1.5 + n / 30,
                timestep=wrong.get("timesteps", range(first, first + len(rows)))[n],
                action=tensor,
            )
            actions.append(one)
        return pickle.dumps(actions)


class Stock:
    """What LeRobot's dataclasses are here: whatever their pickle says."""


class _Stock(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        return type(name, (Stock,), {}) if module == HELPERS else super().find_class(module, name)


def loaded(data: bytes) -> Any:
    """Return what a server gets of a pickle, which it simply loads."""
    return _Stock(io.BytesIO(data)).load()


def _fields(message: bytes) -> dict[int, Any]:
    """Return a protobuf message's fields: numbers, and bytes."""
    found: dict[int, Any] = {}
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = message[at]
            value, shift, at = value | (byte & 0x7F) << shift, shift + 7, at + 1
            if byte < 0x80:
                return value

    while at < len(message):
        tag = varint()
        value: Any = varint()
        if tag & 7 == 2:
            value, at = message[at : at + value], at + value
        found[tag >> 3] = value
    return found


def as_answer(data: bytes) -> bytes:
    """Return the message of an answer, by another way than the client reads it."""
    size, head = len(data), bytearray(b"\x0a")
    while True:
        size, low = divmod(size, 128)
        head.append(low + 128 * (size > 0))
        if not size:
            return bytes(head) + data


class Scripted:
    """Serves until it is closed, and keeps what it was told.

    Args:
        policy: The observation to an answer: rows, bytes of a message as they are, or None for an empty one.
        port: To serve on; 0 takes a free one.
        teach: Called with what it is told to load.
    """

    def __init__(
        self, policy: Callable[[Any], Any], port: int = 0, teach: Callable[[Any], Any] = lambda it: None
    ) -> None:
        self._policy, self._teach = policy, teach
        self.calls: list[str] = []
        self.taught: list[Any] = []
        self.seen: list[Any] = []
        self.parts: list[int] = []
        methods = {
            "Ready": grpc.unary_unary_rpc_method_handler(self._ready),
            "SendPolicyInstructions": grpc.unary_unary_rpc_method_handler(self._instructed),
            "SendObservations": grpc.stream_unary_rpc_method_handler(self._observed),
            "GetActions": grpc.unary_unary_rpc_method_handler(self._asked),
        }
        self._server = grpc.server(ThreadPoolExecutor(4), options=[("grpc.so_reuseport", 0)])
        handler = grpc.method_handlers_generic_handler("transport.AsyncInference", methods)
        self._server.add_generic_rpc_handlers((handler,))
        self.port = self._server.add_insecure_port(f"127.0.0.1:{port}")
        self.url = f"grpc://127.0.0.1:{self.port}"
        self._server.start()

    def _ready(self, request: bytes, context: Any) -> bytes:
        self.calls.append("Ready")
        return b""

    def _instructed(self, request: bytes, context: Any) -> bytes:
        self.calls.append("SendPolicyInstructions")
        self.taught.append(loaded(_fields(request)[1]))
        self._teach(self.taught[-1])
        return b""

    def _observed(self, requests: Any, context: Any) -> bytes:
        self.calls.append("SendObservations")
        messages = [_fields(message) for message in requests]
        self.parts = [message[1] for message in messages]
        self.seen.append(loaded(b"".join(message[2] for message in messages)))
        return b""

    def _asked(self, request: bytes, context: Any) -> bytes:
        self.calls.append("GetActions")
        answer = self._policy(self.seen[-1])
        if answer is None or isinstance(answer, bytes):
            return answer or b""
        return as_answer(pickled(np.asarray(answer), self.seen[-1].timestep))

    def close(self) -> None:
        """End it: every connection is torn."""
        self._server.stop(0).wait(10.0)
