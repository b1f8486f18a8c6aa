"""`ta2 replay`: what the arms of a recording were told, told again: judged whole, approached, followed, and measured beside it.

As any motion: with lease, limits, arms kept apart, and a factor of time. Grippers, chassis and lift stay as they are.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from argparse import Namespace
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gateway.cli.motion.following import Way, follow
from gateway.cli.motion.passing import Passing
from gateway.cli.motion.recording import Recording
from gateway.cli.terminal.ending import ExitStatus
from gateway.client import FollowCheck, RobotState
from gateway.dataset.resample import resample
from gateway.dataset.rows import stretches
from gateway.dataset.series import Series, read_series
from gateway.errors import Code, GatewayError, failure
from gateway.process.own_module import own_module
from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import needed
from gateway.recording.episodes import Episode, episodes
from gateway.recording.topics import STALE_NS
from gateway.robot.topics import arm_state, joint_command
from gateway.values import Side

__all__ = ["Replay", "carry_out", "recorded"]

DT_S = 0.02
"""From point to point [s]: a setpoint is told a hundred times a second, and is a smooth way."""
FIELD = "position"
PICTURES = (".png", ".svg", ".pdf")
END_S = 5.0
"""A view that is to end may take so long [s]."""
NICE = 10
"""How far a view steps back behind whoever moves the robot."""

Joints = Mapping[str, NDArray[np.float64]]
"""Per side joints [rad], shape (N, 7)."""


def carry_out(options: Namespace) -> ExitStatus:
    """Replay a bag, or have it judged.

    Raises:
        GatewayError: Nothing was begun.
    """
    plot = _plot_of(options)
    recording, measured, rest_s = recorded(Path(options.bag), options.episode, options.arm)
    approach = options.speed if options.approach else None
    passing = Passing(
        arm=options.arm, stretch=options.stretch, smoothing_s=options.smoothing, approach=approach, dt_s=DT_S
    )
    replay = Replay(recording, passing, measured, rest_s)
    try:
        with _view(options):
            return follow(options, replay)
    finally:
        if plot is not None and (rows := replay.rows()):  # also of one that broke off
            from gateway.cli.motion.replay_plot import write_plot

            try:
                write_plot(rows, plot)
            except OSError as error:
                print(f"no picture: {plot}: {error.strerror or error}", file=sys.stderr)


def _plot_of(options: Namespace) -> Path | None:
    """Return where to draw; whatever is in its way is said before anything moves."""
    if options.plot is None and not options.view:
        return None
    if options.check:
        raise _refused("with --check nothing moves: there is nothing to draw", "leave out --check", "check")
    if options.view:
        needed("rerun", "view")
    if options.plot is None:
        return None
    needed("matplotlib", "demo")
    if options.plot.suffix not in PICTURES or not options.plot.parent.is_dir():
        raise _refused(f"{options.plot} cannot be drawn", f"{', '.join(PICTURES)} in a folder that is there", "plot")
    return Path(options.plot)


@contextmanager
def _view(options: Namespace) -> Iterator[None]:
    """Have a `ta2 view` beside, where that is asked for: a process of its own, whose hanging or dying changes nothing here."""
    if not options.view:
        yield
        return
    words = ["view"] if options.target is None else ["view", "--socket", options.target]
    quiet, command = subprocess.DEVNULL, own_module("gateway.cli", *words)
    view = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True)
    os.setpriority(os.PRIO_PROCESS, view.pid, max(NICE, os.getpriority(os.PRIO_PROCESS, 0)))
    try:
        yield
    finally:
        view.terminate()
        try:
            view.wait(END_S)
        except subprocess.TimeoutExpired:
            with suppress(ProcessLookupError):
                os.killpg(view.pid, signal.SIGKILL)
            view.wait()


def recorded(path: Path, episode: int | None = None, arm: str = "") -> tuple[Recording, Joints, float]:
    """Return what the arms of a bag were told, as points 20 ms apart, and where they were measured at the same times.

    It is the longest piece in which all of them were told without a gap; the third is how much longer any was told [s]. An arm
    that was told nothing in the episode is left out.

    Args:
        path: Of the bag.
        episode: Its number; None for the first that was not discarded.
        arm: `left` or `right` for that one alone, where it was told something.

    Raises:
        Rejected: BAD_REQUEST, it is no bag, has no such episode, or nobody told the arms anything in it.
    """
    with Bag(path) as bag:
        chosen = _episode(bag, path, episode)
        prefix = f"/{bag.facts()['namespace']}" if bag.facts().get("namespace") else ""
        told = {side.value: prefix + joint_command(side) for side in Side}
        seen = {side.value: prefix + arm_state(side) for side in Side}
        series = read_series(bag, [(topic, FIELD) for topic in (*told.values(), *seen.values())])
    ways = {side: series[topic, FIELD] for side, topic in told.items() if (topic, FIELD) in series}
    if not ways:
        hint = "record while the gateway moves the arms in joint mode"
        raise _refused(f"{path}: nobody told the arms where to go (joint mode)", hint)
    count = max(0, int((chosen.end_ns - chosen.begin_ns) / 1e9 / DT_S))
    times_ns = chosen.begin_ns + np.rint(np.arange(count) * DT_S * 1e9).astype(np.int64)
    found = {side: resample(one, times_ns, "linear", STALE_NS) for side, one in ways.items()}
    found = {side: one for side, one in found.items() if one[1].any()}
    if arm in found:
        found = {arm: found[arm]}
    there = np.array([ok for _, ok in found.values()], dtype=np.bool_).reshape(len(found), count)
    is_any = np.logical_or.reduce(there)
    ok = np.logical_and.reduce(there) & is_any
    first, last = max(stretches(ok), key=lambda run: run[1] - run[0], default=(0, 0))
    if last - first < 2:
        raise _refused(f"{path}: episode {chosen.number} has no two points in a row", "see `ta2 bag info`")
    measured = {side: _measured(series.get((seen[side], FIELD)), times_ns[first:last]) for side in found}
    rows = {side: points[first:last] for side, (points, _) in found.items()}
    rest_s = DT_S * (int(is_any.sum()) - (last - first))
    return Recording(path=path, points=rows, dt_s=DT_S, space="joint"), measured, rest_s


def _episode(bag: Bag, path: Path, number: int | None) -> Episode:
    there = episodes(bag)
    for episode in there:
        if episode.number == number or (number is None and not episode.is_discarded):
            return episode
    what = "no episode that was not discarded" if number is None else f"no episode {number}"
    raise _refused(f"{path} has {what}, but {len(there)} in all", "`ta2 bag info` lists them")


def _measured(series: Series | None, times_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return where an arm was at the times, NaN where nobody knows."""
    if series is None:
        return np.full((len(times_ns), 7), np.nan)
    values, ok = resample(series, times_ns, "linear", STALE_NS)
    return np.where(ok[:, np.newaxis], values, np.nan)


