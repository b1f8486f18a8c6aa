"""`ta2 watch`: the live view. Takes snapshots and notices from the client, draws frames, and ends on q or Ctrl-C.

Rules
    * It only looks: it owns nothing and survives a restart of the gateway, saying meanwhile that there is none.
    * The newest snapshot at most five times a second: a viewer must not cost what it shows.
    * Where the output is no terminal, a line a second and every notice as it comes.
"""

from __future__ import annotations

import time
from argparse import Namespace
from collections import deque
from collections.abc import Iterator
from dataclasses import replace

from rich.console import Console, ConsoleOptions, Group, RenderResult
from rich.live import Live

from gateway.api import protocol
from gateway.cli.looking.frame import Picture, Remark, frame
from gateway.cli.terminal.advice import next_steps
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus, Interrupted, in_shell_words
from gateway.cli.terminal.figures import age_text, fsm_text, rate_text
from gateway.cli.terminal.keys import keys
from gateway.client import Robot, RobotState
from gateway.errors import Code, Disconnected, GatewayError, GatewayTimeout

__all__ = ["Viewer", "carry_out", "plain_line"]

FRAME_HZ = 5.0
LINE_HZ = 1.0
SILENCE_S = 1.0
"""After so long without a snapshot the view says so [s]."""
AWAY_S = 0.5
"""Time between two looks for a gateway that is gone [s]."""
LEAST_LINES = 24
"""A single frame is printed in full even where the terminal is smaller, or none."""
OWN_WORDS = (Code.DISCONNECTED.value, Code.CONNECTED.value)
"""Notices of the client about its connection: the view has its own words for that."""
REMARKS = 500
"""Notices that are kept: more than any terminal shows."""


def carry_out(options: Namespace) -> ExitStatus:
    """Show the live view until q or Ctrl-C.

    Raises:
        Disconnected: No gateway answers at the beginning.
    """
    console = Console(highlight=False)
    with connected("watch", options.target, options.timeout_s) as robot:
        viewer = Viewer(robot)
        try:
            if options.once:
                viewer.look(SILENCE_S)
                least = max(LEAST_LINES, console.height - 1)  # below it the shell's prompt wants a line
                console.print(Group(*frame(replace(viewer.picture(), is_live=False), console.width, least)))
            elif console.is_terminal:
                _show_frames(viewer, console)
            else:
                _print_lines(viewer)
        except Interrupted:
            raise
        except KeyboardInterrupt:
            pass
    return ExitStatus.OK


class Viewer:
    """What is known of a gateway, refreshed by `look`, drawn by rich as a frame of the terminal's size."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._info = robot.info
        self.state = robot.state
        """The newest state."""
        self._seen_ns = time.monotonic_ns()
        self.trouble = ""
        """What is wrong with the view itself; empty when nothing is."""
        self._remarks: deque[Remark] = deque(maxlen=REMARKS)
        self._states: Iterator[RobotState] | None = None
        self._events = robot.events(timeout=0.0)

    def look(self, period_s: float) -> list[Remark]:
        """Wait for a newer snapshot, at most a period apart; return what there is to say since the last look."""
        try:
            self.state = self._next(period_s)
            self._seen_ns = time.monotonic_ns()
            new = [self._heard(notice) for notice in self._events if notice.code not in OWN_WORDS]
            if self.trouble:
                self._info, self.trouble = self._robot.info, ""  # another gateway may have other limits
                new.insert(0, self._remark("info", "the gateway is back"))
        except (Disconnected, GatewayTimeout) as error:
            self._states = None  # an iterator that raised is over
            new = [] if self.trouble else [self._remark("error", f"{error.code}: {error.message}")]
            self.trouble = _trouble(error)
            if isinstance(error, Disconnected):
                time.sleep(AWAY_S)
        self._remarks.extend(new)
        return new

    def _next(self, period_s: float) -> RobotState:
        """Return a snapshot of the last second.

        Raises:
            GatewayTimeout: None came; the one that is known is old.
            Disconnected: The gateway is gone.
        """
        if self._states is None:
            self._states = self._robot.states(max_rate=1.0 / period_s, timeout=max(SILENCE_S, period_s))
            begin = next(self._states)  # it begins with what is known, however old
            if begin.age < SILENCE_S:
                return begin
        return next(self._states)

    def picture(self) -> Picture:
        """Return what is to be seen now."""
        return Picture(
            address=repr(self._robot).removeprefix("<robot at ").partition(" for ")[0],
            info=self._info,
            view=self.state.view,
            since_ns=round(self.state.age * 1e9) + time.monotonic_ns() - self._seen_ns,
            remarks=tuple(self._remarks),
            trouble=self.trouble,
        )

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        height = options.height or console.size.height
        yield Group(*frame(self.picture(), options.max_width, height))

    def _heard(self, notice: protocol.Notice) -> Remark:
        view = self.state.view
        ago_s = (view.at_ns - notice.at_ns) / 1e9 + self.state.age
        return self._remark(notice.level, f"{notice.code}: {notice.message}", max(0.0, ago_s))

    def _remark(self, level: str, text: str, ago_s: float = 0.0) -> Remark:
        return Remark(clock=time.strftime("%H:%M:%S", time.localtime(time.time() - ago_s)), level=level, text=text)


def _trouble(error: GatewayError) -> str:
    if isinstance(error, Disconnected):
        return (
            f"NO GATEWAY: {error.message}; waiting for it, below is the last thing seen -> {in_shell_words(error.hint)}"
        )
    return "NO NEWS from the gateway; below is the last thing seen -> does its process still run?"


# ------------------------------------------------------------------------------------------------------------- terminal


def _show_frames(viewer: Viewer, console: Console) -> None:
    with Live(viewer, console=console, screen=True, auto_refresh=False, transient=True) as live, keys() as pressed:
        while "q" not in pressed.wait(0.0):
            viewer.look(1.0 / FRAME_HZ)
            live.refresh()


# ---------------------------------------------------------------------------------------------------------- plain lines


def _print_lines(viewer: Viewer) -> None:
    while True:
        for remark in viewer.look(1.0 / LINE_HZ):
            print(f"{remark.clock} {remark.level:<7} {remark.text}", flush=True)
        if not viewer.trouble:
            print(f"{time.strftime('%H:%M:%S')} {plain_line(viewer.picture())}", flush=True)


def plain_line(picture: Picture) -> str:
    """Return one line that tells the most."""
    view = picture.view
    age_ns = None if view.link.age_ns is None else view.link.age_ns + picture.since_ns
    parts = [
        view.shown,
        f"fsm {fsm_text(view.fsm)}",
        f"link {age_text(age_ns) if view.link.up else 'down'}",
        f"owner {view.lease.name if view.lease.owned else 'nobody'}",
    ]
    for side, arm in view.arms.items():
        if arm.tracking_rad is not None:
            off_m = "" if arm.tracking_m is None else f"{arm.tracking_m * 1e3:.1f} mm, "
            parts.append(f"{side} off by {off_m}{arm.tracking_rad:.3f} rad")
    for name, stream in view.streams.items():
        if stream.running and "arm" in name:
            parts.append(f"{name} {rate_text(stream.rate_hz)} Hz gap {age_text(stream.worst_gap_ns)}")
    running = [motion for motion in view.motions if motion.state in ("queued", "executing")]
    parts += [f"motion {motion.motion_id} {motion.progress:.0%}" for motion in running]
    parts += [step.text for step in next_steps(view, picture.info) if step.level == "error"]
    return " | ".join(parts)
