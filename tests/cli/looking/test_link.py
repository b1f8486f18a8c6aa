"""Tests of `ta2 link`: the page, what it finds wrong, JSON, exit statuses, and how to look without a gateway."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from gateway.api import protocol
from gateway.api.protocol import Announcement, Wire, WireBridge, WireNeighbour, WireTopic
from gateway.cli.looking.link import document, show_look
from gateway.cli.looking.link_findings import findings_of, names_of
from gateway.cli.looking.link_page import lines, qos_text
from gateway.robot.topics import JOINT_STATE, STATE_TOPICS, TOPICS, VARIANTS, Direction
from gateway.settings.settings import LinkSettings

MS = 1_000_000
S = 1_000_000_000
ROBOT, OWN = "b1d6e0000000000000000000000000aa", "0e110000000000000000000000000000"
ARM = STATE_TOPICS[0]
COMMANDS = VARIANTS["standard"].command_topics


def a_topic(name: str, **changes) -> WireTopic:
    """Return a topic on which all is well, changed as asked."""
    row = TOPICS[name]
    is_state = row.direction is Direction.STATE
    well = WireTopic(
        name=name,
        key=name[1:],
        is_state=is_state,
        type_name=row.type_name,
        nominal_hz=row.rate_hz,
        announced=(Announcement(zid=ROBOT, type_name=row.type_name, qos=":1::0,10"),),
        route="active",
        is_heard=is_state,
        rate_hz=row.rate_hz if is_state else 0.0,
        age_ns=4 * MS if is_state else None,
    )
    return replace(well, **changes)


def a_wire(**changes) -> Wire:
    """Return a wire on which all is well, changed as asked; `topics` may give changes by name."""
    by_name = changes.pop("topics", {})
    well = Wire(
        endpoint="tcp/10.0.0.7:9000",
        namespace="",
        model="standard",
        zid=OWN,
        is_up=True,
        up_ns=35 * S,
        router_zid=ROBOT,
        router_version="v1.10.2-cc839802 built with rustc",
        clock_ns=-3 * S,
        robots=("",),
        bridges=(WireBridge(zid=ROBOT, is_robot=True, namespaces=("",), version="v1.10.2", domain=29),),
        topics=tuple(a_topic(name, **by_name.get(name, {})) for name in (*STATE_TOPICS, *COMMANDS)),
        neighbours=(
            WireNeighbour(zid=OWN, kind="self", whatami="client", address="tcp/10.0.0.2:4711"),
            WireNeighbour(zid=ROBOT, kind="robot", whatami="router"),
        ),
    )
    return replace(well, **changes)


def beside(*others: WireNeighbour) -> Wire:
    """Return a healthy wire on which these are, too."""
    return a_wire(neighbours=(*a_wire().neighbours, *others))


def page(wire: Wire, *, is_gateway: bool = True) -> str:
    """Return the page as plain text."""
    return "\n".join(line.plain.rstrip() for line in lines(wire, "a test", is_gateway))


def codes(wire: Wire) -> list[str]:
    """Return the codes of what is found."""
    return [finding.code for finding in findings_of(wire)]


def only(wire: Wire):
    """Return the one finding."""
    (found,) = findings_of(wire)
    return found


# ---------------------------------------------------------------------------------------------------------------- page


def test_a_healthy_wire_is_one_page_with_everything_and_one_verdict():
    """Versions, namespace, each topic with type, QoS, route, both rates, copies and age; who is there; all is well."""
    text = page(a_wire())
    assert "tcp/10.0.0.7:9000, standard, no namespace" in text and f"router    {ROBOT}, zenoh v1.10.2\n" in text
    assert f"bridge    {ROBOT}, ros2dds v1.10.2, DDS domain 29" in text
    assert "the robot's stamps are 3.000 s behind this clock" in text
    (arm,) = [line.split() for line in text.splitlines() if line.startswith("/left_arm/joint_states ")]
    assert " ".join(arm[1:]) == "JointState reliable volatile 10 active 200 200 1 4.0 ms"
    (enable,) = [line.split() for line in text.splitlines() if line.startswith("/api/fsm/enable ")]
    assert " ".join(enable[1:]) == "Float32 reliable volatile 10 active"
    assert f"this gateway    {OWN} tcp/10.0.0.2:4711" in text and "router and ROS bridge" in text
    assert text.endswith(" ok the wire is as it should be")
    assert all(len(line) <= 120 for line in text.splitlines()) and findings_of(a_wire()) == ()


def test_a_look_is_not_called_a_gateway():
    """Who pastes the page shall not seem to run one."""
    assert "this look" in page(a_wire(), is_gateway=False) and "this gateway" not in page(a_wire(), is_gateway=False)


def test_without_a_transport_the_page_is_short_and_says_why():
    """Nothing about topics that cannot be known."""
    text = page(a_wire(is_up=False, trouble="10.0.0.7 is there, and nothing listens on its port 9000"))
    assert "link      DOWN" in text and "FROM THE ROBOT" not in text
    assert "!! NO_LINK: 10.0.0.7 is there, and nothing listens" in text
    assert "ta2 link --robot tcp/10.0.0.7:9000" in only(a_wire(is_up=False)).remedy


@pytest.mark.parametrize(
    ("clock_ns", "words"),
    [
        (None, "unknown"),
        (-20 * MS, "agree with this clock within 20 ms"),
        (2 * S, "2.000 s ahead of"),
        (-400_000 * S, "400000 s (5 d) behind"),
    ],
)
def test_the_clock_is_told_as_a_person_reads_it(clock_ns, words):
    """An offset changes nothing here, and explains wrong times elsewhere."""
    assert words in page(a_wire(clock_ns=clock_ns))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (":1::0,10", "reliable volatile 10"),
        (":1:1:", "reliable transient"),
        (":0:0:1,-1", "best-effort volatile all"),
        ("K::::hash", "volatile"),
        ("what", "what"),
    ],
)
def test_qos_in_words(text, words):
    """What the token leaves out is left out; what cannot be read is shown as it is."""
    assert qos_text(text) == words


def test_topics_that_are_not_well_are_seen_at_once():
    """Never heard, slow, copied, of another type; a topic that is not heard has no figures."""
    topics = {
        ARM: {"route": "dead", "rate_hz": 0.0, "age_ns": None},
        "/fsm_state": {"rate_hz": 9.0, "times": 3.0},
        "/api/current_mode": {"is_heard": False, "route": "announced", "announced": ()},
    }
    shown = {line.plain.split()[0]: line for line in lines(a_wire(topics=topics), "", True) if line.plain.strip()}
    assert "dead" in shown[ARM].plain and shown[ARM].plain.rstrip().endswith("never")
    assert {str(span.style) for span in shown[ARM].spans} >= {"bold red"}
    assert " 9.0      20      3" in shown["/fsm_state"].plain
    assert shown["/api/current_mode"].plain.split()[-4:] == ["-", "1", "-", "-"]
    assert " -  " in shown["/api/current_mode"].plain and str(shown["/api/current_mode"].style) == "dim"


# ------------------------------------------------------------------------------------------------------------ findings


def test_no_robot_at_all():
    """The router answers, nobody announces anything."""
    silent = {topic: {"announced": (), "age_ns": None, "route": "unannounced"} for topic in TOPICS}
    wire = a_wire(topics=silent, robots=(), bridges=())
    assert only(wire).code == "NO_ROBOT" and only(wire).remedy == "start the robot's bridge"
    assert "none announces a robot here" in page(wire)
    alone = replace(wire, bridges=(WireBridge(zid=ROBOT, is_robot=False, version="v1.9.0", domain=0),))
    assert "ROS_DISTRO=humble" in only(alone).remedy and "(it has 0)" in only(alone).remedy
    assert f"bridge    {ROBOT}, ros2dds v1.9.0, DDS domain 0: announces no robot here" in page(alone)


def test_of_a_node_that_left_the_cause_is_told_and_not_what_follows():
    """States that are gone are one finding; that nobody listens to commands then is none."""
    gone = {name: {"announced": (), "route": "lost"} for name in STATE_TOPICS}
    gone |= {name: {"announced": (), "route": "unannounced"} for name in COMMANDS}
    assert codes(a_wire(topics=gone)) == ["ROUTE_LOST"]


def test_a_robot_under_another_namespace_is_offered_and_several_are_listed():
    """By the line to write; a choice is a person's."""
    silent = {topic: {"announced": (), "age_ns": None, "route": "unannounced"} for topic in TOPICS}
    offered = only(a_wire(topics=silent, robots=("bot1",)))
    assert offered.code == "OTHER_NAMESPACE" and 'namespace = "bot1"' in offered.remedy
    listed = only(a_wire(topics=silent, robots=("bot1", "bot2"), namespace="bot3"))
    assert "there are 2" in listed.text and "bot1" in listed.text and "bot2" in listed.text and "bot3" in listed.text


