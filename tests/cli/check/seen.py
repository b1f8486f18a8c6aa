"""What a check would see of the simulated robot, in virtual time: its messages as bytes, counted as the link counts them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from cdr_types import encode
from cdr_types.keys import Qos, Reliability, Token, TokenKind, topic_to_key
from gateway.cli.check.capture import Capture, Span
from gateway.cli.check.looked import Seen, Wish, looked
from gateway.cli.check.rows import Row
from gateway.errors import Code
from gateway.link.codec import BadSample, decode_sample, encode_frame, stamp_of, to_message
from gateway.link.discovery.discovery import BridgeFacts
from gateway.link.mailbox import Mailbox
from gateway.link.meter import Meter
from gateway.link.others.foreign_watch import Neighbours
from gateway.link.survey import Known, survey
from gateway.robot.topics import COMMAND_TOPICS, JOINT_STATE, STATE_TOPICS, TOPICS
from gateway.settings.settings import LinkSettings
from gateway.sim.robot.clock import VIRTUAL_EPOCH_NS
from gateway.sim.robot.faults import parse_fault
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import SimSettings
from tests.changed import replace

MS = 1_000_000
S = 1_000_000_000
START_NS = 1_000 * S
OWN, BRIDGE = "0e11", "b1d6e"
NAMES = (*STATE_TOPICS, *COMMAND_TOPICS)


def token(topic: str, kind: TokenKind) -> Token:
    """Return what the robot's bridge announces of a topic."""
    qos = Qos(reliability=Reliability.RELIABLE)
    return Token(zid=BRIDGE, kind=kind, topic=f"/{topic_to_key(topic)}", type_name=TOPICS[topic].type_name, qos=qos)


TOKENS = (
    Token(zid=BRIDGE, kind=TokenKind.PRESENCE),
    *(token(topic, TokenKind.MP) for topic in STATE_TOPICS),
    *(token(topic, TokenKind.MS) for topic in COMMAND_TOPICS),
)


class Bench:
    """A simulated robot that is listened to, and commanded frame by frame.

    Args:
        settings: Of the robot.
    """

    def __init__(self, settings: SimSettings | None = None) -> None:
        self.robot = SimRobot(settings, START_NS)
        self.capture = Capture(NAMES)
        self.now_ns = START_NS
        self.meter = Meter()
        self.mailboxes = {name: Mailbox(is_stamped=TOPICS[name].type_name == JOINT_STATE) for name in STATE_TOPICS}
        self.deaf: set[str] = set()
        self.is_frozen = False

    def fault(self, **fault: object) -> None:
        """Let a fault act; those of bridge and process as their node lets them."""
        parsed = parse_fault(fault)
        if parsed.scope != "node":
            self.robot.inject(parsed, self.now_ns)
        elif parsed.name == "route_dead":
            self.deaf.add(parsed.topic)
        elif parsed.name == "frozen":
            self.is_frozen = True
        else:
            self.deaf |= set(STATE_TOPICS)

    def run(self, seconds: float, commands: Callable[[], Iterable[tuple[str, Sequence[float]]]] = tuple) -> Span:
        """Let time pass, at each 10 ms with commands; return when that was."""
        begin_ns = self.now_ns
        while self.now_ns < begin_ns + round(seconds * S):
            self.now_ns += 10 * MS
            for topic, message in self.robot.advance(self.now_ns):
                if topic not in self.deaf and not self.is_frozen:
                    payload = encode(message)
                    self.capture.take(NAMES.index(topic), self.now_ns, payload)
                    self.mailboxes[topic].put(payload, self.now_ns)
            for topic, values in commands():
                self.robot.receive(topic, to_message(topic, tuple(values), self.now_ns), self.now_ns)
                self.capture.take(NAMES.index(topic), self.now_ns, encode_frame(topic, tuple(values), self.now_ns))
            if self.now_ns % (50 * MS) == 0:
                self._count()
        return Span(begin_ns + 1, self.now_ns)

    def _count(self) -> None:
        """Take what came, as the link's thread does."""
        for name, mailbox in self.mailboxes.items():
            arrival = mailbox.take()
            if arrival is None:
                continue
            try:
                stamp_ns = stamp_of(decode_sample(name, arrival.payload))
            except BadSample as error:
                self.meter.refuse(name, error.message)
                continue
            if stamp_ns is not None:
                self.meter.stamp = stamp_ns, arrival.received_ns
        tallies = {name: mailbox.tally for name, mailbox in self.mailboxes.items()}
        self.meter.note(self.now_ns, tallies, self.now_ns + VIRTUAL_EPOCH_NS)

    def seen(self, **changes: object) -> Seen:
        """Return what was seen; `changes` are of what is known of the wire."""
        dead = {topic: Code.ROUTE_DEAD for topic in self.deaf}
        known = Known(
            settings=LinkSettings(),
            now_ns=self.now_ns,
            zid=OWN,
            router_zid=BRIDGE,
            up_since_ns=START_NS,
            tokens=TOKENS,
            bridges={BRIDGE: BridgeFacts(version="v1.10.2", domain=29)},
            written=dict.fromkeys(COMMAND_TOPICS, True),
            codes={**dict.fromkeys(STATE_TOPICS), **dead},
            newest_ns={name: mailbox.newest_ns for name, mailbox in self.mailboxes.items()},
            figures=self.meter.figures,
            refused=self.meter.refused,
            clock_ns=self.meter.clock_ns,
            neighbours=Neighbours(router_version="v1.10.2-abc"),
        )
        return Seen(wire=survey(replace(known, **changes)), capture=self.capture, began_ns=START_NS, knock_s=0.001)


def named(rows: Iterable[Row], verdict: str) -> list[str]:
    """Return the names of rows of a verdict."""
    return [row.name for row in rows if row.verdict == verdict]


def looked_at(bench: Bench, wish: Wish = Wish(), **changes: object) -> Mapping[str, Row]:  # noqa: B008  it never changes
    """Return the rows of a look by name."""
    return {row.name: row for row in looked(bench.seen(**changes), wish)}
