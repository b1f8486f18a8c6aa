"""Pickles of LeRobot's action lists, read as data: no class is looked up, nothing is called, and no torch is needed.

Loading a pickle runs what its author wrote into it. Here its opcodes are followed with values alone: what it would build by a
call or a class is only noted, by the name of who would be called, and other names than those below are refused.
"""

from __future__ import annotations

import io
import pickle
import pickletools
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.errors import Code, GatewayError, failure

__all__ = ["TimedAction", "as_stock", "timed_actions"]

HELPERS = "lerobot.async_inference.helpers"
ACTION, TENSOR, STORAGE = f"{HELPERS}.TimedAction", "torch._utils._rebuild_tensor_v2", "torch.storage._load_from_bytes"
STORAGES: Mapping[str, str] = {
    "torch.FloatStorage": "<f4",
    "torch.DoubleStorage": "<f8",
    "torch.HalfStorage": "<f2",
    "torch.BFloat16Storage": "<u2",
}
"""Kinds of numbers in a tensor, and how they lie in memory; the last one is the upper half of a float32."""
ADMITTED = frozenset({ACTION, TENSOR, STORAGE, "collections.OrderedDict", *STORAGES})
MAGIC, PROTOCOL = 0x1950A86A20F9469CFC6C, 1001
"""What torch writes in front of a storage."""
MOST_STEPS, MOST_STORAGE_STEPS = 100_000, 1_000
"""Opcodes of a list and of a storage's head: 450 actions take 23,000 and 60."""
LITERALS = frozenset(
    "BININT BININT1 BININT2 LONG1 BINFLOAT SHORT_BINUNICODE BINUNICODE SHORT_BINBYTES BINBYTES BINBYTES8".split()
)
VALUES: Mapping[str, Any] = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False, "EMPTY_TUPLE": ()}
OTHERS = frozenset(
    "PROTO FRAME STOP EMPTY_LIST EMPTY_DICT MARK TUPLE TUPLE1 TUPLE2 TUPLE3 APPEND APPENDS SETITEM SETITEMS MEMOIZE BINPUT "
    "LONG_BINPUT BINGET LONG_BINGET GLOBAL STACK_GLOBAL REDUCE NEWOBJ BUILD BINPERSID".split()
)
OPCODES = {one.code.encode("latin-1"): one for one in pickletools.opcodes if one.name in {*LITERALS, *VALUES, *OTHERS}}
"""What a list of actions is made with; of any other not even its argument is read."""


class TimedAction(Struct, frozen=True, kw_only=True):
    """One step of a chunk: its number, and the action, shape (N,)."""

    timestep: int
    action: NDArray[Any]


class _Named(Struct, eq=False):
    """What a pickle names."""

    name: str


class _Made(Struct, eq=False):
    """What a pickle would make: by whom, of what, and the state that it would be given."""

    by: str
    of: Any
    state: Any = None


def as_stock(name: str, state: Mapping[str, Any]) -> bytes:
    """Return a pickle that becomes an object of a dataclass among LeRobot's helpers, where LeRobot is installed.

    Args:
        name: Of the class.
        state: Its fields.
    """
    fields = pickle.dumps(dict(state), protocol=3)[2:-1]  # without its begin and end; protocol 4 would frame it
    return f"\x80\x03c{HELPERS}\n{name}\n)\x81".encode("latin-1") + fields + b"b."


def timed_actions(data: bytes) -> list[TimedAction]:
    """Return the steps of a server's answer.

    Raises:
        Rejected: BAD_REQUEST, it is no such list, or names anything else; WRONG_SHAPE, a tensor does not fit its data.
    """
    found = _followed(io.BytesIO(data), MOST_STEPS)
    if not isinstance(found, list):
        raise _wrong(f"sent a {type(found).__name__}, a list of TimedAction is needed")
    storages: dict[bytes, NDArray[Any]] = {}
    return [_action(one, storages) for one in found]


def _action(one: Any, storages: dict[bytes, NDArray[Any]]) -> TimedAction:  # noqa: ANN401  whatever was in the list
    match one:
        case _Made(by=by, state={"timestep": int(timestep), "action": _Made() as tensor}) if by == ACTION:
            return TimedAction(timestep=timestep, action=_vector(tensor, storages))
    raise _wrong("sent a list of something else than TimedAction with a tensor")


def _vector(tensor: _Made, storages: dict[bytes, NDArray[Any]]) -> NDArray[Any]:
    """Return a tensor of one dimension; those of a list share a storage, which comes with each of them."""
    match tensor:
        case _Made(by=by, of=(_Made(by=loader, of=(bytes(blob),)), int(first), (int(size),), (int(stride),), *_)) if (
            by,
            loader,
        ) == (TENSOR, STORAGE):
            values = storages[blob] if blob in storages else storages.setdefault(blob, _storage(blob))
            last = first + stride * (size - 1)
            if first < 0 or stride < 1 or size < 1 or last >= len(values):
                message = f"sent a tensor of {size} values, stride {stride}, from {first} on, of {len(values)}"
                raise _wrong(message, Code.WRONG_SHAPE)
            return values[first : last + 1 : stride]
    raise _wrong("sent an action that is no tensor of one dimension", Code.WRONG_SHAPE)


