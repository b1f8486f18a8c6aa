"""Who else is on the robot: writers of our command keys, what they sent, other gateways. It remembers; it does nothing.

Rules (BEHAVIOUR, somebody else)
    * Ours is never foreign: this session, the guard's, and those of earlier runs of this daemon (`friends`).
    * A gateway's declared publishers are no writers: it declares them long before it is armed. What it sends is. Who was
      one once stays one: when it leaves, its token goes before the router's list of publishers is asked for again.
    * Data counts as going on until none came for 2 s. That of an armed gateway is its right, and over when it disarms.
    * A sample names its sender only when the sender stamped it (wire.md 4.3). Who announced the topic is named else.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set

from msgspec import Struct

from gateway.core.messages.sightings import ForeignData, Gateway, Means, Writer
from gateway.errors import Code, Refusal
from gateway.robot.topics import CHASSIS_VELOCITY, LIFT_COMMAND

__all__ = ["DATA_GONE_NS", "FRIENDS_KEPT", "GROUND_TOPICS", "Commander", "Others", "Trace"]

S = 1_000_000_000

DATA_GONE_NS = 2 * S
"""Data that has not come for this long has ended [ns]: a writer at 1 Hz is still there."""

FRIENDS_KEPT = 16
"""So many sessions of ours are remembered, the latest ones."""

TRACES_KEPT = 64
"""So many senders and topics are told apart; who floods the robot under ever new names is seen all the same."""

GATEWAYS_KEPT = 256
"""So many sessions are remembered to be gateways, the latest ones."""

GROUND_TOPICS = frozenset({CHASSIS_VELOCITY, LIFT_COMMAND})


class Trace(Struct, kw_only=True):
    """What one sender put on one of our keys.

    Attributes:
        topic: ROS name of the command topic.
        zid: Zenoh id of the sender; empty when it did not name itself.
        link: Its address; empty when unknown.
        since_ns: Arrival of the first sample [ns].
        last_ns: Arrival of the last [ns].
        count: How many came.
    """

    topic: str
    zid: str
    link: str
    since_ns: int
    last_ns: int
    count: int


class Commander(Struct, frozen=True, kw_only=True):
    """Somebody else who commands the robot, or announces it: everything that is known of one session.

    Attributes:
        code: OTHER_GATEWAY or FOREIGN_WRITER.
        who: Zenoh id of the session; the topic where nobody is named.
        text: One sentence, with id, address and what it does.
        since_ns: Since when [ns].
        count: Commands that came from it.
    """

    code: Code
    who: str
    text: str
    since_ns: int
    count: int = 0


class Others:
    """What was seen of others.

    Args:
        zids: Zenoh ids of sessions of ours that an earlier daemon left.
        policy: `hold`: foreign writers stop us and are waited out; `warn`: they are told of and shown, no more.
    """

    def __init__(self, zids: Iterable[str], policy: str) -> None:
        self._own_zid = ""
        self.friends: tuple[str, ...] = tuple(zids)[-FRIENDS_KEPT:]
        """Zenoh ids of sessions of ours, the latest last: must survive a restart."""
        self._is_hold = policy == "hold"
        self._writers: tuple[Writer, ...] = ()
        self._gateways: tuple[Gateway, ...] = ()
        self._were_gateways: dict[str, None] = {}
        self._armed_last: tuple[str, ...] = ()
        self._since_ns: dict[object, int] = {}
        self._traces: dict[tuple[str, str], Trace] = {}
        # Those of them who are not ours; asked for many times a tick, and seldom others than before.
        self.writers: tuple[Writer, ...] = ()
        """Those who announce to publish on our keys and are not ours."""
        self.gateways: tuple[Gateway, ...] = ()
        """Other gateways, armed or not."""

    @property
    def own_zid(self) -> str:
        """Zenoh id of our session; empty before the first link."""
        return self._own_zid

    @own_zid.setter
    def own_zid(self, zid: str) -> None:
        self._own_zid = zid
        self._sort_out()

    # ------------------------------------------------------------------------------------------------ what comes in

    def befriend(self, zid: str) -> None:
        """Take a session for ours, whatever was seen of it before."""
        if zid and zid not in self.friends:
            self.friends = (*self.friends, zid)[-FRIENDS_KEPT:]
            self._sort_out()
        self._forget({zid})

    def befriend_predecessor(self) -> None:
        """Take whoever was armed last for ours: two are never armed, and this process goes on in its place."""
        for zid in self._armed_last:
            self.befriend(zid)

    def _forget(self, zids: Set[str]) -> None:
        if zids:
            self._traces = {key: trace for key, trace in self._traces.items() if trace.zid not in zids}

    def see_writers(self, writers: Sequence[Writer], at_ns: int) -> None:
        """Take all who announce to publish now."""
        self._writers = tuple(writers)
        self._sort_out()
        self._date(at_ns)

    def see_gateways(self, gateways: Sequence[Gateway], at_ns: int) -> None:
        """Take all other gateways that are there now; what one of them sent ends when it says that it is done."""
        self._forget({gateway.zid for gateway in self._gateways if gateway.is_armed})
        self._gateways = tuple(gateways)
        self._armed_last = tuple(g.zid for g in gateways if g.is_armed) or self._armed_last
        self._were_gateways.update(dict.fromkeys(gateway.zid for gateway in gateways))
        for zid in tuple(self._were_gateways)[:-GATEWAYS_KEPT]:
            del self._were_gateways[zid]
        self._sort_out()
        self._date(at_ns)

    def _sort_out(self) -> None:
        """Find out who is not ours; a publisher of a bridge beside its token counts once."""
        ours = {*self.friends, self._own_zid}
        announced = {(w.zid, w.topic) for w in self._writers if w.means is Means.TOKEN}
        self.gateways = tuple(g for g in self._gateways if g.zid not in ours)
        self.writers = tuple(
            w
            for w in self._writers
            if w.zid not in ours
            and (w.means is Means.TOKEN or (w.zid not in self._were_gateways and (w.zid, w.topic) not in announced))
        )

    def _date(self, at_ns: int) -> None:
        """Remember since when each of them has been there; an armed gateway counts anew."""
        there = {*map(_key, self._writers), *map(_key, self._gateways)}
        self._since_ns = {key: self._since_ns.get(key, at_ns) for key in there}

    def see_data(self, data: ForeignData) -> None:
        """Take samples on one of our keys."""
        if data.zid in self.friends:
            return
        key = data.topic, data.zid
        trace = self._traces.get(key)
        if trace is None or data.at_ns - trace.last_ns > DATA_GONE_NS:
            if trace is None and len(self._traces) >= TRACES_KEPT:
                del self._traces[min(self._traces, key=lambda k: self._traces[k].last_ns)]
            self._traces[key] = Trace(
                topic=data.topic,
                zid=data.zid,
                link=data.link,
                since_ns=data.at_ns,
                last_ns=data.at_ns,
                count=data.count,
            )
        else:
            trace.last_ns, trace.count = data.at_ns, trace.count + data.count
            trace.link = data.link or trace.link

    # ------------------------------------------------------------------------------------------------ what is there

    @property
    def is_alone(self) -> bool:
        """Whether nobody but us was seen; the rule, so that it costs nothing."""
        return not (self.writers or self.gateways or self._traces)

    @property
    def armed(self) -> tuple[Gateway, ...]:
        """Other gateways that command the robot, or are about to."""
        return tuple([gateway for gateway in self.gateways if gateway.is_armed])

    @property
    def armed_friends(self) -> tuple[str, ...]:
        """Zenoh ids of sessions of ours that show a claim: a guard of ours, or of a daemon before this one."""
        return tuple(g.zid for g in self._gateways if g.is_armed and g.zid in self.friends and g.zid != self.own_zid)

    def data(self, now_ns: int) -> tuple[Trace, ...]:
        """Return what is being sent by others, the oldest first; what has ended is forgotten.

        What an armed gateway sends is left out: it is armed, which says more.
        """
        if not self._traces:
            return ()
        self._traces = {key: t for key, t in self._traces.items() if now_ns - t.last_ns <= DATA_GONE_NS}
        armed = {gateway.zid for gateway in self._gateways if gateway.is_armed}
        there = (trace for trace in self._traces.values() if trace.zid not in armed)
        return tuple(sorted(there, key=lambda trace: trace.since_ns))

    def since_ns(self, who: Writer | Gateway) -> int:
        """Return since when somebody who is there has been there, in this role [ns]."""
        return self._since_ns[_key(who)]

    # ------------------------------------------------------------------------------------------------ what it means

    def armed_text(self) -> str:
        """Name the gateways that command the robot; empty when none does."""
        return "; ".join(f"gateway {_named(g.zid, g.link)} commands the robot" for g in self.armed)

    def arm_data_text(self, now_ns: int) -> str:
        """Name those who send arm, gripper or FSM commands, where they stop us; empty when none does."""
        return self._data_text([t for t in self.data(now_ns) if t.topic not in GROUND_TOPICS])

    def writer_text(self, now_ns: int) -> str:
        """Name those who announce commands or send some to chassis or lift, where they stop us; empty when none does."""
        if not self._is_hold:
            return ""
        by_zid: dict[str, list[Writer]] = {}
        for writer in self.writers:
            by_zid.setdefault(writer.zid, []).append(writer)
        told = [
            f"{_named(zid, writers[0].link)} publishes on {', '.join(dict.fromkeys(w.topic for w in writers))}"
            for zid, writers in by_zid.items()
        ]
        ground = self._data_text([t for t in self.data(now_ns) if t.topic in GROUND_TOPICS])
        return "; ".join([*told, ground] if ground else told)

    def commanders(self, now_ns: int) -> Iterator[Commander]:
        """Yield everybody else who commands the robot or announces it, under either policy; armed gateways first."""
        for gateway in self.armed:
            yield Commander(
                code=Code.OTHER_GATEWAY,
                who=gateway.zid,
                text=f"another gateway, {_named(gateway.zid, gateway.link)}, commands the robot, or is about to",
                since_ns=self.since_ns(gateway),
            )
        sent: dict[str, list[Trace]] = {}
        for trace in self.data(now_ns):
            sent.setdefault(trace.zid or trace.topic, []).append(trace)
        said: dict[str, list[Writer]] = {}
        for writer in self.writers:
            said.setdefault(writer.zid, []).append(writer)
        for who in {**sent, **said}:
            traces, writers = sent.get(who, []), said.get(who, [])
            topics = [trace.topic for trace in traces]
            announced = dict.fromkeys(writer.topic for writer in writers if writer.topic not in topics)
            name = self.sender(traces[0]) if traces else _named(who, writers[0].link)
            does = [f"sends commands on {', '.join(topics)} that are not ours"] if topics else []
            does += [f"announces some on {', '.join(announced)}"] if announced else []
            yield Commander(
                code=Code.FOREIGN_WRITER,
                who=who,
                text=f"{name} {' and '.join(does)}",
                since_ns=min([trace.since_ns for trace in traces] + [self.since_ns(writer) for writer in writers]),
                count=sum(trace.count for trace in traces),
            )

    def _data_text(self, traces: Sequence[Trace]) -> str:
        return "; ".join(f"{self.sender(t)} sends on {t.topic}" for t in traces) if self._is_hold else ""

    def sender(self, trace: Trace) -> str:
        """Name who sent something, as far as it can be known."""
        if trace.zid:
            return _named(trace.zid, trace.link)
        suspects = {writer.zid: writer.link for writer in self.writers if writer.topic == trace.topic}
        if suspects:
            return f"{' or '.join(_named(zid, link) for zid, link in suspects.items())} (by what it announces)"
        return "a session that does not name itself, or a ROS node on the robot"

    def has_command_of(self, topic: str, now_ns: int) -> bool:
        """Return whether a command topic is somebody else's, so that our stop frames must not go on for ever beside it."""
        return bool(self.armed) or (self._is_hold and any(trace.topic == topic for trace in self.data(now_ns)))

    def objection(self, now_ns: int) -> Refusal | None:
        """Return why nothing may begin beside them: OTHER_GATEWAY or FOREIGN_WRITER, with who; None when nobody objects."""
        rivals = self.armed
        if rivals:
            return Refusal(
                code=Code.OTHER_GATEWAY,
                message=f"another {self.armed_text()}",
                field="gateway",
                value=rivals[0].zid,
            )
        text = "; ".join(filter(None, (self.arm_data_text(now_ns), self.writer_text(now_ns))))
        if text:
            return Refusal(code=Code.FOREIGN_WRITER, message=f"somebody else commands the robot: {text}")
        return None


def _key(who: Writer | Gateway) -> object:
    if isinstance(who, Writer):
        return who.zid, who.topic, who.means
    return who.zid, who.is_armed


def _named(zid: str, link: str) -> str:
    return f"zenoh session {zid} at {link}" if link else f"zenoh session {zid}"
