"""Tests of `ta2 example` and of the examples as texts; what they do at a robot: tests/e2e/test_examples.py."""

from __future__ import annotations

import ast
import importlib
import inspect
import io
import re
import subprocess
import sys
import tokenize
from pathlib import Path

import pytest

from gateway.cli import examples
from gateway.cli.terminal import asking
from gateway.errors import Code, failure
from gateway.examples import EXAMPLES, Example
from tests.cli.shell import Shell

MOST_LINES = 25
NUMBERS = list(EXAMPLES)


@pytest.fixture
def shell(monkeypatch, capsys):
    """A shell whose commands find a scripted engine."""
    return Shell(monkeypatch, capsys)


def source(number):
    """Return the text of an example."""
    return Path(importlib.import_module(EXAMPLES[number].module).__file__).read_text(encoding="utf-8")


def code_lines(text):
    """Return how many lines of a program hold code: no blank lines, comments and docstrings."""
    docstrings = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Module, ast.FunctionDef)) and ast.get_docstring(node) is not None:
            docstrings.update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT):
            lines.update(range(token.start[0], token.end[0] + 1))
    return len({line for line in lines if text.splitlines()[line - 1 : line]} - docstrings)


def test_lines_of_code_are_counted_as_people_count_them():
    """The count that the next test relies on."""
    assert (
        code_lines('"""Doc."""\n\n# note\nx = [\n    1,\n]\n\n\ndef f():\n    """Doc\n    doc."""\n    return 1\n') == 5
    )


@pytest.mark.parametrize("number", NUMBERS)
def test_an_example_is_short_and_needs_the_client_alone(number):
    """At most 25 lines of code; of ours it imports `gateway.client`, else the standard library and numpy."""
    text = source(number)
    assert code_lines(text) <= MOST_LINES
    imported = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            imported.update(name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            imported.add(node.module)
    foreign = {name for name in imported if name.partition(".")[0] not in sys.stdlib_module_names}
    assert foreign <= {"gateway.client", "gateway.client.aio", "numpy"}


@pytest.mark.parametrize("number", NUMBERS)
def test_an_example_says_what_it_is_and_what_it_needs(number):
    """The docstring names the section; `main` takes the gateway's address, as the command line of the program does."""
    module = importlib.import_module(EXAMPLES[number].module)
    assert module.__doc__.startswith(f"Manual §{number}: ") and " Needs " in module.__doc__
    assert list(inspect.signature(module.main).parameters) == ["target"]
    assert source(number).endswith('if __name__ == "__main__":\n    main(*sys.argv[1:])\n')


def test_the_examples_need_no_more_than_the_client():
    """Whoever has a container with zenoh, msgspec and numpy can run them: nothing else is loaded."""
    script = (
        "import sys, importlib; from gateway.examples import EXAMPLES\n"
        "for example in EXAMPLES.values(): importlib.import_module(example.module)\n"
        "print(sorted(m for m in sys.modules if m.startswith(('gateway.', 'cdr_types', 'ruckig', 'rich', 'pycdr2'))))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    allowed = (
        "gateway.client",
        "gateway.api",
        "gateway.errors",
        "gateway.codes",
        "gateway.messages",
        "gateway.process.callbacks",
        "gateway.process.threads",
        "gateway.process.zenoh_words",
        "gateway.values",
        "gateway.examples",
    )
    loaded = set(ast.literal_eval(done.stdout)) - {"gateway.process"}  # the room of these three
    assert [name for name in loaded if not name.startswith(allowed)] == []


def test_the_examples_are_listed(shell):
    """Without a number: which there are, what each needs and does."""
    ended = shell.run("example")
    assert ended.status == 0
    for number, example in EXAMPLES.items():
        assert f"{number}  {example.title}: {example.effect}\n" in ended.out and example.needs in ended.out


@pytest.mark.parametrize("number", NUMBERS)
def test_an_example_is_shown_as_it_stands(shell, number):
    """`--show` prints the program, ready to be copied into a file; nothing is connected."""
    ended = shell.run("example", number, "--show")
    assert ended.status == 0 and ended.out == source(number) and shell.names == []


@pytest.mark.parametrize("more", [[], ["--show"]])
def test_an_unknown_example_is_refused_with_those_there_are(shell, more):
    """A wrong number is refused before anything is connected."""
    ended = shell.run("example", "6.8", *more)
    assert ended.status == 1 and "6.6" in ended.err and "BAD_REQUEST" in ended.err and shell.names == []


@pytest.fixture
def ran(monkeypatch):
    """Put a program in the place of an example; it remembers what it was run with."""
    calls = []
    module = type(sys)("an_example")
    module.main = calls.append
    monkeypatch.setitem(sys.modules, "an_example", module)
    entry = Example(module="an_example", title="t", needs="nothing", effect="it does nothing")
    monkeypatch.setattr(examples, "EXAMPLES", {"6.0": entry})
    return calls


def test_an_example_is_run_with_the_gateway_that_was_named(shell, ran):
    """What it does and needs is said first; then it runs as a program of its own would."""
    ended = shell.run("example", "6.0", "--socket", "/tmp/x.sock")
    assert ended.status == 0 and ran == ["/tmp/x.sock"]
    assert "it does nothing" in ended.err and "needs nothing" in ended.err
    assert shell.run("example", "6.0").status == 0 and ran == ["/tmp/x.sock", None]


def test_one_that_is_refused_is_not_told_of_an_option_that_it_has_not(shell, ran, monkeypatch):
    """An example has no --take."""

    def refuse(target):
        raise failure(Code.LEASE_HELD, "'ann' owns the robot")

    monkeypatch.setattr(sys.modules["an_example"], "main", refuse)
    ended = shell.run("example", "6.0", "--yes")
    assert ended.status == 1 and ended.err.endswith("owns the robot -> wait until it is free\n")


@pytest.mark.parametrize(("agrees", "words", "runs"), [(False, [], 0), (True, [], 1), (False, ["--yes"], 1)])
def test_a_person_is_asked_before_anything_moves(shell, ran, monkeypatch, agrees, words, runs):
    """At a terminal, no means no; --yes was said before."""
    monkeypatch.setattr(examples, "confirmed", lambda: agrees)
    ended = shell.run("example", "6.0", *words)
    assert len(ran) == runs and ended.status == (0 if runs else 1)
    assert ("nothing was done" in ended.err) is (runs == 0)


def test_where_nobody_sits_nobody_is_asked(monkeypatch):
    """In a script the command line has said it all."""
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    assert asking.confirmed()


def test_the_docs_show_two_examples_as_they_stand():
    """What a reader copies out of the page is what is tested, to the letter."""
    page = (Path(__file__).parents[2] / "docs/how-to/examples.md").read_text(encoding="utf-8")
    shown = [block for block in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL) if "Manual §" in block]
    assert len(shown) == 2 and {source(number) for number in NUMBERS} >= set(shown)
