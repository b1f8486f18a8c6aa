"""Others as the link sees them through a real router: who they are, how soon they are seen, and that we are not among them."""

from __future__ import annotations

import threading
import time

import pytest

from gateway.core.messages.events import LinkUp
from gateway.core.messages.outputs import Frame, FrameKind
from gateway.core.messages.sightings import Befriended, ClaimShown, ForeignData, ForeignTokens, GatewayTokens, Means
from gateway.core.streams.gate import Cleared
from gateway.link import RobotLink
from gateway.link.discovery.discovery import TokenTable
from gateway.link.others.foreign_watch import LOOK_PERIOD_NS, ForeignWatch
from gateway.robot.topics import FSM_ENABLE, joint_command
from gateway.settings.settings import LinkSettings
from gateway.values import Side
from tests.link.robot_process import RobotProcess, wait_until
from tests.stranger import Stranger

pytestmark = pytest.mark.e2e

S = 1_000_000_000
ARM = joint_command(Side.LEFT)
Q_RAD = (0.1,) * 7
ADMIN_S = 2.0
"""Declared publishers must be seen within this [s] (BEHAVIOUR, somebody else)."""
SOON_S = 0.5
"""Data and tokens are seen within 0.1 s on a machine that is not busy with other tests."""


class Place:
    """A robot's router, our link to it, and what it has told."""

    def __init__(self, port: int) -> None:
        self.robot = RobotProcess(port).start()
        self.link = RobotLink(LinkSettings(endpoint=self.robot.endpoint))
        self.events: list[object] = []
        self.strangers: list[Stranger] = []
        self.link.open()
        self.wait(lambda: self.told(LinkUp), what="a link")

    def told(self, kind: type) -> list:
        """Return what was told of a kind."""
        self.events += self.link.poll()
        return [event for event in self.events if isinstance(event, kind)]

    def wait(self, condition, timeout_s: float = 5.0, what: str = ""):
        """Poll until something is so."""
        return wait_until(condition, timeout_s, what)

    def stranger(self, **how: object) -> Stranger:
        """Somebody connects."""
        self.strangers.append(Stranger(self.robot.endpoint, **how))
        return self.strangers[-1]

    def writers(self) -> set[tuple[str, str, Means]]:
        """Who announces commands, as was told last."""
        told = self.told(ForeignTokens)
        return {(writer.zid, writer.topic, writer.means) for writer in told[-1].writers} if told else set()

    def gateways(self) -> set[tuple[str, bool]]:
        """Which gateways are there, as was told last."""
        told = self.told(GatewayTokens)
        return {(gateway.zid, gateway.is_armed) for gateway in told[-1].gateways} if told else set()

    def hears(self, send) -> None:
        """Have somebody send until it is heard: what is put right after connecting is lost. Forget it."""
        self.wait(lambda: (send(), self.told(ForeignData))[1], what="a foreign command")
        time.sleep(0.1)
        self.told(ForeignData)
        self.events.clear()

    def publish(self, count: int) -> None:
        """Send frames of our own."""
        for n in range(count):
            self.link.publish(Cleared(Frame(topic=ARM, values=Q_RAD, kind=FrameKind.HOLD, epoch=0, due_ns=n)))

    def close(self) -> None:
        """End everything."""
        for stranger in self.strangers:
            stranger.close()
        assert self.link.close(5 * S)
        self.robot.kill()


@pytest.fixture
def place(port):
    """A place, ended with the test."""
    made = Place(port)
    yield made
    made.close()


def test_our_own_puts_and_onlookers_are_nobody(place):
    """Frames of ours do not come back; who subscribes and who is connected commands nothing; the mode is the robot's."""
    place.stranger().listen("**")
    for _ in range(20):
        place.publish(5)
        time.sleep(0.005)
    place.wait(lambda: len(place.robot.ask("stats")["received"].get("api/left_arm/joint_cmd", ())) == 100)
    time.sleep(1.3)  # a second sample of /api/current_mode and two looks at the router
    assert place.told(ForeignData) == [] and place.writers() == set() and place.gateways() == set()


