"""Brain and robot in one virtual-time loop: the engine against the simulated robot's pure model, no sockets, no sleep.

`Pair` steps both to the instants that the engine asks for. The link between them can be frozen (everything is kept and
arrives in a burst), cut (everything is lost) and restored; clients are names that are kept alive until they are killed.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

from gateway.core.engine import Engine, Output
from gateway.core.messages.events import (
    ClientGone,
    ClientSeen,
    CommandRequested,
    Event,
    LinkDown,
    LinkUp,
    SampleArrived,
    SampleRefused,
    TargetArrived,
)
from gateway.core.messages.outputs import Frame, FrameKind, Notice, Remembered, Reply
from gateway.core.messages.sightings import ClaimShown
from gateway.core.motion.chunk import Chunk
from gateway.core.robot_state.body_model import BodyModel, body_model
from gateway.errors import Code, Refusal
from gateway.link.codec import BadSample, from_message, stamp_of, to_message
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import Acquire, Enable, Move, OpenStream, Request
from gateway.messages.snapshot import Snapshot
from gateway.robot.topics import CURRENT_MODE, MOTION_STATE_TOPICS, STATE_TOPICS
from gateway.settings.settings import Settings
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side, Vector

MS = 1_000_000
S = 1_000_000_000
START_NS = 1_000 * S
KEEPALIVE_NS = 50 * MS
TICK_NS = 10 * MS
COMPLIANCE_RADPNM = 1e-3
"""A harder robot than `ta2 sim`: its arms hang up to 3 mrad below their setpoints, so whoever takes the measured state for a
setpoint lets them sink."""


class Pair:
    """One engine and one robot.

    Args:
        settings: Of the engine.
        sim: Of the robot.
        remembered: What an earlier engine left.
        link: Whether the link is up from the start.
        model: Of the body, for the engine; None for none.
    """

    def __init__(
        self,
        settings: Settings | None = None,
        sim: SimSettings | None = None,
        remembered: Remembered | None = None,
        *,
        link: bool = True,
        model: BodyModel | None = None,
    ) -> None:
        self.settings = settings or Settings()
        self.model = model
        self.engine = Engine(self.settings, remembered, model)
        self.robot = SimRobot(
            sim or SimSettings(state_period_ns=10 * MS, compliance_radpnm=COMPLIANCE_RADPNM), START_NS
        )
        self.now_ns = START_NS
        self.frames: list[tuple[int, Frame]] = []
        """Everything that left the engine, with its time."""
        self.notices: list[Notice] = []
        self.replies: list[Reply] = []
        self.snapshot: Snapshot | None = None
        self.remembered: Remembered | None = None
        self.done = False
        self.claim = 0
        """Number of the claim that the engine shows to other gateways; 0 for none."""
        self.alive: set[str] = set()
        """Clients that send keepalives."""
        self.late_ns = 0
        """Lateness that the next tick is told."""
        self.is_up = False
        self.is_frozen = False
        self.zid = ""
        self.is_deaf = False
        """The state route is dead: nothing of the robot arrives, commands still do."""
        self._ids = itertools.count(1)
        self._seqs = itertools.count(1)
        self._keepalive_ns = START_NS
        self.topics = STATE_TOPICS
        """State topics that arrive; fewer make long runs cheaper."""
        self.on_step: Callable[[Output], None] | None = None
        """Called after every tick, for monitors."""
        self.steady_since_ns: dict[str, int] = {}
        """Since when each topic has come without a gap of more than 100 ms [ns]."""
        self.heard: dict[str, SampleArrived] = {}
        """The latest sample of each topic that reached the engine."""
        self._to_engine: list[SampleArrived | SampleRefused] = []
        self._to_robot: list[Frame] = []
        self.sent = 0
        if link:
            self.up()

    # ------------------------------------------------------------------------------------------------ the link

    def up(self, zid: str = "aa") -> None:
        """Open the transport."""
        self.is_up, self.zid = True, zid
        self.receive(LinkUp(router_zid=zid, at_ns=self.now_ns))

    def down(self) -> None:
        """Lose the transport: what is under way is lost."""
        self.is_up = self.is_frozen = False
        self._to_engine.clear()
        self._to_robot.clear()
        self.receive(LinkDown(at_ns=self.now_ns))

    def freeze(self) -> None:
        """Stall the link: everything is kept."""
        self.is_frozen = True

    def thaw(self) -> None:
        """End the stall: everything kept arrives in a burst, with a fresh receive time."""
        self.is_frozen = False
        frames, self._to_robot = self._to_robot, []
        for frame in frames:
            self._deliver(frame)
        samples, self._to_engine = self._to_engine, []
        for sample in samples:
            if isinstance(sample, SampleArrived):
                self.receive(
                    SampleArrived(
                        topic=sample.topic, value=sample.value, received_ns=self.now_ns, stamp_ns=sample.stamp_ns
                    )
                )

    def take_backlog(self) -> list[SampleArrived | SampleRefused]:
        """End a stall without handing over what the robot said in it: return that instead; our frames arrive."""
        self.is_frozen = False
        frames, self._to_robot = self._to_robot, []
        for frame in frames:
            self._deliver(frame)
        samples, self._to_engine = self._to_engine, []
        return samples

    def _deliver(self, frame: Frame) -> None:
        self.robot.receive(frame.topic, to_message(frame.topic, frame.values, self.now_ns), self.now_ns)

    # ------------------------------------------------------------------------------------------------ time

    @property
    def state_age_ns(self) -> int | None:
        """Age of the newest fast state that reached the engine on this link [ns]."""
        times = [self.heard[topic].received_ns for topic in MOTION_STATE_TOPICS if topic in self.heard]
        return self.now_ns - max(times) if times else None

    @property
    def knows_mode(self) -> bool:
        """Whether `/api/current_mode` has reached the engine on this link."""
        return CURRENT_MODE in self.heard

    def receive(self, event: Event) -> None:
        """Hand an event to the engine."""
        if isinstance(event, SampleArrived):
            before = self.heard.get(event.topic)
            if before is None or event.received_ns - before.received_ns > 100 * MS:
                self.steady_since_ns[event.topic] = event.received_ns
            self.heard[event.topic] = event
        elif isinstance(event, LinkUp):
            self.heard.clear()
        self.engine.receive(event, self.now_ns)

    def step(self, to_ns: int | None = None) -> Output:
        """Go to the engine's next instant (or to `to_ns`) and run one tick."""
        if to_ns is None:
            base_ns, due_ns = (self.now_ns // TICK_NS + 1) * TICK_NS, self.engine.next_due_ns()
            to_ns = base_ns if due_ns is None or due_ns <= self.now_ns else min(base_ns, due_ns)
        self.now_ns = to_ns
        self.hear()
        if self.now_ns >= self._keepalive_ns:
            self._keepalive_ns = self.now_ns + KEEPALIVE_NS
            for client in self.alive:
                self.receive(ClientSeen(client_id=client, at_ns=self.now_ns))
        output = self.engine.tick(self.now_ns, self.late_ns)
        self.late_ns = 0
        for frame in output.frames:
            self.frames.append((self.now_ns, frame))
            if self.is_up and self.is_frozen:
                self._to_robot.append(frame)
            elif self.is_up:
                self._deliver(frame)
        self.sent += len(output.frames)
        if output.claim != self.claim:
            self.claim = output.claim
            self.receive(ClaimShown(claim=self.claim, at_ns=self.now_ns))
        self.notices += output.notices
        self.replies += output.replies
        self.snapshot = output.snapshot or self.snapshot
        self.remembered = output.remembered or self.remembered
        self.done = self.done or output.done
        if self.on_step is not None:
            self.on_step(output)
        return output

    def hear(self) -> None:
        """Let the robot come to the present and hand over what it says."""
        for topic, message in self.robot.advance(self.now_ns, latest_only=True, topics=self.topics):
            if not self.is_up or self.is_deaf:
                continue
            try:
                value = from_message(topic, message)
            except BadSample as bad:
                sample: SampleArrived | SampleRefused = SampleRefused(
                    topic=topic, code=bad.code, message=str(bad), received_ns=self.now_ns
                )
            else:
                sample = SampleArrived(topic=topic, value=value, received_ns=self.now_ns, stamp_ns=stamp_of(value))
            if self.is_frozen:
                self._to_engine.append(sample)
            else:
                self.receive(sample)

    def restart(self) -> None:
        """The daemon dies without a word and another one starts with what was remembered."""
        if self.model is not None:
            self.model = body_model(self.settings)  # as a new daemon makes it
        self.engine = Engine(self.settings, self.remembered, self.model)
        self.done = False
        self._to_engine.clear()
        if self.is_up:
            self.receive(LinkUp(router_zid=self.zid, at_ns=self.now_ns))

    def run(self, seconds: float) -> None:
        """Let time pass."""
        until_ns = self.now_ns + round(seconds * S)
        while self.now_ns < until_ns:
            self.step()

    def run_until(self, is_so: Callable[[], bool], seconds: float = 15.0) -> None:
        """Let time pass until something is so; fail when it never is."""
        until_ns = self.now_ns + round(seconds * S)
        while not is_so():
            assert self.now_ns < until_ns, f"not within {seconds} s; state {self.state}, {self.last_words()}"
            self.step()

    def last_words(self) -> list[str]:
        """Return the latest notices, for failure messages."""
        return [f"{notice.code}: {notice.message}" for notice in self.notices[-6:]]

    # ------------------------------------------------------------------------------------------------ what is seen

    @property
    def state(self) -> str:
        """The supervisor's state now."""
        return self.engine.state.value

    def see(self) -> Snapshot:
        """Return a snapshot of now."""
        self.snapshot = None
        self.run_until(lambda: self.snapshot is not None, 0.1)
        assert self.snapshot is not None
        return self.snapshot

    def codes(self) -> list[Code]:
        """Return the codes of all notices so far."""
        return [notice.code for notice in self.notices]

    def sent_on(self, topic: str, since_ns: int = 0) -> list[tuple[int, Frame]]:
        """Return what left on a topic since a time."""
        return [(at_ns, frame) for at_ns, frame in self.frames if frame.topic == topic and at_ns >= since_ns]

    def kinds_since(self, since_ns: int) -> set[FrameKind]:
        """Return the kinds of all frames since a time."""
        return {frame.kind for at_ns, frame in self.frames if at_ns >= since_ns}

    # ------------------------------------------------------------------------------------------------ clients

    def tell(self, request: Request, client: str = "user", chunk: Chunk | None = None) -> int:
        """Send a request as a client, and the motion of its points if it is worked out, without waiting; return its id."""
        request_id = next(self._ids)
        asked = {"client_id": client, "request_id": request_id, "request": request, "chunk": chunk}
        self.receive(CommandRequested(**asked, received_ns=self.now_ns))
        return request_id

    def ask(self, request: Request, client: str = "user") -> Reply:
        """Send a request as a client and return the reply of the next tick."""
        request_id = self.tell(request, client)
        self.step()
        return next(reply for reply in reversed(self.replies) if reply.request_id == request_id)

    def granted(self, request: Request, client: str = "user") -> Mapping[str, object]:
        """Send a request that must be accepted; return its facts."""
        reply = self.ask(request, client)
        assert reply.refusal is None, reply.refusal
        return reply.facts

    def refused(self, request: Request, client: str = "user") -> Refusal:
        """Send a request that must be refused; return why it was."""
        reply = self.ask(request, client)
        assert reply.refusal is not None, reply.facts
        return reply.refusal

    def own(self, client: str = "user", on_loss: OnLoss = OnLoss.HOLD) -> int:
        """Acquire the lease and stay alive; return the epoch."""
        self.alive.add(client)
        epoch = self.granted(Acquire(name=client, pid=42, on_loss=on_loss), client)["epoch"]
        assert isinstance(epoch, int)
        return epoch

    def activate(self, client: str = "user", on_loss: OnLoss = OnLoss.HOLD) -> int:
        """Acquire, enable and wait for ACTIVE; return the epoch."""
        self.run_until(lambda: self.state == "READ_ONLY")
        self.run_until(lambda: self.knows_mode)
        epoch = self.own(client, on_loss)
        self.granted(Enable(epoch=epoch), client)
        self.run_until(lambda: self.state == "ACTIVE")
        return epoch

    def kill(self, client: str = "user") -> None:
        """A client's process ends: no keepalive any more, its token goes."""
        self.alive.discard(client)
        self.receive(ClientGone(client_id=client, at_ns=self.now_ns))

    def move(self, epoch: int, goals: Mapping[Side, Vector], client: str = "user", speed: float = 1.0) -> int:
        """Begin a motion; return its id."""
        motion_id = self.granted(Move(epoch=epoch, targets_rad=goals, speed=speed), client)["motion_id"]
        assert isinstance(motion_id, int)
        return motion_id

    def stream(self, epoch: int, side: Side = Side.LEFT, client: str = "user") -> int:
        """Open a stream; return its id."""
        stream_id = self.granted(OpenStream(epoch=epoch, side=side), client)["stream_id"]
        assert isinstance(stream_id, int)
        return stream_id

    def target(self, epoch: int, stream_id: int, q_rad: Vector, client: str = "user", seq: int | None = None) -> None:
        """Send a streamed target."""
        self.receive(
            TargetArrived(
                client_id=client,
                stream_id=stream_id,
                epoch=epoch,
                seq=next(self._seqs) if seq is None else seq,
                values=q_rad,
                received_ns=self.now_ns,
            )
        )
