"""A coordinator in a chosen state whose robot says what the test wants it to say: samples by hand, no sockets, no engine.

For tests of one module of the core that needs store, lease, supervisor and body beside it. Time passes in ticks of 10 ms
in which the robot is heard and streams give their frames; nothing else happens unless the test does it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from gateway.core.messages.events import CommandRequested, SampleArrived
from gateway.core.messages.outputs import Frame, Remembered
from gateway.core.supervision.conditions import Conditions
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.phases import Phases
from gateway.core.supervision.supervisor import State
from gateway.errors import Code
from gateway.messages.incoming import OnLoss
from gateway.messages.requests import Request
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import CURRENT_MODE, FSM_STATE, arm_state, ee_pose
from gateway.settings.settings import LinkSettings, Settings
from gateway.values import ArmState, CurrentMode, EePose, FsmState, Side, Space, Vector
from tests.changed import replace

__all__ = ["GOAL", "MIDDLE", "MODE", "MS", "OFFSET_NS", "PLACE", "TICK_NS", "L", "R", "S", "Stage"]

MS = 1_000_000
S = 1_000_000_000
TICK_NS = 10 * MS
OFFSET_NS = 77 * S
"""The robot's clock minus ours [ns]."""
L, R = Side.LEFT, Side.RIGHT
MIDDLE: dict[Side, Vector] = {
    side: tuple((a + b) / 2 for a, b in zip(JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side], strict=True)) for side in Side
}
PLACE: dict[Side, Vector] = {
    side: (0.30, sign * 0.10, -0.20, 0.0, 0.0, 0.0, 1.0) for side, sign in ((L, 1.0), (R, -1.0))
}
"""Where the end effectors are: x, y, z [m], qx, qy, qz, qw."""
GOAL: dict[Side, Vector] = {side: tuple(q + 0.5 for q in MIDDLE[side]) for side in Side}
MODE = CurrentMode(
    api=True,
    joint_mode=dict.fromkeys(Side, True),
    arm_enabled=dict.fromkeys(Side, True),
    chassis_enabled=True,
    lift_enabled=True,
    collision_check=False,
)


