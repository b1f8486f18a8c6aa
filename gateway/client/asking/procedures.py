"""What a client does, step by step, without waiting: generators that yield what to wait for and get it sent back.

The blocking and the async client run the same procedures; they differ in how they wait. A step that fails is raised
inside the procedure, so that it can clean up.

Rules
    * The daemon only accepts; whether something *happened* is read from snapshots newer than the reply.
    * Every procedure ends: each wait in it has a deadline.
    * What failed to end well leaves the robot held: the lease is given back by `release` alone.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from msgspec import structs

from gateway.api import protocol
from gateway.client.asking.requests import chosen
from gateway.client.asking.results import MotionResult, StopResult
from gateway.client.asking.waits import (
    Answer,
    Daemon,
    Seen,
    Stopped,
    Wait,
    answered_reply,
)
from gateway.client.connection.identity import is_of_this_process
from gateway.client.connection.session import Lease, Motion, Session, Sighting
from gateway.errors import Aborted, Cancelled, Code, GatewayError, MotionEnded, Superseded, failure, to_exception

__all__ = [
    "REQUEST_NS",
    "Procedure",
    "abandon",
    "acquire",
    "cancel",
    "disable",
    "enable",
    "get_info",
    "get_routes",
    "greet",
    "open_stream",
    "release",
    "request",
    "result",
    "start_motion",
    "stop",
]

T = TypeVar("T")
MovesT = TypeVar("MovesT", bound=protocol.IncomingMotion)

Procedure = Generator[Wait[Any], Any, T]
"""Yields waits, is sent what they gave, returns a `T`."""

REQUEST_NS = 3_000_000_000
"""How long to wait for a reply [ns]; the daemon answers within 2 s."""

AT_REST = 1e-3
"""A reference slower than this stands still [rad/s, m/s]."""

MOVING = frozenset({"ENABLING", "ACTIVE", "HOLDING", "PAUSED", "STOPPING"})
"""States in which something of ours still goes to the arms."""


# --------------------------------------------------------------------------------------------------------- asking


def request(session: Session, command: protocol.Request, timeout_ns: int = REQUEST_NS) -> Procedure[protocol.Reply]:
    """Ask for something and return the accepting reply.

    Raises:
        GatewayError: The daemon refused; the class is that of the code.
        OutcomeUnknown: The reply was lost.
        Disconnected: No daemon is there; nothing was sent.
    """
    what = type(command).__name__
    payload = session.encode(command, session.next_request_id())
    reply: protocol.Reply = yield Answer(
        session, protocol.COMMAND_KEY, payload, answered_reply, timeout_ns, f"{what} of {session.name!r}"
    )
    return reply


def get_info(session: Session) -> Procedure[protocol.Info]:
    """Return what does not change while the daemon runs; asked once per daemon."""
    if session.info is None:
        session.info = yield Answer(session, protocol.INFO_KEY, b"", protocol.decode_info, REQUEST_NS, "info")
    return session.info


def get_routes(session: Session) -> Procedure[protocol.Routes]:
    """Return how the robot's bridge stands to each topic, as it is now."""
    routes: protocol.Routes = yield Answer(
        session, protocol.ROUTES_KEY, b"", protocol.decode_routes, REQUEST_NS, "the state of the routes"
    )
    return routes


def greet(session: Session, timeout_ns: int) -> Procedure[None]:
    """Wait until a daemon is there, and learn its facts and its first snapshot."""
    yield Daemon(session, timeout_ns)
    yield from get_info(session)
    yield Seen(session, lambda sighting: sighting, timeout_ns, "the first snapshot")


def _fact(reply: protocol.Reply, name: str) -> int:
    value = reply.facts.get(name)
    if not isinstance(value, int):
        raise failure(Code.UNSUPPORTED_VERSION, f"the reply has no number {name!r} but {value!r}")
    return value


# ------------------------------------------------------------------------------------------------------- the lease


