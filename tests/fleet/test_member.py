"""A robot's member in its fleet: what it hands on and what not, over real zenoh on loopback with a scripted gateway."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
import zenoh
from msgspec import structs

from gateway.api import protocol
from gateway.client import connect
from gateway.client.connection.over_zenoh import Credentials, client_configuration
from gateway.errors import Code, Disconnected, NotReady
from gateway.fleet import member as module
from gateway.messages import requests
from tests.api.daemon import Daemon, eventually
from tests.api.samples import command
from tests.e2e.system import free_port
from tests.fleet.fleets import member, router

pytestmark = pytest.mark.e2e

WAIT_S = 30.0


@pytest.fixture
def fleet(monkeypatch):
    """The locator of a fleet's router, which runs."""
    locator = f"tcp/127.0.0.1:{free_port()}"
    monkeypatch.setenv("TA2_FLEET", locator)
    with router(locator):
        yield locator


@pytest.fixture
def daemon(tmp_path):
    """A scripted gateway."""
    with Daemon(tmp_path) as daemon:
        yield daemon


@pytest.fixture
def stranger(fleet):
    """A plain zenoh session at the fleet's router."""
    with zenoh.open(client_configuration(protocol.fleet_address(), Credentials(), 10.0)) as session:
        yield session


def ask(session, key, payload=b"", timeout_s=5.0):
    """Return the answers to a query in JSON, by key."""
    replies = session.get(key, payload=payload, encoding=protocol.JSON, timeout=timeout_s, target=zenoh.QueryTarget.ALL)
    return {str(reply.ok.key_expr): reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None}


def members(session):
    """Return the keys of the members' tokens."""
    found = session.liveliness().get(f"fleet/*/{protocol.MEMBER_TOKENS}", timeout=5.0)
    return [str(token.ok.key_expr) for token in found if token.ok is not None]


def test_a_client_finds_and_owns_a_robot_by_its_name(fleet, daemon):
    """Snapshots, notices and commands pass; keepalives keep the lease, and a closed connection loses it."""
    with member(fleet, "robot-1", daemon.socket):
        robot = eventually(lambda: _connected("robot-1"), WAIT_S)
        with robot:
            assert robot.state.shown == "READ_ONLY"
            with robot.control() as own:
                eventually(lambda: robot.state.lease.name == "far", WAIT_S)
                own.enable(timeout=10.0)
                heard = daemon.plane._inbox.identities
                assert heard.secret_of(robot.client_id)
                key = protocol.keepalive_key(robot.client_id, heard.secret_of(robot.client_id))
                taken = []
                put = daemon.plane._inbox.put_keepalive
                daemon.plane._inbox.put_keepalive = lambda key, at_ns: (taken.append(key), put(key, at_ns))
                eventually(lambda: key in taken, WAIT_S)


def _connected(name):
    try:
        return connect(name, name="far", timeout_s=2.0)
    except Disconnected:
        return None


