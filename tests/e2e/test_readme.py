"""The README's first program runs as it stands, against the simulated robot."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.e2e.system import ATTEMPTS, ROOT, STALLED, System
from tests.thoroughness import IS_THOROUGH

pytestmark = [pytest.mark.e2e, pytest.mark.body_free("the words are the matter, and the heart's tests move both arms")]


def test_the_readmes_first_program_moves_both_arms(tmp_path: Path, systems: Callable[..., System]) -> None:
    """Copied out of the README, with nothing added but the socket in the environment."""
    program = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)[0]
    system = systems(tmp_path, has_guard=IS_THOROUGH)
    with system.connect("watcher"):
        for _ in range(ATTEMPTS):
            done = subprocess.run(
                [sys.executable, "-c", program],
                env={"TA2_SOCKET": system.target, "PATH": "/usr/bin", "PYTHONPATH": str(ROOT)},
                capture_output=True,
                text=True,
                timeout=60,
                check=False,
            )
            if not any(f": {code}: " in done.stderr for code in STALLED):
                break
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("reached, measured error 0.00") == 2, done.stdout
