"""Protocol structs to core values and back: the only module that knows both.

Rules
    * Form is judged here (how many joints, which sides), with the door's code; limits and finiteness are the core's.
    * Text of clients is shown to people and written to logs: what cannot be printed is replaced, and it is cut.
    * A stop comes through whatever its reason looks like.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from msgspec import structs

import gateway
from gateway import robot
from gateway.api import protocol
from gateway.core.messages import events
from gateway.core.motion.chunk import prepare
from gateway.errors import Code, Refusal
from gateway.settings import Settings
from gateway.values import ARM_DOF, Side, Space, Vector

__all__ = ["config_hash", "describe", "printable", "to_notice", "to_refusal", "to_reply", "to_request", "to_target"]

POSE_WIDTH = 7
"""Numbers of a pose: position and quaternion."""

MAX_REASON = 256
"""Longest text of a client that is passed on or logged [characters]."""


def to_request(request: protocol.Request) -> events.Request | Refusal:
    """Return the core's request, or why it cannot be one.

    Args:
        request: As decoded.

    Returns:
        The request, or a refusal with WRONG_SHAPE.
    """
    match request:
        case protocol.Acquire():
            return events.Acquire(name=printable(request.name), pid=request.pid, on_loss=events.OnLoss(request.on_loss))
        case protocol.Take():
            return events.Take(
                name=printable(request.name),
                pid=request.pid,
                reason=printable(request.reason),
                on_loss=events.OnLoss(request.on_loss),
            )
        case protocol.Release():
            return events.Release(epoch=request.epoch)
        case protocol.Abandon():
            return events.Abandon(epoch=request.epoch)
        case protocol.Enable():
            return events.Enable(epoch=request.epoch)
        case protocol.Disable():
            return events.Disable(epoch=request.epoch)
        case protocol.Move():
            return _to_move(request)
        case protocol.Follow():
            return _to_follow(request)
        case protocol.CheckFollow():
            follow = _to_follow(request.follow)
            return (
                follow
                if isinstance(follow, Refusal)
                else events.CheckFollow(follow=follow, from_here=request.from_here)
            )
        case protocol.MovePose():
            return _to_move_pose(request)
        case protocol.OpenStream():
            return events.OpenStream(
                epoch=request.epoch,
                side=Side(request.side),
                space=Space(request.space),
                frame=printable(request.frame),
                speed=request.speed,
                on_limit=events.OnLimit(request.on_limit),
                expiry_ns=request.expiry_ns,
            )
        case protocol.CloseStream():
            return events.CloseStream(epoch=request.epoch, stream_id=request.stream_id)
        case protocol.Hold():
            sides = tuple(side for side in Side if side.value in request.sides)
            return events.Hold(epoch=request.epoch, sides=sides) if sides else _no_arm("sides")
        case protocol.Cancel():
            return events.Cancel(epoch=request.epoch, motion_id=request.motion_id)
        case protocol.SetGripper():
            return events.SetGripper(epoch=request.epoch, side=Side(request.side), raw=request.raw)
        case protocol.DriveChassis():
            return events.DriveChassis(**structs.asdict(request))
        case protocol.StopChassis():
            return events.StopChassis(epoch=request.epoch)
        case protocol.DriveLift():
            return events.DriveLift(**structs.asdict(request))
        case protocol.StopLift():
            return events.StopLift(epoch=request.epoch)
        case protocol.DisableLift():
            return events.DisableLift(epoch=request.epoch)
        case protocol.Stop():
            return events.Stop(reason=printable(request.reason))
        case protocol.Estop():
            return events.Estop(reason=printable(request.reason))
        case protocol.Recover():
            return events.Recover(reason=printable(request.reason))
        case protocol.RegisterEndpoint():
            return events.RegisterEndpoint(
                name=printable(request.name),
                timeout_ns=request.timeout_ns,
                on_silence=events.OnLoss(request.on_silence),
            )
        case protocol.LeaveEndpoint():
            return events.LeaveEndpoint()


def _to_move(move: protocol.Move) -> events.Move | Refusal:
    if not move.targets_rad:
        return _no_arm("targets_rad")
    for side, q_rad in move.targets_rad.items():
        if len(q_rad) != ARM_DOF:
            return Refusal(
                code=Code.WRONG_SHAPE,
                message=f"the {side} arm got {len(q_rad)} joint values, {ARM_DOF} are needed (manual §4.0.3)",
                field=f"{side}_arm",
                value=str(len(q_rad)),
                bound=str(ARM_DOF),
            )
    return events.Move(
        epoch=move.epoch,
        targets_rad={Side(side): q_rad for side, q_rad in move.targets_rad.items()},
        relative=move.relative,
        speed=move.speed,
        tolerance_rad=move.tolerance_rad,
        on_limit=events.OnLimit(move.on_limit),
    )


def _to_follow(follow: protocol.Follow) -> events.Follow | Refusal:
    """Work out the motion through the points here: it takes some milliseconds, which the loop does not have."""
    chunk = prepare(
        {side: follow.points[side.value] for side in Side if side.value in follow.points},
        dt_s=follow.dt_s,
        times_s=follow.times_s,
        stretch=follow.stretch,
        smoothing_s=follow.smoothing_s,
        space=Space(follow.space),
    )
    if isinstance(chunk, Refusal):
        return chunk
    return events.Follow(
        epoch=follow.epoch,
        chunk=chunk,
        frames={Side(side): printable(frame) for side, frame in follow.frames.items()},
        open_end=follow.open_end,
        start_at_ns=follow.start_at_ns,
        start_in_ns=follow.start_in_ns,
        path_tolerance={Side(side): values for side, values in follow.path_tolerance.items()},
        goal_tolerance={Side(side): values for side, values in follow.goal_tolerance.items()},
        goal_time_ns=follow.goal_time_ns,
    )


def _to_move_pose(move: protocol.MovePose) -> events.MovePose | Refusal:
    if not move.targets:
        return _no_arm("targets")
    for side, values in move.targets.items():
        if len(values) != POSE_WIDTH:
            return Refusal(
                code=Code.WRONG_SHAPE,
                message=f"the {side} arm got a pose of {len(values)} values, {POSE_WIDTH} are needed: "
                "x, y, z, qx, qy, qz, qw",
                field=f"{side}_arm",
                value=str(len(values)),
                bound=str(POSE_WIDTH),
            )
    return events.MovePose(
        epoch=move.epoch,
        targets={Side(side): values for side, values in move.targets.items()},
        frames={Side(side): printable(frame) for side, frame in move.frames.items()},
        speed=move.speed,
        tolerance_m=move.tolerance_m,
        tolerance_rad=move.tolerance_rad,
        on_limit=events.OnLimit(move.on_limit),
        straight=move.straight,
    )


def _no_arm(field: str) -> Refusal:
    return Refusal(
        code=Code.WRONG_SHAPE,
        message="no arm is named, one or two are needed (left, right)",
        field=field,
        value="0",
        bound="[1, 2]",
    )


def printable(text: str) -> str:
    """Return a text that can be shown in a terminal or a log: no control characters, at most `MAX_REASON` long."""
    return "".join(c if c.isprintable() else "?" for c in text[:MAX_REASON])


def to_target(target: protocol.Target, client_id: str, stream_id: int, received_ns: int) -> events.TargetArrived:
    """Return a streamed target as the core takes it; the core judges its length, finiteness and limits.

    Args:
        target: As decoded.
        client_id: From the key.
        stream_id: From the key.
        received_ns: Local monotonic arrival [ns].
    """
    return events.TargetArrived(
        client_id=client_id,
        stream_id=stream_id,
        epoch=target.epoch,
        seq=target.seq,
        values=target.values,
        received_ns=received_ns,
    )


def to_reply(reply: events.Reply, after_seq: int) -> protocol.Reply:
    """Return a reply as it is sent.

    Args:
        reply: From the engine.
        after_seq: Number of the newest snapshot that may not show the effect yet.
    """
    return protocol.Reply(
        request_id=reply.request_id,
        refusal=None if reply.refusal is None else to_refusal(reply.refusal),
        facts={name: _plain(value) for name, value in reply.facts.items()},
        after_seq=after_seq,
    )


def _plain(value: object) -> object:
    """Return a fact in types that both encodings know."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(item) for item in value]
    return value


