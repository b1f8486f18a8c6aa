"""What `ta2 check` makes of what was seen, beside faults of the robot: findings of `ta2 link`, wishes, what nobody knows."""

from __future__ import annotations

import inspect
import re

import pytest

from gateway.cli.check.looked import PARTS, ROW_OF, Wish, parts_of
from gateway.cli.check.rows import POINTS
from gateway.cli.looking import link_findings
from gateway.link.others.foreign_watch import Neighbours, Session
from gateway.robot.topics import JOINT_STATE, STATE_TOPICS, TOPICS, ee_pose, joint_command
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.cli.check.seen import TOKENS, Bench, looked_at, named

TOLD = {"GUARD", "CONNECTED", "UNKNOWN", "UNDELIVERED", "QOS"}
"""Findings that are only worth knowing."""


def seen(settings=None):
    """Return a robot that was listened to."""
    bench = Bench(settings)
    bench.run(3.2)
    return bench


def test_every_finding_of_the_link_has_its_row():
    """One judgement of the wire: a new finding has to be shown somewhere."""
    source = inspect.getsource(link_findings)
    codes = set(re.findall(r'"([A-Z][A-Z_]+)"', source)) - {"ORDER"}
    assert codes - TOLD == set(ROW_OF) and set(ROW_OF.values()) <= set(POINTS)


def test_somebody_else_who_commands_is_found():
    """By row `writers`, with the topic."""
    neighbours = Neighbours(
        router_version="v1.10.2",
        sessions={"4057": Session("client", "tcp/10.0.0.9:1")},
        sent={("4057", joint_command(Side.LEFT)): (7, 1_000 * 10**9 + 3 * 10**9)},
    )
    rows = looked_at(seen(), neighbours=neighbours)
    assert named(rows.values(), "fail") == ["writers"] and "/api/left_arm/joint_cmd (7)" in rows["writers"].found


def test_a_router_that_does_not_say_who_is_there_is_no_proof_that_nobody_is():
    """Unknown, and no failure."""
    rows = looked_at(seen(), neighbours=Neighbours())
    assert named(rows.values(), "unknown") == ["writers"] and not named(rows.values(), "fail")


def test_a_part_that_is_meant_to_be_off_is_left_out():
    """Enabled or not, announced or not; unless somebody said so it is missed."""
    tokens = tuple(each for each in TOKENS if "left_" not in each.topic and "chassis" not in each.topic)
    bench = seen(SimSettings(enable_left_arm=False, enable_chassis=False))
    assert named(looked_at(bench).values(), "fail") == ["states", "parts"]
    wish = Wish(without=frozenset({"left_arm", "chassis"}))
    rows = looked_at(bench, wish, tokens=tokens)
    assert not named(rows.values(), "fail") and rows["parts"].found == "right_arm"
    assert named(looked_at(bench, tokens=tokens).values(), "fail") == ["announced", "parts"]


def test_parts_are_those_of_the_model():
    """Only one has a lift (manual §1.2); nothing is enabled before the robot has said so."""
    everything = {f"enable_{part}": 1 for part in PARTS}
    assert parts_of(everything, Wish(), has_lift=True) == dict.fromkeys(PARTS, True)
    assert "lift_servo" not in parts_of(everything, Wish(), has_lift=False)
    assert not any(parts_of(None, Wish(), has_lift=True).values())


@pytest.mark.parametrize("text", ["{", "[]", "[" * 100_000])
def test_a_mode_that_cannot_be_read_is_unknown(text):
    """Never a crash."""
    from cdr_types import encode
    from cdr_types.messages import std_msgs
    from gateway.robot.topics import CURRENT_MODE
    from tests.cli.check.seen import NAMES

    bench = Bench()
    bench.capture.take(NAMES.index(CURRENT_MODE), bench.now_ns, encode(std_msgs.String(data=text)))
    rows = looked_at(bench)
    assert {rows[name].verdict for name in ("mode", "parts", "control")} == {"unknown"}


def test_bytes_that_are_no_message_are_left_out():
    """Row `samples` tells of them; nothing else trips over them."""
    bench = seen()
    for number in range(len(bench.mailboxes)):
        bench.capture.take(number, bench.now_ns, b"\x00\x01\x00\x00\xff")
    assert not named(looked_at(bench).values(), "fail")


@pytest.mark.parametrize("without", [frozenset(), frozenset({"left_arm"})])
def test_rows_of_stamps_say_of_how_many_topics_they_are(without):
    """A pose has none: one that stands still is seen by nobody, and no row says that it does not."""
    bench = Bench()
    bench.fault(fault="freeze", topic=ee_pose(Side.RIGHT))
    bench.run(3.2)
    rows = looked_at(bench, Wish(without=without))
    states = [topic for topic in STATE_TOPICS if not topic.startswith(tuple(PARTS[part] for part in without))]
    stamped = [topic for topic in states if TOPICS[topic].type_name == JOINT_STATE]
    for name in ("fresh", "order", "latency"):
        assert rows[name].verdict == "pass" and "stamped" in rows[name].title
        assert f"of {len(stamped)} of {len(states)} topics" in rows[name].found and len(stamped) < len(states)