def _storage(blob: bytes) -> NDArray[Any]:
    """Return the numbers of a storage as torch saves it beside tensors: five pickles, their count, and they."""
    stream = io.BytesIO(blob)
    magic, protocol, machine, named, _ = (_followed(stream, MOST_STORAGE_STEPS) for _ in range(5))
    match named:
        case _Made(by="", of=("storage", _Named(name=kind), str(), str(), int(count), None)) if kind in STORAGES and (
            magic,
            protocol,
        ) == (MAGIC, PROTOCOL):
            dtype = np.dtype(STORAGES[kind])
            told, data = stream.read(8), stream.read()
            is_little = isinstance(machine, dict) and machine.get("little_endian") is True
            # Compared as a number: a count beyond 8 bytes is none of them, and no error of its own.
            is_whole = len(told) == 8 and int.from_bytes(told, "little", signed=True) == count
            if is_little and is_whole and len(data) == count * dtype.itemsize:
                values = np.frombuffer(data, dtype)
                return (values.astype("<u4") << 16).view("<f4") if dtype.kind == "u" else values
    raise _wrong("sent a tensor whose storage is not as torch saves one")


def _followed(stream: BinaryIO, most_steps: int) -> Any:  # noqa: ANN401  whatever a pickle holds
    """Return what a pickle holds; reads to its end, and no further."""
    try:
        return _follow(stream, most_steps)
    except (ValueError, IndexError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise _wrong(f"sent what is no pickle: {str(error)[:100]}") from None


def _follow(stream: BinaryIO, most_steps: int) -> Any:  # noqa: ANN401  one branch for each opcode
    stack: list[Any] = []
    marks: list[int] = []
    memo: dict[Any, Any] = {}

    def marked() -> list[Any]:
        begin = marks.pop()
        taken = stack[begin:]
        del stack[begin:]
        return taken

    for _ in range(most_steps):
        code = stream.read(1)
        if (opcode := OPCODES.get(code)) is None:
            raise ValueError(f"opcode {code!r}")
        # A name in two lines is read here: pickletools would look for escapes in it.
        argument: Any = opcode.arg.reader(stream) if opcode.arg is not None and opcode.name != "GLOBAL" else None
        match opcode.name:
            case "PROTO" | "FRAME":
                pass
            case "STOP":
                return stack.pop()
            case name if name in LITERALS:
                stack.append(argument)
            case name if name in VALUES:
                stack.append(VALUES[name])
            case "EMPTY_LIST" | "EMPTY_DICT" as name:
                stack.append([] if name == "EMPTY_LIST" else {})
            case "MARK":
                marks.append(len(stack))
            case "TUPLE":
                stack.append(tuple(marked()))
            case "TUPLE1" | "TUPLE2" | "TUPLE3" as name:
                count = int(name[-1])
                stack[-count:] = [tuple(stack[-count:])]
            case "APPEND" | "APPENDS" as name:
                several = marked() if name == "APPENDS" else [stack.pop()]
                stack[-1].extend(several)
            case "SETITEM" | "SETITEMS" as name:
                several = marked() if name == "SETITEMS" else [stack.pop(-2), stack.pop()]
                keys = several[::2]
                if not all(
                    isinstance(key, (str, int)) for key in keys
                ):  # a deep one would overflow the stack by its hash
                    raise ValueError("a key that is neither text nor a number")
                stack[-1].update(zip(keys, several[1::2], strict=True))
            case "MEMOIZE":
                memo[len(memo)] = stack[-1]
            case "BINPUT" | "LONG_BINPUT":
                memo[argument] = stack[-1]
            case "BINGET" | "LONG_BINGET":
                stack.append(memo[argument])
            case "GLOBAL":
                stack.append(_named(".".join(stream.readline().decode().strip() for _ in range(2))))
            case "STACK_GLOBAL":
                module, name = stack[-2:]
                stack[-2:] = [_named(f"{module}.{name}")]
            case "REDUCE" | "NEWOBJ":
                by, of = stack[-2:]
                stack[-2:] = [_Made(by.name, of)]
            case "BUILD":
                state = stack.pop()
                stack[-1].state = state
            case "BINPERSID":
                stack[-1] = _Made("", stack[-1])
    raise ValueError(f"it has no end in {most_steps} opcodes")


def _named(name: str) -> _Named:
    if name not in ADMITTED:
        raise _wrong(f"sent a pickle that names {name[:100]!r}, which is refused: nothing of it was run")
    return _Named(name)


def _wrong(what: str, code: Code = Code.BAD_REQUEST) -> GatewayError:
    hint = "is it LeRobot's own policy server? nothing of its answer was used"
    return failure(code, f"the policy server {what}", field="server", hint=hint)
