"""Rules of `receiver` and `udp` with real sockets: what is sent comes out, errors are told, nothing is left behind."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from gateway.video.errors import VideoCode, VideoError
from gateway.video.hevc.access_unit import AccessUnit
from gateway.video.receiving.receiver import Receiver, ReceiverSettings
from gateway.video.receiving.udp import UdpSocket, addresses_of
from tests.video.packets import Sender, picture, rtp, split_annex_b

pytestmark = pytest.mark.e2e

HERE = "127.0.0.1"
DEADLINE_S = 20.0
Send = Callable[..., None]


def settings(**changes) -> ReceiverSettings:
    """Return settings for a free port of loopback."""
    return ReceiverSettings(**{"source": HERE, "host": HERE, "port": 0, **changes})


def wait_for(is_so: Callable[[], object]) -> None:
    """Poll until something is so."""
    deadline = time.monotonic() + DEADLINE_S
    while not is_so():
        assert time.monotonic() < deadline, "it never was so"
        time.sleep(0.002)


@pytest.fixture
def out() -> Iterator[socket.socket]:
    """Give a socket to send from."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        yield sender


def send(out: socket.socket, receiver: Receiver, packets: list[bytes]) -> None:
    """Send packets to a receiver."""
    for packet in packets:
        out.sendto(packet, (HERE, receiver.port))


def test_pictures_that_are_sent_come_out_stamped(out: socket.socket) -> None:
    """Every one, in order, with the monotonic time of its first packet."""
    sender = Sender()
    with Receiver(settings()) as receiver:
        assert receiver.take(0.0) is None, "the live taker begins with its first call"
        for n in range(60):
            begun_ns = time.monotonic_ns()
            send(out, receiver, sender.send(picture(n)))
            unit = receiver.take(DEADLINE_S)
            assert unit is not None and split_annex_b(unit.data) == picture(n)
            assert begun_ns <= unit.first_packet_ns <= unit.complete_ns <= time.monotonic_ns()
            assert unit.seq == n and unit.is_intact
        counts = receiver.counts
    assert (counts.pictures, counts.lost, counts.kernel_dropped) == (60, 0, 0)


def test_a_stopped_receiver_ends_its_takers_lets_go_of_the_port_and_can_start_again(out: socket.socket) -> None:
    """Whoever waits is woken; threads end."""
    receiver = Receiver(settings())
    receiver.start()
    receiver.start()  # does nothing: it runs
    port, got = receiver.port, []
    taker = threading.Thread(target=lambda: got.append(receiver.take(DEADLINE_S)))
    taker.start()
    receiver.stop()
    taker.join(DEADLINE_S / 2)
    assert got == [None] and receiver.is_over
    receiver.stop()
    assert not [thread for thread in threading.enumerate() if thread.name == "video-receiver"]
    UdpSocket(port, host=HERE).close()
    with receiver:
        receiver.take(0.0)
        send(out, receiver, Sender().send(picture(0)))
        unit = receiver.take(DEADLINE_S)
        assert unit is not None and unit.is_irap


def test_who_takes_from_a_receiver_that_was_not_started_is_not_kept_waiting() -> None:
    """No more will come."""
    receiver, got = Receiver(settings()), []
    assert receiver.take(DEADLINE_S) is None and receiver.is_over
    receiver.tap(got.append, name="recorder").close()
    assert got == [] and receiver.granted_bytes is None and receiver.port == 0


