"""Every sentence in which the core refuses or tells stands in `sentences.txt`: none changes unseen, and all can be read there.

A sentence that a test brings about, and that is not in the list, fails the test. What differs from case to case (numbers,
names, topics) is left out of the comparison. Property tests say what nobody has read before: they are not asked. In all of
them what is said is text, under a code that is one, at a time that is one: a `None` would only fail on its way out.

    TA2_SENTENCES=write TA2_HYPOTHESIS_PROFILE=ci bin/test tests/core tests/behaviour

writes the list anew, as CI says it, in five minutes: read the difference.
"""

from __future__ import annotations

import functools
import os
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import currently_in_test_context

from gateway.core.messages.outputs import Notice
from gateway.errors import Code, Refusal

__all__ = ["only_known_sentences", "pytest_sessionfinish"]

LIST = Path(__file__).with_name("sentences.txt")
SPEAKERS = "gateway.core."
NAMES = re.compile(
    r"""(?<=zenoh session )\w+|(?<!\w)'[^']*'|"[^"]*"|\b(?:tcp|udp|unix)[/:][^ ,;]+|"""
    r"""(?<![\w/])/[a-z_]+(?:/[a-z_]+)*|(?<!\.)\b(?=\d*[a-f])[0-9a-f]{6,}\b"""
)
NUMBERS = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?|\b(?:nan|inf)\b")
PARTS = re.compile(
    r"\b(?:left|right)_(?:\w+_finger|wrist_camera|forearm|palm|upper|torso|shoulder)\b|\b(?:carriage|column|head)\b"
)
STATES = re.compile(r"\b[A-Z][A-Z_]{3,}\b")
SIDES = re.compile(r"\bright\b(?! where)|\bright(?=_arm|_gripper)")
SAID: set[str] = set()
"""What was said in this test, or, while the list is written, in all of them."""

is_written = os.environ.get("TA2_SENTENCES") == "write"


@functools.cache
def _known() -> frozenset[str]:
    return frozenset(LIST.read_text(encoding="utf-8").splitlines())


def _pattern(text: str) -> str:
    text = PARTS.sub("left_palm", NUMBERS.sub("#", NAMES.sub("…", text)))
    return SIDES.sub("left", STATES.sub("@", text)).replace("r_joint", "l_joint")


def _of_refusal(refusal: Refusal) -> str:
    texts = (refusal.message, refusal.field, refusal.value, refusal.bound, refusal.unit, refusal.hint)
    assert isinstance(refusal.code, Code) and all(isinstance(text, str) for text in texts), refusal
    parts = (refusal.message, refusal.field, refusal.unit, refusal.hint)
    return " | ".join((str(refusal.code.value), *(_pattern(str(part)) for part in parts)))


def _of_notice(notice: Notice) -> str:
    texts = (notice.message, *notice.facts, *notice.facts.values())
    assert isinstance(notice.code, Code) and all(isinstance(text, str) for text in texts), notice
    assert isinstance(notice.at_ns, int), notice
    return " | ".join(
        (str(notice.code.value), notice.level.value, _pattern(str(notice.message)), ", ".join(sorted(notice.facts)))
    )


def _listening(cls: type, sentence: Callable[[Any], str]) -> None:
    init = cls.__init__

    @functools.wraps(init)
    def heard(self: object, *args: object, **facts: object) -> None:
        init(self, *args, **facts)
        if sys._getframe(1).f_globals.get("__name__", "").startswith(SPEAKERS):
            said = sentence(self)
            if not currently_in_test_context():
                SAID.add(said)

    cls.__init__ = heard


@pytest.fixture(autouse=True)
def only_known_sentences() -> Iterator[None]:
    """Fail a test in which the core says what nobody has read."""
    if not is_written:
        SAID.clear()
    yield
    assert is_written or not SAID - _known(), f"not in {LIST.name}: {sorted(SAID - _known())}"


def pytest_sessionfinish() -> None:
    """Write the list anew, when that is asked for."""
    if is_written:
        LIST.write_text("".join(f"{sentence}\n" for sentence in sorted(SAID)), encoding="utf-8")


_listening(Refusal, _of_refusal)
_listening(Notice, _of_notice)
