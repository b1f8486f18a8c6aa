"""The process of a local policy, begun by `local_server`: imports `MODULE:FUNCTION`, and answers until whoever asks is gone.

Rules
    * It ends with its parent, however that ends and whatever the policy does: by a thread that reads; on Linux by the kernel.
    * What the policy raises is its answer, with the traceback on stderr, where its prints go, too.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import signal
import socket
import struct
import sys
import traceback
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, BinaryIO

import numpy as np

from gateway.policy.openpi import decoded, encoded
from gateway.process.threads import supervised

__all__ = ["main", "received", "send"]

HEAD = struct.Struct("<I?")
"""Before each frame: its length [bytes], and whether it says how the policy failed, in UTF-8; else it is MessagePack."""
PR_SET_PDEATHSIG = 1


def send(end: socket.socket, frame: bytes, has_failed: bool = False) -> None:
    """Send a frame. Raises OSError as the socket does."""
    end.sendall(HEAD.pack(len(frame), has_failed) + frame)


def received(stream: BinaryIO) -> tuple[bytes, bool]:
    """Return a frame, and whether it says how the policy failed. Raises EOFError, or OSError as the stream does."""
    head = stream.read(HEAD.size)
    size, has_failed = HEAD.unpack(head) if len(head) == HEAD.size else (1, False)
    frame = stream.read(size)
    if len(frame) < size:
        raise EOFError("its process has ended")
    return frame, has_failed


def _read(stream: BinaryIO, frames: SimpleQueue[bytes]) -> None:
    """Read what is asked; at the end of that end this process, whatever it does."""
    with suppress(EOFError, OSError):
        while True:
            frames.put(received(stream)[0])
    os._exit(0)


def _answer(said: Any) -> bytes:  # noqa: ANN401  whatever a policy returns
    answer = said if isinstance(said, dict) else {"actions": said}
    return encoded({key: np.asarray(value) if hasattr(value, "__array__") else value for key, value in answer.items()})


class _NotThere(Exception):
    """No such module, or nothing of that name in it; a traceback would show nothing of the user's."""


def _named(name: str) -> Any:  # noqa: ANN401  whatever a module holds
    """Return what `MODULE:FUNCTION` names; raise _NotThere, or as the import does."""
    module, _, path = name.partition(":")
    try:
        found: Any = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):  # it is one that the user's own imports
            raise
        raise _NotThere(f"there is no module {error.name!r}, neither installed nor in {os.getcwd()}") from None
    for word in path.split("."):
        if not hasattr(found, word):
            raise _NotThere(f"{module} has no {path!r}")
        found = getattr(found, word)
    return found


def main(name: str, parent: int) -> None:
    """Serve a function on the socket that is this process's stdin; its attribute `metadata`, a dict, is told first."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it was too late for that
        return
    end, frames = socket.socket(fileno=os.dup(0)), SimpleQueue[bytes]()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    supervised(lambda: _read(end.makefile("rb"), frames), "ta2-policy-asked").start()
    sys.path.insert(0, os.getcwd())
    function: Any = None
    while True:
        try:
            if function is None:
                function = _named(name)
                answer = encoded(getattr(function, "metadata", {}))
            else:
                answer = _answer(function(decoded(frames.get())))
            send(end, answer)
        except _NotThere as error:
            send(end, str(error).encode(errors="replace"), True)
            return
        except Exception as error:  # noqa: BLE001  whatever a policy raises is its answer
            traceback.print_exc()
            send(end, f"{type(error).__name__}: {error}".encode(errors="replace"), True)
            return


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
