"""`python -m gateway.sim.physics.filming`: a film of a running simulation's scene, as a program of its own.

Asks the simulation for positions, draws them and writes an MP4 file whose pictures have the times of the clock: what is
too slow here gives fewer pictures, never a slower film, and how many is said at the end. It leaves the processor to the
robot. Ends with SIGINT, SIGTERM, the simulation, or its parent.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

from gateway.sim.companion import until_told
from gateway.sim.physics.drawing import Drawing, DrawingMissing
from gateway.sim.reaching import reached
from gateway.sim.remote import SimControl, SimUnreachable
from gateway.sim.robot.manual import S

__all__ = ["Movie", "command_line", "main"]

_TICKS_PER_S: Final = 1000


def command_line() -> argparse.ArgumentParser:
    """Return what can be said about a film on a command line."""
    parser = argparse.ArgumentParser(prog="python -m gateway.sim.physics.filming", description="Films a simulation.")
    parser.add_argument("--at", required=True, metavar="ENDPOINT", help="where the simulation listens")
    parser.add_argument("--to", required=True, type=Path, metavar="FILE", help="the film, *.mp4; overwritten")
    parser.add_argument("--rate", type=int, default=25, metavar="HZ", help="pictures per second at most (default: 25)")
    parser.add_argument("--parent", type=int, metavar="PID", help="end when this process is no longer the parent")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Film until told to stop; return the exit status.

    Args:
        arguments: Without the program's name; None for this process's own.
    """
    options = command_line().parse_args(arguments)
    with until_told(options.parent) as is_over:
        try:
            os.nice(19)
            with reached(options.at, is_over) as control:
                _film(control, options, is_over)
        except (DrawingMissing, OSError, ValueError) as error:
            sys.stderr.write(f"film: {error}\n")
            return 1
    return 0


def _film(control: SimControl, options: argparse.Namespace, is_over: Callable[[], bool]) -> None:
    has_lift = control.ask("ping")["model"] == "lift"
    with Drawing(has_lift=has_lift) as drawing, Movie(options.to, drawing.width, drawing.height) as movie:
        _say(
            f"{drawing.width}x{drawing.height}, at most {options.rate} Hz, drawn by {drawing.backend}, to {options.to}"
        )
        begin_ns = due_ns = time.monotonic_ns()
        while not is_over():
            try:
                positions: Any = control.ask("world")["positions"]
            except SimUnreachable:  # it has ended
                break
            movie.add(drawing.draw(positions), time.monotonic_ns() - begin_ns)
            due_ns += S // options.rate
            ahead_ns = due_ns - time.monotonic_ns()
            if ahead_ns > 0:
                time.sleep(ahead_ns / S)
            else:
                due_ns -= ahead_ns
        seconds = (time.monotonic_ns() - begin_ns) / S
    _say(f"{movie.pictures} pictures in {seconds:.1f} s ({movie.pictures / max(seconds, 1e-9):.1f} Hz)")


class Movie:
    """An MP4 file of H.264 pictures with times of their own; whole when `with` ends.

    Args:
        path: The file; overwritten.
        width: Of its pictures [pixels].
        height: The same.

    Attributes:
        pictures: Written so far.

    Raises:
        ValueError: PyAV is not installed.
    """

    def __init__(self, path: Path, width: int, height: int) -> None:
        try:
            import av
        except ModuleNotFoundError:
            raise ValueError("a film is written with PyAV: pip install 'teleavatar-gateway[video]'") from None
        self.pictures = 0
        self._container = av.open(str(path), "w", format="mp4")
        stream: Any = self._container.add_stream("libx264", rate=25, options={"preset": "veryfast", "crf": "25"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = Fraction(1, _TICKS_PER_S)
        self._stream, self._last = stream, -1
        self._frame_of = av.VideoFrame.from_ndarray

    def add(self, picture: Any, at_ns: int) -> None:  # noqa: ANN401  an array; PyAV has its own idea of which
        """Write a picture of a time since the beginning [ns]."""
        frame = self._frame_of(picture, format="rgb24")
        self._last = frame.pts = max(self._last + 1, at_ns * _TICKS_PER_S // S)
        frame.time_base = Fraction(1, _TICKS_PER_S)
        self._container.mux(self._stream.encode(frame))
        self.pictures += 1

    def __enter__(self) -> Movie:
        return self

    def __exit__(self, *_: object) -> None:
        if self.pictures:
            self._container.mux(self._stream.encode(None))
        self._container.close()


def _say(text: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        sys.stdout.write(f"film: {text}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
