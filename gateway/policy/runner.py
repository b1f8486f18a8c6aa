"""Plays a policy: asks for the next chunk while the last one plays, and hands each to the gateway, which joins and limits it.

Rules
    * Nothing moves but by chunks and gripper commands of the ordinary client; a chunk that the gateway refuses is left out.
    * When no chunk follows in time, the gateway brakes at the end of the last one, and the next goes on from there.
    * A server that is lost, and chunks that are refused, are borne for `patience_s`; a wrong answer is not: it ends the run.
"""

from __future__ import annotations

import statistics
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Literal, Protocol

from msgspec import Struct, field, structs

from gateway.api.protocol import TouchView
from gateway.client import MotionHandle
from gateway.errors import Aborted, Code, Disconnected, GatewayError, GatewayTimeout, Rejected, Stale
from gateway.policy.asking import Answer, Asking
from gateway.policy.chunks import ROUNDED, Chunk, refused, retry_after_ns

__all__ = ["JUMP_RAD", "Figures", "Hands", "Plan", "Runner", "require_near"]

JUMP_RAD = 0.1
"""The gateway takes no chunk that begins farther from an arm [rad]."""
LOOK_NS = 50_000_000
"""Longest time without a look at the motion [ns]."""
BACK_S = 20.0
"""So long may the way back from a touch take [s]."""
DRIVE_S, DRIVE_AGAIN_NS = 0.3, 90_000_000
"""So long does a velocity of chassis or lift count that has no successor [s]; so often is one sent that stays the same [ns]."""
TOLD_STEPS = 100
"""Joints of longer chunks are not noted: a recorder takes no more in one packet."""
GRIP_STEP = 0.005
"""A smaller change of a gripper's command is not sent."""
BORNE = frozenset({Code.TOO_FAST, Code.JUMP_TOO_FAR, Code.CANNOT_JOIN, Code.TOO_LATE, Code.OUT_OF_RANGE})
"""What may be wrong with a chunk while the next one is good."""
SLOWER = "run it slower with --hz, or smoother with --smoothing; --dry shows what each chunk asks for"


class Hands(Protocol):
    """What moves: the owner's client, or one that only looks."""

    def follow(self, chunk: Chunk, late_s: float, smoothing_s: float) -> MotionHandle | None:
        """Follow a chunk whose step 0 was so long ago [s]; return its motion, None where nothing moves."""

    def approach(self, joints: Mapping[str, Any]) -> TouchView | None:
        """Move the arms to joints [rad], and wait until they are there; return the touch at which they ended before."""

    def grip(self, side: str, command: float) -> None:
        """Tell a gripper its command, 0..1."""

    def drive(self, part: str, velocity: Sequence[float]) -> None:
        """Tell `chassis` or `lift` a velocity that counts for `DRIVE_S`; see `Chunk.drives`."""


class Plan(Struct, frozen=True, kw_only=True):
    """How a policy is played.

    Attributes:
        seconds: How long [s]; None until somebody ends it.
        horizon: Steps of a chunk that are played before the next one should be there; 0 for half of it.
        smoothing_s: Jitter is averaged over so much time on each side of a step [s].
        patience_s: How long lost servers and refused chunks are borne [s].
        drive_bounds: Greatest speed of the chassis over the ground [m/s], of its turning [rad/s], of the lift (a part).
        far: What is done about a first step that is far away: `refuse`, `approach` it first, or `follow` it all the same.
    """

    seconds: float | None
    horizon: int
    smoothing_s: float
    patience_s: float
    far: Literal["refuse", "approach", "follow"]
    drive_bounds: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Figures(Struct):
    """How well the server keeps up."""

    chunks: int = 0
    refused: int = 0
    steps_dropped: int = 0
    underruns: int = 0
    lost: int = 0
    chunk_age_s: float = 0.0
    worst_s: float = 0.0
    recent_s: deque[float] = field(default_factory=lambda: deque(maxlen=1000))

    @property
    def p50_s(self) -> float:
        """Median of the latest answers' delays [s]."""
        return statistics.median(self.recent_s) if self.recent_s else 0.0

    def facts(self) -> dict[str, Any]:
        """Return them for scripts."""
        delays = {"p50": round(self.p50_s * 1e3, 1), "worst": round(self.worst_s * 1e3, 1)}
        names = ("chunks", "refused", "steps_dropped", "underruns", "lost")
        return {"inference_ms": delays, **{name: getattr(self, name) for name in names}}

    def line(self) -> str:
        """Return them for people."""
        return (
            f"{self.chunks} chunks, inference {self.p50_s * 1e3:.0f} ms (worst {self.worst_s * 1e3:.0f}), chunk "
            f"{self.chunk_age_s:.2f} s old, {self.steps_dropped} steps dropped, {self.underruns} underruns, "
            f"{self.refused} refused, server lost {self.lost} times"
        )


