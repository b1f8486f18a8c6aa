"""Colours and marks, one meaning each: green goes, yellow waits, red is wrong. Shared by all views of the terminal."""

from __future__ import annotations

from gateway.api import protocol

__all__ = ["MODEL_STYLES", "NOTICE_STYLES", "STEP_MARKS", "STEP_STYLES", "state_style"]

STEP_STYLES = {"error": "bold red", "warning": "yellow", "info": "cyan"}
STEP_MARKS = {"error": "!!", "warning": " !", "info": " ·"}
NOTICE_STYLES = {"error": "bold red", "warning": "yellow", "info": ""}
MODEL_STYLES = {"agrees": "dim", "unknown": "yellow", "differs": "red"}
"""Verdicts on the body model, the worst last."""

STATES = {
    "ACTIVE": "bold green",
    "ENABLING": "bold yellow",
    "HOLDING": "bold yellow",
    "STOPPING": "bold yellow",
    "PAUSED": "bold yellow",
    "STALE": "bold red",
    "OFFLINE": "bold red",
}


def state_style(view: protocol.Snapshot) -> str:
    """Return the colour of what is shown as the state."""
    return "bold red" if view.latches else STATES.get(view.shown, "bold cyan")
