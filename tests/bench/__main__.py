"""`python -m tests.bench`: all benchmarks, each beside its peer; exit status 1 when a goal is missed."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from rich.console import Console

from tests.bench.chunks import chunk_rows
from tests.bench.codec import codec_rows
from tests.bench.collision import collision_rows
from tests.bench.data import data_rows
from tests.bench.fleet import fleet_rows
from tests.bench.guard import crowd_rows, guard_rows
from tests.bench.kinematics import kinematics_rows
from tests.bench.lines import line_rows
from tests.bench.model_check import model_check_rows
from tests.bench.pages import pages_rows
from tests.bench.physics import physics_rows
from tests.bench.policies import dataset_rows, join_rows
from tests.bench.soak import soak_rows
from tests.bench.stop import stop_rows
from tests.bench.table import Row, show
from tests.bench.tick import tick_rows
from tests.bench.video import video_rows
from tests.bench.wire import wire_rows

PARTS = ("codec", "tick", "kinematics", "physics", "wire", "stop", "guard", "video", "data", "web", "fleet")


def main() -> int:
    """Run the chosen parts and print their tables."""
    parser = argparse.ArgumentParser(prog="bin/bench", description=__doc__)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, "soak", []], help="which; all but soak by default")
    parser.add_argument("--seconds", type=float, default=8.0, help="length of each turn [s]")
    parser.add_argument("--minutes", type=float, default=1.0, help="length of the guard's run, and of the soak [min]")
    parser.add_argument("--daemons", type=int, default=0, help="the guard: only so many daemons on one core")
    parser.add_argument("--core", type=int, default=0, help="which core")
    parser.add_argument("--stops", type=int, default=150, help="stops under each flood")
    parser.add_argument("--robots", type=int, default=8, help="of the fleet")
    options = parser.parse_args()
    parts = options.parts or PARTS
    console = Console(width=150 if not sys.stdout.isatty() else None)
    rows: list[Row] = []
    if "codec" in parts:
        rows += (found := codec_rows())
        show("codec (best of many rounds, taking turns)", found, console)
    if "tick" in parts:
        rows += (found := [*tick_rows(), *chunk_rows()])
        show("engine (virtual time)", found, console)
    if "kinematics" in parts:
        rows += (found := [*kinematics_rows(), *collision_rows(), *line_rows(), *model_check_rows()])
        show("kinematics", found, console)
    if "physics" in parts:
        rows += (found := physics_rows())
        show("simulated robot with forces (cameras off)", found, console)
    if "wire" in parts:
        with tempfile.TemporaryDirectory(prefix="ta2-bench-") as folder:
            rows += (found := wire_rows(Path(folder)))
        show("over the wire (loopback, real processes)", found, console)
    if "stop" in parts:
        with tempfile.TemporaryDirectory(prefix="ta2-bench-") as folder:
            rows += (found := stop_rows(Path(folder), options.stops))
        show("stops and streams while others flood (loopback, real processes)", found, console)
    if "guard" in parts:
        with tempfile.TemporaryDirectory(prefix="ta2-bench-") as folder:
            if options.daemons:
                rows += (found := crowd_rows(Path(folder), options.minutes, options.daemons, options.core))
            else:
                rows += (found := guard_rows(Path(folder), options.minutes))
        show("the guard (loopback, real processes)", found, console)
    if "video" in parts:
        with tempfile.TemporaryDirectory(prefix="ta2-bench-") as folder:
            rows += (found := video_rows(Path(folder), options.seconds))
        show("video (1280x2720 at 45 fps over loopback, receivers taking turns)", found, console)
    if "data" in parts:
        with tempfile.TemporaryDirectory(prefix="ta2-bench-") as folder:
            rows += (found := [*join_rows(), *dataset_rows(Path(folder)), *data_rows(Path(folder), options.seconds)])
        show("policies, datasets, recording (virtual time; then real processes over loopback)", found, console)
    if "web" in parts:
        with tempfile.TemporaryDirectory(prefix="ta2-bench-") as folder:
            rows += (found := pages_rows(Path(folder), options.seconds))
        show("pages (loopback, real processes)", found, console)
    if "fleet" in parts:
        with tempfile.TemporaryDirectory(prefix="ta2-bench-") as folder:
            rows += (found := fleet_rows(Path(folder), options.robots, options.seconds))
        show("a fleet (loopback, real processes)", found, console)
    if "soak" in parts:
        with tempfile.TemporaryDirectory(prefix="ta2-bench-") as folder:
            rows += (found := soak_rows(Path(folder), options.minutes))
        show("a lab's day (loopback, real processes)", found, console)
    missed = [row.name for row in rows if row.good is False]
    console.print(f"{len(rows)} figures, {len(missed)} goals missed" + (f": {', '.join(missed)}" if missed else ""))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
