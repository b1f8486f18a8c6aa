"""The guard's look at the daemon's API: what counts as an answer, and which missing ones count."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from gateway.api.stop_lane import StopLane
from gateway.core.messages.held import Held
from gateway.guard import api_watch
from gateway.guard.api_watch import SILENT_MISSES, ApiWatch
from tests.api.daemon import Daemon, eventually


def ticking(beat: str = "silent") -> Held:
    """What a daemon shows that ticks all the time."""
    return Held(at_ns=time.monotonic_ns(), state="ACTIVE", beat=beat)


@pytest.fixture(autouse=True)
def in_haste(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of the usual times: a test has no second for each question."""
    monkeypatch.setattr(api_watch, "PERIOD_S", 0.1)
    monkeypatch.setattr(api_watch, "PATIENCE_S", 0.1)


@pytest.fixture
def watch(tmp_path: Path) -> Iterator[ApiWatch]:
    """A watch over the daemon of this test, which ticks."""
    made = ApiWatch(tmp_path / "gw.sock", ticking)
    made.start()
    yield made
    made.close()


def test_a_daemon_that_answers_is_well_and_one_whose_lane_hangs_is_not(
    watch: ApiWatch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing counts before the first answer; then each question without one does, until there is one again."""
    with Daemon(tmp_path):
        eventually(lambda: watch._was_open, 20.0)
        go_on = threading.Event()
        deliver = StopLane.deliver

        def hang(lane: StopLane, timeout_s: float) -> bool:
            go_on.wait()
            return deliver(lane, timeout_s)

        monkeypatch.setattr(StopLane, "deliver", hang)
        eventually(lambda: watch.misses >= SILENT_MISSES, 30.0)
        go_on.set()
        eventually(lambda: watch.misses == 0, 20.0)


def test_a_daemon_that_has_not_opened_its_socket_yet_misses_nothing(
    watch: ApiWatch, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The guard is started first."""
    asked: list[bool] = []
    ask = watch._ask

    def noted() -> bool:
        asked.append(ask())
        return asked[-1]

    monkeypatch.setattr(watch, "_ask", noted)
    eventually(lambda: len(asked) > SILENT_MISSES, 20.0)
    assert not any(asked) and watch.misses == 0


@pytest.mark.parametrize("why", ["it does not tick", "we are late"])
def test_what_the_host_explains_counts_anew(tmp_path: Path, why: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A daemon that does not tick is judged by its ticks; a host that holds up this thread holds up the daemon, too."""
    watch = ApiWatch(tmp_path / "gw.sock", ticking if why == "we are late" else lambda: None)
    watch._was_open, watch.misses = True, 4
    asked: list[int] = []

    def ask() -> bool:
        asked.append(watch.misses)
        if why == "we are late":
            time.sleep(0.1 + api_watch.LATE_NS / 1e9 + 0.05)
        return False

    monkeypatch.setattr(watch, "_ask", ask)
    watch.start()
    eventually(lambda: len(asked) > 2, 20.0)
    watch.close()
    assert asked[:3] == [4, 0, 0]


def test_a_daemon_that_refuses_at_once_is_asked_no_more_often(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A socket that nobody listens at any more."""
    watch = ApiWatch(tmp_path / "gw.sock", ticking)
    watch._was_open = True
    begun: list[float] = []
    monkeypatch.setattr(watch, "_ask", lambda: begun.append(time.monotonic()) or False)
    watch.start()
    eventually(lambda: watch.misses >= 3, 20.0)
    watch.close()
    assert all(b - a >= 0.09 for a, b in pairwise(begun))


def test_a_daemon_that_commands_has_been_asked_to_so_its_api_was_open(tmp_path: Path) -> None:
    """Though it never answered this guard, which may be its second."""
    watch = ApiWatch(tmp_path / "gw.sock", lambda: ticking("one"))
    watch.start()
    eventually(lambda: watch.misses >= SILENT_MISSES, 20.0)
    watch.close()


def test_after_its_end_a_missing_answer_counts_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The guard has ended the daemon meanwhile: that it did not answer is no news."""
    watch = ApiWatch(tmp_path / "gw.sock", ticking)
    watch._was_open = True

    def ask() -> bool:
        watch.close()
        return False

    monkeypatch.setattr(watch, "_ask", ask)
    watch._watch()
    assert watch.misses == 0
