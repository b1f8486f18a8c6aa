"""Engine and robot with forces in one virtual time: what the daemon does between user and robot, without either's process.

Deterministic: the same settings, seed and targets give the same bits.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Final, cast

from gateway.core.engine import Engine
from gateway.core.messages.events import ClientSeen, CommandRequested, LinkUp, SampleArrived, StateValue, TargetArrived
from gateway.core.messages.outputs import Level, Notice, Reply
from gateway.core.messages.sightings import ClaimShown
from gateway.core.robot_state.body_model import body_model
from gateway.errors import Code, Refusal, failure, to_exception
from gateway.link.codec import from_message, stamp_of, to_message
from gateway.messages.incoming import OnLimit
from gateway.messages.requests import Acquire, Enable, OpenStream, Request, SetGripper
from gateway.messages.snapshot import Snapshot
from gateway.robot.topics import CURRENT_MODE, arm_state, ee_pose, gripper_state
from gateway.robot.vector_layout import STATE_NAMES, STATE_WIDTHS
from gateway.settings.settings import Settings
from gateway.sim.robot.model import SimRobot
from gateway.sim.robot.settings import SimSettings
from gateway.values import EePose, MotorState, Side, Vector

if TYPE_CHECKING:
    from gateway.sim.physics.bodies import Bodies

__all__ = ["STATE", "VirtualRobot"]

S: Final = 1_000_000_000
START_NS: Final = 1_000 * S
TICK_NS: Final = 10_000_000
PATIENCE_NS: Final = 15 * S
NAME: Final = "gym"
STATE: Final = STATE_NAMES[: STATE_WIDTHS[1]]
"""What is shown of the robot: joints, grippers and end effectors."""


class VirtualRobot:
    """An enabled robot, both of whose arms follow streams of joint targets.

    Args:
        settings: Of the gateway.
        sim: Of the robot, with physics.

    Attributes:
        engine: The gateway's.
        robot: The simulated one.
        world: Its world, for the true state.
        now_ns: Virtual time [ns].

    Raises:
        PhysicsMissing: MuJoCo is not installed.
        GatewayError: The engine does not enable the robot; with code and remedy.
    """

    def __init__(self, settings: Settings, sim: SimSettings) -> None:
        self.now_ns = START_NS
        self.robot = SimRobot(sim, START_NS)
        self.world = cast("Bodies", self.robot.dynamics).world
        model = body_model(settings) if settings.model.self_collision else None
        self.engine = Engine(settings, None, model)
        self._values: dict[str, StateValue] = {}
        self._told: list[str] = []
        self._replies: tuple[Reply, ...] = ()
        self._snapshot: Snapshot | None = None
        self._ids, self._seqs, self._claim = itertools.count(1), itertools.count(1), 0
        self._levels: dict[Side, float] = {}
        self.engine.receive(LinkUp(router_zid="aa", at_ns=START_NS), START_NS)
        self._until(lambda: self.engine.state == "READ_ONLY" and CURRENT_MODE in self._values)
        self._epoch = self._number("epoch", Acquire(name=NAME, pid=1))
        self._number("", Enable(epoch=self._epoch))
        self._until(lambda: self.engine.state == "ACTIVE")
        if model is not None:  # it keeps arms apart once it agrees with the robot
            self._until(lambda: not any(model.refusal(side, self.now_ns) for side in Side))
        stream = partial(OpenStream, epoch=self._epoch, on_limit=OnLimit.CLIP, expiry_ns=3 * S)
        self._streams = {side: self._number("stream_id", stream(side=side)) for side in Side}
        self._told.clear()

    def aim(self, side: Side, q_rad: Vector, gripper: float) -> None:
        """Give an arm its next target, shape (7,) [rad], clipped to its limits, and its gripper a command 0..1 (§4.4)."""
        seq, stream_id, now_ns = next(self._seqs), self._streams[side], self.now_ns
        target = TargetArrived(
            client_id=NAME, stream_id=stream_id, epoch=self._epoch, seq=seq, values=q_rad, received_ns=now_ns
        )
        self.engine.receive(target, now_ns)
        if self._levels.get(side) != gripper:
            self._levels[side] = gripper
            self._send(SetGripper(epoch=self._epoch, side=side, raw=gripper))

    def run(self, until_ns: int) -> None:
        """Let time pass up to an instant of virtual time [ns]."""
        while self.now_ns < until_ns:
            due_ns = self.engine.next_due_ns()
            grid_ns = min((self.now_ns // TICK_NS + 1) * TICK_NS, until_ns)
            self._tick(grid_ns if due_ns is None or due_ns <= self.now_ns else min(grid_ns, due_ns))

    def state(self) -> Vector:
        """Return the numbers of `STATE`, as measured last."""
        topics = [topic(side) for side in Side for topic in (arm_state, gripper_state)]
        motors = [cast("MotorState", self._values[topic]) for topic in topics]
        hands = [cast("EePose", self._values[ee_pose(side)]).values for side in Side]
        columns = ([m.q_rad for m in motors], [m.dq_radps for m in motors], [m.tau_nm for m in motors], hands)
        return tuple(number for column in columns for numbers in column for number in numbers)

    def report(self) -> dict[str, Any]:
        """Return what the engine has to say: `limited`, `told` since the last report, `latches`; texts in tuples."""
        told, self._told = tuple(dict.fromkeys(self._told)), []
        targets = self._snapshot.targets if self._snapshot else ()
        limited = tuple(target.side for target in targets if target.open and target.limited)
        latches = tuple(f"{code}: {message}" for code, message in self.engine.latches.items())
        return {"limited": limited, "told": told, "latches": latches}

    def _tick(self, now_ns: int) -> None:
        self.now_ns = now_ns
        for topic, message in self.robot.advance(now_ns, latest_only=True):
            value = self._values[topic] = from_message(topic, message)
            heard = SampleArrived(topic=topic, value=value, received_ns=now_ns, stamp_ns=stamp_of(value))
            self.engine.receive(heard, now_ns)
        self.engine.receive(ClientSeen(client_id=NAME, at_ns=now_ns), now_ns)
        output = self.engine.tick(now_ns)
        for frame in output.frames:
            self.robot.receive(frame.topic, to_message(frame.topic, frame.values, now_ns), now_ns)
        if output.claim != self._claim:
            self._claim = output.claim
            self.engine.receive(ClaimShown(claim=self._claim, at_ns=now_ns), now_ns)
        self._snapshot, self._replies = output.snapshot or self._snapshot, output.replies or self._replies
        news: list[Notice | Refusal] = [notice for notice in output.notices if notice.level is not Level.INFO]
        news += [reply.refusal for reply in output.replies if reply.refusal]
        self._told += [f"{found.code}: {found.message}" for found in news]

    def _send(self, request: Request) -> None:
        request_id, now_ns = next(self._ids), self.now_ns
        event = CommandRequested(client_id=NAME, request_id=request_id, request=request, received_ns=now_ns)
        self.engine.receive(event, now_ns)

    def _number(self, fact: str, request: Request) -> int:
        """Ask for something that must be granted; return a number of the reply, 0 without it."""
        self._send(request)
        self.run(self.now_ns + TICK_NS)
        (reply,) = self._replies
        if reply.refusal is not None:
            raise to_exception(reply.refusal)
        return cast("int", reply.facts.get(fact, 0))

    def _until(self, is_so: Callable[[], bool]) -> None:
        """Let time pass until something is so."""
        until_ns = self.now_ns + PATIENCE_NS
        while not is_so():
            if self.now_ns > until_ns:
                raise failure(Code.ENABLE_TIMEOUT, f"the engine stays {self.engine.state} ({'; '.join(self._told)})")
            self.run(self.now_ns + TICK_NS)
