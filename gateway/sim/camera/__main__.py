"""`python -m gateway.sim.camera`: the simulated robot's camera as a program of its own, so that it disturbs no control.

It encodes live where the machine is at least twice as fast as the pictures come, and else plays a loop that it encodes
once and keeps in the user's cache folder. With `--scene` its pictures are what the robot's eyes see in a simulation with
forces: as many as this machine draws and encodes, at the times of their triggers, and how many is said every ten seconds.
Ends with SIGINT, SIGTERM, after a time, or with its parent.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from gateway.sim.camera.composite import FULL, Size
from gateway.sim.camera.film import Coded, Film, Interrupted, live
from gateway.sim.camera.handover import HandOvers
from gateway.sim.camera.hevc import Coding, EncoderMissing, Hevc, KeyFrames
from gateway.sim.camera.rig import Rig
from gateway.sim.camera.rtp import PAYLOAD_TYPE
from gateway.sim.camera.sender import DEFAULT_TO, S, Sender, address_of
from gateway.sim.companion import until_told
from gateway.sim.reaching import reached
from gateway.sim.remote import SimUnreachable

__all__ = ["cache_folder", "command_line", "main"]

HEADROOM: Final = 2.0
"""So many times faster than the pictures come must encoding be, to be done live (choice)."""
SCENE_GOP: Final = 4
"""Pictures per group at most when a scene is drawn: there are few in a second, and who joins waits for the first of one."""
TABLE_SLOTS: Final = 1 << 16


def cache_folder() -> Path:
    """Return where loops are kept: `$XDG_CACHE_HOME/ta2`, else `~/.cache/ta2`."""
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (base if base.is_absolute() else Path.home() / ".cache") / "ta2"


def command_line() -> argparse.ArgumentParser:
    """Return what can be said about a simulated camera on a command line."""
    parser = argparse.ArgumentParser(
        prog="python -m gateway.sim.camera", description="The picture stream of a simulated TeleAvatar 2."
    )
    parser.add_argument("--to", type=_address, default=DEFAULT_TO, metavar="HOST:PORT", help="default: %(default)s")
    parser.add_argument("--bind", default="", metavar="ADDRESS", help="send from this local address")
    parser.add_argument("--size", type=_size, default=FULL, metavar="WxH", help="of the composite (default: 1280x2720)")
    parser.add_argument("--rate", type=int, default=45, metavar="HZ", help="pictures per second (default: %(default)s)")
    parser.add_argument("--gop", type=int, default=45, help="pictures per group (default: %(default)s)")
    parser.add_argument("--mbps", type=float, default=20.0, help="bit rate [Mbit/s] (default: %(default)s)")
    parser.add_argument("--key-frames", choices=[kind.value for kind in KeyFrames], default="idr")
    parser.add_argument("--source", choices=("auto", "live", "loop"), default="auto", help="how to encode")
    parser.add_argument("--pictures", type=int, default=90, help="in a loop (default: %(default)s)")
    parser.add_argument("--spread", type=float, default=0.5, help="part of a period in which packets leave")
    parser.add_argument("--payload-type", type=int, default=PAYLOAD_TYPE, help="default: %(default)s")
    parser.add_argument("--scene", metavar="ENDPOINT", help="show the scene of the simulation that listens there")
    parser.add_argument("--seed", type=int, default=0, help="of the patterns (default: %(default)s)")
    parser.add_argument("--table", type=Path, help="file for the time at which each picture was handed over")
    parser.add_argument("--for", dest="for_s", type=float, metavar="SECONDS", help="end after this time")
    parser.add_argument("--nice", type=int, default=0, help="leave the processor to others, 0 to 19")
    parser.add_argument("--parent", type=int, metavar="PID", help="end when this process is no longer the parent")
    return parser


def _size(text: str) -> Size:
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit()):
        raise argparse.ArgumentTypeError(f"{text!r} is no WIDTHxHEIGHT, e.g. 1280x2720")
    return Size(int(width), int(height))


def _address(text: str) -> tuple[str, int]:
    try:
        return address_of(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def main(arguments: Sequence[str] | None = None) -> int:
    """Send pictures until told to stop; return the exit status.

    Args:
        arguments: Without the program's name; None for this process's own.
    """
    options = command_line().parse_args(arguments)
    with until_told(options.parent) as is_unwanted:
        try:
            os.nice(options.nice)
            _send(options, is_unwanted)
        except Interrupted:
            return 0
        except (EncoderMissing, ValueError, OSError) as error:
            if isinstance(error, SimUnreachable) and is_unwanted():  # the robot ended first
                return 0
            sys.stderr.write(f"camera: {error}\n")
            return 1
    return 0


def _send(options: argparse.Namespace, is_unwanted: Callable[[], bool]) -> None:
    coding = Coding(
        width=options.size.width,
        height=options.size.height,
        rate_hz=options.rate,
        gop=options.gop if options.scene is None else min(options.gop, SCENE_GOP),
        bit_rate_bps=int(options.mbps * 1e6),
        key_frames=KeyFrames(options.key_frames),
    )
    with contextlib.ExitStack() as stack:
        table = None if options.table is None else stack.enter_context(HandOvers(options.table, TABLE_SLOTS))
        if options.scene is not None:
            pictures, how = _scene(options, coding, is_unwanted, stack)
        else:
            pictures, how = _pictures(options, coding, is_unwanted)
        sender = Sender(
            options.to,
            pictures,
            options.rate,
            spread=options.spread,
            payload_type=options.payload_type,
            table=table,
            bind=options.bind,
        )
        stack.callback(sender.close)
        host, port = options.to
        _say(f"{coding.width}x{coding.height} at {coding.rate_hz} Hz, {how}, to {host}:{port} (SSRC {sender.ssrc:08x})")
        end_ns = None if options.for_s is None else time.monotonic_ns() + int(options.for_s * S)
        sender.run(lambda: is_unwanted() or (end_ns is not None and time.monotonic_ns() >= end_ns))
        _say(json.dumps(asdict(sender.counts)))


def _pictures(
    options: argparse.Namespace, coding: Coding, is_unwanted: Callable[[], bool]
) -> tuple[Iterator[Coded], str]:
    """Return what to send, and in words where it comes from."""
    seed, folder = options.seed, cache_folder()
    source = options.source
    is_kept = Film.is_kept(coding, options.pictures, seed, folder)
    if source == "auto":
        source = "loop" if is_kept or _encoding_hz(coding, is_unwanted) < HEADROOM * coding.rate_hz else "live"
    if source == "live":
        rig = Rig(Size(coding.width, coding.height), coding.rate_hz, seed)
        return live(coding, rig), "encoded live"
    if not is_kept:
        _say(f"encoding a loop of {options.pictures} pictures once, kept in {folder}")
    film = Film.of(coding, options.pictures, seed=seed, folder=folder, should_stop=is_unwanted)
    return film.play(), f"a loop of {len(film.pictures)} pictures"


def _scene(
    options: argparse.Namespace, coding: Coding, is_unwanted: Callable[[], bool], stack: contextlib.ExitStack
) -> tuple[Iterator[Coded], str]:
    """Return what the robot's eyes see in a running simulation, and in words what draws it."""
    try:
        from gateway.sim.physics.drawing import DrawingMissing  # MuJoCo: only a scene needs it
        from gateway.sim.physics.eyes import Eyes
    except ModuleNotFoundError as error:
        raise ValueError(f"--scene needs {error.name}: pip install 'teleavatar-gateway[sim,video]'") from None
    control = stack.enter_context(reached(options.scene, is_unwanted))
    has_lift = control.ask("ping")["model"] == "lift"

    def positions() -> Sequence[float]:
        told: Any = control.ask("world")["positions"]
        return list(map(float, told))

    try:
        eyes = stack.enter_context(Eyes(positions, has_lift=has_lift, size=options.size))
    except DrawingMissing as error:
        _say(f"test pictures instead of the scene: {error}")
        return _pictures(options, coding, is_unwanted)
    rig = Rig(options.size, coding.rate_hz, options.seed, cameras=eyes.cameras)
    return _counted(live(coding, rig)), f"the scene, drawn by {eyes.backend}"


