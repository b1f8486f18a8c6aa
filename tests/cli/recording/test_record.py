"""Tests of `ta2 record` without a robot: what it refuses, and `recover`. With one: tests/e2e/test_recording.py."""

from __future__ import annotations

import pytest

from gateway.errors import Code, Disconnected, Refusal
from gateway.recording.bag_writer import BagWriter, bag_file
from tests.recording.bags import ARM, BEGIN_NS, TOPICS, joints


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
