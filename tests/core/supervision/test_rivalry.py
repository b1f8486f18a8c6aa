"""Rivalry: our claim follows the lease and the frames, everybody who comes or goes is told once, and no 0.0 runs on."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import GuardSeen
from gateway.core.messages.outputs import Level, Notice
from gateway.core.messages.sightings import (
    Befriended,
    ClaimShown,
    ForeignData,
    ForeignTokens,
    Gateway,
    GatewayTokens,
    Means,
    Writer,
)
from gateway.core.others.claim import LINK_SETTLE_NS, LOOK_AGAIN_NS
from gateway.core.others.others import DATA_GONE_NS
from gateway.core.supervision.rivalry import NEWCOMER_NS, Rivalry
from gateway.core.supervision.supervisor import STREAMING, State
from gateway.errors import Code
from gateway.robot.topics import CHASSIS_VELOCITY, gripper_command, joint_command
from gateway.values import Side
from tests.core.stage import Stage

ARM = joint_command(Side.LEFT)
GRIP = gripper_command(Side.LEFT)


class Scene(Stage):
    """A stage on which others are followed."""

    def __init__(self, state: State = State.IDLE, **how: object) -> None:
        super().__init__(state, **how)
        self.rivalry = Rivalry(self.coordinator)

    def step(self) -> list[Notice]:
        """One tick; return what was told."""
        self.coordinator.notices.clear()
        self.run(1)
        self.rivalry.step(self.now_ns)
        return list(self.coordinator.notices)

    def writers(self, *writers: Writer) -> list[Notice]:
        """Who announces commands changes."""
        self.rivalry.receive(ForeignTokens(writers=writers, at_ns=self.now_ns))
        return self.step()

    def gateways(self, **armed: bool) -> list[Notice]:
        """Which gateways are there changes."""
        gateways = tuple(Gateway(zid=zid, is_armed=is_armed, link="tcp/g") for zid, is_armed in armed.items())
        self.rivalry.receive(GatewayTokens(gateways=gateways, at_ns=self.now_ns))
        return self.step()

    def data(self, topic: str = ARM, zid: str = "", count: int = 1) -> list[Notice]:
        """Somebody sends."""
        self.rivalry.receive(ForeignData(topic=topic, zid=zid, at_ns=self.now_ns, count=count, link="tcp/d"))
        return self.step()


def announced(zid: str, topic: str = ARM, link: str = "") -> Writer:
    """Somebody who announces to publish."""
    return Writer(topic=topic, zid=zid, means=Means.TOKEN, link=link)


# ------------------------------------------------------------------------------------------------ our claim


def test_a_lease_is_claimed_and_the_claim_confirmed_when_it_was_shown():
    """From the first tick on: the wait is over before most users ask for anything."""
    scene = Scene(State.IDLE)
    claim = scene.coordinator.claim
    claim.link_up(scene.now_ns - LINK_SETTLE_NS)
    scene.step()
    assert claim.number == 2 and not claim.is_confirmed  # the stage itself had claim 1
    scene.rivalry.receive(ClaimShown(claim=2, at_ns=scene.now_ns - LOOK_AGAIN_NS))
    scene.step()
    assert claim.is_confirmed


def test_nothing_is_claimed_while_an_earlier_guard_holds():
    """It shows its own claim and would take ours for a rival's: the hold is taken over first."""
    scene = Scene(State.IDLE)
    scene.rivalry.link_up("0e", scene.now_ns)
    scene.coordinator.guard.earlier_holds = True
    scene.now_ns += LINK_SETTLE_NS
    scene.step()
    assert scene.coordinator.claim.number == 0
    scene.coordinator.guard.earlier_holds = False
    scene.step()
    assert scene.coordinator.claim.number


def test_a_link_brings_our_name_and_the_claim_begins_anew():
    """The session of each link is ours from then on; what was claimed on the former one is not seen any more."""
    scene = Scene(State.IDLE)
    scene.rivalry.link_up("0e", scene.now_ns)
    others, claim = scene.coordinator.others, scene.coordinator.claim
    assert (others.own_zid, others.friends) == ("0e", ("0e",)) and claim.number == 0
    scene.now_ns += LINK_SETTLE_NS
    scene.step()
    assert claim.number == 2


