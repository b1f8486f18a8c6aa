"""Tests of asking a recorder: what is said when nobody records, or does not answer. With one: tests/recording/test_door.py."""

from __future__ import annotations

import socket

import pytest

from gateway.api.recorder_protocol import recorder_socket
from gateway.client.connection.recorder import ask_recorder
from gateway.errors import Code, NotReady, OutcomeUnknown, Rejected


@pytest.fixture
def address(tmp_path):
    """Of a gateway that is not there."""
    return str(tmp_path / "gateway.sock")


def test_where_nobody_records_it_says_so(address):
    """No socket, or one whose recorder was killed."""
    with pytest.raises(NotReady, match=r"no recorder listens at .*gateway\.sock\.recorder -> start one"):
        ask_recorder(address, "status")
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as dead:
        dead.bind(str(recorder_socket(address)))
    with pytest.raises(NotReady) as caught:
        ask_recorder(address, "start")
    assert caught.value.code is Code.NO_RECORDER and caught.value.retryable


def test_nobody_talks_to_a_socket_of_somebody_else(address, monkeypatch):
    """In a folder that others may write to anybody may listen."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as theirs:
        theirs.bind(str(recorder_socket(address)))
        theirs.listen()
        monkeypatch.setattr("os.geteuid", lambda: 4_000_000)
        with pytest.raises(NotReady, match="no recorder"):
            ask_recorder(address, "start")


def test_a_recorder_that_does_not_answer_leaves_the_outcome_unknown(address):
    """It stands still, its answer makes no sense, or so many wait that there is no place."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as frozen:
        frozen.bind(str(recorder_socket(address)))
        frozen.listen(0)
        for _ in range(3):
            with pytest.raises(OutcomeUnknown, match="look at its terminal"):
                ask_recorder(address, "start", timeout_s=0.05)


def test_what_does_not_fit_into_a_packet_or_is_no_text_is_not_sent(address):
    """Whether somebody records or not."""
    with pytest.raises(Rejected, match="20024 bytes are asked, 16384 bytes fit"):
        ask_recorder(address, "mark", text="x" * 20_000)
    with pytest.raises(Rejected, match=r"that is no text: .* -> write it in UTF-8"):
        ask_recorder(address, "mark", text="\udcff")