def acquire(session: Session, on_loss: protocol.OnLossName, take: str | None, timeout_ns: int) -> Procedure[Lease]:
    """Become the owner; with `take` from whoever it is, and then wait until the arms are at rest.

    `take` is the reason to take the robot from its owner, None to ask for a free one; `timeout_ns` is for the arms to
    come to rest after taking over.

    Raises:
        LeaseError: LEASE_HELD, somebody else owns the robot, or another `control()` of this client does, or asks for it.
        Rejected: BAD_REQUEST, an empty reason to take it.
    """
    yield from get_info(session)
    session.forget_lost()
    session.keep_alive()
    lease: Lease | None = None
    try:
        name, pid, loss = session.name, session.pid, chosen(protocol.OnLoss, "on_loss", on_loss)
        command: protocol.Request = protocol.Acquire(name=name, pid=pid, on_loss=loss)
        if take is not None:
            command = protocol.Take(name=name, pid=pid, reason=take, on_loss=loss)
        reply = yield from request(session, command)
        lease = session.own(_fact(reply, "epoch"))
        seen = _rests if take is not None else _any
        yield Seen(session, seen, timeout_ns, "seeing the robot owned and at rest", after_seq=reply.after_seq)
    except BaseException as error:  # Ctrl-C included: nobody gets this lease, so nobody may look alive for it
        if lease is None:
            session.let_go(None)
        else:
            session.abandon(lease)
        if isinstance(error, GatewayError):
            raise _held_here(session, error) from None
        raise
    return lease


def _held_here(session: Session, error: GatewayError) -> GatewayError:
    """Return a LEASE_HELD that says so when it is this very process that owns the robot, by another connection."""
    sighting = session.sighting()
    if error.code is not Code.LEASE_HELD or sighting is None or not is_of_this_process(sighting.view.lease.client_id):
        return error
    hint = "another connection of this process owns it (a notebook cell that ran twice?): release() or close() that one"
    return to_exception(replace(error.refusal, hint=hint))


def release(session: Session, lease: Lease, timeout_ns: int) -> Procedure[None]:
    """Give the lease back and wait until the robot was paused and nothing is sent any more. A lost lease is fine."""
    deadline_ns = session.transport.now_ns() + timeout_ns
    try:
        reply = yield from request(session, protocol.Release(epoch=lease.epoch))
    except GatewayError as error:
        if error.code in (Code.NOT_OWNER, Code.LEASE_STALE):
            session.let_go(lease)
            return
        raise
    session.let_go(lease)

    def at_rest(sighting: Sighting) -> bool | None:
        view = sighting.view
        taken_over = view.lease.owned and view.lease.epoch != lease.epoch
        return True if taken_over or _is_down(sighting) else None

    left_ns = max(0, deadline_ns - session.transport.now_ns())
    yield Seen(session, at_rest, left_ns, "coming to rest after the release", after_seq=reply.after_seq)


def abandon(session: Session, lease: Lease) -> Procedure[None]:
    """Leave the robot held, and wait until the daemon has said that it knows."""
    session.let_go(lease)
    try:
        yield from request(session, protocol.Abandon(epoch=lease.epoch))
    except GatewayError as error:
        if error.code not in (Code.NOT_OWNER, Code.LEASE_STALE):
            raise