@pytest.mark.parametrize("state", sorted(STREAMING - {State.ENABLING}))
def test_an_unowned_hold_is_claimed(state):
    """Whoever holds the arms commands the robot, owner or not."""
    scene = Scene(state, owner=None)
    scene.step()
    assert scene.coordinator.claim.is_confirmed


def test_an_unowned_base_claims_nothing():
    """Somebody else may have the robot."""
    scene = Scene(State.READ_ONLY, owner=None)
    scene.step()
    assert scene.coordinator.claim.number == 0


def test_the_claim_lasts_until_the_last_stop_frame():
    """Chassis zeros still go out after the lease was given back."""
    scene = Scene(State.READ_ONLY, owner=None)
    scene.coordinator.body.ground_stop(scene.now_ns)
    scene.step()
    assert scene.coordinator.claim.is_confirmed
    scene.run(120)
    scene.step()
    assert scene.coordinator.claim.number == 0


def test_the_claim_waits_while_another_gateway_is_armed():
    """An established one is never disturbed by ours."""
    scene = Scene(State.IDLE)
    scene.coordinator.claim.link_up(scene.now_ns - LINK_SETTLE_NS)
    scene.gateways(b=True)
    assert scene.coordinator.claim.number == 0
    scene.gateways()
    assert scene.coordinator.claim.number == 2


# ------------------------------------------------------------------------------------------------ words


def test_who_announces_commands_is_told_once_with_all_topics():
    """Who, where, what; a second look says nothing, an address that becomes known neither; going is told, too."""
    scene = Scene()
    (told,) = scene.writers(announced("ab", link="tcp/x"), announced("ab", GRIP, link="tcp/x"))
    assert (told.code, told.level) == (Code.FOREIGN_WRITER, Level.WARNING)
    assert dict(told.facts) == {"zid": "ab", "link": "tcp/x", "topics": f"{ARM}, {GRIP}"} and GRIP in told.message
    assert scene.step() == []
    assert scene.writers(announced("ab", link="tcp/y"), announced("ab", GRIP, link="tcp/y")) == []
    (told,) = scene.writers(announced("ab"), announced("ab", GRIP), announced("cd"))
    assert told.facts["zid"] == "cd" and "unknown address" in told.message
    gone = scene.writers()
    assert {notice.facts["zid"] for notice in gone} == {"ab", "cd"} and {n.level for n in gone} == {Level.INFO}


def test_a_gateway_is_told_when_it_comes_arms_disarms_and_goes():
    """Loud only while it commands."""
    scene = Scene()
    assert scene.gateways(b=False) == []  # perhaps our own guard, which has not said its name yet
    scene.now_ns += NEWCOMER_NS
    seen = [
        scene.step(),
        scene.step(),
        scene.gateways(b=True),
        scene.gateways(b=False),
        scene.gateways(),
        scene.gateways(b=True),
        scene.gateways(),
    ]
    words = [[(notice.code, notice.level, notice.message) for notice in notices] for notices in seen]
    assert words[1] == []
    texts = [message for ((code, _, message),) in (words[0], *words[2:]) if code is Code.OTHER_GATEWAY]
    for text, expected in zip(
        texts, ("is connected", "commands the robot", "nothing any more", "is gone"), strict=False
    ):
        assert expected in text
    levels = [level for ((_, level, _),) in (words[0], *words[2:])]
    assert levels == [Level.INFO, Level.WARNING, Level.INFO, Level.INFO, Level.WARNING, Level.INFO]


def test_a_gateway_whose_address_becomes_known_is_not_told_again():
    """Nothing that a person must know has changed."""
    scene = Scene()
    scene.gateways(b=True)
    scene.rivalry.receive(GatewayTokens(gateways=(Gateway(zid="b", is_armed=True, link="tcp/h"),), at_ns=scene.now_ns))
    assert scene.step() == []


