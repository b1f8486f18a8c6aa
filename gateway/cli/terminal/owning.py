"""Owning the robot for the time of a command: getting the lease, and saying what becomes of the arms afterwards."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

from gateway.cli.terminal.figures import since_text
from gateway.cli.terminal.progress import Teller
from gateway.client import Control, Robot, RobotState
from gateway.errors import Code, GatewayError, LeaseError, failure

__all__ = ["HELD", "held_text", "is_held", "lost", "owned"]

HELD = frozenset({"ACTIVE", "HOLDING", "PAUSED", "STOPPING"})
"""States in which arms are held, or will be when they have come to rest."""

LOOK_HZ = 5.0
LOOK_S = 2.0
"""Longest wait for a snapshot while waiting for something else [s]."""
TOLD_S = 0.2
"""Longest silence in which the reason of a takeover is waited for [s]."""


@contextmanager
def owned(robot: Robot, tell: Teller, *, take: str | None, is_left_held: bool) -> Iterator[Control]:
    """Own the robot while the block runs. A block that ends by an exception leaves it held.

    A lease whose owner has vanished becomes free after some seconds: they are waited for.

    `take` is the reason to take the robot from its owner at once, None to wait or be refused. With `is_left_held` a
    normal end of the block leaves the robot held; else it brakes, rests and pauses.

    Raises:
        LeaseError: LEASE_HELD, somebody else owns the robot and lives.
    """
    control = robot.control(on_exit="hold" if is_left_held else "release", take=take)
    while True:
        try:
            control.acquire()
            break
        except LeaseError as error:
            lease = robot.state.lease
            if error.code is not Code.LEASE_HELD or (lease.owned and lease.free_in_ns is None):
                raise
            _wait_until_free(robot, tell)
    with ExitStack() as stack:
        stack.push(control)  # it is entered already
        yield control


def _wait_until_free(robot: Robot, tell: Teller) -> None:
    """Wait until nobody owns the robot, or its owner is back."""
    for state in robot.states(max_rate=LOOK_HZ, timeout=LOOK_S):
        lease = state.lease
        if not lease.owned or lease.free_in_ns is None:
            return
        left = since_text(lease.free_in_ns)
        tell.advance("wait", None, f"{lease.name!r} (pid {lease.pid}) has left; free in {left} (--take REASON: now)")


def lost(robot: Robot, state: RobotState) -> GatewayError:
    """Return the error of a robot that is not ours any more, with the reason where somebody took it; not raised."""
    lease = state.lease
    who = f"{lease.name!r} (pid {lease.pid})" if lease.owned else "nobody"
    for notice in robot.events(timeout=TOLD_S) if lease.owned else ():
        if notice.code == Code.LEASE_CHANGED and notice.facts.get("epoch") == str(lease.epoch):
            return failure(Code.LEASE_LOST, notice.message)
    return failure(Code.LEASE_LOST, f"{who} owns the robot now")


def is_held(robot: Robot) -> bool:
    """Return whether this command leaves arms held, or as far as they can be; False when nobody can tell."""
    with suppress(GatewayError):
        state = robot.state
        return state.state in (*HELD, "STALE") and state.lease.client_id == robot.client_id
    return False


def held_text(robot: Robot, command: str) -> str:
    """Return what becomes of a robot that is left held, and how to go on."""
    info = robot.info
    what = f"the arms are held with their grip for {info.down_after_ns / 1e9:g} s, then the robot pauses"
    if robot.state.state == "STALE":
        what = "the robot is not heard: heard again within 0.8 s arms at rest stay held with their grip, else it pauses"
    return (
        f"{what}\n"
        f"  go on    `ta2 {command}` again: it waits {info.free_after_ns / 1e9:g} s for the lease, or --take REASON\n"
        f"  release  `ta2 enable`, then Ctrl-C; at once: `ta2 estop`"
    )
