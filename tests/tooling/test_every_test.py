"""Rules of `every_test.py`: what runs with which interpreter, what a failure does, and the sum."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.tooling.every_test import ROOT, Plan, Run, Runner, closing_line, plan

TESTS = """
import pathlib
import pytest
tried = pathlib.Path(__file__).with_name("tried")
def test_that_fails_in_some_tries(tmp_path):
    tried.write_text((tried.read_text() if tried.exists() else "") + "x")
    (tmp_path / "daemon.log").write_text("the first" + " line" + "." * 5000 + "the last" + " words")
    assert len(tried.read_text()) not in {bad}
def test_another():
    pass
"""


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """A run of the tests of a folder, with pytest alone: its plugins take longer to be there than these tests."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    return Run(
        name="3.11-alone", python=sys.executable, arguments=("--rootdir", str(tmp_path), str(tmp_path / "test_it.py"))
    )


def ran(folder: Path, profile: str = "dev") -> subprocess.CompletedProcess[str]:
    """Run the tests of a folder, as they are run by hand."""
    words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(folder), str(folder)]
    environment = {"PYTHONPATH": str(ROOT), "TA2_HYPOTHESIS_PROFILE": profile}
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True, timeout=60, check=False
    )


def judged(tmp_path: Path, plan: Plan) -> tuple[bool, str]:
    """Run a plan; return whether all is well, and the sum."""
    reports = tmp_path / "reports"
    reports.mkdir()
    return Runner(reports).run(plan), closing_line(reports, 61)


@pytest.mark.parametrize(
    ("bad", "tries", "said"),
    [
        (set(), 1, "2 passed"),
        ({1}, 2, "2 passed"),
        ({1, 2}, 3, "2 passed"),
        pytest.param({1, 2, 3}, 3, "1 failed, 1 passed", marks=pytest.mark.thorough),
    ],
    ids=["well", "well by itself", "well the second time", "never well"],
)
@pytest.mark.parametrize("place", ["front", pytest.param("behind", marks=pytest.mark.thorough)])
def test_what_failed_counts_as_it_ends_by_itself(
    tmp_path: Path, run: Run, bad: set[int], tries: int, said: str, place: str
) -> None:
    """In front and behind: it alone is run again, twice at most, and the sum names it."""
    (tmp_path / "test_it.py").write_text(TESTS.replace("{bad}", repr(bad)), encoding="utf-8")
    is_well, told = judged(tmp_path, Plan(**{place: [run]}))
    assert is_well is ("failed" not in said)
    assert len((tmp_path / "tried").read_text()) == tries
    assert re.fullmatch(rf"=+ {said} in 61\.00s \(0:01:01\) =+", told.splitlines()[-1]), told
    assert ("failed at first, passed by itself: 3.11-alone" in told) is (is_well and tries > 1), told


def test_a_run_that_breaks_off_fails_all(tmp_path: Path, run: Run) -> None:
    """It leaves no report, and nothing of it is run again: no test could do better."""
    broken = Run(name="3.11-quick", python=sys.executable, arguments=("--no-such-option",))
    (tmp_path / "test_it.py").write_text(TESTS.replace("{bad}", "set()"), encoding="utf-8")
    is_well, told = judged(tmp_path, Plan(front=[run], behind=[broken]))
    assert not is_well
    assert "1 failed, 2 passed" in told


def test_a_run_without_tests_is_well(tmp_path: Path, run: Run) -> None:
    """Where nothing measures time, or all of it is left out."""
    (tmp_path / "test_it.py").write_text("", encoding="utf-8")
    is_well, told = judged(tmp_path, Plan(front=[run]))
    assert is_well and " 0 passed in " in told


def test_what_runs_behind_ends_with_the_runner(tmp_path: Path, run: Run) -> None:
    """Ctrl-C leaves no tests behind that go on."""
    (tmp_path / "test_it.py").write_text(
        "import pathlib, time\ndef test_it():\n    pathlib.Path(__file__).with_name('begun').touch()\n    time.sleep(200)\n",
        encoding="utf-8",
    )
    runner = Runner(tmp_path)
    running = threading.Thread(target=runner.run, args=(Plan(behind=[run]),), daemon=True)
    running.start()
    deadline = threading.Event()
    while not (tmp_path / "begun").exists():
        assert running.is_alive()
        deadline.wait(0.02)
    runner.close()
    running.join(20.0)
    assert not running.is_alive()


def test_the_default_interpreter_runs_all_and_the_others_what_can_differ() -> None:
    """Few examples, the heart end to end, and no quick test of rules, geometry or tools."""
    made = plan({"3.11": "a", "3.10": "b", "3.13": "c"}, cores=2, beside=3, is_thorough=True, has_bridge=True)
    assert [run.name for run in made.front] == ["3.11-e2e", "3.11-alone", "3.10-e2e", "3.13-e2e"]
    assert [run.name for run in made.behind] == ["3.11-quick", "3.10-quick", "3.13-quick"]
    assert [run.python for run in made.behind] == ["a", "b", "c"]
    assert made.behind[0].arguments == ("-m", "not e2e") and made.front[1].arguments[:2] == ("-m", "alone")
    assert [run.brief for run in made.front] == [False, False, True, True]
    assert made.front[3].arguments[2:] == ("tests/e2e/test_heart.py",)
    assert made.front[0].parallel[:2] == ("-n", "3") and made.behind[0].parallel[:2] == ("-n", "2")
    assert "--ignore=tests/kinematics" in made.behind[1].arguments


def test_what_takes_long_or_needs_a_bridge_is_left_out_by_hand() -> None:
    """The same with one interpreter."""
    made = plan({"3.11": "a"}, cores=8, beside=6, is_thorough=False, has_bridge=False)
    assert [run.name for run in made.front + made.behind] == ["3.11-e2e", "3.11-alone", "3.11-quick"]
    assert made.front[0].arguments[1] == "e2e and not alone and not thorough and not interop"
    assert made.behind[0].arguments[1] == "not e2e and not thorough"


def test_a_failed_end_to_end_test_tells_what_its_processes_wrote(tmp_path: Path) -> None:
    """Why a daemon ended stands in its log alone, and that is gone with the machine."""
    (tmp_path / "conftest.py").write_text("from tests.conftest import pytest_runtest_makereport\n", encoding="utf-8")
    text = TESTS.replace("{bad}", "{1}").replace("def test_that", "@pytest.mark.e2e\ndef test_that")
    (tmp_path / "test_it.py").write_text(text, encoding="utf-8")
    done = ran(tmp_path)
    assert done.returncode == 1
    assert (
        "end of daemon.log" in done.stdout and "the last words" in done.stdout and "the first line" not in done.stdout
    )


def test_where_few_examples_are_tried_the_first_and_the_last_parameters_are(tmp_path: Path) -> None:
    """Other interpreters: what differs between them is not between the sets of parameters of one test."""
    (tmp_path / "conftest.py").write_text(
        "from tests.conftest import pytest_collection_modifyitems\n", encoding="utf-8"
    )
    text = "import pytest\n@pytest.mark.parametrize('n', range(9))\ndef test_it(n):\n    assert n in (0, 8)\n"
    (tmp_path / "test_it.py").write_text(text, encoding="utf-8")
    done = ran(tmp_path, "brief")
    assert done.returncode == 0 and "2 passed, 7 deselected" in done.stdout, done.stdout
