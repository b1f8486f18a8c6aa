"""Real-time measures: each is taken or says in one line why not; FIFO goes to every thread or to none."""

from __future__ import annotations

import errno
import json
import os
import resource
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.process import realtime
from gateway.process.realtime import (
    FifoScheduling,
    Linux,
    Measure,
    SleepWatch,
    calm_interpreter,
    lock_memory,
    sharpen_timer,
)

ROOT = Path(__file__).resolve().parents[1]
MS = 1_000_000
S = 1_000_000_000
OTHER = (0, 0)
LOOP = 100
FIFO = realtime.SCHED_FIFO


class Fake:
    """A kernel in memory: threads with policies, and errors where the test wants them."""

    def __init__(self, threads: dict[int, tuple[int, int]] | None = None) -> None:
        self.threads = dict(threads or {LOOP: OTHER, 101: OTHER, 102: OTHER})
        self.denied: dict[int, OSError] = {}
        self.stuck: set[int] = set()
        self.on_list: Callable[[int], None] = lambda listing: None
        self.listings = 0
        self.slack_ns = 50_000
        self.unlimited = True
        self.locked = False
        self.error: OSError | None = None

    def _maybe_fail(self) -> None:
        if self.error is not None:
            raise self.error

    def set_timer_slack(self, slack_ns: int) -> None:
        self._maybe_fail()
        self.slack_ns = slack_ns

    def lift_memory_limit(self) -> bool:
        return self.unlimited

    def lock_memory(self) -> None:
        self._maybe_fail()
        self.locked = True

    def thread_ids(self) -> set[int]:
        self._maybe_fail()
        self.listings += 1
        found = set(self.threads)
        self.on_list(self.listings)
        return found

    def scheduling(self, thread_id: int) -> tuple[int, int]:
        self._alive(thread_id)
        return self.threads[thread_id]

    def schedule(self, thread_id: int, policy: int, priority: int) -> None:
        self._alive(thread_id)
        if thread_id in self.stuck:
            raise PermissionError(errno.EPERM, "Operation not permitted")
        if thread_id in self.denied and policy == FIFO:
            raise self.denied[thread_id]
        self.threads[thread_id] = (policy, priority)

    def _alive(self, thread_id: int) -> None:
        if thread_id not in self.threads:
            raise ProcessLookupError(errno.ESRCH, "No such process")


def _is_one_line(measure: Measure) -> bool:
    return "\n" not in measure.line and measure.line.startswith(f"{measure.name}: ") and len(measure.line) < 200


# ------------------------------------------------------------------------------------------------------ single measures


def test_the_timer_of_the_calling_thread_is_sharpened_to_a_nanosecond() -> None:
    """The default of 50 us is the whole difference to the ideal loop."""
    kernel = Fake()
    measure = sharpen_timer(kernel)
    assert measure.taken
    assert _is_one_line(measure)
    assert kernel.slack_ns == 1


def test_memory_is_locked_where_nothing_limits_it() -> None:
    """And the line says so."""
    kernel = Fake()
    measure = lock_memory(kernel)
    assert measure.taken
    assert _is_one_line(measure)
    assert kernel.locked


def test_memory_is_not_locked_under_a_limit_that_would_starve_the_daemon_later() -> None:
    """A lock that fits today refuses memory to a thread that is born tomorrow."""
    kernel = Fake()
    kernel.unlimited = False
    measure = lock_memory(kernel)
    assert not measure.taken
    assert _is_one_line(measure)
    assert "LimitMEMLOCK" in measure.line
    assert not kernel.locked


@pytest.mark.parametrize("error", [PermissionError(errno.EPERM, "Operation not permitted"), OSError("not available")])
@pytest.mark.parametrize(
    "take", [sharpen_timer, lock_memory, lambda k: FifoScheduling(k, 60, LOOP).apply()], ids=["timer", "memory", "fifo"]
)
def test_what_the_kernel_refuses_is_one_line_and_no_error(take: Callable[[Fake], Measure], error: OSError) -> None:
    """The daemon goes on without it."""
    kernel = Fake()
    kernel.error = error
    measure = take(kernel)
    assert not measure.taken
    assert _is_one_line(measure)
    assert (error.strerror or str(error)) in measure.line
    assert kernel.threads == Fake().threads


# ----------------------------------------------------------------------------------------------------------------- FIFO


def test_every_thread_gets_fifo_the_loop_above_the_others() -> None:
    """40 for the threads of zenoh, 60 for the loop: they run before ordinary programs, and never after the loop."""
    kernel = Fake()
    measure = FifoScheduling(kernel, 60, LOOP).apply()
    assert measure.taken
    assert _is_one_line(measure)
    assert kernel.threads == {LOOP: (FIFO, 60), 101: (FIFO, 40), 102: (FIFO, 40)}