def require_near(answer: Answer, now_ns: int) -> None:
    """Refuse a chunk that begins too far from where the arms were measured.

    Raises:
        Rejected: JUMP_TOO_FAR, with the joint.
    """
    gap_rad, side, joint = answer.chunk.gap(now_ns, answer.observation.measured)
    if gap_rad > JUMP_RAD:
        message = (
            f"the policy begins {gap_rad:.3f} rad from the {side} arm's joint {joint}; {JUMP_RAD} rad is the bound"
        )
        hint = "bring the arms to where its demonstrations begin, or let it: --approach"
        place = f"{side}_arm[{joint - 1}]"
        raise refused(Code.JUMP_TOO_FAR, message, f"{gap_rad:.4g}", f"{JUMP_RAD}", field=place, hint=hint)


class Runner:
    """Plays until its time is over.

    Args:
        asking: Asks the server.
        hands: Move.
        plan: How.
        say: Is told what a person should read.
        show: Is told how far it is, 0..1, and the figures.
        now_ns: The monotonic clock [ns].
        note: Is told each chunk, and what became of it, as facts for JSON; must not wait. See docs/how-to/policy.md.
    """

    def __init__(
        self,
        asking: Asking,
        hands: Hands,
        plan: Plan,
        say: Callable[[str], None],
        show: Callable[[float | None, str], None],
        now_ns: Callable[[], int] = time.monotonic_ns,
        note: Callable[[Mapping[str, object]], None] = lambda facts: None,
    ) -> None:
        self.figures = Figures()
        self._asking, self._hands, self._plan = asking, hands, plan
        self._say, self._show, self._now_ns, self._note = say, show, now_ns, note
        self.touch: TouchView | None = None
        """The touch that ended it, where it was to end at one."""
        self._chunk: Chunk | None = None
        self._way: Chunk | None = None
        """What the arms follow of it: joined to the one before."""
        self._motion: MotionHandle | None = None
        self._plays = False
        self._is_asked, self._failures = False, 0
        self._retry_ns = self._trouble_ns = 0
        self._trouble: GatewayError | None = None
        self._gripped: dict[str, float] = {}
        self._driven: dict[str, tuple[tuple[float, ...], int]] = {}
        self._ordered_ns = self._begun_ns = self._number = self._played = 0
        """When the policy was asked last, when the chunk that plays began, how many chunks came, and which one plays."""

    @property
    def playing(self) -> Chunk | None:
        """The chunk that plays, or would; None for none."""
        chunk = self._chunk if self._plays else None
        return None if chunk is None or chunk.is_over(self._now_ns()) else chunk

    def run(self) -> None:
        """Play.

        Raises:
            GatewayError: What ended it before its time; the arms brake, or are held.
        """
        try:
            self._run()
        except GatewayError as ended:
            self._over(ended.code)
            raise
        finally:  # Ctrl-C, too
            self._over("END")

    def _run(self) -> None:
        began_ns, seconds = self._now_ns(), self._plan.seconds
        while self.touch is None and (now_ns := self._now_ns()) - began_ns < (seconds or float("inf")) * 1e9:
            if not self._is_asked and now_ns >= max(self._retry_ns, self._ask_ns()):
                self._asking.order()
                self._is_asked, self._ordered_ns = True, now_ns
            self._grip(now_ns)
            self._drive(now_ns)
            answer = self._asking.answer(self._rest_ns(now_ns) / 1e9)
            now_ns = self._now_ns()
            if answer is not None:
                self._is_asked = False
                if isinstance(answer, GatewayError):
                    self._bear_loss(answer, now_ns)
                else:
                    self._take(answer, now_ns)
            self._watch()
            if self._trouble is not None and now_ns - self._trouble_ns > self._plan.patience_s * 1e9:
                raise self._trouble
            if self._chunk is not None:
                self.figures.chunk_age_s = (now_ns - self._chunk.observed_ns) / 1e9
            self._show(None if seconds is None else min(1.0, (now_ns - began_ns) / 1e9 / seconds), self.figures.line())

    def _ask_ns(self) -> int:
        if self._chunk is None or not self._plays:
            return 0
        horizon = self._plan.horizon or (self._chunk.steps + 1) // 2
        return self._chunk.ask_ns(horizon, round(self.figures.p50_s * 1e9))

    def _rest_ns(self, now_ns: int) -> int:
        """Return how long nothing is to be done but to wait for an answer [ns]."""
        rest_ns = LOOK_NS
        if not self._is_asked:
            rest_ns = min(rest_ns, max(self._retry_ns, self._ask_ns()) - now_ns)
        if self._chunk is not None and (self._chunk.grips or self._chunk.drives):
            rest_ns = min(rest_ns, self._chunk.period_ns - (now_ns - self._chunk.observed_ns) % self._chunk.period_ns)
        return max(0, rest_ns)

    def _take(self, answer: Answer, now_ns: int) -> None:
        chunk, figures = answer.chunk, self.figures
        late_s = (now_ns - chunk.observed_ns) / 1e9
        figures.recent_s.append(answer.delay_ns / 1e9)
        figures.worst_s = max(figures.worst_s, answer.delay_ns / 1e9)
        try:
            if self._chunk is None and self._plan.far != "follow" and not chunk.is_over(now_ns):
                require_near(answer, now_ns)
        except Rejected as far:
            self._tell(answer, now_ns, far.code)
            if self._plan.far == "refuse":
                raise
            self._plan = structs.replace(self._plan, far="refuse")
            self._say(f"{far.message}: moved there first")
            row = chunk.row(now_ns)
            self.touch = self._hands.approach({side: joints[row] for side, joints in chunk.arms.items()})
            return
        try:
            if chunk.is_over(now_ns):
                message = f"the policy's {chunk.steps} steps had passed when they came, {late_s:.2f} s after it looked"
                raise refused(Code.TOO_LATE, message, hint="ask a faster server, or one with longer chunks")
            chunk.require_drivable(*self._plan.drive_bounds)
            motion, led = self._follow(chunk, now_ns)
        except Rejected as error:
            self._tell(answer, now_ns, error.code)
            if error.code not in BORNE:
                raise
            figures.refused += 1
            figures.steps_dropped += chunk.steps
            too_fast = error.code is Code.TOO_FAST
            self._bear(Rejected(replace(error.refusal, hint=SLOWER)) if too_fast else error, now_ns)
            return
        except Aborted as error:
            self._tell(answer, now_ns, error.code)
            if error.code is not Code.CONTACT or self._motion is None:
                raise
            return  # it was under way when the hand was touched; how the motion ended is about to be seen
        self._over("SUPERSEDED")
        self._tell(answer, now_ns, "ACCEPTED" if motion is not None else "NOT_PLAYED")
        self._begun_ns, self._played = now_ns, self._number
        if self._trouble is not None:
            self._say("the policy plays again")
        self._chunk, self._motion, self._trouble, self._failures = chunk, motion, None, 0
        self._plays = True
        figures.chunks += 1
        figures.steps_dropped += chunk.passed(now_ns) if motion is None else max(0, motion.skipped - led)

    def _tell(self, answer: Answer, now_ns: int, verdict: str) -> None:
        """Note a chunk, and what the gateway said to it."""
        chunk, self._number = answer.chunk, self._number + 1
        facts: dict[str, object] = {"event": "chunk", "number": self._number, "verdict": verdict, "steps": chunk.steps}
        facts |= {"asked_ns": self._ordered_ns, "observed_ns": chunk.observed_ns, "arrived_ns": now_ns}
        facts |= {"delay_ns": answer.delay_ns, "period_ns": chunk.period_ns}
        if chunk.steps <= TOLD_STEPS:
            facts["arms"] = {side: q.round(4).tolist() for side, q in chunk.arms.items()}
        self._note(facts)

    def _over(self, why: str) -> None:
        """Note that the chunk that plays is over, if one does."""
        if self._chunk is not None and self._plays:
            now_ns, chunk = self._now_ns(), self._chunk
            steps = 0 if self._motion is None else chunk.passed(now_ns) - chunk.passed(self._begun_ns)
            self._note({"event": "end", "number": self._played, "why": why, "steps_played": steps, "ended_ns": now_ns})
        self._plays = False

    def _follow(self, chunk: Chunk, now_ns: int) -> tuple[MotionHandle | None, int]:
        """Hand a chunk to the gateway, joined to what plays if that is taken; return its motion, and how many steps lead it."""
        smoothing_s = chunk.smoothing_s(self._plan.smoothing_s)
        joined = chunk.joined_to(self._way if self._motion is not None else None, now_ns, smoothing_s)
        if joined is not chunk:
            with suppress(
                Rejected
            ):  # they differ by more than can be faded: then the gateway joins them, or says why not
                motion = self._hands.follow(joined, (now_ns - joined.observed_ns) / 1e9, smoothing_s)
                self._way = joined
                return motion, joined.steps - chunk.steps
        motion = self._hands.follow(chunk, (now_ns - chunk.observed_ns) / 1e9, smoothing_s)
        self._way = chunk
        return motion, 0

    def _bear_loss(self, error: GatewayError, now_ns: int) -> None:
        is_lost = isinstance(error, (Disconnected, GatewayTimeout)) and error.field == "server"
        if not (is_lost or isinstance(error, Stale)):
            raise error
        self._note({"event": "error", "code": error.code, "message": error.message, "asked_ns": self._ordered_ns})
        self.figures.lost += is_lost and self._failures == 0
        self._bear(error, now_ns)

    def _bear(self, error: GatewayError, now_ns: int) -> None:
        if self._trouble is None:
            self._trouble_ns = now_ns
        if self._trouble is None or self._trouble.code is not error.code:
            self._say(f"{error.code}: {error.message}; borne for {self._plan.patience_s:g} s")
        self._trouble, self._failures = error, self._failures + 1
        self._retry_ns = now_ns + retry_after_ns(self._failures)

    def _watch(self) -> None:
        """See whether the motion has ended: for want of a successor, or for what ends the run."""
        if self._motion is None or not self._motion.done:
            return
        try:
            self.touch = self._motion.result(BACK_S).touch
        except Aborted as ended:
            if ended.code is not Code.UNDERRUN:
                raise
            self.figures.underruns += 1
            self._say("no chunk came in time: the arms brake and hold")
        self._over("UNDERRUN" if self.touch is None else "CONTACT")
        self._motion = None

    def _grip(self, now_ns: int) -> None:
        """Tell the grippers what is due; the last command stays while no chunk plays."""
        if self._chunk is None or not self._plays:
            return
        row = self._chunk.row(now_ns)
        for side, commands in self._chunk.grips.items():
            command = float(commands[row])
            if abs(command - self._gripped.get(side, -1.0)) > GRIP_STEP:
                self._hands.grip(side, command)
                self._gripped[side] = command

    def _drive(self, now_ns: int) -> None:
        """Tell chassis and lift what is due, again before it expires, and zero where no chunk plays."""
        chunk = self.playing
        for part, velocities in self._chunk.drives.items() if self._chunk is not None else ():
            rest = (0.0,) * velocities.shape[1]
            velocity = (
                rest if chunk is None else tuple((velocities[chunk.row(now_ns)] * (1.0 - 2.0 * ROUNDED)).tolist())
            )
            last, sent_ns = self._driven.get(part, (rest, 0))
            if velocity != last or (any(velocity) and now_ns - sent_ns > DRIVE_AGAIN_NS):
                self._hands.drive(part, velocity)
                self._driven[part] = velocity, now_ns
