"""Tests of LeRobot's asynchronous inference as a transport, against a server on loopback that speaks as LeRobot's does."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from gateway.errors import Aborted, Code, Disconnected, GatewayTimeout, Rejected
from gateway.policy import lerobot
from gateway.policy.asking import Answer, Asking
from gateway.policy.chunks import chunk_of
from gateway.policy.lerobot import LeRobotServer
from gateway.policy.observing import Observation
from gateway.policy.policy_map import Actions, load_map
from tests.policy.lerobot_server import Scripted, as_answer, pickled

ROWS = np.arange(32, dtype="<f4").reshape(2, 16) / 100
SEEN = {
    "observation.state": np.float32([1.0, 2.5, -3.0]),
    "observation.images.head_camera": np.arange(24, dtype=np.uint8).reshape(2, 4, 3),
    "task": "折",
}
ARMS = Actions(columns=("left_arm", "left_gripper_effort", "right_arm", "right_gripper_effort"))
Serve = Callable[..., tuple[LeRobotServer, Scripted]]


@pytest.fixture
def served() -> Iterator[Serve]:
    """Makes a server and who asks it."""
    opened: list[Any] = []

    def serve(policy: Any = lambda seen: ROWS, **options: Any) -> tuple[LeRobotServer, Scripted]:
        server = Scripted(policy, **{key: options.pop(key) for key in ("port", "teach") if key in options})
        waits = {"connect_s": 20.0, "answer_s": 20.0, "first_answer_s": 30.0}
        asker = LeRobotServer(server.url, "act:/data/act", **{**waits, **options})
        opened.extend([asker, server])
        return asker, server

    yield serve
    for end in opened:
        end.close()


def test_a_server_is_told_its_policy_once_and_answers_observations(served: Serve) -> None:
    """As LeRobot's client does it: Ready, what to load, then an observation, numbered, for each chunk; state dims by name."""
    asker, server = served(device="cuda")
    asker.connect()
    assert asker.is_connected and server.calls == ["Ready"]
    for _ in range(2):
        np.testing.assert_array_equal(asker.ask(SEEN)["actions"], ROWS)
    assert server.calls == ["Ready", "SendPolicyInstructions", *2 * ["SendObservations", "GetActions"]]
    (taught,) = server.taught
    assert type(taught).__name__ == "RemotePolicyConfig"
    assert (taught.policy_type, taught.pretrained_name_or_path, taught.device) == ("act", "/data/act", "cuda")
    features = taught.lerobot_features
    assert features["observation.images.head_camera"]["shape"] == (2, 4, 3)
    assert taught.actions_per_chunk == 450 and taught.rename_map == {}
    first, second = server.seen
    assert second.timestep == first.timestep + 1 and second.timestamp > first.timestamp and first.must_go
    names = features["observation.state"]["names"]
    assert [first.observation[name] for name in names] == [1.0, 2.5, -3.0]
    np.testing.assert_array_equal(first.observation["head_camera"], SEEN["observation.images.head_camera"])
    assert first.observation["task"] == "折" and server.parts == [lerobot.END]


def test_a_large_observation_goes_in_parts(served: Serve) -> None:
    """Of 2 MB: gRPC takes no more than 4 MB in a message."""
    asker, server = served()
    asker.connect()
    picture = np.arange(5_000_000, dtype=np.uint32).view(np.uint8)[: 3 * 1_600_000].reshape(1600, 1000, 3)
    asker.ask({**SEEN, "observation.images.head_camera": picture})
    assert server.parts == [lerobot.BEGIN, lerobot.MIDDLE, lerobot.END]
    np.testing.assert_array_equal(server.seen[0].observation["head_camera"], picture)


def test_keys_that_lerobot_does_not_have_are_refused_before_anything_is_sent(served: Serve) -> None:
    """With the map that has them."""
    asker, server = served()
    asker.connect()
    with pytest.raises(Rejected, match="observation/state") as caught:
        asker.ask({"observation/state": np.float32([1.0])})
    assert "--map lerobot" in caught.value.hint and server.calls == ["Ready"]


