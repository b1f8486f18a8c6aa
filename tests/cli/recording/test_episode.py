"""Tests of `ta2 episode`: what it tells a recorder, and what it shows."""

from __future__ import annotations

import pytest

from gateway.api.recorder_protocol import recorder_socket
from gateway.recording.door import Door
from gateway.recording.episode_desk import EpisodeDesk


@pytest.fixture
def said(shell, tmp_path):
    """What a recorder wrote that listens where `ta2` looks."""
    written = []
    desk = EpisodeDesk(tmp_path / "bag", "noted", lambda facts: written.append(facts) is None)
    door = Door(recorder_socket(None), desk.carry_out, lambda: desk.state)
    yield written
    door.close()


def test_an_episode_is_told_from_elsewhere(shell, said, tmp_path):
    """Its task as words or with --task; a mark with its text; a line says how the recording is then."""
    assert shell.run("episode", "status").out == f"{tmp_path}/bag: no episode yet\n"
    assert shell.run("episode", "start", "wave", "twice").out == f"{tmp_path}/bag: episode 1 goes on: wave twice\n"
    shell.run("episode", "mark", "touched", "it")
    assert "episode 1 has ended" in shell.run("episode", "failure").out
    assert shell.run("episode", "start", "--task", "pick").status == 0
    assert [(facts["event"], facts["task"], facts["text"]) for facts in said] == [
        ("start", "wave twice", ""),
        ("mark", "", "touched it"),
        ("stop", "", ""),
        ("failure", "", ""),
        ("start", "pick", ""),
    ]


def test_scripts_read_json(shell, said, tmp_path):
    """The state, or the refusal."""
    assert shell.run("episode", "start", "--json").json == {
        "ok": True,
        "bag": f"{tmp_path}/bag",
        "episode": 1,
        "is_running": True,
        "task": "noted",
    }
    ended = shell.run("episode", "start", "--json")
    assert ended.status == 1 and ended.json["error"]["message"] == "episode 1 goes on"


def test_without_a_recorder_it_says_so(shell):
    """In one line, with what helps."""
    ended = shell.run("episode", "start")
    assert (
        ended.status == 1 and ended.err.startswith("NO_RECORDER: no recorder listens at ") and "ta2 record" in ended.err
    )
