"""Tests of pacing in virtual time: where a stream's ticks lie in the grid of the daemon's setpoints, and how many there are."""

from __future__ import annotations

import itertools
import random

import pytest

from gateway.client import aio, connect
from gateway.client.asking.phase import FORGOTTEN_NS, OLD_NS, SPARE_NS, Phase
from tests.api.stand_in import TICK_NS
from tests.client.playing import play
from tests.client.world import World
from tests.memory_transport import MemoryTransport

MS = 1_000_000
STEP_NS = MS // 4
WAY_NS = MS
"""From `set` to the daemon."""


class FineWorld(World):
    """A world whose time goes on by steps that are small against a tick; what is put takes time, and clocks may differ.

    Args:
        ahead_ns: How far the client's clock is ahead of the daemon's [ns].
    """

    def __init__(self, ahead_ns=0):
        super().__init__()
        self.ahead_ns = ahead_ns
        self.leads_ns = []
        """Of the targets that the engine took, in order [ns]."""
        self.on_step = lambda: None
        self.missed = set()
        """Numbers of the ticks that the loop skips."""
        self._under_way = []

    def transport(self):
        transport = SlowWay(self.plane, lambda: self.time_ns + self.ahead_ns, self.pump)
        transport.world = self
        self.transports.append(transport)
        return transport

    def later(self, put):
        """Let a put arrive when it has made its way."""
        self._under_way.append((self.time_ns + WAY_NS, put))

    def pump(self):
        self.time_ns += STEP_NS
        while self._under_way and self._under_way[0][0] <= self.time_ns:
            self._under_way.pop(0)[1]()
        if self.time_ns % TICK_NS == 0:
            self.ticks += 1
            if self.ticks not in self.missed:
                known = len(self.engine.targets)
                self.engine.tick()
                self.leads_ns += [self.time_ns - target.received_ns for target in self.engine.targets[known:]]
        self.on_step()

    def run(self, seconds):
        for _ in range(round(seconds * 1e9 / STEP_NS)):
            self.pump()
            for transport in self.transports:
                transport.beat()


class SlowWay(MemoryTransport):
    """A transport whose puts need a moment."""

    def put(self, key, payload):
        self.world.later(lambda: super(SlowWay, self).put(key, payload))


def streamed(world, seconds, rate_hz=50.0, *, work=lambda n: 0.0, on_target=lambda n: None, paced=True):
    """Stream with the blocking client for a time; return when each target was set, by the client's clock [ns]."""
    set_ns = []
    with connect(transport=world.transport(), name="paced") as robot, robot.control() as own:
        own.enable()
        with own.left_arm.stream(rate_hz=rate_hz, paced=paced) as out:
            world.skipped = lambda: out.skipped
            world.run(0.0035)  # not at a tick
            until_ns = world.time_ns + round(seconds * 1e9)
            while world.time_ns < until_ns:
                world.run(work(len(set_ns)))
                on_target(len(set_ns))
                set_ns.append(world.time_ns + world.ahead_ns)
                out.set(out.q)
                out.tick()
    return set_ns


def apart_ns(set_ns):
    """Return the intervals [ns]."""
    return [later - earlier for earlier, later in itertools.pairwise(set_ns)]


def is_even(set_ns, interval_ns):
    """Whether targets lie so far apart, but for a step, and altogether exactly so."""
    off_ns = [at_ns - set_ns[0] - n * interval_ns for n, at_ns in enumerate(set_ns)]
    return max(off_ns) - min(off_ns) <= STEP_NS


# ------------------------------------------------------------------------------------------------ where ticks lie


@pytest.mark.parametrize("ahead_ns", [0, 3_700_000, 86_400_000_000_000, -1_234_567])
def test_a_targets_wait_for_its_setpoint_is_short_whatever_the_clocks_say(ahead_ns):
    """Set, way and a little more, then the tick: also when the client's clock is another host's."""
    world = FineWorld(ahead_ns)
    set_ns = streamed(world, 2.0)
    assert max(world.leads_ns[5:]) <= SPARE_NS + 2 * STEP_NS and min(world.leads_ns[5:]) >= 0
    assert is_even(set_ns[6:], 20 * MS) and world.skipped() == 0


