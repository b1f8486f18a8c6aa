"""Tests of episodes while they are recorded: what may be said when, and what is written of it."""

from __future__ import annotations

import pytest

from gateway.errors import Rejected
from gateway.recording.episode_desk import EpisodeDesk


@pytest.fixture
def said():
    """What was written."""
    return []


@pytest.fixture
def desk(said, tmp_path):
    """A desk of a recording with a task."""
    return EpisodeDesk(tmp_path / "bag", "noted", lambda facts: said.append(facts) is None)


def words(said):
    """Return the event and the episode of each."""
    return [(facts["event"], facts["episode"]) for facts in said]


def test_an_episode_begins_and_ends(desk, said):
    """Counted from 1; the task of the recording, or one of its own."""
    assert (desk.state.episode, desk.state.is_running) == (0, False)
    desk.carry_out("start")
    desk.carry_out("mark", text="touched")
    assert desk.carry_out("stop").is_running is False
    state = desk.carry_out("start", "wave")
    assert (state.episode, state.is_running, state.task) == (2, True, "wave")
    assert words(said) == [("start", 1), ("mark", 1), ("stop", 1), ("start", 2)]
    assert [facts["task"] for facts in said] == ["noted", "", "", "wave"] and said[1]["text"] == "touched"


@pytest.mark.parametrize("verdict", ["success", "failure", "discard"])
def test_a_verdict_ends_an_episode_that_goes_on(desk, said, verdict):
    """One that has ended may be judged, too, and judged anew."""
    desk.carry_out("start")
    desk.carry_out(verdict, text="why")
    desk.carry_out("success")
    assert words(said) == [("start", 1), ("stop", 1), (verdict, 1), ("success", 1)]
    assert said[2]["text"] == "why"


@pytest.mark.parametrize(
    ("before", "ask", "why"),
    [
        (("start",), "start", "episode 1 goes on"),
        ((), "stop", "no episode goes on"),
        (("start", "stop"), "mark", "no episode goes on"),
        ((), "success", "there was no episode yet"),
    ],
)
def test_what_makes_no_sense_now_is_refused(desk, said, before, ask, why):
    """And nothing is written."""
    for word in before:
        desk.carry_out(word)
    with pytest.raises(Rejected, match=why):
        desk.carry_out(ask)
    assert len(said) == len(before) and desk.carry_out("status") == desk.state


def test_the_end_of_a_recording_ends_its_episode(desk, said):
    """One that goes on; else nothing is said."""
    desk.end()
    desk.carry_out("start")
    desk.end()
    desk.end()
    assert words(said) == [("start", 1), ("stop", 1)]


def test_what_does_not_fit_is_refused(tmp_path):
    """Nobody believes that an episode goes on which is not in the bag."""
    desk = EpisodeDesk(tmp_path / "bag", "", lambda facts: False)
    with pytest.raises(Rejected, match="queue is full"):
        desk.carry_out("start")
    assert desk.state.episode == 0
