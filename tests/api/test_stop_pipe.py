"""Tests of the pipes into which stops are dropped: what comes through, who may write, what is never waited for."""

from __future__ import annotations

import os
import stat
import subprocess
import time
from pathlib import Path

import pytest

from gateway.api.keys import ESTOP_KEY, STOP_KEY
from gateway.api.service import LocalPlane
from gateway.api.stop_pipe import MAX_BYTES, MOST_LINES, StopPipes, drop_stop, stop_pipe
from gateway.messages.requests import Estop, Stop
from tests.api.daemon import settings_for


@pytest.fixture
def socket(tmp_path: Path) -> Path:
    """Beside which the pipes are; nobody listens there."""
    return tmp_path / "gw.sock"


@pytest.fixture
def pipes(socket: Path):
    """Open ones."""
    pipes = StopPipes(socket, 0o660)
    yield pipes
    pipes.close(is_last=True)


def test_what_is_written_is_the_stop(socket, pipes):
    """Of a shell, of any program, of us: each line is one, e-stops are read first, and what was read is not read again."""
    subprocess.run(["sh", "-c", f"echo smoke > {stop_pipe(socket, STOP_KEY)}"], check=True, timeout=10)
    stop_pipe(socket, ESTOP_KEY).write_bytes(b"\xff\xfe\nno line's end")
    assert drop_stop(socket, STOP_KEY, b"")
    assert pipes.read() == [
        (ESTOP_KEY, b"\xff\xfe"),
        (ESTOP_KEY, b"no line's end"),
        (STOP_KEY, b"smoke"),
        (STOP_KEY, b""),
    ]
    assert pipes.read() == []


@pytest.mark.parametrize("payload", [b"x" * MAX_BYTES, b"two\nlines"])
def test_what_does_not_fit_on_a_line_is_left_away_and_the_stop_is_not(socket, pipes, payload):
    """Lines of two writers must not mix."""
    assert drop_stop(socket, STOP_KEY, payload)
    assert pipes.read() == [(STOP_KEY, b"")]


def test_a_full_pipe_is_full_of_stops(socket, pipes):
    """Whoever drops one more has stopped the robot, and waits for nobody; one look costs the same however much lies there."""
    writer = os.open(stop_pipe(socket, STOP_KEY), os.O_WRONLY | os.O_NONBLOCK)
    with pytest.raises(BlockingIOError):
        while True:
            os.write(writer, b"\n" * MAX_BYTES)
    os.close(writer)
    assert drop_stop(socket, STOP_KEY, b"one more")
    assert len(pipes.read()) == MOST_LINES + 1


def test_a_stop_behind_many_of_the_owners_is_not_taken_for_one_of_them(socket, pipes):
    """An owner's own latches nothing: what is too much to be read by itself is nobody's, and keeps the robot stopped."""
    own = b'{"client_id": "owner", "secret": "s3cret"}'
    for payload in (*[own] * MOST_LINES, b'{"name": "ann"}', own):
        assert drop_stop(socket, STOP_KEY, payload)
    assert [line for _, line in pipes.read()] == [*[own] * MOST_LINES, b""] and not pipes.read()
    for _ in range(MOST_LINES):
        assert drop_stop(socket, STOP_KEY, own)
    assert [line for _, line in pipes.read()] == [own] * MOST_LINES


def test_a_line_is_never_cut_where_the_reading_ends(socket, pipes):
    """Half a map is none, and whose secret is in it would be read as a reason; a map in msgpack may hold any byte but one."""
    line = b'{"reason": "' + b"x" * 1990 + b'", "client_id": "c0ffee", "secret": "s3cret"}'
    for payload in (line, line, line, b"\x81\x0d\x0d", b"a\x0b\x0c\x1c\x85b"):
        assert drop_stop(socket, STOP_KEY, payload)
    assert [read for _, read in pipes.read()] == [line, line, line, b"\x81\x0d\x0d", b"a\x0b\x0c\x1c\x85b"]


def test_nobody_is_told_that_it_stopped_where_nobody_reads(socket):
    """No gateway, a dead one's pipe, or a file that somebody left there."""
    assert not drop_stop(socket, STOP_KEY, b"")
    StopPipes(socket, 0o660).close()
    assert stop_pipe(socket, STOP_KEY).is_fifo() and not drop_stop(socket, STOP_KEY, b"")
    stop_pipe(socket, STOP_KEY).unlink()
    stop_pipe(socket, STOP_KEY).touch()
    assert not drop_stop(socket, STOP_KEY, b"") and not stop_pipe(socket, STOP_KEY).read_bytes()


