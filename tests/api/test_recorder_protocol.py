"""Tests of where a recorder listens, and of what may be said to it."""

from __future__ import annotations

import pytest

from gateway.api.recorder_protocol import (
    MAX_PACKET_BYTES,
    RecorderQuestion,
    packed,
    read_answer,
    read_question,
    recorder_socket,
)
from gateway.errors import Rejected


def test_a_recorder_listens_beside_the_gateways_socket(tmp_path, monkeypatch):
    """Found by itself, or named as a gateway is."""
    assert recorder_socket(f"unix:{tmp_path}/a.sock") == tmp_path / "a.sock.recorder"
    monkeypatch.setenv("TA2_SOCKET", str(tmp_path / "b.sock"))
    assert recorder_socket(None) == tmp_path / "b.sock.recorder"


@pytest.mark.parametrize("address", ["tcp/10.0.0.2:7448", "/nowhere/at/all/gateway.sock"])
def test_beside_this_users_own_where_the_gateways_is_out_of_reach(tmp_path, monkeypatch, address):
    """On another host, or in a folder in which this user may make nothing."""
    monkeypatch.setenv("TA2_SOCKET", str(tmp_path / "own.sock"))
    assert recorder_socket(address) == tmp_path / "own.sock.recorder"


def test_what_is_no_address_is_refused(tmp_path, monkeypatch):
    """Nobody is told of episodes at a place that was not meant; the same of what the environment names."""
    with pytest.raises(Rejected, match="'gateway' is no address") as caught:
        recorder_socket("gateway")
    assert caught.value.field == "target"
    monkeypatch.setenv("TA2_SOCKET", "tcp/10.0.0.2:7448")
    with pytest.raises(Rejected, match="no path of a unix socket"):
        recorder_socket(None)


def test_the_longest_question_fits_into_a_packet_and_a_longer_one_is_none():
    """A thousand characters each, whatever they are."""
    for letter in ("\x01", "界"):
        question = RecorderQuestion(ask="start", task=letter * 1000, text=letter * 1000)
        assert len(packed(question)) < MAX_PACKET_BYTES and read_question(packed(question)) == question
    with pytest.raises(ValueError, match="length <= 1000"):
        read_question(packed(RecorderQuestion(ask="mark", text="x" * 1001)))
    with pytest.raises(ValueError, match="state"):
        read_answer(b"{}")
