"""Tests of `ta2 stop`, `estop` and `recover`."""

from __future__ import annotations

import json

import pytest

from gateway.api.keys import ESTOP_KEY, STOP_KEY
from gateway.api.stop_pipe import StopPipes
from gateway.cli.motion import stopping
from gateway.errors import Code, Disconnected, Refusal
from gateway.messages import requests
from gateway.messages.snapshot import LinkView


@pytest.mark.parametrize(("command", "kind"), [("stop", requests.Stop), ("estop", requests.Estop)])
def test_a_stop_is_one_request_with_reason_and_name(shell, monkeypatch, command, kind):
    """No lease, no question asked; the reason names the person, since the gateway knows no name of a stranger."""
    monkeypatch.setattr(stopping.getpass, "getuser", lambda: "ada")
    ended = shell.run(command, "smoke", "in", "the", "lab")
    ((_, request),) = shell.world.engine.requests
    assert isinstance(request, kind) and request.reason == "smoke in the lab (ada)"
    assert ended.status == 0 and "`ta2 recover`" in ended.out and not ended.err
    assert shell.names == [f"ta2 {command}"]
    assert shell.run(command, "--json").json == {"ok": True, "undelivered": False, "by_guard": False}
    assert shell.world.engine.requests[-1][1].reason == f"ta2 {command} (ada)"


@pytest.mark.parametrize(("command", "key"), [("stop", STOP_KEY), ("estop", ESTOP_KEY)])
def test_a_stop_is_dropped_before_anything_is_connected_to(shell, monkeypatch, tmp_path, command, key):
    """In a crowd it takes seconds to connect, or fails."""
    pipes, dropped = StopPipes(tmp_path / "gw.sock", 0o600), []

    def fail(*_, **__):
        dropped.extend(pipes.read())
        raise Disconnected(Refusal(code=Code.DISCONNECTED, message="crowded"))

    monkeypatch.setattr("gateway.client.connect", fail)
    assert shell.run(command, "--socket", str(tmp_path / "gw.sock"), "smoke").status != 0
    ((arrived, payload),) = dropped
    assert arrived == key
    assert json.loads(payload)["name"] == f"ta2 {command}" and json.loads(payload)["reason"].startswith("smoke")
    pipes.close()


@pytest.mark.parametrize("command", ["stop", "estop"])
def test_no_reason_of_a_shell_keeps_a_stop_away(shell, monkeypatch, tmp_path, command):
    """Bytes that are no UTF-8 come as lone surrogates, of a user's name too: pipe and gateway get the stop all the same."""
    monkeypatch.setattr(stopping.getpass, "getuser", lambda: "j\udcf6rg")
    pipes = StopPipes(tmp_path / "gw.sock", 0o600)
    ended = shell.run(command, "--socket", str(tmp_path / "gw.sock"), "k\udcf6nnte", "x" * 5000)
    ((_, payload),) = pipes.read()
    assert ended.status == 0 and json.loads(payload)["reason"].startswith("k?nnte x")
    assert stopping.signed("k\udcf6nnte") == "k?nnte (j?rg)"
    pipes.close()


@pytest.mark.parametrize("target", ["nonsense", "tcp/127.0.0.1:7448"])
def test_where_there_is_no_pipe_the_connection_is_all(shell, target):
    """A gateway beyond this host; what is no address is refused by whoever connects, which this shell does not."""
    assert shell.run("stop", "--socket", target).status == 0


def test_where_no_socket_can_be_found_there_is_no_guard_to_ask(monkeypatch):
    """What hinders is told by whoever connects."""
    monkeypatch.setenv("TA2_SOCKET", "no-path.sock")
    assert stopping._by_guard("stop", None, "smoke") is None


def test_a_stop_without_a_name_is_a_stop(shell, monkeypatch):
    """An account without a name does not keep anybody from stopping."""

    def nobody():
        raise KeyError("uid not found")

    monkeypatch.setattr(stopping.getpass, "getuser", nobody)
    assert shell.run("stop").status == 0
    assert shell.world.engine.requests[0][1].reason == "ta2 stop"


def test_a_stop_that_did_not_leave_fails_loudly(shell):
    """Without a transport to the robot the reply says so: status 1 and the physical emergency stop."""
    shell.world.engine.show(link=LinkView(up=False, router_zid="", fresh=False, age_ns=None))
    ended = shell.run("estop", "--json")
    assert ended.status == 1 and ended.json["error"]["code"] == "STOP_UNDELIVERED"
    assert ended.err.startswith("STOP_UNDELIVERED: ") and "physical emergency stop" in ended.err


def test_a_stop_without_an_answer_is_unknown(shell):
    """The reply is lost: status 4, and nobody is told that the robot stopped."""
    shell.world.engine.mute.add(requests.Stop)
    ended = shell.run("stop")
    assert ended.status == 4 and ended.err.startswith("OUTCOME_UNKNOWN: ") and not ended.out
    assert "physical emergency stop" in ended.err


def test_recover_tells_what_it_cleared(shell):
    """Cause by cause; nothing latched is fine too."""
    assert shell.run("recover").out == "nothing was held off\n"
    shell.run("stop", "lunch")
    ended = shell.run("recover")
    assert ended.status == 0 and "STOPPED_BY_OTHER: " in ended.out and "lunch" in ended.out
    shell.run("stop")
    assert list(shell.run("recover", "--json").json["cleared"]) == ["STOPPED_BY_OTHER"]


def test_recover_is_refused_while_the_cause_persists(shell):
    """The refusal of the gateway is told as it came."""
    shell.world.engine.refusals[requests.Recover] = Refusal(code=Code.LATCH_PERSISTS, message="FSM is ERROR")
    ended = shell.run("recover")
    assert (
        ended.status == 1 and ended.err.startswith("LATCH_PERSISTS: FSM is ERROR -> ") and "`ta2 recover`" in ended.err
    )
