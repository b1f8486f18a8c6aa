"""Tests of the protocol of policies' servers, against a server on loopback that speaks as openpi's own do."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import msgpack
import numpy as np
import pytest
from websockets.server import ServerProtocol

from gateway.errors import Aborted, Code, Disconnected, GatewayTimeout, Rejected
from gateway.policy.openpi import PolicyServer, decoded, encoded
from tests.policy.server import Scripted, packed, unpacked

ACTIONS = np.arange(32, dtype="<f4").reshape(2, 16)


def answering(observation: Any) -> Any:
    """A policy that works."""
    return {"actions": ACTIONS, "policy_timing": {"infer_ms": np.float64(3.5)}}


@pytest.fixture
def served() -> Iterator[Callable[..., tuple[PolicyServer, Scripted]]]:
    """Makes a server and who asks it."""
    opened: list[Any] = []

    def serve(policy: Any = answering, metadata: Any = None, **options: Any) -> tuple[PolicyServer, Scripted]:
        server = Scripted(policy, metadata)
        asker = PolicyServer(server.url, **{"connect_s": 5.0, "answer_s": 5.0, **options})
        opened.extend([asker, server])
        return asker, server

    yield serve
    for end in opened:
        end.close()


def test_metadata_come_first_then_observations_are_answered(served) -> None:
    """Arrays arrive as they were sent, in both directions, and what was read may be written to."""
    asker, server = served(metadata={"fps": 45, "available_tasks": ["fold"]})
    asker.connect()
    assert asker.metadata == {"fps": 45, "available_tasks": ["fold"]}
    picture = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    answer = asker.ask({"observation/state": np.float32([1, 2]), "image": picture[:, ::2], "prompt": "折"})
    np.testing.assert_array_equal(answer["actions"], ACTIONS)
    assert answer["actions"].dtype == np.float32 and answer["policy_timing"] == {"infer_ms": 3.5}
    answer["actions"][0, 0] = 7.0
    seen = server.seen[0]
    np.testing.assert_array_equal(seen["image"], picture[:, ::2])
    assert seen["prompt"] == "折" and seen["observation/state"].dtype == np.float32


def test_the_key_goes_as_openpi_expects_it(served) -> None:
    """`Authorization: Api-Key ...`, and nothing where there is none."""
    asker, server = served(api_key="secret")
    asker.connect()
    assert server.headers[0]["Authorization"] == "Api-Key secret"
    plain, other = served()
    plain.connect()
    assert "Authorization" not in other.headers[0]


@pytest.mark.parametrize("where", ["metadata", "answer"])
def test_a_text_frame_is_the_servers_traceback(served, where) -> None:
    """Its last line is told; the connection is over."""
    trace = "Traceback (most recent call last):\n  File ...\nKeyError: 'observation/state'\n"
    asker, _ = served(lambda _: trace, trace if where == "metadata" else None)
    with pytest.raises(Aborted, match="failed: KeyError: 'observation/state'") as caught:
        asker.connect()
        asker.ask({})
    assert caught.value.code is Code.POLICY_FAILED and not asker.is_connected and "log" in caught.value.hint


def test_a_server_that_has_hung_up_by_then_is_heard_all_the_same(served, monkeypatch) -> None:
    """Its last words are told, not that its socket is closed."""
    asker, _ = served(lambda _: None, "Traceback (most recent call last):\nKeyError: 'state'\n")
    connect = asker._connect

    def late(*words, **options):
        made = connect(*words, **options)
        made.recv_events_thread.join(10.0)  # until the server has hung up
        return made

    monkeypatch.setattr(asker, "_connect", late)
    with pytest.raises(Aborted, match="KeyError: 'state'"):
        asker.connect()


def test_a_server_that_hangs_up_is_gone_and_may_come_back(served) -> None:
    """Also in the middle of a question; another `connect` begins anew."""
    answers = [None, {"actions": ACTIONS}]
    asker, _ = served(lambda _: answers.pop(0))
    asker.connect()
    with pytest.raises(Disconnected) as caught:
        asker.ask({})
    assert caught.value.field == "server" and not asker.is_connected
    with pytest.raises(Disconnected, match="no connection"):
        asker.ask({})
    asker.connect()
    assert len(asker.ask({})["actions"]) == 2


def test_a_server_that_is_started_anew_is_connected_to_again(served) -> None:
    """On the same port, after its process was killed."""
    asker, server = served()
    asker.connect()
    server.close()
    with pytest.raises(Disconnected):
        asker.ask({})
    with pytest.raises(Disconnected, match="is not there"):
        asker.connect()
    again = Scripted(answering, port=server.port)
    try:
        asker.connect()
        assert "actions" in asker.ask({})
    finally:
        asker.close()
        again.close()


def test_a_silent_server_is_not_waited_for_for_ever(served) -> None:
    """The first answer may take longer: models are compiled then. After a timeout the connection is over."""
    release = threading.Event()
    answers = iter([False, True])

    def slow(observation: Any) -> Any:
        if next(answers):
            release.wait(30.0)
        return {"actions": ACTIONS}

    asker, _ = served(slow, answer_s=0.05, first_answer_s=20.0)
    asker.connect()
    asker.ask({})
    try:
        with pytest.raises(GatewayTimeout, match=r"no answer came .* in 0.05 s") as caught:
            asker.ask({})
    finally:
        release.set()
    assert caught.value.field == "server" and not asker.is_connected


def test_a_server_that_stands_still_is_not_sent_to_for_ever() -> None:
    """It reads nothing: a large observation does not fit into what the kernel holds for it."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        held: list[socket.socket] = []

        def accept() -> None:
            near, _ = listener.accept()
            held.append(near)
            protocol = ServerProtocol()
            while not protocol.events_received():
                protocol.receive_data(near.recv(4096))
                for request in protocol.events_received():
                    protocol.send_response(protocol.accept(request))
                    protocol.send_binary(packed({}))
                    near.sendall(b"".join(protocol.data_to_send()))
                    return

        thread = threading.Thread(target=accept)
        thread.start()
        asker = PolicyServer(f"ws://127.0.0.1:{listener.getsockname()[1]}", answer_s=0.1)
        asker.connect()
        thread.join(10.0)
        with pytest.raises(Disconnected):
            asker.ask({"picture": np.zeros((4000, 4000), np.uint8)})
        asker.close()
        held[0].close()


