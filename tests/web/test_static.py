"""The page's file: what a screen reader and a keyboard find there, and nothing from elsewhere."""

from __future__ import annotations

from html.parser import HTMLParser

import pytest

from gateway.web.server import STATIC

NAMED = ("aria-label", "aria-labelledby")


class Page(HTMLParser):
    """The elements of the page in their order: name, attributes, text, and the labels they stand in."""

    def __init__(self) -> None:
        super().__init__()
        self.all: list[tuple[str, dict[str, str | None], list[str], str]] = []
        self._open: list[int] = []
        self.feed((STATIC / "index.html").read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        parents = " ".join(self.all[number][0] for number in self._open)
        self.all.append((tag, dict(attrs), [], parents))
        if tag not in ("meta", "link", "input", "img"):
            self._open.append(len(self.all) - 1)

    def handle_endtag(self, tag: str) -> None:
        assert self.all[self._open.pop()][0] == tag, "what was opened last is closed first"

    def handle_data(self, data: str) -> None:
        for number in self._open:
            self.all[number][2].append(data)


PAGE = Page()
IDS = [attributes["id"] for _, attributes, *_ in PAGE.all if "id" in attributes]


def test_each_id_is_there_once_and_each_reference_leads_to_one() -> None:
    """A name that is given by reference is no name where that leads nowhere."""
    assert len(IDS) == len(set(IDS))
    for _, attributes, *_ in PAGE.all:
        for key in ("aria-labelledby", "aria-describedby"):
            assert set((attributes.get(key) or "").split()) <= set(IDS)


@pytest.mark.parametrize("tag", ["button", "input", "select", "canvas"])
def test_whatever_can_be_worked_has_a_name(tag: str) -> None:
    """By its text, its label, or a name of its own."""
    found = [row for row in PAGE.all if row[0] == tag]
    assert found
    for _, attributes, text, parents in found:
        is_named = any(attributes.get(key) for key in NAMED) or "label" in parents.split()
        assert is_named or (tag == "button" and "".join(text).strip()), attributes


def test_each_part_has_a_heading_and_what_scrolls_or_is_drawn_can_be_reached_by_keys() -> None:
    """In the order in which it stands there: nobody gives an order of its own."""
    for tag, attributes, *_ in PAGE.all:
        assert tag != "section" or attributes.get("aria-labelledby")
        assert attributes.get("tabindex", "0") == "0"
    canvas = next(attributes for tag, attributes, *_ in PAGE.all if tag == "canvas")
    assert canvas["tabindex"] == "0" and canvas["role"] == "application" and canvas["aria-describedby"] == "near"


def test_the_policy_is_kept() -> None:
    """No script, style or handler in the page itself, and each file that it names is there."""
    for tag, attributes, text, _ in PAGE.all:
        assert "style" not in attributes and not any(key.startswith("on") for key in attributes)
        assert tag != "script" or not "".join(text).strip()
        source = attributes.get("src") or (attributes.get("href") if tag == "link" else None) or "data:"
        assert source.startswith("data:") or (STATIC / source.removeprefix("/static/")).is_file()
