"""Tests of the journal: what became of chunks reaches whoever records, and nobody waits for one who does not."""

from __future__ import annotations

import socket
import threading

import pytest

from gateway.api.recorder_protocol import RecordingState, recorder_socket
from gateway.policy.journal import MOST_WAITING, Journal
from gateway.recording.door import Door


@pytest.fixture
def address(tmp_path):
    """Of a gateway that is not there."""
    return str(tmp_path / "gateway.sock")


def opened(address, note):
    """A recorder's door."""
    return Door(recorder_socket(address), lambda *_: pytest.fail("no episode"), lambda: RecordingState(bag="/b"), note)


def test_facts_reach_a_recorder_in_their_order(address):
    """With the mode; what is noted before the end is told before the end. A long chunk's joints fit."""
    noted = []
    door = opened(address, lambda facts: noted.append(facts) is None)
    try:
        journal = Journal(address, "shadow")
        rows = [[-0.1234] * 7] * 100
        journal.note({"event": "chunk", "number": 1, "arms": {"left": rows, "right": rows}})
        journal.note({"event": "end", "number": 1, "why": "SUPERSEDED"})
        journal.close()
    finally:
        door.close()
    assert [(facts["mode"], facts["event"], facts["number"]) for facts in noted] == [
        ("shadow", "chunk", 1),
        ("shadow", "end", 1),
    ]
    assert noted[0]["arms"]["right"] == rows


def test_where_nobody_records_or_it_does_not_fit_nothing_happens(address):
    """No error, and no thread is left."""
    journal = Journal(address, "play")
    journal.note({"event": "end"})
    journal.close()
    assert not journal._thread.is_alive()
    door = opened(address, lambda facts: False)
    try:
        journal = Journal(address, "play")
        journal.note({"event": "end"})
        journal.close()
    finally:
        door.close()
    assert not journal._thread.is_alive()


def test_a_recorder_that_hangs_keeps_nobody_waiting(address):
    """What it does not take is left out; noting never waits."""
    path = recorder_socket(address)
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as silent:
        silent.bind(str(path))
        silent.listen()
        journal = Journal(address, "play")
        noting = threading.Thread(target=lambda: [journal.note({"n": n}) for n in range(2 * MOST_WAITING)])
        noting.start()
        noting.join(1.9)  # sooner than a single answer is given up on
        assert not noting.is_alive()
