"""The robot plane: events in, cleared frames out, and a session that comes back by itself.

Three kinds of thread meet here. zenoh's callbacks stamp and store, or zenoh itself keeps (`robot_session`). The loop
thread calls `poll` and `publish`, which never wait. The link's own thread opens the session, then follows the bridge and
others (`discovery`, `foreign_watch`): whatever may take its time happens there.

Rules:

* Nothing is decoded before `poll`, and then only the newest sample of each topic; how often is `pace`'s word.
* `publish` takes only what the gate has cleared. Without transport it sends nothing and counts: zenoh would accept the
  frame and lose it, and a frame that waits in a stalled link arrives late (wire.md 2.3, 7). Whether state is fresh
  enough to send at all is the engine's decision, not the link's.
* Who only looks (`is_reader`) can send nothing, is no gateway to others and keeps no route alive by a token: a token that
  goes again would end the state of whoever has none (wire.md 3.1 b).
* `close` is bounded whatever the robot does. Call it: zenoh's callback threads keep a process alive. Who forgets is
  helped out: the link closes by itself when the main thread has ended.

Knows no state of the robot, no lease and no mode.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Collection
from functools import partial

import zenoh

from gateway.api.protocol import Wire
from gateway.core.messages.events import Event, LinkUp, RobotsAnnounced, RouteObserved, SampleArrived, SampleRefused
from gateway.core.messages.sightings import Befriended, ClaimShown
from gateway.core.streams.gate import Cleared
from gateway.link.codec import BadFrame, BadSample, decode_sample, encode_frame, stamp_of
from gateway.link.connecting import MAX_RETRY_S, connect
from gateway.link.decode_schedule import DecodeSchedule
from gateway.link.discovery.discovery import Discovery, Sight
from gateway.link.discovery.revival import Revival
from gateway.link.hearing import AT_ONCE, STAMPED, mailboxes_of, slots_of
from gateway.link.mailbox import Tray
from gateway.link.meter import Meter
from gateway.link.news import TransportNews, time_of
from gateway.link.others.claim_token import ClaimToken
from gateway.link.others.foreign_watch import ForeignWatch
from gateway.link.robot_session import RobotSession, SessionListener
from gateway.link.session_config import session_config
from gateway.link.survey import gather
from gateway.process.threads import supervised
from gateway.robot.topics import STATE_TOPICS
from gateway.settings.settings import LinkSettings, SettingsRefused

__all__ = ["RobotLink"]

S = 1_000_000_000

CLAIM_END_S = 0.2
"""How long the end waits for the thread of our token [s]: it hangs only where the session hangs, too."""
STEP_S = 0.25
"""Period of the link's own thread [s]."""
FAULT_PAUSE_S = 2.0
"""How long routes are not looked at after a fault of the diagnosis [s]."""

_log = logging.getLogger(__name__)


