"""Others: ours is never foreign, data lasts until it has been gone for 2 s, and everybody is named as far as known."""

from __future__ import annotations

import pytest

from gateway.core.messages.sightings import ForeignData, Gateway, Means, Writer
from gateway.core.others.others import DATA_GONE_NS, FRIENDS_KEPT, GATEWAYS_KEPT, TRACES_KEPT, Others
from gateway.errors import Code
from gateway.robot.topics import CHASSIS_VELOCITY, FSM_ENABLE, LIFT_COMMAND, gripper_command, joint_command
from gateway.values import Side

S = 1_000_000_000
ARM = joint_command(Side.LEFT)
WHEELS = CHASSIS_VELOCITY


def writer(zid: str = "ab", topic: str = ARM, means: Means = Means.TOKEN, link: str = "") -> Writer:
    """Somebody who announces to publish."""
    return Writer(topic=topic, zid=zid, means=means, link=link)


def data(topic: str = ARM, zid: str = "", at_ns: int = 0, count: int = 1, link: str = "") -> ForeignData:
    """Samples that arrived together."""
    return ForeignData(topic=topic, zid=zid, at_ns=at_ns, count=count, link=link)


@pytest.fixture
def others() -> Others:
    """A registry of a gateway called `me` with an earlier run called `old`."""
    made = Others(["01d"], "hold")
    made.own_zid = "0e"
    return made


# ------------------------------------------------------------------------------------------------ who is ours


def test_sessions_of_ours_are_never_foreign(others):
    """Neither what they announce nor what they send nor what they claim: this run's, an earlier one's, the guard's."""
    others.befriend("0e")
    others.befriend("9a")
    for zid in ("0e", "01d", "9a"):
        others.see_writers([writer(zid)], 1)
        others.see_gateways([Gateway(zid=zid, is_armed=True)], 1)
        others.see_data(data(zid=zid))
        assert (others.writers, others.gateways, others.data(0), others.objection(0)) == ((), (), (), None)
    assert others.friends == ("01d", "0e", "9a")


def test_who_turns_out_to_be_ours_is_forgotten(others):
    """The guard's data may be seen before it is introduced; somebody else's stays."""
    others.see_data(data(zid="9a"))
    others.see_data(data(zid="b"))
    others.befriend("9a")
    others.befriend("")
    assert [trace.zid for trace in others.data(0)] == ["b"]


def test_whoever_was_armed_last_is_the_process_that_is_gone(others):
    """Also when its token has gone before; who was armed earlier is somebody else."""
    others.befriend_predecessor()
    for zid in ("b", "d0"):
        others.see_gateways([Gateway(zid=zid, is_armed=True)], 1)
        others.see_gateways([Gateway(zid=zid, is_armed=False)], 2)
    others.befriend_predecessor()
    assert others.friends == ("01d", "d0")


def test_the_latest_sessions_are_remembered(others):
    """A bounded number; nobody is remembered twice."""
    for number in range(40):
        others.befriend(f"{number:x}")
        others.befriend(f"{number:x}")
    assert others.friends == tuple(f"{number:x}" for number in range(40 - FRIENDS_KEPT, 40))


# ------------------------------------------------------------------------------------------------ who is there


def test_writers_are_those_who_announce_now(others):
    """Each with its topic, since it was first seen there; who left is gone."""
    others.see_writers([writer("ab")], 5)
    others.see_writers([writer("ab"), writer("cd", WHEELS)], 9)
    assert [(w.zid, others.since_ns(w)) for w in others.writers] == [("ab", 5), ("cd", 9)]
    others.see_writers([writer("cd", WHEELS)], 12)
    others.see_writers([writer("ab"), writer("cd", WHEELS)], 15)
    assert [(w.zid, others.since_ns(w)) for w in others.writers] == [("ab", 15), ("cd", 9)]
    others.see_writers([], 20)
    assert others.writers == () and others.objection(20) is None


def test_a_bridges_publisher_beside_its_token_counts_once(others):
    """A ROS bridge has both; a publisher on another topic than the token is somebody else's doing."""
    others.see_writers(
        [writer("ab"), writer("ab", means=Means.PUBLISHER), writer("ab", WHEELS, means=Means.PUBLISHER)], 1
    )
    assert [(w.topic, w.means) for w in others.writers] == [(ARM, Means.TOKEN), (WHEELS, Means.PUBLISHER)]


def test_publishers_of_another_gateway_are_no_writers(others):
    """It declares them when it connects, long before it commands anything; a bridge's token on it would count."""
    others.see_gateways([Gateway(zid="9", is_armed=False)], 1)
    others.see_writers([writer("9", means=Means.PUBLISHER), writer("8", means=Means.PUBLISHER)], 1)
    assert [w.zid for w in others.writers] == ["8"]
    others.see_writers([writer("9", means=Means.TOKEN)], 2)
    assert [w.zid for w in others.writers] == ["9"]


