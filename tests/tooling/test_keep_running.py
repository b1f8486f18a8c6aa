"""The first process of the gateway's container: it outlives a daemon that dies, and ends with one that ends."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "configs" / "containers" / "keep-running.sh"
DEADLINE_S = 50.0


def kept(program: str, folder: Path) -> subprocess.Popen[str]:
    """Start a shell program as the daemon of a container."""
    words = ["sh", str(SCRIPT), "sh", "-c", program]
    return subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, text=True)


def test_a_container_that_is_read_only_has_room_for_its_lock() -> None:
    """Docker makes no /tmp of its own in one, and a gateway without any holds no robot."""
    services = (SCRIPT.parent / "compose.yaml").read_text("utf-8")
    sandbox = services.partition("x-sandbox: &sandbox\n")[2].partition("\n\n")[0]
    assert "  read_only: true\n" in sandbox and '  tmpfs: ["/tmp:mode=1777"]' in sandbox
    assert services.count("image: ") == services.count("<<: *sandbox\n    image: ")


def test_a_daemon_that_dies_is_started_again(tmp_path: Path) -> None:
    """By an error or a signal, as often as it takes; the last one ended well."""
    program = "echo >> tries; case $(wc -l < tries) in 1) exit 1;; 2) kill -9 $$;; *) exit 0;; esac"
    process = kept(program, tmp_path)
    _, told = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0 and (tmp_path / "tries").read_text() == "\n\n\n"
    assert "status 1: it is started again" in told and "status 137: it is started again" in told


@pytest.mark.parametrize("status", [0, 2])
def test_a_daemon_that_ended_well_or_cannot_start_is_not(tmp_path: Path, status: int) -> None:
    """0 is an orderly end, 2 a configuration that is wrong: so is the container's end."""
    process = kept(f"echo >> tries; exit {status}", tmp_path)
    process.communicate(timeout=DEADLINE_S)
    assert process.returncode == status and (tmp_path / "tries").read_text() == "\n"


def test_who_ends_the_container_ends_the_daemon_in_order(tmp_path: Path) -> None:
    """SIGTERM is handed on and waited for: the daemon brakes and pauses the robot in its own time."""
    program = "trap 'sleep 0.3; echo > paused; exit 7' TERM; echo > up; while :; do sleep 0.05; done"
    process = kept(program, tmp_path)
    deadline = time.monotonic() + DEADLINE_S
    while not (tmp_path / "up").exists():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGTERM)
    process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 7 and (tmp_path / "paused").exists()
