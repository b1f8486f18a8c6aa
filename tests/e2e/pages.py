"""Pages of the docs, run as a reader runs them: their programs, their commands, and what both print.

How a page is read
    * Its ```` ```python ```` blocks are one session, its ```` ```sh ```` blocks are run by bash and must succeed. They are
      run in their order.
    * `<!-- run: terminals -->` before a block: each line is a command in a terminal of its own, which goes on to the end of
      the page.
    * `<!-- output -->` before a ```` ```text ```` block: what the block before it prints, but for numbers. `...` stands for
      anything, as a line of its own for any lines.
    * `<!-- not run: REASON -->` before a block: it is for a real robot, or for a machine that is not that of a test.

Nothing is added but where robot and gateway are: a port that is free and folders of the test's own.
`python -m tests.e2e.pages PAGE` runs one by hand and renews the pictures that it draws and shows.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from gateway.client import connect
from tests.e2e.system import ROOT, Process, free_port, run_apart, wait_for
from tests.thoroughness import IS_THOROUGH

__all__ = ["Block", "PageBroken", "PageRun", "blocks", "differs", "main"]

DIRECTIVE = re.compile(r"<!-- (run: terminals|output|not run: .+) -->")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)
NUMBER = re.compile(r"[-+]?\d+(\.\d*)?(e[-+]?\d+)?")

BLOCK_S = 60.0
"""No block of a page takes longer [s]."""

SESSION = """
import json, sys, traceback
names = {"__name__": "__main__"}
for line in sys.stdin:
    place, text = json.loads(line)
    try:
        exec(compile(text, place, "exec"), names)
        status = 0
    except BaseException:
        traceback.print_exc(file=sys.stdout)
        status = 1
    print(f"\\x04{status}", flush=True)
"""
"""Runs blocks of Python, one a line of its input, in one namespace; ends the output of each with its status."""


class PageBroken(AssertionError):
    """A block does not do what its page says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """One block of a page.

    Attributes:
        place: Page and line.
        language: As the fence names it.
        directive: From the comment before it; empty when there is none.
        text: What is in it.
    """

    place: str
    language: str
    directive: str
    text: str


def blocks(page: Path) -> Iterator[Block]:
    """Yield the blocks of a page in their order."""
    text = page.read_text(encoding="utf-8")
    for match in FENCE.finditer(text):
        before = text[: match.start()]
        said = DIRECTIVE.fullmatch(before.rstrip().rpartition("\n")[2])
        yield Block(
            place=f"{page.name}:{before.count(chr(10)) + 1}",
            language=match[1],
            directive=said[1] if said else "",
            text=match[2],
        )


def differs(told: str, wanted: str) -> str:
    """Return how an output differs from that of the page, numbers apart; empty when it does not."""
    pattern = "".join(
        r"(?:.*\n)*?" if line == "..." else ".*".join(map(re.escape, line.split("..."))) + r"\n"
        for line in _plain(wanted)
    )
    if re.fullmatch(pattern, "".join(f"{line}\n" for line in _plain(told))):
        return ""
    return f"the page says\n{wanted.strip()}\nand it printed\n{told.strip()}"


def _plain(text: str) -> list[str]:
    """Return lines without what differs from run to run: numbers, and how wide columns are."""
    return [" ".join(NUMBER.sub("N", line).split()) for line in text.strip().splitlines()]