@pytest.mark.parametrize(
    ("topics", "code", "level", "word"),
    [
        ({ARM: {"route": "dead"}}, "ROUTE_DEAD", "error", "does not read it"),
        ({ARM: {"route": "lost"}}, "ROUTE_LOST", "error", "nobody announces it any more"),
        ({ARM: {"route": "unannounced"}}, "NOT_ANNOUNCED", "warning", "announced by nobody"),
        ({ARM: {"route": "silent"}}, "ROUTE_SUSPECT", "warning", "nothing comes"),
        ({ARM: {"times": 3.0}}, "STATE_DUPLICATED", "warning", "3 times"),
        ({ARM: {"rate_hz": 120.0}}, "SLOW", "warning", "slower"),
        ({ARM: {"rate_hz": 400.0}}, "FAST", "warning", "faster"),
        ({ARM: {"refused": 7, "why_refused": "too short"}}, "SAMPLE_REFUSED", "error", "too short"),
        ({COMMANDS[0]: {"route": "unannounced"}}, "NOT_ANNOUNCED", "warning", "nobody on the robot listens"),
        ({name: {"route": "unannounced"} for name in COMMANDS}, "NOT_ANNOUNCED", "warning", "VR mode"),
        ({COMMANDS[0]: {"route": "inactive"}}, "ROUTE_DEAD", "error", "does not pass on"),
    ],
)
def test_each_trouble_of_a_topic_is_found_once_with_a_remedy(topics, code, level, word):
    """With its code, how bad it is, what is seen, and what to do."""
    found = only(a_wire(topics=topics))
    assert (found.code, found.level) == (code, level) and word in found.text and found.remedy
    assert document(a_wire(topics=topics), "", is_gateway=True)["ok"] is False