class RobotLink:
    """The gateway's only connection to the robot.

    Args:
        settings: Endpoint, namespace, model and lease.
        clock: Monotonic clock [ns].
        wall_clock: Wall clock for header stamps [ns since 1970].
        topics: State topics to hear; the others are not subscribed to, and cost nothing.
        stamped: Those of them whose samples are stamped when they arrive, which wakes a thread for each; the others
            count as old as they can be.
        is_reader: Whether to look only.
        hears_commands: Whether to look for others' commands and publishers at once; else from `hear_commands` on.

    Attributes:
        undelivered: Frames that `publish` did not hand to zenoh because there was no transport or no session.

    Raises:
        SettingsRefused: If zenoh cannot read the endpoint.
    """

    def __init__(
        self,
        settings: LinkSettings,
        clock: Callable[[], int] = time.monotonic_ns,
        wall_clock: Callable[[], int] = time.time_ns,
        topics: Collection[str] = STATE_TOPICS,
        stamped: Collection[str] = STAMPED,
        *,
        is_reader: bool = False,
        hears_commands: bool = True,
    ) -> None:
        self.undelivered = 0
        self._hears_commands = hears_commands
        self._settings = settings
        self._clock = clock
        self._wall_clock = wall_clock
        self._is_reader = is_reader
        self._config = partial(session_config, settings, is_reader=is_reader)
        try:
            zenoh.Config.from_json5(self._config())
        except OSError:  # its network interface may come
            pass
        except zenoh.ZError as error:
            raise SettingsRefused("robot.endpoint", settings.endpoint, rule=f"is no endpoint: {error}") from error
        self._commands = frozenset(() if is_reader else settings.variant.command_topics)
        self._mailboxes = mailboxes_of(topics, stamped)
        self._slots = slots_of(self._mailboxes)
        self._turns = DecodeSchedule()
        # From other threads to the loop: appended there, taken here, each one atomic operation.
        self._transport = TransportNews()
        self._observations: deque[RouteObserved | RobotsAnnounced] = deque()
        self._own_news: deque[Befriended | ClaimShown] = deque()
        self._claim = ClaimToken(self._note_shown)
        self._friends: set[str] = set()
        self._foreign: ForeignWatch | None = None
        self._meter = Meter()
        self._session: RobotSession | None = None
        self._serving: zenoh.Session | None = None
        self._discovery: Discovery | None = None
        self._closing = threading.Event()
        self._worker = supervised(self._work, "robot-link", may_return=self._may_end, daemon=False)

    @property
    def is_up(self) -> bool:
        """Whether a transport to the robot's router is open now. Any thread."""
        return bool(self._transport.router_zid)

    @property
    def router_zid(self) -> str:
        """Zenoh id of the robot's router; empty without transport."""
        return self._transport.router_zid

    @property
    def zid(self) -> str:
        """Our own zenoh id on the robot plane; empty before the first connection."""
        session = self._session
        return "" if session is None else session.zid

    @property
    def robot_version(self) -> str:
        """Version of the robot's bridge; empty until it has said it."""
        discovery = self._discovery
        return "" if discovery is None else discovery.version

    def readiness(self) -> dict[str, str]:
        """Return, per topic of this model, whether its route works, in a few words. Any thread."""
        discovery = self._discovery
        if discovery is None:
            topics = (*self._mailboxes, *self._settings.variant.command_topics)
            return dict.fromkeys(topics, "unknown: not connected yet")
        return discovery.readiness()

    def wire(self) -> Wire:
        """Return everything that is known of the wire, for people. Any thread; asks nobody."""
        return gather(
            self._settings,
            self._clock(),
            self.zid,
            transport=self._transport,
            newest_ns={topic: box.newest_ns for topic, box in self._mailboxes.items()},
            meter=self._meter,
            discovery=self._discovery,
            foreign=self._foreign,
            friends=frozenset(self._friends),
            undelivered=self.undelivered,
        )

    def open(self) -> None:
        """Start connecting and return at once; LinkUp comes when it worked."""
        self._worker.start()

    def befriend(self, zid: str) -> None:
        """Say that a session on the robot plane is ours, before it declares or sends anything. Any thread."""
        self._friends.add(zid)
        self._own_news.append(Befriended(zid=zid, at_ns=self._clock()))

    def hear_commands(self) -> None:
        """Look for what others command from now on, on later sessions too. Any thread; returns at once."""
        if not self._hears_commands:
            self._hears_commands = True
            if (session := self._session) is not None:
                session.hear_commands()

    # ---------------------------------------------------------------------------------------------- the loop's thread

    def poll(self) -> list[Event]:
        """Return what has happened since the last call, oldest first. The loop's thread only; never waits."""
        events = self._transport.take(self.zid)
        is_new_link = any(isinstance(event, LinkUp) for event in events)
        while self._observations:
            events.append(self._observations.popleft())
        is_ordered = not events
        while self._own_news:  # before what is seen of others: a friend is introduced first
            events.append(self._own_news.popleft())
        foreign, session = self._foreign, self._session
        if foreign is not None and session is not None:
            session.take_commands(foreign.take)
            events += foreign.poll(self.router_zid, is_new_link=is_new_link)
        now_ns = self._clock()
        is_due = self._turns.due(now_ns, is_everyones=not is_ordered)
        for topic, mailbox, kind in self._slots:
            if not is_due[kind]:
                continue  # its turn comes. Beside news of the link all are taken: what came before is told before
            arrival = mailbox.look(now_ns) if isinstance(mailbox, Tray) else mailbox.take()
            if arrival is None:
                continue
            try:
                value = decode_sample(topic, arrival.payload)
            except BadSample as error:
                self._meter.refuse(topic, error.message)
                events.append(
                    SampleRefused(topic=topic, code=error.code, message=error.message, received_ns=arrival.received_ns)
                )
                continue
            stamp_ns = stamp_of(value)
            if stamp_ns is not None:
                self._meter.stamp = stamp_ns, arrival.received_ns
            events.append(
                SampleArrived(
                    topic=topic,
                    value=value,
                    received_ns=arrival.received_ns,
                    stamp_ns=stamp_ns,
                    count=arrival.samples,
                    duplicates=arrival.duplicates,
                    worst_gap_ns=arrival.worst_gap_ns,
                )
            )
        if not is_ordered:
            events.sort(key=time_of)
        return events

    def skim(self) -> int:
        """Note when samples came, decode nothing; return when the newest fast one did [ns]. The loop's thread only."""
        now_ns = self._clock()
        for _, mailbox, _ in self._slots:
            if isinstance(mailbox, Tray):
                mailbox.skim(now_ns)
        return max(mailbox.newest_ns or 0 for _, mailbox, kind in self._slots if kind != AT_ONCE)

    def pace(self, *, is_moving: bool, is_watched: bool, is_posing: bool = False) -> None:
        """Say how often to decode: what costs time and serves nobody waits for its turn.

        Joints have theirs 50 times a second, FSM and mode at each poll; after a pause everything is decoded.

        Args:
            is_moving: Setpoints are sent: what is only shown, which tells of the link, is decoded 50 times a second.
            is_watched: Somebody looks: the same. If neither, 25 times.
            is_posing: An arm is in end-effector mode: its pose decides about motion, at each poll.
        """
        self._turns.pace(is_moving=is_moving, is_watched=is_watched, is_posing=is_posing)

    def show(self, claim: int) -> None:
        """Let other gateways see a claim to command the robot; 0 for none. ClaimShown comes when they can. Never waits."""
        self._claim.show(claim)

    def publish(self, frame: Cleared) -> None:
        """Send a frame that the gate has cleared. The loop's thread only; waits at most half a millisecond.

        Without transport nothing is sent: the frame is counted in `undelivered`.

        Raises:
            BadFrame: If the frame could not have passed the gate: unknown topic, wrong length, not finite.
        """
        if frame.topic not in self._commands:
            raise BadFrame(f"{frame.topic!r} is no command topic of model {self._settings.model!r}")
        payload = encode_frame(frame.topic, frame.values, self._wall_clock())
        session = self._session
        if session is None or not self.router_zid or not session.put(frame.topic, payload):
            self.undelivered += 1

    def close(self, timeout_ns: int = 2 * S) -> bool:
        """End everything within the given time; a second call only waits again.

        A thread that is just connecting needs up to 2 s, everything else some 50 ms.

        Args:
            timeout_ns: Longest wait [ns].

        Returns:
            Whether everything ended in time. If not, zenoh's threads may keep the process alive: end it by `os._exit`.
        """
        self._closing.set()
        if self._worker.ident is not None:  # it was started
            self._worker.join(timeout_ns / S)
        return self._claim.close(CLAIM_END_S) and not self._worker.is_alive() and self._serving is None

    def _note_shown(self, claim: int) -> None:
        self._own_news.append(ClaimShown(claim=claim, at_ns=self._clock()))

    # ---------------------------------------------------------------------------------------------- the link's thread

    def _work(self) -> None:
        while (opened := connect(self._config, self._settings.endpoint, self._goes_on)) is not None:
            # A panic passes: the session stays, and with it the last way to the robot, until the process ends.
            try:
                self._serve(opened)
            except Exception:  # noqa: BLE001  # whatever it was: without a session the robot cannot even be stopped
                _log.exception("the session to %s failed; opening another one", self._settings.endpoint)
            self._drop(opened)
            self._goes_on(MAX_RETRY_S)

    def _serve(self, opened: zenoh.Session) -> None:
        """Declare everything on a session and follow the bridge until the link closes."""
        self._serving = opened
        own_zid = str(opened.zid())
        topics = tuple(self._mailboxes)
        self._discovery = discovery = Discovery(self._settings, own_zid, self._ask, self._friends, topics)
        foreign = ForeignWatch(self._settings, discovery.tokens, own_zid, self._clock)

        def note(zid: str, is_open: bool, at_ns: int) -> None:
            if self._serving is opened:  # what an earlier session still says is not about this one
                self._transport.note(zid, is_open, at_ns)

        listener = SessionListener(
            mailboxes=self._mailboxes,
            transport=note,
            token=discovery.tokens.receive,
            gateway=foreign.note_gateway,
        )
        self._session = session = RobotSession(opened, self._settings, listener, self._clock, is_reader=self._is_reader)
        self._foreign = foreign
        self._claim.attach(session)
        session.listen()  # only now: who is told of a transport can publish
        if self._hears_commands:  # last: who wants it from now on finds the session itself
            session.hear_commands()
        self._follow(discovery, foreign, session)

    def _drop(self, opened: zenoh.Session) -> None:
        """Close a session; the loop hears that its transport is gone."""
        self._claim.attach(None)
        self._session = self._serving = None
        if self.router_zid:
            self._transport.note(self.router_zid, False, self._clock())
        opened.close()  # type: ignore[no-untyped-call]  # zenoh's stub gives no types here

    def _follow(self, discovery: Discovery, foreign: ForeignWatch, session: RobotSession) -> None:
        revival = Revival(partial(session.redeclare, closing=self._closing))
        while self._goes_on(revival.pause_s(self._clock(), STEP_S)):
            try:
                self._look(discovery, foreign, session, revival)
            except Exception:  # noqa: BLE001  # a fault of the diagnosis must not take the link away: logged, not hidden
                _log.exception(
                    "discovery failed: the link goes on, routes are looked at again in %.0f s", FAULT_PAUSE_S
                )
                self._goes_on(FAULT_PAUSE_S)

    def _look(self, discovery: Discovery, foreign: ForeignWatch, session: RobotSession, revival: Revival) -> None:
        router_zid = self.router_zid
        if not router_zid:
            for part in (discovery.lose, foreign.lose, revival.forget, self._meter.forget):
                part()
            return
        tallies = {topic: box.tally for topic, box in self._mailboxes.items()}
        self._meter.note(self._clock(), tallies, self._wall_clock())
        revival.step(self._clock())
        if self._hears_commands:
            foreign.ask(self._clock(), router_zid, self._ask)
        finding = discovery.step(
            Sight(
                now_ns=self._clock(),
                up_since_ns=self._transport.up_since_ns,
                newest_ns={topic: box.newest_ns for topic, box in self._mailboxes.items()},
            )
        )
        self._observations.extend(finding.observations)
        revival.want(finding.revive, self._clock())

    def _goes_on(self, pause_s: float) -> bool:
        """Wait, then return whether the link is still wanted: nobody closed it and the program has not ended."""
        self._closing.wait(pause_s)
        return not self._may_end()

    def _may_end(self) -> bool:
        return self._closing.is_set() or not threading.main_thread().is_alive()

    def _ask(self, selector: str) -> dict[str, bytes]:
        session = self._session
        return {} if session is None else session.ask(selector, self._closing)