def to_refusal(refusal: Refusal) -> protocol.RefusalMessage:
    """Return a refusal as it is sent."""
    return protocol.RefusalMessage(**asdict(refusal) | {"code": refusal.code.value})


def to_notice(notice: events.Notice) -> protocol.Notice:
    """Return a notice as it is sent."""
    return protocol.Notice(
        code=notice.code.value,
        level=notice.level.value,
        message=notice.message,
        at_ns=notice.at_ns,
        facts=dict(notice.facts),
    )


def describe(settings: Settings, *, socket: str, pid: int) -> protocol.Info:
    """Return what a daemon with these settings says about itself.

    Args:
        settings: Effective settings.
        socket: Path of its unix socket.
        pid: Its process id.
    """
    arm, pose = settings.arm, settings.pose
    return protocol.Info(
        version=gateway.__version__,
        protocol=protocol.PROTOCOL_VERSION,
        pid=pid,
        socket=socket,
        robot=settings.link.endpoint,
        model=settings.link.model,
        has_lift=settings.link.variant.has_lift,
        config_hash=config_hash(settings),
        joint_names={side.value: robot.ARM_JOINTS[side] for side in Side},
        lower_rad=_per_side(arm.lower_rad),
        upper_rad=_per_side(arm.upper_rad),
        v_radps=arm.v_radps,
        a_radps2=arm.a_radps2,
        j_radps3=arm.j_radps3,
        arm_rate_hz=arm.rate_hz,
        snapshot_hz=settings.local.snapshot_hz,
        settle_rad=arm.settle_rad,
        settle_ns=arm.settle_ns,
        tracking_rad=arm.tracking_rad,
        pose_rate_hz=pose.rate_hz,
        pose_v_mps=pose.v_mps,
        pose_w_radps=pose.w_radps,
        reach_m=pose.reach_m,
        settle_pose_m=pose.settle_m,
        settle_pose_rad=pose.settle_rad,
        tracking_pose_m=pose.tracking_m,
        tracking_pose_rad=pose.tracking_rad,
        target_expiry_ns=arm.target_expiry_ns,
        chassis_v_mps=settings.chassis.v_mps,
        chassis_w_radps=settings.chassis.w_radps,
        chassis_expiry_ns=settings.chassis.expiry_ns,
        lift_v_max=settings.lift.v_max,
        lift_expiry_ns=settings.lift.expiry_ns,
        keepalive_ns=settings.loss.keepalive_ns,
        free_after_ns=settings.loss.free_after_ns,
        down_after_ns=settings.loss.down_after_ns,
    )


def _per_side(vectors: Mapping[Side, Vector]) -> dict[str, tuple[float, ...]]:
    return {side.value: tuple(vectors[side]) for side in Side}


def config_hash(settings: Settings) -> str:
    """Return 16 hexadecimal digits that change with any setting."""
    return hashlib.sha256(repr(settings).encode()).hexdigest()[:16]
