"""Rules of `gateway.link.discovery.discovery`: what tokens and admin space make of a topic. Answers are given here."""

from __future__ import annotations

import json
import logging
import threading

import pytest

from cdr_types.keys import Qos, Token, TokenKind, format_token, presence_key, topic_to_key
from gateway.core.messages.events import RobotsAnnounced
from gateway.errors import Code
from gateway.link.discovery.discovery import BridgeFacts, Discovery, Sight, TokenTable
from gateway.robot.topics import (
    CHASSIS_VELOCITY,
    FSM_ENABLE,
    FSM_STATE,
    JOINT_STATE,
    STATE_TOPICS,
    TOPICS,
    VARIANTS,
    Direction,
    arm_state,
    ee_pose,
    joint_command,
)
from gateway.settings.settings import LinkSettings
from gateway.values import Side

S = 1_000_000_000
BRIDGE = "b1d6e"
OWN = "0e11"
HOST = "4057"
ARM = arm_state(Side.LEFT)
COMMAND = joint_command(Side.LEFT)


def token(topic: str, kind: TokenKind, zid: str = BRIDGE) -> str:
    """Return a token as the bridge writes it."""
    return format_token(Token(zid=zid, kind=kind, topic=topic, type_name=JOINT_STATE, qos=Qos()))


class Robot:
    """A robot's bridge as discovery sees it, and the discovery that looks at it."""

    def __init__(self, namespace: str = "", model: str = "standard") -> None:
        self.namespace = namespace
        self.answers: dict[str, object] = {}
        self.asked: list[str] = []
        self.now_ns = 10 * S
        self.silent: set[str] = set()
        self.friends: set[str] = set()
        self.discovery = Discovery(LinkSettings(namespace=namespace, model=model), OWN, self.ask, self.friends)
        for topic, row in TOPICS.items():
            is_state = row.direction is Direction.STATE
            self.announce(topic, TokenKind.MP if is_state else TokenKind.MS)
            self.route(topic, **({"dds_reader": "01.02"} if is_state else {"is_active": True}))
        self.answers[f"@/{BRIDGE}/ros2/version"] = "1.10.2"

    def key(self, topic: str) -> str:
        return topic_to_key(topic, self.namespace)

    def announce(self, topic: str, kind: TokenKind, zid: str = BRIDGE, *, is_alive: bool = True) -> None:
        self.discovery.tokens.receive(token(f"/{self.key(topic)}", kind, zid), is_alive)

    def route(self, topic: str, zid: str = BRIDGE, **fields) -> None:
        direction = "pub" if TOPICS[topic].direction is Direction.STATE else "sub"
        self.answers[f"@/{zid}/ros2/route/topic/{direction}/{self.key(topic)}"] = fields

    def ask(self, selector: str) -> dict[str, bytes]:
        self.asked.append(selector)
        start, _, rest = selector.partition("@/*/")
        assert start == ""
        found = {}
        for key, fields in self.answers.items():
            tail = key.split("/", 2)[2]
            if tail == rest or (rest.endswith("/**") and tail.startswith(rest[:-2])):
                found[key] = json.dumps(fields).encode()
        return found

    def step(self, seconds: float = 1.0):
        self.now_ns += int(seconds * S)
        newest_ns = {topic: (1 if topic in self.silent else self.now_ns) for topic in STATE_TOPICS}
        return self.discovery.step(Sight(now_ns=self.now_ns, up_since_ns=0, newest_ns=newest_ns))


@pytest.fixture
def seen() -> Robot:
    """A robot on which everything works."""
    return Robot()


# ------------------------------------------------------------------------------------------------------------- tokens


def test_the_table_holds_what_is_there():
    """Tokens come and go; each change raises the revision."""
    table = TokenTable()
    first, second = token(ARM, TokenKind.MP), presence_key(BRIDGE)
    table.receive(first, True)
    table.receive(second, True)
    table.receive(first, True)
    assert {t.kind for t in table.all()} == {TokenKind.MP, TokenKind.PRESENCE}
    table.receive(first, False)
    assert [t.kind for t in table.all()] == [TokenKind.PRESENCE]
    assert table.revision == 4
    table.receive(first, False)
    assert len(table.all()) == 1


