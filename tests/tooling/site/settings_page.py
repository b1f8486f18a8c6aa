"""The reference of the settings: keys, defaults and words of configs/default.toml, with what `config.KEYS` says they take."""

from __future__ import annotations

import re
from pathlib import Path

from gateway.settings.toml_file import KEYS, Key, Kind
from tests.tooling.site.markdown import cell, table

__all__ = ["page"]

DEFAULTS = Path(__file__).resolve().parents[3] / "configs" / "default.toml"


def page(text: str | None = None) -> str:
    """Return the page.

    Args:
        text: Of the file of defaults; None for the one there is.
    """
    head, *sections = re.split(r"^\[(\w+)\]\n", text or DEFAULTS.read_text(encoding="utf-8"), flags=re.MULTILINE)
    lines = ["# Settings", "", _joined(head), ""]
    for section, body in zip(sections[::2], sections[1::2], strict=True):
        lines += [f"## [{section}]", "", table(["Key and default", "Takes", "Means"], _rows(section, body))]
    return "\n".join(lines)


def _joined(comment: str) -> str:
    """Return the words of comment lines."""
    return " ".join(line.removeprefix("#").strip() for line in comment.strip().splitlines()).replace("  ", "\n\n")


def _rows(section: str, body: str) -> list[tuple[str, str, str]]:
    """Return a row for each comment, with the keys below it."""
    groups = re.findall(r"((?:^#.*\n)+)((?:^\w.*\n?)+)", body, flags=re.MULTILINE)
    rows = []
    for comment, keys in groups:
        lines = keys.splitlines()
        names = dict.fromkeys(re.split(r"[ .]", line)[0] for line in lines)
        takes = dict.fromkeys(_takes(KEYS[section][name]) for name in names)
        rows.append(("<br>".join(f"`{line}`" for line in lines), "<br>".join(takes), cell(_joined(comment))))
    return rows


def _takes(key: Key) -> str:
    return f"a number [{key.unit}]" if key.kind is Kind.TIME else key.kind.value
