"""What every receiver of the video benchmark does with its pictures: which one is it, and how long ago was it handed over.

Imports nothing that the distribution's own Python does not have beside NumPy: GStreamer's bindings live only there.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

from gateway.sim.camera.composite import FULL, crop_box
from gateway.sim.camera.handover import HandOvers
from tests.video.code_reader import read_code

__all__ = ["Watch"]

WARM_UP = 10
"""Pictures before the measurement begins."""
X0, Y0, X1, Y1 = crop_box(FULL, "head_left_eye")


class Watch:
    """Measures one receiver, in its process.

    Args:
        program: Name of the receiver; its arguments are this process's own.
    """

    def __init__(self, program: str) -> None:
        parser = argparse.ArgumentParser(prog=program)
        parser.add_argument("--port", type=int, required=True)
        parser.add_argument("--table", type=Path, required=True)
        parser.add_argument("--loop", type=int, required=True)
        parser.add_argument("--seconds", type=float, required=True)
        options = parser.parse_args()
        self.port: int = options.port
        self._loop: int = options.loop
        self._span_ns = int(options.seconds * 1e9)
        self._table = HandOvers(options.table)
        self._seen = 0
        self._lost = 0
        self._unreadable = 0
        self._before: int | None = None
        self._begin_ns = 0
        self._begin_cpu_ns = 0
        self._latencies_ns: list[int] = []

    def see(self, composite: Any) -> bool:
        """Take in a picture, an array that can be read now; return whether to go on."""
        now_ns = time.monotonic_ns()
        counter = read_code(composite[Y0:Y1, X0:X1])
        self._seen += 1
        if self._seen <= WARM_UP:
            self._before = counter
            self._begin_ns, self._begin_cpu_ns = now_ns, time.process_time_ns()
            return True
        handed = None if counter is None else self._table.find(counter)
        if counter is None or handed is None:
            self._unreadable += 1
        else:
            self._latencies_ns.append(now_ns - handed.sent_ns)
            if self._before is not None:
                self._lost += (counter - self._before - 1) % self._loop
            self._before = counter
        return now_ns - self._begin_ns < self._span_ns

    def tell(self) -> None:
        """Print what was measured, a JSON object."""
        seconds = (time.monotonic_ns() - self._begin_ns) / 1e9
        cpu_s = (time.process_time_ns() - self._begin_cpu_ns) / 1e9
        found = {
            "seconds": seconds,
            "cpu_s": cpu_s,
            "frames": len(self._latencies_ns) + self._unreadable,
            "lost": self._lost,
            "unreadable": self._unreadable,
            "latencies_ms": [round(latency / 1e6, 3) for latency in self._latencies_ns],
        }
        print(json.dumps(found), flush=True)
        sys.stdout.flush()
