"""Tests of the client over real zenoh on loopback: processes that die, freeze, fork, restart; users and certificates."""

from __future__ import annotations

import gc
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack

import numpy as np
import pytest

from gateway.client import Credentials, connect
from gateway.client.connection.over_zenoh import Pulse
from gateway.core.messages.outputs import Level, Notice
from gateway.errors import Code, Disconnected, LeaseError, OutcomeUnknown, Rejected
from gateway.messages import requests
from gateway.process.threads import take_lost
from tests.api.daemon import Daemon, eventually
from tests.api.stand_in import START_Q
from tests.api.test_service import end

pytestmark = pytest.mark.e2e


@pytest.fixture
def daemon(tmp_path):
    """A daemon on a unix socket of this test."""
    with Daemon(tmp_path) as daemon:
        yield daemon


def start(script, *arguments):
    """Start a Python program that says `up` when it is ready."""
    process = subprocess.Popen([sys.executable, "-c", script, *map(str, arguments)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline().strip() == "up"
    return process


OWNER = """
import sys, time
from gateway.client import connect
with connect(sys.argv[1], name="child") as robot, robot.control(on_exit="release") as own:
    own.enable()
    handle = own.left_arm.move_to(robot.state.left_arm.q)
    print("up", flush=True)
    try:
        list(robot.events(timeout=3600))
    except KeyboardInterrupt:
        print("interrupted", own.is_open, flush=True)
        raise
"""


CONNECTING = """
import sys
from gateway.client import connect
print("up", flush=True)
try:
    connect(sys.argv[1], timeout_s=60.0)
except KeyboardInterrupt:
    print("interrupted")
"""


def test_ctrl_c_ends_a_connect_that_nobody_answers(tmp_path):
    """At once, not when its time is over."""
    with socket.socket(socket.AF_UNIX) as deaf:
        deaf.bind(str(tmp_path / "gw.sock"))
        deaf.listen()
        deaf.settimeout(20.0)
        process = start(CONNECTING, tmp_path / "gw.sock")
        deaf.accept()[0].close()  # does anybody listen
        with deaf.accept()[0]:
            process.send_signal(signal.SIGINT)
            assert process.communicate(timeout=20.0)[0] == "interrupted\n" and process.returncode == 0


HASTY = """
import atexit, sys, time
from gateway.client import connect
atexit.register(lambda: transport._session is None or print("callbacks come until Python has ended"))
robot = connect(sys.argv[1], name="hasty")
transport = robot._session.transport
beats = [transport.every(20_000, lambda: transport.put("ta2/nobody", b"beat"), print) for _ in range(4)]
print("up", flush=True)
time.sleep(0.05)
"""
FORGETFUL = """
import sys
from gateway.client import connect
robots = [connect(sys.argv[1], name=f"forgetful{n}") for n in range(4)]
robots.clear()
print("up", flush=True)
"""


@pytest.mark.parametrize("program", [HASTY, FORGETFUL], ids=["keepalives", "closings"])
def test_a_program_that_closes_nothing_ends_well(daemon, program):
    """Twenty times, with threads of ours inside zenoh at the end: keepalives, and what closes robots that nobody holds.

    No callback comes after that either.
    Before 3.14 Python unwinds a daemon thread that comes back after its end, over zenoh's frames, which abort the process.
    """
    words = [sys.executable, "-c", program, f"unix:{daemon.socket}"]
    for _ in range(5):
        with ExitStack() as stack:
            running = [
                stack.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
                for _ in range(4)
            ]
            for process in running:
                said = process.communicate(timeout=30)
                assert (process.returncode, *said) == (0, "up\n", "")


def test_the_whole_way(daemon):
    """Connect, own, enable, move, stream, release, against the real plane."""
    with connect(f"unix:{daemon.socket}", name="tester") as robot:
        assert np.allclose(robot.state.left_arm.q, START_Q) and robot.info.pid == os.getpid()
        with robot.control() as own:
            own.enable()
            assert own.left_arm.move_to(START_Q, speed=0.5).result(timeout=5).error < 0.01
            with own.left_arm.stream(rate_hz=100) as out:
                for _ in range(30):
                    out.set(out.q)
                    out.tick()
                eventually(lambda: out.accepted == 30)
        assert robot.state.state == "READ_ONLY" and robot.health().ok
        daemon.engine.notices.append(Notice(code=Code.WALK, level=Level.INFO, message="hello", at_ns=1))
        assert [notice.message for notice in robot.events(timeout=0.3)] == ["hello"]
    eventually(lambda: daemon.engine.gone == [robot.client_id])


def test_a_stop_is_dropped_and_asked_about(daemon):
    """Into the pipe first, whose stop needs nothing of zenoh; both are its own, by its secret."""
    with connect(str(daemon.socket)) as robot:
        robot.recover()
        robot.stop("smoke")
        stops = [who for who, request in daemon.engine.requests if request == requests.Stop(reason="smoke")]
    assert stops == [robot.client_id] * 2


@pytest.mark.alone
def test_a_killed_owner_is_gone_at_once(daemon):
    """SIGKILL of the owner: its token is gone within 250 ms, its signs of life have ended."""
    process = start(OWNER, daemon.socket)
    (client,) = daemon.engine.seen
    process.kill()
    killed = time.monotonic()
    eventually(lambda: daemon.engine.gone == [client])
    assert time.monotonic() - killed < 0.25
    end(process)


def test_a_frozen_owner_falls_silent_and_comes_back(daemon):
    """SIGSTOP ends the keepalives, SIGCONT brings them back under the same identity."""
    process = start(OWNER, daemon.socket)
    try:
        (client,) = daemon.engine.seen
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.1)
        silent_since = len(daemon.engine.seen[client])
        time.sleep(0.5)
        assert len(daemon.engine.seen[client]) == silent_since and daemon.engine.gone == []
        process.send_signal(signal.SIGCONT)
        eventually(lambda: len(daemon.engine.seen[client]) > silent_since + 3)
    finally:
        end(process)


def test_ctrl_c_in_a_wait_abandons_and_ends_the_process(daemon):
    """SIGINT while waiting: the robot is left held, the exception reaches the user, the process ends by itself."""
    process = start(OWNER, daemon.socket)
    time.sleep(0.5)  # the next thing that it does after saying `up` is to wait
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=20)
    assert said == "interrupted False\n" and process.returncode in (1, -signal.SIGINT, 130)
    assert daemon.engine.names()[-1] == "Abandon" and "Release" not in daemon.engine.names()


