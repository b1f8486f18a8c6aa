"""Figures as people read them: times, rates, joints, names of topics. Pure; nothing is wider than its column."""

from __future__ import annotations

from collections.abc import Sequence

from gateway.api.protocol import FSM_NAMES, ModelView
from gateway.robot.topics import TOPICS

__all__ = ["age_limit_ns", "age_text", "fsm_text", "joints_text", "model_text", "rate_text", "since_text", "topic_text"]

MS = 1_000_000
S = 1_000_000_000

PERIODS = 10
"""A topic that has been silent for so many of its periods is old ..."""
LEAST_NS, MOST_NS = 100 * MS, 3 * S
"""... but not before 100 ms, and in any case after 3 s (validity of the fast states and of `/api/current_mode`)."""


def age_text(age_ns: int | None) -> str:
    """Return an age or a gap in at most seven characters, `-` when there is none."""
    if age_ns is None:
        return "-"
    if age_ns < 10 * MS:
        return f"{age_ns / MS:.1f} ms"
    if age_ns < S:
        return f"{age_ns / MS:.0f} ms"
    return since_text(age_ns)


def since_text(duration_ns: int) -> str:
    """Return a duration of seconds to days in at most seven characters."""
    seconds = max(0, duration_ns) / S
    if seconds < 99.95:
        return f"{seconds:.1f} s"
    if seconds < 100 * 60:
        return f"{seconds / 60:.0f} min"
    if seconds < 100 * 3600:
        return f"{seconds / 3600:.0f} h"
    return f"{seconds / 86400:.0f} d"


def rate_text(rate_hz: float) -> str:
    """Return a rate in at most five characters, `-` for none."""
    if rate_hz <= 0.0:
        return "-"
    return f"{rate_hz:.1f}" if rate_hz < 100.0 else f"{rate_hz:.0f}"


def joints_text(q_rad: Sequence[float]) -> str:
    """Return joint values with three decimals, in columns."""
    return " ".join(f"{q:+.3f}" for q in q_rad)


def model_text(model: ModelView) -> str:
    """Return how far the body model is from an arm, what matters most first."""
    if model.position_m is None or model.angle_rad is None:
        return f"model {model.state}"
    figures = f"{1e3 * model.position_m:.1f} mm {1e3 * model.angle_rad:.1f} mrad"
    return f"model {figures}" if model.state == "agrees" else f"model {model.state.upper()} {figures}"


def topic_text(topic: str) -> str:
    """Return a topic's name without what all of its kind have in common."""
    return topic.removeprefix("/api/").removeprefix("/")


def age_limit_ns(topic: str) -> int:
    """Return the age beyond which a state topic is old [ns]; for one that we do not know, the longest."""
    known = TOPICS.get(topic)
    return MOST_NS if known is None else round(min(max(PERIODS * S / known.rate_hz, LEAST_NS), MOST_NS))


def fsm_text(fsm: int | None) -> str:
    """Return the robot's FSM state (manual §4.11.1) by name and number."""
    return "unknown" if fsm is None else f"{FSM_NAMES.get(fsm, '?')} ({fsm})"
