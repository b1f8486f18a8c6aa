"""Rules of `gateway.process.own_module`: what runs is this package's, in whatever folder."""

from __future__ import annotations

import subprocess
from pathlib import Path

import gateway
from gateway.process.own_module import own_module


def test_a_folder_of_the_same_name_is_not_run_instead(tmp_path: Path) -> None:
    """Where the daemon was started somebody's `gateway` may lie: `python -m` would run it as the guard."""
    (tmp_path / "gateway").mkdir()
    (tmp_path / "gateway" / "__init__.py").write_text("raise SystemExit('another package')\n")
    ended = subprocess.run(
        own_module("gateway.cli", "--version"), cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert gateway.__version__ in ended.stdout
