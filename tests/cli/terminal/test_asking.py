"""Tests of the question before something moves."""

from __future__ import annotations

import io
import os
import subprocess
import sys

import pytest

from gateway.cli.terminal.asking import confirmed

ASK = """
import fcntl, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
from gateway.cli.terminal.asking import confirmed
print(confirmed())
"""


@pytest.mark.parametrize(("typed", "answer"), [(b"y\n", b"True"), (b"\n", b"False")])
def test_a_person_is_asked_where_stderr_goes_elsewhere(typed, answer):
    """On the terminal, which is where he looks; nothing of it lands in the file."""
    ours, theirs = os.openpty()
    asking = subprocess.Popen(
        [sys.executable, "-c", ASK],
        stdin=theirs,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    os.close(theirs)
    try:
        shown = b""
        while b"[y/N] " not in shown:
            shown += os.read(ours, 1024)  # fails when it ends without a question
        os.write(ours, typed)
        assert asking.communicate(timeout=30) == (answer + b"\n", b"")
    finally:
        asking.kill()
        asking.wait()
        os.close(ours)


def test_with_no_terminal_nobody_is_asked(monkeypatch, capsys):
    """A script goes on."""
    monkeypatch.setattr("sys.stdin", io.StringIO("n\n"))
    assert confirmed()
    assert capsys.readouterr() == ("", "")
