"""Reaching a simulation that is only just starting: for programs that run beside it."""

from __future__ import annotations

import time
from collections.abc import Callable

from gateway.sim.remote import SimControl, SimUnreachable

__all__ = ["reached"]


def reached(endpoint: str, is_over: Callable[[], bool], patience_s: float = 20.0) -> SimControl:
    """Return a control channel that has answered.

    Raises:
        SimUnreachable: None answered in time, or it is over.
    """
    end_s = time.monotonic() + patience_s
    while True:
        try:
            control = SimControl(endpoint)
        except SimUnreachable:
            if is_over() or time.monotonic() > end_s:
                raise
            time.sleep(0.05)
            continue
        try:
            control.ask("ping")
        except SimUnreachable:
            control.close()
            if is_over() or time.monotonic() > end_s:
                raise
        else:
            return control
