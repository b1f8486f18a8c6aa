"""Tests of `ta2 record` without a robot: what it refuses, and `recover`. With one: tests/e2e/test_recording.py."""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
import time

import pytest

from gateway.cli.recording import record
from gateway.errors import Code, Disconnected, Refusal
from gateway.recording import recorder as recorder_module
from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import ACTIVE, METADATA, BagWriter, bag_file
from gateway.recording.episode_desk import EpisodeDesk
from gateway.recording.episodes import episodes
from gateway.recording.recorder import Recorder
from gateway.recording.recovering import recover
from gateway.recording.topics import EPISODES
from tests.recording.bags import ARM, BEGIN_NS, TOPICS, joints, payload


def test_a_bag_that_was_cut_off_is_recovered(shell, tmp_path):
    """Named by its folder; the same as JSON."""
    for n, options in enumerate([(), ("--json",)]):
        folder = tmp_path / f"bag{n}"
        bag = BagWriter(folder, TOPICS)
        bag.add(ARM, BEGIN_NS, BEGIN_NS, joints(1))
        bag.flush()
        bag.abandon()
        ended = shell.run("record", "recover", str(folder), *options)
        assert ended.status == 0 and bag_file(folder).exists()
        if options:
            assert ended.json["messages"] == 1 and ended.json["file"] == str(bag_file(folder))
        else:
            assert "1 messages, 0.0 s; torn there: " in ended.out


def test_without_a_gateway_it_says_that_none_is_needed(shell, monkeypatch):
    """Where the robot is can be said here."""

    def nobody(*_, **__):
        raise Disconnected(Refusal(code=Code.DISCONNECTED, message="there is no socket"))

    monkeypatch.setattr("gateway.client.connect", nobody)
    ended = shell.run("record")
    assert ended.status == 3 and "or name the robot with --robot" in ended.err


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("recover",), "which folder?"),
        (("recover", "nowhere"), "nothing to recover"),
        (("--robot", "127.0.0.1:9", "--out", "full"), "is not empty"),
    ],
)
def test_what_makes_no_sense_is_refused(shell, tmp_path, monkeypatch, words, why):
    """In one line, before anything is connected to."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes").touch()
    ended = shell.run("record", *words)
    assert ended.status == 1 and why in ended.err and ended.err.startswith("BAD_REQUEST: ")


class Robot:
    """In place of a robot's router: each state comes once, then nothing; after that something may happen."""

    then = staticmethod(lambda: None)

    def __init__(self, settings, topics, take):
        self._topics, self._take = topics, take

    def open(self):
        for number, topic in enumerate(self._topics):
            if topic.rate_hz:
                self._take(number, time.monotonic_ns(), payload(topic, BEGIN_NS))
        time.sleep(0.3)
        self.then()

    def close(self):
        pass


class Quiet:
    """In place of a gateway: nobody."""

    def __init__(self, target, tell):
        pass

    def start(self):
        pass

    close = start


class Screen(io.StringIO):
    """Standard error that is gone from some moment on."""

    def __init__(self, error, *, is_terminal=False):
        super().__init__()
        self._error, self._is_terminal = error, is_terminal
        self.is_gone, self.refused = False, 0

    def isatty(self):
        return self._is_terminal

    def write(self, text):
        if self.is_gone:
            self.refused += 1
            raise OSError(self._error, os.strerror(self._error))
        return super().write(text)


@pytest.fixture
def begin(shell, tmp_path, monkeypatch):
    """Return a function that records what `Robot` says, into `bag`."""
    monkeypatch.setattr(record, "Tap", Robot)
    monkeypatch.setattr(record, "GatewayTap", Quiet)
    monkeypatch.setattr(record, "share_reactor", lambda: None)
    words = ("record", "--robot", "127.0.0.1:9", "--socket", str(tmp_path / "gateway"), "--out", str(tmp_path / "bag"))
    return lambda *more: shell.run(*words, *more)


def test_a_recording_goes_on_when_nobody_can_be_told_any_more(begin, tmp_path, monkeypatch):
    """Whoever read what it says has gone."""
    screen = Screen(errno.EPIPE)
    monkeypatch.setattr(sys, "stderr", screen)

    def leave():
        screen.is_gone = True

    monkeypatch.setattr(Robot, "then", staticmethod(leave))
    assert begin("--seconds", "1").status == 0
    assert screen.refused == 1
    with Bag(tmp_path / "bag") as bag:
        assert bag.message_count == sum(topic.rate_hz > 0 for topic in TOPICS)


def test_a_recording_ends_well_when_its_terminal_is_gone(begin, tmp_path, monkeypatch):
    """With SIGHUP; the display cannot even be taken away."""
    screen = Screen(errno.EIO, is_terminal=True)
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")

    def hang_up():
        screen.is_gone = True
        os.kill(os.getpid(), signal.SIGHUP)

    monkeypatch.setattr(Robot, "then", staticmethod(hang_up))
    assert begin().status == 128 + signal.SIGHUP
    assert screen.refused and (tmp_path / "bag" / METADATA).exists() and bag_file(tmp_path / "bag").exists()


def test_what_breaks_off_for_an_unknown_reason_is_kept(begin, tmp_path, monkeypatch):
    """And recovered. Where nothing came there is nothing to keep."""
    asked_s = []

    def fail(typed, desk, tell):
        asked_s.append(time.monotonic())
        if asked_s[-1] - asked_s[0] > 1.0:
            raise ValueError("who knows")

    monkeypatch.setattr(record, "_obey", fail)
    with pytest.raises(ValueError, match="who knows"):
        begin()
    assert (tmp_path / "bag" / f"bag_0.mcap{ACTIVE}").exists() and recover(tmp_path / "bag").messages > 0
    monkeypatch.setattr(Robot, "open", lambda robot: None)
    with pytest.raises(ValueError, match="who knows"):
        begin("--out", str(tmp_path / "other"))
    assert not (tmp_path / "other").exists()


def test_nothing_is_left_where_nothing_came(begin, tmp_path, monkeypatch):
    """The folder neither."""
    monkeypatch.setattr(Robot, "open", lambda robot: None)
    monkeypatch.setattr(record, "FIRST_S", 0.1)
    ended = begin()
    assert ended.status == 4 and "nothing came from the robot" in ended.err and not (tmp_path / "bag").exists()


@pytest.mark.parametrize("most", [3, 0])
def test_a_full_queue_keeps_no_recording_from_its_end(tmp_path, monkeypatch, most):
    """What waits makes room for the last word; where there is none at all, the episode ends with the bag."""
    recorder = Recorder(tmp_path / "bag", TOPICS, {}, free_bytes=lambda path: 10**12)
    desk = EpisodeDesk(tmp_path / "bag", "", lambda said: recorder.tell(EPISODES, said))
    desk.carry_out("start")
    for n in range(2):
        recorder.take(ARM, time.monotonic_ns() + n, joints(BEGIN_NS))
    monkeypatch.setattr(recorder_module, "MOST_WAITING", most)
    assert record._end(recorder, desk) == bag_file(tmp_path / "bag")
    with Bag(tmp_path / "bag") as bag:
        assert [one.is_finished for one in episodes(bag)] == [most > 0]
