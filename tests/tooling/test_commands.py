"""The commands in `bin/`: found from anywhere, and plain about what is missing. Nothing is installed here."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = ["bin/demo", "bin/test", "bin/check", "bin/bench", "bin/bridge", "bin/interop", "bin/docs", ".ci/run"]
# What the scripts call besides Python.
PROGRAMS = ["bash", "cat", "cut", "dirname", "env", "grep", "head", "mktemp", "readlink", "rm", "sh", "sort", "tail"]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """The commands in a checkout of their own, whose folder has a space in its name."""
    root = tmp_path / "a checkout"
    shutil.copytree(ROOT / "bin", root / "bin")
    shutil.copytree(ROOT / ".ci", root / ".ci")
    shutil.copy(ROOT / "pyproject.toml", root)
    return root


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder with everything the commands need but Python."""
    folder = tmp_path / "programs"
    folder.mkdir()
    for name in PROGRAMS:
        path = shutil.which(name)
        assert path is not None
        (folder / name).symlink_to(path)
    return folder


def put_script(path: Path, text: str) -> None:
    """Write an executable shell script."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(0o755)


def run(command: Path, cwd: Path, path: Path) -> subprocess.CompletedProcess[str]:
    """Run a command with nothing on the PATH but one folder."""
    environment = {"PATH": str(path), "HOME": str(path)}
    return subprocess.run([command], cwd=cwd, env=environment, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_can_be_executed_and_is_valid_bash(command: str) -> None:
    """Each command has its executable bit and parses."""
    assert os.access(ROOT / command, os.X_OK)
    subprocess.run(["bash", "-n", ROOT / command], check=True)


def test_a_command_finds_its_checkout_from_any_directory_and_through_symlinks(checkout: Path, tmp_path: Path) -> None:
    """A link to a link to bin/test, called from elsewhere, prints the help of bin/test."""
    (tmp_path / "first").symlink_to(checkout / "bin/test")
    (tmp_path / "second").symlink_to(tmp_path / "first")
    result = subprocess.run(
        [tmp_path / "second", "--help"], cwd="/", capture_output=True, text=True, timeout=120, check=True
    )
    assert result.stdout.startswith("usage: bin/test")


def test_without_python_the_message_names_the_package(checkout: Path, programs: Path) -> None:
    """On a machine without python3 a command ends at once and says what to install."""
    result = run(checkout / "bin/demo", checkout, programs)
    assert result.returncode == 2
    assert "apt install python3 python3-venv" in result.stderr


def test_an_old_python_is_refused_with_its_version(checkout: Path, programs: Path) -> None:
    """Python 3.9 is refused by name, and the way to choose another one is shown."""
    put_script(programs / "python3", "echo 3.9.18 /usr/bin/python3")
    result = run(checkout / "bin/test", checkout, programs)
    assert result.returncode == 2
    assert "Python 3.9.18, 3.10 or newer is needed" in result.stderr
    assert "PYTHON=python3.12" in result.stderr


def test_a_python_without_venv_names_the_package_of_its_version(checkout: Path, programs: Path) -> None:
    """Debian's Python has no ensurepip of its own: the message names python3.12-venv."""
    put_script(programs / "python3", f'case "$*" in *ensurepip*) exit 1 ;; esac\necho 3.12.3 {programs}/python3')
    result = run(checkout / "bin/demo", checkout, programs)
    assert result.returncode == 2
    assert "apt install python3.12-venv" in result.stderr


