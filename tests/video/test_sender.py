"""Rules of `gateway.sim.camera.sender`, in virtual time: an absolute grid, packets spread, restarts as a new sender."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.sim.camera import sender as module
from gateway.sim.camera.annexb import joined
from gateway.sim.camera.film import Coded
from gateway.sim.camera.handover import HandOvers
from gateway.sim.camera.sender import S, Sender, address_of

PERIOD_NS = S // 45
TO = ("127.0.0.1", 8890)


class World:
    """A clock that only sleeping moves, and a network that takes down what it gets."""

    def __init__(self) -> None:
        self.now_ns = 5 * S
        self.sent: list[tuple[int, bytes]] = []
        self.to: set[object] = set()
        self.is_down = False
        self.stall_ns: dict[int, int] = {}
        self.bound: object = None

    def monotonic_ns(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now_ns += round(seconds * S)

    def sendto(self, packet: bytes, to: object) -> None:
        if self.is_down:
            raise OSError("Network is unreachable")
        self.sent.append((self.now_ns, packet))
        self.to.add(to)
        self.now_ns += self.stall_ns.pop(len(self.sent), 0)

    def bind(self, address: object) -> None:
        self.bound = address

    def close(self) -> None:
        self.is_down = True

    def times_ns(self) -> list[int]:
        """Return when the first packet of each picture was sent."""
        stamps: dict[bytes, int] = {}
        for at_ns, packet in self.sent:
            stamps.setdefault(packet[4:12], at_ns)
        return list(stamps.values())

    def field(self, place: int, shape: str) -> list[int]:
        """Return a field of all packets' headers."""
        return [struct.unpack_from(shape, packet, place)[0] for _, packet in self.sent]


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    """What the sender sees of time and network."""
    world = World()
    monkeypatch.setattr(module, "time", world)
    monkeypatch.setattr(module.socket, "socket", lambda *_: world)
    return world


def pictures(size: int = 20, gop: int = 5) -> Iterator[Coded]:
    """Yield pictures with an IDR at the beginning of each group."""
    for counter in itertools.count():
        kind = 19 if counter % gop == 0 else 1
        yield Coded(counter, joined([bytes((kind << 1, 1)) + b"x" * size]))


def stop_after(count: int):
    """Return what says stop after so many questions."""
    questions = itertools.count()
    return lambda: next(questions) >= count


def ticks(stamps: list[int]) -> list[int]:
    """Return the distances of RTP timestamps."""
    return [(b - a) & 0xFFFFFFFF for a, b in itertools.pairwise(stamps)]


