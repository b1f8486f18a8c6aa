"""Programs beside a simulated robot: they end when they are told to, and never outlive who started them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.sim.companion import Companion, until_told

PROGRAM = """
import sys, time
from gateway.sim.companion import until_told
with until_told(int(sys.argv[sys.argv.index("--parent") + 1])) as is_over:
    print("there", flush=True)
    while not is_over():
        time.sleep(0.01)
print("ended", flush=True)
"""


def test_signals_are_told_and_given_back() -> None:
    """Two of them; who had them before has them after."""
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    for number in (signal.SIGINT, signal.SIGTERM):
        with until_told(os.getppid()) as is_over:
            assert not is_over()
            signal.raise_signal(number)
            assert is_over()
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_a_program_ends_when_its_parent_has_gone() -> None:
    """Whatever has become of the parent: it need not have told anybody."""
    shell = 'PROGRAM=$1; "$2" -c "$PROGRAM" --parent $$ & kill -KILL $$'
    run = subprocess.run(
        ["/bin/sh", "-c", shell, "sh", PROGRAM, sys.executable], capture_output=True, text=True, timeout=15, check=False
    )
    assert run.returncode == -signal.SIGKILL
    assert run.stdout == "there\nended\n" and run.stderr == ""  # read to its end: the program has closed it


@pytest.mark.parametrize("patience_s", [15.0, 0.0])
def test_a_companion_ends_with_its_block(patience_s: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In order, with its last words, when it is given the time, and else all the same."""
    (tmp_path / "beside.py").write_text(PROGRAM)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.getcwd()]))
    companion = Companion("beside", [], patience_s)
    assert companion.pid is None
    with companion:
        pid = companion.pid
        assert pid is not None
    assert companion.pid is None
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