@pytest.mark.parametrize("denied", [LOOP, 101, 102])
def test_when_one_thread_cannot_be_raised_all_are_put_back(denied: int) -> None:
    """FIFO on some threads is worse than on none; what ran under another policy before does so again."""
    before = {LOOP: OTHER, 101: (2, 5), 102: OTHER}
    kernel = Fake(before)
    kernel.denied[denied] = PermissionError(errno.EPERM, "Operation not permitted")
    fifo = FifoScheduling(kernel, 60, LOOP)
    measure = fifo.apply()
    assert not measure.taken
    assert not fifo.active
    assert "CAP_SYS_NICE or LimitRTPRIO=" in measure.line
    assert kernel.threads == before


def test_a_thread_that_ends_meanwhile_is_no_failure() -> None:
    """Threads come and go between the listing and the call."""
    kernel = Fake()
    kernel.on_list = lambda listing: kernel.threads.pop(102, None)
    assert FifoScheduling(kernel, 60, LOOP).apply().taken
    assert kernel.threads == {LOOP: (FIFO, 60), 101: (FIFO, 40)}


def test_a_thread_born_while_the_others_are_raised_is_raised_too() -> None:
    """The list is read again until nobody is new."""
    kernel = Fake()

    def born(listing: int) -> None:
        if listing == 1:
            kernel.threads[103] = OTHER

    kernel.on_list = born
    assert FifoScheduling(kernel, 60, LOOP).apply().taken
    assert kernel.threads[103] == (FIFO, 40)


def test_threads_that_are_born_without_end_do_not_keep_the_daemon_from_starting() -> None:
    """The list is read a few times, not for ever."""
    kernel = Fake()
    kernel.on_list = lambda listing: kernel.threads.update({1000 + listing: OTHER})
    assert FifoScheduling(kernel, 60, LOOP).apply().taken
    assert kernel.listings < 20


def test_another_call_raises_threads_that_were_born_since() -> None:
    """A thread made by the loop inherits 60: it is brought to 40."""
    kernel = Fake()
    fifo = FifoScheduling(kernel, 60, LOOP)
    fifo.apply()
    kernel.threads |= {103: (FIFO, 60), 104: (FIFO, 40), 105: OTHER}
    measure = fifo.apply()
    assert measure.taken
    assert kernel.threads == {LOOP: (FIFO, 60), **dict.fromkeys((101, 102, 103, 104, 105), (FIFO, 40))}


def test_another_call_that_fails_puts_all_back_even_those_that_inherited_fifo() -> None:
    """A thread born under the loop has no policy of its own to go back to: it goes where the loop was."""
    before = {LOOP: OTHER, 101: (2, 5), 102: OTHER}
    kernel = Fake(before)
    fifo = FifoScheduling(kernel, 60, LOOP)
    fifo.apply()
    kernel.threads |= {103: (FIFO, 60), 104: OTHER}
    kernel.denied[104] = PermissionError(errno.EPERM, "Operation not permitted")
    assert not fifo.apply().taken
    assert kernel.threads == {**before, 103: OTHER, 104: OTHER}


def test_undoing_leaves_a_thread_that_may_not_come_down() -> None:
    """The others come down all the same."""
    kernel = Fake()
    fifo = FifoScheduling(kernel, 60, LOOP)
    fifo.apply()
    kernel.stuck = {101}
    fifo.undo()
    assert not fifo.active
    assert kernel.threads == {LOOP: OTHER, 101: (FIFO, 40), 102: OTHER}


def test_undoing_what_was_never_applied_changes_nothing() -> None:
    """No thread has a place to go back to."""
    kernel = Fake({LOOP: OTHER, 101: (2, 5)})
    FifoScheduling(kernel, 60, LOOP).undo()
    assert kernel.threads == {LOOP: OTHER, 101: (2, 5)}


# -------------------------------------------------------------------------------------------------------- sleep of host


class Clocks:
    """Two clocks in the test's hand."""

    def __init__(self) -> None:
        self.monotonic = 5 * S
        self.boot = 900 * S
        self.read_cost_ns = 0

    def pass_ns(self, ns: int, slept_ns: int = 0) -> None:
        self.monotonic += ns
        self.boot += ns + slept_ns

    def monotonic_ns(self) -> int:
        self.pass_ns(self.read_cost_ns)
        return self.monotonic

    def watch(self) -> SleepWatch:
        return SleepWatch(boot_ns=lambda: self.boot, monotonic_ns=self.monotonic_ns)


