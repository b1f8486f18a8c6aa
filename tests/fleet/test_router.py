"""The router's file on the how-to page: what it lets through, and what not."""

from __future__ import annotations

import pytest
import zenoh

from gateway.api import protocol
from gateway.client import connect
from gateway.client.connection.over_zenoh import Credentials, client_configuration
from gateway.errors import Disconnected
from gateway.fleet.member import Member
from tests.api.daemon import Daemon, eventually
from tests.e2e.system import free_port
from tests.fleet.fleets import files_of_the_page, member

pytestmark = pytest.mark.e2e

WAIT_S = 30.0


@pytest.fixture
def way(tmp_path):
    """A router as on the page, but for its listener on loopback; returns what makes a user's file."""
    locator, users = f"tcp/127.0.0.1:{free_port()}", tmp_path / "users"
    users.write_text("robot-1:one\nann:two\n")
    file, theirs = tmp_path / "router.json5", files_of_the_page()
    file.write_text(theirs[1].replace("/etc/ta2/fleet-users", str(users)).replace("tls/0.0.0.0:7447", locator))
    config = zenoh.Config.from_file(str(file))
    config.insert_json5("scouting/delay", "0")

    def file_of(user, password):
        own = tmp_path / f"{user}.json5"
        text = (
            theirs[0].replace("tls/fleet.lab:7447", locator).replace("robot-1", user).replace('"..."', f'"{password}"')
        )
        own.write_text(text)
        return str(own)

    with zenoh.open(config):
        yield file_of


def session_of(file, robot=""):
    """Return a plain session of a user."""
    address = protocol.Address(locator="", file=file, robot=robot)
    return zenoh.open(client_configuration(address, Credentials(), 5.0))


def test_a_robot_serves_and_a_client_owns_it_and_nobody_else_hears_its_secret(way, tmp_path, monkeypatch):
    """Users get in with their password, robots alone take what is said to robots or speak for them."""
    ann = way("ann", "two")
    monkeypatch.setenv("TA2_FLEET", ann)
    with pytest.raises(zenoh.ZError):
        session_of(way("eve", "x"))
    heard, said, passed = [], [], []
    real = Member._on_lane
    monkeypatch.setattr(Member, "_on_lane", lambda *of: (passed.append(str(of[2].key_expr)), real(*of)))

    def take(sample):
        heard.append(str(sample.key_expr))
        said.append(sample.payload.to_bytes())

    with (
        Daemon(tmp_path) as daemon,
        member(way("robot-1", "one"), "robot-1", daemon.socket),
        session_of(ann) as spy,
        session_of(ann) as liar,
    ):
        for key in ("**", protocol.KEEPALIVE_KEYS, protocol.TARGET_KEYS, protocol.EVENT_KEY, protocol.SNAPSHOT_KEY):
            spy.declare_subscriber(f"fleet/*/{key}", zenoh.handlers.Callback(take, indirect=False))
        false = liar.liveliness().declare_token("fleet/robot-1/ta2/1/alive/member/ff")
        spy.declare_queryable("fleet/robot-1/ta2/1/command", lambda query: heard.append("command"))
        robot = eventually(_connected, WAIT_S)
        with robot, robot.control() as own:
            own.enable(timeout=10.0)
            eventually(lambda: robot.state.lease.owned and f"fleet/robot-1/{protocol.SNAPSHOT_KEY}" in heard, WAIT_S)
            liar.put(f"fleet/robot-1/{protocol.EVENT_KEY}", b"LIE")
            assert [reply.ok for reply in liar.get("fleet/robot-1/ta2/stop", timeout=5.0)] != []
            secret = daemon.plane._inbox.identities.secret_of(robot.client_id)
            for key in protocol.lane_keys(robot.client_id, secret):
                for guess in (f"{secret[0]}$*", f"$*{secret[-1]}", f"{secret[:9]}$*{secret[20:]}", "*"):
                    liar.put(f"fleet/robot-1/{key.removesuffix(secret)}{guess}".replace("/*/", "/1/"), b"")
            assert [reply.ok for reply in liar.get("fleet/robot-1/ta2/stop", timeout=5.0)] != []  # behind all of these
            assert protocol.keepalive_key(robot.client_id, secret) in passed
            assert not [key for key in passed if "*" in key], "it tells how the secret is spelt"
            (found,) = spy.liveliness().get(f"fleet/*/{protocol.MEMBER_TOKENS}", timeout=5.0)
            assert not str(found.ok.key_expr).endswith("/ff")
        del false
    assert set(heard) <= {f"fleet/robot-1/{key}" for key in (protocol.SNAPSHOT_KEY, protocol.EVENT_KEY)}
    assert b"LIE" not in said


def _connected():
    try:
        return connect("robot-1", timeout_s=2.0)
    except Disconnected:
        return None
