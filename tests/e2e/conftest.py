"""Systems for end-to-end tests, ended whatever happens; each test with each robot.

The robots: the simulated one on zenoh, the same model as a node on a DDS graph behind a real bridge
(`tests/interop/dds_robot.py`), and where `TA2_PHYSICS=mujoco` says so, as in CI, the first with a body that forces move.
Every test is the same for all, with the same bounds. One that proves nothing of how a body moves is marked
`body_free` with the reason and does without forces, one that proves nothing of the wire `wire_free` and does without the
real bridge; one that is for the first robot alone is marked `sim_only`:

* The demo starts a robot of its own.
* Dead routes: the simulated bridge has a switch for them. A real one must be brought to it, which it refuses to be as
  long as we hold our tokens (wire reference, fact 8); `tests/interop/test_routes.py` does it without them.
* A core of this host that stands still, whatever the robot is.
* The memory of thousands of connections is a matter of clients and daemon, and takes a minute.

What is under the surface different, and passes all the same: a killed robot is two processes, node and bridge; after
`router_stop` only the bridge is new and the node goes on, as when a bridge is restarted on a robot; state routes exist in the
bridge from the moment it has found the node, a tenth of a second after it listens; and all messages are written and read
by CycloneDDS's own serializer.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.e2e.system import System
from tests.interop.bridge_process import demand, is_required, lacking


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Give every test all robots, unless it says that it is not for one, or there is none."""
    kinds: list[Any] = ["sim"]
    marker = metafunc.definition.get_closest_marker
    if marker("sim_only") is None:
        if marker("wire_free") is None and (is_required() or not lacking()):
            kinds.append(pytest.param("dds", marks=pytest.mark.interop))
        if os.environ.get("TA2_PHYSICS") == "mujoco" and marker("body_free") is None:
            kinds.append(pytest.param("forces", marks=pytest.mark.forces))
    metafunc.parametrize("robot_kind", kinds, indirect=True)


@pytest.fixture(autouse=True)
def robot_kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Choose the robot of a test: `sim`, `dds` or `forces`."""
    kind: str = request.param
    if kind == "dds":
        demand()
    monkeypatch.setattr(System, "kind", kind)
    return kind


@pytest.fixture
def systems() -> Iterator[Callable[..., System]]:
    """Give a maker of systems; all of them end with the test."""
    made: list[System] = []

    def make(folder: Path, **options: Any) -> System:
        made.append(System(folder, **options))
        return made[-1]

    yield make
    for system in made:
        system.close()
