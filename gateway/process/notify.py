"""What a service manager is told: ready, alive, stopping, and a line for people (sd_notify(3)).

Rules it obeys
    * The thread tells whose life it proves. A watchdog that another one feeds is fed while the control loop hangs.
    * Nothing here waits or raises: what is not taken is counted, and what must arrive is sent anew with the next beat.
    * The manager's variables are taken out of the environment: it asks nobody who is started from here.
    * Without a manager there is no notifier.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, MutableMapping

__all__ = ["Notifier", "notifier_of"]

LOOK_NS = 1_000_000_000
"""Without a watchdog the line for people is looked at so often [ns]."""
AGAIN_NS = 20_000_000
"""What was not taken is sent anew after this [ns]."""


class Notifier:
    """Tells the service manager of one process.

    Args:
        address: Path of its socket, or `@name` of an abstract one.
        watchdog_ns: It wants to hear from us this often [ns], and is told twice as often; 0 when it does not ask.

    Attributes:
        undelivered: Datagrams that were not taken.
    """

    def __init__(self, address: str, watchdog_ns: int = 0) -> None:
        self._address = f"\0{address[1:]}" if address.startswith("@") else address
        self._alive = "WATCHDOG=1" if watchdog_ns > 0 else ""
        self._period_ns = watchdog_ns // 2 or LOOK_NS
        self._due_ns = 0
        self._owed = self._status = ""
        self._look: Callable[[], str] = lambda: ""
        self.undelivered = 0
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def ready(self, now_ns: int, status: Callable[[], str]) -> None:
        """Say that the service is there, at this monotonic time [ns]; from now on `status` gives the line for people."""
        self._look = status
        self._tell("READY=1", now_ns)

    def stopping(self, now_ns: int) -> None:
        """Say that the end has begun, at this monotonic time [ns]."""
        self._tell("STOPPING=1", now_ns)

    def _tell(self, word: str, now_ns: int) -> None:
        self._owed, self._due_ns = word, 0
        self.beat(now_ns)

    def beat(self, now_ns: int) -> None:
        """Say that the caller's thread is alive, when that is due; call it in every cycle, with its monotonic time [ns]."""
        if now_ns < self._due_ns:
            return
        line = f"STATUS={' '.join(self._look().split())}"
        words = [word for word in (self._owed, self._alive, line if line != self._status else "") if word]
        self._due_ns = now_ns + self._period_ns
        try:
            if words:
                self._socket.sendto("\n".join(words).encode(), self._address)
            self._owed, self._status = "", line
        except OSError:  # nobody is there, or its queue is full
            self.undelivered += 1
            self._due_ns = now_ns + min(AGAIN_NS, self._period_ns)

    def close(self) -> None:
        """Say nothing more."""
        self._socket.close()


def notifier_of(environ: MutableMapping[str, str], pid: int) -> Notifier | None:
    """Return what tells the manager of this process; None when it has none. Takes its variables out of the environment.

    Args:
        environ: Environment variables of this process.
        pid: Its id: a watchdog may be meant for another one.
    """
    address, interval_us, watched = (
        environ.pop(name, "") for name in ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID")
    )
    if not address.startswith(("/", "@")):  # none, or one that is not for processes of this host
        return None
    is_watched = interval_us.isascii() and interval_us.isdecimal() and watched in ("", str(pid))
    return Notifier(address, int(interval_us) * 1000 if is_watched else 0)
