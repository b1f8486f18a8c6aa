"""Builds the snapshot: what the outside may see of store, lease, supervisor, body and loop at one instant."""

from __future__ import annotations

from collections.abc import Iterator

from gateway.core.others.others import Others
from gateway.core.supervision.coordinator import Coordinator
from gateway.messages.snapshot import (
    ArmView,
    ChassisView,
    ContactView,
    EnableView,
    Finding,
    GripView,
    GuardView,
    LiftView,
    LinkView,
    LoopView,
    ModelView,
    ModeView,
    MotorView,
    OthersView,
    OtherView,
    RefusalMessage,
    Snapshot,
)
from gateway.robot.limits import gripper_torque_nm
from gateway.robot.topics import CHASSIS_STATE, CURRENT_MODE, STATE_TOPICS, arm_state, ee_pose, gripper_state
from gateway.values import MotorState, Side, Space

__all__ = ["build"]

ARMS = tuple((side, side.value, arm_state(side), ee_pose(side)) for side in Side)
GRIPPERS = tuple((side.value, gripper_state(side)) for side in Side)
SIDES = tuple((side, side.value) for side in Side)


def build(
    coordinator: Coordinator,
    findings: tuple[Finding, ...],
    refusals: dict[str, RefusalMessage],
    loop: LoopView,
    seq: int,
    now_ns: int,
    refused: dict[str, int],
) -> Snapshot:
    """Return the snapshot of this instant."""
    reading = coordinator.reading
    store, supervisor, body, enable = coordinator.store, coordinator.supervisor, coordinator.body, coordinator.enable
    return Snapshot(
        seq=seq,
        at_ns=now_ns,
        state=supervisor.state.value,
        shown=supervisor.shown,
        latches={code.value: message for code, message in supervisor.latches.items()},
        link=LinkView(
            up=coordinator.transport_up,
            router_zid=coordinator.router_zid if coordinator.transport_up else "",
            fresh=coordinator.transport_up and store.is_fresh(now_ns),
            age_ns=store.link_age_ns(now_ns),
        ),
        fsm=store.fsm(now_ns),
        mode=_mode(coordinator, now_ns),
        lease=coordinator.lease.view(now_ns),
        arms={name: _arm(coordinator, side, state, pose, now_ns) for side, name, state, pose in ARMS},
        grippers={name: _motors(coordinator, topic, now_ns) for name, topic in GRIPPERS},
        chassis=_motors(coordinator, CHASSIS_STATE, now_ns),
        topics={topic: store.topic_view(topic, now_ns) for topic in STATE_TOPICS},
        streams={stream.topic: stream.log.view(now_ns) for stream in body.streams},
        motions=body.motions.views(),
        targets=body.targets.views(),
        grips={name: _grip(coordinator, side) for side, name in SIDES},
        drive=_drive(coordinator, now_ns),
        lift=_lift(coordinator, now_ns),
        enable=EnableView(
            attempt=enable.attempt,
            outcome=enable.outcome,
            code=enable.code.value if enable.code else "",
            message=enable.message,
        ),
        loop=loop,
        findings=findings,
        refusals=refusals,
        refused=refused,
        guard=GuardView(
            expected=coordinator.settings.guard.enabled,
            pid=coordinator.guard.pid,
            linked=coordinator.guard.is_linked,
            lost=coordinator.guard.lost,
            earlier_holds=coordinator.guard.earlier_holds,
        ),
        others=OthersView(
            zid=coordinator.others.own_zid,
            armed=coordinator.claim.is_confirmed,
            seen=tuple(_others(coordinator.others, now_ns)),
        ),
        settings_read_ns=reading.at_ns if reading else 0,
        settings_refused=reading.message if reading and reading.is_refused else "",
        spacing=body.spacing,
        slowing={side.value: view for side, view in body.slowing.items()},
        endpoints=coordinator.endpoints.views(now_ns),
    )


def _others(others: Others, now_ns: int) -> Iterator[OtherView]:
    for trace in others.data(now_ns):
        yield OtherView(
            kind="data",
            topic=trace.topic,
            zid=trace.zid,
            link=trace.link,
            since_ns=trace.since_ns,
            last_ns=trace.last_ns,
            count=trace.count,
            armed=False,
        )
    for writer in others.writers:
        yield OtherView(
            kind=writer.means.value,
            topic=writer.topic,
            zid=writer.zid,
            link=writer.link,
            since_ns=others.since_ns(writer),
            last_ns=None,
            count=0,
            armed=False,
        )
    for gateway in others.gateways:
        yield OtherView(
            kind="gateway",
            topic="",
            zid=gateway.zid,
            link=gateway.link,
            since_ns=others.since_ns(gateway),
            last_ns=None,
            count=0,
            armed=gateway.is_armed,
        )


