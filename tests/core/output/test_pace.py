"""When ticks and snapshots come: lateness, the rate of snapshots, and rest."""

from __future__ import annotations

import pytest

from gateway.core.messages.outputs import Remembered
from gateway.core.output.pace import REST_NS, TICK_NS, UNWATCHED_PERIOD_NS, Pace, is_idle
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.supervisor import State
from gateway.messages.incoming import OnLoss
from gateway.settings.settings import Settings

MS = 1_000_000
S = 1_000_000_000


@pytest.fixture
def pace() -> Pace:
    """Snapshots at 50 Hz."""
    return Pace(50.0)


def test_lateness_is_counted_and_the_worst_of_ten_seconds_is_kept(pace):
    """Skipped periods add up; an old worst value gives way to the worst that came after it."""
    for n, late_ms in enumerate((25, 3, 7, 7, 0)):
        pace.tick(n * TICK_NS, late_ms * MS)
    view = pace.view(0)
    assert (view.ticks, view.skipped, view.late_ns, view.worst_late_ns) == (5, 2, 0, 25 * MS)
    pace.tick(10 * S, 1 * MS)
    assert pace.view(1 * MS).worst_late_ns == 25 * MS, "ten seconds old, not older"
    pace.tick(10 * S + TICK_NS, 0)
    assert pace.view(0).worst_late_ns == 7 * MS


def test_a_gap_lasts_from_the_last_tick_in_time_to_the_next_that_may_be(pace):
    """Late ticks in a row are one gap; without one there is none, however far apart ticks are."""
    assert pace.gap_ns(5 * S, is_late=True) == 0, "nothing has left before"
    assert [pace.gap_ns(at_ns, is_late=False) for at_ns in (6 * S, 7 * S)] == [0, 0]
    late = [pace.gap_ns(7 * S + ms * MS, is_late=ms < 200) for ms in (70, 140, 200)]
    assert late == [80 * MS, 150 * MS, 200 * MS]
    assert pace.gap_ns(8 * S, is_late=False) == 0 and pace.gap_ns(8 * S + 60 * MS, is_late=True) == 70 * MS
    assert pace.gap_ns(8 * S + 160 * MS, is_late=True) == 170 * MS
    assert pace.gap_ns(8 * S + 230 * MS, is_late=True) == pace.gap_ns(8 * S + 240 * MS, is_late=False) == 0, "told once"


def test_snapshots_come_at_their_rate_however_often_it_is_ticked(pace):
    """One for each instant of their own grid; the first at once; numbers rise by one."""
    numbers = [pace.snapshot_due(now_ns, is_watched=True) for now_ns in range(5 * MS, 105 * MS, 5 * MS)]
    assert numbers == [1, None, None, 2, None, None, None, 3, None, None, None, 4, None, None, None, 5] + [None] * 3 + [
        6
    ]


def test_snapshots_are_few_while_nobody_listens(pace):
    """Those who ask without listening get one that is at most 200 ms old."""
    due = [now_ns for now_ns in range(0, 2 * S, TICK_NS) if pace.snapshot_due(now_ns, is_watched=False)]
    assert due == list(range(0, 2 * S, UNWATCHED_PERIOD_NS))


@pytest.mark.parametrize(("snapshot_hz", "rest_ns"), [(50.0, 20 * MS), (100.0, 10 * MS), (10.0, REST_NS)])
def test_rest_leaves_every_snapshot_to_those_who_listen(snapshot_hz, rest_ns):
    """Ticks are no further apart than snapshots then, and never further than a loss of state may go unseen."""
    pace = Pace(snapshot_hz)
    assert pace.rest_ns(is_watched=True) == rest_ns
    assert pace.rest_ns(is_watched=False) == REST_NS


@pytest.mark.parametrize("busy", ["", "owned", "exiting", "owed", "sending", "state"])
def test_idle_is_who_has_nothing_to_do(busy):
    """An owner, an end, a 0.0 that is owed, a stream or a state in which something is held: each of them keeps it busy."""
    coordinator = Coordinator(Settings(), Remembered())
    if busy == "owned":
        coordinator.lease.acquire("a", "ann", 1, OnLoss.HOLD, 0)
    elif busy == "exiting":
        coordinator.is_exiting = True
    elif busy == "owed":
        coordinator.body.heartbeat.is_owed = True
    elif busy == "sending":
        coordinator.body.chassis.stop(0)
    elif busy == "state":
        coordinator.go(State.STALE, 0, "test")
    assert is_idle(coordinator) == (busy == "")
