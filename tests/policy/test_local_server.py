"""Tests of policies in Python: real processes that answer, raise, hang and die, and that never outlive who asks."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import Aborted, Code, Disconnected, GatewayTimeout, Rejected
from gateway.policy.local_policy import send
from gateway.policy.local_server import LocalPolicy
from gateway.policy.openpi import encoded
from gateway.process.own_module import own_module

ROOT = Path(__file__).resolve().parents[2]
WAIT_S = 60.0

POLICIES = """
import os, re, time
import numpy as np

def rows(observation):
    print("printed, and harmless")
    os.write(1, b"so is this")
    return np.full((3, 7), observation["observation/state"][0])

rows.metadata = {"fps": 45}

class Model:
    def act(self, observation):
        return {"actions": [[float(observation["a"].sum())]], "pid": os.getpid(), "n": np.float32(2.0)}

model = Model()

def fails(observation):
    raise ValueError("no such towel")

def hangs(observation):
    open("pid", "w").write(str(os.getpid()))
    os.rename("pid", "hanging")
    while True:
        time.sleep(3600)

def holds_the_gil(observation):
    open("pid", "w").write(str(os.getpid()))
    os.rename("pid", "hanging")
    re.match(r"(a+)+$", "a" * 200 + "b")

def dies(observation):
    os._exit(3)

def unknown(observation):
    return {"actions": object()}

def words(observation):
    return {"actions": np.array(["a"])}
"""


def wait_for(is_so, what):
    """Poll until something is so."""
    until_s = time.monotonic() + WAIT_S
    while not is_so():
        assert time.monotonic() < until_s, what
        time.sleep(0.01)


def is_gone(pid):
    """Whether a process has ended, reaped or not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except FileNotFoundError:
        return True


@pytest.fixture
def make(tmp_path, monkeypatch):
    """Makes local policies of a module in the working directory."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "towels.py").write_text(POLICIES)
    (tmp_path / "cloths.py").write_text("import napkins\n")
    made = []

    def make(function, answer_s=WAIT_S, first_answer_s=WAIT_S):
        made.append(LocalPolicy(function, answer_s=answer_s, first_answer_s=first_answer_s))
        return made[-1]

    yield make
    for policy in made:
        policy.close()


def test_a_function_of_the_working_directory_is_asked_as_a_server_is(make, capfd):
    """Arrays in, arrays out; its metadata first; what it prints is on stderr."""
    policy = make("towels:rows")
    assert not policy.is_connected
    policy.connect()
    assert policy.is_connected and policy.metadata == {"fps": 45}
    for value in (0.5, 0.25):
        actions = policy.ask({"observation/state": np.full(48, value, np.float32), "prompt": "fold"})["actions"]
        assert actions.shape == (3, 7) and (actions == value).all()
    policy.close()
    told = capfd.readouterr()
    assert not told.out and "printed, and harmless" in told.err and "so is this" in told.err
    with pytest.raises(Disconnected):
        policy.ask({})


def test_a_method_may_answer_a_map_to_pictures_of_any_size(make):
    """More than a pipe holds, both being read; numbers of numpy are numbers."""
    policy = make("towels:model.act")
    policy.connect()
    answer = policy.ask({"a": np.ones((2720, 1280, 3), np.uint8)})
    assert answer["actions"] == [[2720 * 1280 * 3.0]] and answer["n"] == 2.0 and answer["pid"] != os.getpid()


@pytest.mark.parametrize(
    ("function", "words"),
    [
        ("towels:fails", "ValueError: no such towel"),
        ("towels:unknown", "TypeError: object cannot be sent"),
        ("cloths:act", "ModuleNotFoundError: No module named 'napkins'"),
    ],
)
def test_what_it_raises_is_told_with_its_last_line(make, capfd, function, words):
    """Its traceback is on stderr; whoever asks goes on living."""
    policy = make(function)
    with pytest.raises(Aborted) as caught:
        policy.connect()
        policy.ask({})
    assert caught.value.code is Code.POLICY_FAILED and caught.value.field == "server" and words in caught.value.message
    assert not policy.is_connected and "Traceback" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("function", "words"),
    [
        ("towels:nobody", "towels has no 'nobody'"),
        ("napkins:act", "there is no module 'napkins'"),
        ("napkins.small:act", "there is no module 'napkins'"),
    ],
)
def test_what_is_not_there_is_told_in_a_line(make, capfd, function, words):
    """Without a traceback, in which nothing is the user's."""
    with pytest.raises(Aborted) as caught:
        make(function).connect()
    assert caught.value.code is Code.POLICY_FAILED and words in caught.value.message
    assert capfd.readouterr().err == ""