@pytest.mark.parametrize("stamps", [True, False])
def test_a_command_of_somebody_else_is_seen_at_once_by_name_if_it_has_one(place, stamps):
    """Without a declared publisher, a DELETE too; a plain program's sample carries the router's stamp: nobody is named."""
    stranger = place.stranger(stamps=stamps)
    place.hears(lambda: stranger.put(ARM, Q_RAD))
    stranger.put(ARM, Q_RAD)
    (data,) = place.wait(lambda: place.told(ForeignData), SOON_S)
    assert (data.topic, data.zid, data.count) == (ARM, stranger.zid if stamps else "", 1)
    place.events.clear()
    stranger.delete(FSM_ENABLE)
    (data,) = place.wait(lambda: place.told(ForeignData), SOON_S)
    assert (data.topic, data.zid) == (FSM_ENABLE, stranger.zid if stamps else "")


def test_a_command_for_both_arms_at_once_is_seen_as_each_of_them(place):
    """The robot takes what is put on a key with wildcards."""
    stranger = place.stranger(stamps=True)
    place.hears(lambda: stranger.put(ARM, Q_RAD))
    stranger.put(ARM, Q_RAD, key="api/*/joint_cmd")
    place.wait(lambda: len(place.told(ForeignData)) == 2, SOON_S)
    assert {(data.topic, data.zid, data.count) for data in place.told(ForeignData)} == {
        (joint_command(side), stranger.zid, 1) for side in Side
    }


def test_a_ros_publisher_is_seen_before_it_sends_and_until_it_ends(place):
    """By the token of its bridge."""
    stranger = place.stranger()
    stranger.announce(FSM_ENABLE)
    place.wait(lambda: place.writers() == {(stranger.zid, FSM_ENABLE, Means.TOKEN)}, SOON_S)
    stranger.retract(FSM_ENABLE)
    place.wait(lambda: place.writers() == set(), SOON_S)


def test_a_declared_publisher_that_sends_nothing_is_seen_with_its_address(place):
    """As the router lists it, within two seconds; it goes with its session."""
    stranger = place.stranger()
    stranger.declare(ARM)
    place.wait(lambda: place.writers() == {(stranger.zid, ARM, Means.PUBLISHER)}, ADMIN_S)
    place.wait(lambda: place.told(ForeignTokens)[-1].writers[0].link.startswith("tcp/127.0.0.1:"), ADMIN_S)
    stranger.close()
    place.wait(lambda: place.writers() == set(), ADMIN_S)


def test_gateways_see_each_other_connect_arm_and_leave(place):
    """Two links of ours on one router: presence with the session, the armed token with the claim."""
    other = RobotLink(LinkSettings(endpoint=place.robot.endpoint))
    other.open()
    try:
        place.wait(lambda: place.gateways() == {(other.zid, False)}, what="another gateway")
        shown: list[object] = []
        other.show(7)

        def is_shown() -> bool:
            shown.extend(event for event in other.poll() if isinstance(event, ClaimShown))
            return bool(shown)

        place.wait(is_shown, what="its claim is out")
        assert [event.claim for event in shown] == [7]
        place.wait(lambda: place.gateways() == {(other.zid, True)}, SOON_S, "armed")
        other.show(0)
        place.wait(lambda: place.gateways() == {(other.zid, False)}, SOON_S, "disarmed")
        other.show(8)
        place.wait(lambda: place.gateways() == {(other.zid, True)}, SOON_S, "armed again")
    finally:
        assert other.close(5 * S)
    place.wait(lambda: place.gateways() == set(), SOON_S, "gone")


def test_no_session_of_ours_is_listed_as_a_publisher(place):
    """Not even one that has just sent: an answer to who publishes is what can hang the router."""
    other = RobotLink(LinkSettings(endpoint=place.robot.endpoint))
    other.open()
    try:
        place.wait(lambda: place.gateways() == {(other.zid, False)}, what="another gateway")
        place.publish(5)
        asker = place.stranger()
        assert asker.ask(f"@/{place.robot.zid}/router/publisher/api/*/*") == {}
        place.stranger().declare(ARM)
        place.wait(lambda: asker.ask(f"@/{place.robot.zid}/router/publisher/api/*/*"), what="somebody else's is listed")
    finally:
        assert other.close(5 * S)