def test_topics_that_are_announced_otherwise_than_the_manual_says():
    """Another type, two bridges for one topic, other QoS; what cannot be read is nothing to judge."""
    other = Announcement(zid="4057", type_name="a/msg/B", qos=":0:1:")
    announced = (*a_topic(ARM).announced, other)
    found = {finding.code: finding for finding in findings_of(a_wire(topics={ARM: {"announced": announced}}))}
    assert set(found) == {"WRONG_TYPE", "TWO_ROBOTS", "QOS"}
    assert "a/msg/B" in found["WRONG_TYPE"].text and "4057" in found["TWO_ROBOTS"].text
    assert "best effort" in found["QOS"].text and "transient local" in found["QOS"].text
    odd = (Announcement(zid=ROBOT, type_name=JOINT_STATE, qos="?"),)
    assert findings_of(a_wire(topics={ARM: {"announced": odd}})) == ()


@pytest.mark.parametrize(
    ("who", "code", "level", "said"),
    [
        (WireNeighbour(zid="6a", kind="gateway"), None, "", "commands nothing; could when it enables"),
        (WireNeighbour(zid="6a", kind="gateway", is_armed=True), "OTHER_GATEWAY", "warning", "COMMANDS the robot"),
        (
            WireNeighbour(zid="6a", kind="gateway", is_armed=True, sent={COMMANDS[0]: 9}, sent_age_ns=0),
            "OTHER_GATEWAY", "warning", "COMMANDS the robot; SENT 9",
        ),
        (WireNeighbour(zid="9a", kind="guard"), None, "", "stops the robot if the gateway dies"),
        (
            WireNeighbour(zid="c1", kind="session", whatami="client", address="tcp/10.0.0.9:1"),
            "CONNECTED", "info", "could command",
        ),
        (
            WireNeighbour(zid="6a", kind="gateway", sent={COMMANDS[0]: 9}, sent_age_ns=S),
            None, "", "SENT 9 commands",
        ),
        (
            WireNeighbour(zid="", kind="session", sent={COMMANDS[0]: 4}, sent_age_ns=3000 * S),
            "FOREIGN_WRITER", "info", "the last 50 min ago",
        ),
        (
            WireNeighbour(zid="", kind="session", sent={COMMANDS[0]: 4, COMMANDS[1]: 1}, sent_age_ns=S),
            "FOREIGN_WRITER", "error", "SENT 5 commands",
        ),
        (
            WireNeighbour(zid=ROBOT, kind="robot", publishes=(COMMANDS[0],)),
            "FOREIGN_WRITER", "warning", "announces commands on /api/left_arm/joint_cmd",
        ),
        (
            WireNeighbour(zid="4057", kind="bridge", address="tcp/10.0.0.8:1", listens=(ARM, "/fsm_state")),
            "CONNECTED", "info", "reads 2 topics; could command: any ROS node behind it",
        ),
    ],
)  # fmt: skip
def test_everybody_else_is_told_with_what_he_does_and_could_do(who, code, level, said):
    """By whole id and address; a finding where it matters."""
    wire = beside(who)
    found = [finding for finding in findings_of(wire) if code is not None]
    assert [(f.code, f.level) for f in found] == ([] if code is None else [(code, level)])
    (line,) = [
        text
        for text in page(wire).splitlines()
        if said in text and (who.zid or "(does not say)") in text and text[0] != " "
    ]
    assert who.address.partition("?")[0] in line


