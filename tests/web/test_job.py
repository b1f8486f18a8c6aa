"""A command that looks: in a process of its own, one at a time, and never for longer than it may."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from pathlib import Path

import pytest

from gateway.web import job
from gateway.web.job import Job, JobSeen

DEADLINE_S = 40.0


def python(text: str) -> Job:
    """Return a job that runs this."""
    return Job(sys.executable, "-c", text)


async def ended(job: Job) -> JobSeen:
    """Begin it and wait for its end."""
    job.begin()
    assert job.seen.is_running
    deadline = time.monotonic() + DEADLINE_S
    while job.seen.is_running:
        assert time.monotonic() < deadline, "it runs without end"
        await asyncio.sleep(0.01)
    return job.seen


@pytest.mark.parametrize(
    ("text", "report", "error"),
    [
        ('print(\'{"ok": false, "rows": []}\'); raise SystemExit(1)', {"ok": False, "rows": []}, ""),
        ('print(\'{"error": {"message": "nobody there", "hint": "ta2 run"}}\')', None, "nobody there -> ta2 run"),
        ("print('no JSON')", None, "nothing that can be read"),
        ("print('[1]')", None, "nothing that can be read"),
        ("raise SystemExit(2)", None, "nothing that can be read"),
    ],
)
def test_what_it_says_is_the_report_whatever_its_status(text: str, report, error: str) -> None:
    """A check that fails is a report; what is none is told with its reason."""
    seen = asyncio.run(ended(python(text)))
    assert seen.report == report and error in seen.error and bool(seen.error) == (report is None)


def test_a_program_that_is_not_there_is_told() -> None:
    """And can be asked for again."""
    assert "nothing that can be read" in asyncio.run(ended(Job("/nowhere/ta2"))).error


def test_what_takes_too_long_is_killed_and_what_was_seen_before_is_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """A look that hangs (a robot that is half there) must not be the last one."""
    monkeypatch.setattr(job, "MOST_S", 0.2)
    seen = asyncio.run(ended(python("import time; time.sleep(1000)")))
    assert seen.report is None and "was killed" in seen.error


def test_one_runs_at_a_time_and_the_end_of_the_page_is_its_end(tmp_path: Path) -> None:
    """However often it is asked for; nothing is left behind by a server that ends."""
    noted = tmp_path / "pids"
    text = f"import os, time; open({str(noted)!r}, 'a').write(f'{{os.getpid()}}\\n'); time.sleep(1000)"

    async def story() -> list[int]:
        one = python(text)
        for _ in range(3):
            one.begin()
        deadline = time.monotonic() + DEADLINE_S
        while not (noted.exists() and noted.read_text().endswith("\n")):
            assert time.monotonic() < deadline, "it never began"
            await asyncio.sleep(0.01)
        assert one.seen.is_running
        await one.end()
        return [int(line) for line in noted.read_text().split()]

    (pid,) = asyncio.run(story())
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
