"""`ta2 fleet`: which routers are refused, what is said of robots, and when a stop counts as confirmed."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys

import pytest
from rich.console import Console

from gateway.api import protocol
from gateway.cli import fleet
from gateway.cli.main import main
from gateway.errors import Rejected
from tests.api.stand_in import a_snapshot
from tests.e2e.system import free_port

USER = 'auth: { usrpwd: { user: "robot-1", password: "x" } }'
CERTIFIED = 'enable_mtls: true, connect_certificate: "/c", connect_private_key: "/k"'
ROOT = 'root_ca_certificate: "/ca"'


def file_of(tmp_path, endpoints, transport):
    """Return a fleet's file."""
    file = tmp_path / "fleet.json5"
    file.write_text(f"{{ connect: {{ endpoints: {json.dumps(endpoints)} }}, transport: {{ {transport} }} }}")
    return protocol.fleet_address(str(file))


@pytest.mark.parametrize("is_open", [False, True])
@pytest.mark.parametrize(
    ("endpoints", "transport", "goes"),
    [
        (["tls/fleet:7447"], f"{USER}, link: {{ tls: {{ {ROOT} }} }}", (True, False)),
        (["tls/fleet:7447"], f"link: {{ tls: {{ {ROOT}, {CERTIFIED} }} }}", (True, False)),
        (["tcp/127.0.0.1:7447"], USER, (True, False)),
        (["tcp/[::1]:7447"], "", (False, True)),
        (["tcp/localhost:7447?so=1"], "", (False, True)),
        (["tls/fleet:7447"], USER, (False, False)),
        (["tls/fleet:7447"], f"link: {{ tls: {{ {ROOT} }} }}", (False, False)),
        (["tcp/fleet:7447"], USER, (False, False)),
        (["tcp/127.0.0.1.fleet:7447"], USER, (False, False)),
        (["tls/fleet:7447", "tcp/10.0.0.1:7447"], f"{USER}, link: {{ tls: {{ {ROOT} }} }}", (False, False)),
        (["tcp/127.0.0.1:7447", "tcp/10.0.0.1:7447"], "", (False, False)),
        ([], USER, (False, False)),
    ],
)
def test_a_router_at_which_strangers_could_drive_is_refused(tmp_path, endpoints, transport, goes, is_open):
    """The rules of a gateway's own port: TLS beyond this host, somebody known or words that say that all may."""
    address = file_of(tmp_path, endpoints, transport)
    if goes[is_open]:
        fleet.demand_known(address, is_open=is_open)
    else:
        with pytest.raises(Rejected):
            fleet.demand_known(address, is_open=is_open)


def test_a_router_named_on_the_command_line_knows_nobody(monkeypatch, capsys):
    """And a file that is none, a name that is none, and no fleet at all are errors of the command line."""
    monkeypatch.delenv("TA2_FLEET", raising=False)
    for words in (
        ["--fleet", "tcp/127.0.0.1:7447", "robot-1"],
        ["--fleet", "tls/fleet:7447", "robot-1", "--open-to-every-user-of-this-host"],
        ["--fleet", "/nowhere/fleet.json5", "robot-1"],
        ["--fleet", "tcp/127.0.0.1:7447", "robot/1", "--open-to-every-user-of-this-host"],
        ["robot-1"],
    ):
        assert main(["fleet", "join", *words]) == 2, words
    assert capsys.readouterr().err.count("BAD_REQUEST") == 5


REPLIES = {
    "done": protocol.Reply(request_id=1, facts={"stop_undelivered": False}),
    "undelivered": protocol.Reply(request_id=1, facts={"stop_undelivered": True}),
    "silent": protocol.Reply(request_id=1),
    "refused": protocol.Reply(
        request_id=1, refusal=protocol.RefusalMessage(code="X", message=""), facts={"stop_undelivered": False}
    ),
}


