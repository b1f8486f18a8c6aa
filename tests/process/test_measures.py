"""Rules of `gateway.process.measures`: what is taken is undone at the end, so that nobody waits for a process that ends."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]

PROCESS = """
import gc, json, os, sys, threading
from gateway.process.measures import Measures
from gateway.settings.settings import Settings

gc.unfreeze()  # Python 3.12 begins with frozen objects of its own
done = threading.Event()
threading.Thread(target=done.wait).start()

def now():
    threads = [int(name) for name in os.listdir("/proc/self/task")]
    return {
        "policies": sorted({os.sched_getscheduler(t) for t in threads}),
        "cores": sorted({tuple(sorted(os.sched_getaffinity(t))) for t in threads}),
        "collects": gc.isenabled(),
        "frozen": gc.get_freeze_count() > 0,
    }

measures = Measures(Settings(), is_guard=sys.argv[1] == "guard")
if sys.argv[1] == "untaken":
    measures.take = lambda: None
seen = [now()]
measures.take()
seen.append(now())
threading.Thread(target=done.wait).start()
measures.renew()
measures.undo()
seen.append(now())
done.set()
print(json.dumps(seen))
"""


def process(kind: str) -> list[dict[str, Any]]:
    """Run a process that takes measures, gets another thread, and undoes them; return it before, between and after."""
    command = [sys.executable, "-c", PROCESS, kind]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=30, check=True)
    seen: list[dict[str, Any]] = json.loads(done.stdout)
    return seen


@pytest.mark.skipif(sys.platform != "linux", reason="threads are listed in /proc on Linux only")
@pytest.mark.parametrize("kind", ["daemon", "guard", "untaken"])
def test_a_process_leaves_real_time_before_it_ends(kind: str) -> None:
    """Policies, cores and garbage collection of all threads, also of later ones, are what they were before."""
    before, taken, after = process(kind)
    assert after == before
    assert (taken["frozen"], taken["collects"]) == ((False, True) if kind == "untaken" else (True, False))
    if kind == "guard":
        assert taken["cores"] == before["cores"], "it must run when its daemon spins"
