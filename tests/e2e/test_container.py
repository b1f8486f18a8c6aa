"""The client in a container without ROS: three packages, the gateway's socket at another path, and nothing else."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.e2e.system import ROOT, System
from tests.thoroughness import IS_THOROUGH

pytestmark = [pytest.mark.e2e, pytest.mark.sim_only("what the client needs is the matter")]

NEEDED = ("zenoh", "msgspec", "numpy", "numpy.libs", "gateway")

PROGRAM = """
import sys
sys.path[:0] = [sys.argv[1]]
from gateway.cli.main import main
status = main(["example", "6.6", "--yes", "--socket", sys.argv[2]])
print(sorted({name.partition(".")[0] for name in sys.modules} - set(sys.stdlib_module_names)))
sys.exit(status)
"""


def image(folder: Path) -> Path:
    """Make a folder with what is installed in a slim image: links to three packages and to ours."""
    folder.mkdir()
    for name in NEEDED:
        spec = importlib.util.find_spec(name) if "." not in name else None
        if name == "gateway":
            origin = ROOT / "gateway"
        elif spec is not None and spec.origin is not None:
            origin = Path(spec.origin).parent
        else:
            numpy = importlib.util.find_spec("numpy")
            assert numpy is not None and numpy.origin is not None
            origin = Path(numpy.origin).parents[1] / name
        if origin.exists():
            (folder / name).symlink_to(origin)
    return folder


def test_the_client_and_the_examples_run_with_three_packages(tmp_path: Path, systems: Callable[..., System]) -> None:
    """An isolated interpreter without site packages, the socket's directory seen elsewhere: an example moves the robot."""
    system = systems(tmp_path, has_guard=IS_THOROUGH)
    mounted = tmp_path / "run"
    mounted.symlink_to(Path(system.target).parent)
    with system.connect("watcher"):
        done = subprocess.run(
            [
                sys.executable,
                *("-I", "-S", "-c", PROGRAM),
                str(image(tmp_path / "image")),
                str(mounted / "gw.sock"),
            ],
            env={},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    converged, loaded = done.stdout.strip().splitlines()
    assert "Both arms converged!" in converged
    assert set(eval(loaded)) <= {
        "__main__",
        "gateway",
        "zenoh",
        "msgspec",
        "numpy",
        "typing_extensions",
        "_cython_3_0_11",
    }
