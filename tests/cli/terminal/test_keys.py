"""Tests of the keys of a terminal that records, through a pseudo-terminal."""

from __future__ import annotations

import fcntl
import os
import pty
import subprocess
import sys
import termios

from gateway.cli.terminal.keys import keys

READER = """
from gateway.cli.terminal.keys import keys
with keys() as pressed:
    print("ready" if pressed.are_there else "nobody", flush=True)
    typed = ""
    while pressed.are_there and "q" not in typed:
        typed += pressed.wait(0.05)
print(repr(typed), flush=True)
"""


CHANGED = READER.replace(
    "    typed =",
    "    import termios\n    mode = termios.tcgetattr(0)\n    mode[3] |= termios.ICANON | termios.ECHO\n"
    "    termios.tcsetattr(0, termios.TCSANOW, mode)\n    pressed.renew()\n    print('renewed', flush=True)\n    typed =",
)
"""The same, whose terminal somebody changes meanwhile."""


def reading(theirs, *, owns_it, program=READER):
    """Return a process that reads keys from a terminal, which it controls or only has open."""

    def take():
        os.setsid()
        fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

    command = [sys.executable, "-c", program]
    return subprocess.Popen(
        command,
        stdin=theirs,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=take if owns_it else None,
        pass_fds=[theirs],
    )


def test_keys_are_taken_one_by_one_and_the_terminal_is_given_back():
    """Without Enter and unechoed, in lower case."""
    ours, theirs = pty.openpty()
    try:
        before = termios.tcgetattr(theirs)
        reader = reading(theirs, owns_it=True)
        assert reader.stdout.readline() == "ready\n"
        assert not termios.tcgetattr(theirs)[3] & (termios.ICANON | termios.ECHO)
        os.write(ours, b" Sm")
        os.write(ours, b"q")
        assert reader.communicate(timeout=30)[0] == "' smq'\n" and reader.returncode == 0
        assert termios.tcgetattr(theirs) == before
    finally:
        os.close(ours)
        os.close(theirs)


def test_single_keys_come_again_from_a_terminal_that_a_shell_has_changed():
    """As it does while a process is stopped."""
    ours, theirs = pty.openpty()
    try:
        reader = reading(theirs, owns_it=True, program=CHANGED)
        assert [reader.stdout.readline() for _ in range(2)] == ["ready\n", "renewed\n"]
        os.write(ours, b"sq")
        assert reader.communicate(timeout=30)[0] == "'sq'\n" and reader.returncode == 0
    finally:
        os.close(ours)
        os.close(theirs)


def test_a_terminal_of_somebody_else_is_let_alone():
    """One that others control, as in the background: asking it for keys would stop this process."""
    ours, theirs = pty.openpty()
    try:
        before = termios.tcgetattr(theirs)
        reader = reading(theirs, owns_it=False)
        assert reader.communicate(timeout=30)[0] == "nobody\n''\n"
        assert termios.tcgetattr(theirs) == before
    finally:
        os.close(ours)
        os.close(theirs)


def test_where_there_is_no_terminal_nothing_is_pressed(monkeypatch):
    """It only waits."""
    with open(os.devnull) as nothing, keys() as pressed:
        monkeypatch.setattr("sys.stdin", nothing)
        assert not pressed.are_there and pressed.wait(0.0) == ""
