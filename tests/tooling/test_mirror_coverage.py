"""Coverage by mirror finds what a test file leaves out of its module, and pairs modules with files by name."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.tooling.mirror_coverage import ROOT, Mirror, measure, mirrors

GEAR = Mirror(module=Path("gateway/core/gear.py"), test=Path("tests/core/test_gear.py"))
MODULE = '''"""A module under test."""


def shift(gear: int) -> str:
    """Name the gear."""
    name = "neutral"
    if gear > 0:
        name = "forward"
    return name
'''


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout with one module and this project's settings."""
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    write(tmp_path / "gateway/__init__.py", "")
    write(tmp_path / "gateway/core/__init__.py", "")
    write(tmp_path / GEAR.module, MODULE)
    return tmp_path


def write(path: Path, text: str) -> None:
    """Write a file and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


@pytest.mark.slow
def test_a_branch_that_is_never_taken_is_missing(checkout: Path) -> None:
    """Every line can be reached and a branch still be missing: the `if` that was never false."""
    write(checkout / GEAR.test, "from gateway.core.gear import shift\n\ndef test():\n    assert shift(1)\n")
    assert measure(GEAR, checkout).missing == "branch 7 -> 9"


def test_a_missing_test_file_is_named(checkout: Path) -> None:
    """A module without a test file of its own falls short, whatever else covers it."""
    assert "there is no tests/core/test_gear.py" in measure(GEAR, checkout).trouble


def test_every_module_is_paired_with_its_own_file(checkout: Path) -> None:
    """`core/x.py` is paired with `tests/core/test_x.py`; a part of a package may share the package's file."""
    write(checkout / "gateway/core/streams/__init__.py", "from gateway.core.gear import shift\n")
    write(checkout / "gateway/core/streams/arm.py", "")
    write(checkout / "cdr_types/codec.py", "")
    write(checkout / "cdr_types/messages/__init__.py", "def load():\n    pass\n")
    write(checkout / "cdr_types/messages/std_msgs.py", "")
    write(checkout / "tests/core/streams/test_arm.py", "")
    write(checkout / "tests/cdr_types/test_messages.py", "")
    assert {m.module.as_posix(): m.test.as_posix() for m in mirrors(checkout)} == {
        "gateway/core/gear.py": "tests/core/test_gear.py",
        "gateway/core/streams/arm.py": "tests/core/streams/test_arm.py",
        "cdr_types/codec.py": "tests/cdr_types/test_codec.py",
        "cdr_types/messages/__init__.py": "tests/cdr_types/test_messages.py",
        "cdr_types/messages/std_msgs.py": "tests/cdr_types/test_messages.py",
    }
