"""Rules of `gateway.process.zenoh_threads`: who waits and reads, who connects; what a user sets stays."""

from __future__ import annotations

import os
import subprocess
import sys

from gateway.process.zenoh_threads import SHARED, VARIABLE, share_reactor

PROGRAM = """
import pathlib
import zenoh
from gateway.process.zenoh_threads import share_reactor
share_reactor()
config = zenoh.Config()
for key, value in (("mode", '"router"'), ("listen/endpoints", '["tcp/127.0.0.1:0"]'), ("scouting/multicast/enabled", "false")):
    config.insert_json5(key, value)
with zenoh.open(config) as session:
    session.put("a/key", b"")
    print(*sorted({p.joinpath("comm").read_text().strip()[:3] for p in pathlib.Path("/proc/self/task").iterdir()}))
"""


def test_sockets_are_waited_for_where_they_are_read():
    """In a process of its own that listens, too: zenoh reads where it waits, and clients' sockets are opened elsewhere."""
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, timeout=30)
    assert done.returncode == 0, done.stderr
    threads = done.stdout.split()
    assert "rx-" in threads
    assert "app" not in threads
    assert "acc" in threads


def test_what_the_user_set_stays(monkeypatch):
    """The variable is zenoh's own, and whoever sets it knows why."""
    monkeypatch.setattr("os.environ", {VARIABLE: "(rx: (worker_threads: 4))"})
    share_reactor()
    assert os.environ == {VARIABLE: "(rx: (worker_threads: 4))"}
    os.environ.clear()
    share_reactor()
    assert os.environ == {VARIABLE: SHARED}
