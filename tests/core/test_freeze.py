"""What is taken for a freeze: ticks that are missing on a core that runs, judged by a guard that was there in time."""

from __future__ import annotations

import pytest

from gateway.core.freeze import AHEAD_NS, EVERY_NS, LATE_NS, PATIENCE_NS, FreezeWatch
from gateway.core.held import Held
from gateway.settings import GuardSettings
from tests.pair import MS, START_NS

ARMED = Held(at_ns=START_NS, state="HOLDING", beat="one")
FREEZE_NS = GuardSettings().freeze_ns
DUE_NS = START_NS + FREEZE_NS


def test_ticks_missing_for_80_ms_are_a_freeze() -> None:
    """Not a nanosecond earlier; the next look is exactly then."""
    watch = FreezeWatch(FREEZE_NS)
    assert not watch.is_frozen(ARMED, START_NS)
    assert watch.look_ns == DUE_NS
    assert not watch.is_frozen(ARMED, DUE_NS - 1)
    assert watch.is_frozen(ARMED, DUE_NS)
    assert not watch.is_asking


def test_a_guard_that_was_late_itself_counts_anew() -> None:
    """What held it up may have held up the daemon."""
    watch = FreezeWatch(FREEZE_NS)
    watch.is_frozen(ARMED, START_NS)
    late_ns = DUE_NS + LATE_NS + 1
    assert not watch.is_frozen(ARMED, late_ns)
    assert watch.look_ns == late_ns + FREEZE_NS
    assert watch.is_frozen(ARMED, late_ns + FREEZE_NS)


def test_a_guard_that_was_a_little_late_does_not() -> None:
    """20 ms are ordinary."""
    watch = FreezeWatch(FREEZE_NS)
    watch.is_frozen(ARMED, START_NS)
    assert watch.is_frozen(ARMED, DUE_NS + LATE_NS)


@pytest.mark.parametrize("core_ran_ns", [None, 0])
@pytest.mark.parametrize(
    "held",
    [None, Held(at_ns=START_NS, state="IDLE"), Held(at_ns=START_NS, state="STALE", is_owed=True)],
    ids=["unborn", "silent", "owing"],
)
def test_a_daemon_with_nothing_on_the_wire_is_never_frozen(held: Held | None, core_ran_ns: int | None) -> None:
    """A person may stop it and look at it: nobody needs a successor, and nobody is asked."""
    watch = FreezeWatch(FREEZE_NS)
    for n in range(1, 50):
        assert not watch.is_frozen(held, START_NS + n * FREEZE_NS, core_ran_ns)
        assert not watch.is_asking


class Host:
    """A guard that looks when it wants to, and a core that stands still at times.

    Args:
        standing: From when to when the daemon's core stands still [ns after the newest tick].
    """

    def __init__(self, *standing: tuple[int, int]) -> None:
        self.watch = FreezeWatch(FREEZE_NS)
        self.standing = standing
        self.asked: list[int] = []
        self._ran_ns = 0

    def ran_ns(self, now_ns: int) -> int:
        """Return when the core answered last: a question waits until the core runs."""
        if self.asked:
            question_ns = self.asked[-1]
            answer_ns = max([question_ns, *(end for begin, end in self.standing if begin <= question_ns < end)])
            if answer_ns <= now_ns:
                self._ran_ns = START_NS + answer_ns
        return self._ran_ns

    def frozen_after_ns(self, ticks: tuple[int, ...] = (0,), until_ns: int = 1_000 * MS) -> int | None:
        """Return when the daemon is judged frozen [ns after the first tick]; None when it never is.

        Args:
            ticks: When it ticks.
            until_ns: The end.
        """
        now_ns = 0
        while now_ns < until_ns:
            tick_ns = max(tick for tick in ticks if tick <= now_ns)
            held = Held(at_ns=START_NS + tick_ns, state="HOLDING", beat="one")
            if self.watch.is_frozen(held, START_NS + now_ns, self.ran_ns(now_ns)):
                return now_ns
            if self.watch.is_asking:
                self.asked.append(now_ns)
            now_ns = max(self.watch.look_ns - START_NS, now_ns + 1)
        return None


def test_a_daemon_that_hangs_on_a_core_that_runs_is_frozen_after_80_ms() -> None:
    """Asking costs no time: the core is asked before, and again every 10 ms."""
    host = Host()
    assert host.frozen_after_ns() == FREEZE_NS
    assert host.asked == list(range(FREEZE_NS - AHEAD_NS, FREEZE_NS, EVERY_NS))


@pytest.mark.parametrize("begin_ms", [1, 30, 49, 50, 55, 65])
@pytest.mark.parametrize("length_ms", [90, 150, 250])
def test_a_core_that_stands_still_is_no_freeze_of_its_daemon(begin_ms: int, length_ms: int) -> None:
    """It ticks again as soon as its core runs, and lives."""
    begin, end = begin_ms * MS, (begin_ms + length_ms) * MS
    ticks = (0, *range(10 * MS, begin, 10 * MS), *range(end, 1_000 * MS, 10 * MS))
    assert Host((begin, end)).frozen_after_ns(ticks) is None


def test_a_daemon_that_hangs_after_its_core_came_back_is_frozen_80_ms_later() -> None:
    """The core gives it that much time, and no more."""
    host = Host((40 * MS, 200 * MS))
    assert host.frozen_after_ns() == 200 * MS + FREEZE_NS


def test_a_core_that_was_a_little_late_gives_no_more_time() -> None:
    """A daemon that hangs is ended at the answer."""
    host = Host((65 * MS, 70 * MS + LATE_NS))
    assert host.frozen_after_ns() == 70 * MS + LATE_NS


def test_a_core_that_stays_silent_is_judged_in_the_end() -> None:
    """The robot's own watchdogs have acted; who hangs so long must not come back and write."""
    host = Host((40 * MS, 10_000 * MS))
    assert host.frozen_after_ns() == FREEZE_NS + PATIENCE_NS


def test_a_daemon_that_is_no_longer_bound_to_a_core_is_judged_by_its_ticks() -> None:
    """An open question is forgotten with the core."""
    watch = FreezeWatch(FREEZE_NS)
    assert not watch.is_frozen(ARMED, DUE_NS - AHEAD_NS, 0)
    assert watch.is_asking
    assert watch.is_frozen(ARMED, DUE_NS, None)
