"""The robot plane: events in, cleared frames out, and a session that comes back by itself.

Three kinds of thread meet here. zenoh's callbacks stamp and store (`robot_session`). The loop thread calls `poll` and
`publish`, which never wait. The link's own thread opens the session (the first `open` fails while no router listens, so
it is repeated here), then follows the bridge (`discovery`): whatever may take its time happens there.

Rules:

* Nothing is decoded before `poll`, and then only the newest sample of each topic; how often is `pace`'s word.
* `publish` takes only what the gate has cleared. Without transport it sends nothing and counts: zenoh would accept the
  frame and lose it, and a frame that waits in a stalled link arrives late (wire.md 2.3, 7). Whether state is fresh
  enough to send at all is the engine's decision, not the link's.
* Who has polled a LinkDown before a LinkUp has seen every outage, however short; another router id means another robot
  process.
* `close` is bounded whatever the robot does. Call it: zenoh's callback threads keep a process alive. Who forgets is
  helped out: the link closes by itself when the main thread has ended.

Knows no state of the robot, no lease and no mode.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable

import zenoh

from gateway import robot
from gateway.core.events import Event, LinkDown, LinkUp, RouteObserved, SampleArrived, SampleRefused
from gateway.core.gate import Cleared
from gateway.link.codec import BadFrame, BadSample, decode_sample, encode_frame, stamp_of
from gateway.link.discovery import Discovery, Sight
from gateway.link.mailbox import Mailbox
from gateway.link.robot_session import RobotSession, SessionListener
from gateway.link.session_config import session_config
from gateway.settings import LinkSettings, SettingsRefused
from gateway.values import Side

__all__ = ["RobotLink"]

S = 1_000_000_000

FIRST_RETRY_S = 0.2
MAX_RETRY_S = 1.0
DECIDING = frozenset((*map(robot.arm_state, Side), robot.FSM_STATE, robot.CURRENT_MODE))
"""State topics that decide about motion; the others are only shown."""

AT_ONCE, DECISIVE, SHOWN = range(3)
"""Classes of topics, by how often their newest sample is decoded."""

STEP_S = 0.25
"""Period of the link's own thread."""

FAULT_PAUSE_S = 2.0
"""How long routes are not looked at after a fault of the diagnosis."""

_log = logging.getLogger(__name__)


