"""Daemon, guard and robot in one virtual-time loop: the daemon's engine can die or freeze at any tick, the guard goes on.

A `Guarded` is a `Pair` whose engine is replaced by the guard's when the guard acts, and by a new daemon's engine when one
takes the hold over. So whatever watches a pair (`tests/invariants.py`) watches the whole succession.
"""

from __future__ import annotations

from collections.abc import Callable

from gateway.core.engine import Engine, Output
from gateway.core.guardian import Guardian, Phase
from gateway.core.messages.events import (
    Event,
    HeldElsewhere,
    LinkDown,
    LinkUp,
    RouteObserved,
    SampleArrived,
    SampleRefused,
    TakenOver,
)
from gateway.core.messages.held import Held
from gateway.settings.settings import Settings
from gateway.sim.robot.settings import SimSettings
from tests.pair import MS, Pair, S

__all__ = ["Guarded"]

ROBOT_EVENTS = (SampleArrived, SampleRefused, LinkUp, LinkDown, RouteObserved)


class _ActingEngine:
    """The guardian in the shape of an engine, for the loop of a pair."""

    def __init__(self, guardian: Guardian) -> None:
        self.guardian = guardian
        self.receive = guardian.engine.receive
        self.tick = guardian.tick

    def __getattr__(self, name: str) -> object:
        return getattr(self.guardian.engine, name)


class Guarded(Pair):
    """A pair with a guard.

    Args:
        settings: Of daemon and guard.
        sim: Of the robot.

    Attributes:
        guardian: The guard; another one after each handover.
        shown: What the daemon showed last.
    """

    def __init__(self, settings: Settings | None = None, sim: SimSettings | None = None) -> None:
        self.guardian = Guardian(settings or Settings())
        self.shown: Held | None = None
        self.is_dead = False
        """Whether nobody commands: the daemon has ended and the guard has not seen it yet."""
        self.listeners: list[Guardian | Engine] = [self.guardian]
        """Who hears the robot beside the engine."""
        self.on_succession: Callable[[], None] = lambda: None
        """Called when the guard begins: latches are the daemon's, and in its state file."""
        super().__init__(settings, sim)

    def receive(self, event: Event) -> None:
        """Hand an event to the engine, and what the robot says to the guard as well."""
        if not self.is_dead:
            super().receive(event)
        for other in self.listeners:
            if isinstance(event, ROBOT_EVENTS) and other is not self.engine:
                other.receive(event, self.now_ns)

    def step(self, to_ns: int | None = None) -> Output:
        """Run one tick of whoever commands; the guard looks after the daemon's."""
        output = super().step(to_ns)
        if self.guardian.phase is Phase.WATCHING:
            self.shown = self.engine.takeover.show(self.now_ns)
            if self.now_ns >= self.guardian.freeze.look_ns:
                assert not self.guardian.freeze.is_frozen(self.shown, self.now_ns), (
                    "a living daemon was taken for frozen"
                )
                assert self.guardian.tick(self.now_ns).frames == (), "a watching guard sent something"
        return output

    # ------------------------------------------------------------------------------------------------ what happens

    def _listen(self, milliseconds: float) -> None:
        """Time passes in which nobody sends; the guard hears the robot."""
        until_ns = self.now_ns + round(milliseconds * MS)
        while self.now_ns < until_ns:
            self.now_ns = min(self.now_ns + 5 * MS, until_ns)
            self.hear()

    def die(self, seen_after_ms: float = 6.0, *, is_clean: bool = False) -> None:
        """The daemon is killed; the guard sees it a little later, and commands from then on."""
        self.is_dead = True
        self._listen(seen_after_ms)
        self.guardian.daemon_ended(self.shown, self.now_ns, is_clean=is_clean)
        self.on_succession()
        self.is_dead = False
        self.listeners.clear()
        self.engine = _ActingEngine(self.guardian)  # type: ignore[assignment]  # as far as a loop needs one

    def freeze_daemon(self) -> float:
        """The daemon stands still; the guard finds out, and ends it. Return how long that took [ms]."""
        begun_ns = self.now_ns
        self.is_dead = True
        while True:
            self._listen(max((self.guardian.freeze.look_ns - self.now_ns) / MS, 1.0))
            if self.guardian.freeze.is_frozen(self.shown, self.now_ns):
                break
            assert self.now_ns - begun_ns < 1000 * MS, "the freeze was never seen"
        took_ms = (self.now_ns - begun_ns) / MS
        self.die(0.0)
        return took_ms

    def restart(self) -> None:
        """The daemon dies and another one starts: it takes the hold over, or begins when the guard has ended."""
        self.die()
        if self.guardian.is_holding:
            self.restart_guarded()
            return
        self._after_the_guard()

    def _after_the_guard(self) -> None:
        """The guard comes to its end; then a daemon starts from what was remembered."""
        until_ns = self.now_ns + 16 * S
        while self.guardian.phase is not Phase.DONE:
            assert self.now_ns < until_ns, f"the guard never ends; {self.guardian.engine.state}"
            self.step()
        super().restart()
        self._watch_anew()

    def _watch_anew(self) -> None:
        """Another guard, beside another daemon."""
        self.guardian, self.shown = Guardian(self.settings), None
        self.listeners = [self.guardian]
        if self.is_up:
            self.guardian.receive(LinkUp(router_zid=self.zid, at_ns=self.now_ns), self.now_ns)

    def start_daemon(self) -> Engine:
        """A new daemon starts beside the guard that holds; return its engine."""
        new = Engine(self.settings, self.remembered)
        new.receive(LinkUp(router_zid=self.zid, at_ns=self.now_ns), self.now_ns)
        new.receive(HeldElsewhere(is_held=True, at_ns=self.now_ns), self.now_ns)
        self.listeners = [new]
        return new

    def restart_guarded(self) -> None:
        """A new daemon, with a guard of its own, starts beside the guard that holds, and takes the hold over."""
        old, new = self.guardian, self.start_daemon()
        while new.takeover.objection(self.now_ns):
            self.step()
            if not old.is_holding:  # the robot ended the hold before the daemon was ready
                self.listeners = []
                return self._after_the_guard()
            assert new.tick(self.now_ns).frames == (), "a daemon that has not taken over sent something"
        held = old.hand_over(self.now_ns)
        assert held is not None
        new.receive(TakenOver(held=held, at_ns=self.now_ns), self.now_ns)
        new.receive(HeldElsewhere(is_held=False, at_ns=self.now_ns), self.now_ns)
        assert new.takeover.refused == ""
        self.engine = new
        self._watch_anew()
        self.step()
        old.handed_on()