def test_an_answer_that_is_no_numbers_is_refused(make):
    """As a server's is."""
    policy = make("towels:words")
    policy.connect()
    with pytest.raises(Rejected, match="only numbers are read"):
        policy.ask({})


@pytest.mark.parametrize("function", ["hangs", "holds_the_gil"])
def test_one_that_hangs_is_ended_and_begun_anew(make, tmp_path, function):
    """TIMEOUT of the server; the process is gone, whatever it did; the next question goes to another one."""
    policy = make(f"towels:{function}", first_answer_s=WAIT_S)
    policy.connect()
    policy._first_answer_s = 0.2
    with pytest.raises(GatewayTimeout) as caught:
        policy.ask({"a": np.zeros(20_000_000, np.uint8)})  # more than fits on its way
    assert caught.value.field == "server" and not policy.is_connected
    policy._first_answer_s = WAIT_S
    policy.connect()
    assert policy.is_connected


def test_one_that_dies_is_lost_as_a_server_is(make):
    """DISCONNECTED, and it can be begun anew."""
    policy = make("towels:dies")
    for _ in range(2):
        policy.connect()
        with pytest.raises(Disconnected) as caught:
            policy.ask({})
        assert caught.value.field == "server" and not policy.is_connected


def test_closing_does_not_wait_for_one_that_hangs(make, tmp_path):
    """Whoever waits for its answer is woken, and its process ends."""
    policy = make("towels:hangs")
    policy.connect()
    ended = []

    def ask():
        try:
            policy.ask({})
        except Disconnected as error:
            ended.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    wait_for((tmp_path / "hanging").exists, "a policy that hangs")
    pid = int((tmp_path / "hanging").read_text())
    policy.close()
    thread.join(WAIT_S)
    assert len(ended) == 1 and is_gone(pid)


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel of others does not end a process with its parent")
@pytest.mark.parametrize("function", ["hangs", "holds_the_gil"])
def test_it_ends_with_a_parent_that_is_killed(make, tmp_path, function):
    """By SIGKILL, in the midst of an answer that never comes, even one that lets no thread of its own run."""
    make("towels:rows")  # writes the module
    program = (
        "from gateway.policy.local_server import LocalPolicy\n"
        f"policy = LocalPolicy('towels:{function}')\npolicy.connect()\npolicy.ask({{}})\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    parent = subprocess.Popen([sys.executable, "-c", program], cwd=tmp_path, env=environment)
    try:
        wait_for((tmp_path / "hanging").exists, "a policy that hangs")
        pid = int((tmp_path / "hanging").read_text())
        assert not is_gone(pid)
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.wait()
    wait_for(lambda: is_gone(pid), "the end of the policy's process")


def test_it_ends_where_nobody_asks_any_more(make, tmp_path):
    """By the end of what it reads alone, in the midst of an answer."""
    make("towels:rows")
    ours, theirs = socket.socketpair()
    with theirs:
        command = own_module("gateway.policy.local_policy", "towels:hangs", str(os.getpid()))
        process = subprocess.Popen(command, stdin=theirs.fileno(), stdout=subprocess.DEVNULL, cwd=tmp_path)
    try:
        with ours:
            send(ours, encoded({}))
            wait_for((tmp_path / "hanging").exists, "a policy that hangs")
            assert process.poll() is None
        assert process.wait(WAIT_S) == 0
    finally:
        process.kill()
        process.wait()
