"""Tests of `robot.recording` in both clients: each call tells the recorder what it says, and returns how the recording is."""

from __future__ import annotations

import asyncio
import inspect

import pytest

from gateway.api.recorder_protocol import RecordingState
from gateway.client import aio_recording, recording
from tests.client.test_twins import public, signature

CALLS = [
    ("state", (), ("status", "", "")),
    ("start", ("wave",), ("start", "wave", "")),
    ("stop", (), ("stop", "", "")),
    ("mark", ("here",), ("mark", "", "here")),
    ("success", ("well",), ("success", "", "well")),
    ("failure", ("fell",), ("failure", "", "fell")),
    ("discard", ("blurred",), ("discard", "", "blurred")),
]


@pytest.fixture
def asked(monkeypatch):
    """What the recorder is asked."""
    heard = []

    def ask(address, ask, task="", text=""):
        heard.append((address, ask, task, text))
        return RecordingState(bag="/bags/one", episode=len(heard))

    for module in (recording, aio_recording):
        monkeypatch.setattr(module, "ask_recorder", ask)
    return heard


@pytest.mark.parametrize(("name", "arguments", "said"), CALLS)
def test_each_call_is_one_question(asked, name, arguments, said):
    """In both clients, of the recorder beside the gateway's socket."""
    assert getattr(recording.Recording("memory"), name)(*arguments).episode == 1
    assert asyncio.run(getattr(aio_recording.Recording("memory"), name)(*arguments)).episode == 2
    assert asked == [("memory", *said)] * 2


def test_the_clients_are_twins():
    """Names, arguments and results."""
    assert public(recording.Recording) == public(aio_recording.Recording)
    for name in public(recording.Recording):
        theirs, own = getattr(recording.Recording, name), getattr(aio_recording.Recording, name)
        assert inspect.iscoroutinefunction(own) and signature(own) == signature(theirs)
