"""Rules of the bad network itself: it does what its name says, as often as asked, and the same again for the same seed."""

from __future__ import annotations

import itertools
import socket
import struct

import pytest

from tests.video.bad_network import OTHER, ROBOT, BadNetwork, Datagram, Faults, relay

COUNT = 4000


def packets(count: int = COUNT) -> list[bytes]:
    """Return RTP packets that bear their number."""
    return [struct.pack("!BBHII", 0x80, 96, number & 0xFFFF, 90 * number, 7) + bytes(50) for number in range(count)]


def arrived(faults: Faults, seed: int = 1) -> tuple[list[Datagram], BadNetwork]:
    """Send packets through a network; return what arrives."""
    network = BadNetwork(faults, seed)
    return [*(one for packet in packets() for one in network.pass_on(packet)), *network.flush()], network


def numbers(datagrams: list[Datagram]) -> list[int]:
    """Return which packets of the sender arrived."""
    return [struct.unpack_from("!H", one.data, 2)[0] for one in datagrams if one.source == ROBOT]


def test_a_good_network_changes_nothing():
    """Each datagram arrives once, in order, at once."""
    datagrams, _ = arrived(Faults())
    assert [one.data for one in datagrams] == packets()


def test_a_seed_gives_the_same_again():
    """A red test can be repeated."""
    faults = Faults(loss_p=0.1, swap_p=0.1, duplicate_p=0.1, truncate_p=0.1, garbage_p=0.1, spoof_p=0.1, burst_p=0.01)
    assert arrived(faults)[0] == arrived(faults)[0] != arrived(faults, seed=2)[0]


@pytest.mark.parametrize("loss_p", [0.001, 0.01, 0.2])
def test_losses_are_as_many_as_asked_for(loss_p):
    """Within four standard deviations."""
    datagrams, network = arrived(Faults(loss_p=loss_p))
    lost = COUNT - len(datagrams)
    assert abs(lost - loss_p * COUNT) < 4 * (loss_p * COUNT) ** 0.5
    assert lost == network.did["loss"]


def test_bursts_lose_neighbours():
    """Many in a row, seldom."""
    datagrams, network = arrived(Faults(burst_p=0.002, burst_length=20))
    gaps = [b - a - 1 for a, b in itertools.pairwise(numbers(datagrams))]
    assert max(gaps) > 10 and 1 <= network.did["burst"] < 30


def test_neighbours_are_swapped_and_none_is_lost():
    """By one place only."""
    datagrams, network = arrived(Faults(swap_p=0.1))
    order = numbers(datagrams)
    assert sorted(order) == list(range(COUNT)) and network.did["swap"] > 200
    assert max(abs(number - place) for place, number in enumerate(order)) == 1


def test_duplicates_come_right_behind():
    """And are the same."""
    datagrams, network = arrived(Faults(duplicate_p=0.1))
    assert len(datagrams) == COUNT + network.did["duplicate"] > COUNT
    assert sorted(set(numbers(datagrams))) == list(range(COUNT))


def test_truncated_datagrams_are_shorter_and_still_come():
    """Down to nothing at all."""
    datagrams, network = arrived(Faults(truncate_p=0.5))
    assert len(datagrams) == COUNT
    assert sum(len(one.data) < 62 for one in datagrams) == network.did["truncate"]
    assert min(len(one.data) for one in datagrams) == 0


def test_last_packets_of_pictures_can_be_spared():
    """Those with the marker."""
    network = BadNetwork(Faults(truncate_p=1.0, truncates_last=False))
    assert len(network.pass_on(b"\x80\xe0rest")[0].data) == 6
    assert len(network.pass_on(b"\x80\x60rest")[0].data) < 6


def test_garbage_comes_beside_what_was_sent():
    """From nothing to 1400 bytes."""
    datagrams, network = arrived(Faults(garbage_p=0.2))
    sent = set(packets())
    garbage = [one.data for one in datagrams if one.data not in sent]
    assert len(garbage) == network.did["garbage"] and max(map(len, garbage)) > 1300


@pytest.mark.parametrize(("spoofs_address", "source"), [(False, OTHER), (True, ROBOT)])
def test_a_spoofer_sends_valid_rtp_of_its_own(spoofs_address, source):
    """Version 2, the same payload type, another SSRC, a sequence of its own."""
    datagrams, network = arrived(Faults(spoof_p=0.2, spoofs_address=spoofs_address))
    spoofed = [one for one in datagrams if struct.unpack_from("!I", one.data, 8)[0] != 7]
    assert len(spoofed) == network.did["spoof"] and {one.source for one in spoofed} == {source}
    assert {one.data[:2] for one in spoofed} == {b"\x80\x60"}
    order = [struct.unpack_from("!H", one.data, 2)[0] for one in spoofed]
    assert all((b - a) & 0xFFFF == 1 for a, b in itertools.pairwise(order))


def test_the_payload_type_can_be_another():
    """The marker stays."""
    network = BadNetwork(Faults(payload_type=97))
    assert network.pass_on(b"\x80\xe0rest") == [Datagram(b"\x80\xe1rest")]


def test_silence_is_silent():
    """Until it ends."""
    network = BadNetwork(Faults(is_silent=True, garbage_p=1.0))
    assert network.pass_on(b"one") == []
    network.faults = Faults()
    assert network.pass_on(b"two") == [Datagram(b"two")]


@pytest.mark.e2e
def test_a_relay_does_the_same_between_sockets():
    """What was sent, and what was not from the other address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver, socket.socket(type=socket.SOCK_DGRAM) as sender:
        receiver.bind((ROBOT, 0))
        receiver.settimeout(10.0)
        with relay(BadNetwork(Faults(spoof_p=1.0)), receiver.getsockname()[1]) as between:
            sender.sendto(packets(1)[0], (ROBOT, between.port))
            first, source = receiver.recvfrom(2048)
            assert source[0] == OTHER and first != packets(1)[0]
            assert receiver.recvfrom(2048)[0] == packets(1)[0]
            between.set(spoof_p=0.0, swap_p=1.0)
            sender.sendto(packets(2)[1], (ROBOT, between.port))
            assert receiver.recv(2048) == packets(2)[1]
