"""What a gateway opens to the network: nothing by default, one port where it was configured."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from gateway.client import connect
from tests.e2e.system import Process, free_port, wait_for

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("no robot is needed to look at the ports of a gateway")]

LISTENING = "0A"


def family(pid: int) -> list[int]:
    """Return a process and all that it has started."""
    pids = [pid]
    for each in pids:
        for task in Path(f"/proc/{each}/task").glob("*/children"):
            pids += [int(word) for word in task.read_text().split()]
    return pids


def open_ports(pid: int) -> set[str]:
    """Return the TCP ports at which a process listens, and its UDP sockets, as the kernel names them."""
    mine = set()
    for name in os.listdir(f"/proc/{pid}/fd"):
        try:
            status = os.stat(f"/proc/{pid}/fd/{name}")
        except OSError:  # closed meanwhile
            continue
        if stat.S_ISSOCK(status.st_mode):
            mine.add(str(status.st_ino))
    found = set()
    for kind in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/{pid}/net/{kind}").read_text().splitlines()[1:]:
            words = line.split()
            if words[9] in mine and (words[3] == LISTENING or kind.startswith("udp")):
                found.add(f"{kind} {words[1]}")
    return found


@pytest.mark.parametrize("is_asked_for", [False, True])
def test_nothing_is_open_to_the_network_unless_configured(tmp_path, is_asked_for):
    """Of the daemon and of its guard; a listener that is asked for is the only one, so that the scan is known to see."""
    port, config = free_port(), tmp_path / "config.toml"
    local = f'[local]\ntcp = "127.0.0.1:{port}"\ntcp_open_to_every_user_of_this_host = true\n'
    config.write_text(local if is_asked_for else "")
    socket = str(tmp_path / "gw.sock")
    arguments = ["-m", "gateway.cli", "run", "--robot", f"tcp/127.0.0.1:{free_port()}", "--socket", socket]
    state = {"TA2_STATE_DIR": str(tmp_path / "state")}
    daemon = Process("daemon", [*arguments, "--config", str(config)], tmp_path, state)
    try:
        wait_for(lambda: connect(socket, timeout_s=1.0, greet=False).close() or True, "a daemon", tell=daemon.text)
        pids = wait_for(lambda: family(daemon.pid) if len(family(daemon.pid)) > 1 else [], "a guard", tell=daemon.text)
        heard = f"listening on tcp/127.0.0.1:{port}"
        wait_for(lambda: not is_asked_for or heard in daemon.text(), "what is asked for", tell=daemon.text)
        found = {pid: open_ports(pid) for pid in pids}
        own = {f"tcp 0100007F:{port:04X}"} if is_asked_for else set()
        assert found.pop(daemon.pid) == own
        assert set().union(*found.values()) == set(), "of the guard"
    finally:
        daemon.end()
