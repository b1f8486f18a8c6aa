"""Tests of `ta2 incident` and `ta2 why --since`: files in, lines, a page and a status out."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from gateway.cli.command_line.arguments import parse
from gateway.cli.looking import boxes, incident
from gateway.cli.main import main
from gateway.incident import recorder as recorder_module
from gateway.incident import ring as ring_module
from gateway.settings import toml_file
from tests.incident.recorded import an_incident


@pytest.fixture(scope="module")
def state(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a state folder with one incident."""
    folder = tmp_path_factory.mktemp("state")
    an_incident(folder / "incidents" / "tcp_robot-1234", seconds=0.5)
    return folder


@pytest.fixture(autouse=True)
def here(state: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the commands find it."""
    monkeypatch.setenv("TA2_STATE_DIR", str(state))


def test_an_incident_is_listed_shown_and_replayed_by_its_name(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Or without one: the newest."""
    assert main(["incident", "list", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["code"] == "ESTOP" and row["robot"] == "tcp_robot-1234" and row["bytes"] > 1000
    assert main(["incident", "list"]) == 0 and row["name"] in capsys.readouterr().out
    for name in (row["name"], str(state / "incidents" / row["robot"] / "kept" / row["name"])):
        assert main(["incident", "replay", name]) == 0
        assert "identical, bit by bit" in capsys.readouterr().out
    assert main(["incident", "replay", "--json"]) == 0
    done = json.loads(capsys.readouterr().out)
    assert done["is_identical"] and done["frames"] > 0 and not done["other_release"]


def test_it_shows_what_was_asked_and_told_around_the_cause(capsys: pytest.CaptureFixture[str]) -> None:
    """In its order, in seconds from what it was kept for; names, not numbers, of clients."""
    assert main(["incident", "show"]) == 0
    out = capsys.readouterr().out
    assert "kept for ESTOP: latched ESTOP" in out
    assert re.search(r"-\d\.\d\d s  Move by user\n", out) and re.search(r"\+0\.00 s  LATCH_CHANGED: latched ESTOP", out)
    assert main(["incident", "show", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["release"]["code"] and shown["causes"][0]["code"] == "ESTOP"
    times = [line["t_s"] for line in shown["timeline"]]
    assert times == sorted(times) and {"request", "notice"} <= {line["kind"] for line in shown["timeline"]}


def test_a_reader_who_has_enough_is_no_fault_of_the_incident(monkeypatch: pytest.MonkeyPatch) -> None:
    """`ta2 incident show | head -1`: a broken pipe is an OSError, too, and ends the command as everywhere."""

    def show(*_: object) -> None:
        raise BrokenPipeError

    monkeypatch.setattr(incident, "_show", show)
    with pytest.raises(BrokenPipeError):
        incident.carry_out(parse(["incident", "show"]))


def test_the_page_stands_alone_and_says_nothing_as_html(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No script, no address; both lines of each joint."""
    page = tmp_path / "page.html"
    assert main(["incident", "show", "--html", str(page)]) == 0
    text = page.read_text()
    assert not re.search(r"<script|https?:|src=|href=|url\(", text) and "default-src 'none'" in text
    assert text.count("<svg") == 14 and text.count("class=set d=") == text.count("class=is d=") == 14
    assert main(["incident", "show", "--html", str(tmp_path / "nowhere" / "page.html")]) == 1
    assert "BAD_REQUEST" in capsys.readouterr().err


def test_another_release_is_named_before_its_replay(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It may well be the same: then the status is 0 all the same."""
    here = recorder_module.release()
    monkeypatch.setattr("gateway.cli.looking.incident.release", lambda: {**here, "ta2": "9.9.9"})
    assert main(["incident", "replay"]) == 0
    assert capsys.readouterr().out.startswith("recorded by another release: ta2 ")


def test_what_was_changed_is_not_the_same(state: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Status 1 with the first difference; what is no incident at all is refused."""
    (kept,) = (state / "incidents").glob("*/kept/*")
    other = tmp_path / "other"
    shutil.copytree(kept, other)
    box = sorted(other.glob("*.box"))[0]
    head, _ = box.read_bytes().split(b"\n", 1)
    box.write_bytes(head + b"\n")
    assert main(["incident", "replay", str(other)]) == 1
    assert "nothing to replay" in capsys.readouterr().out
    box.write_bytes(b"{}\n")
    assert main(["incident", "replay", str(other)]) == 1
    assert "is no piece of a black box" in capsys.readouterr().err
    assert main(["incident", "show", "nope"]) == 1
    assert "ta2 incident list" in capsys.readouterr().err
    assert main(["incident", "list", "--dir", str(tmp_path)]) == 0 and "no incident is kept" in capsys.readouterr().out


def test_why_prints_what_was_told_since(capsys: pytest.CaptureFixture[str]) -> None:
    """Without a gateway."""
    assert main(["why", "--since", "30d"]) == 0
    assert "error  LATCH_CHANGED: latched ESTOP" in capsys.readouterr().out
    assert main(["why", "--since", "1h", "--json"]) == 0
    for line in capsys.readouterr().out.splitlines():
        assert {"t", "event", "code", "message", "robot"} <= json.loads(line).keys()


def test_the_black_box_of_a_service_is_looked_at_too(
    state: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As its socket is, unless a folder is named. Where it cannot be read nobody is told that nothing was."""
    monkeypatch.delenv("TA2_STATE_DIR")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(toml_file, "SERVICE_STATE", state)
    for words in (("why", "--since", "30d"), ("incident", "list"), ("incident", "show")):
        assert main([*words]) == 0 and "ESTOP" in capsys.readouterr().out
    (tmp_path / "incidents").write_text("no folder")
    monkeypatch.setattr(toml_file, "SERVICE_STATE", tmp_path)
    for words in (("why", "--since", "30d"), ("incident", "list"), ("incident", "show")):
        assert main([*words]) == 1
        assert f"{tmp_path / 'incidents'} cannot be read: look as its user" in capsys.readouterr().err
    monkeypatch.setattr(toml_file, "SERVICE_STATE", state)
    with monkeypatch.context() as closed:  # each robot's folder is its gateway's alone
        closed.setattr(boxes.os, "access", lambda path, mode: False)
        for words in (("why", "--since", "30d"), ("incident", "list"), ("incident", "show")):
            assert main([*words]) == 1 and f"{state / 'incidents'}/" in capsys.readouterr().err
    monkeypatch.setattr(toml_file, "SERVICE_STATE", tmp_path / "none")
    for words in (("why", "--since", "30d"), ("incident", "list")):
        assert main([*words]) == 0
        ended = capsys.readouterr()
        assert not ended.err and all(str(tmp_path / part / "incidents") in ended.out for part in ("home/ta2", "none"))


@pytest.mark.parametrize("span", ["1x", "h", "-1h", "0s", "nan", "400d"])
def test_what_is_no_span_of_time_is_refused(span: str, capsys: pytest.CaptureFixture[str]) -> None:
    """With what one looks like."""
    with pytest.raises(SystemExit) as ended:
        main(["why", f"--since={span}"])
    assert ended.value.code == 2
    assert f"{span!r} is no time such as 90s, 10m, 1h, 2d, at most 31d" in capsys.readouterr().err


def test_the_ring_has_a_name_beside_the_state_file() -> None:
    """One folder for each robot."""
    assert ring_module.folder_of(Path("/x/tcp_a-1.json")) == Path("/x/incidents/tcp_a-1")
