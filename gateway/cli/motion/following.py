"""`ta2 follow`: a recorded trajectory, judged whole before anybody is asked, then followed; or only judged, with `--check`.

Rules
    * The gateway judges, here is only said where in the file a point stands that it refuses.
    * A long recording goes as several requests, each while the one before is followed: the arms do not stop in between. All of
      it is judged before the first one.
    * Nothing brings an arm to the beginning but `--approach`: a motion of its own, announced as one.
"""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from msgspec.structs import replace

from gateway.cli.motion.job import PROGRESS_HZ, Stage, after, move, require_mode, watched
from gateway.cli.motion.passing import Part, Passing, chosen, cut, dt_of, located, space_of
from gateway.cli.motion.recording import Recording, read
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus
from gateway.cli.terminal.owning import LOOK_S
from gateway.cli.terminal.progress import Teller
from gateway.client import Control, FollowCheck, MotionHandle, MotionResult, PoseTarget, Robot, RobotState
from gateway.client.asking.chunks import Wishes
from gateway.errors import Aborted, Code, Refused, failure

__all__ = ["Way", "carry_out", "follow"]

AHEAD_S = 6.0
"""A part is asked for when it begins in less than this [s]; the gateway takes it up to 10 s ahead."""
BEGUN_S = 0.1
"""... and once the one before it has been followed for so long [s]: one that still waits would be replaced."""


class Way:
    """A recording as a task of `job`.

    Raises:
        Rejected: The file has not what was asked for.
    """

    def __init__(self, recording: Recording, passing: Passing) -> None:
        self._recording = recording
        self._passing = passing
        self.points = chosen(recording, passing.arm)
        self.space = space_of(recording, passing.space)
        self.dt_s = dt_of(recording, passing.dt_s)
        self._parts = tuple(cut(self.points, recording.times_s, self.dt_s, passing.stretch))
        self.duration_s = 0.0
        """From the first point to the last [s]; known once it was judged."""
        self._moved = 0.0
        self._skipped = 0

    # ------------------------------------------------------------------------------------------------ as requests

    def _wishes(self, part: Part) -> Wishes:
        passing = self._passing
        wishes: Wishes = {
            "stretch": passing.stretch,
            "smoothing": passing.smoothing_s,
            "open_end": not part.is_last,
            "path_tolerance": passing.path_tolerance,
        }
        if part.times_s is not None:
            wishes["times"] = part.times_s
        if self.space == "pose":
            wishes["frames"] = {side: f"{side}_shoulder_base" for side in part.points}
        if part.is_last:
            wishes["goal_tolerance"] = passing.goal_tolerance
        if part.first == 0:
            wishes["start_at"], wishes["start_in"] = passing.start_at_s, passing.start_in_s
        return wishes

    @property
    def in_other_mode(self) -> str:
        """What to use for an arm that is in the other control mode, in words."""
        return f"a recording with --space {'joint' if self.space == 'pose' else 'pose'}"

    def judge(self, robot: Robot) -> FollowCheck:
        """Have all of it judged by the gateway, and the arms' control modes; return what it says of the beginning.

        Raises:
            NotReady: An arm is in the other control mode.
            Rejected: With the first point and number to blame, and where it stands in the file.
            Stale: Nobody knows where an arm is.
        """
        for side in self.points:
            require_mode(side, robot.state, is_pose=self.space == "pose", remedy=self.in_other_mode)
        checks: list[FollowCheck] = []
        for part in self._parts:
            from_here = part.first == 0 and self._passing.approach is None
            with located(self._recording, part.first):
                checks.append(robot.check_follow(part.points, self.dt_s, from_here=from_here, **self._wishes(part)))
        self.duration_s = self._parts[-1].begins_s + checks[-1].duration
        self._moved, self._skipped = max(judged.moved for judged in checks), checks[0].skipped
        return checks[0]

    # ------------------------------------------------------------------------------------------------ as a task

    def preview(self, robot: Robot, options: Namespace) -> Iterator[str]:
        """Yield what will be followed and where it begins; all of it is judged before.

        Raises:
            NotReady: An arm is in the other control mode.
            Rejected: What the gateway refuses, with its place in the file.
        """
        yield from self.description(self.judge(robot))
        yield f"  then the arms are {after(options)}"

    def description(self, judged: FollowCheck) -> Iterator[str]:
        """Yield in words what was judged."""
        arms, name = " and ".join(self.points), self._recording.path.name
        yield f"follow: {arms} through {len(self._recording)} points of {name}, {self.duration_s:.1f} s"
        if self._moved:
            yield f"  smoothing moves a number by {self._moved:.4f} at most"
        for side in self.points:
            away = judged.away.get(side)
            if away is None:
                where = "begins nobody knows how far away"
            elif self.space == "pose":
                where = f"begins {away[0] * 1e3:.0f} mm and {away[1]:.3f} rad away"
            else:
                where = f"begins {max(away):.3f} rad away"
            going = (
                ""
                if self._passing.approach is None
                else f": moved there first, at {self._passing.approach:g} of full speed"
            )
            yield f"  {side + ' arm':<9} {where}{going}"

    @property
    def stages(self) -> Sequence[Stage]:
        """To the beginning, where that was asked for; then along it."""
        return (self._follow,) if self._passing.approach is None else (self._approach, self._follow)

    def _approach(self, robot: Robot, own: Control, tell: Teller, timeout_s: float) -> MotionResult:
        speed = self._passing.approach or 1.0
        if self.space == "pose":
            targets = {
                side: PoseTarget(rows[0][:3], rows[0][3:], f"{side}_shoulder_base")
                for side, rows in self.points.items()
            }
            handle = own.move_pose(targets, speed=speed)
        else:
            handle = own.move_to({side: rows[0] for side, rows in self.points.items()}, speed=speed)
        return watched(robot, handle, tell, timeout_s, "approach")

    def _follow(self, robot: Robot, own: Control, tell: Teller, timeout_s: float) -> MotionResult:
        handle = self._ask(own, self._parts[0])
        self._skipped = handle.skipped
        begins_s = handle.begins or 0.0
        for before, part in pairwise(self._parts):
            turn_s = max(before.begins_s + BEGUN_S, part.begins_s - AHEAD_S)
            self._await_turn(robot, handle, tell, begins_s, turn_s)
            try:
                handle = self._ask(own, part, begins_s + part.begins_s)
            except Refused as refused:  # what is under way ends without a successor: the arms brake and hold
                raise Aborted(refused.refusal) from refused
        return self._await_end(robot, handle, tell, begins_s, timeout_s)

    def _ask(self, own: Control, part: Part, start_at_s: float | None = None) -> MotionHandle:
        wishes = self._wishes(part)
        if start_at_s is not None:
            wishes["start_at"] = start_at_s
        with located(self._recording, part.first):
            return own.follow(part.points, self.dt_s, **wishes)

    def _await_turn(self, robot: Robot, handle: MotionHandle, tell: Teller, begins_s: float, turn_s: float) -> None:
        """Wait until the next part may be asked for; raise what ended the one before it."""
        for state in robot.states(max_rate=PROGRESS_HZ, timeout=LOOK_S):
            now_s = state.view.at_ns / 1e9 - begins_s
            self._see(state, now_s)
            tell.advance("follow", *self._progress(now_s))
            if handle.done:
                handle.result()
            if now_s >= turn_s:
                return

    def _await_end(
        self, robot: Robot, handle: MotionHandle, tell: Teller, begins_s: float, timeout_s: float
    ) -> MotionResult:
        for state in robot.states(max_rate=PROGRESS_HZ, timeout=LOOK_S):
            now_s = state.view.at_ns / 1e9 - begins_s
            self._see(state, now_s)
            progress, detail = self._progress(now_s)
            tell.advance("follow", progress, detail if progress < 1.0 or handle.done else f"{detail}, settling")
            if handle.done:
                break
            if now_s > self.duration_s + timeout_s:
                message = f"the arms have not settled {timeout_s:g} s after the last point"
                raise failure(Code.TIMEOUT, message, hint="wait longer with --timeout")
        return replace(handle.result(), duration=self.duration_s)

    def _see(self, state: RobotState, now_s: float) -> None:
        """Be shown a state so long after the first point [s]; for whoever looks on."""

    def _progress(self, now_s: float) -> tuple[float, str]:
        part = min(max(now_s / self.duration_s, 0.0), 1.0)
        return part, f"{part:4.0%}, {min(max(now_s, 0.0), self.duration_s):.1f} of {self.duration_s:.1f} s"

    def figures(self) -> dict[str, object]:
        """Return what was followed, for scripts."""
        return {"points": len(self._recording), "skipped": self._skipped, "moved": self._moved}

    def remark(self) -> str:
        """Return how many points were skipped, in words."""
        return f", {self._skipped} points skipped" if self._skipped else ""