def enable(session: Session, lease: Lease, timeout_ns: int) -> Procedure[None]:
    """Bring the FSM to READY and wait for it.

    Raises:
        NotReady: What is missing, at once or when the daemon gave up.
        GatewayTimeout: Neither in time.
    """
    deadline_ns = session.transport.now_ns() + timeout_ns
    reply = yield from request(session, protocol.Enable(epoch=lease.epoch))
    attempt = _fact(reply, "attempt")
    left_ns = max(0, deadline_ns - session.transport.now_ns())

    def enabled(sighting: Sighting) -> bool | None:
        _require_lease(session, sighting, lease)
        latest = sighting.view.enable
        if latest.attempt > attempt:
            raise failure(Code.SUPERSEDED, f"enabling {attempt} was begun again")
        if latest.attempt < attempt or latest.outcome == "running":
            return None
        if latest.outcome != "ok":
            raise _ended(latest.code, latest.message, "enabling failed")
        return True

    def led_back(sighting: Sighting) -> bool | None:
        _require_lease(session, sighting, lease)
        near = all(_is_tracking(arm, session.info) for arm in sighting.view.arms.values())
        return True if near and _rests(sighting) else None

    if reply.facts.get("outcome") != "ok":
        yield Seen(session, enabled, left_ns, "reaching READY", after_seq=reply.after_seq)
    elif reply.facts.get("walking"):
        yield Seen(session, led_back, left_ns, "leading the reference back to the arms", after_seq=reply.after_seq)


def _is_tracking(arm: protocol.ArmView, info: protocol.Info | None) -> bool:
    """Return whether an arm is as near to its setpoint as it must be for a motion."""
    if info is None or arm.tracking_rad is None or arm.tracking_m is None:
        return arm.tracking_rad is None or (info is not None and arm.tracking_rad <= info.tracking_rad)
    return arm.tracking_rad <= info.tracking_pose_rad and arm.tracking_m <= info.tracking_pose_m


def disable(session: Session, lease: Lease, timeout_ns: int) -> Procedure[None]:
    """Brake to rest, pause the robot, and wait until nothing is sent any more; the lease stays."""
    deadline_ns = session.transport.now_ns() + timeout_ns
    reply = yield from request(session, protocol.Disable(epoch=lease.epoch))
    left_ns = max(0, deadline_ns - session.transport.now_ns())
    yield Seen(
        session,
        _is_down,
        left_ns,
        "coming to rest after disable()",
        after_seq=reply.after_seq,
    )


def _is_down(sighting: Sighting) -> bool | None:
    """Return True when nothing goes to the arms and the heartbeat is silent: its 0.0 was answered, or given up."""
    heartbeat = sighting.view.streams.get(protocol.HEARTBEAT_TOPIC)
    is_beating = heartbeat is not None and heartbeat.running
    return None if is_beating or sighting.view.state in MOVING else True


def _require_lease(session: Session, sighting: Sighting, lease: Lease) -> None:
    """Refuse when a snapshot shows that somebody else owns the robot, or nobody."""
    now = sighting.view.lease
    if not now.owned or now.epoch != lease.epoch:
        owner = f"{now.name!r} (pid {now.pid})" if now.owned else "nobody"
        with session.changed:
            said = session.news.takeover(now.epoch) or f"{owner} owns the robot now"
        raise failure(Code.LEASE_LOST, f"epoch {lease.epoch} is over: {said}")


def _any(_: Sighting) -> bool:
    """Take any snapshot: from then on the state shows the lease."""
    return True


def _rests(sighting: Sighting, sides: tuple[str, ...] = ("left", "right")) -> bool | None:
    """Return True when the references of these arms stand still (or none is sent)."""
    for side in sides:
        arm = sighting.view.arms[side]
        if arm.streaming and any(
            abs(speed) > AT_REST for speed in (*arm.dq_ref_radps, *arm.ref_v_mps, *arm.ref_w_radps)
        ):
            return None
    return True


# --------------------------------------------------------------------------------------------------------- motions


def start_motion(
    session: Session, command: protocol.Move | protocol.MovePose | protocol.Follow
) -> Procedure[tuple[Motion, Mapping[str, Any]]]:
    """Ask for a motion; returns its record and the facts of the reply."""
    reply = yield from request(session, _knowing(session, command))
    return session.follow(_fact(reply, "motion_id"), reply.after_seq), reply.facts


def _knowing(session: Session, command: MovesT) -> MovesT:
    """Return a request with the newest touch that its user was told of, where it is to end at one."""
    if command.until is None:
        return command
    return structs.replace(command, until=structs.replace(command.until, seen=session.touch_seen))