def test_who_was_a_gateway_once_stays_one(others):
    """When it leaves, its token is gone at once and its publishers with the next look at the router; nobody else's matter."""
    others.see_gateways([Gateway(zid="9", is_armed=False)], 1)
    others.see_gateways([], 2)
    others.see_writers([writer("9", means=Means.PUBLISHER), writer("8", means=Means.PUBLISHER)], 2)
    assert [w.zid for w in others.writers] == ["8"]
    for number in range(GATEWAYS_KEPT):
        others.see_gateways([Gateway(zid=f"{number + 256:x}", is_armed=False)], 3)
    assert [w.zid for w in others.writers] == ["9", "8"]


def test_a_gateway_that_arms_counts_anew(others):
    """Since when it commands matters more than since when it is connected."""
    others.see_gateways([Gateway(zid="9", is_armed=False)], 3)
    assert [others.since_ns(g) for g in others.gateways] == [3] and others.armed == () and others.objection(3) is None
    others.see_gateways([Gateway(zid="9", is_armed=True, link="tcp/x")], 7)
    (rival,) = others.armed
    assert others.since_ns(rival) == 7
    refusal = others.objection(8)
    assert refusal.code is Code.OTHER_GATEWAY and "9 at tcp/x" in refusal.message and refusal.value == "9"


# ------------------------------------------------------------------------------------------------ what they send


def test_data_lasts_until_it_has_been_gone_for_2_s(others):
    """Counted and dated per sender and topic, the oldest first; what comes later is a new one."""
    others.see_data(data(zid="b", at_ns=5, count=3))
    others.see_data(data(zid="b", at_ns=9, count=2, link="tcp/x"))
    others.see_data(data(zid="b", at_ns=10))
    others.see_data(data(WHEELS, zid="b", at_ns=2))
    first, second = others.data(10)
    assert (first.topic, second.topic) == (WHEELS, ARM)
    assert (second.since_ns, second.last_ns, second.count, second.link) == (5, 10, 6, "tcp/x")
    assert [t.topic for t in others.data(10 + DATA_GONE_NS)] == [ARM]
    assert others.data(11 + DATA_GONE_NS) == ()
    others.see_data(data(zid="b", at_ns=5 * S))
    assert [t.since_ns for t in others.data(5 * S)] == [5 * S]


def test_what_an_armed_gateway_sends_is_no_foreign_data_and_over_when_it_disarms(others):
    """Its token says it all, and says when it is done: whoever waits for the robot does not wait for 2 s more."""
    others.see_gateways([Gateway(zid="9", is_armed=True)], 1)
    others.see_data(data(zid="9"))
    others.see_data(data(zid="b"))
    assert [t.zid for t in others.data(0)] == ["b"]
    others.see_gateways([Gateway(zid="9", is_armed=False)], 2)
    assert [t.zid for t in others.data(0)] == ["b"]
    others.see_data(data(zid="9"))
    assert [t.zid for t in others.data(0)] == ["b", "9"]  # it sends without being armed: an e-stop there


def test_data_that_comes_back_after_2_s_begins_anew(others):
    """Also when nobody looked meanwhile."""
    others.see_data(data(zid="b", at_ns=0))
    others.see_data(data(zid="b", at_ns=3 * S))
    assert [(t.since_ns, t.count) for t in others.data(3 * S)] == [(3 * S, 1)]


def test_a_flood_of_names_costs_bounded_memory(others):
    """The longest silent are forgotten first; that something is sent is never."""
    for number in range(3 * TRACES_KEPT):
        others.see_data(data(zid=f"{number:x}", at_ns=number))
    traces = others.data(3 * TRACES_KEPT)
    assert len(traces) == TRACES_KEPT and traces[-1].zid == f"{3 * TRACES_KEPT - 1:x}"


# ------------------------------------------------------------------------------------------------ what it means


def test_arm_and_fsm_data_is_told_apart_from_chassis_and_lift(others):
    """The first takes everything down, the second is as bad as an announcement (BEHAVIOUR, somebody else)."""
    others.see_data(data(WHEELS, zid="b"))
    assert others.arm_data_text(0) == "" and f"b sends on {WHEELS}" in others.writer_text(0)
    others.see_data(data(FSM_ENABLE, zid="c"))
    others.see_data(data(gripper_command(Side.LEFT), zid="d"))
    assert "c sends on /api/fsm/enable" in others.arm_data_text(0) and "d sends on" in others.arm_data_text(0)
    assert others.objection(0).code is Code.FOREIGN_WRITER
    assert WHEELS in others.objection(0).message and FSM_ENABLE in others.objection(0).message


def test_who_announces_is_named_once_with_all_topics(others):
    """One bridge, several publishers; an address where it is known."""
    others.see_writers([writer("ab", link="tcp/x"), writer("ab", WHEELS, link="tcp/x"), writer("cd")], 1)
    text = others.writer_text(2)
    assert text == f"zenoh session ab at tcp/x publishes on {ARM}, {WHEELS}; zenoh session cd publishes on {ARM}"


