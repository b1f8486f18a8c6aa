"""Hostile payloads over zenoh against real processes: the daemon lives, answers, and drives the robot afterwards.

The attackers are processes of their own with a deadline each, so that nothing they run into can hang a test. What every
payload does to the engine is judged in virtual time beside this file; here it is sessions, threads, locks and memory.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.client import Control, Robot
from gateway.errors import CODES, Code, MotionEnded, NotReady
from tests.e2e.system import Process, System, wait_for
from tests.fuzz.attacker import connect
from tests.thoroughness import IS_THOROUGH, either

pytestmark = pytest.mark.e2e

CONFIG = "[loss]\nfree_after_s = 1.0\ndown_after_s = 2.0\n"
WARM_UP = 500
PAYLOADS = either(2_000, 5_000)
ATTACK_S = 90.0
GROWTH_KIB = 30 * 1024


@pytest.fixture
def system(tmp_path: Path) -> Iterator[System]:
    """Give a simulated robot and a daemon, each a process."""
    made = System(tmp_path, config=CONFIG, has_guard=IS_THOROUGH)
    try:
        yield made
    finally:
        made.close()


def attack(system: System, side: str, target: str, seed: int, count: int) -> dict[str, Any]:
    """Run an attacker to its end and return what it did; fail when it does not end in time."""
    name = f"attacker-{side}-{seed}"
    process = Process(name, ["-u", "-m", "tests.fuzz.attacker", side, target, str(seed), str(count)], system.folder)
    system.clients.append(process)
    wait_for(lambda: not process.is_running, f"the end of {name}", ATTACK_S)
    assert process.wait() == 0, process.text()[-3000:]
    report: dict[str, Any] = json.loads(process.text().rsplit("DONE ", 1)[1])
    return report


def rss_kib(process: Process) -> int:
    """Return the resident memory of a process [KiB]."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0])


def assert_well(system: System) -> None:
    """The daemon is the same process, hears the robot, and a newcomer can own, enable, move and release it."""
    assert system.daemon.is_running, system.daemon.text()[-3000:]
    with system.connect("newcomer") as robot:
        assert robot.info.pid == system.daemon.pid
        wait_for(lambda: recovered(robot), "a recovery", 5.0)
        seq = robot.state.seq
        wait_for(lambda: robot.state.seq > seq + 10 and robot.state.link.fresh, "live state")
        with robot.control(take="after an attack") as own:
            wait_for(lambda: robot.state.fsm == 0, f"a robot at rest ({robot.state.shown})")
            wait_for(lambda: recovered(robot) and moved(system, own), "a motion", 45.0)
        wait_for(lambda: not robot.state.lease.owned and robot.state.fsm == 0, "a released robot")


def moved(system: System, own: Control) -> bool:
    """Enable and move an arm; return whether it went well, or it must be tried again: a lie lasts, the machine is busy."""
    try:
        own.enable(timeout=12.0)
        before = system.arm_q()
        own.left_arm.move_by([0.05] * 7, speed=0.5, on_limit="clip").result(15.0)
    except (MotionEnded, NotReady) as broken:
        passing = Code.PART_LOST, Code.ROBOT_PAUSED, Code.ENDPOINT_SILENT
        assert CODES[broken.code].retryable or broken.code in passing, broken
        return False
    assert max(abs(a - b) for a, b in zip(system.arm_q(), before, strict=True)) > 0.03, "the arm did not move"
    return True


def recovered(robot: Robot) -> bool:
    """Return whether all latches are gone, and stop endpoints that nobody keeps; wrong joint names latch for a second more."""
    try:
        robot.recover(reason="after an attack")
    except NotReady as refused:
        assert refused.code in (Code.LATCH_PERSISTS, Code.STATE_STALE), refused
        return False
    return True


def raw_snapshot(system: System) -> dict[str, Any]:
    """Return the newest snapshot, asked for as any program can that speaks zenoh and JSON."""
    with connect(f"unixsock-stream/{system.target}") as session:
        for reply in session.get("ta2/1/snapshot", encoding="application/json", timeout=5.0):
            if reply.ok is not None:
                snapshot: dict[str, Any] = json.loads(reply.ok.payload.to_bytes())
                return snapshot
    pytest.fail("no snapshot came")


def assert_log_is_whole(system: System) -> None:
    """Nothing unforeseen was caught on the way, and nobody wrote lines of their own into the log."""
    text = system.daemon.text()
    assert "Traceback" not in text, text[text.index("Traceback") - 500 :][:3000]
    assert "\x1b" not in text and "\nforged" not in text


def run_attacks(system: System, side: str, target: str) -> dict[str, Any]:
    """Attack twice, the second time in earnest, and judge the daemon and its memory."""
    system.connect("first").close()  # the daemon is there and hears the robot
    attack(system, side, target, 1, WARM_UP)
    assert_well(system)
    before_kib = rss_kib(system.daemon)
    report = attack(system, side, target, 2, PAYLOADS)
    assert_well(system)
    growth_kib = rss_kib(system.daemon) - before_kib
    print(f"\n{side}: {report['done']}, answers {report['codes']}, daemon {before_kib} KiB, then {growth_kib:+d} KiB")
    assert growth_kib < GROWTH_KIB, f"the daemon grew by {growth_kib} KiB"
    assert_log_is_whole(system)
    return report


@pytest.mark.thorough
def test_hostile_clients_do_not_harm_the_daemon(system: System) -> None:
    """Raw queries, puts, deletions and declarations on every key of the local plane, a megabyte ending each batch.

    Each question is answered once. On a busy host this attacker sends faster than it is read, or reads less than it is sent:
    then answers are lost, other ones each time.
    """
    report = run_attacks(system, "local", system.target)
    done, codes, unanswered = report["done"], report["codes"], set(report["unanswered"])
    asked = {key: count for key, count in done.items() if key.startswith("question")}
    assert asked.keys() <= {"question answered 1", "question answered 0"}, f"a question was answered twice: {done}"
    assert len(unanswered) < asked["question answered 1"] // 10, done
    for _ in range(3):
        if unanswered:
            unanswered &= set(attack(system, "local", system.target, 2, PAYLOADS)["unanswered"])
    assert not unanswered, f"never answered: {unanswered}"
    assert "never finished" not in done, done
    assert codes.keys() - {"no refusal"} <= {code.value for code in CODES} - {"INTERNAL"}, codes
    assert "malformed" in system.daemon.text()
    assert min(codes["BAD_REQUEST"], codes["no refusal"]) > PAYLOADS // 50, codes


@pytest.mark.thorough
def test_hostile_samples_do_not_harm_the_daemon(system: System) -> None:
    """Raw samples on the robot's state keys among the robot's own, and of tokens of a bridge that raves."""
    report = run_attacks(system, "robot", system.endpoint)
    assert report["done"]["token"] > 6 * PAYLOADS // 100, report
    refused = {topic: view["refused"] for topic, view in raw_snapshot(system)["topics"].items()}
    # The newest of 20 to 50 ms is decoded, so that most hostile samples of a fast topic are never looked at.
    assert sum(refused.values()) > PAYLOADS // 50, f"hardly a sample was refused: {refused}"