class PageRun:
    """A page that is being run.

    Args:
        page: Which.
        folder: For sockets, logs and what the page writes; its path must be short.
    """

    def __init__(self, page: Path, folder: Path) -> None:
        self._blocks = list(blocks(page))
        self._folder = folder
        self._endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._terminals: list[Process] = []
        self._session: subprocess.Popen[str] | None = None
        programs = folder / "programs"
        programs.mkdir()
        self.environment = {
            "XDG_RUNTIME_DIR": str(folder),
            "TA2_STATE_DIR": str(folder / "state"),
            "PATH": f"{programs}:{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "MPLBACKEND": "Agg",
        }
        self._put(programs / "python", f'exec {sys.executable} "$@"')
        at = f'[ "$1" != sim ] || set -- "$@" --at {self._endpoint}'
        self._put(programs / "ta2", f'{at}\nexec {sys.executable} -m gateway.cli "$@"')

    @staticmethod
    def _put(program: Path, text: str) -> None:
        program.write_text(f"#!/bin/sh\n{text}\n")
        program.chmod(0o755)

    def run(self) -> None:
        """Run all of it.

        Raises:
            PageBroken: A block failed, or printed something else than the page says.
        """
        printed = ""
        for block in self._blocks:
            if block.directive.startswith("not run"):
                printed = ""
            elif block.directive == "output":
                if difference := differs(printed, block.text):
                    raise PageBroken(f"{block.place}: {difference}")
            elif block.directive == "run: terminals":
                self._open_terminals(block.text)
            elif block.language == "sh":
                printed = self._shell(block)
            elif block.language == "python":
                printed = self._python(block)

    def _open_terminals(self, text: str) -> None:
        for line in text.splitlines():
            name, command, *words = shlex.split(line, comments=True)
            assert name == "ta2", f"only ta2 can go on in a terminal: {line}"
            added = {"sim": ["--listen", self._endpoint], "run": ["--robot", self._endpoint]}.get(command, [])
            if (
                command == "run" and not IS_THOROUGH
            ):  # beside other tests a guard rightly ends a daemon that stands still
                added.append("--no-guard")
            arguments = ["-m", "gateway.cli", command, *words, *added]
            self._terminals.append(Process(f"ta2-{command}", arguments, self._folder, self.environment))
            if command == "sim":
                wait_for(lambda: "listening" in self._terminals[-1].text(), "the simulated robot", tell=self.logs)
            if command == "run":
                self._wait_for_life()
        for terminal in self._terminals:
            if terminal.name == "ta2-sim":
                run_apart(terminal.pid)

    def _wait_for_life(self) -> None:
        """Wait as a reader does until the gateway sees the robot: a second or two."""
        socket = str(self._folder / "ta2" / "gateway.sock")
        with wait_for(lambda: connect(socket, timeout_s=1.0), "the gateway", tell=self.logs) as robot:
            seen = lambda: robot.state.link.fresh and robot.state.mode and robot.state.left_arm.model.state == "agrees"  # noqa: E731
            wait_for(seen, "a live robot", tell=self.logs)

    def _shell(self, block: Block) -> str:
        done = subprocess.run(
            ["bash", "-e", "-c", block.text],
            cwd=self._folder,
            env={**os.environ, **self.environment},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=BLOCK_S,
            check=False,
        )
        if done.returncode:
            raise PageBroken(f"{block.place}: status {done.returncode}\n{done.stdout}{done.stderr}{self.logs()}")
        return done.stdout

    def _python(self, block: Block) -> str:
        if self._session is None:
            self._session = subprocess.Popen(
                [sys.executable, "-u", "-c", SESSION],
                cwd=self._folder,
                env={**os.environ, **self.environment},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                start_new_session=True,
            )
        assert self._session.stdin is not None and self._session.stdout is not None
        self._session.stdin.write(json.dumps([block.place, block.text]) + "\n")
        self._session.stdin.flush()
        printed, deadline = "", time.monotonic() + BLOCK_S
        for line in self._session.stdout:
            before, ended, status = line.partition("\x04")
            printed += before
            if ended:
                if int(status):
                    raise PageBroken(f"{block.place}: it failed\n{printed}{self.logs()}")
                return printed
            if time.monotonic() > deadline:
                break
        raise PageBroken(f"{block.place}: it did not end in order\n{printed}{self.logs()}")

    def logs(self) -> str:
        """Return the ends of what the terminals show."""
        return "".join(f"\n--- {terminal.name}\n{terminal.text()[-1500:]}" for terminal in self._terminals)

    def close(self) -> None:
        """End everything that was started."""
        if self._session is not None:
            with contextlib.suppress(
                ProcessLookupError
            ):  # and what a block has started, which would keep the pipe open
                os.killpg(self._session.pid, signal.SIGKILL)
            self._session.communicate()
        for terminal in reversed(self._terminals):
            terminal.end()


def main(names: list[str]) -> int:
    """Run pages; pictures that they draw and show are copied beside them. Return the exit status."""
    for name in names:
        page = Path(name)
        folder = Path(tempfile.mkdtemp(prefix="ta2-"))
        run = PageRun(page, folder)
        try:
            run.run()
        except PageBroken as broken:
            print(broken)
            return 1
        finally:
            run.close()
        for picture in re.findall(r"!\[[^]]*\]\(([\w-]+\.\w+)\)", page.read_text(encoding="utf-8")):
            if (folder / picture).exists():
                shutil.copy(folder / picture, page.parent)
                print(f"{picture}: drawn anew")
        shutil.rmtree(folder)
        print(f"{name}: as it says")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
