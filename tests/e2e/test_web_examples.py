"""The programs of docs/how-to/web-api.md do what they say, as they stand there: node's own fetch and WebSocket, and C++17."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.e2e.pages import blocks
from tests.e2e.system import ROOT, System, wait_for
from tests.e2e.test_web import Web

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.thorough,
    pytest.mark.sim_only("the page is a client of the gateway, whatever the robot is"),
]

REQUIRED = os.environ.get("TA2_EXAMPLES") == "required"
NODE = 22
"""The first that has a WebSocket of its own which takes headers."""


def program(language: str) -> str:
    """Return the program of the page in a language."""
    (found,) = [block for block in blocks(ROOT / "docs/how-to/web-api.md") if block.language == language]
    return found.text


def missing(why: str) -> None:
    """Skip, or fail where both are required."""
    (pytest.fail if REQUIRED else pytest.skip)(why)


def node() -> str:
    """Return a node that is new enough: the system's, or the one that Playwright brings along."""
    playwright = importlib.util.find_spec("playwright")
    own = (
        [] if playwright is None or playwright.origin is None else [Path(playwright.origin).parent / "driver" / "node"]
    )
    for path in (shutil.which("node"), *own):
        if path is None or not Path(path).exists():
            continue
        words = [str(path), "-p", "process.versions.node"]
        said = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False).stdout
        if said.partition(".")[0].isdigit() and int(said.partition(".")[0]) >= NODE:
            return str(path)
    missing(f"no node {NODE} or newer here (pip install playwright has one)")
    return ""


def run(words: list[str], folder: Path, **variables: str) -> str:
    """Return what a program prints; it must end well."""
    environ = {**os.environ, **variables}
    done = subprocess.run(words, cwd=folder, env=environ, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_programs_in_javascript_and_in_c_plus_plus(systems: Callable[..., System], tmp_path: Path) -> None:
    """The first moves an arm, both see the state and stop the robot, with no package at all.

    Neither takes the secret among its arguments, which every user of a host can read.
    """
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        missing("no C++ compiler here (Debian: apt install g++)")
        return
    interpreter = node()
    (tmp_path / "look.mjs").write_text(program("js"))
    (tmp_path / "look.cpp").write_text(program("cpp"))
    run([compiler, "-std=c++17", "-Wall", "-Wextra", "look.cpp", "-o", "look"], tmp_path)
    system = systems(tmp_path, has_guard=False)
    with system.connect("watcher") as robot:
        web = Web(system)
        try:
            before = robot.fresh_state().left_arm.q[0]
            (tmp_path / "web.json").write_text(web.process.text().splitlines()[0])
            said = run([interpreter, "look.mjs"], tmp_path)
            assert said.count("ok: true") == 4 and "confirmed: true" in said, said
            assert abs(robot.fresh_state().left_arm.q[0] - before - 0.05) < 0.02
            wait_for(lambda: any("js" in text for text in robot.state.latches.values()), "the first stop")
            robot.recover("seen")
            wait_for(lambda: not robot.state.latches, "the recovery")
            looked = run(["./look", "127.0.0.1", str(web.port)], tmp_path, TA2_WEB_SECRET=web.token)
            state, stop = looked.splitlines()
            assert json.loads(state)["type"] == "state" and json.loads(stop)["confirmed"]
            wait_for(lambda: any("c++" in text for text in robot.state.latches.values()), "the second stop")
        finally:
            web.process.end()
