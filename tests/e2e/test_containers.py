"""The images of configs/containers as compose.yaml runs them: a robot, the gateway, and a client without network that moves.

`bin/containers` builds them; where it has not, or podman runs nothing, this is skipped, and fails with TA2_CONTAINERS=required.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator

import pytest

from tests.e2e.system import ROOT, STALLED, wait_for

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.thorough,
    pytest.mark.sim_only("a robot in a container is a simulated one"),
]

READ_ONLY = ("--read-only", "--read-only-tmpfs=false", "--tmpfs", "/tmp:mode=1777")
"""As docker has it: of itself podman makes more than the compose file has writable."""
SANDBOX = (*READ_ONLY, "--cap-drop", "ALL", "--security-opt", "no-new-privileges")
GATEWAY = "keep-running.sh ta2 run --socket /run/ta2/gateway.sock --robot tcp/127.0.0.1:9000"
MOVE = """
import numpy as np
from gateway.client import connect
with connect() as robot, robot.control(take="from who stalled before") as own:
    own.enable()
    before = robot.fresh_state().left_arm.q
    own.left_arm.move_by(np.full(7, 0.03)).result(timeout=30.0)
    if np.allclose(robot.fresh_state().left_arm.q - before, 0.03, atol=0.01):
        print("moved")
"""
NAMES = tuple(f"ta2-test-{os.getpid()}-{part}" for part in ("robot", "gateway", "client", "run", "state"))
ROBOT, DAEMON, CLIENT, RUN, STATE = NAMES


def podman(*words: str) -> subprocess.CompletedProcess[str]:
    """Run podman."""
    return subprocess.run(["podman", *words], capture_output=True, text=True, timeout=120, check=False)


def container(name: str, image: str, *words: str, options: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    """Run one, in its sandbox."""
    command = [str(ROOT / "bin/containers"), "run", "--rm", "--name", name, *SANDBOX, *options, image, *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)


def require(is_so: bool, why: str) -> None:
    """Skip, or fail where they were built."""
    if not is_so:
        (pytest.fail if os.environ.get("TA2_CONTAINERS") == "required" else pytest.skip)(why)


@pytest.fixture
def gateway() -> Iterator[str]:
    """The name of a gateway's container that is connected to a robot's."""
    require(shutil.which("podman") is not None, "no podman here")
    for image in ("ta2-client", "ta2-gateway"):
        there = podman("image", "exists", f"localhost/{image}").returncode == 0
        require(there, f"no image {image} here: bin/containers builds it, where that can be done")
    try:
        words = ("ta2", "sim", "--listen", "tcp/127.0.0.1:9000")
        started = container(ROBOT, "localhost/ta2-gateway", *words, options=("-d", "--network", "none"))
        require(started.returncode != 77, started.stderr)
        assert started.returncode == 0, started.stderr
        volumes = ("--volume", f"{RUN}:/run/ta2", "--volume", f"{STATE}:/var/lib/ta2")
        options = ("-d", "--network", f"container:{ROBOT}", *volumes)
        started = container(DAEMON, "localhost/ta2-gateway", *GATEWAY.split(), options=options)
        assert started.returncode == 0, started.stderr
        tells = lambda: "".join(podman("logs", name).stdout for name in (ROBOT, DAEMON))  # noqa: E731
        ready = lambda: '"READ_ONLY"' in podman("exec", DAEMON, "ta2", "status", "--json").stdout  # noqa: E731
        wait_for(ready, "the gateway", seconds=90.0, tell=tells)
        yield DAEMON
    finally:
        for name in (CLIENT, DAEMON, ROBOT):  # the gateway has the robot's network
            podman("rm", "--force", "--volumes", "--time", "5", "--ignore", name)
        podman("volume", "rm", "--force", RUN, STATE)


def test_a_client_without_network_moves_arms_through_the_gateways_socket(gateway: str) -> None:
    """None of them is root, has a capability, or can write to itself."""
    options = ("--network", "none", "--volume", f"{RUN}:/run/ta2")
    for _ in range(6):  # without real time, which this engine may not give
        done = container(CLIENT, "localhost/ta2-client", "python3", "-c", MOVE, options=options)
        if not any(code in done.stderr for code in STALLED):
            break
    assert done.returncode == 0 and "moved" in done.stdout, done.stdout + done.stderr
    look = "id -u; grep CapEff /proc/self/status; touch /opt/ta2/x 2>/dev/null || echo read only"
    sandboxed = ["1000", "CapEff:", "0000000000000000", "read", "only"]
    for name in (ROBOT, gateway):
        assert podman("exec", name, "sh", "-c", look).stdout.split() == sandboxed
    assert container(CLIENT, "localhost/ta2-client", "sh", "-c", look, options=options).stdout.split() == sandboxed
    done = container(CLIENT, "localhost/ta2-client", "python3", "-m", "pip", "list", options=options)
    assert "ruckig" not in done.stdout and "msgspec" in done.stdout, done.stdout + done.stderr