class RobotLink:
    """The gateway's only connection to the robot.

    Args:
        settings: Endpoint, namespace, model and lease.
        clock: Monotonic clock [ns].
        wall_clock: Wall clock for header stamps [ns since 1970].

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
    ) -> None:
        self.undelivered = 0
        self._settings = settings
        self._clock = clock
        self._wall_clock = wall_clock
        self._config = session_config(settings)
        try:
            zenoh.Config.from_json5(self._config)
        except zenoh.ZError as error:
            raise SettingsRefused("robot.endpoint", settings.endpoint, rule=f"is no endpoint: {error}") from error
        self._commands = frozenset(settings.variant.command_topics)
        self._mailboxes = {
            topic: Mailbox(is_stamped=robot.TOPICS[topic].type_name == robot.JOINT_STATE)
            for topic in robot.STATE_TOPICS
        }
        self._slots = [
            *((topic, self._mailboxes[topic], DECISIVE) for topic in map(robot.arm_state, Side)),
            *((topic, self._mailboxes[topic], AT_ONCE) for topic in (robot.FSM_STATE, robot.CURRENT_MODE)),
        ]
        self._slots += [(topic, box, SHOWN) for topic, box in self._mailboxes.items() if topic not in DECIDING]
        self._every = [1, 1, 2]
        self._polls = 0
        # From the callbacks to the loop: appended there, taken here, each one atomic operation.
        self._transport_news: deque[tuple[str, bool, int]] = deque()
        self._observations: deque[RouteObserved] = deque()
        self._router_zid = ""  # as the latest callback said
        self._up_since_ns = 0
        self._polled_zid = ""  # as the loop was told
        self._session: RobotSession | None = None
        self._serving: zenoh.Session | None = None
        self._discovery: Discovery | None = None
        self._closing = threading.Event()
        self._worker = threading.Thread(target=self._work, name="robot-link")

    @property
    def is_up(self) -> bool:
        """Whether a transport to the robot's router is open now. Any thread."""
        return bool(self._router_zid)

    @property
    def router_zid(self) -> str:
        """Zenoh id of the robot's router; empty without transport."""
        return self._router_zid

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
            topics = (*robot.STATE_TOPICS, *self._settings.variant.command_topics)
            return dict.fromkeys(topics, "unknown: not connected yet")
        return discovery.readiness()

    def open(self) -> None:
        """Start connecting and return at once; LinkUp comes when it worked."""
        self._worker.start()

    # ---------------------------------------------------------------------------------------------- the loop's thread

    def poll(self) -> list[Event]:
        """Return what has happened since the last call, oldest first. The loop's thread only; never waits."""
        events: list[Event] = []
        while self._transport_news:
            events += self._link_events(*self._transport_news.popleft())
        while self._observations:
            events.append(self._observations.popleft())
        is_ordered = not events
        self._polls += 1
        for number, (topic, mailbox, kind) in enumerate(self._slots):
            if is_ordered and (self._polls + number) % self._every[kind]:
                continue  # its turn comes. Beside news of the link all are taken: what came before is told before
            arrival = mailbox.take()
            if arrival is None:
                continue
            try:
                value = decode_sample(topic, arrival.payload)
            except BadSample as error:
                events.append(
                    SampleRefused(topic=topic, code=error.code, message=error.message, received_ns=arrival.received_ns)
                )
                continue
            events.append(
                SampleArrived(
                    topic=topic,
                    value=value,
                    received_ns=arrival.received_ns,
                    stamp_ns=stamp_of(value),
                    count=arrival.samples,
                    duplicates=arrival.duplicates,
                    worst_gap_ns=arrival.worst_gap_ns,
                )
            )
        if not is_ordered:
            events.sort(key=_time_of)
        return events

    def pace(self, *, is_moving: bool, is_watched: bool) -> None:
        """Say how often to decode, at 100 polls a second: what costs time and serves nobody waits for its turn.

        Args:
            is_moving: Setpoints are sent: joints are decoded at every poll; else at every second one.
            is_watched: Somebody looks: what is only shown is decoded 50 times a second; else 25 times.
        """
        self._every[DECISIVE] = 1 if is_moving else 2
        self._every[SHOWN] = 2 if is_watched else 4

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
        if session is None or not self._router_zid or not session.put(frame.topic, payload):
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
        return not self._worker.is_alive()

    def _link_events(self, zid: str, is_open: bool, at_ns: int) -> list[Event]:
        before = self._polled_zid
        if is_open:
            self._polled_zid = zid
            if before == zid:
                return []
            gone: list[Event] = [LinkDown(at_ns=at_ns)] if before else []
            return [*gone, LinkUp(router_zid=zid, at_ns=at_ns)]
        if before != zid:
            return []
        self._polled_zid = ""
        return [LinkDown(at_ns=at_ns)]

    # ---------------------------------------------------------------------------------------------- zenoh's threads

    def _note_transport(self, zid: str, is_open: bool, at_ns: int) -> None:
        if is_open:
            self._up_since_ns = at_ns
            self._router_zid = zid
        elif self._router_zid == zid:
            self._router_zid = ""
        self._transport_news.append((zid, is_open, at_ns))

    # ---------------------------------------------------------------------------------------------- the link's thread

    def _work(self) -> None:
        while (opened := self._open_session()) is not None:
            try:
                self._serve(opened)
            except Exception:  # noqa: BLE001  # whatever it was: without a session the robot cannot even be stopped
                _log.exception("the session to %s failed; opening another one", self._settings.endpoint)
            finally:
                self._drop(opened)
            self._goes_on(MAX_RETRY_S)

    def _serve(self, opened: zenoh.Session) -> None:
        """Declare everything on a session and follow the bridge until the link closes."""
        self._serving = opened
        self._discovery = discovery = Discovery(self._settings, str(opened.zid()), self._ask)

        def note(zid: str, is_open: bool, at_ns: int) -> None:
            if self._serving is opened:  # what an earlier session still says is not about this one
                self._note_transport(zid, is_open, at_ns)

        listener = SessionListener(mailboxes=self._mailboxes, transport=note, token=discovery.tokens.receive)
        self._session = session = RobotSession(opened, self._settings, listener, self._clock)
        session.listen()  # only now: who is told of a transport can publish
        self._follow(discovery, session)

    def _drop(self, opened: zenoh.Session) -> None:
        """Close a session; the loop hears that its transport is gone."""
        self._session = self._serving = None
        if self._router_zid:
            self._note_transport(self._router_zid, False, self._clock())
        opened.close()  # type: ignore[no-untyped-call]  # zenoh's stub gives no types here

    def _follow(self, discovery: Discovery, session: RobotSession) -> None:
        while self._goes_on(STEP_S):
            try:
                self._look(discovery, session)
            except Exception:  # noqa: BLE001  # a fault of the diagnosis must not take the link away: logged, not hidden
                _log.exception(
                    "discovery failed: the link goes on, routes are looked at again in %.0f s", FAULT_PAUSE_S
                )
                self._goes_on(FAULT_PAUSE_S)

    def _look(self, discovery: Discovery, session: RobotSession) -> None:
        if not self._router_zid:
            discovery.lose()
            return
        finding = discovery.step(
            Sight(
                now_ns=self._clock(),
                up_since_ns=self._up_since_ns,
                newest_ns={topic: box.newest_ns for topic, box in self._mailboxes.items()},
                matching=session.matching(),
            )
        )
        self._observations.extend(finding.observations)
        for topic in finding.revive:
            session.redeclare(topic, self._closing)

    def _open_session(self) -> zenoh.Session | None:
        """Return an open session, however long it takes; None when the link closes first."""
        retry_s = FIRST_RETRY_S
        has_failed = False
        while self._goes_on(0.0):
            try:
                session = zenoh.open(zenoh.Config.from_json5(self._config))
            except zenoh.ZError as error:
                if not has_failed:
                    _log.warning("no zenoh router at %s yet, trying on: %s", self._settings.endpoint, error)
                has_failed = True
                self._goes_on(retry_s)
                retry_s = min(2 * retry_s, MAX_RETRY_S)
                continue
            if not self._goes_on(0.0):
                session.close()  # type: ignore[no-untyped-call]  # zenoh's stub gives no types here
                break
            _log.info("connected to %s as %s", self._settings.endpoint, session.zid())
            return session
        return None

    def _goes_on(self, pause_s: float) -> bool:
        """Wait, then return whether the link is still wanted: nobody closed it and the program has not ended."""
        return not self._closing.wait(pause_s) and threading.main_thread().is_alive()

    def _ask(self, selector: str) -> dict[str, bytes]:
        session = self._session
        return {} if session is None else session.ask(selector, self._closing)


def _time_of(event: Event) -> int:
    if isinstance(event, (LinkUp, LinkDown, RouteObserved)):
        return event.at_ns
    if isinstance(event, (SampleArrived, SampleRefused)):
        return event.received_ns
    raise TypeError(f"the robot plane makes no {type(event).__name__}")
