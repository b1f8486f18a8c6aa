"""The black box in a place where somebody else was first."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from gateway.incident.event_log import EventLog
from gateway.incident.folders import own_folder
from gateway.incident.ring import Ring, folder_of
from tests.incident.recorded import an_incident


@pytest.mark.parametrize("name", ["incidents", "incidents/robot", "incidents/robot/ring", "incidents/robot/kept"])
def test_nothing_is_written_where_a_link_leads(name: str, tmp_path: Path) -> None:
    """Whoever may write into the folder of the state could have what we write land elsewhere."""
    place, elsewhere = tmp_path / name, tmp_path / "elsewhere"
    elsewhere.mkdir()
    place.parent.mkdir(parents=True, exist_ok=True)
    place.symlink_to(elsewhere)
    ring = Ring(folder_of(tmp_path / "robot.json"))
    ring.spare_bytes = 0
    for write in (ring.open, lambda: ring.begin({"form": 1}, 0)):
        with pytest.raises(OSError, match="leads elsewhere"):
            write()
    assert not any(elsewhere.iterdir())


def test_events_are_not_written_where_a_link_leads(tmp_path: Path) -> None:
    """Neither by their file nor by its folder."""
    folder, victim = tmp_path / "box", tmp_path / "victim"
    victim.write_text("mine")
    folder.mkdir()
    (folder / "events.jsonl").symlink_to(victim)
    (tmp_path / "link").symlink_to(folder)
    for way in (folder, tmp_path / "link"):
        with pytest.raises(OSError):
            EventLog(way).write(b"line")
    assert victim.read_text() == "mine"


def test_a_folder_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be that one's to change what is in it."""
    monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
    with pytest.raises(OSError, match="no folder of this user"):
        own_folder(tmp_path)


@pytest.mark.parametrize("mask", [0o000, 0o022])
def test_folders_are_for_their_owner_alone(mask: int, tmp_path: Path) -> None:
    """Whatever the mask of the process; one that was open is shut."""
    folder = folder_of(tmp_path / "state" / "robot.json")
    (folder / "ring").mkdir(parents=True)
    before = os.umask(mask)
    try:
        an_incident(folder)
    finally:
        os.umask(before)
    for path in (folder.parent, *folder.parent.rglob("*")):
        assert stat.S_IMODE(path.stat().st_mode) == (0o700 if path.is_dir() else 0o600), path