def test_keys_of_two_robots_do_not_meet(fleet, tmp_path, stranger):
    """A stop for one is none for the other; one for all reaches both, and each answers under its own name."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    with Daemon(tmp_path / "a") as one, Daemon(tmp_path / "b") as two:
        with member(fleet, "a", one.socket), member(fleet, "b", two.socket):
            eventually(lambda: len(members(stranger)) == 2, WAIT_S)
            answers = ask(stranger, "fleet/a/ta2/stop")
            assert set(answers) == {"fleet/a/ta2/stop"} and b'"stop_undelivered":false' in answers["fleet/a/ta2/stop"]
            assert one.engine.requests and not two.engine.requests
            stranger.put("fleet/*/ta2/estop", b"smoke")
            for daemon in (one, two):
                eventually(lambda daemon=daemon: _has_stopped(daemon, requests.Estop), WAIT_S)
            assert set(ask(stranger, "fleet/*/ta2/stop")) == {"fleet/a/ta2/stop", "fleet/b/ta2/stop"}
            assert set(ask(stranger, "fleet/*/ta2/1/snapshot")) == {"fleet/a/ta2/1/snapshot", "fleet/b/ta2/1/snapshot"}


def test_two_of_one_name_are_noticed_by_both_and_moved_by_nobody(fleet, daemon, stranger, caplog):
    """Commands are refused until one has left; stops and views go on."""
    with member(fleet, "twin", daemon.socket) as first:
        eventually(lambda: members(stranger), WAIT_S)
        with member(fleet, "twin", daemon.socket) as second:
            eventually(lambda: first.namesakes and second.namesakes, WAIT_S)
            assert len(members(stranger)) == 2
            with connect("twin", timeout_s=10.0) as robot, pytest.raises(NotReady) as refused, robot.control():
                pass
            assert refused.value.code == Code.OTHER_GATEWAY
            assert not any(isinstance(request, requests.Acquire) for _, request in daemon.engine.requests)
            assert ask(stranger, "fleet/twin/ta2/stop")
        eventually(lambda: not first.namesakes, WAIT_S)
        with connect("twin", timeout_s=10.0) as robot, robot.control():
            assert robot.state.lease.owned
    assert caplog.text.count("1 others have this name") == 2


def test_nobody_in_the_fleet_is_an_admin_unless_that_was_said(fleet, daemon, stranger):
    """Its gateway takes the member for an admin of its host: taking the robot and recovering it would be everybody's."""
    kinds = (protocol.Take(name="far", pid=1, reason="mine"), protocol.Recover(reason="all is well"))
    asked = [protocol.encode(command(request, request_id=n), protocol.JSON) for n, request in enumerate(kinds, 7)]

    def answers():
        found = [ask(stranger, f"fleet/r/{protocol.COMMAND_KEY}", payload) for payload in asked]
        return [protocol.decode_reply(answer, protocol.JSON) for one in found for answer in one.values()]

    def heard():
        return {type(request).__name__ for _, request in daemon.engine.requests} & {"Take", "Recover"}

    with member(fleet, "r", daemon.socket):
        eventually(lambda: ask(stranger, f"fleet/r/{protocol.INFO_KEY}"), WAIT_S)  # seen first, then it serves
        refused = answers()
        assert [(reply.request_id, reply.refusal.code) for reply in refused] == [(n, "NOT_PERMITTED") for n in (7, 8)]
        assert all("--as-admin" in reply.refusal.hint for reply in refused) and not heard()
        unread = ask(stranger, f"fleet/r/{protocol.COMMAND_KEY}", b'{"version": 99, "request": {"type": "take"}}')
        assert [protocol.decode_reply(one, protocol.JSON).refusal.code for one in unread.values()] == [
            "UNSUPPORTED_VERSION"
        ]
        assert daemon.plane._inbox.malformed == 0, (
            "it was handed on: a gateway of a later release might read a Take in it"
        )
        payload = protocol.encode(command(protocol.Acquire(name="far", pid=1), request_id=9), protocol.JSON)
        assert ask(stranger, f"fleet/r/{protocol.COMMAND_KEY}", payload)
    eventually(lambda: not members(stranger), WAIT_S)
    with member(fleet, "r", daemon.socket, as_admin=True):
        eventually(lambda: ask(stranger, f"fleet/r/{protocol.INFO_KEY}"), WAIT_S)
        assert len(answers()) == 2 and heard() == {"Take", "Recover"}


def test_a_namesake_that_has_gone_unheard_is_asked_for_again(fleet, daemon, stranger, monkeypatch):
    """Its end may have been told before its token was found; one that is there stays one."""
    monkeypatch.setattr(module, "NAMESAKES_S", 0.1)
    ghost = protocol.MEMBER_TOKENS.replace("*", "1234")
    with member(fleet, "twin", daemon.socket) as first, member(fleet, "twin", daemon.socket) as second:
        eventually(lambda: first.namesakes and second.namesakes, WAIT_S)
        real = set(first.namesakes)
        first.namesakes.add(ghost)
        eventually(lambda: ghost not in first.namesakes, WAIT_S)
        assert first.namesakes == real