def test_a_program_that_forgets_to_close_still_ends(daemon):
    """No thread of ours or of zenoh keeps an interpreter from ending."""
    script = (
        "import sys; from gateway.client import connect; robot = connect(sys.argv[1]); "
        "own = robot.control().acquire(); own.enable(); print(robot.state.state)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(daemon.socket)], capture_output=True, text=True, timeout=30, check=True
    )
    assert done.stdout == "ACTIVE\n"
    eventually(lambda: len(daemon.engine.gone) == 1)


def test_a_forked_child_is_told_to_be_spawned(daemon):
    """In a real fork nothing hangs, connect() neither, a stop is dropped, and the parent's connection and lease live on."""
    with connect(str(daemon.socket), name="parent") as robot, robot.control() as own:
        own.enable()
        read_end, write_end = os.pipe()
        child = os.fork()
        if child == 0:  # pragma: no branch - the child leaves by _exit, where coverage cannot follow
            said = b"nothing"
            try:
                robot.stop()
            except Disconnected as error:
                said = b"forked" if "forked" in str(error) else str(error).encode()
            try:
                connect(str(daemon.socket), name="child")
            except Disconnected as error:
                said += b", by spawn" if "forked" in str(error) and "spawn" in error.hint else str(error).encode()
            finally:
                robot.close()
                os.write(write_end, said)
                os._exit(0)
        os.close(write_end)
        assert os.read(read_end, 100) == b"forked, by spawn"
        os.close(read_end)
        os.waitpid(child, 0)
        eventually(lambda: "Stop" in daemon.engine.names())  # dropped all the same, and not as the parent's
        own.enable()
        own.left_arm.move_to(START_Q).result(timeout=5)
    assert daemon.engine.names().count("Stop") == 1 and daemon.engine.names()[-1] == "Release"