def test_what_is_no_address_or_policy_is_refused() -> None:
    """With the field that makes it an error of the command line."""
    for url in (
        "grpc://host",
        "grpc://:1",
        "grpc://host:0",
        "grpc://host:x",
        "grpc://h:1/act",
        "grpc://a@h:1",
        "ws://h:1",
    ):
        with pytest.raises(Rejected, match="no address") as caught:
            LeRobotServer(url, "act:x")
        assert caught.value.field == "target"
    for policy in ("act", ":x", "act:"):
        with pytest.raises(Rejected, match="names no policy"):
            LeRobotServer("grpc://[::1]:80", policy)


def test_without_grpcio_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the other packages that are missing."""
    monkeypatch.setattr(lerobot.importlib, "import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    with pytest.raises(Rejected, match="grpcio") as caught:
        LeRobotServer("grpc://h:1", "act:x")
    assert "teleavatar-gateway[lerobot]" in caught.value.hint


def test_an_empty_answer_is_a_policy_that_failed(served: Serve) -> None:
    """Its log says why; where it answered before, it may be another process now, and is told its policy anew."""
    answers = [ROWS, None, None]
    asker, server = served(lambda seen: answers.pop(0))
    asker.connect()
    asker.ask(SEEN)
    with pytest.raises(Disconnected, match="answered with nothing"):
        asker.ask(SEEN)
    assert not asker.is_connected
    asker.connect()
    with pytest.raises(Aborted) as caught:
        asker.ask(SEEN)
    assert caught.value.code is Code.POLICY_FAILED and "log" in caught.value.hint and len(server.taught) == 2


@pytest.mark.parametrize("numbers", [(1, 1), (1, 3), (1, 0)])
def test_steps_that_do_not_follow_each_other_are_refused(served: Serve, numbers: tuple[int, int]) -> None:
    """Each is played at its place: one left out, or twice there, would shift all that come after it."""
    asker, _ = served(lambda seen: as_answer(pickled(ROWS, timesteps=numbers)))
    asker.connect()
    with pytest.raises(Rejected, match=f"step {numbers[1]} in place of 2"):
        asker.ask(SEEN)


def test_what_a_server_raises_is_told(served: Serve) -> None:
    """As gRPC passes it on: a type of policy that it does not know, say."""

    def teach(policy: Any) -> None:
        raise ValueError("Policy type nope not supported")

    asker, _ = served(teach=teach)
    asker.connect()
    with pytest.raises(Aborted, match=r"SendPolicyInstructions.*nope not supported") as caught:
        asker.ask(SEEN)
    assert caught.value.code is Code.POLICY_FAILED and not asker.is_connected


def test_a_server_that_is_started_anew_is_told_its_policy_again(served: Serve) -> None:
    """On the same port: what was lost is an error, the next connection begins from the front."""
    asker, server = served()
    asker.connect()
    asker.ask(SEEN)
    server.close()
    with pytest.raises(Disconnected) as caught:
        asker.ask(SEEN)
    assert caught.value.field == "server" and not asker.is_connected
    with pytest.raises(Disconnected, match="no connection"):
        asker.ask(SEEN)
    with pytest.raises(Disconnected, match="is not there"):
        asker.connect()
    _, again = served(port=server.port)
    asker.connect()
    np.testing.assert_array_equal(asker.ask(SEEN)["actions"], ROWS)
    assert again.calls[:2] == ["Ready", "SendPolicyInstructions"]


def test_a_silent_server_is_not_waited_for_for_ever(served: Serve) -> None:
    """The first answer may take longer. After a timeout the connection is over."""
    release, answers = threading.Event(), iter([False, True])

    def slow(seen: Any) -> Any:
        if next(answers):
            release.wait(30.0)
        return ROWS

    asker, _ = served(slow, answer_s=0.1)
    asker.connect()
    asker.ask(SEEN)
    try:
        with pytest.raises(GatewayTimeout, match="did not answer") as caught:
            asker.ask(SEEN)
    finally:
        release.set()
    assert caught.value.field == "server" and not asker.is_connected


def test_whoever_listens_and_says_nothing_is_no_server() -> None:
    """It is not waited for for ever."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        asker = LeRobotServer(f"grpc://127.0.0.1:{listener.getsockname()[1]}", "act:x", connect_s=0.3)
        with pytest.raises((GatewayTimeout, Disconnected)):
            asker.connect()
        assert not asker.is_connected


