"""Rules of `gateway.link.robot_link`: events in order, frames only over a living transport, and a link that comes back."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
import zenoh

from cdr_types import encode
from gateway.core.messages.events import LinkDown, LinkUp, RouteObserved, SampleArrived, SampleRefused
from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.streams.gate import Cleared
from gateway.errors import Code
from gateway.link import RobotLink
from gateway.link.codec import FRAME_BYTES, BadFrame
from gateway.link.discovery.discovery import Discovery
from gateway.link.discovery.revival import GRID_NS
from gateway.link.hearing import DECIDING, STAMPED
from gateway.link.robot_session import RobotSession
from gateway.process.threads import take_lost
from gateway.robot.topics import (
    COMMAND_TOPICS,
    FSM_ENABLE,
    FSM_STATE,
    LIFT_COMMAND,
    STATE_TOPICS,
    TOPICS,
    VARIANTS,
    arm_state,
    ee_pose,
    gripper_state,
    joint_command,
)
from gateway.settings.settings import LinkSettings, SettingsRefused
from gateway.values import Side
from tests.link.robot_process import ROOT, RobotProcess, wait_until
from tests.link.stand_in import Keepsake, state_message

MS = 1_000_000
S = 1_000_000_000
ARM = arm_state(Side.LEFT)
JOINTS = joint_command(Side.LEFT)


def cleared(topic: str = FSM_ENABLE, values: tuple[float, ...] = (1.0,)) -> Cleared:
    """Return a frame as the gate would hand it over."""
    return Cleared(Frame(topic=topic, values=values, kind=FrameKind.HOLD, epoch=0, due_ns=0))


def names(events) -> list[str]:
    """Return the event types in order."""
    return [type(event).__name__ for event in events]


# ---------------------------------------------------------------------------------------------------- without a robot


@pytest.fixture
def link() -> RobotLink:
    """A link that was never opened; what callbacks would store is put in by hand."""
    return RobotLink(LinkSettings())


def test_a_link_that_was_never_opened_is_down_and_silent(link):
    """Nothing is known, nothing is sent, closing is harmless."""
    assert (link.is_up, link.router_zid, link.zid, link.robot_version) == (False, "", "", "")
    assert link.poll() == []
    assert set(link.readiness()) == {*STATE_TOPICS, *VARIANTS["standard"].command_topics}
    assert link.close(0)
    assert link.close(0)


def test_an_endpoint_that_zenoh_cannot_read_is_refused_at_once(monkeypatch):
    """A daemon with a wrong endpoint must not try for ever."""
    monkeypatch.setattr("gateway.link.robot_link.session_config", lambda settings, is_reader: "{mode: 5}")
    with pytest.raises(SettingsRefused, match="no endpoint"):
        RobotLink(LinkSettings())


def test_frames_without_transport_are_counted_and_not_sent(link):
    """Zenoh would accept and lose them (wire.md 2.3); the loop hears no exception."""
    for _ in range(3):
        link.publish(cleared())
    assert link.undelivered == 3


@pytest.mark.parametrize(
    "frame",
    [
        cleared(LIFT_COMMAND, (0.0, 1.0)),  # not on the standard model
        cleared(ARM, (0.0,) * 7),
        cleared(JOINTS, (0.0,) * 6),
        cleared(JOINTS, (float("nan"),) * 7),
    ],
)
def test_a_frame_that_no_gate_clears_is_a_bug_and_said_so(link, frame):
    """Keys outside the profile, wrong lengths and NaN raise, connected or not: the loop stops the robot then."""
    with pytest.raises(BadFrame):
        link.publish(frame)


def test_opening_and_losing_the_transport_are_told_in_order(link):
    """LinkUp with the router's id, LinkDown; what repeats itself is told once."""
    link._transport.note("aa", True, 1)
    assert link.is_up and link.router_zid == "aa"
    link._transport.note("aa", True, 2)
    link._transport.note("aa", False, 3)
    assert not link.is_up
    link._transport.note("aa", False, 4)
    assert link.poll() == [LinkUp(router_zid="aa", at_ns=1), LinkDown(at_ns=3)]
    assert link.poll() == []