class Stage:
    """A coordinator, its robot and the time.

    Args:
        state: Where the supervisor is; ann owns the robot in each of them.
        sides: Arms whose streams run, where any do.
        model: `lite`, `standard` or `lift`.
        latches: What is latched.
        owner: Who owns the robot; None for nobody.
        dumb: Arms whose state was never heard.
        poses: Arms in end-effector mode.
        settings: Other ones than the defaults, `model` among them.

    Attributes:
        q_rad: What is measured, per side [rad].
        pose: The same of the end effectors: x, y, z [m], qx, qy, qz, qw.
        fsm: What `/fsm_state` says; None for nothing.
        mode: What `/api/current_mode` says; None for nothing.
        dumb: Arms whose state is not heard.
        poses: Arms whose end effectors' poses are heard.
    """

    def __init__(
        self,
        state: State = State.IDLE,
        *,
        sides: tuple[Side, ...] = (L, R),
        model: str = "standard",
        latches: Mapping[Code, str] | None = None,
        owner: str | None = "ann",
        dumb: Collection[Side] = (),
        poses: Collection[Side] = (),
        settings: Settings | None = None,
    ) -> None:
        settings = settings or Settings(link=LinkSettings(model=model))
        self.coordinator = Coordinator(settings, Remembered(latches=latches or {}))
        self.phases = Phases(self.coordinator, Conditions(self.coordinator))
        self.now_ns = 1_000 * S
        self.q_rad = dict(MIDDLE)
        self.fsm: int | None = int(FsmState.PAUSE)
        self.pose = dict(PLACE)
        self.poses = set(poses)
        self.mode: CurrentMode | None = replace(MODE, joint_mode={side: side not in poses for side in Side})
        self.dumb = set(dumb)
        self.coordinator.transport_up, self.coordinator.router_zid = True, "aa"
        self._claim()
        self.run(32)  # arms can be seeded after 0.3 s
        self.epoch = 0
        if owner is not None:
            epoch = self.coordinator.lease.acquire(owner, owner, 7, OnLoss.HOLD, self.now_ns)
            assert isinstance(epoch, int)
            self.epoch = epoch
        self._enter(state, sides)
        self.coordinator.notices.clear()

    def _claim(self) -> None:
        """Other gateways have been shown that the robot is commanded: this took place before the stage."""
        claim = self.coordinator.claim
        claim.link_up(self.now_ns - S)
        for _ in range(2):
            claim.step(self.now_ns, is_wanted=True, is_used=True, own_zid="", rivals=[])
            claim.shown(1, self.now_ns - S)
        assert claim.is_confirmed

    def _enter(self, state: State, sides: tuple[Side, ...]) -> None:
        coordinator = self.coordinator
        if state is State.OFFLINE:
            coordinator.transport_up = False
            coordinator.store.reset()
        elif state in {State.READ_ONLY, State.IDLE}:
            coordinator.go(state, self.now_ns, "test")
        elif state is State.ENABLING:
            coordinator.go(state, self.now_ns, "test")
            self.phases.enabling.begin(sides, self.now_ns)
        else:
            self.fsm = int(FsmState.READY)
            coordinator.enable.begin(sides)
            coordinator.choose_spaces(sides, self.now_ns)
            for side in sides:
                is_pose = coordinator.body.arms[side].space is Space.POSE
                coordinator.body.arms[side].start(self.pose[side] if is_pose else self.q_rad[side], self.now_ns)
            coordinator.body.heartbeat.ones(self.now_ns)
            coordinator.go(State.ACTIVE, self.now_ns, "test")
            self.run(3)
            coordinator.go(state, self.now_ns, "test")

    # ---------------------------------------------------------------------------------------------- the robot and time

    def hear(self) -> None:
        """The robot says what it has to say, now."""
        store = self.coordinator.store
        for side in Side:
            if side not in self.dumb:
                value = ArmState(q_rad=self.q_rad[side], dq_radps=(), tau_nm=(), stamp_ns=self.now_ns + OFFSET_NS)
                topic = arm_state(side)
                store.receive(SampleArrived(topic=topic, value=value, received_ns=self.now_ns), self.now_ns)
            if side in self.poses:
                pose = EePose(p_m=self.pose[side][:3], quat_xyzw=self.pose[side][3:])
                topic = ee_pose(side)
                store.receive(SampleArrived(topic=topic, value=pose, received_ns=self.now_ns), self.now_ns)
        for topic, said in ((FSM_STATE, self.fsm), (CURRENT_MODE, self.mode)):
            if said is not None:
                store.receive(SampleArrived(topic=topic, value=said, received_ns=self.now_ns), self.now_ns)

    def run(self, ticks: int) -> list[Frame]:
        """Let time pass; return what was due, unjudged by the gate."""
        due: list[Frame] = []
        for _ in range(ticks):
            self.now_ns += TICK_NS
            self.hear()
            frames = [stream.frame(self.now_ns) for stream in self.coordinator.body.streams if stream.running]
            due += [frame for frame in frames if frame is not None]
        return due

    def push(self, side: Side, by_rad: float) -> None:
        """The first joint of an arm is moved by hand, in steps that the store believes."""
        steps = round(abs(by_rad) / 0.1) + 1
        for _ in range(steps):
            first, *others = self.q_rad[side]
            self.q_rad[side] = (first + by_rad / steps, *others)
            self.run(1)

    def shift(self, side: Side, by_m: float) -> None:
        """The end effector is moved by hand along its x axis."""
        x, *others = self.pose[side]
        self.pose[side] = (x + by_m, *others)
        self.run(1)

    def say_mode(self, **changes: object) -> None:
        """The robot's mode changes, and is heard at once."""
        self.mode = replace(MODE, **changes)
        self.hear()

    # ---------------------------------------------------------------------------------------------- clients

    def command(self, request: Request, client: str = "ann", received_ns: int | None = None) -> CommandRequested:
        """A request as it arrives now, or when it is said to have arrived."""
        at_ns = self.now_ns if received_ns is None else received_ns
        return CommandRequested(client_id=client, request_id=1, request=request, received_ns=at_ns)

    # ---------------------------------------------------------------------------------------------- what is seen

    @property
    def state(self) -> State:
        """Where the supervisor is."""
        return self.coordinator.state

    def told(self, code: Code) -> list[str]:
        """Messages of the notices with a code."""
        return [notice.message for notice in self.coordinator.notices if notice.code is code]