def test_what_others_put_does_not_reach_the_gateway(fleet, daemon, stranger):
    """Neither without the owner's secret nor on a key for everybody; with it, it does."""
    payload = protocol.encode(command(protocol.Acquire(name="far", pid=1)), protocol.JSON)
    said = command(protocol.Acquire(name="far", pid=1))
    put, taken = daemon.plane._inbox.put_keepalive, []
    daemon.plane._inbox.put_keepalive = lambda key, at_ns: (taken.append(key), put(key, at_ns))
    with member(fleet, "r", daemon.socket):
        eventually(lambda: members(stranger), WAIT_S)
        secret = said.secret or "s3cret"
        payload = protocol.encode(structs.replace(said, secret=secret), protocol.JSON)
        (answer,) = ask(stranger, f"fleet/r/{protocol.COMMAND_KEY}", payload).values()
        assert b"epoch" in answer
        for key in (f"{said.client_id}/wrong", "**", f"*/{secret}", f"{said.client_id}/*"):
            stranger.put(f"fleet/r/ta2/1/keepalive/{key}", b"")
        stranger.put(f"fleet/r/{protocol.keepalive_key(said.client_id, secret)}", b"")
        eventually(lambda: taken, WAIT_S)
        assert set(taken) == {protocol.keepalive_key(said.client_id, secret)}


def test_the_router_goes_and_comes_back(fleet_that_ends, daemon):
    """A client on the gateway's own host notices nothing; the fleet finds the robot again."""
    locator, end, begin = fleet_that_ends
    with member(locator, "r", daemon.socket), connect(str(daemon.socket)) as near:
        far = eventually(lambda: _connected("r"), WAIT_S)
        with near.control():
            end()
            eventually(lambda: not far.health().ok, WAIT_S)
            assert near.state.lease.owned
            begin()
            eventually(lambda: far._session.is_connected, WAIT_S)
            eventually(lambda: far.state.lease.owned, WAIT_S)
        far.close()


@pytest.fixture
def fleet_that_ends(monkeypatch):
    """A router's locator, what ends it, and what begins it anew."""
    locator = f"tcp/127.0.0.1:{free_port()}"
    monkeypatch.setenv("TA2_FLEET", locator)
    running = [router(locator)]

    def end():
        running.pop().close()

    def begin():
        until_s = time.monotonic() + WAIT_S
        while not running:
            try:
                running.append(router(locator))
            except zenoh.ZError:
                if time.monotonic() > until_s:
                    raise

    yield locator, end, begin
    for session in running:
        session.close()


def test_a_stop_of_a_gateway_that_does_not_answer_lies_in_its_pipe(fleet, daemon, stranger, monkeypatch):
    """Nobody claims that it was carried out; its guard, where there is one, is asked and says so."""
    asked = []
    monkeypatch.setattr(module, "STOP_S", 0.2)
    monkeypatch.setattr(module, "stop_at_guard", lambda *words: asked.append(words[1]))
    with member(fleet, "r", daemon.socket):
        eventually(lambda: members(stranger), WAIT_S)
        daemon._stopped.set()
        daemon._thread.join()
        assert ask(stranger, "fleet/r/ta2/estop") == {} and asked == ["estop"]
        assert daemon.plane.poll_stops()
        done = type("Done", (), {"undelivered": False})
        monkeypatch.setattr(module, "stop_at_guard", lambda *words: done)
        (answer,) = ask(stranger, "fleet/r/ta2/stop").values()
        assert protocol.decode_reply(answer, protocol.JSON).facts == {"stop_undelivered": False, "by_guard": True}