def test_the_versions_of_other_bridges_are_told():
    """A host bridge of another release is worth knowing (wire.md 3.1)."""
    bridges = (*a_wire().bridges, WireBridge(zid="4057", is_robot=False, version="v1.5.1", domain=4))
    who = WireNeighbour(zid="4057", kind="bridge", address="tcp/10.0.0.8:1")
    text = page(replace(beside(who), bridges=bridges))
    assert "ROS bridge      4057" in text and "ros2dds v1.5.1, DDS domain 4" in text


def test_two_gateways_at_one_address_may_be_one():
    """A gateway and its guard are two sessions to anybody else."""
    two = [WireNeighbour(zid=zid, kind="gateway", address=f"tcp/10.0.0.9:{n}") for n, zid in enumerate(("6a", "6b"))]
    assert codes(beside(*two)) == ["GUARD"] and codes(beside(two[0])) == []


def test_a_closed_admin_space_and_lost_frames_are_worth_a_line():
    """Unknown is said to be unknown."""
    closed = a_wire(router_version="", neighbours=(), undelivered=12)
    assert codes(closed) == ["UNKNOWN", "UNDELIVERED"] and "it does not say its version" in page(closed)
    assert document(closed, "", is_gateway=True)["ok"] is True  # neither keeps the robot from anything


