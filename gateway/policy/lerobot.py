"""A policy's server of LeRobot's asynchronous inference, over gRPC: Ready, what to load, then observation for action chunk.

Rules
    * The server loads the policy that it is told, each time it is connected to; the first observation is sent after that.
    * Observations go as LeRobot's own client sends them, pickled; its answers are read by `pickled`, which runs nothing.
    * Every observation must be answered (`must_go`): without, the server leaves out those that are like the one before.
    * It answers with nothing when it failed (its log says why), and when it was started anew and knows no policy yet.
    * Every wait has an end. No proxy of the environment is used.

Libraries: grpcio (extra `lerobot`); its three messages are a dozen bytes and made here. Knows nothing of the robot.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from gateway.errors import Code, GatewayError, failure
from gateway.policy.openpi import FIRST_ANSWER_S
from gateway.policy.pickled import as_stock, timed_actions

__all__ = ["SCHEME", "LeRobotServer"]

SCHEME = "grpc"
STATE, IMAGES, TASK = "observation.state", "observation.images.", "task"
"""Keys of LeRobot's observations."""
PART_BYTES = 2 * 1024 * 1024
"""Of an observation in one message, as LeRobot has it: gRPC takes no more than 4 MB."""
MOST_BYTES = 64 * 1024 * 1024
"""The longest answer that is read: 450 steps of 72 dims have 58 MB, as each one comes with all of them."""
MOST_STEPS = 450
BEGIN, MIDDLE, END = 1, 2, 3
"""Which part of an observation a message is."""
BAD_MESSAGE = "is it LeRobot's own policy server? see its log"


class LeRobotServer:
    """A connection to LeRobot's policy server, made by `connect`; used by one thread, closed by any.

    Args:
        url: `grpc://HOST:PORT`.
        policy: `TYPE:NAME` of what it loads: LeRobot's name of the policy's type, and a folder there or a name on its hub.
        device: Where the policy runs.
        connect_s: Longest wait for the connection [s].
        answer_s: Longest wait for an answer [s] ...
        first_answer_s: ... and for the first one of a connection, and for the policy's being loaded.

    Raises:
        Rejected: BAD_REQUEST, the address or the policy's name is none, or grpcio is not installed.
    """

    def __init__(
        self,
        url: str,
        policy: str,
        *,
        device: str = "cpu",
        connect_s: float = 5.0,
        answer_s: float = 5.0,
        first_answer_s: float = FIRST_ANSWER_S,
    ) -> None:
        try:
            self._grpc: Any = importlib.import_module("grpc")  # Any: it has no types of its own
        except ImportError as error:
            message = f"LeRobot's policy servers are asked with grpcio, which is not installed ({error})"
            hint = "install it: pip install 'teleavatar-gateway[lerobot]'"
            raise failure(Code.BAD_REQUEST, message, hint=hint) from None
        self.url = url
        self.metadata: Mapping[Any, Any] = {}
        """It says nothing of itself."""
        self._target = _target(url)
        self._kind, _, self._name = policy.partition(":")
        if not (self._kind and self._name):
            message, hint = f"{policy!r} names no policy to load", "TYPE:NAME does, e.g. act:/data/my_act"
            raise failure(Code.BAD_REQUEST, message, field="policy", value=policy, hint=hint)
        self._device = device
        self._connect_s, self._answer_s, self._first_answer_s = connect_s, answer_s, first_answer_s
        self._channel: Any = None
        self._number = 0
        self._is_taught = self._has_answered = False

    @property
    def is_connected(self) -> bool:
        """Whether there is a connection that was not lost yet."""
        return self._channel is not None

    def connect(self) -> None:
        """Connect.

        Raises:
            Rejected: BAD_REQUEST, whoever is there does not speak this protocol.
            Disconnected: Nobody answers there.
            GatewayTimeout: Somebody is there, and says nothing.
        """
        self.close()
        options = [("grpc.max_receive_message_length", MOST_BYTES), ("grpc.enable_http_proxy", 0)]
        # A pool of its own: a new connection is tried at once, without the pause after those that failed.
        options += [("grpc.enable_retries", 0), ("grpc.use_local_subchannel_pool", 1)]
        self._is_taught = self._has_answered = False
        self._channel = self._grpc.insecure_channel(self._target, options=options)
        self._called("Ready", b"", time.monotonic() + self._connect_s)

    def ask(self, observation: Mapping[str, Any]) -> dict[Any, Any]:
        """Return the server's actions for an observation, under `actions`, shape (H, N).

        Raises:
            Disconnected: The connection was lost, or never made.
            GatewayTimeout: TIMEOUT, no answer came; the connection is closed.
            Aborted: POLICY_FAILED, with what the server says.
            Rejected: The observation has keys that LeRobot does not know, or the answer is none of this protocol.
        """
        features, values = _as_lerobot(observation)
        until_s = time.monotonic() + (self._answer_s if self._has_answered else self._first_answer_s)
        if not self._is_taught:
            wanted: dict[str, Any] = {"policy_type": self._kind, "pretrained_name_or_path": self._name}
            wanted |= {
                "device": self._device,
                "lerobot_features": features,
                "actions_per_chunk": MOST_STEPS,
                "rename_map": {},
            }
            self._called("SendPolicyInstructions", _field(1, as_stock("RemotePolicyConfig", wanted)), until_s)
            self._is_taught = True
        self._number += 1
        seen = {"timestamp": time.monotonic(), "timestep": self._number, "observation": values, "must_go": True}
        self._called("SendObservations", _parts(as_stock("TimedObservation", seen)), until_s)
        data = _data(self._called("GetActions", b"", until_s))
        if not data:
            self._fail_for_nothing()
        steps = timed_actions(data)
        if steps and steps[0].timestep != self._number:
            message = f"the policy server answered observation {steps[0].timestep}, it was asked about {self._number}"
            hint = "does another client ask it? it serves one at a time"
            raise failure(Code.BAD_REQUEST, message, field="server", hint=hint)
        for due, step in enumerate(steps, self._number):
            if step.timestep != due:
                message = f"the policy server sent step {step.timestep} in place of {due}: steps follow each other"
                raise failure(Code.BAD_REQUEST, message, field="server", hint=BAD_MESSAGE)
        self._has_answered = True
        return {"actions": [step.action for step in steps]}

    def close(self) -> None:
        """Hang up; nothing when there is no connection."""
        channel, self._channel = self._channel, None
        if channel is not None:
            channel.close()

    def _fail_for_nothing(self) -> None:
        was_good = self._has_answered
        self.close()
        if was_good:  # it may be another process by now, that was told no policy
            raise self._gone("it answered with nothing; it is told its policy anew")
        message = f"the policy server {self.url} answered with nothing: {self._kind} failed there"
        hint = "its log says why; do keys, dims and pictures of --map fit the policy?"
        raise failure(Code.POLICY_FAILED, message, field="server", hint=hint)

    def _called(self, name: str, message: bytes | Iterator[bytes], until_s: float) -> bytes:
        channel, left_s = self._channel, max(0.01, until_s - time.monotonic())
        try:
            if channel is None:
                raise ValueError("there is no connection")
            call = channel.unary_unary if isinstance(message, bytes) else channel.stream_unary
            answer: bytes = call(f"/transport.AsyncInference/{name}")(message, timeout=left_s)
            return answer
        except ValueError as error:  # closed, perhaps by another thread
            raise self._gone(str(error)) from None
        except self._grpc.RpcError as error:
            self.close()
            raise self._error(error.code().name, name, str(error.details() or "")) from None

    def _error(self, status: str, name: str, said: str) -> GatewayError:
        """Return what the status of a call means."""
        last = next((line.strip() for line in reversed(said.splitlines()) if line.strip()), "nothing was said")[:300]
        match status:
            case "UNAVAILABLE" | "CANCELLED":
                return self._gone(last)
            case "DEADLINE_EXCEEDED":
                message, hint = f"the policy server {self.url} did not answer {name} in time", "wait longer: --timeout"
                return failure(Code.TIMEOUT, message, field="server", hint=hint)
            case "UNIMPLEMENTED" | "RESOURCE_EXHAUSTED":
                message = f"the policy server {self.url} does not speak as LeRobot's: {name}: {last}"
                return failure(Code.BAD_REQUEST, message, field="server", hint=BAD_MESSAGE)
        message = f"the policy server {self.url} failed in {name}: {last}"
        return failure(Code.POLICY_FAILED, message, field="server", hint="its log says more")

    def _gone(self, why: str) -> GatewayError:
        message, hint = f"the policy server {self.url} is not there: {why}", "start it, and see its log"
        return failure(Code.DISCONNECTED, message, field="server", hint=hint)