def test_pictures_leave_on_an_absolute_grid(world: World) -> None:
    """45 a second for a minute: no drift, 2000 ticks each."""
    sender = Sender(TO, pictures())
    sender.run(stop_after(45 * 60))
    times = world.times_ns()
    assert all(abs(at - 5 * S - number * S // 45) <= 1 for number, at in enumerate(times))
    assert set(ticks(world.field(4, "!I"))) == {2000}
    assert (sender.counts.pictures, sender.counts.late) == (2700, 0)
    assert world.to == {TO}


def test_a_rate_that_divides_no_clock_keeps_its_mean(world: World) -> None:
    """7 pictures a second: ticks differ by one, their sum does not."""
    Sender(TO, pictures(), rate_hz=7).run(stop_after(71))
    assert set(ticks(world.field(4, "!I"))) == {12_857, 12_858}
    assert sum(ticks(world.field(4, "!I"))) == 900_000


def test_a_late_sender_skips_periods_and_leaves_no_picture_out(world: World) -> None:
    """It stood still for three and a half periods: no burst follows, and the timestamps tell the gap."""
    world.stall_ns[2] = int(3.5 * PERIOD_NS)
    counters = []
    sender = Sender(TO, (counters.append(one.counter) or one for one in pictures()))
    sender.run(stop_after(5))
    assert sender.counts.late == 2
    assert ticks(world.field(4, "!I")) == [2000, 6000, 2000, 2000]
    gaps = [b - a for a, b in zip(world.times_ns(), world.times_ns()[1:], strict=False)]
    assert min(gaps) > PERIOD_NS // 3
    assert counters == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("spread", "part"), [(0.0, 0.0), (0.5, 0.5), (0.9, 0.9)])
def test_a_pictures_packets_are_spread_over_part_of_its_period(world: World, spread: float, part: float) -> None:
    """In ten bunches at most, evenly."""
    Sender(TO, pictures(size=60_000), spread=spread).run(stop_after(1))
    times = [at for at, _ in world.sent]
    assert times[-1] - times[0] == pytest.approx(part * 0.9 * PERIOD_NS, abs=PERIOD_NS * part * 0.1)
    assert len(set(times)) == (1 if not spread else 9)


def test_the_table_tells_when_and_as_what_each_picture_was_handed_over(world: World, tmp_path: Path) -> None:
    """At its first packet, with its timestamp."""
    with HandOvers(tmp_path / "table", 16) as table:
        sender = Sender(TO, pictures(), table=table)
        sender.run(stop_after(3))
        found = [table.find(counter) for counter in range(3)]
    assert [one and one.sent_ns for one in found] == world.times_ns()
    assert [one and one.rtp_timestamp for one in found] == world.field(4, "!I")
    assert {one and one.ssrc for one in found} == {sender.ssrc}


@pytest.mark.parametrize(("at_key_frame", "counters"), [(True, [0, 1, 5, 6, 7]), (False, [0, 1, 2, 3, 4])])
def test_a_restart_is_another_sender(world: World, at_key_frame: bool, counters: list[int]) -> None:
    """New SSRC, sequence number and timestamp; from the next key frame, or in mid-group."""
    sender = Sender(TO, pictures(), seed=1)
    sender.run(stop_after(2))
    before = sender.ssrc
    sender.restart(at_key_frame=at_key_frame)
    sender.run(stop_after(6 if at_key_frame else 3))
    ssrcs = world.field(8, "!I")
    assert ssrcs[:2] == [before] * 2 and set(ssrcs[2:]) == {sender.ssrc} and sender.ssrc != before
    assert sender.counts.lives == 2
    kinds = [packet[12] >> 1 for _, packet in world.sent]
    assert kinds == [19 if counter % 5 == 0 else 1 for counter in counters]
    assert (world.field(2, "!H")[2] - world.field(2, "!H")[1]) & 0xFFFF != 1


def test_silence_sends_nothing_and_the_clock_goes_on(world: World) -> None:
    """Afterwards the next picture, with the time that it has by then."""
    sender = Sender(TO, pictures())
    sender.run(stop_after(1))
    sender.is_silent = True
    sender.run(stop_after(4))
    assert len(world.sent) == 1
    sender.is_silent = False
    sender.run(stop_after(1))
    assert len(world.sent) == 2 and sender.counts.pictures == 2


def test_a_network_that_is_down_is_counted_and_not_waited_for(world: World) -> None:
    """The robot does not know its receiver."""
    world.is_down = True
    sender = Sender(TO, pictures())
    sender.run(stop_after(3))
    assert (sender.counts.refused, sender.counts.packets) == (3, 0)


def test_it_sends_from_the_address_asked_for(world: World) -> None:
    """A host may have several."""
    Sender(TO, pictures(), bind="127.0.0.2").close()
    assert world.bound == ("127.0.0.2", 0)


def test_a_spread_beyond_the_period_is_refused() -> None:
    """The next picture would be late."""
    with pytest.raises(ValueError, match=r"outside \[0, 0.9\]"):
        Sender(TO, pictures(), spread=1.0)


def test_addresses_are_host_and_port() -> None:
    """IPv6 in brackets; anything else is refused."""
    assert address_of("127.0.0.1:8890") == TO
    assert address_of("[::1]:8890") == ("::1", 8890)
    for text in ("8890", "host", "host:", ":8890", "host:0", "host:65536", "::1:8890", "host:port"):
        with pytest.raises(ValueError, match="HOST:PORT"):
            address_of(text)