def test_a_daemon_that_is_restarted_is_found_again(tmp_path):
    """A reader goes on with the next daemon by itself; an owner is told that its lease is over, and nothing is sent."""
    with Daemon(tmp_path) as first:
        robot = connect(str(first.socket), name="reader")
        own = robot.control().acquire()
        own.enable()
        handle = own.left_arm.move_to(START_Q)
        first.engine.frozen = True
    started = time.monotonic()
    with pytest.raises(Disconnected):
        handle.result(timeout=30)
    assert time.monotonic() - started < 3.0 and not robot.health().daemon
    with pytest.raises(Disconnected):
        robot.stop()
    with Daemon(tmp_path) as second:
        eventually(lambda: robot.health().daemon)
        assert robot.state.state == "READ_ONLY" and not robot.state.lease.owned
        with pytest.raises(LeaseError) as caught:
            own.enable()
        assert caught.value.code is Code.LEASE_LOST and not own.is_open
        time.sleep(0.3)  # several beats of a keepalive, if there were one
        assert second.engine.requests == [] and second.engine.seen == {} and second.engine.targets == []
        with robot.control():
            assert second.engine.names() == ["Acquire"]
        robot.close()


def test_a_frozen_loop_is_an_unknown_outcome_in_time(daemon):
    """A daemon whose loop hangs: the plane answers after two seconds what it knows."""
    with connect(str(daemon.socket)) as robot:
        daemon.engine.frozen = True
        started = time.monotonic()
        with pytest.raises(TimeoutError, match="was not run"):
            robot.recover()
        assert 1.9 < time.monotonic() - started < 2.9
        daemon.engine.frozen = False
        robot.recover()
        assert daemon.engine.names() == ["Recover"]


def test_connecting_often_leaves_no_threads(daemon):
    """Twenty connections in one process, as in a notebook, leave nothing behind."""
    before = {*threading.enumerate()}  # one of an earlier test may end meanwhile
    for _ in range(20):
        with connect(str(daemon.socket)) as robot, robot.control():
            assert robot.state.lease.client_id == robot.client_id
    gc.collect()
    eventually(lambda: {*threading.enumerate()} <= before)


def test_two_clients_race_for_the_lease(daemon):
    """However two clients race, never do both own; the loser is told who won."""
    winners, losers = [], []

    def race(name):
        with connect(str(daemon.socket), name=name) as robot:
            for _ in range(25):
                try:
                    with robot.control() as own:
                        winners.append(own.epoch)
                except LeaseError as error:
                    losers.append(str(error))

    threads = [threading.Thread(target=race, args=(name,)) for name in ("first", "second")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert len(winners) + len(losers) == 50 and len(set(winners)) == len(winners)
    assert all("LEASE_HELD" in error for error in losers)


def test_nobody_at_the_socket_is_disconnected_at_once(tmp_path):
    """A socket that a killed gateway left is told apart from none and from a file: its guard is to be asked, not waited for."""
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(tmp_path / "dead.sock"))
        (tmp_path / "file").touch()
    started = time.monotonic()
    for name, why in (("dead.sock", "nobody listens at"), ("file", "is no socket"), ("none", "there is no socket")):
        with pytest.raises(Disconnected, match=why):
            connect(str(tmp_path / name), timeout_s=600.0)
    assert time.monotonic() - started < 60.0
    with pytest.raises(Disconnected, match="check host"):
        connect("tcp/127.0.0.1:19330", timeout_s=0.3)


