"""Tests of files and of the viewer's process; no window is opened: programs of ours stand for the viewer."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from tests.cli.scene.rrd import read, rr

from gateway.cli.scene import sink as sinks
from gateway.cli.scene.sink import Sink
from gateway.errors import GatewayError

DEADLINE_S = 30.0


@pytest.fixture
def viewer(tmp_path, monkeypatch):
    """Return what puts a program in the viewer's place, and the file in which it may say something."""
    said = tmp_path / "said.rrd"

    def stand_in(program):
        script = tmp_path / "viewer.py"
        script.write_text(f"import os, signal, sys, time\nsaid = open({str(said)!r}, 'wb', 0)\n{program}")
        starter = tmp_path / "viewer"
        starter.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{script}" "$@"\n')
        starter.chmod(0o755)
        monkeypatch.setenv("RERUN_CLI_PATH", str(starter))
        return said

    return stand_in


def opened():
    """Return a stream and a window for it."""
    stream = rr.RecordingStream("test")
    return stream, Sink(stream, None)


def until(is_so, what):
    """Wait until something is so."""
    deadline = time.monotonic() + DEADLINE_S
    while not is_so():
        assert time.monotonic() < deadline, f"{what}: not in time"
        time.sleep(0.01)


def test_a_viewer_is_handed_what_was_drawn_while_it_comes(viewer, tmp_path, monkeypatch):
    """Piece by piece; the viewer's own program reads all of them."""
    said = viewer("while data := os.read(0, 1 << 16):\n    said.write(data)")
    stream, sink = opened()
    for n in range(3):
        stream.set_time("time", duration=float(n))
        stream.log("a", rr.Scalars([float(n)]))
        before = said.stat().st_size if said.exists() else 0
        assert sink.push()
        until(lambda before=before: said.exists() and said.stat().st_size > before, "a piece")
    sink.close()
    monkeypatch.delenv("RERUN_CLI_PATH")
    merged, quiet = tmp_path / "merged.rrd", {**os.environ, **sinks.ENVIRONMENT}
    words = [sys.executable, "-m", "rerun_cli", "rrd", "merge", str(said), "-o", str(merged)]
    subprocess.run(words, check=True, capture_output=True, timeout=DEADLINE_S, env=quiet)
    assert read(merged)["a"]["scalars"] == [[0.0], [1.0], [2.0]]


def test_a_viewer_listens_on_loopback_alone_and_reports_nothing(viewer):
    """Its own defaults are all networks, and reports of how it is used."""
    said = viewer("said.write(repr((sys.argv[1:], os.environ['CI'])).encode())")
    _, sink = opened()
    sink.wait()
    sink.close()
    words, ci = eval(said.read_text())
    assert words[:5] == ["-", "--bind", "127.0.0.1", "--port", "0"] and ci == "1"


def test_a_window_that_is_closed_ends_it(viewer):
    """Whoever draws is told, and no pipe breaks over him."""
    viewer("")
    stream, sink = opened()

    def is_closed():
        stream.log("a", rr.Scalars([1.0]))
        return not sink.push()

    until(is_closed, "the end")
    assert not sink.push()
    sink.close()


def test_a_viewer_that_cannot_open_a_window_says_what_else_there_is(viewer):
    """With its status."""
    viewer("sys.exit(3)")
    _, sink = opened()
    with pytest.raises(GatewayError, match="ended with status 3") as refused:
        sink.wait()
    assert "--save" in refused.value.hint
    sink.close()


def test_a_viewer_that_hangs_is_ended_all_the_same(viewer, monkeypatch):
    """It reads nothing, and hears no signal that it may pass over."""
    monkeypatch.setattr(sinks, "GRACE_S", 0.2)
    said = viewer("signal.signal(signal.SIGTERM, signal.SIG_IGN)\nsaid.write(b'up')\nwhile True: time.sleep(1.0)")
    _, sink = opened()
    until(lambda: said.exists() and said.read_bytes() == b"up", "a viewer")
    sink.close()
    assert sink._viewer.returncode == -9


def test_what_cannot_be_started_or_written_is_refused(tmp_path, monkeypatch):
    """In a line, with the path."""
    monkeypatch.setenv("RERUN_CLI_PATH", str(tmp_path / "nothing"))
    with pytest.raises(GatewayError, match="nothing"):
        opened()
    with pytest.raises(GatewayError, match="nowhere"):
        Sink(rr.RecordingStream("test"), tmp_path / "nowhere" / "a.rrd")


def test_nobody_closes_a_file(tmp_path):
    """It goes on until it is ended, and is whole then."""
    stream = rr.RecordingStream("test")
    sink = Sink(stream, tmp_path / "a.rrd")
    stream.log("a", rr.Scalars([1.0]))
    assert sink.push()
    sink.wait()
    sink.close()
    assert read(tmp_path / "a.rrd")["a"]["scalars"] == [[1.0]]
