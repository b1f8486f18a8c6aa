"""How trials of `ta2 check` go on and end: what fails ends them, and whatever happens the robot is left held or paused."""

from __future__ import annotations

from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from gateway.cli.check import trials as module
from gateway.cli.check.capture import Capture
from gateway.cli.check.rows import MOVING, row
from gateway.cli.check.trials import Trials, step_of
from gateway.errors import Code, NotReady, Refusal
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.settings.settings import LinkSettings
from gateway.values import Side
from tests.cli.check.seen import NAMES, Bench
from tests.cli.check.test_faults import Commander

PARTS = {"left_arm": True, "right_arm": True, "chassis": True}


class Told:
    """Nobody is told."""

    def say(self, text):
        """Forget it."""

    def advance(self, phase, progress, detail):
        """Forget it."""


class Gateway:
    """A gateway that refuses to enable; remembers how its owner left, and who stopped."""

    def __init__(self):
        self.left, self.stopped, self.losses = [], [], []

    def control(self, on_loss="hold"):
        """Return a right to command."""
        self.losses.append(on_loss)
        return self

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        self.left.append(kind)

    def enable(self):
        """Refuse."""
        raise NotReady(Refusal(code=Code.ENABLE_TIMEOUT, message="the FSM stayed PAUSE", hint="enable()"))

    def estop(self, reason):
        """Remember it."""
        self.stopped.append(reason)


@pytest.fixture
def gateway(monkeypatch):
    """The gateway that trials start."""
    made = Gateway()

    @contextmanager
    def own_gateway(self):
        yield made, None

    monkeypatch.setattr(Trials, "_own_gateway", own_gateway)
    return made


def some_trials(capture=None, parts=PARTS):
    """Return trials of a standard robot."""
    return Trials(capture=capture or Capture(NAMES), parts=parts, tell=Told(), settings=LinkSettings())


def verdicts(rows):
    """Return verdicts by name; every moving row is there once, in order."""
    assert [each.name for each in rows] == list(MOVING)
    return {each.name: each.verdict for each in rows}


def paused_capture():
    """Return what a paused robot says."""
    bench = Bench()
    bench.run(0.2)
    return bench.capture


def test_what_is_refused_is_a_row_and_the_rest_is_not_tried(gateway):
    """In words that a person can follow in a shell; the owner left by the error, which holds."""
    rows = some_trials(paused_capture()).all(None)
    found = verdicts(rows)
    assert found.pop("echo") == "fail" and set(found.values()) == {"skipped"}
    assert "ENABLE_TIMEOUT: the FSM stayed PAUSE -> `ta2 enable`" in rows[0].found and gateway.left == [NotReady]
    assert not gateway.stopped and gateway.losses == ["pause"]


def test_an_arm_that_jumps_while_it_is_enabled_has_not_stayed(monkeypatch):
    """The first frames are sent before READY: what the arm does then is what `echo` looks for."""
    bench = Bench()
    bench.run(0.5)
    commander = Commander(bench)
    clock = SimpleNamespace(sleep=lambda s: bench.run(s, commander), monotonic_ns=lambda: bench.now_ns)
    monkeypatch.setattr(module, "time", clock)

    class Enabling(Gateway):
        def enable(self):
            bench.run(0.3, commander)
            bench.fault(fault="jump", side="left", joint=3, delta_rad=0.25)
            bench.run(1.0, commander)

    assert next(some_trials(bench.capture).commanded(Enabling())).verdict == "fail"


def test_a_robot_that_is_not_known_to_be_paused_is_stopped_in_the_end(gateway):
    """Silence is no PAUSE."""
    some_trials().all(None)
    assert gateway.stopped == ["ta2 check: the robot did not pause"]


def test_a_gateway_that_runs_is_not_killed(gateway):
    """Rows that need one of our own say so; nor is it stopped: its owner was told, and the arms are held."""
    rows = {each.name: each for each in some_trials().all(gateway)}
    assert rows["heartbeat"].found == rows["chassis_timeout"].found == "needs a gateway of its own"
    assert not gateway.stopped


def test_parts_that_are_not_there_are_not_tried(gateway):
    """Nothing is owned for nothing."""
    rows = some_trials(parts={"left_arm": False}).all(None)
    assert set(verdicts(rows).values()) == {"skipped"} and gateway.left == [None]
    assert rows[0].found == "the part is not there, or disabled"


def test_a_row_that_fails_ends_the_trials_as_an_error_does(gateway):
    """Whoever owns the robot leaves it held, and no gateway is killed any more."""

    def commanded(robot):
        with robot.control(on_loss="pause"):
            yield row("echo", True, "")
            yield row("move_left", False, "stuck")
            raise AssertionError("it went on")

    taken = []
    module._take(commanded(gateway), taken)
    assert [each.name for each in taken] == ["echo", "move_left"] and gateway.left == [GeneratorExit]
    module._take(iter(()), taken)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("part", [0.0, 0.02, 0.98, 1.0, None])
def test_a_step_goes_where_there_is_room(side, part):
    """Inside the limits wherever the arm is inside them (manual §4.13)."""
    lower, upper = JOINT_LOWER_RAD[side], JOINT_UPPER_RAD[side]
    q_rad = (
        HOME_Q_RAD[side]
        if part is None
        else [low + part * (high - low) for low, high in zip(lower, upper, strict=True)]
    )
    joint, step = step_of(side, q_rad)
    assert abs(step) == 0.05 and lower[joint] < q_rad[joint] + step < upper[joint]
