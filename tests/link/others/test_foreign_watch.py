"""Rules of `gateway.link.others.foreign_watch`: everybody on a command key is seen, named as far as possible, and told once."""

from __future__ import annotations

import json

import pytest
import zenoh

from cdr_types.keys import Qos, Reliability, Token, TokenKind, format_token, presence_key
from gateway.core.messages.sightings import ForeignData, ForeignTokens, Gateway, GatewayTokens, Means, Writer
from gateway.link.discovery.discovery import TokenTable
from gateway.link.others.foreign_watch import (
    AGAIN_NS,
    LOOK_PERIOD_NS,
    OTHERS_KEPT,
    ROBOT,
    SENDERS_KEPT,
    WRITERS_KEPT,
    ForeignWatch,
    Session,
    publishers_of,
)
from gateway.link.others.gateway_token import GatewayToken
from gateway.robot.topics import (
    CHASSIS_VELOCITY,
    COMMAND_TOPICS,
    FSM_ENABLE,
    TOPICS,
    VARIANTS,
    arm_state,
    joint_command,
)
from gateway.settings.settings import LinkSettings
from gateway.values import Side

S = 1_000_000_000
OWN, ROUTER = "0a", "70"
ARM = joint_command(Side.LEFT)
CHASSIS_KEY = CHASSIS_VELOCITY[1:]
QOS = Qos(reliability=Reliability.RELIABLE)


class Scene:
    """A watch with the robot's router as the test says."""

    def __init__(self, namespace: str = "", model: str = "standard") -> None:
        self.now_ns = 5 * S
        self.prefix = f"{namespace}/" if namespace else ""
        self.tokens = TokenTable()
        self.watch = ForeignWatch(LinkSettings(namespace=namespace, model=model), self.tokens, OWN, lambda: self.now_ns)
        self.publishers: dict[str, bytes] = {}
        self.sessions: object = []
        self.version: object = None
        self.asked: list[str] = []

    def token(self, zid: str, topic: str, kind: TokenKind = TokenKind.MP, *, is_there: bool = True) -> None:
        """A bridge's token comes or goes."""
        type_name = TOPICS[topic].type_name
        token = Token(zid=zid, kind=kind, topic=f"/{self.prefix}{topic[1:]}", type_name=type_name, qos=QOS)
        self.tokens.receive(format_token(token), is_there)

    def ask(self, selector: str) -> dict[str, bytes]:
        """Answer as the router's admin space."""
        self.asked.append(selector)
        if selector == f"@/{ROUTER}/router":
            return {selector: json.dumps({"version": self.version, "sessions": self.sessions}).encode()}
        return {f"@/{ROUTER}/router/publisher/{key}": value for key, value in self.publishers.items()}

    def publishes(self, key: str, **roles: object) -> None:
        """The router says who has declared a publisher."""
        self.publishers[key] = json.dumps({"routers": [], "peers": [], "clients": [], **roles}).encode()

    def look(self, times: int = 2) -> None:
        """The link's thread asks, when it is time: twice, so that who is connected has been there at the look before."""
        for _ in range(times):
            self.now_ns += LOOK_PERIOD_NS
            self.watch.ask(self.now_ns, ROUTER, self.ask)

    def questions(self, times: int = 1) -> int:
        """The link's thread asks; return how often it asked who publishes."""
        self.asked.clear()
        self.look(times)
        return len([selector for selector in self.asked if "/publisher/" in selector])

    def poll(self, *, is_new_link: bool = False) -> list[object]:
        """The loop looks."""
        return self.watch.poll(ROUTER, is_new_link=is_new_link)

    def writers(self) -> list[tuple[str, str, str]]:
        """The loop looks, and hears of writers: zid, topic, means."""
        (event,) = [event for event in self.poll() if isinstance(event, ForeignTokens)]
        return [(writer.zid, writer.topic, writer.means.value) for writer in event.writers]


