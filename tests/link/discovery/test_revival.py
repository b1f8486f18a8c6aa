"""Rules of `link.discovery.revival`: two processes that find a route dead are out together, whatever instant each finds it."""

from __future__ import annotations

import pytest

from gateway.link.discovery.revival import GRID_NS, Revival
from gateway.link.discovery.route_watch import MAX_REVIVALS, REVIVAL_WINDOW_NS, Evidence, RouteWatch
from gateway.robot.topics import TOPICS, arm_state
from gateway.values import Side

MS = 1_000_000
S = 1_000_000_000
ARM = arm_state(Side.LEFT)
OUT_NS = 200 * MS


class Process:
    """One process that watches a dead route in steps of a quarter of a second.

    Args:
        first_ns: Its first look.
    """

    def __init__(self, first_ns: int) -> None:
        self.watch = RouteWatch(TOPICS[ARM])
        self.out_at_ns: list[int] = []
        self.next_ns = first_ns
        self.revival = Revival(lambda topics: self.out_at_ns.append(self.next_ns))

    def step(self) -> None:
        """Look once, as the link's thread does."""
        now_ns = self.next_ns
        self.revival.step(now_ns)
        if self.watch.wants_evidence(now_ns):
            _, is_due = self.watch.judge(now_ns, Evidence(has_reader=False))
            self.revival.want([ARM] if is_due else [], now_ns)
        self.next_ns += round(self.revival.pause_s(now_ns, 0.25) * S) or 1


def test_nothing_is_declared_before_its_instant():
    """All that was found dead until then goes together, once."""
    done: list[tuple[str, ...]] = []
    revival = Revival(lambda topics: done.append(tuple(topics)))
    revival.step(10**12)
    revival.want([], GRID_NS)
    assert revival.pause_s(GRID_NS, 0.25) == 0.25
    revival.want(["a"], GRID_NS + 1)
    revival.want(["b", "a"], 2 * GRID_NS - 100 * MS)
    assert revival.pause_s(GRID_NS + 1, 0.25) == 0.25
    assert revival.pause_s(2 * GRID_NS - 100 * MS, 0.25) == pytest.approx(0.1)
    revival.step(2 * GRID_NS - 1)
    assert done == []
    revival.step(2 * GRID_NS)
    revival.step(2 * GRID_NS + 1)
    assert done == [("a", "b")]
    assert revival.pause_s(2 * GRID_NS + 1, 0.25) == 0.25


def test_what_could_not_be_declared_is_due_again_at_the_next_instant():
    """Its topics have no subscription then: the next attempt on the watch's own schedule may be 18 s away."""
    done: list[tuple[str, ...]] = []

    def fail_once(topics):
        done.append(tuple(topics))
        if len(done) == 1:
            raise OSError("not now")

    revival = Revival(fail_once)
    revival.want(["a", "b"], 0)
    with pytest.raises(OSError, match="not now"):
        revival.step(GRID_NS)
    revival.step(2 * GRID_NS - 1)
    assert done == [("a", "b")]
    revival.step(2 * GRID_NS)
    revival.step(3 * GRID_NS)
    assert done == [("a", "b")] * 2


def test_a_lost_transport_revives_nothing():
    """The next one declares everything anew."""
    done: list[object] = []
    revival = Revival(done.append)
    revival.want(["a"], 0)
    revival.forget()
    revival.step(10 * GRID_NS)
    assert done == []


@pytest.mark.parametrize("apart_ms", [0, 40, 110, 180, 249, 300])
@pytest.mark.parametrize("phase_ms", range(0, 3000, 50))
def test_two_processes_are_out_together_within_the_first_two_attempts(phase_ms, apart_ms):
    """Whenever the route dies, and however their looks are apart; and neither does it more than four times a minute."""
    begun_ns = 30 * S + phase_ms * MS
    daemon, guard = Process(begun_ns), Process(begun_ns + apart_ms * MS)
    for process in (daemon, guard):
        while process.next_ns < begun_ns + 60 * S:
            process.step()
        assert len(process.out_at_ns) <= MAX_REVIVALS
        assert process.out_at_ns[-1] - process.out_at_ns[0] <= REVIVAL_WINDOW_NS
    together = [a for a in daemon.out_at_ns[:2] for b in guard.out_at_ns if abs(a - b) < OUT_NS / 2]
    assert together, (daemon.out_at_ns, guard.out_at_ns)
    assert together[0] - begun_ns <= 9 * S