def test_findings_are_about_the_last_seconds(out: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was wrong and is not any more is not told any more; the counters keep it."""
    monkeypatch.setattr("gateway.video.receiving.receiver.RECENT_NS", 1)
    monkeypatch.setattr("gateway.video.receiving.receiver.DROPPED_EVERY_NS", 1)
    with Receiver(settings()) as receiver:
        send(out, receiver, [b"garbage"])
        wait_for(lambda: receiver.counts.too_short)
        wait_for(lambda: receiver.facts().recent.too_short == 0)
        assert receiver.counts.too_short == 1


def test_a_port_that_is_taken_is_named_with_what_to_do() -> None:
    """Two programs cannot both receive."""
    with Receiver(settings()) as first:
        with pytest.raises(VideoError, match=rf"udp port {first.port} is taken.*ss -ulpn") as caught:
            Receiver(settings(port=first.port)).start()
        assert caught.value.code is VideoCode.PORT_BUSY


@pytest.mark.parametrize(("host", "port"), [("192.0.2.7", 0), (HERE, 70_000)])
def test_an_address_that_is_not_of_this_host_is_refused(host: str, port: int) -> None:
    """With the values."""
    with pytest.raises(VideoError, match=rf"{host}:{port}") as caught:
        UdpSocket(port, host=host)
    assert caught.value.code is VideoCode.BAD_ADDRESS


def test_the_robots_name_is_resolved_and_one_that_does_not_exist_is_refused() -> None:
    """The filter compares addresses."""
    assert HERE in addresses_of("localhost")
    with pytest.raises(VideoError, match=r"no-such-robot\.invalid"):
        addresses_of("no-such-robot.invalid")


def test_packets_from_elsewhere_are_refused_unless_anybody_may_send(out: socket.socket) -> None:
    """The filter is on by default: there is no receiver without a word about it."""
    with Receiver(settings(source="127.0.0.9")) as receiver:
        send(out, receiver, Sender().send(picture(0)))
        wait_for(lambda: receiver.counts.bad_source)
        assert receiver.counts.packets == 0
        wait_for(lambda: VideoCode.WRONG_SOURCE in {finding.code for finding in receiver.why()})
    with Receiver(settings(source=None)) as receiver:
        send(out, receiver, Sender().send(picture(0)))
        wait_for(lambda: receiver.counts.pictures)


def test_another_payload_type_is_told_while_it_comes(out: socket.socket) -> None:
    """In words, with both numbers."""
    with Receiver(settings()) as receiver:
        send(out, receiver, [rtp(b"\x02\x01\x80", 1, 2, payload_type=97)])
        wait_for(lambda: receiver.counts.bad_payload_type)
        (finding,) = [f for f in receiver.why() if f.code is VideoCode.WRONG_PAYLOAD_TYPE]
    assert "payload type is 97, not 96" in finding.message


def test_the_buffer_that_was_granted_is_told(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """And how to raise it, where the kernel caps it; a warning at the start."""
    asked = 1 << 30
    monkeypatch.setattr("gateway.video.receiving.udp._SO_RCVBUFFORCE", 12_345)  # as for a user without privileges
    with Receiver(settings(receive_buffer_bytes=asked)) as receiver:
        granted = receiver.granted_bytes
        assert granted is not None and 0 < granted < asked
        (finding,) = [f for f in receiver.why() if f.code is VideoCode.RECEIVE_BUFFER_CAPPED]
        assert str(granted) in finding.message and f"net.core.rmem_max={asked}" in finding.hint
    assert "RECEIVE_BUFFER_CAPPED" in caplog.text


def test_what_the_kernel_drops_is_counted() -> None:
    """A socket that nobody empties."""
    udp = UdpSocket(0, host=HERE, buffer_bytes=4096)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for _ in range(200):
            out.sendto(bytes(1000), (HERE, udp.port))
    assert udp.dropped() > 100
    udp.close()
    assert udp.dropped() == 0, "a closed socket does not tell"


def test_a_recorder_that_hangs_delays_neither_the_live_taker_nor_another_recorder(out: socket.socket) -> None:
    """Each has a queue of its own."""
    sender, may_go, slow, fast = Sender(), threading.Event(), [], []

    def hang(unit: AccessUnit) -> None:
        may_go.wait(DEADLINE_S)
        slow.append(unit.seq)

    with Receiver(settings()) as receiver:
        receiver.take(0.0)
        taps = receiver.tap(hang, name="slow"), receiver.tap(lambda unit: fast.append(unit.seq), name="fast")
        for n in range(30):
            send(out, receiver, sender.send(picture(n)))
            unit = receiver.take(DEADLINE_S)
            assert unit is not None and unit.seq == n
        wait_for(lambda: len(fast) == 30)
        assert slow == []
        may_go.set()
        for tap in taps:
            tap.close()
    assert slow == fast == list(range(30))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_error_on_the_receiving_thread_is_told_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """To who takes, to who records, and by `why`; the port is free again."""

    def broken(_: UdpSocket) -> None:
        raise OSError(100, "Network is down")

    got: list[AccessUnit] = []
    receiver = Receiver(settings())
    with receiver:
        receiver.take(0.0)
        tap = receiver.tap(got.append, name="recorder")
        monkeypatch.setattr(UdpSocket, "receive", broken)
        with pytest.raises(VideoError, match="Network is down"):
            receiver.take(DEADLINE_S)
        wait_for(lambda: tap.error is not None)
        assert receiver.why()[0].code is VideoCode.RECEIVER_FAILED
        with pytest.raises(VideoError, match="Network is down"):
            receiver.take(0.0)
        monkeypatch.undo()
        receiver.start()
        assert receiver.take(0.0) is None and receiver.why() == (), "it can be started again"
    UdpSocket(receiver.port, host=HERE).close()


def test_a_held_packet_is_given_up_while_nothing_comes(out: socket.socket) -> None:
    """The last picture before a silence is not kept back by a packet that was lost in it."""
    sender = Sender()
    first, second = sender.pictures(range(2))
    with Receiver(settings()) as receiver:
        receiver.take(0.0)
        send(out, receiver, first + second[:1] + second[2:])
        units = [receiver.take(DEADLINE_S) for _ in range(2)]
    assert [unit is not None and unit.is_intact for unit in units] == [True, False]
