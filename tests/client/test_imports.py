"""Tests of how slim the client is: a container with the client alone must work, and a script must start at once."""

from __future__ import annotations

import os
import subprocess
import sys

SCRIPT = """
import sys, time
started = time.perf_counter()
before = set(sys.modules)  # what site-packages load into every interpreter is none of ours
import gateway.client
took = time.perf_counter() - started
ours = {m for m in sys.modules if m.startswith(("gateway.", "cdr_types"))}
print(took)
print(sorted({m.split(".")[0] for m in set(sys.modules) - before} - set(sys.stdlib_module_names)))
rooms = "client", "api", "errors", "codes", "messages", "process.callbacks", "process.threads", "process.zenoh_words", "values"
known = tuple(f"gateway.{m}" for m in rooms)
print(sorted(m for m in ours - {"gateway.process"} if not m.startswith(known)))
print(sorted(m for m in ours if m.startswith("gateway.api")))
print("asyncio" in sys.modules)
"""


def imported():
    """Return what a fresh interpreter says after `import gateway.client`."""
    return subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, timeout=60
    ).stdout.splitlines()


def test_the_client_needs_zenoh_msgspec_and_numpy_alone():
    """No codec, no planner, no terminal library, nothing of the daemon; asyncio only for those who use it."""
    _, packages, ours, api, asyncio = imported()
    allowed = {
        "gateway",
        "msgspec",
        "numpy",
        "zenoh",
        "typing_extensions",
    }
    loaded = {name for name in eval(packages) if not name.startswith(("_", "cython", "numpy"))}
    assert loaded <= allowed
    assert ours == "[]" and asyncio == "False"
    assert set(eval(api)) == {
        f"gateway.api{m}" for m in ("", ".address", ".encoding", ".keys", ".protocol", ".stop_pipe")
    }


TIMES = """
import time
times = [time.process_time()]
import zenoh, msgspec, numpy
times.append(time.process_time())
import gateway.client
times.append(time.process_time())
print(times[1] - times[0], times[2] - times[1])
"""

QUIET_S = 0.06
"""What the three packages take on a machine of usual speed that does nothing else; measured: 0.04 s."""


def test_the_client_is_imported_in_a_tenth_of_a_second():
    """Its own part is smaller than that of the packages it needs; together a tenth of a second, where those leave one.

    Compiled once, as everywhere but where an environment forbids Python to keep what it compiled.
    """
    env = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    runs = [
        subprocess.run(
            [sys.executable, "-c", TIMES], env=env, capture_output=True, text=True, check=True, timeout=60
        ).stdout
        for _ in range(5)
    ]
    packages_s, own_s = (min(column) for column in zip(*(map(float, run.split()) for run in runs), strict=True))
    assert own_s < packages_s, f"own part {own_s:.3f} s, zenoh, msgspec and numpy {packages_s:.3f} s"
    if packages_s < QUIET_S:
        assert packages_s + own_s < 0.1
