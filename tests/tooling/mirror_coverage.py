"""Coverage by mirror: each module of `core` and `cdr_types` reaches 100 % branch coverage from its own test file alone.

That one rule keeps modules separable: what cannot be reached from beside it does not belong in it. Each test file runs
in a process of its own with few, fixed hypothesis examples, so that no luck and no neighbour helps; it is forked from one
that has loaded what others have written, and nothing of ours. Exclusions (type checking, `assert_never`, bodies of
protocols) stand in `pyproject.toml`.

    python -m tests.tooling.mirror_coverage [PATH ...]     only the modules whose path contains one of these
"""

from __future__ import annotations

import ast
import json
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import coverage
import coverage.exceptions
import pytest

__all__ = ["Mirror", "Result", "measure", "mirrors"]

ROOT = Path(__file__).resolve().parents[2]
SOURCES = (("gateway/core", "tests/core"), ("cdr_types", "tests/cdr_types"))
JOBS = 2
TIMEOUT_S = 300

LOADED = multiprocessing.get_context("forkserver")
LOADED.set_forkserver_preload(
    ["hypothesis", "msgspec", "numpy", "pytest", "ruckig", "schemathesis.pytest.plugin", "zenoh"]
)
"""Forks processes that have these packages."""


@dataclass(frozen=True)
class Mirror:
    """A module and the test file that must cover it alone; paths are relative to the checkout."""

    module: Path
    test: Path


@dataclass(frozen=True)
class Result:
    """What one test file covers of its module.

    Attributes:
        mirror: The pair.
        missing: Lines and branches not reached, as text; empty when all were.
        trouble: Why nothing could be measured; empty when it could.
    """

    mirror: Mirror
    missing: str = ""
    trouble: str = ""

    @property
    def is_complete(self) -> bool:
        """Whether every line and branch was reached."""
        return not self.missing and not self.trouble


def mirrors(root: Path = ROOT) -> Iterator[Mirror]:
    """Pair every module with its test file.

    The file of `core/streams/arm.py` is `tests/core/streams/test_arm.py` or, for a package whose parts are small and
    alike, the package's own, as `tests/cdr_types/test_messages.py` is; the nearer one wins. An `__init__.py` that only
    re-exports needs none.
    """
    for source, tests in SOURCES:
        for path in sorted((root / source).rglob("*.py")):
            inside = path.relative_to(root / source)
            if path.name == "__init__.py":
                if _only_exports(path):
                    continue
                inside = inside.parent
            packages = [folder for folder in inside.parents if folder.name]
            names = [(part.parent, part.stem or Path(source).name) for part in (inside, *packages)]
            candidates = [root / tests / folder / f"test_{name}.py" for folder, name in names]
            test = next((candidate for candidate in candidates if candidate.exists()), candidates[0])
            yield Mirror(module=path.relative_to(root), test=test.relative_to(root))


def _only_exports(path: Path) -> bool:
    """Whether a module holds nothing but a docstring, imports and plain names."""
    plain = (ast.Import, ast.ImportFrom, ast.Assign, ast.Expr)
    return all(isinstance(node, plain) for node in ast.parse(path.read_text(encoding="utf-8")).body)


def measure(mirror: Mirror, root: Path = ROOT) -> Result:
    """Run one test file under coverage and say what of its module it leaves out."""
    if not (root / mirror.test).exists():
        return Result(mirror=mirror, trouble=f"there is no {mirror.test}")
    with tempfile.TemporaryDirectory() as folder:
        data_file, said = Path(folder) / "coverage", Path(folder) / "said"
        said.touch()  # it may end before it says anything
        run = LOADED.Process(target=_run, args=(mirror, root, data_file, said))
        run.start()
        run.join(TIMEOUT_S)
        run.kill()
        run.join()
        if run.exitcode != 0:
            return Result(mirror=mirror, trouble=f"{mirror.test} fails:\n{said.read_text(encoding='utf-8')[-4000:]}")
        return Result(mirror=mirror, missing=_missing(data_file, root, mirror.module))


def _run(mirror: Mirror, root: Path, data_file: Path, said: Path) -> None:
    """Run a test file under coverage, in a process of its own that ends with pytest's status."""
    with said.open("w", encoding="utf-8") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    os.environ["TA2_HYPOTHESIS_PROFILE"] = "mirror"
    os.chdir(root)
    sys.path.insert(0, str(root))
    name = ".".join(mirror.module.with_suffix("").parts).removesuffix(".__init__")
    seen = coverage.Coverage(data_file=str(data_file), branch=True, source=[name])
    options = ["--quiet", "--no-header", "-p", "no:cacheprovider", "-m", "not e2e and not slow"]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # of what was loaded before: no test is among it
    seen.start()
    status = pytest.main([*options, str(mirror.test)])
    seen.stop()
    seen.save()
    sys.exit(status)


def _missing(data_file: Path, root: Path, module: Path) -> str:
    """Return which lines and branches of a module the recorded run left out, or an empty string."""
    recorded = coverage.Coverage(data_file=str(data_file), config_file=str(root / "pyproject.toml"))
    recorded.load()
    report = data_file.with_suffix(".json")
    try:
        recorded.json_report(morfs=[str(root / module)], outfile=str(report))
    except coverage.exceptions.NoDataError:
        return "anything: it never imports the module"
    (found,) = json.loads(report.read_text(encoding="utf-8"))["files"].values()
    lines = [f"line {line}" for line in found["missing_lines"]]
    # A branch that starts in a line that was not reached says nothing new; a negative end is the way out.
    reached = [(start, end) for start, end in found["missing_branches"] if start not in found["missing_lines"]]
    branches = [f"branch {start} -> {'exit' if end < 0 else end}" for start, end in reached]
    return ", ".join(lines + branches)


def main(only: list[str]) -> int:
    """Measure all pairs, print those that fall short, return the exit status."""
    chosen = [m for m in mirrors() if not only or any(part in m.module.as_posix() for part in only)]
    with ThreadPoolExecutor(max_workers=JOBS) as pool:
        results = list(pool.map(measure, chosen))
    short = [result for result in results if not result.is_complete]
    for result in short:
        reason = result.trouble or f"{result.mirror.test} does not reach {result.missing}"
        print(f"{result.mirror.module}: {reason}")
    print(f"coverage by mirror: {len(results) - len(short)} of {len(results)} modules at 100 % of lines and branches")
    return 1 if short or not results else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