def test_no_outage_is_too_short_to_be_seen(link):
    """Down and up between two polls are both told; so is another router that took over without a word."""
    link._transport.note("aa", True, 1)
    link.poll()
    link._transport.note("aa", False, 2)
    link._transport.note("aa", True, 3)
    assert link.poll() == [LinkDown(at_ns=2), LinkUp(router_zid="aa", at_ns=3)]
    link._transport.note("bb", True, 4)
    link._transport.note("aa", False, 5)
    assert link.poll() == [LinkDown(at_ns=4), LinkUp(router_zid="bb", at_ns=4)]
    assert link.router_zid == "bb"


def test_events_come_oldest_first(link):
    """A sample from before the loss must not look like one from after it, not even one that waits for its turn."""
    box = link._mailboxes
    link.pace(is_moving=False, is_watched=False)
    box[ARM].put(encode(state_message(ARM, 1)), 5)
    link._transport.note("aa", True, 3)
    link._observations.append(RouteObserved(topic=ARM, code=None, message="", at_ns=4))
    box[FSM_STATE].put(encode(state_message(FSM_STATE, 1)), 7)
    link._transport.note("aa", False, 6)
    events = link.poll()
    assert names(events) == ["LinkUp", "RouteObserved", "SampleArrived", "LinkDown", "SampleArrived"]


def test_each_topic_gives_its_newest_sample_with_its_counters(link):
    """Latest only; arrivals, duplicates and the worst gap come with it."""
    for stamp, at_ms in [(1, 0), (1, 1), (2, 5), (3, 30)]:
        link._mailboxes[ARM].put(encode(state_message(ARM, stamp)), at_ms * MS)
    (event,) = link.poll()
    assert isinstance(event, SampleArrived)
    assert (event.topic, event.stamp_ns, event.received_ns) == (ARM, 3, 30 * MS)
    assert (event.count, event.duplicates, event.worst_gap_ns) == (3, 1, 25 * MS)


def test_what_nobody_waits_for_is_decoded_less_often():
    """Joints at every second poll; poses and grippers less often when nothing moves and nobody looks; FSM always."""
    now_ns = 1 * S
    link = RobotLink(LinkSettings(), clock=lambda: now_ns)
    shown = gripper_state(Side.LEFT)
    waiting: list[bytes] = []
    link._mailboxes[shown].attach(lambda: [Keepsake(waiting.pop()) for _ in waiting[:]], 0)

    def polled(polls: int, period_ns: int) -> tuple[int, ...]:
        nonlocal now_ns
        link.poll()
        counts = {ARM: 0, shown: 0, FSM_STATE: 0}
        for _ in range(polls):
            now_ns += period_ns
            for topic in (ARM, FSM_STATE):
                link._mailboxes[topic].put(encode(state_message(topic, now_ns)), now_ns)
            waiting.append(encode(state_message(shown, now_ns)))
            for event in link.poll():
                counts[event.topic] += 1
        return tuple(counts.values())

    for is_moving, is_watched, expected in (
        (True, True, (10, 10, 20)),
        (True, False, (10, 10, 20)),
        (False, True, (10, 10, 20)),
        (False, False, (10, 5, 20)),
    ):
        link.pace(is_moving=is_moving, is_watched=is_watched)
        assert polled(20, 10 * MS) == expected
    assert polled(4, 50 * MS) == (4, 4, 4), "polls are rare, or late: each gives everything"


def test_types_without_a_stamp_are_never_taken_for_copies(link):
    """A pose that does not change is a state that is alive."""
    topic = ee_pose(Side.LEFT)
    waiting = [Keepsake(encode(state_message(topic, 0)))] * 3
    link._mailboxes[topic].attach(lambda: waiting, 0)
    link.pace(is_moving=False, is_watched=False, is_posing=True)
    (event,) = link.poll()
    assert (event.count, event.duplicates, event.stamp_ns) == (3, 0, None)