def test_everybody_who_commands_is_named_with_all_that_he_does(others):
    """One sentence for each session, with id, address, topics, since when, and how much came; armed gateways first."""
    assert not list(others.commanders(S))
    others.see_writers([writer("b0b", WHEELS, link="tcp/10.0.0.9:1"), writer("b0b", link="tcp/10.0.0.9:1")], S)
    others.see_data(data(ARM, zid="b0b", at_ns=2 * S, count=3, link="tcp/10.0.0.9:1"))
    others.see_data(data(ARM, zid="", at_ns=2 * S))
    others.see_data(data(LIFT_COMMAND, zid="", at_ns=2 * S, count=2))
    others.see_gateways([Gateway(zid="9a", is_armed=True), Gateway(zid="9b", is_armed=False)], S)
    others.see_writers([writer("b0b", WHEELS, link="tcp/10.0.0.9:1"), writer("eve")], 3 * S)
    first, *rest = others.commanders(3 * S)
    assert (first.code, first.who, first.since_ns, first.count) == (Code.OTHER_GATEWAY, "9a", S, 0)
    assert first.text == "another gateway, zenoh session 9a, commands the robot, or is about to"
    assert [(each.code, each.who, each.since_ns, each.count) for each in rest] == [
        (Code.FOREIGN_WRITER, "b0b", S, 3),
        (Code.FOREIGN_WRITER, ARM, 2 * S, 1),
        (Code.FOREIGN_WRITER, LIFT_COMMAND, 2 * S, 2),
        (Code.FOREIGN_WRITER, "eve", 3 * S, 0),
    ]
    sent = f"sends commands on {ARM} that are not ours"
    assert rest[0].text == f"zenoh session b0b at tcp/10.0.0.9:1 {sent} and announces some on {WHEELS}"
    assert rest[1].text == f"zenoh session eve (by what it announces) {sent}"
    assert "does not name itself" in rest[2].text and LIFT_COMMAND in rest[2].text
    assert rest[3].text == f"zenoh session eve announces some on {ARM}"


def test_who_sends_is_named_as_far_as_it_can_be_known(others):
    """By its stamp; else by who announces the topic; else nobody can be named."""
    others.see_data(data())
    (trace,) = others.data(0)
    assert "does not name itself" in others.sender(trace)
    others.see_writers([writer("ab", link="tcp/x"), writer("cd", WHEELS), writer("ef")], 1)
    assert others.sender(trace) == "zenoh session ab at tcp/x or zenoh session ef (by what it announces)"
    others.see_data(data(zid="cd", link="tcp/y"))
    assert others.sender(others.data(0)[-1]) == "zenoh session cd at tcp/y"


def test_under_warn_nobody_but_an_armed_gateway_objects():
    """Event only: they are seen and named, and stop nothing."""
    others = Others([], "warn")
    others.see_writers([writer()], 1)
    others.see_data(data())
    others.see_data(data(WHEELS))
    assert others.writers and others.data(0)
    assert (others.arm_data_text(0), others.writer_text(0), others.objection(0)) == ("", "", None)
    others.see_gateways([Gateway(zid="9", is_armed=True)], 1)
    assert others.objection(0).code is Code.OTHER_GATEWAY


def test_a_topic_is_somebody_elses_when_he_sends_on_it_or_a_gateway_is_armed(others):
    """Not when he sends elsewhere, or announces; not under `warn`."""
    relaxed = Others([], "warn")
    for one in (others, relaxed):
        one.see_writers([writer(topic=WHEELS)], 0)
        one.see_data(data(ARM, zid="b"))
    assert others.has_command_of(ARM, 0) and not others.has_command_of(WHEELS, 0)
    assert not relaxed.has_command_of(ARM, 0)
    relaxed.see_gateways([Gateway(zid="9", is_armed=True)], 1)
    assert relaxed.has_command_of(WHEELS, 0)


def test_a_friend_that_shows_a_claim_is_known_and_no_rival(others):
    """A guard of an earlier daemon holds, or a daemon before this one has not quite gone."""
    others.befriend("9")
    others.see_gateways([Gateway(zid="9", is_armed=True), Gateway(zid="8", is_armed=True)], 1)
    assert others.armed_friends == ("9",)
    assert [gateway.zid for gateway in others.armed] == ["8"]
    others.see_gateways([Gateway(zid="9", is_armed=False)], 2)
    assert others.armed_friends == ()


def test_nobody_but_us_was_seen_until_somebody_was(others):
    """Announcing, being a gateway or sending is enough, whoever it is."""
    assert others.is_alone
    others.see_gateways([Gateway(zid="9", is_armed=False)], 1)
    assert not others.is_alone
