"""`ta2 completion`: what real shells offer when a person asks them to complete a command line."""

from __future__ import annotations

import argparse
import fcntl
import os
import select
import shutil
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest

from gateway.cli.command_line.arguments import parser
from gateway.cli.command_line.first_arguments import SHELLS
from gateway.cli.completion import FILES, FOLDERS
from tests.cli.shell import Shell

DEADLINE_S = 30.0
BASH = """
source "$1"
read -ra COMP_WORDS <<< "$2"
[[ $2 != *' ' ]] || COMP_WORDS+=("")
COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
_shtab_ta2
printf '%s\\n' "${COMPREPLY[@]}"
"""
"""What readline does on a tab."""
ZSH = """fpath=($PWD $fpath); autoload -U compinit; compinit -D -u; LISTMAX=999; unset zle_bracketed_paste; PS1="READ""Y "\n"""
"""Typed at an interactive zsh: completion that writes no file, and a prompt that shows that all is done."""
CTRL_D, CTRL_U = "\x04", "\x15"
"""List what there is; forget the line."""


def offered_by_bash(script: Path, line: str) -> set[str]:
    """Return what bash would write or list."""
    words = ["bash", "--norc", "-c", BASH, "bash", str(script), line]
    return set(_output_of(words, script.parent).split())


def offered_by_fish(script: Path, line: str) -> set[str]:
    """Return what fish would list, without the descriptions."""
    words = ["fish", "--no-config", "-c", 'source $argv[1]; complete -C "$argv[2]"', str(script), line]
    return {each.partition("\t")[0] for each in _output_of(words, script.parent).splitlines()}


def offered_by_zsh(script: Path, line: str) -> set[str]:
    """Return the words on the screen after zsh was asked for a list."""
    terminal, inside = os.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 200, 200, 0, 0))
    zsh = subprocess.Popen(
        ["zsh", "-f", "-i"],
        cwd=script.parent,
        env={**os.environ, "TERM": "dumb"},
        stdin=inside,
        stdout=inside,
        stderr=inside,
        start_new_session=True,
    )
    os.close(inside)
    try:
        os.write(terminal, ZSH.encode())
        _read_until(terminal, "READY ")
        os.write(terminal, (line + CTRL_D + CTRL_U + "print DO''NE\n").encode())
        screen = _read_until(terminal, "DONE\r\n")
    finally:
        zsh.kill()
        zsh.wait()
        os.close(terminal)
    return set(screen.rpartition(line)[0].split())


OFFERED = {"bash": offered_by_bash, "zsh": offered_by_zsh, "fish": offered_by_fish}


def _output_of(words: list[str], folder: Path) -> str:
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=DEADLINE_S, check=True)
    assert not done.stderr
    return done.stdout


def _read_until(terminal: int, mark: str) -> str:
    text, deadline = "", time.monotonic() + DEADLINE_S
    while mark not in text:
        assert time.monotonic() < deadline, text
        if select.select([terminal], [], [], 0.1)[0]:
            text += os.read(terminal, 65536).decode(errors="replace")
    return text


@pytest.fixture(params=SHELLS)
def offered(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch, capsys):
    """Return what a shell offers for a line, in a folder with a file and a folder."""
    if shutil.which(request.param) is None:
        pytest.skip(f"no {request.param} here (Debian, Ubuntu: apt install {request.param})")
    ended = Shell(monkeypatch, capsys).run("completion", request.param)
    assert ended.status == 0 and not ended.err
    script = tmp_path / "_ta2"  # where zsh looks for it, by this name
    script.write_text(ended.out)
    (tmp_path / "settings.toml").touch()
    (tmp_path / "pictures").mkdir()
    return lambda line: OFFERED[request.param](script, line)


@pytest.mark.parametrize(
    ("line", "wanted", "unwanted"),
    [
        ("ta2 st", {"status", "stop", "stop-endpoint"}, {"estop", "run", "settings.toml"}),
        ("ta2 stop --", {"--help", "--socket", "--at", "--timeout", "--json"}, {"--speed", "--version"}),
        ("ta2 run --model ", {"lite", "standard", "lift"}, {"settings.toml", "--config"}),
        ("ta2 sim --mode p", {"pose"}, {"joint"}),
        ("ta2 sim st", {"stats"}, {"status", "stop"}),
        ("ta2 gripper r", {"right"}, {"left"}),
        ("ta2 completion ", {"bash", "zsh", "fish"}, {"settings.toml"}),
        ("ta2 run --config s", {"settings.toml"}, {"pictures/"}),
        ("ta2 status --socket s", {"settings.toml"}, {"pictures/"}),
        ("ta2 follow s", {"settings.toml"}, {"pictures/"}),
        ("ta2 video split --out p", {"pictures/"}, {"settings.toml"}),
    ],
)
def test_a_shell_offers_commands_options_choices_and_paths(offered, line, wanted, unwanted):
    """Those that are possible there, and no others."""
    found = offered(line)
    found |= {f"{each}/" for each in found if each == "pictures"}  # bash adds it when it writes the word
    assert wanted <= found and not unwanted & found


def test_whatever_takes_a_path_is_shown_by_a_name_that_completion_knows():
    """What is read as a path, at every depth of the parser."""

    def paths(of: argparse.ArgumentParser) -> list[argparse.Action]:
        subs = [
            sub for each in of._actions if isinstance(each, argparse._SubParsersAction) for sub in each.choices.values()
        ]
        named = ("config", "urdf", "calibration", "plot", "out", "sheet", "record", "file", "folder", "show", "check")
        own = [each for each in of._actions if each.nargs != 0 and (each.type is Path or each.dest in named)]
        return [*own, *(each for sub in subs for each in paths(sub))]

    found = paths(parser())
    assert len(found) > 20 and {each.metavar for each in found} <= FILES | FOLDERS


def test_without_the_library_it_says_what_to_install(monkeypatch, capsys):
    """A slim installation of the client alone has none."""
    monkeypatch.setitem(sys.modules, "shtab", None)
    ended = Shell(monkeypatch, capsys).run("completion", "bash")
    assert (
        ended.status == 1
        and not ended.out
        and ended.err == "BAD_REQUEST: shtab is not installed -> pip install shtab\n"
    )


def test_completion_costs_other_commands_nothing():
    """Its library is imported by nobody else."""
    program = "import sys, gateway.cli.main as c; c.parse(['status']); assert 'shtab' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], check=True, timeout=DEADLINE_S)