def carry_out(options: Namespace) -> ExitStatus:
    """Follow a file, or have it judged.

    Raises:
        GatewayError: Nothing was begun.
    """
    passing = Passing(
        arm=options.arm,
        space=options.space,
        dt_s=options.dt,
        stretch=options.stretch,
        smoothing_s=options.smoothing,
        start_at_s=options.start_at,
        start_in_s=options.start_in,
        path_tolerance=_one_or_all(options.path_tolerance),
        goal_tolerance=_one_or_all(options.tolerance),
        approach=options.speed if options.approach else None,
    )
    return follow(options, Way(read(Path(options.file)), passing))


def follow(options: Namespace, way: Way) -> ExitStatus:
    """Follow a way; or with `--check` have it judged: nothing moves then, and nobody needs to own the robot.

    Raises:
        GatewayError: Nothing was begun, or what is wrong with it.
    """
    if not options.check:
        return move(options, lambda _: way)
    with connected("follow", options.target, options.timeout_s) as robot:
        judged = way.judge(robot)
    if options.json:
        away = {side: list(values) for side, values in judged.away.items()}
        print(json.dumps({"ok": True, "duration_s": way.duration_s, "away": away, **way.figures()}))
    else:
        print("\n".join([*way.description(judged), "good: the gateway would follow it"]))
    return ExitStatus.OK


def _one_or_all(values: list[float] | None) -> float | list[float] | None:
    """Return one number for all joints as such."""
    return values[0] if values is not None and len(values) == 1 else values