@pytest.mark.parametrize(
    ("slept_ns", "seen_ns"),
    [(0, 0), (99 * MS, 0), (100 * MS, 0), (100 * MS + 1, 100 * MS + 1), (3600 * S, 3600 * S), (-1 * S, 0)],
)
def test_a_step_of_more_than_100_ms_between_the_clocks_is_a_sleep(slept_ns: int, seen_ns: int) -> None:
    """CLOCK_BOOTTIME goes on while the host sleeps, CLOCK_MONOTONIC does not; it is told once."""
    clocks = Clocks()
    watch = clocks.watch()
    clocks.pass_ns(10 * MS, slept_ns)
    assert watch.slept_ns() == seen_ns
    clocks.pass_ns(10 * MS)
    assert watch.slept_ns() == 0


@given(st.lists(st.integers(0, 10 * S), max_size=30))
def test_time_that_passes_awake_is_never_a_sleep(steps: list[int]) -> None:
    """However long the process stood still: both clocks went on."""
    clocks = Clocks()
    watch = clocks.watch()
    for step in steps:
        clocks.pass_ns(step)
        assert watch.slept_ns() == 0


def test_a_reading_that_was_interrupted_says_nothing() -> None:
    """A pause between the two clocks looks like a step; it is read again next time, and a real sleep is not lost."""
    clocks = Clocks()
    watch = clocks.watch()
    clocks.read_cost_ns = 200 * MS
    clocks.pass_ns(10 * MS, slept_ns=5 * S)
    assert watch.slept_ns() == 0
    clocks.read_cost_ns = 0
    assert watch.slept_ns() == 5 * S


def test_a_first_reading_that_was_interrupted_is_made_up_for() -> None:
    """The first good one is then the one to compare with."""
    clocks = Clocks()
    clocks.read_cost_ns = 200 * MS
    watch = clocks.watch()
    clocks.read_cost_ns = 0
    assert watch.slept_ns() == 0
    clocks.pass_ns(10 * MS, slept_ns=5 * S)
    assert watch.slept_ns() == 5 * S


def test_a_system_without_a_boot_clock_never_sleeps() -> None:
    """Nothing is told where nothing is known."""
    watch = SleepWatch(boot_ns=None)
    assert watch.slept_ns() == 0


def test_this_host_does_not_sleep_during_the_tests() -> None:
    """With the real clocks: no false alarm."""
    watch = SleepWatch()
    assert [watch.slept_ns() for _ in range(100)] == [0] * 100


def test_a_calm_interpreter_is_released_at_the_end() -> None:
    """What was frozen can be freed again and collection goes on: a process that ends leaves nothing behind."""
    script = (
        "import gc, json\n"
        "from gateway.process.realtime import calm_interpreter, release_interpreter\n"
        "calm_interpreter()\n"
        "calm = [gc.isenabled(), gc.get_freeze_count() > 0]\n"
        "release_interpreter()\n"
        "print(json.dumps([calm, [gc.isenabled(), gc.get_freeze_count()]]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=30)
    assert json.loads(done.stdout) == [[False, True], [True, 0]]


# ------------------------------------------------------------------------------------------------------ the real kernel

REAL = """
import gc, json, os, sys, threading
from gateway.process.realtime import FifoScheduling, Linux, calm_interpreter, lock_memory, sharpen_timer

kernel, done = Linux(), threading.Event()
threading.Thread(target=done.wait).start()
slack = sharpen_timer(kernel)
# A real-time thread has no slack at all: read it before FIFO.
slack_ns = int(open("/proc/self/timerslack_ns").read())
loop = threading.get_native_id()
fifo = FifoScheduling(kernel, 60, loop)
measures = [slack, calm_interpreter(), lock_memory(kernel), fifo.apply()]
threading.Thread(target=done.wait).start()
measures.append(fifo.apply())
threads = {("loop" if t == loop else str(t)): kernel.scheduling(t) for t in kernel.thread_ids()}
locked = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmLck"))
resident = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmRSS"))
fifo.undo()
after = sorted(kernel.scheduling(t) for t in kernel.thread_ids())
done.set()
print(json.dumps({
    "measures": [[m.name, m.taken, m.line] for m in measures], "slack_ns": slack_ns, "threads": threads,
    "after": after, "locked_kib": locked, "resident_kib": resident,
    "gc": [gc.isenabled(), gc.get_freeze_count() > 0], "switch_s": sys.getswitchinterval(),
}))
"""


def test_the_measures_take_effect_or_say_why_not() -> None:
    """On this very host, with whatever it permits: what is said to be taken is seen in /proc, the rest is unchanged."""
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(REAL)], cwd=ROOT, capture_output=True, text=True, timeout=30, check=True
    )
    seen = json.loads(run.stdout)
    taken = {name: was_taken for name, was_taken, _ in seen["measures"]}
    assert list(taken) == ["timer slack", "interpreter", "memory lock", "SCHED_FIFO"]
    assert all("\n" not in line and line.startswith(name) for name, _, line in seen["measures"])
    assert taken["timer slack"]
    assert seen["slack_ns"] == 1
    assert taken["interpreter"]
    assert seen["gc"] == [False, True]
    assert seen["switch_s"] == pytest.approx(0.0005)
    assert (seen["locked_kib"] > 0) == taken["memory lock"]
    assert seen["resident_kib"] < 60_000  # on fault only: the stacks of the threads stay where they are
    loop, others = seen["threads"].pop("loop"), list(seen["threads"].values())
    assert len(others) == 2
    if taken["SCHED_FIFO"]:
        assert (loop, others) == ([FIFO, 60], [[FIFO, 40]] * 2)
    else:
        assert FIFO not in [policy for policy, _ in [loop, *others]]
    assert seen["after"] == [[os.sched_getscheduler(0), 0]] * 3, "what it was before: this process may run on idle time"