@pytest.mark.parametrize(
    ("gateways", "answers", "why"),
    [
        (1, ["done"], ""),
        (0, ["done"], ""),
        (2, ["done", "done"], ""),
        (2, ["done"], "1 of 2"),
        (1, [], "no answer"),
        (0, [], "no robot of that name"),
        (1, ["undelivered"], "no transport"),
        (2, ["done", "undelivered"], "no transport"),
        (1, ["silent"], "no transport"),
        (1, ["refused"], "no transport"),
    ],
)
def test_a_stop_is_confirmed_by_all_of_a_name_or_not_at_all(gateways, answers, why):
    """Whatever is missing, refused or not said is a stop of which nobody knows."""
    found = fleet._unconfirmed(gateways, [protocol.encode(REPLIES[answer], protocol.JSON) for answer in answers])
    assert found.startswith(why) or why in found
    assert bool(found) == bool(why)


def test_an_answer_that_cannot_be_read_confirms_nothing():
    """It may be anybody's."""
    assert fleet._unconfirmed(1, [b"\xff"]) == "its answer cannot be read"


def test_the_list_shows_who_is_there_twice_or_does_not_answer():
    """What comes from the fleet can neither colour nor move the terminal."""
    console = Console(width=120, record=True, markup=False)
    evil = a_snapshot(shown="[red]\x1b[2J")
    console.print(fleet._table(fleet.Counter(a=1, b=2, c=1), {"a": a_snapshot(), "b": evil, "c": None}))
    text = console.export_text()
    assert "READ_ONLY" in text and "2 gateways have this name" in text and "does not answer" in text
    assert "[red]?[2J" in text and "\x1b" not in text


@pytest.mark.parametrize("words", [[], ["--all", "robot-1"], ["*"], ["robot/1"]])
def test_a_stop_says_which_robots(words, monkeypatch, capsys):
    """Nothing is guessed from a command line that names none, or all and one."""
    monkeypatch.setattr(fleet, "_open", lambda *_: contextlib.nullcontext())
    try:
        status = main(["fleet", "stop", *words, "--fleet", "tcp/127.0.0.1:1"])
    except SystemExit as end:
        status = end.code
    assert status == 2


def test_no_reason_keeps_a_stop_away(monkeypatch):
    """Bytes that are no UTF-8 come as lone surrogates: the stop is sent all the same."""

    class Sent(Exception):
        """A fleet that is not there any more when the stop was sent."""

        def put(self, key, payload, **_):
            raise Sent(key, payload)

    monkeypatch.setattr(fleet, "_open", lambda *_: contextlib.nullcontext(Sent()))
    with pytest.raises(Sent) as sent:
        main(["fleet", "stop", "--all", "--fleet", "tcp/127.0.0.1:1", "--reason", "k\udcf6nnte"])
    key, payload = sent.value.args
    assert key == "fleet/*/ta2/stop" and b"k?nnte" in payload


@pytest.mark.parametrize("words", [["list"], ["watch"], ["stop", "--all"]])
def test_ctrl_c_does_not_wait_for_a_router_that_says_nothing(words):
    """Not even while it connects: the time that it may take is over long after this test."""
    with socket.create_server(("127.0.0.1", 0)) as mute:
        fleet_words = ["--fleet", f"tcp/127.0.0.1:{mute.getsockname()[1]}", "--timeout", "600"]
        command = [sys.executable, "-m", "gateway.cli", "fleet", *words, *fleet_words]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            try:
                connection, _ = mute.accept()
                with connection:
                    assert connection.recv(1), "it has begun to ask"
                    process.send_signal(signal.SIGINT)
                    said, _ = process.communicate(timeout=30.0)
            finally:
                process.kill()
    assert process.returncode == 128 + signal.SIGINT and "Traceback" not in said


def test_a_router_that_does_not_answer_leaves_a_stop_unknown(capsys):
    """Status 3, and the only hint that counts."""
    words = ["--fleet", f"tcp/127.0.0.1:{free_port()}", "--timeout", "0.2"]
    assert main(["fleet", "stop", "--all", *words]) == 3
    assert "physical emergency stop" in capsys.readouterr().err
    assert main(["fleet", "list", *words]) == 3