class Replay(Way):
    """A way that was recorded, and how far the arms are from where they were then."""

    def __init__(self, recording: Recording, passing: Passing, measured: Joints, rest_s: float) -> None:
        super().__init__(recording, passing)
        self._rest_s = rest_s
        self._measured = {side: measured[side] for side in self.points}
        self._step_s = DT_S * passing.stretch
        self._off_rad: list[float] = []
        self._rows: dict[str, list[NDArray[np.float64]]] = {side: [] for side in self.points}

    @property
    def in_other_mode(self) -> str:
        """What to use for an arm that is in end-effector mode, in words: only joints are replayed."""
        return "--arm for one in joint mode"

    def description(self, judged: FollowCheck) -> Iterator[str]:
        """Yield in words what was judged, and what of the recording is left out."""
        yield from super().description(judged)
        if round(self._rest_s, 1):
            yield f"  its longest piece without a gap; {self._rest_s:.1f} s more that were told are left out"

    def _see(self, state: RobotState, now_s: float) -> None:
        place = now_s / self._step_s
        if not 0.0 <= place <= len(next(iter(self._measured.values()))) - 1:
            return
        before, share = int(place), place - int(place)
        for side, rows in self._measured.items():
            then = rows[before] + share * (rows[min(before + 1, len(rows) - 1)] - rows[before])
            now = state.arm(side).q
            self._rows[side].append(np.array([now_s, *now, *then]))
            off = np.abs(now - then)
            self._off_rad += off[np.isfinite(off)].tolist()

    def rows(self) -> dict[str, NDArray[np.float64]]:
        """Return per side what was seen, shape (N, 15): time [s], joints now and then [rad]; nothing before it was begun."""
        return {side: np.array(rows) for side, rows in self._rows.items() if rows}

    def figures(self) -> dict[str, object]:
        """Return the same as of any way, what is left out [s], and how far from the recorded one it was: RMS and most [rad]."""
        off = np.array(self._off_rad)
        beside = {"rms_rad": float(np.sqrt(np.mean(off**2))), "most_rad": float(off.max())} if len(off) else {}
        return super().figures() | {"left_out_s": round(self._rest_s, 2)} | beside

    def remark(self) -> str:
        """Return the same in words."""
        figures = self.figures()
        if "rms_rad" not in figures:
            return super().remark()
        beside = f", {figures['rms_rad']:.4f} rad RMS from the recording, {figures['most_rad']:.4f} at most"
        return super().remark() + beside


def _refused(message: str, hint: str, field: str = "bag") -> GatewayError:
    return failure(Code.BAD_REQUEST, message, field=field, hint=hint)