def _mode(coordinator: Coordinator, now_ns: int) -> ModeView | None:
    mode = coordinator.store.mode(now_ns)
    if mode is None:
        return None
    return ModeView(
        api=mode.api,
        joint_mode={name: mode.joint_mode[side] for side, name in SIDES},
        arm_enabled={name: mode.arm_enabled[side] for side, name in SIDES},
        chassis_enabled=mode.chassis_enabled,
        lift_enabled=mode.lift_enabled,
        collision_check=mode.collision_check,
        age_ns=coordinator.store.age_ns(CURRENT_MODE, now_ns) or 0,
    )


def _motors(coordinator: Coordinator, topic: str, now_ns: int) -> MotorView | None:
    value = coordinator.store.value(topic)
    age_ns = coordinator.store.age_ns(topic, now_ns)
    if not isinstance(value, MotorState) or age_ns is None:
        return None
    return MotorView(
        q_rad=value.q_rad, dq_radps=value.dq_radps, tau_nm=value.tau_nm, stamp_ns=value.stamp_ns, age_ns=age_ns
    )


def _arm(coordinator: Coordinator, side: Side, state: str, ee_pose: str, now_ns: int) -> ArmView:
    arm = coordinator.body.arms[side]
    pose = coordinator.store.pose(side)
    measured = _motors(coordinator, state, now_ns)
    values, rates, off = (arm.values, arm.rates, coordinator.measured(side)) if arm.running else ((), (), None)
    gap, is_pose = None if off is None else arm.distance(off), arm.space is Space.POSE
    return ArmView(
        measured=measured,
        p_m=pose.p_m if pose else (),
        quat_xyzw=pose.quat_xyzw if pose else (),
        pose_age_ns=coordinator.store.age_ns(ee_pose, now_ns),
        space=arm.space.value,
        q_ref_rad=() if is_pose else values,
        dq_ref_radps=() if is_pose else rates,
        ref_p_m=values[:3] if is_pose else (),
        ref_quat_xyzw=values[3:] if is_pose else (),
        ref_v_mps=rates[:3] if is_pose else (),
        ref_w_radps=rates[3:] if is_pose else (),
        streaming=arm.running,
        tracking_rad=None if gap is None else gap.rad,
        tracking_m=gap.m if gap is not None and is_pose else None,
        model=_model(coordinator, side, now_ns),
        contact=_contact(coordinator, side, now_ns),
        touch=coordinator.body.touches.get(side),
        guard_n=coordinator.settings.model.touch_n(side),
    )


def _model(coordinator: Coordinator, side: Side, now_ns: int) -> ModelView | None:
    if coordinator.model is None:
        return None
    verdict = coordinator.model.verdict(side, now_ns)
    return ModelView(
        state=verdict.state.value,
        reason=verdict.reason,
        pairs=verdict.pairs,
        position_m=verdict.position_m,
        angle_rad=verdict.angle_rad,
        lag_ns=round(1e9 * verdict.lag_s),
    )


def _contact(coordinator: Coordinator, side: Side, now_ns: int) -> ContactView | None:
    contacts = None if coordinator.model is None else coordinator.model.contacts
    return None if contacts is None else contacts.view(side, now_ns)


def _drive(coordinator: Coordinator, now_ns: int) -> ChassisView:
    chassis = coordinator.body.chassis
    return ChassisView(
        driven=chassis.is_driven,
        drive_id=chassis.drive_id,
        code=chassis.code.value if chassis.code else "",
        wanted_mps=chassis.wanted[:2],
        wanted_radps=chassis.wanted[2],
        commanded_mps=chassis.commanded[:2],
        commanded_radps=chassis.commanded[2],
        left_ns=chassis.left_ns(now_ns),
    )


def _lift(coordinator: Coordinator, now_ns: int) -> LiftView | None:
    lift = coordinator.body.lift
    if lift is None:
        return None
    return LiftView(
        driven=lift.is_driven,
        drive_id=lift.drive_id,
        code=lift.code.value if lift.code else "",
        velocity_ratio=lift.commanded,
        servo_on=lift.is_in_use,
        left_ns=lift.left_ns(now_ns),
    )


def _grip(coordinator: Coordinator, side: Side) -> GripView:
    gripper = coordinator.body.grippers[side]
    if not gripper.running:
        return GripView(streaming=False, input_ratio=None, torque_nm=None, holding=None)
    return GripView(
        streaming=True,
        input_ratio=gripper.raw,
        torque_nm=gripper_torque_nm(gripper.raw),
        holding=gripper.is_holding,
    )