def test_the_default_socket_is_found(tmp_path, monkeypatch):
    """TA2_SOCKET leads daemon and client to one another."""
    monkeypatch.setenv("TA2_SOCKET", str(tmp_path / "gw.sock"))
    with Daemon(tmp_path, socket=""), connect() as robot:
        assert robot.info.socket == str(tmp_path / "gw.sock")
    monkeypatch.setenv("TA2_SOCKET", "gw.sock")
    with pytest.raises(Rejected):
        connect()


@pytest.mark.alone
def test_a_pulse_skips_what_it_missed():
    """Beats lie on an absolute grid; a beat that takes long loses beats and never bunches them."""
    beats = []

    def beat():
        beats.append(time.monotonic_ns())
        if len(beats) == 3:
            time.sleep(0.055)

    pulse = Pulse(10_000_000, beat, on_lost=pytest.fail)
    eventually(lambda: len(beats) >= 8)
    pulse.stop()
    count = len(beats)
    gaps = np.diff(beats)
    assert gaps[2] >= 55_000_000 and min(gaps) > 1_000_000
    time.sleep(0.05)
    assert len(beats) == count


def test_a_pulse_that_ends_unasked_tells_its_owner():
    """Once, with why; nobody else of this process hears of it."""

    class Panic(BaseException):
        pass

    def beat():
        raise Panic("boom")

    told = []
    pulse = Pulse(10_000_000, beat, told.append)
    eventually(lambda: told)
    pulse.stop()
    (why,) = told
    assert why.startswith("the thread ta2-keepalive ended unasked:") and why.endswith("Panic: boom")
    assert take_lost() == []


def test_users_connect_with_their_password(tmp_path):
    """On the network, credentials open the door; without them nobody answers."""
    users = tmp_path / "users"
    users.write_text("operator:correct horse\n")
    users.chmod(0o600)
    with Daemon(tmp_path, tcp="127.0.0.1:19331", users_file=str(users)):
        good = Credentials(user="operator", password="correct horse")
        assert "horse" not in repr(good)
        with connect("tcp/127.0.0.1:19331", credentials=good) as robot, robot.control() as own:
            own.enable()
        with pytest.raises(Disconnected):
            connect("tcp/127.0.0.1:19331", timeout_s=0.4)


def certificates(directory):
    """Make a small authority, a certificate for this host and one for a client, with the openssl program."""

    def openssl(*arguments):
        subprocess.run(["openssl", *arguments], cwd=directory, check=True, capture_output=True, timeout=60)

    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    openssl("req", "-x509", *key, "-keyout", "ca.key", "-out", "ca.pem", "-days", "2", "-subj", "/CN=test authority")
    for name in ("daemon", "client"):
        openssl("req", *key, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}")
        (directory / "san").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\n")
        signing = ["-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2", "-extfile", "san"]
        openssl("x509", "-req", "-in", f"{name}.csr", "-out", f"{name}.pem", *signing)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="certificates are made with the openssl program")
def test_certificates_open_the_door(tmp_path):
    """With TLS both sides show a certificate; a client without one is not let in."""
    certificates(tmp_path)
    tls = {
        "tls_certificate": str(tmp_path / "daemon.pem"),
        "tls_private_key": str(tmp_path / "daemon.key"),
        "tls_root_ca": str(tmp_path / "ca.pem"),
    }
    with Daemon(tmp_path, tcp="127.0.0.1:19332", **tls):
        known = Credentials(
            root_ca=str(tmp_path / "ca.pem"),
            certificate=str(tmp_path / "client.pem"),
            private_key=str(tmp_path / "client.key"),
        )
        with connect("tls/127.0.0.1:19332", credentials=known) as robot, robot.control() as own:
            own.enable()
        with pytest.raises((Disconnected, OutcomeUnknown)):
            connect("tls/127.0.0.1:19332", credentials=Credentials(root_ca=str(tmp_path / "ca.pem")), timeout_s=1.0)