def test_hanging_up_from_another_thread_ends_a_wait(served: Serve) -> None:
    """Whoever ends the run does not wait for the policy."""
    asked, release = threading.Event(), threading.Event()

    def slow(seen: Any) -> Any:
        asked.set()
        release.wait(30.0)
        return ROWS

    asker, _ = served(slow)
    asker.connect()
    ended: list[BaseException] = []

    def ask() -> None:
        try:
            asker.ask(SEEN)
        except Disconnected as error:
            ended.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    assert asked.wait(20.0)
    asker.close()
    thread.join(20.0)
    release.set()
    assert len(ended) == 1


def test_an_answer_to_another_observation_is_refused(served: Serve) -> None:
    """Two clients take each other's answers."""
    asker, _ = served(lambda seen: as_answer(pickled(ROWS, seen.timestep + 1)))
    asker.connect()
    with pytest.raises(Rejected, match="another client"):
        asker.ask(SEEN)


def test_a_giant_answer_is_refused_unread(served: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    """By gRPC, before it is in memory whole."""
    monkeypatch.setattr(lerobot, "MOST_BYTES", 100_000)
    asker, _ = served(lambda seen: as_answer(bytes(200_000)))
    asker.connect()
    with pytest.raises(Rejected, match="larger than max"):
        asker.ask(SEEN)


@pytest.mark.parametrize(
    "message", [b"\x0a\x05ab", b"\x12\x01a", b"\x0a\xff\xff\xff\xff\xff\xff", as_answer(b"x" * 300) + b"y"]
)
def test_a_message_that_is_none_of_actions_is_refused(served: Serve, message: bytes) -> None:
    """Whatever a server sends is an error that names it."""
    asker, _ = served(lambda seen: message)
    asker.connect()
    with pytest.raises(Rejected) as caught:
        asker.ask(SEEN)
    assert caught.value.field == "server"


@pytest.mark.parametrize(
    ("rows", "code"),
    [
        (np.full((2, 16), np.nan, "<f4"), Code.NOT_FINITE),
        (np.zeros((2, 15), "<f4"), Code.WRONG_SHAPE),
        (np.zeros((1, 16), "<f4"), Code.WRONG_SHAPE),
        (np.zeros((0, 16), "<f4"), Code.WRONG_SHAPE),
    ],
)
def test_answers_are_judged_as_any_other_servers(served: Serve, rows: Any, code: Code) -> None:
    """NaN, another width, too few steps or none."""
    asker, _ = served(lambda seen: rows)
    asker.connect()
    with pytest.raises(Rejected) as caught:
        chunk_of(asker.ask(SEEN), ARMS, 0, 33_000_000)
    assert caught.value.code is code


def test_the_runner_asks_it_as_any_other_server(served: Serve) -> None:
    """It connects by itself, and an answer becomes a chunk; arms and gripper efforts come out of 72 dims by the map."""
    layout = load_map("lerobot").actions
    rows = np.tile(np.arange(72, dtype="<f4"), (3, 1))
    asker, _ = served(lambda seen: rows)

    class Observer:
        def observe(self) -> Observation:
            return Observation(values=SEEN, observed_ns=time.monotonic_ns(), measured={}, uncovered=())

    asking = Asking(asker, Observer(), layout, 33_000_000)
    asking.order()
    answer = asking.answer(60.0)
    asking.close()
    assert isinstance(answer, Answer), answer
    chunk = answer.chunk
    assert chunk.arms["left"][0].tolist() == list(range(7)) and chunk.arms["right"][0].tolist() == list(range(8, 15))
    assert layout.width == 72 and chunk.grips["left"].tolist() == [0.0] * 3  # efforts 39 and 47: open
