"""The file of users: what stands in it, who may read it, and what is refused of it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.errors import Rejected
from gateway.web import users
from gateway.web.users import add_user, is_password, read_users

PASSWORD = "correct horse battery"


@pytest.fixture(autouse=True)
def cheap(monkeypatch: pytest.MonkeyPatch) -> None:
    """A guess costs nothing here."""
    monkeypatch.setattr(users, "COST", "16:8:1")
    monkeypatch.setattr(users, "NOBODY", f"16:8:1:{'00' * 16}:{'00' * 32}")


def test_a_password_is_known_again_and_stands_nowhere(tmp_path: Path) -> None:
    """The file is its owner's alone; the same password twice is not seen to be the same."""
    file = tmp_path / "users"
    add_user(file, "ann", PASSWORD)
    add_user(file, "bob", PASSWORD)
    kept = read_users(file)
    assert list(kept) == ["ann", "bob"] and kept["ann"] != kept["bob"]
    assert PASSWORD not in file.read_text() and file.stat().st_mode & 0o777 == 0o600
    assert is_password(PASSWORD, kept["ann"]) and not is_password(f"{PASSWORD}x", kept["ann"])
    assert [path.name for path in tmp_path.iterdir()] == ["users"]


def test_nobody_gets_in_by_a_name_that_is_not_there() -> None:
    """Whatever the password; it takes as long."""
    assert not is_password(PASSWORD, None) and not is_password("\ud800", None)


def test_another_password_takes_the_place_of_the_first(tmp_path: Path) -> None:
    """Who is taken out of the file is gone."""
    file = tmp_path / "users"
    for password in (PASSWORD, "another password"):
        add_user(file, "ann", password)
    kept = read_users(file)["ann"]
    assert is_password("another password", kept) and not is_password(PASSWORD, kept)


def test_it_costs_what_one_guess_should() -> None:
    """At least what is recommended for scrypt in 2024: 32 MiB, thrice."""
    n, r, p = map(int, "32768:8:3".split(":"))
    assert 128 * n * r == 32 * 2**20 and p == 3
    line = f"ann:32768:8:3:{'00' * 16}:{'00' * 32}"
    assert users.LINE.fullmatch(line)
    assert not is_password(PASSWORD, line.partition(":")[2])  # it may take that memory


@pytest.mark.parametrize(
    ("name", "password", "told"),
    [
        ("", PASSWORD, "cannot be a user's name"),
        ("a:b", PASSWORD, "cannot be"),
        ("a\nb", PASSWORD, "cannot be"),
        ("-a", PASSWORD, "cannot be"),
        ("a" * 33, PASSWORD, "cannot be"),
        ("ann", "short", "5 characters"),
        ("ann", "x" * 1001, "1001 characters"),
    ],
)
def test_what_is_no_user_is_refused_and_nothing_written(tmp_path: Path, name: str, password: str, told: str) -> None:
    """The line could be read as another one; the password guessed."""
    with pytest.raises(Rejected, match=told):
        add_user(tmp_path / "users", name, password)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["nonsense", "ann:1:2", "ann::::", f"ann:0:0:0:{'00' * 15}:00", "\n", "ann"])
def test_a_line_that_is_wrong_lets_nobody_in(tmp_path: Path, text: str) -> None:
    """Also not those in other lines: nobody knows what was meant."""
    file = tmp_path / "users"
    add_user(file, "ann", PASSWORD)
    before = file.read_text()
    file.write_text(before + text + "\n")
    with pytest.raises(Rejected, match="a line is wrong"):
        read_users(file)
    file.write_text(before * 2)
    with pytest.raises(Rejected, match="there twice"):
        read_users(file)


def test_a_file_that_is_not_there_is_told_in_plain_words(tmp_path: Path) -> None:
    """With the command that makes it."""
    with pytest.raises(Rejected, match=r"nofile: No such file or directory") as caught:
        read_users(tmp_path / "nofile")
    assert "--add-user" in caught.value.hint and "Errno" not in caught.value.message


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o602])
def test_a_file_that_others_may_use_is_refused(tmp_path: Path, mode: int) -> None:
    """With the command that mends it."""
    file = tmp_path / "users"
    add_user(file, "ann", PASSWORD)
    file.chmod(mode)
    with pytest.raises(Rejected, match=f"mode {mode:o}") as caught:
        read_users(file)
    assert "chmod 600" in caught.value.hint


def test_a_file_that_is_not_there_or_no_text_is_refused(tmp_path: Path) -> None:
    """And one in a folder that is not there cannot be written."""
    for path, data in ((tmp_path / "none", None), (tmp_path / "bytes", b"\xff\xfe")):
        if data is not None:
            path.write_bytes(data)
            path.chmod(0o600)
        with pytest.raises(Rejected, match="users in"):
            read_users(path)
    with pytest.raises(Rejected, match="users in"):
        add_user(tmp_path / "no" / "users", "ann", PASSWORD)


def test_a_disk_that_fails_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole, and nothing beside it."""
    file = tmp_path / "users"
    add_user(file, "ann", PASSWORD)
    before = file.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(Rejected, match="No space left"):
        add_user(file, "bob", PASSWORD)
    assert file.read_bytes() == before and [path.name for path in tmp_path.iterdir()] == ["users"]
