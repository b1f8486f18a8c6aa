"""Video: frames, latency and processor time of our receiver, of libavformat's, and of a GStreamer pipeline in software.

One simulated camera sends all the time; the receivers take turns on its port, several rounds of them, so that whatever else
the machine does meets all three. Latency counts from the hand-over of a picture's first packet to an array that can be
read. Half a period of it is the camera's own pacing.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from tests.bench.processor import favour
from tests.bench.table import Row
from tests.bench.video_gstreamer import MISSING
from tests.e2e.system import ROOT, Process, wait_for
from tests.video.sending import udp_port

__all__ = ["video_rows"]

ROUNDS = 3
LOOP = 90
"""Pictures in the camera's loop: two seconds, far more than any latency."""
LATENCY_GOAL = 0.9
CPU_GOAL = 0.85
OURS: Final = "ours"
LIBAVFORMAT: Final = "libavformat"
GSTREAMER: Final = "GStreamer"


@dataclass(slots=True)
class Measured:
    """What one receiver did, in all rounds."""

    seconds: float = 0.0
    cpu_s: float = 0.0
    frames: int = 0
    lost: int = 0
    unreadable: int = 0
    latencies_ms: list[float] = field(default_factory=list)

    def add(self, told: Mapping[str, float], latencies_ms: Sequence[float]) -> None:
        """Add a round."""
        self.seconds += told["seconds"]
        self.cpu_s += told["cpu_s"]
        self.frames += int(told["frames"])
        self.lost += int(told["lost"])
        self.unreadable += int(told["unreadable"])
        self.latencies_ms += latencies_ms

    @property
    def fps(self) -> float:
        """Pictures per second [1/s]."""
        return self.frames / self.seconds

    @property
    def cpu_ms(self) -> float:
        """Processor time for one picture [ms]: whoever falls behind the camera shows fewer, and is not the cheaper for it."""
        return self.cpu_s / max(self.frames, 1) * 1000

    def latency_ms(self, percent: float) -> float:
        """Return a percentile of the latency [ms]."""
        return float(np.percentile(self.latencies_ms, percent))


def video_rows(folder: Path, seconds: float = 8.0) -> list[Row]:
    """Measure the receivers; some one and a half minutes with GStreamer.

    Args:
        folder: For logs and tables.
        seconds: Length of each receiver's turn [s].
    """
    programs = {
        OURS: [sys.executable, "-m", "tests.bench.video_ours"],
        LIBAVFORMAT: [sys.executable, "-m", "tests.bench.video_libavformat"],
    }
    gstreamer, why_not = _gstreamer()
    if gstreamer:
        programs[GSTREAMER] = gstreamer
    port, table = udp_port(), _table(folder)
    words = ["--to", f"127.0.0.1:{port}", "--source", "loop", "--pictures", str(LOOP), "--table", str(table)]
    camera = Process("camera", ["-m", "gateway.sim.camera", *words], folder)
    try:
        wait_for(lambda: "a loop of" in camera.text() and "SSRC" in camera.text(), "the camera", 180.0, camera.text)
        favour(camera)
        found = {name: Measured() for name in programs}
        for _ in range(ROUNDS):
            for name, command in programs.items():
                told = _run(command, port, table, seconds)
                found[name].add(told, told.pop("latencies_ms"))
    finally:
        camera.end()
        table.unlink(missing_ok=True)
    sent = json.loads(camera.text().rpartition("camera: {")[2].join(("{", "")))
    rows = [row for name in programs if name != OURS for row in _rows(found[OURS], found[name], name)]
    late = sent["late"] / (sent["pictures"] + sent["late"])
    rows.append(
        Row(name="periods that the camera itself missed", ours=f"{late:.1%}", ratio="0 on a machine that is free")
    )
    if not gstreamer:
        rows.append(Row(name="GStreamer in software", ours="", peer=f"not here: {why_not}"))
    return rows


def _table(folder: Path) -> Path:
    """Return where the hand-overs go: in memory where there is such a folder."""
    memory = Path("/dev/shm")
    return (memory if os.access(memory, os.W_OK) else folder) / f"ta2-bench-{os.getpid()}"


def _gstreamer() -> tuple[list[str], str]:
    """Return how GStreamer's receiver is run; nothing and the reason where it cannot be. GST_PYTHON names another Python."""
    reasons = []
    for python in dict.fromkeys(
        filter(None, (os.environ.get("GST_PYTHON"), "/usr/bin/python3", shutil.which("python3")))
    ):
        if not os.access(python, os.X_OK):
            continue
        command = [python, "-m", "tests.bench.video_gstreamer"]
        looked = subprocess.run(
            [*command, "--look"], cwd=ROOT, env=_environment(), capture_output=True, text=True, check=False
        )
        if looked.returncode == 0:
            return command, ""
        if looked.returncode == MISSING:
            reasons.append(f"{python}: {looked.stderr.strip()}")
    return [], "; ".join(reasons) or "no Python of the distribution"


def _run(command: list[str], port: int, table: Path, seconds: float) -> dict[str, object]:
    words = ["--port", str(port), "--table", str(table), "--loop", str(LOOP), "--seconds", str(seconds)]
    ran = subprocess.run(
        [*command, *words],
        cwd=ROOT,
        env=_environment(),
        capture_output=True,
        text=True,
        timeout=seconds + 90,
        check=False,
    )
    if ran.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {ran.returncode}: {ran.stderr.strip()}")
    told: dict[str, object] = json.loads(ran.stdout.splitlines()[-1])
    return told


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def _rows(ours: Measured, peer: Measured, name: str) -> list[Row]:
    is_goal = name == GSTREAMER

    def row(what: str, unit: str, a: float, b: float, goal: float | None = None) -> Row:
        return Row(
            name=f"{what}, ours against {name}",
            ours=f"{a:.1f} {unit}",
            peer=f"{b:.1f} {unit}",
            ratio=f"{a / b:.2f}x" if b else "",
            goal="" if goal is None or not is_goal else f"<= {goal:g}x",
            good=None if goal is None or not is_goal else a <= goal * b,
        )

    lost = ours.lost + ours.unreadable
    return [
        row("frames per second", "fps", ours.fps, peer.fps),
        Row(
            name=f"pictures lost or unreadable, ours against {name}",
            ours=f"{lost} of {ours.frames + ours.lost}",
            peer=f"{peer.lost + peer.unreadable} of {peer.frames + peer.lost}",
            goal="0",
            good=lost == 0,
        ),
        row("latency to the array p50", "ms", ours.latency_ms(50), peer.latency_ms(50), LATENCY_GOAL),
        row("latency to the array p99", "ms", ours.latency_ms(99), peer.latency_ms(99)),
        row("CPU for a picture", "ms", ours.cpu_ms, peer.cpu_ms, CPU_GOAL),
    ]
