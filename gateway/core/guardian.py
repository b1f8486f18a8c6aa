"""The guard's mind: watches the daemon's ticks, and goes on in its place when it is dead or frozen. Pure, like the engine.

    WATCHING -> ACTING -> DONE          the daemon died: held, or ended what was on the wire
                ACTING -> HANDED        a restarted daemon takes the hold over; nothing is sent any more
                HANDED -> DONE, ACTING  it has it; or it died before it had it

Rules (BEHAVIOUR, the guard)
    * Two never write: nothing is sent while the daemon may live. Whoever calls `daemon_ended` has seen its end.
    * What a freeze is: `freeze.py`.
    * A daemon that ended by itself, or had nothing on the wire, has no successor: DONE.
    * The hold lasts 10 s, then everything goes down; then the guard ends.
    * A guard that stood still for a second while it acted (stopped, or the host slept) sends nothing any more: the robot has
      paused by itself (manual §4.7), and whoever commands it since is somebody else. So is one that finds the daemon dead
      for that long (`takeover.py`).
    * A hold that was handed over and not confirmed in time goes down: the daemon that asked for it hangs.

While it acts it is an engine like the daemon's: the same table, streams and gate. It knows no process and no clock.
"""

from __future__ import annotations

from enum import Enum

from msgspec import structs
from msgspec.structs import replace

from gateway.core.engine import Engine, Output
from gateway.core.handover.freeze import FreezeWatch
from gateway.core.handover.takeover import LAST_FRAME_NS
from gateway.core.messages.events import Event, ExitRequested, Suspended, TakenOver
from gateway.core.messages.held import Held
from gateway.core.supervision.supervisor import STREAMING, State
from gateway.robot.limits import FSM_WATCHDOG_NS
from gateway.settings.settings import Settings

__all__ = ["HANDED_NS", "Guardian", "Phase"]

MS = 1_000_000

HANDED_NS = 2 * LAST_FRAME_NS
"""Who was given the hold has it by then, or never [ns]: a setpoint older than half of it is no reference to anybody."""

SILENT = Output(frames=(), replies=(), notices=(), snapshot=None, remembered=None, done=False)


class Phase(str, Enum):
    """What the guard is doing."""

    WATCHING = "watching"
    ACTING = "acting"
    HANDED = "handed"
    DONE = "done"


class Guardian:
    """Watches one daemon, once."""

    def __init__(self, settings: Settings) -> None:
        guard, loss = settings.guard, settings.loss
        hold = replace(loss, free_after_ns=min(loss.free_after_ns, guard.hold_ns), down_after_ns=guard.hold_ns)
        self.engine = Engine(replace(settings, loss=hold), is_guard=True)
        """Acts in the daemon's place; silent until then."""
        self.engine.is_watched = False
        self.phase = Phase.WATCHING
        self.freeze = FreezeWatch(guard.freeze_ns)
        """Whether the daemon hangs."""
        self._is_ending = False
        self._ticked_ns = 0
        self._handed_ns = 0
        self._woke_ns = -1
        self._slept_ns = 0
        self.given_up = ""
        """Why it sends nothing any more although something was on the wire; empty when that is not so."""

    @property
    def is_holding(self) -> bool:
        """Whether it holds the robot, so that a daemon may take the hold over."""
        return self.phase is Phase.ACTING and self.engine.state is State.HOLDING and not self._is_ending

    def left_ns(self, now_ns: int) -> int:
        """Return how long the hold will go on [ns]; 0 when nothing is held."""
        return self.engine.takeover.left_ns(now_ns) if self.is_holding else 0

    # ------------------------------------------------------------------------------------------------ watching

    def daemon_ended(self, held: Held | None, now_ns: int, *, is_clean: bool) -> None:
        """The daemon is no more: go on in its place, if there is anything to go on with.

        It has shown nothing (None) when it never ticked; `is_clean` is whether it said that it ends.
        """
        if is_clean or held is None or held.is_silent:
            self.phase = Phase.DONE
            return
        age_ns, frame_ns = self._since_ns(held.at_ns, now_ns), self._since_ns(held.last_frame_ns, now_ns)
        held = structs.replace(held, at_ns=now_ns - age_ns, last_frame_ns=now_ns - frame_ns)
        self.engine.tick(now_ns)  # where the robot is now, as far as it was heard; nothing is on the wire yet
        self.engine.receive(TakenOver(held=held, at_ns=now_ns), now_ns)
        self.phase, self._ticked_ns = Phase.ACTING, now_ns

    def _since_ns(self, at_ns: int, now_ns: int) -> int:
        """Return how long ago an instant was, with the time in which this host slept [ns]."""
        return now_ns - at_ns + (self._slept_ns if at_ns <= self._woke_ns else 0)

    # ------------------------------------------------------------------------------------------------ acting

    def receive(self, event: Event, now_ns: int) -> None:
        """Take what the robot, the link, the host's clocks or a person who stops has to say."""
        if isinstance(event, Suspended):
            self._woke_ns, self._slept_ns = now_ns, event.slept_ns
        self.engine.receive(event, now_ns)

    def end(self, now_ns: int) -> None:
        """Brake, send what must be sent, and end: somebody asked this process to go."""
        if self.phase is Phase.ACTING and not self._is_ending:
            self._is_ending = True
            self.engine.receive(ExitRequested(at_ns=now_ns), now_ns)

    def tick(self, now_ns: int, late_ns: int = 0) -> Output:
        """Run one cycle; frames come out only while it acts."""
        stood_ns, self._ticked_ns = self._since_ns(self._ticked_ns, now_ns), now_ns
        if self.phase in {Phase.ACTING, Phase.HANDED} and stood_ns >= FSM_WATCHDOG_NS:
            self.phase = Phase.DONE
            self.given_up = (
                f"this guard stood still for {stood_ns / MS:.0f} ms: the robot has paused by itself meanwhile"
            )
        if self.phase is Phase.HANDED and now_ns - self._handed_ns >= HANDED_NS:
            self.take_back(now_ns)
        if self.phase in {Phase.HANDED, Phase.DONE}:
            return SILENT
        if self.phase is Phase.ACTING and self.engine.state not in STREAMING:
            self.end(now_ns)
        output = self.engine.tick(now_ns, late_ns)
        if self.phase is not Phase.ACTING:
            return structs.replace(output, frames=())
        if output.done:
            self.phase = Phase.DONE
        return output

    # ------------------------------------------------------------------------------------------------ handing over

    def hand_over(self, now_ns: int) -> Held | None:
        """Stop sending and return what is on the wire, for a daemon that goes on; None where nothing is held."""
        if not self.is_holding:
            return None
        self.phase, self._handed_ns = Phase.HANDED, now_ns
        return self.engine.takeover.show(now_ns)

    def handed_on(self) -> None:
        """The daemon has it."""
        if self.phase is Phase.HANDED:
            self.phase = Phase.DONE

    def take_back(self, now_ns: int) -> None:
        """The daemon died, or did not want it, before it sent anything: go on, or end when the last setpoint is too old."""
        if self.phase is Phase.HANDED:
            self.phase = Phase.ACTING
            if now_ns - self.engine.takeover.show(now_ns).last_frame_ns >= LAST_FRAME_NS:
                self.engine.takeover.give_up("the hold was handed over and came back too late", now_ns)
