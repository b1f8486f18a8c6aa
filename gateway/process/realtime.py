"""Real-time measures of the daemon: each is taken, or says in one line why it was not.

Rules it obeys
    * Nothing here fails: a measure that is not permitted or not available is a `Measure` with `taken` False, and the
      daemon goes on without it. The caller logs the line.
    * SCHED_FIFO goes to every thread of the process or to none. On the Python thread alone it is worse than nothing:
      zenoh's sending thread starves behind it, and setpoints are dropped (measured: 14 of 549).
    * Memory is locked on fault only (`MCL_ONFAULT`). Without it every thread stack becomes resident (31 -> 130 MB and
      more) and the first ticks stall for 160-208 ms. A finite limit of locked memory would refuse memory to the running
      daemon later on, so memory is locked only where there is no limit.
    * Order: import everything, open sessions, then `calm_interpreter`, `lock_memory`, `FifoScheduling.apply`, and only
      then arm the robot. `sharpen_timer` is for the loop thread, which calls it itself.

Figures are from the project's real-time measurements: timer slack 1 ns brings the loop's median lateness from 74 to
26 us; a full garbage collection of 200k objects cost 35 ms. It does not know the loop, the link or any setting.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

from msgspec import Struct

__all__ = [
    "FifoScheduling",
    "Linux",
    "Measure",
    "SleepWatch",
    "calm_interpreter",
    "has_capability",
    "lock_memory",
    "release_interpreter",
    "require_linux",
    "sharpen_timer",
]

MS = 1_000_000

PR_SET_TIMERSLACK = 29
TIMER_SLACK_NS = 1
SWITCH_INTERVAL_S = 0.0005
"""Longest wait for the interpreter lock behind another Python thread: 5 ms by default, 0.5 ms costs nothing."""
MCL_CURRENT_FUTURE_ONFAULT = 1 | 2 | 4
SCHED_FIFO = 1
"""`os.SCHED_FIFO`, which exists on Linux only."""
CAP_IPC_LOCK, CAP_SYS_NICE = 14, 23
"""Bits of the capabilities that lift the limits of locked memory, and of real-time priority (capabilities(7))."""
BELOW_LOOP = 20
"""All other threads get the loop's priority less this: zenoh sends and receives above ordinary programs."""
LISTINGS = 8
"""How often threads are listed again because new ones were born meanwhile."""


class Measure(Struct, frozen=True, kw_only=True):
    """What became of one measure.

    Attributes:
        name: Which one.
        taken: Whether it is in effect.
        line: One line for the log: what it is, or why not and what would permit it.
    """

    name: str
    taken: bool
    line: str


def has_capability(number: int) -> bool:
    """Return whether this process has it where it lifts a limit: in the first user namespace, not in a rootless container."""
    status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    held = next((int(line.split()[1], 16) for line in status.splitlines() if line.startswith("CapEff:")), 0)
    whole = Path("/proc/self/uid_map").read_text(encoding="ascii").split() == ["0", "0", "4294967295"]
    return whole and bool(held >> number & 1)


class Linux:
    """The running Linux kernel; on any other system every call raises `OSError`."""

    def set_timer_slack(self, slack_ns: int) -> None:
        """Set the calling thread's timer slack [ns]."""
        unused = ctypes.c_ulong(0)
        _call("prctl", PR_SET_TIMERSLACK, ctypes.c_ulong(slack_ns), unused, unused, unused)

    def lift_memory_limit(self) -> bool:
        """Raise the limit of locked memory as far as allowed; return whether none is left."""
        require_linux()
        soft, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
        if soft != hard:
            resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard, hard))
        if hard == resource.RLIM_INFINITY:
            return True
        return has_capability(CAP_IPC_LOCK)

    def lock_memory(self) -> None:
        """Lock present and future pages as they are touched."""
        _call("mlockall", MCL_CURRENT_FUTURE_ONFAULT)

    def thread_ids(self) -> set[int]:
        """Return every thread of this process."""
        require_linux()
        return {int(name) for name in os.listdir("/proc/self/task")}

    def scheduling(self, thread_id: int) -> tuple[int, int]:
        """Return policy and priority of a thread."""
        return os.sched_getscheduler(thread_id), os.sched_getparam(thread_id).sched_priority

    def schedule(self, thread_id: int, policy: int, priority: int) -> None:
        """Set policy and priority of a thread."""
        os.sched_setscheduler(thread_id, policy, os.sched_param(priority))


def require_linux() -> None:
    """Raise `OSError` on every other system."""
    if sys.platform != "linux":
        raise OSError(f"not available on {sys.platform}")


def _call(name: str, *arguments: object) -> None:
    """Call a function of the C library that returns 0 when all is well.

    Raises:
        OSError: With the number that the kernel gave, or because there is no such call here.
    """
    require_linux()
    function = getattr(ctypes.CDLL(None, use_errno=True), name, None)
    if function is None:
        raise OSError(f"this C library has no {name}")
    if function(*arguments) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def sharpen_timer(kernel: Linux) -> Measure:
    """Let the calling thread's sleeps end within 1 ns of their deadline instead of 50 us; needs no privilege."""
    name = "timer slack"
    try:
        kernel.set_timer_slack(TIMER_SLACK_NS)
    except OSError as error:
        return _not_taken(name, error, "sleeps end up to 50 us late")
    return Measure(name=name, taken=True, line=f"timer slack: {TIMER_SLACK_NS} ns on the loop thread")


