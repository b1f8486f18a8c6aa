"""`ta2 model check`: what it prints, how it ends, and what it does with a URDF."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.kinematics.description import nominal
from gateway.values import Side
from tests.cli.shell import Shell
from tests.kinematics.bodies import nudged
from tests.kinematics.urdfs import written

ROOT = Path(__file__).parents[3]


@pytest.fixture
def shell(monkeypatch, capsys):
    """A shell of `ta2`."""
    return Shell(monkeypatch, capsys)


def test_our_own_numbers_agree(shell):
    """Status 0, the source is told, and every figure agrees."""
    ended = shell.run("model", "check")
    assert ended.status == 0
    assert "teleavatar_urdf_20260928-v2" in ended.out and "19 figures checked, 0 differ" in ended.out


def test_a_urdf_that_differs_ends_with_status_1_and_names_what(shell, tmp_path):
    """Judged like our numbers, and compared with them."""
    path = written(nudged(Side.LEFT, 4, xyz_m=(0.0, 0.0, 0.001)), tmp_path / "mine.urdf")
    ended = shell.run("model", "check", "--urdf", str(path))
    assert ended.status == 1
    assert "19 figures checked, 1 differ: left_ee at the home of §6.6" in ended.out.replace("\n", " ")


def test_the_vendors_numbers_as_a_urdf_agree(shell, tmp_path):
    """The same list for a file, as JSON, with the four rows of the comparison behind."""
    path = written(nominal(), tmp_path / "vendor.urdf")
    ended = shell.run("model", "check", "--urdf", str(path), "--json")
    told = json.loads(ended.out)
    assert ended.status == 0 and told["good"] is True
    assert len(told["findings"]) == 23
    assert [row["allowed"] for row in told["findings"][-4:]] == [None] * 4


def test_what_a_urdf_lacks_is_one_line_and_the_status_of_a_wrong_configuration(shell, tmp_path):
    """The names that are missing, and what to do."""
    path = tmp_path / "other.urdf"
    path.write_text('<robot name="other"/>')
    ended = shell.run("model", "check", "--urdf", str(path))
    assert ended.status == 2
    assert (
        ended.err.startswith("BAD_CONFIG: ")
        and "'armL1_joint' (or 'l_joint1')" in ended.err
        and ended.err.count("\n") == 1
    )


def test_the_check_needs_neither_pinocchio_nor_a_robot():
    """Nothing heavy is imported for it, nor for the arms' kinematics at all."""
    code = (
        "import sys; from gateway.cli import main as cli; status = cli.main(['model', 'check', '--json']); "
        "assert not {'pinocchio', 'mujoco', 'zenoh'} & set(sys.modules), sorted(sys.modules); sys.exit(status)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
