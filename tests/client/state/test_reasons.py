"""Tests of `robot.why()`: what was inferred reaches the user, with words, numbers and times."""

from __future__ import annotations

import pytest

from gateway.client import aio
from gateway.errors import Disconnected
from gateway.messages.snapshot import Finding, RefusalMessage
from tests.client.test_aio import play

S = 1_000_000_000


def stalled(world, ago_s=2.0):
    """Let the daemon have found something."""
    found = Finding(
        code="TRACKING_STALL",
        message="left arm joint 7 stays at 0.100 rad",
        hint="look for contact",
        since_ns=world.engine.snapshot.at_ns - round(ago_s * S),
        facts={"joint": 7.0, "off_rad": 0.4},
    )
    world.engine.show(findings=(found,))
    world.run(0.05)


def test_why_is_false_and_says_so_when_all_is_well(robot):
    """A program asks `if robot.why():`."""
    why = robot.why()
    assert not why and why.findings == () and "nothing is known" in str(why)


def test_why_has_codes_words_numbers_and_times(world, robot):
    """What the daemon inferred, counted to now, readable in one line each."""
    stalled(world)
    why = robot.why()
    (finding,) = why.findings
    assert why and (finding.code, finding.facts["off_rad"]) == ("TRACKING_STALL", 0.4)
    assert finding.since == pytest.approx(2.05, abs=0.1)
    assert str(why).startswith("TRACKING_STALL (for 2.") and str(why).endswith("-> look for contact")
    with pytest.raises(TypeError):
        finding.facts["off_rad"] = 0.0
    assert robot.health().findings == ("TRACKING_STALL",)


def test_latches_are_reasons_too(world, robot):
    """What is latched stands first, with the way out."""
    world.engine.show(latches={"ESTOP": "by hand"}, shown="ESTOP")
    world.run(0.05)
    why = robot.why()
    assert why and str(why) == "ESTOP (latched): by hand -> recover() when it is safe"


def test_what_would_be_refused_is_known_before_it_is_asked(world, robot):
    """By kind of request, with code, words and remedy; not a fault in itself."""
    refusal = RefusalMessage(
        code="NOT_ENABLED", message="the arms are not enabled", field="", value="", bound="", unit="", hint="enable()"
    )
    world.engine.show(refusals={"left_arm": refusal, "right_arm": refusal})
    world.run(0.05)
    why = robot.why()
    assert not why and why.refusals["left_arm"].code == "NOT_ENABLED" and "chassis" not in why.refusals
    assert str(why).splitlines()[1] == (
        "refused now: left_arm, right_arm: NOT_ENABLED: the arms are not enabled -> enable()"
    )


def test_without_a_daemon_nothing_is_made_up(world, robot):
    """What an old snapshot said is no answer."""
    world.plane.set_reachable(False)
    world.run(1.5)
    with pytest.raises(Disconnected):
        robot.why()


def test_asyncio_has_the_same(world):
    """The twin gives the same answer."""

    async def ask():
        async with aio.connect(name="t", transport=world.transport()) as robot:
            return await robot.why()

    stalled(world)
    assert play(world, ask).findings[0].code == "TRACKING_STALL"