def test_nothing_seen_is_nothing_told():
    """A poll without news is empty; a new link tells that nobody is there."""
    scene = Scene()
    assert scene.poll() == [] and scene.poll() == []
    assert scene.poll(is_new_link=True) == [
        ForeignTokens(writers=(), at_ns=scene.now_ns),
        GatewayTokens(gateways=(), at_ns=scene.now_ns),
    ]


# ------------------------------------------------------------------------------------------------ data


@pytest.mark.parametrize("namespace", ["", "bot1"])
def test_samples_on_command_keys_are_told_with_their_sender(namespace):
    """All since the last look together; the router's own stamp names nobody."""
    scene = Scene(namespace)
    for zid in ("b", "b", ROUTER, ""):
        scene.watch.take(f"{scene.prefix}api/left_arm/joint_cmd", zid)
    assert scene.poll() == [
        ForeignData(topic=ARM, zid="b", at_ns=scene.now_ns, count=2),
        ForeignData(topic=ARM, zid="", at_ns=scene.now_ns, count=2),
    ]
    assert scene.poll() == []


@pytest.mark.parametrize("key", ["api/current_mode", "api/servo/cmd", "api/somebody/elses", "bot1/api/fsm/enable"])
def test_other_keys_are_no_commands_of_this_model(key):
    """The mode is the robot's own, a standard robot has no lift, another namespace is another robot."""
    scene = Scene()
    scene.watch.take(key, "b")
    assert scene.poll() == []


def test_every_command_of_the_model_counts():
    """Exactly the command topics of manual §4."""
    for model, variant in VARIANTS.items():
        scene = Scene(model=model)
        for topic in TOPICS:
            scene.watch.take(topic[1:], "b")
        assert sorted(event.topic for event in scene.poll()) == sorted(variant.command_topics)


# ------------------------------------------------------------------------------------------------ tokens


def test_publishers_of_ros_nodes_are_told_as_they_come_and_go():
    """MP tokens on command keys; subscribers, state topics, ours and news about others change nothing."""
    scene = Scene()
    scene.token("b", ARM)
    assert scene.writers() == [("b", ARM, "token")]
    scene.token("c", arm_state(Side.LEFT))
    scene.token("c", ARM, TokenKind.MS)
    scene.token(OWN, ARM)
    assert scene.poll() == []
    scene.token("b", ARM, is_there=False)
    assert scene.writers() == []


def test_a_ros_node_on_the_robot_is_named_as_such():
    """Its token carries the zenoh id of the bridge that announces the robot's state."""
    scene = Scene()
    scene.token("70", arm_state(Side.LEFT))
    scene.token("70", ARM)
    (event,) = scene.poll()
    assert event.writers == (Writer(topic=ARM, zid="70", means=Means.TOKEN, link=ROBOT),)


def test_a_router_full_of_writers_is_told_up_to_a_bound():
    """One is enough to stop."""
    scene = Scene()
    for number in range(WRITERS_KEPT + 10):
        scene.token(f"{number + 256:x}", ARM)
    assert len(scene.writers()) == WRITERS_KEPT


WILD = {
    "api/*/joint_cmd": {joint_command(side) for side in Side},
    "api/fsm/*": {FSM_ENABLE},
    "api/chassis/**": {CHASSIS_VELOCITY},
    "**": set(VARIANTS["standard"].command_topics),
    "api/left_arm/joint_c$*": {ARM},
    "*/joint_states": set(),
}
"""Keys with wildcards, on which anybody may put, and the commands that the robot takes from there."""


@pytest.mark.parametrize("key", WILD)
def test_a_sample_on_a_key_with_wildcards_is_told_as_all_the_commands_that_it_is(key):
    """The robot takes it by its own key, whatever the key it was put on looks like."""
    scene = Scene()
    scene.watch.take(key, "b")
    assert {(event.topic, event.zid) for event in scene.poll()} == {(topic, "b") for topic in WILD[key]}