def test_a_current_environment_is_used_without_installing(checkout: Path, programs: Path) -> None:
    """A stamp that holds place, version and pyproject.toml is enough: the demo starts with its arguments."""
    put_script(checkout / ".venv/bin/python", 'case "$*" in *version_info*) echo 3.12.3 ;; *) echo "$@" ;; esac')
    stamp = f"{checkout}\n3.12.3\n{(checkout / 'pyproject.toml').read_text(encoding='utf-8')}"
    for kind in ("demo", "body"):
        (checkout / f".venv/.installed-{kind}").write_text(stamp, encoding="utf-8")
    result = subprocess.run(
        [checkout / "bin/demo", "--seed", "1"],
        cwd="/",
        env={"PATH": str(programs)},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert result.stdout == "-I -m gateway.cli demo --seed 1\n"
    assert result.stderr == ""


@pytest.mark.parametrize("change", ["pyproject", "python", "place"])
def test_an_environment_made_from_something_else_is_not_current(change: str, checkout: Path, programs: Path) -> None:
    """Another pyproject.toml, another Python or another place of the checkout: the stamp no longer holds."""
    version = "3.13.0" if change == "python" else "3.12.3"
    put_script(checkout / ".venv/bin/python", f'case "$*" in *"import sys"*) echo {version} x ;; *) exit 1 ;; esac')
    place = "/elsewhere" if change == "place" else checkout
    text = (checkout / "pyproject.toml").read_text(encoding="utf-8") + ("\n# older" if change == "pyproject" else "")
    for kind in ("demo", "body"):
        (checkout / f".venv/.installed-{kind}").write_text(f"{place}\n3.12.3\n{text}", encoding="utf-8")
    result = run(checkout / "bin/demo", checkout, programs)
    assert result.returncode == 2
    assert "'python3' does not run" in result.stderr


def test_a_shim_that_exists_and_fails_is_not_an_interpreter(tmp_path: Path, programs: Path) -> None:
    """A version manager's python3.12 that only prints an error is passed over, with the reason."""
    put_script(programs / "python3.12", "echo 'python3.12: command not found' >&2; exit 127")
    script = f'ROOT=/; . "{ROOT}/bin/_environment.sh"; find_python 3.12; echo "[$FOUND_PYTHON] $NOT_FOUND"'
    result = subprocess.run(
        ["bash", "-euc", script],
        env={"PATH": str(programs), "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert re.fullmatch(r"\[\] \S*/python3\.12 does not run\n", result.stdout)


def test_an_interpreter_of_a_version_manager_is_found_behind_its_failing_shim(tmp_path: Path, programs: Path) -> None:
    """Behind a failing shim the version manager's own folder is looked into."""
    put_script(programs / "python3.12", "exit 127")
    real = tmp_path / ".pyenv/versions/3.12.1/bin/python"
    put_script(real, f'case "$*" in *ensurepip*) exit 0 ;; esac\necho 3.12.1 {real}')
    script = f'ROOT=/; . "{ROOT}/bin/_environment.sh"; find_python 3.12; echo "$FOUND_PYTHON"'
    result = subprocess.run(
        ["bash", "-euc", script],
        env={"PATH": str(programs), "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert result.stdout == f"{real}\n"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "-m tests.tooling.every_test 3.12={python}"),
        (["--all-pythons"], "-m tests.tooling.every_test 3.12={python}"),  # no other one is there
        (["--fast"], "-m pytest -m not e2e and not slow -n auto --maxprocesses 8"),
        (["--fast", "tests/core"], "-m pytest -m not e2e and not slow tests/core"),
        (["--", "--help"], "-m pytest --help"),
    ],
)
def test_bin_test_runs_every_test_or_what_it_is_given(
    checkout: Path, programs: Path, words: list[str], said: str
) -> None:
    """Without arguments of pytest its own runner plans the runs; else it is one plain run of pytest."""
    python = checkout / ".venv/bin/python"
    put_script(python, 'case "$*" in *"%d.%d.%d"*) echo 3.12.3 x ;; *) echo "$*" ;; esac')
    stamp = f"{checkout}\n3.12.3\n{(checkout / 'pyproject.toml').read_text(encoding='utf-8')}"
    for kind in ("test", "body"):
        (checkout / f".venv/.installed-{kind}").write_text(stamp.replace("3.12.3", "3.12.3 x"), encoding="utf-8")
    environment = {"PATH": str(programs), "HOME": str(programs)}
    command = [checkout / "bin/test", *words]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=True)
    assert result.stdout == said.format(python=python) + "\n", result.stderr
