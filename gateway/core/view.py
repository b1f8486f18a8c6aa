"""Builds the snapshot: what the outside may see of store, lease, supervisor, body and loop at one instant."""

from __future__ import annotations

from gateway import robot
from gateway.core.conductor import Conductor
from gateway.core.snapshot import (
    ArmView,
    EnableView,
    LinkView,
    LoopView,
    ModeView,
    MotorView,
    Snapshot,
)
from gateway.values import MotorState, Side

__all__ = ["build"]

ARMS = tuple((side, side.value, robot.arm_state(side), robot.ee_pose(side)) for side in Side)
GRIPPERS = tuple((side.value, robot.gripper_state(side)) for side in Side)
SIDES = tuple((side, side.value) for side in Side)


def build(conductor: Conductor, loop: LoopView, seq: int, now_ns: int) -> Snapshot:
    """Return the snapshot of this instant.

    Args:
        conductor: What is shown.
        loop: Figures of the control loop.
        seq: Number of the snapshot.
        now_ns: Monotonic time [ns].
    """
    store, supervisor, body, enable = conductor.store, conductor.supervisor, conductor.body, conductor.enable
    return Snapshot(
        seq=seq,
        at_ns=now_ns,
        state=supervisor.state.value,
        shown=supervisor.shown,
        latches={code.value: message for code, message in supervisor.latches.items()},
        link=LinkView(
            up=conductor.transport_up,
            router_zid=conductor.router_zid if conductor.transport_up else "",
            fresh=conductor.transport_up and store.is_fresh(now_ns),
            age_ns=store.link_age_ns(now_ns),
        ),
        fsm=store.fsm(now_ns),
        mode=_mode(conductor, now_ns),
        lease=conductor.lease.view(now_ns),
        arms={name: _arm(conductor, side, state, pose, now_ns) for side, name, state, pose in ARMS},
        grippers={name: _motors(conductor, topic, now_ns) for name, topic in GRIPPERS},
        chassis=_motors(conductor, robot.CHASSIS_STATE, now_ns),
        topics={topic: store.topic_view(topic, now_ns) for topic in robot.STATE_TOPICS},
        streams={stream.topic: stream.log.view(now_ns) for stream in body.streams},
        motions=body.motions.views(),
        targets=body.targets.views(),
        enable=EnableView(
            attempt=enable.attempt,
            outcome=enable.outcome,
            code=enable.code.value if enable.code else "",
            message=enable.message,
        ),
        loop=loop,
    )


def _mode(conductor: Conductor, now_ns: int) -> ModeView | None:
    mode = conductor.store.mode(now_ns)
    if mode is None:
        return None
    return ModeView(
        api=mode.api,
        joint_mode={name: mode.joint_mode[side] for side, name in SIDES},
        arm_enabled={name: mode.arm_enabled[side] for side, name in SIDES},
        chassis_enabled=mode.chassis_enabled,
        lift_enabled=mode.lift_enabled,
        collision_check=mode.collision_check,
        age_ns=conductor.store.age_ns(robot.CURRENT_MODE, now_ns) or 0,
    )


def _motors(conductor: Conductor, topic: str, now_ns: int) -> MotorView | None:
    value = conductor.store.value(topic)
    age_ns = conductor.store.age_ns(topic, now_ns)
    if not isinstance(value, MotorState) or age_ns is None:
        return None
    return MotorView(
        q_rad=value.q_rad, dq_radps=value.dq_radps, tau_nm=value.tau_nm, stamp_ns=value.stamp_ns, age_ns=age_ns
    )


def _arm(conductor: Conductor, side: Side, state: str, ee_pose: str, now_ns: int) -> ArmView:
    arm = conductor.body.arms[side]
    pose = conductor.store.pose(side)
    measured = _motors(conductor, state, now_ns)
    is_running, reference = arm.running, arm.reference
    return ArmView(
        measured=measured,
        p_m=pose.p_m if pose else (),
        quat_xyzw=pose.quat_xyzw if pose else (),
        pose_age_ns=conductor.store.age_ns(ee_pose, now_ns),
        q_ref_rad=reference.q_rad if is_running else (),
        dq_ref_radps=reference.dq_radps if is_running else (),
        streaming=is_running,
        tracking_rad=arm.distance_rad(measured.q_rad) if is_running and measured else None,
    )