def test_whoever_listens_and_says_nothing_is_no_server() -> None:
    """Neither a handshake nor metadata are waited for for ever."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        asker = PolicyServer(f"ws://127.0.0.1:{listener.getsockname()[1]}", connect_s=0.1)
        with pytest.raises(Disconnected):
            asker.connect()


def test_hanging_up_from_another_thread_ends_a_wait(served) -> None:
    """Whoever ends the run does not wait for the policy."""
    asked, release = threading.Event(), threading.Event()

    def slow(observation: Any) -> Any:
        asked.set()
        release.wait(30.0)
        return {}

    asker, _ = served(slow)
    asker.connect()
    ended: list[BaseException] = []

    def ask() -> None:
        try:
            asker.ask({})
        except Disconnected as error:
            ended.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    assert asked.wait(10.0)
    asker.close()
    thread.join(10.0)
    release.set()
    assert len(ended) == 1


def test_what_is_no_address_is_refused() -> None:
    """With the field that makes it an error of the command line."""
    for url in ("http://127.0.0.1:8000", "127.0.0.1", "ws://127.0.0.1:x"):
        with pytest.raises(Rejected, match="no address of a policy server") as caught:
            PolicyServer(url).connect()
        assert caught.value.field == "target"


@pytest.mark.parametrize(
    ("frame", "code", "words"),
    [
        (b"\xc1", Code.BAD_REQUEST, "no MessagePack"),
        (b"", Code.BAD_REQUEST, "no MessagePack"),
        (packed([1]), Code.BAD_REQUEST, "a list, a map is needed"),
        (packed({"a": np.array([None])}), Code.BAD_REQUEST, "array of object"),
        (packed({"a": np.array([1j])}), Code.BAD_REQUEST, "array of complex128"),
        (packed({"a": np.array([b"x"])}), Code.BAD_REQUEST, "only numbers are read"),
        (packed({"a": {b"__ndarray__": True, b"data": b"", b"dtype": "no", b"shape": [1]}}), Code.BAD_REQUEST, "'no'"),
        (packed({"a": {b"__ndarray__": True}}), Code.BAD_REQUEST, "None"),
        (
            packed({"a": {b"__ndarray__": True, b"data": b"1234567", b"dtype": "<f4", b"shape": [2]}}),
            Code.WRONG_SHAPE,
            "7 bytes, 8 bytes for shape (2,)",
        ),
        (
            packed({"a": {b"__ndarray__": True, b"data": b"", b"dtype": "<f4", b"shape": [-1, 0]}}),
            Code.WRONG_SHAPE,
            "-1",
        ),
    ],
)
def test_a_frame_that_is_none_is_refused(frame: bytes, code: Code, words: str) -> None:
    """Nothing is unpickled, and no array is taken for what it is not."""
    with pytest.raises(Rejected) as caught:
        decoded(frame)
    assert caught.value.code is code and words in caught.value.message and caught.value.hint


def test_arrays_in_lists_and_of_no_length_are_read() -> None:
    """At whatever depth."""
    found = decoded(packed({"a": [np.zeros((0, 3), np.float32), np.float32(1.5)], b"k": np.array(2)}))
    assert found["a"][0].shape == (0, 3) and found["a"][1] == 1.5 and found["k"].shape == ()


def test_what_is_sent_is_what_openpi_unpacks() -> None:
    """The same frame as its own packing makes, key by key; anything else than arrays and plain values is an error."""
    values = {"state": np.float32([[1, 2]]), "prompt": "x"}
    assert msgpack.unpackb(encoded(values)) == msgpack.unpackb(packed(values))
    np.testing.assert_array_equal(unpacked(encoded(values))["state"], values["state"])
    with pytest.raises(TypeError, match="cannot be sent"):
        encoded({"a": object()})


def test_numbers_of_numpy_are_sent_as_numbers() -> None:
    """Alone, and in lists, as a policy in Python has them; one of which Python has no number is an error."""
    values = {"fps": np.float32(45), "n": np.int64(3), "ok": np.bool_(True), "rows": [[np.float64(0.5)] * 2]}
    assert decoded(encoded(values)) == {"fps": 45.0, "n": 3, "ok": True, "rows": [[0.5, 0.5]]}
    with pytest.raises(TypeError, match="cannot be sent"):
        encoded({"a": np.longdouble(1.0)})
