"""What is taken for a freeze: ticks that are missing of a daemon that could run, judged by a guard that was there in time."""

from __future__ import annotations

import pytest

from gateway.core.handover.freeze import AHEAD_NS, EVERY_NS, LAST_NS, LATE_NS, PATIENCE_NS, FreezeWatch
from gateway.core.messages.held import Held
from gateway.settings.settings import GuardSettings
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


@pytest.mark.parametrize("could_run_ns", [None, 0])
@pytest.mark.parametrize(
    "held",
    [None, Held(at_ns=START_NS, state="IDLE"), Held(at_ns=START_NS, state="STALE", is_owed=True)],
    ids=["unborn", "silent", "owing"],
)
def test_a_daemon_with_nothing_on_the_wire_is_never_frozen(held: Held | None, could_run_ns: int | None) -> None:
    """A person may stop it and look at it: nobody needs a successor, and nobody is asked."""
    watch = FreezeWatch(FREEZE_NS)
    for n in range(1, 50):
        assert not watch.is_frozen(held, START_NS + n * FREEZE_NS, could_run_ns)
        assert not watch.is_asking


class Host:
    """A guard that looks when it wants to, and a daemon that is kept from running at times.

    Args:
        standing: From when to when its core stands still, or runs others only [ns after the newest tick].
    """

    def __init__(self, *standing: tuple[int, int]) -> None:
        self.watch = FreezeWatch(FREEZE_NS)
        self.standing = standing
        self.asked: list[int] = []
        self._ran_ns = 0

    def could_run_ns(self, now_ns: int) -> int:
        """Return when it could run, as far as was asked: a question waits until it may."""
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
            if self.watch.is_frozen(held, START_NS + now_ns, self.could_run_ns(now_ns)):
                return now_ns
            if self.watch.is_asking:
                self.asked.append(now_ns)
            now_ns = max(self.watch.look_ns - START_NS, now_ns + 1)
        return None


def test_a_daemon_that_hangs_on_a_core_that_runs_is_frozen_after_80_ms() -> None:
    """Asking costs no time: it is asked before, again every 10 ms, and once more when the verdict is near."""
    host = Host()
    assert host.frozen_after_ns() == FREEZE_NS
    assert host.asked == [*range(FREEZE_NS - AHEAD_NS, FREEZE_NS - LAST_NS, EVERY_NS), FREEZE_NS - LAST_NS]


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


def test_an_answer_that_was_a_little_late_gives_no_more_time() -> None:
    """A daemon that hangs is ended when it could run once more."""
    host = Host((65 * MS, 70 * MS + LATE_NS))
    assert host.frozen_after_ns() == 70 * MS + LATE_NS + MS


@pytest.mark.parametrize("block_ms", [45, 50, 60])
@pytest.mark.parametrize("begin_ms", [1, 5, 10])
@pytest.mark.parametrize("behind_ms", [10, 25, 60])
def test_a_daemon_that_waits_behind_others_after_its_core_came_back_lives(
    begin_ms: int, block_ms: int, behind_ms: int
) -> None:
    """The kernel gives 50 ms of each second to ordinary programs, then come the loops of other daemons on the same core."""
    end_ms = begin_ms + block_ms + behind_ms
    ticks = (0, *range(end_ms * MS, 1_000 * MS, 10 * MS))
    assert Host((begin_ms * MS, end_ms * MS)).frozen_after_ns(ticks) is None


def test_turns_that_come_too_rarely_are_judged_in_the_end() -> None:
    """Each answer gives time anew, but not for ever: a daemon that hangs on a busy core is ended too."""
    host = Host(*((n * 60 * MS, (n * 60 + 55) * MS) for n in range(20)))
    assert host.frozen_after_ns() == FREEZE_NS + PATIENCE_NS


def test_a_daemon_that_is_never_let_run_is_judged_in_the_end() -> None:
    """The robot's own watchdogs have acted; who hangs so long must not come back and write."""
    host = Host((40 * MS, 10_000 * MS))
    assert host.frozen_after_ns() == FREEZE_NS + PATIENCE_NS


def test_a_daemon_of_which_nobody_can_tell_is_judged_by_its_ticks() -> None:
    """An open question is forgotten."""
    watch = FreezeWatch(FREEZE_NS)
    assert not watch.is_frozen(ARMED, DUE_NS - AHEAD_NS, 0)
    assert watch.is_asking
    assert watch.is_frozen(ARMED, DUE_NS, None)
