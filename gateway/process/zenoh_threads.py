"""Which of zenoh's threads do what in a process that must be cheap: called once, before the first session opens.

By default zenoh opens its sockets in one runtime (`app`) and reads them in another (`rx`): for every packet the thread
that waits at the socket wakes another one, which reads it. With `app` handed over to `rx`, whoever waits also reads.
Measured on a process that takes the robot's whole state, 1,420 samples a second: 2.3 to 2.6 % of a core against 3.0 to
3.3 %. The same is true of sockets that clients have opened, which `acc` waits at: 188 wake-ups a second in a daemon whose
client streams targets.

There are six `rx` threads. One that reads from a client that floods goes on for as long as there is something to read; with
two, two of them held the robot's own socket up for 100 ms on two busy cores (2 losses of its state in 15 floods of four
processes; none in 25 with six, at the same cost).

zenoh reads this from the environment when its first runtime starts; what a user set there himself stays.
"""

from __future__ import annotations

import os
from collections.abc import MutableMapping

__all__ = ["VARIABLE", "share_reactor"]

VARIABLE = "ZENOH_RUNTIME"
SHARED = "(rx: (worker_threads: 6), app: (handover: rx), acc: (handover: rx))"


def share_reactor(environ: MutableMapping[str, str] | None = None) -> None:
    """Let the thread that waits at a socket also read it, in every session that this process opens later.

    Args:
        environ: Environment variables; None for this process's own.
    """
    (os.environ if environ is None else environ).setdefault(VARIABLE, SHARED)
