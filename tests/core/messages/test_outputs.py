"""What the engine gives: plain frozen values that compare by what they say."""

from __future__ import annotations

import copy
import dataclasses

import pytest

from gateway.core.messages import outputs
from gateway.core.messages.outputs import (
    ROUTERS_KEPT,
    Frame,
    FrameKind,
    Level,
    Notice,
    Remembered,
    Reply,
    found_at,
    router_name,
)
from gateway.errors import Code, Refusal
from gateway.robot.topics import FSM_ENABLE

FRAME = Frame(topic=FSM_ENABLE, values=(1.0,), kind=FrameKind.BEAT, epoch=0, due_ns=5)
NOTICE = Notice(code=Code.LINK_UP, level=Level.INFO, message="linked", at_ns=5)
REPLY = Reply(client_id="c", request_id=1)


@pytest.mark.parametrize("value", [FRAME, NOTICE, REPLY, Remembered()], ids=lambda value: type(value).__name__)
def test_what_was_given_cannot_be_changed(value):
    """A frame that was cleared is the frame that leaves; frozen, slotted, built by keyword, equal to its copy."""
    names = value.__slots__ if dataclasses.is_dataclass(value) else value.__struct_fields__
    with pytest.raises(AttributeError):
        setattr(value, names[0], None)
    with pytest.raises(TypeError):
        type(value)(*(getattr(value, name) for name in names))
    assert not hasattr(value, "__dict__") and copy.deepcopy(value) == value
    assert type(value).__name__ in outputs.__all__ and sorted(outputs.__all__) == outputs.__all__


def test_the_routers_of_a_robot_are_kept_the_latest_last():
    """By zenoh id and namespace, each once, so many and no more."""
    assert router_name("a1", "/lab/") == "a1/lab"
    many = tuple(f"{n}/" for n in range(ROUTERS_KEPT))
    assert found_at(many, "0", "") == (*many[1:], "0/") == found_at((*many[1:], "0/"), "0", "/")
    assert found_at(many, "new", "") == (*many[1:], "new/")


def test_a_frame_is_told_entirely():
    """No frame has a kind, an epoch or an instant by default: whoever makes it must know."""
    assert all(field.default is dataclasses.MISSING for field in dataclasses.fields(Frame))
    assert dataclasses.replace(FRAME, values=(0.0,)) != FRAME != dataclasses.replace(FRAME, epoch=1)


def test_a_reply_says_yes_unless_it_carries_a_refusal():
    """Exactly one of facts and refusal counts."""
    assert (REPLY.refusal, REPLY.facts) == (None, {})
    refused = Reply(client_id="c", request_id=1, refusal=Refusal(code=Code.NOT_OWNER, message="no"))
    assert refused != REPLY and refused.refusal is not None


def test_two_values_never_share_their_facts():
    """A fact added to one notice does not show up in the next."""
    other = Notice(code=Code.LINK_UP, level=Level.INFO, message="linked", at_ns=5)
    assert other.facts == NOTICE.facts == {} and other.facts is not NOTICE.facts
    assert Remembered().latches is not Remembered().latches
    assert Reply(client_id="c", request_id=2).facts is not REPLY.facts


def test_what_must_be_remembered_is_compared_by_content():
    """The disk is written when it changed: an epoch, a latch, or its message."""
    remembered = Remembered(epoch=3, latches={Code.ESTOP: "by ann"})
    assert remembered == Remembered(epoch=3, latches={Code.ESTOP: "by ann"})
    for other in (
        Remembered(epoch=4, latches=remembered.latches),
        Remembered(epoch=3),
        Remembered(epoch=3, latches={Code.ESTOP: "by bob"}),
    ):
        assert other != remembered


@pytest.mark.parametrize("words", [FrameKind, Level])
def test_kinds_and_levels_travel_as_words(words):
    """Wire, log and replay show the same lower-case names; they never change."""
    assert [member.value for member in words] == [member.name.lower() for member in words]
    assert all(words(member.value) is member for member in words)