def test_an_unpaced_stream_keeps_its_own_grid():
    """Even intervals from its opening on, and whatever wait there is."""
    world = FineWorld()
    set_ns = streamed(world, 1.0, paced=False)
    assert is_even(set_ns[1:], 20 * MS) and min(world.leads_ns[5:]) > 2 * MS


def test_the_callers_own_work_is_waited_for():
    """What he does between `tick` and `set` is part of the way: the target is in time all the same."""
    world = FineWorld()
    streamed(world, 2.0, work=lambda n: 0.006)
    assert max(world.leads_ns[5:]) <= SPARE_NS + 2 * STEP_NS


def test_the_margin_is_as_wide_as_targets_are_late():
    """Work that takes 2 to 4 ms: nearly no target misses its tick, and none waits for much longer than that differs."""
    world, random_work = FineWorld(), random.Random(1)
    streamed(world, 8.0, work=lambda n: random_work.choice([0.002, 0.0025, 0.003, 0.0035, 0.004]))
    leads_ns = world.leads_ns[20:]
    assert sorted(leads_ns)[round(0.99 * len(leads_ns))] <= 2 * MS + SPARE_NS + 2 * STEP_NS


def test_not_everybody_waits_for_the_one_in_a_hundred_that_is_late():
    """It misses its setpoint; a margin for it would cost all others more."""
    world = FineWorld()
    streamed(world, 6.0, work=lambda n: 0.004 if n % 100 == 60 else 0.0)
    late = [n for n, lead_ns in enumerate(world.leads_ns) if n > 5 and lead_ns > SPARE_NS + 2 * STEP_NS]
    assert late == [60, 160, 260]


def test_the_asyncio_client_is_paced_as_the_blocking_one_is():
    """The same procedure, awaited."""
    world = FineWorld(5 * MS)

    async def scene():
        async with aio.connect(transport=world.transport()) as robot, robot.control() as own:
            await own.enable()
            world.on_step = robot._session.notify  # the event loop's own timers know nothing of this world's time
            async with own.left_arm.stream(rate_hz=50) as out:
                for _ in range(60):
                    out.set(out.q)
                    await out.tick()

    play(world, scene, STEP_NS / 1e9)
    assert len(world.leads_ns) == 60 and max(world.leads_ns[5:]) <= SPARE_NS + 2 * STEP_NS


# ------------------------------------------------------------------------------------------------ how many there are


