"""What pages that are made from code have in common: cells of tables, and our docstrings as Markdown."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Sequence

__all__ = ["attributes", "cell", "prose", "table"]


def cell(text: str) -> str:
    """Return a text that can stand in a table."""
    return " ".join(text.replace("|", r"\|").replace("<", "&lt;").split())


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; its cells are Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def prose(docstring: str) -> str:
    """Return a docstring as Markdown: what follows its first sentence, lists under their titles, no Google sections.

    Our lists are indented below a title; to Markdown that would be code, or one paragraph.
    """
    text = inspect.cleandoc(docstring)
    text = re.split(r"^(?:Attributes|Args|Returns|Raises):$", text, flags=re.MULTILINE)[0]
    return re.sub(r"^(\w[\w ]*)\n((?: {4}.*\n?)+)", _list, text, flags=re.MULTILINE).strip() + "\n"


def _list(match: re.Match[str]) -> str:
    title, items = match.groups()
    return f"**{title}**\n\n{inspect.cleandoc(items)}\n".replace("\n  ", "\n    ")


def attributes(docstring: str) -> dict[str, str]:
    """Return what the `Attributes` section of a docstring says of each name."""
    _, _, section = inspect.cleandoc(docstring).partition("\nAttributes:\n")
    found = re.findall(r"^    (\w+): (.*(?:\n {5,}.*)*)", section, flags=re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in found}