def test_calming_the_interpreter_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Collect first, freeze what is left, then switch off: in this order."""
    steps: list[str] = []
    for name in ("collect", "freeze", "disable"):
        monkeypatch.setattr(realtime.gc, name, lambda name=name: steps.append(name))
    monkeypatch.setattr(realtime.sys, "setswitchinterval", lambda s: steps.append(f"{s}"))
    measure = calm_interpreter()
    assert measure.taken
    assert _is_one_line(measure)
    assert steps == ["collect", "freeze", "disable", "0.0005"]


def test_another_system_has_none_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every measure of the kernel says so; nothing else happens."""
    monkeypatch.setattr(realtime.sys, "platform", "darwin")
    kernel = Linux()
    for measure in (sharpen_timer(kernel), lock_memory(kernel), FifoScheduling(kernel, 60, LOOP).apply()):
        assert not measure.taken
        assert _is_one_line(measure)
        assert "not available on darwin" in measure.line


def test_a_c_library_without_the_call_is_one_line() -> None:
    """Other C libraries have other calls."""
    with pytest.raises(OSError, match="has no no_such_call"):
        realtime._call("no_such_call")


def test_a_refused_call_of_the_c_library_gives_the_kernels_reason() -> None:
    """The number of the error becomes its words."""
    with pytest.raises(OSError, match=os.strerror(errno.EINVAL)):
        realtime._call("prctl", -1, 0, 0, 0, 0)


@pytest.mark.parametrize(
    ("soft", "hard", "capability", "uid_map", "lifted", "unlimited"),
    [
        (8, resource.RLIM_INFINITY, False, "0 0 4294967295", True, True),
        (resource.RLIM_INFINITY, resource.RLIM_INFINITY, False, "0 1000 1", False, True),
        (8, 64, True, "0 0 4294967295", True, True),
        (8, 8, True, "0 0 4294967295", False, True),
        (8, 8, True, "0 1000 1", False, False),
        (8, 8, False, "0 0 4294967295", False, False),
    ],
)
def test_locked_memory_has_no_limit_by_rlimit_or_by_a_capability_that_counts(
    soft: int,
    hard: int,
    capability: bool,
    uid_map: str,
    lifted: bool,
    unlimited: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A capability in a user namespace of one's own (a rootless container) does not lift the kernel's limit."""
    raised: list[tuple[int, int]] = []
    status = f"Name:\tta2\nCapEff:\t{(1 << realtime.CAP_IPC_LOCK) if capability else 0:016x}\n"
    texts = {"/proc/self/status": status, "/proc/self/uid_map": uid_map}
    monkeypatch.setattr(realtime.resource, "getrlimit", lambda what: (soft, hard))
    monkeypatch.setattr(realtime.resource, "setrlimit", lambda what, limits: raised.append(limits))
    monkeypatch.setattr(realtime.Path, "read_text", lambda self, **_: texts[str(self)])
    assert Linux().lift_memory_limit() is unlimited
    assert raised == ([(hard, hard)] if lifted else [])


def test_the_threads_of_this_process_are_listed() -> None:
    """`/proc/self/task` has the main thread, whose id is the process's."""
    assert os.getpid() in Linux().thread_ids()
    assert Linux().scheduling(os.getpid())[0] == os.sched_getscheduler(0)


def test_the_boot_clock_is_there_and_ahead() -> None:
    """On Linux it counts from boot, sleep included."""
    assert realtime.BOOT_CLOCK is not None
    assert realtime.BOOT_CLOCK() >= time.monotonic_ns() - MS
