"""What comes in made fit for the engine, and what the engine gives made fit for the wire.

Rules
    * What a request asks for is the core's to judge, its form too.
    * Text of clients is shown to people and written to logs: what cannot be printed is replaced, and it is cut.
    * A stop comes through whatever its reason looks like.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TypeVar

from msgspec import structs

import gateway
from gateway.api import protocol
from gateway.api.keys import printable
from gateway.core.messages import events, outputs
from gateway.core.motion.chunk import Chunk
from gateway.core.requests.follows import worked_out
from gateway.errors import Refusal
from gateway.messages.requests import CheckFollow, Follow, Request
from gateway.robot.topics import ARM_JOINTS
from gateway.settings.settings import Settings
from gateway.values import Side, Vector

__all__ = ["config_hash", "describe", "to_notice", "to_refusal", "to_reply", "to_request", "to_target"]

_R = TypeVar("_R", bound=Request)


def to_request(request: Request) -> tuple[Request, Chunk | None] | Refusal:
    """Return a request that is fit to be shown and judged, and the motion through its points if it has any; or a refusal.

    Args:
        request: As decoded.
    """
    chunk = worked_out(request) if isinstance(request, (Follow, CheckFollow)) else None
    if isinstance(chunk, Refusal):
        return chunk
    return _shown(request), chunk


def _shown(request: _R) -> _R:
    """Return a request whose texts can be shown."""
    changed: dict[str, object] = {}
    for name in request.__struct_fields__:
        value = getattr(request, name)
        if type(value) is str:  # an enum is one of its own words
            changed[name] = printable(value)
        elif name == "frames":
            changed[name] = {side: printable(frame) for side, frame in value.items()}
        elif name == "follow":
            changed[name] = _shown(value)
    return structs.replace(request, **changed) if changed else request


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


def to_reply(reply: outputs.Reply, after_seq: int) -> protocol.Reply:
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


def to_notice(notice: outputs.Notice) -> protocol.Notice:
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
        namespace=settings.link.namespace,
        model=settings.link.model,
        has_lift=settings.link.variant.has_lift,
        config_hash=config_hash(settings),
        joint_names={side.value: ARM_JOINTS[side] for side in Side},
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