def calm_interpreter() -> Measure:
    """Stop garbage collection after a last one, and let threads hand the interpreter over sooner.

    What exists now is never searched again, and what is made from now on is freed by reference counts alone: the daemon
    makes no cycles in its loop. May be called again while the robot is not armed, to collect what there is after all.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    line = f"interpreter: garbage collection off, {gc.get_freeze_count()} objects frozen, switch interval 0.5 ms"
    return Measure(name="interpreter", taken=True, line=line)


def release_interpreter() -> None:
    """Undo `calm_interpreter` when the loop has ended: what was frozen can be freed before the process ends."""
    gc.unfreeze()
    gc.enable()


def lock_memory(kernel: Linux) -> Measure:
    """Keep what was touched from being swapped out."""
    name = "memory lock"
    try:
        if not kernel.lift_memory_limit():
            remedy = "CAP_IPC_LOCK or LimitMEMLOCK=infinity permits it"
            raise PermissionError(f"locked memory is limited: {remedy}")
        kernel.lock_memory()
    except OSError as error:
        return _not_taken(name, error, "pages may be swapped out")
    return Measure(name=name, taken=True, line="memory lock: pages stay once they were touched")


class FifoScheduling:
    """SCHED_FIFO on every thread of the process, or on none.

    Threads born later inherit from the thread that made them; another `apply` brings them to their place. So do processes:
    start those that must not run in real time before `apply`.

    Args:
        kernel: The operating system.
        priority: Of the loop thread; all others get 20 less.
        loop_thread_id: Kernel's id of the loop thread (`threading.get_native_id()` there).
    """

    def __init__(self, kernel: Linux, priority: int, loop_thread_id: int) -> None:
        self._kernel = kernel
        self._priority = priority
        self._loop_thread_id = loop_thread_id
        self._before: dict[int, tuple[int, int]] = {}
        self._origin: tuple[int, int] | None = None
        self.active = False
        """Whether the threads are under SCHED_FIFO now."""

    def apply(self) -> Measure:
        """Raise every thread; when one cannot be raised, put all back."""
        try:
            raised = self._raise_all()
        except OSError as error:
            self.undo()
            remedy = (
                "CAP_SYS_NICE or LimitRTPRIO= permits it" if isinstance(error, PermissionError) else "none was raised"
            )
            return _not_taken("SCHED_FIFO", error, f"ticks come later under load ({remedy})")
        self.active = True
        line = f"SCHED_FIFO: loop {self._priority}, {raised - 1} other threads {self._priority - BELOW_LOOP}"
        return Measure(name="SCHED_FIFO", taken=True, line=line)

    def undo(self) -> None:
        """Put every thread back where it was; one born meanwhile goes where the loop thread was."""
        self.active = False
        with contextlib.suppress(OSError):  # no list, nothing to put back
            for thread_id in self._kernel.thread_ids():
                before = self._before.get(thread_id, self._origin)
                if before is not None:
                    with contextlib.suppress(OSError):  # it ended meanwhile, or was up before and may not move
                        self._kernel.schedule(thread_id, *before)
        self._before.clear()
        self._origin = None

    def _raise_all(self) -> int:
        """Raise all threads, listing them until no new one appears; return how many there are."""
        seen: set[int] = set()
        for _ in range(LISTINGS):
            born = self._kernel.thread_ids() - seen
            if not born:
                break
            for thread_id in born:
                self._remember(thread_id)
            for thread_id in born:
                self._raise(thread_id)
            # From here on a new thread has inherited our priority: where it was before says nothing.
            self._origin = self._before.get(self._loop_thread_id)
            seen |= born
        return len(seen)

    def _remember(self, thread_id: int) -> None:
        if thread_id not in self._before:
            with contextlib.suppress(ProcessLookupError):  # it ended between the listing and now
                self._before[thread_id] = self._origin or self._kernel.scheduling(thread_id)

    def _raise(self, thread_id: int) -> None:
        priority = self._priority if thread_id == self._loop_thread_id else self._priority - BELOW_LOOP
        with contextlib.suppress(ProcessLookupError):  # as above
            self._kernel.schedule(thread_id, SCHED_FIFO, priority)


def _not_taken(name: str, error: OSError, consequence: str) -> Measure:
    reason = error.strerror or str(error)
    return Measure(name=name, taken=False, line=f"{name}: not taken ({reason}); {consequence}")


def _boot_ns() -> int:
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


BOOT_CLOCK: Callable[[], int] | None = _boot_ns if hasattr(time, "CLOCK_BOOTTIME") else None
"""The clock that counts sleep, where there is one (Linux)."""


class SleepWatch:
    """Tells when this host slept: CLOCK_BOOTTIME goes on then, CLOCK_MONOTONIC does not.

    Args:
        step_ns: A step larger than this between two looks is a sleep [ns].
        boot_ns: Clock that counts sleep [ns]; None for a system that has none, which then never sleeps.
        monotonic_ns: Clock that does not [ns].
    """

    def __init__(
        self,
        step_ns: int = 100 * MS,
        boot_ns: Callable[[], int] | None = BOOT_CLOCK,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._step_ns = step_ns
        self._boot_ns = boot_ns
        self._monotonic_ns = monotonic_ns
        self._offset_ns = self._offset()

    def slept_ns(self) -> int:
        """Return how long the host slept since the last look [ns]; 0 when it did not."""
        offset = self._offset()
        if offset is None:
            return 0
        before, self._offset_ns = self._offset_ns, offset
        if before is None or offset - before <= self._step_ns:
            return 0
        return offset - before

    def _offset(self) -> int | None:
        """Return boot time minus monotonic time; None when the reading was interrupted, so that it says nothing."""
        if self._boot_ns is None:
            return None
        early = self._monotonic_ns()
        boot = self._boot_ns()
        late = self._monotonic_ns()
        if late - early > self._step_ns // 2:
            return None
        return boot - (early + late) // 2