def test_our_questions_do_not_hang_the_router_however_many_declare_beside_them(place):
    """As fast as they can be asked, beside a client that declares without pause: each is answered, and others are served.

    With our own sessions among the publishers the router hung within some ten questions.
    """
    watched = threading.Event()
    busy = place.stranger()
    thread = threading.Thread(target=busy.declare_without_pause, args=(watched.is_set,))
    place.publish(5)
    asker = place.stranger()
    watch = ForeignWatch(LinkSettings(), TokenTable(), asker.zid, time.monotonic_ns)
    answered: list[int] = []

    def ask(selector: str) -> dict[str, bytes]:
        answers = asker.ask(selector)
        answered.append(len(answers))
        assert answers or selector.endswith("*"), f"no answer to question {len(answered)}: the router hangs"
        return answers

    thread.start()
    try:
        for look in range(1, 401):
            watch.ask(look * LOOK_PERIOD_NS, place.robot.zid, ask)
    finally:
        watched.set()
        thread.join(5.0)
        if thread.is_alive():
            place.robot.kill()  # it hangs, and with it all that is closed while it lives
    assert answered == [1, *([1, 0] * 399)]
    stranger = place.stranger()
    place.hears(lambda: stranger.put(ARM, Q_RAD))


def test_who_is_there_is_told_again_after_the_router_restarted(place):
    """Under its new transport: strangers come back by themselves, and are seen although nothing else has changed."""
    stranger = place.stranger()
    stranger.announce(ARM)
    stranger.pose_as_gateway(is_armed=True)
    place.wait(lambda: place.writers() and place.gateways())
    place.robot.kill()
    place.wait(lambda: not place.link.is_up)
    place.robot.start()
    place.events.clear()
    place.wait(lambda: place.told(LinkUp), 10.0, "a link again")
    place.wait(lambda: place.writers() == {(stranger.zid, ARM, Means.TOKEN)}, 10.0, "the stranger's token")
    place.wait(lambda: place.gateways() == {(stranger.zid, True)}, 10.0, "the gateway's token")


def test_a_friend_is_introduced_in_the_order_of_events(place):
    """The guard's zenoh id reaches the core before anything that it sends afterwards."""
    guard = place.stranger(stamps=True)
    place.hears(lambda: guard.put(ARM, Q_RAD))
    place.link.befriend(guard.zid)
    guard.put(ARM, Q_RAD)
    place.wait(lambda: place.told(ForeignData), SOON_S)
    kinds = [type(event) for event in place.events if isinstance(event, (Befriended, ForeignData))]
    assert kinds == [Befriended, ForeignData] and place.told(ForeignData)[0].zid == guard.zid


def test_who_hears_no_commands_does_so_as_soon_as_it_wants_to_and_after_the_next_connecting(place):
    """As a guard does: nothing of what others command comes back to it while it waits."""
    stranger = place.stranger()
    guard = RobotLink(LinkSettings(endpoint=place.robot.endpoint), hears_commands=False)
    guard.open()
    try:
        wait_until(lambda: guard.is_up, 5.0, "the guard's link")
        place.hears(lambda: stranger.put(ARM, Q_RAD))  # whoever listens hears it
        assert not any(isinstance(event, ForeignData) for event in guard.poll())

        def hears() -> bool:
            stranger.put(ARM, Q_RAD)
            return any(isinstance(event, ForeignData) for event in guard.poll())

        for _ in range(2):  # whoever doubts goes on doubting, and nothing is declared twice
            guard.hear_commands()
        wait_until(hears, 5.0, "a foreign command")
        place.robot.kill()
        wait_until(lambda: not guard.is_up, 5.0, "the end of the link")
        place.robot.start()
        wait_until(lambda: guard.is_up, 10.0, "a link again")
        wait_until(hears, 5.0, "a foreign command on the new link")
    finally:
        assert guard.close(5 * S)


def test_a_link_that_was_told_to_hear_commands_before_it_is_open_hears_them(place):
    """Its first session declares what was wanted before there was one."""
    stranger = place.stranger()
    guard = RobotLink(LinkSettings(endpoint=place.robot.endpoint), hears_commands=False)
    guard.hear_commands()
    guard.open()
    try:
        wait_until(
            lambda: (stranger.put(ARM, Q_RAD), any(isinstance(event, ForeignData) for event in guard.poll()))[1],
            5.0,
            "a foreign command",
        )
    finally:
        assert guard.close(5 * S)