@pytest.mark.parametrize(
    "keyexpr",
    [
        *("", "@/x/@ros2_lv", "@/1a/@ros2_lv/XX/a/b", "left_arm/joint_states"),
        "@/1a/@ros2_lv/MP/\x1b[2J§fsm_state/std_msgs§msg§Int32/:1::",
    ],
)
def test_a_token_outside_the_grammar_is_ignored(keyexpr):
    """Somebody's own tokens are none of our business."""
    table = TokenTable()
    table.receive(keyexpr, True)
    assert table.all() == ()
    assert table.revision == 0


def test_the_table_is_safe_between_threads():
    """Tokens come from zenoh's threads while the link's own thread reads them."""
    table = TokenTable()
    tokens = [token(topic, TokenKind.MP) for topic in STATE_TOPICS]

    def write() -> None:
        for _ in range(300):
            for keyexpr in tokens:
                table.receive(keyexpr, True)
            for keyexpr in tokens:
                table.receive(keyexpr, False)

    threads = [threading.Thread(target=write) for _ in range(2)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        assert len(table.all()) <= len(tokens)
    for thread in threads:
        thread.join()
    assert table.all() == ()
    assert table.revision == 2 * 300 * 2 * len(tokens)


# ---------------------------------------------------------------------------------------------------------- readiness


def test_before_the_first_look_readiness_is_unknown(seen):
    """No word is said about what was not seen, for each topic of the model and no other."""
    words = seen.discovery.readiness()
    assert set(words) == {*STATE_TOPICS, *VARIANTS["standard"].command_topics}
    assert all(text.startswith("unknown") for text in words.values())


@pytest.mark.parametrize("namespace", ["", "bot1"])
@pytest.mark.parametrize("model", sorted(VARIANTS))
def test_everything_is_ready_on_a_working_robot(namespace, model):
    """Announced, active, delivering (wire.md 2.5)."""
    seen = Robot(namespace, model)
    seen.step()
    words = seen.discovery.readiness()
    assert set(words.values()) == {"ready"}
    assert set(words) == {*STATE_TOPICS, *VARIANTS[model].command_topics}


def test_a_command_that_nobody_on_the_robot_listens_to_is_not_ready(seen):
    """No MS token of the robot's bridge; one of somebody else's bridge or our own does not count."""
    seen.announce(COMMAND, TokenKind.MS, is_alive=False)
    seen.announce(COMMAND, TokenKind.MS, HOST)
    seen.announce(COMMAND, TokenKind.MS, OWN)
    seen.step()
    assert "not announced" in seen.discovery.readiness()[COMMAND]


def test_a_command_on_an_inactive_route_is_not_ready(seen):
    """`is_active:false` black-holes commands for ever (wire.md 3.1 a)."""
    seen.route(COMMAND, is_active=False)
    seen.step()
    assert "inactive" in seen.discovery.readiness()[COMMAND]


def test_a_closed_admin_space_is_no_failure(seen):
    """Absence means unknown: the tokens decide, and the text says so (wire.md 5.2)."""
    seen.answers.clear()
    seen.step()
    assert seen.discovery.readiness()[COMMAND] == "ready, as far as the tokens tell (admin space not readable)"
    assert seen.discovery.readiness()[ARM] == "ready"
    assert seen.discovery.version == ""


def test_states_say_whether_they_are_announced_and_delivered(seen):
    """Announced but silent, and not announced at all."""
    pose = ee_pose(Side.LEFT)
    seen.announce(pose, TokenKind.MP, is_alive=False)
    seen.silent = {ARM, pose}
    seen.step()
    words = seen.discovery.readiness()
    assert words[ARM] == "announced, silent"
    assert words[pose].startswith("not announced")


def test_readiness_follows_the_tokens_soon_and_else_every_five_seconds(seen):
    """The admin space is not asked at every step."""
    for _ in range(40):
        seen.step(0.25)
    assert 2 <= sum("/sub/" in selector for selector in seen.asked) <= 3
    seen.asked.clear()
    seen.announce(COMMAND, TokenKind.MS, is_alive=False)
    seen.step(0.5)
    assert "not announced" in seen.discovery.readiness()[COMMAND]


def test_without_transport_nothing_is_known(seen):
    """`lose` takes readiness back at once; the next look fills it again."""
    seen.step()
    seen.discovery.lose()
    assert all("no transport" in text for text in seen.discovery.readiness().values())
    seen.step(0.5)
    assert set(seen.discovery.readiness().values()) == {"ready"}


def test_the_version_is_logged_once_and_read_again_after_a_loss(seen, caplog):
    """Log the robot's version at connect (wire.md 5.3); a restarted robot may have another one."""
    caplog.set_level(logging.INFO)
    for _ in range(3):
        seen.step(6)
    assert seen.discovery.version == "1.10.2"
    assert [r.message for r in caplog.records] == [f"the robot's bridge {BRIDGE} is version 1.10.2"]
    assert seen.asked.count("@/*/ros2/version") == 1
    seen.answers[f"@/{BRIDGE}/ros2/version"] = "1.11.0"
    seen.answers[f"@/{HOST}/ros2/version"] = "0.0.1"
    seen.discovery.lose()
    seen.step()
    assert seen.discovery.version == "1.11.0"


def test_what_a_bridge_or_a_router_says_obeys_no_terminal_and_forges_no_line(seen, caplog):
    """Anybody on the robot's network may answer in their place."""
    caplog.set_level(logging.INFO)
    evil = "v1\x1b[31m\n2026 WARNING forged"
    seen.silent = {ARM}
    seen.route(ARM, dds_reader="", remote_routes=[f"{evil}:{seen.key(ARM)}"])
    seen.answers[f"@/{BRIDGE}/router"] = {"sessions": [{"peer": evil, "links": [{"dst": evil}]}]}
    ask = seen.discovery._ask
    plain = {f"@/{BRIDGE}/ros2/version": evil.encode()}  # JSON would have escaped it
    seen.discovery._ask = lambda selector: plain if selector == "@/*/ros2/version" else ask(selector)
    (observation,) = seen.step().observations
    assert "forged" in observation.message and observation.message.isprintable()
    assert "forged" in seen.discovery.version and seen.discovery.version.isprintable()
    assert all(record.getMessage().isprintable() for record in caplog.records)


def test_what_bridges_say_of_themselves_is_read_when_one_comes(seen):
    """Version and DDS domain of each, with two questions for all; a bridge that says nothing is asked about once."""
    seen.answers[f"@/{BRIDGE}/ros2/config"] = {"domain": 29, "namespace": "/"}
    for _ in range(3):
        seen.step(6)
    assert seen.discovery.bridges == {BRIDGE: BridgeFacts(version="1.10.2", domain=29)}
    seen.discovery.tokens.receive(presence_key(HOST), True)
    for _ in range(3):
        seen.step(6)
    assert seen.discovery.bridges[HOST] == BridgeFacts()
    assert seen.asked.count("@/*/ros2/version") == seen.asked.count("@/*/ros2/config") == 2
    seen.discovery.lose()
    assert seen.discovery.bridges == {}


def test_whether_a_command_is_written_is_known_as_far_as_the_admin_space_tells(seen):
    """True, false, or unknown; nothing is known any more after a loss."""
    seen.route(FSM_ENABLE, is_active=False)
    seen.answers.pop(f"@/{BRIDGE}/ros2/route/topic/sub/{seen.key(COMMAND)}")
    seen.step()
    written = seen.discovery.written
    assert (written[FSM_ENABLE], written[COMMAND], written[CHASSIS_VELOCITY]) == (False, None, True)
    seen.discovery.lose()
    assert seen.discovery.written == {}


# --------------------------------------------------------------------------------------------------------- elsewhere


class Elsewhere(Robot):
    """A link that is up since 100 s and hears nothing under its namespace."""

    def __init__(self, namespace: str = "") -> None:
        super().__init__(namespace)
        for topic in STATE_TOPICS:
            self.announce(topic, TokenKind.MP, is_alive=False)
        self.newest_ns: int | None = None
        self.now_ns = 100 * S

    def robot(self, namespace: str, *, is_alive: bool = True) -> None:
        """A robot under another namespace comes or goes."""
        for topic in STATE_TOPICS:
            self.discovery.tokens.receive(token(f"/{topic_to_key(topic, namespace)}", TokenKind.MP), is_alive)

    def told(self, seconds: float = 1.0) -> list[tuple[str, ...]]:
        """Let the link look; return what it says about robots elsewhere."""
        self.now_ns += int(seconds * S)
        sight = Sight(now_ns=self.now_ns, up_since_ns=100 * S, newest_ns=dict.fromkeys(STATE_TOPICS, self.newest_ns))
        found = self.discovery.step(sight).observations
        return [(seen.elsewhere or seen.twins) for seen in found if isinstance(seen, RobotsAnnounced)]


def test_a_robot_under_another_namespace_is_told_once_when_none_is_under_ours():
    """Not before a fresh link had time to find its own, again when it changes, and when it is over."""
    scene = Elsewhere()
    scene.robot("bot1")
    assert scene.told(1.9) == []
    assert scene.told(0.2) == [("bot1",)]
    assert scene.told() == []
    scene.robot("bot2")
    assert scene.told() == [("bot1", "bot2")]
    scene.robot("bot1", is_alive=False)
    scene.robot("bot2", is_alive=False)
    assert scene.told() == [()]


def test_what_is_under_our_own_namespace_or_was_heard_is_our_robot():
    """Others beside it are nobody's business; a sample proves more than a token that is late."""
    scene = Elsewhere("bot1")
    scene.robot("bot1")
    scene.robot("bot2")
    assert scene.told(3.0) == []
    scene.robot("bot1", is_alive=False)
    assert scene.told() == [("bot2",)]
    scene.newest_ns = 101 * S
    assert scene.told() == [()]
    scene.newest_ns = 99 * S  # over an earlier transport
    assert scene.told() == [("bot2",)]


def test_several_bridges_that_announce_a_robot_under_our_namespace_are_told_at_once():
    """Although all is heard, and until one of them is gone."""
    scene = Elsewhere()
    scene.robot("")
    scene.newest_ns = 101 * S
    assert scene.told() == []
    for topic in STATE_TOPICS:
        scene.announce(topic, TokenKind.MP, HOST)
    assert scene.told() == [(HOST, BRIDGE)]
    assert scene.told() == []
    scene.announce(FSM_STATE, TokenKind.MP, HOST, is_alive=False)
    assert scene.told() == [()]


def test_after_a_loss_robots_elsewhere_are_told_anew():
    """The engine has forgotten them with the link."""
    scene = Elsewhere()
    scene.robot("bot1")
    assert scene.told(3.0) == [("bot1",)]
    scene.discovery.lose()
    assert scene.told() == [("bot1",)]


# ------------------------------------------------------------------------------------------------------------- routes


def test_a_dead_route_is_found_and_revived(seen):
    """Announced, silent, no DDS reader: observed, and named for re-declaration (BEHAVIOUR, the bridge misbehaves)."""
    seen.silent = {ARM}
    seen.route(ARM, dds_reader="", remote_routes=[])
    finding = seen.step()
    assert [(o.topic, o.code) for o in finding.observations] == [(ARM, Code.ROUTE_DEAD)]
    assert finding.revive == (ARM,)
    assert seen.discovery.readiness()[ARM].startswith("route dead")
    seen.silent = set()
    finding = seen.step()
    assert [(o.topic, o.code) for o in finding.observations] == [(ARM, None)]
    assert finding.revive == ()


def test_who_may_keep_a_route_dead_is_named_with_the_address(seen):
    """Bridges from `remote_routes`, and whoever is connected: who subscribes is not asked, the answer can hang a router."""
    key = seen.key(ARM)
    seen.silent = {ARM}
    seen.route(ARM, dds_reader="", remote_routes=[f"{HOST}:{key}", f"{OWN}:{key}"])
    link = {"src": "tcp/10.0.0.1:9000", "dst": "tcp/10.0.0.7:41000"}
    sessions = [{"peer": "c1", "links": [link]}, {"peer": OWN, "links": [link]}, {"peer": BRIDGE, "links": []}]
    seen.answers[f"@/{BRIDGE}/router"] = {"sessions": sessions}
    (observation,) = seen.step().observations
    assert f"perhaps one of these: {HOST}, c1 at tcp/10.0.0.7:41000" in observation.message
    assert not any("/router/" in selector for selector in seen.asked)


def test_sessions_of_ours_are_not_named_as_those_who_keep_a_route_dead(seen):
    """The guard subscribes as well, and declares again together with us."""
    key = seen.key(ARM)
    seen.silent = {ARM}
    seen.friends.add("9a")
    seen.route(ARM, dds_reader="", remote_routes=[f"9a:{key}"])
    seen.answers[f"@/{BRIDGE}/router"] = {"sessions": [{"peer": "9a", "links": []}, {"peer": OWN, "links": []}]}
    (observation,) = seen.step().observations
    assert "9a" not in observation.message and "restart the robot's bridge" in observation.message


def test_the_route_of_another_bridge_is_no_evidence(seen):
    """A host bridge may have a route of the same name; only who announces the topic is asked about."""
    seen.silent = {ARM}
    seen.answers.pop(f"@/{BRIDGE}/ros2/route/topic/pub/{seen.key(ARM)}")
    seen.route(ARM, HOST, dds_reader="")
    finding = seen.step()
    assert (finding.observations, finding.revive) == ((), ())


def test_all_topics_lost_at_once_are_all_observed_without_a_question(seen):
    """The node is away: the tokens say it, the admin space need not be asked."""
    seen.silent = set(STATE_TOPICS)
    for topic in STATE_TOPICS:
        seen.announce(topic, TokenKind.MP, is_alive=False)
    assert not [o for o in seen.step().observations if o.topic != FSM_ENABLE], "they may be gone with a transport"
    finding = seen.step()
    lost = [o for o in finding.observations if o.topic != FSM_ENABLE]
    assert {o.topic for o in lost} == set(STATE_TOPICS)
    assert {o.code for o in lost} == {Code.ROUTE_LOST}
    assert finding.revive == ()
    assert not any("/pub/" in selector for selector in seen.asked)


def test_what_stands_between_the_heartbeat_and_the_robot_is_observed_once(seen):
    """For the engine to say when 1.0 does nothing (BEHAVIOUR, the bridge misbehaves); a ready route is no news."""
    assert seen.step().observations == ()
    seen.announce(FSM_ENABLE, TokenKind.MS, is_alive=False)
    (observation,) = seen.step().observations
    assert (observation.topic, observation.code) == (FSM_ENABLE, None)
    assert observation.message == "not announced: nobody on the robot listens to it"
    (lost,) = seen.step().observations
    assert (lost.topic, lost.code) == (FSM_ENABLE, Code.ROUTE_LOST)
    assert seen.step().observations == ()
    seen.announce(FSM_ENABLE, TokenKind.MS)
    assert [o.message for o in seen.step().observations] == [f"the robot listens again to {FSM_ENABLE}", "ready"]


def test_what_the_robot_listened_to_before_the_transport_went_is_not_missed_after_it(seen):
    """A bridge that is restarted announces everything anew; until then nothing is lost."""
    seen.step()
    seen.discovery.lose()
    seen.announce(FSM_ENABLE, TokenKind.MS, is_alive=False)
    assert all(o.code is not Code.ROUTE_LOST for _ in range(4) for o in seen.step().observations)


def test_many_silent_topics_cost_one_question(seen):
    """A stalled bridge is asked once, not once per topic: each question may take a second."""
    seen.silent = set(STATE_TOPICS)
    seen.step()
    assert sum("/pub/" in selector for selector in seen.asked) == 1


@pytest.mark.parametrize(
    "answer", [None, 1, [], "text", {}, {"dds_reader": None}, {"dds_reader": 5, "remote_routes": 7}]
)
def test_an_answer_of_another_shape_is_no_evidence(seen, answer):
    """What cannot be read is unknown."""
    seen.silent = {ARM}
    seen.answers[f"@/{BRIDGE}/ros2/route/topic/pub/{seen.key(ARM)}"] = answer
    seen.answers[f"@/{BRIDGE}/router"] = {"sessions": "none"}
    finding = seen.step()
    assert (finding.observations, finding.revive) == ((), ())


def test_answers_that_are_not_json_are_no_evidence(seen):
    """Some admin answers are not even text (wire.md 5.2: metrics are gzip)."""
    seen.silent = {ARM}
    ask = seen.ask
    seen.discovery._ask = lambda selector: {key: b"\x1f\x8b\xff" for key in ask(selector)}
    finding = seen.step()
    assert (finding.observations, finding.revive) == ((), ())
    assert "tokens tell" in seen.discovery.readiness()[COMMAND]


def test_findings_are_logged(seen, caplog):
    """Loss as a warning with its code, recovery as information."""
    caplog.set_level(logging.INFO)
    seen.step()
    caplog.clear()
    seen.silent = {ARM}
    seen.announce(ARM, TokenKind.MP, is_alive=False)
    seen.step()
    seen.step()
    seen.silent = set()
    seen.step()
    assert [(r.levelname, r.message.split(":")[0]) for r in caplog.records] == [
        ("WARNING", "ROUTE_LOST"),
        ("INFO", ARM),
    ]