def test_stops_that_wait_for_the_guard_hold_up_nobody_and_are_answered_at_once(fleet, daemon, stranger, monkeypatch):
    """While it is asked the robot is owned as ever; one more question answers all that came meanwhile, but the old."""
    asked, go_on, done = [], threading.Event(), type("Done", (), {"undelivered": False})

    def guard(*words):
        asked.append(words[1])
        assert go_on.wait(WAIT_S)
        return done

    class Waiting:
        key, encoding = protocol.STOP_KEY, protocol.JSON

        def __init__(self, age_ns=0):
            self.received_ns, self.told = time.monotonic_ns() - age_ns, []

        def answer(self, payload, encoding):
            self.told.append("answered")

        def drop(self):
            self.told.append("dropped")

    monkeypatch.setattr(module, "stop_at_guard", guard)
    with member(fleet, "r", daemon.socket) as made:
        eventually(lambda: members(stranger), WAIT_S)
        made._stops.put(Waiting())
        eventually(lambda: asked, WAIT_S)
        wanted = structs.replace(command(protocol.Acquire(name="far", pid=1)), secret="s3cret")
        assert ask(stranger, f"fleet/r/{protocol.COMMAND_KEY}", protocol.encode(wanted, protocol.JSON))
        monkeypatch.setattr(module, "STOP_KEPT_NS", 3_600_000_000_000)
        late, young = [Waiting(age_ns=7_200_000_000_000)], [Waiting() for _ in range(50)]
        for waiting in (*late, *young):
            made._stops.put(waiting)
        go_on.set()
        eventually(lambda: all(waiting.told for waiting in (*late, *young)), WAIT_S)
        assert {waiting.told[0] for waiting in late} == {"dropped"} and len(asked) == 2
        assert {waiting.told[0] for waiting in young} == {"answered"}


class _Router:
    """A fleet's router that notes who is heard there: his id, by subscriber."""

    def __init__(self):
        self.heard = set()

    def declare_subscriber(self, key, take):
        router, name = self, (key.split("/")[3], key)

        class Subscriber:
            def undeclare(self):
                router.heard.remove(name)

        self.heard.add(name)
        return Subscriber()


class _Question:
    encoding = protocol.JSON

    def __init__(self):
        self.told = []

    def answer(self, payload, encoding):
        self.told.append(payload)


@pytest.mark.parametrize("are_there", [True, False])
def test_whoever_is_given_the_robot_is_heard_however_many_had_it_before(are_there):
    """And no stop endpoint's silence, nor the owner's, comes from here, while he is there and has not left."""
    robot = module.Member(protocol.parse_address("tcp/h:1"), "r", Path("/gw.sock"))
    robot._fleet = _Router()
    yes, no = (
        protocol.encode(protocol.Reply(request_id=1, refusal=refusal), protocol.JSON)
        for refusal in (None, protocol.RefusalMessage(code="X", message="x"))
    )

    def ask(client_id, request, answer=yes):
        robot._tokens[protocol.client_token(client_id)] = None
        asked = structs.replace(command(request, client_id=client_id), secret="s")
        question = _Question()
        robot._give(question, module._lane_of(asked), request, answer)
        assert question.told == [answer]
        return {client_id for client_id, _ in robot._fleet.heard}

    acquire, endpoint = protocol.Acquire(name="n", pid=1), protocol.RegisterEndpoint(name="n", timeout_ns=10**9)
    assert ask("refused", acquire, no) == set()
    ask("pendant", endpoint)
    ask("left", endpoint)
    ask("left", protocol.LeaveEndpoint())
    owner = ""
    for number in range(2 * module.MOST_LANES):
        before, owner = owner, f"c{number}"
        heard = ask(owner, acquire)
        assert {owner, before, "pendant"} - {""} <= heard and len(heard) <= module.MOST_LANES
    assert "left" not in heard
    if not are_there:
        robot._tokens.clear()
    for number in range(2 * module.MOST_LANES):
        heard = ask(f"e{number}", endpoint)
        ask(f"e{number}", protocol.LeaveEndpoint())
        assert f"e{number}" in heard and len(heard) <= module.MOST_LANES
    assert ({owner, "pendant"} <= heard) == are_there
    assert len(robot._endpoints) <= 1 + are_there


def test_only_so_much_goes_on(monkeypatch):
    """As many at once as in a second, then one as soon as its time has come."""
    now_s = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now_s[0])
    take = module._bucket(10)
    assert [take() for _ in range(12)] == [True] * 10 + [False] * 2
    now_s[0] = 0.15
    assert take() and not take()
    now_s[0] = 100.0
    assert sum(take() for _ in range(100)) == 10


def _has_stopped(daemon, kind):
    return any(isinstance(request, kind) for _, request in daemon.engine.requests)
