"""Grippers, chassis and lift, tick by tick: what ends a drive by itself, after requests and before frames.

Rules
    * A velocity without a successor runs out: the chassis ramps down, the lift stops.
    * A drive ends with the lease, the state, the mode and the switches under which it may begin. Most of it is cut where
      it happens, by the supervisor's table; here nothing is left over.
    * The lift is kept at [0,1] while somebody owns or holds the robot, and taken off with [0,0] afterwards. A robot that is
      out of reach, in VR mode, plays a recording or takes somebody else's commands is not ours: the lift then falls silent
      after its stop.
"""

from __future__ import annotations

from gateway.codes import Code
from gateway.core.limits import ground_rules as rules
from gateway.core.messages.outputs import Level
from gateway.core.streams.ground import LIFT_OFF, GroundStream
from gateway.core.supervision.coordinator import Coordinator
from gateway.core.supervision.grip import Grips
from gateway.core.supervision.supervisor import STREAMING, Trigger
from gateway.errors import Refusal
from gateway.values import OWN_FSM

__all__ = ["Drives"]


class Drives:
    """Looks after chassis and lift, and at the grippers (`grip.py`)."""

    def __init__(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator
        self._grips = Grips(coordinator)

    def step(self, now_ns: int) -> None:
        """Do what is due."""
        coordinator, body = self._coordinator, self._coordinator.body
        store = coordinator.store
        self._grips.step(now_ns)
        if body.chassis.is_driven:
            self._check("chassis", body.chassis, rules.check_chassis(store.mode(now_ns), store.fsm(now_ns)), now_ns)
        if body.lift is not None:
            if body.lift.is_driven:
                check = rules.check_lift(store.mode(now_ns), store.fsm(now_ns))
                self._check("lift", body.lift, check, now_ns)
            if body.lift.is_in_use:
                self._keep_or_end(now_ns)

    def _check(self, name: str, ground: GroundStream, refusal: Refusal | None, now_ns: int) -> None:
        """Stop a group that may not be driven any more; else let its velocity run out in time."""
        why = self._over(ground) or refusal
        if why is not None:
            ground.cut(why.code, now_ns)
            message = f"the {name} stops: {why.message}"
            self._coordinator.notice(why.code, Level.WARNING, message, now_ns, part=name)
        elif ground.expire(now_ns):
            how = "ramps down" if name == "chassis" else "stops"
            message = f"no velocity came in time: the {name} {how}"
            self._coordinator.notice(Code.TARGET_EXPIRED, Level.WARNING, message, now_ns, part=name)

    def _over(self, ground: GroundStream) -> Refusal | None:
        """Return why the owner's drive is over, whatever the robot says."""
        coordinator = self._coordinator
        if ground.epoch != coordinator.lease.valid_epoch:
            is_lost = ground.epoch == coordinator.lease.epoch and coordinator.lease.owner is not None
            code = Code.CLIENT_LOST if is_lost else Code.LEASE_LOST
            return Refusal(code=code, message="its owner is lost" if is_lost else "its owner has the lease no more")
        for code, message in coordinator.supervisor.latches.items():
            return Refusal(code=code, message=message)
        rivals = coordinator.others.armed_text()
        if rivals and not coordinator.claim.is_open:  # while it is they may be the ones who yield, and nothing leaves
            return Refusal(code=Code.OTHER_GATEWAY, message=f"another {rivals}")
        code_of_state = coordinator.supervisor.cell(Trigger.GROUND_COMMAND).refuse
        return (
            None
            if code_of_state is None
            else Refusal(code=code_of_state, message=f"the gateway is {coordinator.state}")
        )

    def _keep_or_end(self, now_ns: int) -> None:
        """Keep the lift's servo on, or end its use."""
        coordinator, lift = self._coordinator, self._coordinator.body.lift
        assert lift is not None, "a lift is in use"
        mode, fsm = coordinator.store.mode(now_ns), coordinator.store.fsm(now_ns)
        is_theirs = (mode is not None and not mode.api) or (fsm is not None and fsm not in OWN_FSM)
        if not coordinator.transport_up or is_theirs or coordinator.others.has_command_of(lift.topic, now_ns):
            lift.let_go()
        elif coordinator.lease.owner is None and not self._is_held:
            lift.then(LIFT_OFF)

    @property
    def _is_held(self) -> bool:
        coordinator = self._coordinator
        return coordinator.state in STREAMING or coordinator.stale_hold or coordinator.can_resume