def test_foreign_data_is_told_at_once_and_once_and_when_it_has_ended():
    """With the sender; at the end with how much there was."""
    scene = Scene()
    (told,) = scene.data(zid="b", count=3)
    assert (told.code, told.level) == (Code.FOREIGN_WRITER, Level.WARNING)
    assert dict(told.facts) == {"topic": ARM, "zid": "b", "link": "tcp/d"}
    assert "b at tcp/d" in told.message
    assert scene.data(zid="b", count=4) == []
    scene.now_ns += DATA_GONE_NS
    (told,) = scene.step()
    assert told.level is Level.INFO and "there were 7" in told.message


def test_a_gateway_that_turns_out_to_be_ours_is_not_told_to_be_gone():
    """The process in whose place this one goes on."""
    scene = Scene()
    scene.gateways(b=True)
    scene.rivalry.receive(Befriended(zid="b", at_ns=scene.now_ns))
    assert scene.step() == [] and scene.gateways() == []


def test_the_guard_is_introduced():
    """A session of ours: nothing about it is told."""
    scene = Scene()
    scene.rivalry.receive(Befriended(zid="9a", at_ns=scene.now_ns))
    assert scene.data(zid="9a") == [] and scene.gateways(**{"9a": True}) == [] and scene.writers(announced("9a")) == []


# ------------------------------------------------------------------------------------------------ a 0.0 that ends


def test_a_claim_does_not_end_the_hold_of_a_guard_that_cannot_be_reached():
    """It listens at another socket: whoever acquires waits for its end, and does not make it drop the grip."""
    scene = Scene()
    scene.coordinator.claim.withdraw()
    scene.coordinator.others.befriend("9a")
    scene.gateways(**{"9a": True})
    scene.step()
    assert scene.coordinator.claim.number == 0
    scene.gateways(**{"9a": False})
    scene.step()
    assert scene.coordinator.claim.number > 0


def test_our_own_guards_claim_is_no_reason_not_to_claim():
    """It shows one whenever we send."""
    scene = Scene()
    scene.coordinator.claim.withdraw()
    scene.coordinator.others.befriend("9a")
    scene.coordinator.guard.see(GuardSeen(pid=41, zid="9a", is_linked=True, at_ns=scene.now_ns))
    scene.gateways(**{"9a": True})
    scene.step()
    assert scene.coordinator.claim.number > 0


@pytest.mark.parametrize("who", ["data", "gateway"])
def test_a_0_0_that_is_being_repeated_ends_when_somebody_else_commands(who):
    """It would pause the other's robot; an e-stop's goes on whoever commands (BEHAVIOUR, somebody else)."""
    for is_estop in (False, True):
        scene = Scene(State.IDLE)
        scene.coordinator.body.heartbeat.is_owed = True
        scene.coordinator.body.heartbeat.zeros(scene.now_ns, is_estop=is_estop)
        scene.step()
        assert scene.coordinator.body.heartbeat.is_ending
        scene.data() if who == "data" else scene.gateways(b=True)
        assert scene.coordinator.body.heartbeat.is_ending is is_estop


def test_a_0_0_goes_on_beside_an_announcement_and_chassis_data():
    """Nobody moves the arms yet: pausing them is right."""
    scene = Scene(State.IDLE)
    scene.coordinator.body.heartbeat.zeros(scene.now_ns)
    scene.writers(announced("ab"))
    scene.data(CHASSIS_VELOCITY)
    assert scene.coordinator.body.heartbeat.is_ending


def test_a_1_0_is_not_ended_here():
    """What foreign data does to a heartbeat of 1.0 stands in the supervisor's table."""
    scene = Scene(State.ACTIVE)
    scene.data()
    assert scene.coordinator.body.heartbeat.running and not scene.coordinator.body.heartbeat.is_ending


def test_nothing_is_claimed_while_an_earlier_daemons_guard_holds():
    """It would take us for another gateway, and let the robot go; the claim comes with the hold."""
    scene = Scene()
    scene.coordinator.claim.withdraw()
    scene.coordinator.guard.earlier_holds = True
    scene.step()
    assert scene.coordinator.claim.number == 0
    scene.coordinator.guard.earlier_holds = False
    scene.step()
    assert scene.coordinator.claim.number > 0