def test_skimming_tells_when_the_newest_fast_sample_came_and_reads_none():
    """A guard that waits wants to know that the robot is heard, not what it says; FSM and mode do not tell (20 and 1 Hz)."""
    now_ns = 1 * S
    link = RobotLink(LinkSettings(), clock=lambda: now_ns, topics=DECIDING, stamped=())
    waiting: dict[str, list[Keepsake]] = {topic: [] for topic in DECIDING}
    for topic, samples in waiting.items():
        link._mailboxes[topic].attach(lambda samples=samples: [samples.pop(0) for _ in samples[:]], now_ns)
    assert link.skim() == 0
    now_ns += 40 * MS
    for topic in (FSM_STATE, arm_state(Side.LEFT)):
        waiting[topic].append(Keepsake(encode(state_message(topic, 1))))
    assert link.skim() == 1 * S
    now_ns += 40 * MS
    waiting[FSM_STATE].append(Keepsake(encode(state_message(FSM_STATE, 2))))
    assert link.skim() == 1 * S
    arrived = {event.topic: event.received_ns for event in link.poll()}
    assert arrived == {arm_state(Side.LEFT): 1 * S, FSM_STATE: 1 * S + 40 * MS}


def test_what_is_only_shown_never_looks_younger_than_it_is():
    """Such a sample came between two polls: its age counts from the first of them, its gap from how many came."""
    now_ns = 1 * S
    link = RobotLink(LinkSettings(), clock=lambda: now_ns)
    topic = gripper_state(Side.LEFT)
    waiting: list[bytes] = []
    link._mailboxes[topic].attach(lambda: [Keepsake(waiting.pop(0)) for _ in waiting[:]], now_ns)
    link.pace(is_moving=False, is_watched=True)
    arrived = []
    for n in range(1, 9):
        now_ns += 10 * MS
        waiting += [encode(state_message(topic, 10 * n + k)) for k in range(2)]
        arrived += [(now_ns, event) for event in link.poll()]
    assert [at_ns - event.received_ns for at_ns, event in arrived[2:]] == [20 * MS] * 3
    assert [(event.count, event.worst_gap_ns) for _, event in arrived[2:]] == [(4, 5 * MS)] * 3


@pytest.mark.parametrize(
    ("change", "code"), [({"name": ["x"] * 7}, Code.JOINT_ORDER), ({"position": [0.0]}, Code.SAMPLE_REFUSED)]
)
def test_a_sample_that_cannot_be_believed_is_told_with_its_code(link, change, code):
    """The others are not held up by it."""
    message = state_message(ARM, 1)
    for name, value in change.items():
        setattr(message, name, value)
    link._mailboxes[ARM].put(encode(message), 4 * MS)
    link._mailboxes[FSM_STATE].put(encode(state_message(FSM_STATE, 1)), 5 * MS)
    refused, arrived = link.poll()
    assert isinstance(refused, SampleRefused) and isinstance(arrived, SampleArrived)
    assert (refused.topic, refused.code, refused.received_ns, refused.count) == (ARM, code, 4 * MS, 1)
    assert refused.message


# ------------------------------------------------------------------------------------------------- with a robot process


class Plane:
    """A robot process, a link to it and everything that the link has told."""

    def __init__(self, port: int, **settings) -> None:
        self.robot = RobotProcess(port, settings.get("namespace", ""))
        self.link = RobotLink(LinkSettings(endpoint=self.robot.endpoint, **settings))
        self.events: list[object] = []

    def poll(self) -> list[object]:
        new = self.link.poll()
        self.events += new
        return new

    def wait_for(self, condition, timeout_s: float = 5.0, what: str = ""):
        """Poll until the condition holds."""

        def look():
            self.poll()
            return condition()

        return wait_until(look, timeout_s, what)

    def told(self, event_type) -> list:
        return [event for event in self.events if isinstance(event, event_type)]

    def wait_for_states(self, timeout_s: float) -> float:
        """Return how long it took until each state topic had delivered [s]."""
        start_s = time.monotonic()
        seen: set[str] = set()

        def all_seen() -> bool:
            seen.update(event.topic for event in self.poll() if isinstance(event, SampleArrived))
            return seen == set(STATE_TOPICS)

        wait_until(all_seen, timeout_s, "every state topic")
        return time.monotonic() - start_s

    def wait_for_arm(self, timeout_s: float) -> float:
        """Return how long it took until an arm sample came [s]."""
        start_s = time.monotonic()
        wait_until(
            lambda: any(isinstance(event, SampleArrived) and event.topic == ARM for event in self.poll()),
            timeout_s,
            "an arm sample",
        )
        return time.monotonic() - start_s

    def connected(self):
        """Start robot and link and wait until state comes."""
        self.robot.start()
        self.link.open()
        self.wait_for_arm(5.0)
        return self

    def received(self) -> dict[str, list[str]]:
        return self.robot.ask("stats")["received"]

    def own_tokens(self) -> list[str]:
        return [token for token in self.robot.ask("stats")["foreign_tokens"] if f"@/{self.link.zid}/" in token]

    def end(self) -> None:
        self.robot.kill()
        assert self.link.close(5 * S)


