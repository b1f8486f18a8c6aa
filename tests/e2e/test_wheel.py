"""What a user installs: the wheel, in an environment of its own, far from any checkout. Nothing comes from a network."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from tests.e2e.system import ATTEMPTS, ROOT, STALLED

pytestmark = [pytest.mark.e2e, pytest.mark.thorough, pytest.mark.sim_only("the demo starts a robot of its own")]


class Installed:
    """An environment with the wheel; all that it needs comes from the environment of the tests.

    Args:
        folder: For the wheel and the environment.
    """

    def __init__(self, folder: Path) -> None:
        self._environment = {
            name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "TA2_"))
        }
        self._home = folder / "environment"
        _run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)], ROOT)
        (wheel,) = folder.glob("*.whl")
        _run([sys.executable, "-m", "venv", "--without-pip", str(self._home)], folder)
        self.python = self._home / "bin/python"
        here = sysconfig.get_path("purelib", vars={"base": str(self._home)})
        # Paths of a .pth file come last, and the .pth files in them are not read: they lead to no checkout.
        (Path(here) / "needs.pth").write_text(sysconfig.get_path("purelib"))
        options = ["--quiet", "--no-index", "--no-deps", "--ignore-installed"]
        _run([self.python, "-m", "pip", "install", *options, str(wheel)], folder)

    def run(self, folder: Path, *words: str, without: str = "") -> subprocess.CompletedProcess[str]:
        """Run `ta2 WORDS` in a folder, as it is or as if a package were not installed."""
        command = [str(self._home / "bin/ta2"), *words]
        if without:
            hide = f"import sys; sys.modules[{without!r}] = None; from gateway.cli.main import main; sys.exit(main())"
            command = [str(self.python), "-I", "-c", hide, *words]
        return subprocess.run(
            command, cwd=folder, env=self._environment, capture_output=True, text=True, timeout=120, check=False
        )


def _run(words: list[str | Path], folder: Path) -> None:
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """One wheel for all tests."""
    return Installed(tmp_path_factory.mktemp("wheel"))


@pytest.mark.alone
def test_the_demo_runs_from_a_wheel_beside_a_folder_of_the_same_name(installed: Installed, tmp_path: Path) -> None:
    """Robot and daemon are those of the wheel; the plot lies where the user is."""
    (tmp_path / "gateway").mkdir()
    (tmp_path / "gateway/__init__.py").write_text("raise ImportError('not this one')")
    for _ in range(ATTEMPTS):
        done = installed.run(tmp_path, "demo")
        if not done.stderr.startswith(STALLED):
            break
    assert done.returncode == 0 and "all good" in done.stdout, done.stdout + done.stderr
    assert (tmp_path / "out/demo.png").stat().st_size > 10_000


def test_a_demo_that_cannot_draw_says_what_to_install_before_it_starts_anything(
    installed: Installed, tmp_path: Path
) -> None:
    """One line with the command of pip."""
    done = installed.run(tmp_path, "demo", without="matplotlib")
    assert done.returncode == 1 and not done.stdout and done.stderr.count("\n") == 1
    assert done.stderr.startswith("BAD_REQUEST: ") and "pip install 'teleavatar-gateway[demo]'" in done.stderr


def test_the_wheel_holds_all_that_the_commands_read(installed: Installed, tmp_path: Path) -> None:
    """The default settings, the examples, and what is installed beside it for the shell's completion."""
    for words in (["config", "--show"], ["example"], ["model", "check"], ["completion", "bash"]):
        done = installed.run(tmp_path, *words)
        assert done.returncode == 0 and done.stdout, done.stderr
