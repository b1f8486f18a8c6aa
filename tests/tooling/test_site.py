"""The pages that are made for the site of the docs leave nothing out, and their links lead somewhere on the site.

Whether the site can be built without a warning is asked by `bin/docs`, in an environment of its own.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from typing import get_args

import msgspec
import pytest

from gateway import client
from gateway.cli.command_line.arguments import parser
from gateway.messages.requests import Request
from gateway.settings.toml_file import KEYS
from tests.tooling.site import client_page, commands_page, protocol_page, settings_page
from tests.tooling.site.hook import PAGES, ROOT, loads_elsewhere, with_links
from tests.tooling.site.markdown import attributes, prose


def commands(of: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """Yield every command below a parser."""
    for action in of._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield command
                yield from commands(command)


def section(page: str, heading: str) -> str:
    """Return what stands below a heading, up to the next one."""
    found = re.search(rf"^#+ {re.escape(heading)}\n(.*?)(?=^#|\Z)", page, flags=re.DOTALL | re.MULTILINE)
    assert found, f"there is no {heading}"
    return found.group(1)


def test_every_command_is_there_with_each_of_its_options() -> None:
    """What argparse takes is what the page lists."""
    page = commands_page.page()
    assert len(list(commands(parser()))) > 25
    for command in commands(parser()):
        told = section(page, command.prog)
        for action in command._actions:
            if action.help and action.dest not in ("help", "ask"):
                assert action.help.split("%")[0].split("|")[0].split("<")[0] in told, (command.prog, action.dest)
                assert all(f"`{name}" in told for name in action.option_strings)


def test_the_page_leaves_the_parsers_as_they_are() -> None:
    """They are made once in a process, and `--help` is laid out by a class of argparse, whoever has made the page before."""
    commands_page.page()
    assert parser().formatter_class is argparse.RawDescriptionHelpFormatter
    assert all(isinstance(command.formatter_class, type) for command in commands(parser()))


def test_every_setting_is_there_with_its_default() -> None:
    """What `config.KEYS` reads is what the page lists, in its section."""
    page = settings_page.page()
    for name, keys in KEYS.items():
        told = section(page, f"[{name}]")
        assert [key for key in keys if not re.search(rf"`{key}[ .].*=", told)] == []


def test_every_request_is_there_with_its_fields() -> None:
    """What the daemon decodes is what the page lists; a type that is a message leads to it."""
    page = protocol_page.page()
    for kind in get_args(Request):
        told = section(page, f"`{kind.__struct_config__.tag}`")
        assert [field.name for field in msgspec.structs.fields(kind) if f"| `{field.name}` |" not in told] == []
    headings = {re.sub(r"\W", "", heading.lower()) for heading in re.findall(r"^#+ (.*)$", page, flags=re.MULTILINE)}
    linked = set(re.findall(r"\]\(#([^)]*)\)", page))
    assert linked and linked <= headings


def test_every_name_of_the_client_is_there_once() -> None:
    """A name that the client gets has a place on the page."""
    named = [name for names in client_page.PARTS.values() for name in names]
    assert sorted(named) == sorted(client.__all__)
    assert client_page.page().count("::: gateway.client.") == len(named) + 1  # and what records


@pytest.mark.parametrize(
    ("uri", "link", "wanted"),
    [
        ("index.md", "docs/how-to/move.md#look", "how-to/move.md#look"),
        ("index.md", "CONTRIBUTING.md", "contributing.md"),
        ("contributing.md", "docs/reference/behaviour.md", "reference/behaviour.md"),
        ("how-to/move.md", "../../README.md", "../index.md"),
        ("how-to/real-robot.md", "../../configs/default.toml", "../reference/settings.md"),
        ("how-to/move.md", "real-robot.md", "real-robot.md"),
        ("how-to/move.md", "#look", "#look"),
        ("index.md", "https://semver.org", "https://semver.org"),
    ],
)
def test_a_link_leads_to_the_page_that_is_made_from_its_file(uri: str, link: str, wanted: str) -> None:
    """In a checkout a link leads to a file, on the site to a page."""
    assert with_links(f"see [there]({link}).", uri) == f"see [there]({wanted})."


def test_files_that_pages_are_made_from_are_there() -> None:
    """A file that is renamed takes its page along."""
    assert [name for name in PAGES if not (ROOT / name).exists()] == []


def test_what_would_be_loaded_from_elsewhere_is_found_and_links_are_not() -> None:
    """The site works without a network; that it names addresses does not matter."""
    assert (
        loads_elsewhere('<a href="https://a.b/c">c</a><link rel="canonical" href="https://a.b"><img src="x.png">') == []
    )
    assert loads_elsewhere('<script src="https://a.b/c.js"></script><link href="//fonts.a/b">') == [
        "https://a.b/c.js",
        "//fonts.a/b",
    ]


def test_a_docstring_becomes_markdown() -> None:
    """Our lists are lists there, and what is said of attributes is found, continued lines too."""
    rules = "Rules\n    * One\n      goes on.\n    * Two."
    text = f"What it is.\n\n{rules}\n\nAttributes:\n    a: First [m]\n        and more.\n    b: Second."
    assert prose(text) == "What it is.\n\n**Rules**\n\n* One\n    goes on.\n* Two.\n"
    assert attributes(text) == {"a": "First [m] and more.", "b": "Second."}