# ------------------------------------------------------------------------------------------------ admin space


@pytest.mark.parametrize("key", WILD)
def test_a_publisher_of_a_key_with_wildcards_is_one_of_all_the_commands_that_it_matches(key):
    """Before it sends."""
    scene = Scene()
    scene.publishes(key, clients=["b"])
    scene.look()
    events = [event for event in scene.poll() if isinstance(event, ForeignTokens)]
    assert {(writer.topic, writer.zid) for event in events for writer in event.writers} == {
        (topic, "b") for topic in WILD[key]
    }


def test_declared_publishers_are_told_with_their_addresses():
    """Routers, peers and clients; ourselves and keys that are no commands left out."""
    scene = Scene()
    scene.publishes("api/left_arm/joint_cmd", clients=[OWN, "b"], peers=["c"], routers=["d"])
    scene.publishes("api/current_mode", clients=["70"])
    scene.publishes("api/current_$*", clients=["70"])
    scene.sessions = [{"peer": "b", "links": [{"src": "tcp/r", "dst": "tcp/b"}]}]
    scene.look()
    (event,) = scene.poll()
    assert [(writer.zid, writer.link) for writer in event.writers] == [("b", "tcp/b"), ("c", ""), ("d", "")]
    assert {writer.means for writer in event.writers} == {Means.PUBLISHER}
    scene.publishers.clear()
    scene.look(AGAIN_NS // LOOK_PERIOD_NS)
    assert scene.writers() == []


def test_the_router_is_asked_twice_a_second_and_not_in_between():
    """Who is connected and, with nobody named, who publishes; of command keys only, and of all of them."""
    scene = Scene()
    for _ in range(6):
        scene.look(1)
        scene.watch.ask(scene.now_ns, ROUTER, scene.ask)  # again in the same instant: nothing is asked
    assert (
        scene.asked == 6 * [f"@/{ROUTER}/router", f"@/{ROUTER}/router/publisher/api/*/*"] and LOOK_PERIOD_NS == S // 2
    )
    asked = zenoh.KeyExpr("bot1/api/*/*")
    assert publishers_of("bot1") == f"publisher/{asked}"
    matched = {topic for topic in TOPICS if asked.intersects(zenoh.KeyExpr(f"bot1{topic}"))}
    assert matched == set(COMMAND_TOPICS)


def test_who_publishes_is_not_asked_while_somebody_comes_or_goes():
    """Whoever connects declares first of all; a declaration beside the question can hang the router."""
    scene = Scene()
    assert scene.questions() == 1
    for peers in (["b"], ["b", "c"], ["c"], ["d"], []):
        scene.sessions = [{"peer": peer, "links": [{"dst": f"tcp/{peer}"}]} for peer in peers]
        assert scene.questions() == 0
    assert scene.questions() == 1


def test_who_was_named_is_not_asked_about_again_before_the_sessions_change_or_for_half_a_minute():
    """An answer is what can hang the router: one each time that somebody comes, and one in half a minute."""
    scene = Scene()
    scene.sessions = [{"peer": "b", "links": [{"dst": "tcp/b"}]}]
    scene.publishes("api/left_arm/joint_cmd", clients=["b"])
    assert scene.questions(2) == 1 and scene.writers() == [("b", ARM, "publisher")]
    assert scene.questions(AGAIN_NS // LOOK_PERIOD_NS - 1) == 0
    assert scene.questions() == 1
    scene.sessions.append({"peer": "c", "links": [{"dst": "tcp/c"}]})
    scene.publishes("api/left_arm/joint_cmd", clients=["b", "c"])
    assert scene.questions(2) == 1 and scene.writers() == [("b", ARM, "publisher"), ("c", ARM, "publisher")]
    assert scene.questions(10) == 0
    scene.publishers.clear()
    assert scene.questions(AGAIN_NS // LOOK_PERIOD_NS - 10) == 1 and scene.writers() == []
    assert scene.questions(2) == 2


def test_the_publishers_of_a_session_go_with_it_at_once():
    """Its end is in the list of sessions; the others are still there."""
    scene = Scene()
    scene.sessions = [{"peer": peer, "links": [{"dst": f"tcp/{peer}"}]} for peer in "bc"]
    scene.publishes("api/left_arm/joint_cmd", clients=["b", "c"])
    scene.look()
    scene.writers()
    scene.sessions = scene.sessions[1:]
    assert scene.questions() == 0 and scene.writers() == [("c", ARM, "publisher")]


def test_an_address_that_becomes_known_is_told():
    """The same writer again, now with a place."""
    scene = Scene()
    scene.token("b", ARM)
    assert scene.writers()
    scene.sessions = [{"peer": "b", "links": [{"dst": "tcp/b"}]}]
    scene.look()
    (event,) = scene.poll()
    assert event.writers[0].link == "tcp/b"
    scene.watch.take("api/left_arm/joint_cmd", "b")
    assert scene.poll()[0].link == "tcp/b"


@pytest.mark.parametrize(
    "answer",
    [b"", b"\xff", b"[]", b'{"clients": "b"}', b'{"clients": [1, null]}', b"[" * 100_000],
)
def test_an_answer_that_makes_no_sense_is_no_answer(answer):
    """Unknown, never failure."""
    scene = Scene()
    scene.publishers["api/left_arm/joint_cmd"] = answer
    scene.look()
    assert scene.poll() == []


@pytest.mark.parametrize(
    "sessions", ["x", [1], [{"peer": "b"}], [{"peer": "b", "links": "x"}], [{"peer": "b", "links": [1]}]]
)
def test_addresses_that_make_no_sense_are_none(sessions):
    """The writer is told without."""
    scene = Scene()
    scene.sessions = sessions
    scene.publishes("api/left_arm/joint_cmd", clients=["b"])
    scene.look()
    (event,) = scene.poll()
    assert event.writers[0].link == ""


def test_without_transport_publishers_are_forgotten_and_asked_for_at_once_after_it():
    """What the router said is not known any more; tokens go by themselves."""
    scene = Scene()
    scene.publishes("api/left_arm/joint_cmd", clients=["b"])
    scene.look()
    assert scene.writers()
    scene.watch.lose()
    assert scene.writers() == []
    scene.watch.ask(scene.now_ns, ROUTER, scene.ask)
    assert scene.writers()


# ------------------------------------------------------------------------------------------------ gateways


def test_gateways_are_told_as_they_come_arm_disarm_and_go():
    """Connected is not armed; an armed token alone is a gateway too; ours and nonsense are ignored."""
    scene = Scene()
    told = []
    for key, is_there in [
        ("b", True), ("b/armed", True), ("b/armed", False), ("b", False), ("c/armed", True), (OWN, True),
        (f"{OWN}/armed", True), ("no zid", True),
    ]:  # fmt: skip
        scene.watch.note_gateway(f"teleavatar_gateway/{key}", is_there)
        told += scene.poll()
    assert [event.gateways for event in told] == [
        (Gateway(zid="b", is_armed=False),),
        (Gateway(zid="b", is_armed=True),),
        (Gateway(zid="b", is_armed=False),),
        (),
        (Gateway(zid="c", is_armed=True),),
    ]


def test_of_too_many_gateways_the_armed_ones_are_told():
    """A bounded number, and never the ones that matter left out."""
    scene = Scene()
    for number in range(OTHERS_KEPT + 10):
        scene.watch.note_gateway(f"teleavatar_gateway/{number + 256:x}", True)
    scene.watch.note_gateway("teleavatar_gateway/fff/armed", True)
    (event,) = scene.poll()
    assert len(event.gateways) == OTHERS_KEPT and event.gateways[0] == Gateway(zid="fff", is_armed=True)


def test_all_who_are_there_are_told_again_after_a_new_link():
    """The core forgot nothing, but what it heard before may have been about another transport."""
    scene = Scene()
    scene.watch.note_gateway("teleavatar_gateway/b/armed", True)
    scene.token("c", ARM)
    first = scene.poll()
    assert len(first) == 2 and scene.poll() == []
    assert scene.poll(is_new_link=True) == first


def test_who_publishes_is_not_asked_while_a_hosts_bridge_would_be_named():
    """Its answer could hang the router; the robot's own bridge, beside its router or the same, declares none of these."""
    scene = Scene()
    for zid in (ROUTER, "6b"):
        scene.tokens.receive(presence_key(zid), True)
    scene.token("6b", arm_state(Side.LEFT))
    assert scene.questions(3) == 3
    scene.tokens.receive(presence_key("4057"), True)
    assert scene.questions(3) == 0
    scene.tokens.receive(presence_key("4057"), False)
    assert scene.questions(3) == 3


def test_a_bridge_that_declares_publishers_for_everything_commands_nothing():
    """A host's bridge does so as soon as it is connected (seen with 1.10.2): its tokens tell who is behind it."""
    scene = Scene()
    scene.publishes(CHASSIS_KEY, clients=["4057", "b"])
    scene.look()
    scene.tokens.receive(presence_key("4057"), True)
    (seen,) = scene.poll()
    assert [(writer.zid, writer.means) for writer in seen.writers] == [("b", Means.PUBLISHER)]
    assert scene.watch.neighbours.publishers == {("b", CHASSIS_VELOCITY)}
    scene.token("4057", CHASSIS_VELOCITY)
    (seen,) = scene.poll()
    assert {(writer.zid, writer.means) for writer in seen.writers} == {("b", Means.PUBLISHER), ("4057", Means.TOKEN)}
    scene.tokens.receive(presence_key("4057"), False)  # whoever it is, it is no bridge any more
    (seen,) = scene.poll()
    assert ("4057", Means.PUBLISHER) in {(writer.zid, writer.means) for writer in seen.writers}


# ---------------------------------------------------------------------------------------------------------- neighbours


def test_everybody_who_was_seen_can_be_asked_for():
    """Sessions with what they are and where, gateways, declared publishers, and how much each has sent."""
    scene = Scene()
    scene.sessions = [{"peer": "b", "whatami": "peer", "links": [{"dst": "tcp/b"}]}, {"peer": "c", "links": []}]
    scene.publishes(CHASSIS_KEY, clients=["b"])
    scene.look()
    scene.watch.note_gateway("teleavatar_gateway/9a/armed", True)
    for key, zid in ((CHASSIS_KEY, "b"), (CHASSIS_KEY, "b"), (CHASSIS_KEY, ROUTER)):
        scene.watch.take(key, zid)
    scene.poll()
    scene.now_ns += S
    scene.watch.take(CHASSIS_KEY, "b")
    scene.poll()
    seen = scene.watch.neighbours
    assert seen.sessions == {"b": Session("peer", "tcp/b"), "c": Session("", "")}
    assert seen.gateways == {GatewayToken("9a", True)}
    assert seen.publishers == {("b", CHASSIS_VELOCITY)}
    now_ns = scene.now_ns
    assert seen.sent == {("b", CHASSIS_VELOCITY): (3, now_ns), ("", CHASSIS_VELOCITY): (1, now_ns - S)}
    scene.watch.lose()
    assert scene.watch.neighbours.sessions == {} and scene.watch.neighbours.router_version == ""


def test_the_routers_version_is_kept_and_senders_are_bounded():
    """Who floods the robot under ever new names fills no memory."""
    scene = Scene()
    scene.version = "v1.10.2"
    scene.look()
    assert scene.watch.neighbours.router_version == "v1.10.2"
    for n in range(SENDERS_KEPT + 9):
        scene.watch.take(CHASSIS_KEY, f"{n:x}")
    scene.poll()
    assert len(scene.watch.neighbours.sent) == SENDERS_KEPT