def test_the_worst_is_told_first_and_many_topics_are_a_number():
    """A person reads the first line."""
    wire = a_wire(topics={ARM: {"route": "silent"}, COMMANDS[0]: {"route": "inactive"}}, undelivered=1)
    assert [finding.level for finding in findings_of(wire)] == ["error", "warning", "info"]
    assert names_of(STATE_TOPICS).endswith(f"and {len(STATE_TOPICS) - 3} more")
    assert names_of(("/a", "/b")) == "/a, /b"


# ------------------------------------------------------------------------------------------------------------- command


def test_the_gateway_is_asked_and_the_page_begins_with_what_runs_here(shell):
    """Under its own name; releases, interpreter and system are what whoever helps asks for first."""
    wire = a_wire()
    shell.world.plane._outbox.routes = lambda: protocol.Routes(routes={}, bridge_version="", undelivered=0, wire=wire)
    ended = shell.run("link")
    assert ended.status == 0 and shell.names == ["ta2 link"]
    assert ended.out.startswith("ta2 link 0.") and "Python 3." in ended.out.splitlines()[0]
    assert "the gateway, release" in ended.out and "the wire is as it should be" in ended.out
    told = shell.run("link", "--json").json
    assert told["ok"] is True and told["is_gateway"] is True and told["findings"] == []
    assert told["wire"]["topics"][0]["name"] == ARM and told["here"]["ta2"]


def test_without_a_gateway_the_hint_says_how_to_look_without_one(tmp_path, capsys):
    """Who is in trouble may have none that starts."""
    from gateway.cli.main import main

    assert main(("link", "--socket", str(tmp_path / "none.sock"))) == 3
    assert "to look without one: `ta2 link --robot ADDRESS`" in capsys.readouterr().err


def test_a_gateway_of_an_earlier_release_is_told_as_such(shell):
    """It does not know what is asked."""
    ended = shell.run("link")
    assert ended.status == 5 and "does not tell the state of its wire" in ended.err


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({}, 0),
        ({"is_up": False, "trouble": "no"}, 3),
        ({"robots": ("a", "b"), "topics": {n: {"announced": (), "age_ns": None} for n in TOPICS}}, 1),
        ({"robots": ("a",), "topics": {n: {"announced": (), "age_ns": None} for n in TOPICS}}, 0),
        ({"robots": ("", "a")}, 0),
    ],
)
def test_the_exit_status_of_a_look(changes, status, capsys):
    """Nobody at the address, several robots to choose from, else done, whatever is found."""
    assert show_look(a_wire(**changes), as_json=False) == status
    assert "a look of" in capsys.readouterr().out


def test_a_look_has_the_settings_of_the_command_line(shell, monkeypatch, tmp_path):
    """Address, namespace and model; a file's namespace counts as asked for, none as not."""
    asked = []

    def look(settings, *, is_named):
        asked.append((settings, is_named))
        return a_wire()

    monkeypatch.setattr("gateway.link.surveyor.look", look)
    assert shell.run("link", "--robot", "10.0.0.7").status == 0
    assert shell.run("link", "--robot", "10.0.0.7", "--namespace", "bot1", "--model", "lift").status == 0
    file = tmp_path / "settings.toml"
    file.write_text('[robot]\nendpoint = "tcp/10.0.0.8:9000"\nnamespace = "bot2"\n')
    assert shell.run("link", "--config", str(file), "--json").json["is_gateway"] is False
    assert asked == [
        (LinkSettings(endpoint="tcp/10.0.0.7:9000"), False),
        (LinkSettings(endpoint="tcp/10.0.0.7:9000", namespace="bot1", model="lift"), True),
        (LinkSettings(endpoint="tcp/10.0.0.8:9000", namespace="bot2"), True),
    ]
    assert shell.run("link", "--robot", "10.0.0.7", "--namespace", "a*b").status == 2
    assert shell.run("link", "--namespace", "bot1").status == 2