@pytest.mark.parametrize("rate_hz", [1.0, 7.0, 20.0, 30.0, 50.0, 64.0, 70.0, 99.0, 100.0])
def test_the_average_rate_is_the_one_that_was_asked_for(rate_hz):
    """Also of rates that do not divide the setpoints': each tick is at most half a setpoint from its own grid, none bursts."""
    world = FineWorld()
    set_ns = streamed(world, 10.0, rate_hz)
    settled = set_ns[len(set_ns) // 5 :]
    period_ns = 1e9 / rate_hz
    off_ns = [at_ns - settled[0] - n * period_ns for n, at_ns in enumerate(settled)]
    assert max(off_ns) - min(off_ns) <= TICK_NS + 2 * STEP_NS
    assert min(apart_ns(settled)) >= TICK_NS - STEP_NS and world.skipped() == 0


def test_a_late_caller_skips_and_neither_bursts_nor_drifts():
    """What he missed is counted and gone; the ticks go on just in time."""
    world = FineWorld()
    set_ns = streamed(world, 3.0, work=lambda n: 0.095 if n in (40, 80) else 0.0)
    assert world.skipped() == 8
    assert sum(interval_ns < 20 * MS - STEP_NS for interval_ns in apart_ns(set_ns)[6:]) <= 2  # one after each late one
    for n in (60, 100):
        assert world.leads_ns[n] <= SPARE_NS + 2 * STEP_NS
    assert is_even(set_ns[90:], 20 * MS)


def test_a_caller_who_always_takes_longer_than_a_tick_is_not_paced():
    """Half the rate, as without pacing, and no tick that returns at once."""
    world = FineWorld()
    set_ns = streamed(world, 2.0, work=lambda n: 0.025)
    assert is_even(set_ns[2:], 40 * MS)


def test_ticks_that_the_loop_skips_move_nothing():
    """Its grid is absolute: the next setpoint is where it would have been."""
    world = FineWorld()
    world.missed = {tick for tick in range(400) if tick % 17 == 0}
    set_ns = streamed(world, 3.0)
    assert is_even(set_ns[6:], 20 * MS)
    assert max(lead_ns % TICK_NS for lead_ns in world.leads_ns[5:]) <= SPARE_NS + 2 * STEP_NS


# ------------------------------------------------------------------------------------------------ without a word


def ask(phase, due_ns, now_ns):
    """Return by how much a wake is moved [ns]."""
    return phase.wake(due_ns, now_ns)[0] - due_ns


def told(tick_ns=20 * MS, setpoint_ns=10 * MS, lead_ns=4 * MS):
    """Return what a stream knows after one target, which was set at once."""
    phase = Phase(tick_ns)
    assert phase.wake(1000 * MS, 990 * MS) == (1000 * MS, 1000 * MS)
    phase.sent(1, 1000 * MS)
    phase.hear(1, lead_ns, setpoint_ns, 1019 * MS)
    return phase


def test_a_phase_that_is_old_is_not_kept_to():
    """Then the caller has his own grid."""
    assert ask(told(), 1020 * MS, 1019 * MS) == 4 * MS - SPARE_NS
    assert ask(told(), 1020 * MS + OLD_NS, 1019 * MS + OLD_NS) == 4 * MS - SPARE_NS
    assert ask(told(), 1020 * MS + OLD_NS, 1019 * MS + OLD_NS + 1) == 0


def test_a_daemon_that_falls_silent_leaves_an_even_grid():
    """No more snapshots: a second later the intervals are what they are without pacing."""
    world = FineWorld()

    def silence(n):
        if n == 50:
            world.plane.publish_snapshot = lambda snapshot: None
        if n == 110:
            del world.plane.publish_snapshot  # for a good end

    set_ns = streamed(world, 4.0, 30.0, on_target=silence)
    assert (
        len({*apart_ns(set_ns)[5:40]}) == 2 and max(apart_ns(set_ns[90:110])) - min(apart_ns(set_ns[90:110])) <= STEP_NS
    )


def test_what_is_forgotten_is_no_guide():
    """Clocks drift: the phase is that of the last seconds."""
    phase = told()
    now_ns = 1000 * MS + FORGOTTEN_NS + 30 * MS
    for number in range(2, 5):
        woken_ns, _ = phase.wake(now_ns, now_ns)
        phase.sent(number, woken_ns)
        phase.hear(number, 7 * MS - woken_ns % (10 * MS), 10 * MS, now_ns)
        now_ns += 20 * MS
    assert phase.wake(now_ns, now_ns)[0] % (10 * MS) == 7 * MS - SPARE_NS


def test_targets_faster_than_setpoints_are_not_paced():
    """Two of them would be woken at once."""
    assert ask(told(tick_ns=10 * MS, setpoint_ns=14 * MS), 1020 * MS, 1019 * MS) == 0


def test_a_daemon_that_tells_of_other_targets_teaches_nothing():
    """An older one, one that another tick led to, one that took longer than a tick."""
    phase = Phase(20 * MS)
    phase.sent(1, 1000 * MS)  # before the first wake
    phase.wake(1000 * MS, 990 * MS)
    phase.sent(2, 1021 * MS)
    phase.hear(2, 4 * MS, 10 * MS, 1030 * MS)
    phase.hear(7, 4 * MS, 10 * MS, 1030 * MS)
    assert ask(phase, 1040 * MS, 1035 * MS) == 0