@pytest.fixture
def make_plane(port):
    """Make planes that are ended with the test."""
    planes = []

    def make(**settings) -> Plane:
        planes.append(Plane(port, **settings))
        return planes[-1]

    yield make
    for plane in planes:
        plane.end()


@pytest.mark.e2e
def test_state_of_every_topic_is_there_within_two_seconds(make_plane):
    """From `open` to the first sample of each topic, after LinkUp with the router's id (wire.md 2.2)."""
    plane = make_plane()
    plane.robot.start()
    plane.link.open()
    plane.wait_for_states(2.0)
    (up,) = plane.told(LinkUp)
    assert up.router_zid == plane.robot.zid == plane.link.router_zid
    assert names(plane.events)[0] == "LinkUp"
    assert plane.told(SampleRefused) == []


@pytest.mark.e2e
@pytest.mark.parametrize("namespace", ["", "bot1"])
def test_frames_arrive_exactly_and_in_their_lane(make_plane, namespace):
    """Exact bytes on the exact key; DROP and express, the heartbeat in its own priority (wire.md 7.3)."""
    plane = make_plane(model="lift", namespace=namespace).connected()
    sent = VARIANTS["lift"].command_topics
    for topic in sent:
        plane.link.publish(cleared(topic, (0.125,) * TOPICS[topic].width))
    received = wait_until(lambda: (r := plane.received()) and len(r) == len(sent) and r, what="all frames")
    for topic in sent:
        ((kind, payload, *lane),) = [entry.split() for entry in received[f"{namespace}{topic}".strip("/")]]
        priority = "REAL_TIME" if topic == FSM_ENABLE else "INTERACTIVE_HIGH"
        assert (kind, len(payload) // 2) == ("put", FRAME_BYTES[topic])
        assert lane == [f"Priority.{priority}", "CongestionControl.DROP", "express"]
    assert plane.link.undelivered == 0


@pytest.mark.e2e
def test_our_tokens_are_there_as_long_as_the_session(make_plane):
    """One MS token per state topic from the start, again after a reconnect, gone after `close` (wire.md fact 8)."""
    plane = make_plane(model="lift").connected()
    tokens = wait_until(lambda: (t := plane.own_tokens()) and len(t) == len(STATE_TOPICS) and t)
    assert f"@/{plane.link.zid}/@ros2_lv/MS/left_arm§joint_states/sensor_msgs§msg§JointState/:1::0,10" in tokens
    plane.robot.kill()
    plane.wait_for(lambda: plane.told(LinkDown), what="LinkDown")
    plane.robot.start()
    assert wait_until(lambda: (t := plane.own_tokens()) and len(t) == len(STATE_TOPICS) and t) == tokens
    zid = plane.link.zid
    assert plane.link.close()
    wait_until(lambda: not any(zid in token for token in plane.robot.ask("stats")["foreign_tokens"]))


@pytest.mark.e2e
def test_topics_that_nobody_wants_are_not_heard_and_not_missed(make_plane):
    """A guard hears what decides: no subscription, no token, no readiness and no dead route for the rest."""
    plane = make_plane()
    plane.link.close()
    plane.link = RobotLink(LinkSettings(endpoint=plane.robot.endpoint), topics=DECIDING)
    plane.connected()
    tokens = wait_until(lambda: (t := plane.own_tokens()) and len(t) == len(DECIDING) and t)
    assert not any("gripper" in token or "chassis" in token for token in tokens)
    assert set(plane.link.readiness()) == {*DECIDING, *VARIANTS["standard"].command_topics}
    end_s = time.monotonic() + 2.6  # a topic that ought to come would be called silent by now
    plane.wait_for(lambda: time.monotonic() > end_s)
    assert {event.topic for event in plane.told(SampleArrived)} == DECIDING
    assert [event for event in plane.told(RouteObserved) if event.topic not in COMMAND_TOPICS] == []


@pytest.mark.e2e
def test_a_robot_that_starts_later_is_found(make_plane, caplog):
    """The first `open` fails while nobody listens; the link goes on trying and says so once."""
    caplog.set_level(logging.INFO, logger="gateway.link")
    plane = make_plane()
    plane.link.open()
    wait_until(lambda: "trying on" in caplog.text, 4.0, "the first failure")
    assert plane.poll() == []
    plane.robot.start()
    assert plane.wait_for_arm(2.5) < 2.5
    assert caplog.text.count("trying on") == 1 and ".rs:" not in caplog.text


@pytest.mark.alone
@pytest.mark.e2e
def test_a_restarted_router_is_found_within_a_second(make_plane):
    """LinkDown at once, LinkUp with another id, state back < 1 s after the router listens; nothing sent in between."""
    plane = make_plane().connected()
    first = plane.robot.zid
    plane.robot.kill()
    killed_s = time.monotonic()
    plane.wait_for(lambda: plane.told(LinkDown), what="LinkDown")
    assert time.monotonic() - killed_s < 0.5
    assert not plane.link.is_up
    for _ in range(100):
        plane.link.publish(cleared())
    assert plane.link.undelivered == 100
    plane.robot.start()
    assert plane.wait_for_arm(5.0) < 1.0
    assert [up.router_zid for up in plane.told(LinkUp)] == [first, plane.robot.zid]
    assert plane.link.router_zid == plane.robot.zid
    plane.link.publish(cleared(values=(0.0,)))
    received = wait_until(plane.received, what="the one frame after the outage")
    assert [entry.split()[1] for entry in received["api/fsm/enable"]] == ["0001000000000000"]
    assert plane.link.undelivered == 100


@pytest.mark.e2e
def test_a_last_frame_is_delivered_although_close_follows_at_once(make_plane):
    """0.0 and then the end of the process: the frame must not stay behind in a queue."""
    plane = make_plane().connected()
    plane.link.publish(cleared(values=(0.0,)))
    assert plane.link.close()
    assert list(wait_until(plane.received)) == ["api/fsm/enable"]
    plane.link.publish(cleared())
    assert plane.link.undelivered == 1
    assert not plane.link.is_up


@pytest.mark.alone
@pytest.mark.e2e
def test_close_is_bounded_while_the_robot_is_frozen(make_plane):
    """A router that does not answer holds nobody up (wire.md 6.1), and state comes back when it goes on."""
    plane = make_plane().connected()
    plane.robot.freeze()
    for _ in range(50):
        plane.link.publish(cleared())
    start_s = time.monotonic()
    assert plane.link.close()
    assert time.monotonic() - start_s < 1.0
    plane.robot.thaw()


@pytest.mark.alone
@pytest.mark.e2e
def test_close_is_bounded_while_nobody_listens(make_plane):
    """The thread that is just connecting needs 2 s at most; who does not want to wait is told that it still runs."""
    plane = make_plane()
    plane.link.open()
    start_s = time.monotonic()
    plane.link.close(100 * MS)
    assert time.monotonic() - start_s < 0.5
    assert plane.link.close(3 * S)


@pytest.mark.e2e
def test_a_bridge_that_delivers_thrice_is_seen_through(make_plane):
    """Copies are skipped and counted; the rate stays the robot's (wire.md 3.1 f)."""
    plane = make_plane().connected()
    plane.robot.ask("copies", number=3)
    plane.poll()

    def arrivals():
        return [event for event in plane.told(SampleArrived) if event.topic == ARM]

    plane.wait_for(lambda: any(event.duplicates for event in arrivals()), what="the first copy")
    plane.events.clear()
    plane.wait_for(lambda: sum(event.count for event in arrivals()) > 100, what="100 samples with copies")
    factor = 1 + sum(event.duplicates for event in arrivals()) / sum(event.count for event in arrivals())
    assert 2.8 < factor < 3.2


@pytest.mark.e2e
def test_a_spoilt_topic_is_refused_and_the_others_go_on(make_plane):
    """NaN on one arm: that topic is refused, its twin arrives."""
    plane = make_plane().connected()
    plane.robot.ask("spoil", topic=ARM)
    plane.wait_for(lambda: len(plane.told(SampleRefused)) > 3, what="refusals")
    assert {(event.topic, event.code) for event in plane.told(SampleRefused)} == {(ARM, Code.SAMPLE_REFUSED)}
    plane.events.clear()
    plane.wait_for(lambda: any(e.topic == arm_state(Side.RIGHT) for e in plane.told(SampleArrived)))


@pytest.mark.e2e
def test_readiness_and_version_are_read_from_the_bridge(make_plane):
    """Tokens, admin space and data agree: every topic of the model is ready (wire.md 2.5)."""
    plane = make_plane(namespace="bot1").connected()
    plane.wait_for(lambda: set(plane.link.readiness().values()) == {"ready"}, what=str(plane.link.readiness()))
    assert plane.link.robot_version == "9.9.9"


@pytest.mark.e2e
def test_a_dead_route_is_revived(make_plane):
    """The bridge has lost its reader: ROUTE_DEAD, declared again, state back, the token never gone (BEHAVIOUR)."""
    plane = make_plane().connected()
    plane.robot.ask("kill_route", topic=ARM)
    plane.wait_for(lambda: plane.told(RouteObserved), 3.0, "ROUTE_DEAD")
    assert len(plane.own_tokens()) == len(STATE_TOPICS)
    # Up to three seconds until the instant at which every process declares again, then the pause and a sample.
    plane.wait_for(lambda: len(plane.told(RouteObserved)) == 2, GRID_NS / 1e9 + 1.0, "the route alive again")
    assert [(e.topic, e.code) for e in plane.told(RouteObserved)] == [(ARM, Code.ROUTE_DEAD), (ARM, None)]
    assert plane.told(LinkDown) == []


@pytest.mark.e2e
def test_a_node_that_leaves_is_a_lost_route_until_it_returns(make_plane):
    """Tokens gone, transport up: ROUTE_LOST for every silent topic, and the end of it (wire.md 3.1 b2)."""
    plane = make_plane().connected()
    plane.robot.ask("leave")

    def codes():
        return {e.topic: e.code for e in plane.told(RouteObserved)}

    plane.wait_for(lambda: codes().get(ARM) is Code.ROUTE_LOST, 3.0, "ROUTE_LOST")
    plane.robot.ask("return")
    plane.wait_for(lambda: set(codes().values()) == {None}, 3.0, "all routes alive again")
    assert plane.link.is_up


@pytest.mark.e2e
def test_a_session_that_fails_is_replaced_by_another(make_plane, monkeypatch, caplog):
    """A declaration that zenoh refuses once must not leave the daemon without a robot until it is restarted."""
    listen, attempts = RobotSession.listen, []

    def fail_once(self):
        listen(self)
        attempts.append(self.zid)
        if len(attempts) == 1:
            raise zenoh.ZError("declared no more")

    monkeypatch.setattr(RobotSession, "listen", fail_once)
    plane = make_plane().connected()
    wait_until(lambda: len(attempts) == 2 and plane.link.is_up and plane.poll(), what="another session")
    plane.wait_for_arm(5.0)
    assert plane.link.zid == attempts[1] != attempts[0]
    told = [name for name in names(plane.events) if name in ("LinkUp", "LinkDown")]
    assert told in (["LinkUp"], ["LinkUp", "LinkDown", "LinkUp"]), "an outage that was seen is told"
    assert "opening another one" in caplog.text


@pytest.mark.e2e
def test_a_fault_of_the_diagnosis_does_not_take_the_link_away(make_plane, monkeypatch, caplog):
    """Discovery only watches: when it fails, state and commands go on, and the log says what is missing."""
    monkeypatch.setattr(Discovery, "step", lambda self, sight: 1 / 0)
    plane = make_plane().connected()
    wait_until(lambda: "discovery failed" in caplog.text, what="the log line")
    plane.wait_for_arm(1.0)
    plane.link.publish(cleared())
    assert wait_until(plane.received)
    assert plane.link.undelivered == 0


def test_a_panic_in_the_links_thread_leaves_the_session_to_the_loop(make_plane, monkeypatch):
    """It is told, and what brakes and holds goes on: a session that closed would hand the arms to the robot's watchdogs."""

    class Panic(BaseException):
        pass

    def panic(self, sight):
        raise Panic("boom")

    take_lost()
    plane = make_plane().connected()
    monkeypatch.setattr(Discovery, "step", panic)
    wait_until(lambda: not plane.link._worker.is_alive(), what="the end of the thread")
    assert [lost.name for lost in take_lost()] == ["robot-link"]
    plane.wait_for_arm(1.0)
    plane.link.publish(cleared())
    assert wait_until(plane.received)
    assert plane.link.is_up and plane.link.undelivered == 0
    assert not plane.link.close(0), "who ends the process would wait for zenoh's threads"
    plane.link._drop(plane.link._serving)


@pytest.mark.thorough
@pytest.mark.e2e
def test_a_subscription_that_could_not_be_declared_again_is_tried_again(make_plane, monkeypatch, caplog):
    """One failed attempt to revive a route must not leave its topic deaf for ever."""
    plane = make_plane().connected()
    plane.wait_for_states(5.0)  # everything is declared
    subscribe, attempts = RobotSession._subscribe, []

    def fail_once(self, topic):
        attempts.append(topic)
        if len(attempts) == 1:
            raise zenoh.ZError("not now")
        return subscribe(self, topic)

    monkeypatch.setattr(RobotSession, "_subscribe", fail_once)
    plane.robot.ask("kill_route", topic=ARM)
    wait_until(lambda: plane.poll() is not None and len(attempts) > 1, 12.0, "another attempt")
    plane.wait_for_arm(2.0)
    assert attempts == [ARM, ARM]
    assert "discovery failed" in caplog.text


GATEWAY = """
import sys, time
from gateway.link import RobotLink
from gateway.settings.settings import LinkSettings
link = RobotLink(LinkSettings(endpoint=sys.argv[1]))
link.open()
while not link.is_up:
    time.sleep(0.01)
print(link.zid or "", flush=True)
if sys.stdin.readline() == "close\\n":
    print(link.close(), flush=True)
"""


@pytest.fixture
def gateway(port):
    """A robot and a process of its own that holds a link to it and ends after a line on stdin."""
    robot_process = RobotProcess(port).start()
    process = subprocess.Popen(
        [sys.executable, "-c", GATEWAY, robot_process.endpoint],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    process.stdout.readline()
    yield robot_process, process
    process.kill()
    process.communicate()
    robot_process.kill()


@pytest.mark.alone
@pytest.mark.e2e
def test_the_robots_end_forgets_a_frozen_gateway_after_its_lease(gateway):
    """The announced lease is a fence: after that much silence of ours the robot's end closes (wire.md fact 2)."""
    robot_process, process = gateway
    wait_until(lambda: len(robot_process.ask("stats")["foreign_tokens"]) == len(STATE_TOPICS))
    os.kill(process.pid, signal.SIGSTOP)
    start_s = time.monotonic()
    wait_until(lambda: not robot_process.ask("stats")["foreign_tokens"], 3.0, "the tokens gone")
    assert time.monotonic() - start_s < 1.5
    os.kill(process.pid, signal.SIGCONT)
    wait_until(lambda: robot_process.ask("stats")["foreign_tokens"], 3.0, "the tokens back")


@pytest.mark.e2e
def test_the_process_ends_after_close(gateway):
    """Zenoh's callback threads keep a process alive until its session is closed (realtime.md 7.1)."""
    _, process = gateway
    said, _ = process.communicate("close\n", timeout=5)
    assert said.strip() == "True"
    assert process.returncode == 0


@pytest.mark.e2e
def test_the_process_ends_although_nobody_closed_the_link(gateway):
    """A program that fails in its main thread must not hang, and not abort either."""
    _, process = gateway
    process.communicate("leave\n", timeout=5)
    assert process.returncode == 0


@pytest.mark.e2e
def test_callbacks_run_in_threads_of_their_own(make_plane):
    """Not in zenoh's reader: a busy interpreter would hold up every topic in one line (measured in `robot_session`).

    What is only shown, and poses, have no callback and no thread; transport events, tokens of bridges, tokens of gateways
    and the link itself have one each.
    """
    before = threading.active_count()
    plane = make_plane().connected()
    wait_until(lambda: threading.active_count() - before > len(STAMPED), what="a thread per stamped topic and ours")
    plane.wait_for_states(2.0)
    assert threading.active_count() - before <= len(STAMPED) + 4
    assert STAMPED < DECIDING < set(STATE_TOPICS)
    assert zenoh.handlers.Callback(print).indirect
