"""Tests of a recorder's door: whoever is its user may tell it of episodes, and nobody makes it wait."""

from __future__ import annotations

import contextlib
import os
import socket
import stat

import pytest

from gateway.api.guard_protocol import connected
from gateway.api.recorder_protocol import read_answer, recorder_socket
from gateway.client.connection.recorder import ask_recorder
from gateway.errors import Rejected
from gateway.recording.door import Door
from gateway.recording.episode_desk import EpisodeDesk


@contextlib.contextmanager
def opened(path, said):
    """Give an open door."""
    desk = EpisodeDesk(path.parent / "bag", "", lambda facts: said.append(facts["event"]) is None)
    door = Door(path, desk.carry_out, lambda: desk.state)
    try:
        yield desk
    finally:
        door.close()


@pytest.fixture
def address(tmp_path):
    """Of a gateway that is not there."""
    return str(tmp_path / "gateway.sock")


def test_what_is_told_is_carried_out(address):
    """Answered with how the recording is then; its user alone may tell; the socket goes with the door."""
    path, said = recorder_socket(address), []
    with opened(path, said) as desk:
        assert stat.S_IMODE(os.stat(path).st_mode) == 0o600
        assert ask_recorder(address, "start", "wave") == desk.state and desk.state.task == "wave"
        with pytest.raises(Rejected, match=r"episode 1 goes on.*stop or judge it first"):
            ask_recorder(address, "start")
        ask_recorder(address, "success", text="é")
    assert said == ["start", "stop", "success"] and not path.exists()


@pytest.mark.parametrize(
    "packet",
    [b"start", b'{"ask": "estop"}', b'{"ask": "start", "task": 5}', b'{"ask": "mark", "text": "' + b"x" * 20_000],
)
def test_what_nobody_can_read_is_refused_with_an_error(address, packet):
    """And nothing is written."""
    path, said = recorder_socket(address), []
    with opened(path, said), connected(path, 5.0) as caller:
        caller.send(packet)
        answer = read_answer(caller.recv(20_000))
    assert answer.error.startswith("nobody can read that: ") and said == []


def test_who_says_nothing_or_hangs_up_keeps_nobody_out(address):
    """Each has a moment."""
    path, said = recorder_socket(address), []
    with opened(path, said), connected(path, 5.0):
        connected(path, 5.0).close()
        assert ask_recorder(address, "start", timeout_s=10.0).is_running


def test_the_socket_of_a_killed_recorder_is_taken_over_and_that_of_a_living_one_is_not(address):
    """The second recorder says that it cannot be told."""
    path = recorder_socket(address)
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as dead:
        dead.bind(str(path))
    with opened(path, []):
        with pytest.raises(Rejected, match=r"cannot be told of episodes at .*gateway\.sock\.recorder: Address already"):
            Door(path, lambda *_: None, lambda: None)
        assert not ask_recorder(address, "status").is_running