def result(session: Session, motion: Motion, timeout_ns: int) -> Procedure[MotionResult]:
    """Wait until a motion has ended, and the hand is back where it was to go back at a touch.

    Raises:
        MotionEnded: Aborted, Cancelled or Superseded; code and message say why.
        OutcomeUnknown: It ended so long ago that the daemon does not list it any more.
        GatewayTimeout: It goes on; the motion is not touched.
    """
    deadline_ns = session.transport.now_ns() + timeout_ns
    if not motion.ended:
        what = f"the end of motion {motion.motion_id}"
        yield Seen(session, lambda _: True if motion.ended else None, timeout_ns, what, after_seq=motion.after_seq)
    view = motion.view
    if motion.missing or view is None:
        session.require_daemon(motion.daemon)
        raise failure(Code.OUTCOME_UNKNOWN, f"motion {motion.motion_id} is not listed any more")
    if view.touch is not None:
        session.touch_seen = max(session.touch_seen, view.touch.number)
        if view.touch.back_id:
            left_ns = max(0, deadline_ns - session.transport.now_ns())
            yield from result(session, session.follow(view.touch.back_id, motion.after_seq), left_ns)
    if view.state in ("reached", "touched"):
        return MotionResult(
            motion_id=view.motion_id,
            sides=view.sides,
            error=view.error_rad,
            duration=view.duration_ns / 1e9,
            error_m=view.error_m,
            touch=view.touch,
        )
    kinds: dict[str, type[MotionEnded]] = {"cancelled": Cancelled, "superseded": Superseded}
    refusal = _ended(view.code, view.message, f"motion {view.motion_id} was {view.state}").refusal
    raise kinds.get(view.state, Aborted)(refusal)


def cancel(session: Session, lease: Lease, motion: Motion, timeout_ns: int) -> Procedure[None]:
    """Brake and end one motion; waits until its arms' references stand still. One that has ended stays as it is."""
    deadline_ns = session.transport.now_ns() + timeout_ns
    session.sighting()
    if motion.missing:  # with its daemon, perhaps
        session.require_lease(lease)
    if motion.ended:
        return
    reply = yield from request(session, protocol.Cancel(epoch=lease.epoch, motion_id=motion.motion_id))

    def at_rest(sighting: Sighting) -> bool | None:
        sides = motion.view.sides if motion.view is not None else ("left", "right")
        return True if motion.ended and _rests(sighting, sides) else None

    left_ns = max(0, deadline_ns - session.transport.now_ns())
    yield Seen(
        session,
        at_rest,
        left_ns,
        f"the standstill after cancelling motion {motion.motion_id}",
        after_seq=reply.after_seq,
    )


def _ended(code: str, message: str, otherwise: str) -> GatewayError:
    return to_exception(protocol.refusal_of(protocol.RefusalMessage(code=code, message=message or otherwise)))


# ------------------------------------------------------------------------------------------------------- the rest


def stop(session: Session, command: protocol.Stop | protocol.Estop) -> Procedure[StopResult]:
    """Stop everything; anybody may."""
    reply: protocol.Reply = yield Stopped(session, command, REQUEST_NS)
    session.stop_undelivered = bool(reply.facts.get("stop_undelivered"))
    return StopResult(undelivered=session.stop_undelivered)


def open_stream(session: Session, command: protocol.OpenStream) -> Procedure[tuple[int, tuple[float, ...], int]]:
    """Open a stream of targets; returns its number, where it starts and the snapshot after which it is listed."""
    reply = yield from request(session, _knowing(session, command))
    start = reply.facts.get("values")
    if not (isinstance(start, (list, tuple)) and all(isinstance(value, (int, float)) for value in start)):
        raise failure(Code.UNSUPPORTED_VERSION, f"the reply has no start but {start!r}")
    return _fact(reply, "stream_id"), tuple(float(value) for value in start), reply.after_seq
