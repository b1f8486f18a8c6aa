"""The program of the page on cameras runs as it stands, against the simulated camera."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.e2e.system import ROOT
from tests.video.sending import camera, udp_port

pytestmark = pytest.mark.e2e


def test_the_pages_program_prints_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Copied out of the page, with nothing changed but the port."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (program,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/how-to/cameras.md").read_text(), flags=re.DOTALL)
    port = udp_port()
    changed = program.replace('Video("127.0.0.1")', f'Video("127.0.0.1", port={port})')
    assert changed != program
    with camera(port):
        process = subprocess.Popen(
            [sys.executable, "-u", "-c", changed],
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        try:
            lines = [process.stdout.readline() for _ in range(5)]
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=30)
        finally:
            process.kill()
    seqs = [int(line.partition(":")[0]) for line in lines]
    assert seqs == sorted(set(seqs))
    assert all(re.search(r": \d+ ms old, clean, mean \d+\.\d$", line) for line in lines), lines
