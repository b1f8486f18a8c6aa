"""How a robot and its state show themselves: one line in a terminal, a small table in a notebook.

Rules
    * Showing never waits, never asks and never raises: a cell that ends with `robot` must work without a robot.
    * Whatever came from others (names, messages) is escaped.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from gateway.errors import GatewayError

if TYPE_CHECKING:
    from gateway.client.connection.session import Session, Sighting
    from gateway.client.state.health import Health
    from gateway.client.state.reading import RobotState

__all__ = ["health_table", "robot_table", "state_line", "state_table", "vector"]


def vector(values: Sequence[float], digits: int = 3) -> str:
    """Return numbers as people read them: `[0.100, -1.300]`."""
    return f"[{', '.join(f'{value:.{digits}f}' for value in values)}]"


def state_line(state: RobotState) -> str:
    """Return a state in one line."""
    lease = state.lease
    owner = f"owned by {lease.name!r}" if lease.owned else "unowned"
    link = "fresh" if state.link.fresh else ("stale" if state.link.up else "down")
    return f"<state {state.seq}: {state.shown}, FSM {state.fsm_name}, link {link}, {owner}, {state.age:.3f} s old>"


def state_table(state: RobotState) -> str:
    """Return a state as HTML: what the gateway is doing, then a row per arm."""
    return _table(_of_state(state))


def robot_table(session: Session, state_of: Callable[[Sighting, int], RobotState]) -> str:
    """Return who is connected to what, and the newest state, read by `state_of`, as HTML."""
    rows = [("client", session.name), ("gateway", session.transport.address)]
    try:
        session.require_daemon()
        sighting = session.sighting()
    except GatewayError as error:
        return _table([*rows, ("state", str(error))])
    if sighting is None:
        return _table([*rows, ("state", "not seen yet")])
    return _table([*rows, *_of_state(state_of(sighting, session.transport.now_ns()))])


def health_table(health: Health) -> str:
    """Return a health as HTML: what is well, what is not, and the ages of what the robot sends."""
    rows = [
        ("health", "ok" if health.ok else "not ok"),
        ("state", health.state),
        ("FSM", health.fsm),
        ("link", f"up, {_seconds(health.link_age)} old" if health.link_up else "down"),
        ("latches", ", ".join(health.latches) or "none"),
        ("owner", health.lease_holder or "nobody"),
    ]
    rows += [(name, f"{_seconds(age)} old, {health.rates.get(name, 0.0):.0f} Hz") for name, age in health.ages.items()]
    return _table(rows)


def _of_state(state: RobotState) -> Iterable[tuple[str, str]]:
    lease = state.lease
    yield "state", state.shown
    yield "FSM", state.fsm_name
    age_ns = state.link.age_ns
    yield (
        "link",
        f"{'up' if state.link.up else 'down'}, {'never heard' if age_ns is None else f'{age_ns / 1e6:.0f} ms old'}",
    )
    yield "owner", f"{lease.name} (pid {lease.pid}, epoch {lease.epoch})" if lease.owned else "nobody"
    yield from _named("latch", state.latches)
    for arm in (state.left_arm, state.right_arm):
        yield arm.name, repr(arm).strip("<>").partition(": ")[2]
    yield "seen", f"{state.age:.3f} s ago"


def _named(what: str, messages: Mapping[str, str]) -> Iterable[tuple[str, str]]:
    for code, message in messages.items():
        yield f"{what} {code}", message


def _seconds(value: float | None) -> str:
    return "never heard" if value is None else f"{value:.3f} s"


def _table(rows: Iterable[tuple[str, str]]) -> str:
    lines = (f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in rows)
    return f"<table>{''.join(lines)}</table>"