def _target(url: str) -> str:
    try:
        parts = urlsplit(url)
        if parts.scheme == SCHEME and parts.hostname and parts.port and not (parts.path.strip("/") or parts.username):
            return parts.netloc
    except ValueError:  # of the port, or of brackets
        pass
    message, hint = f"{url!r} is no address of a policy server", f"{SCHEME}://HOST:PORT is one of LeRobot's"
    raise failure(Code.BAD_REQUEST, message, field="target", value=url, hint=hint)


def _as_lerobot(observation: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return LeRobot's description of an observation, and what its robots would return for it."""
    features, values = dict[str, Any](), dict[str, Any]()
    for key, value in observation.items():
        if key == TASK:
            values[key] = value
        elif key.startswith(IMAGES):
            features[key] = {"dtype": "image", "shape": tuple(value.shape), "names": ("height", "width", "channels")}
            values[key.removeprefix(IMAGES)] = np.ascontiguousarray(value)
        elif key == STATE:
            names = tuple(f"{STATE}.{n}" for n in range(len(value)))
            features[key] = {"dtype": "float32", "shape": (len(value),), "names": names}
            values.update(zip(names, value.tolist(), strict=True))
        else:
            message = f"LeRobot's policies know no {key!r}: only {STATE!r}, {IMAGES + '...'!r} and {TASK!r}"
            raise failure(Code.BAD_REQUEST, message, field="map", value=key, hint="take --map lerobot, or one like it")
    return features, values


def _varint(value: int) -> bytes:
    told = bytearray()
    while value > 0x7F:
        told.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*told, value])


def _field(number: int, data: bytes) -> bytes:
    """Return a field of bytes of a protobuf message."""
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _parts(data: bytes) -> Iterator[bytes]:
    """Yield the messages of an observation: which part it is, and its bytes."""
    for begin in range(0, len(data), PART_BYTES):
        part = END if begin + PART_BYTES >= len(data) else MIDDLE if begin else BEGIN
        yield b"\x08" + _varint(part) + _field(2, data[begin : begin + PART_BYTES])


def _data(message: bytes) -> bytes:
    """Return the only field of an answer; empty where there is none."""
    for at in range(2, min(len(message), 6) + 1):  # one of these lengths of the head leaves as many bytes as it says
        if message[:at] == b"\x0a" + _varint(len(message) - at):
            return message[at:]
    if not message:
        return b""
    text = f"the policy server sent {len(message)} bytes that are no message of actions"
    raise failure(Code.BAD_REQUEST, text, field="server", hint=BAD_MESSAGE)