@pytest.mark.parametrize(("mode", "made"), [(0o660, 0o620), (0o600, 0o600), (0o666, 0o622), (0o000, 0o600)])
def test_who_may_open_the_socket_may_write_and_nobody_else_reads(socket, mode, made):
    """An owner's line carries his secret."""
    pipes = StopPipes(socket, mode)
    assert {stat.S_IMODE(os.fstat(file).st_mode) for file in pipes.files} == {made}
    pipes.close()


def test_what_is_no_pipe_of_ours_is_replaced(socket, tmp_path):
    """A file, a link to one: it is not opened, not followed, not changed."""
    (tmp_path / "precious").write_bytes(b"kept")
    stop_pipe(socket, STOP_KEY).symlink_to(tmp_path / "precious")
    stop_pipe(socket, ESTOP_KEY).write_bytes(b"rubbish")
    pipes = StopPipes(socket, 0o660)
    assert drop_stop(socket, STOP_KEY, b"a") and drop_stop(socket, ESTOP_KEY, b"b")
    assert pipes.read() == [(ESTOP_KEY, b"b"), (STOP_KEY, b"a")]
    pipes.close(is_last=True)
    assert (tmp_path / "precious").read_bytes() == b"kept"
    assert [path.name for path in tmp_path.iterdir()] == ["precious"]


def test_what_cannot_be_replaced_is_refused(socket):
    """Somebody made a folder there."""
    stop_pipe(socket, STOP_KEY).mkdir()
    with pytest.raises(OSError):
        StopPipes(socket, 0o660)


def test_a_guard_reads_what_its_frozen_gateway_did_not(socket, pipes):
    """Both have the same pipe; each line is read once, and the one that is left goes on with it."""
    guard = StopPipes(socket, 0o660)
    drop_stop(socket, ESTOP_KEY, b"while it stands still")
    pipes.close()  # killed
    assert guard.read() == [(ESTOP_KEY, b"while it stands still")] and drop_stop(socket, STOP_KEY, b"")
    guard.close()
    assert not drop_stop(socket, STOP_KEY, b"")


def test_the_pipes_of_a_successor_stay(socket, pipes):
    """Whoever ends in order takes away what is still its own."""
    path = stop_pipe(socket, STOP_KEY)
    path.unlink()
    successor = StopPipes(socket, 0o660)
    pipes.close(is_last=True)
    assert path.is_fifo() and drop_stop(socket, STOP_KEY, b"")
    successor.close(is_last=True)
    assert not path.exists()


# ------------------------------------------------------------------------------------------------- at the gateway


@pytest.fixture
def plane(tmp_path: Path):
    """A local plane whose loop is this test."""
    with LocalPlane(settings_for(tmp_path), tmp_path) as plane:
        yield plane


@pytest.mark.e2e
def test_a_dropped_stop_ends_the_sleep_and_the_rest_of_the_loop(plane):
    """It is there before anything of zenoh is, with its name in quotes; an e-stop first."""
    assert not plane.wait_for_stop(0.0) and not plane.wait(0.0)
    drop_stop(plane.socket, STOP_KEY, b'{"name": "Ann", "reason": "smoke"}')
    assert plane.wait_for_stop(10.0)
    drop_stop(plane.socket, ESTOP_KEY, b"")
    estop, stop = plane.poll_stops()
    assert (estop.request, estop.client_id) == (Estop(), "somebody")
    assert (stop.request, stop.client_id) == (Stop(reason="smoke"), "'Ann'")
    drop_stop(plane.socket, STOP_KEY, b"")
    assert plane.wait(10.0) and len(plane.poll()) == 1
    assert plane.poll() == [] and not plane.wait_for_stop(0.0)


@pytest.mark.e2e
def test_a_flood_of_stops_lets_the_loop_sleep(plane):
    """While one waits to be served the pipe is not looked at: whoever writes without end takes no processor from the loop."""
    drop_stop(plane.socket, STOP_KEY, b"")
    while plane.wait_for_stop(0.0):  # the pipe, then the bell that it rang
        drop_stop(plane.socket, STOP_KEY, b"")
    begun_s = time.monotonic()
    assert not plane.wait_for_stop(0.05)
    assert time.monotonic() - begun_s >= 0.05
    assert len(plane.poll_stops()) == 3


@pytest.mark.e2e
def test_a_gateway_that_ends_in_order_leaves_no_pipe(tmp_path):
    """A shell that writes there must not wait for a reader that never comes."""
    with LocalPlane(settings_for(tmp_path), tmp_path) as plane:
        assert stop_pipe(plane.socket, STOP_KEY).is_fifo() and stop_pipe(plane.socket, ESTOP_KEY).is_fifo()
    assert not [path for path in tmp_path.iterdir() if path.is_fifo()]