def _counted(pictures: Iterator[Coded]) -> Iterator[Coded]:
    """Pass pictures on, and say every ten seconds how many come in one."""
    begin_ns, count = time.monotonic_ns(), 0
    for picture in pictures:
        yield picture
        count += 1
        passed_ns = time.monotonic_ns() - begin_ns
        if passed_ns >= 10 * S:
            _say(f"{count * S / passed_ns:.1f} pictures a second")
            begin_ns, count = time.monotonic_ns(), 0


def _encoding_hz(coding: Coding, is_unwanted: Callable[[], bool]) -> float:
    """Return how many pictures per second this machine shoots and encodes, tried with a third of a second's."""
    rig, encoder = Rig(Size(coding.width, coding.height), coding.rate_hz), Hevc(coding)
    count = max(5, coding.rate_hz // 3)
    begin_ns = time.monotonic_ns()
    for counter in range(count):
        picture = rig.shoot(counter)
        if is_unwanted():
            raise Interrupted("while the encoder was tried")
        if picture is not None:
            encoder.encode(picture)
    encoder.finish()
    return count * S / (time.monotonic_ns() - begin_ns)


def _say(text: str) -> None:
    with contextlib.suppress(BrokenPipeError):  # nobody reads any more; the camera goes on
        sys.stdout.write(f"camera: {text}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
