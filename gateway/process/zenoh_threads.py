"""Which of zenoh's threads do what in a process that must be cheap: called once, before the first session opens.

By default zenoh opens its sockets in one runtime (`app`) and reads them in another (`rx`): for every packet the thread
that waits at the socket wakes another one, which reads it. With `app` handed over to `rx`, whoever waits also reads.
Measured on a process that takes the robot's whole state, 1,420 samples a second: 2.3 to 2.6 % of a core against 3.0 to
3.3 %.

Sockets that clients open keep a runtime of their own, `acc`: zenoh closes them in it, and where that was `rx` too, peers
that did nothing but connect had each of its threads hand its work to another one, tens of times a second, and the robot's
own socket was not read for 100 ms (6 losses of its state in 34 floods of four such processes, at a quarter of the usual
speed; none in 34 with `acc` apart and behind `rx`, see `api/flood_watch.py`; at the same cost).

There are six `rx` threads. One that reads from a client that floods goes on for as long as there is something to read; with
two, two of them held the robot's own socket up for 100 ms on two busy cores (2 losses of its state in 15 floods of four
processes; none in 25 with six, at the same cost).

zenoh reads this from the environment when its first runtime starts; what a user set there himself stays.
"""

from __future__ import annotations

import os

__all__ = ["VARIABLE", "share_reactor"]

VARIABLE = "ZENOH_RUNTIME"
SHARED = "(rx: (worker_threads: 6), app: (handover: rx), acc: (worker_threads: 4))"


def share_reactor() -> None:
    """Let the thread that waits at a socket also read it, in every session that this process opens later."""
    os.environ.setdefault(VARIABLE, SHARED)
