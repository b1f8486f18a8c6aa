"""Tests of keys as wishes."""

from __future__ import annotations

import pytest

from gateway.cli.teleop.keyboard import ACTIONS, HELP, MOTIONS, Keyboard

MS = 1_000_000


class Typed:
    """Keys of a terminal by script."""

    def __init__(self):
        self.are_there, self.renewed, self._typed = True, 0, []

    def type(self, *chunks):
        """Let this be read, a chunk each time."""
        self._typed += chunks

    def wait(self, seconds):
        """Return the next chunk, as `Keys` does."""
        assert seconds == 0.0
        return self._typed.pop(0) if self._typed else ""

    def renew(self):
        """Count it."""
        self.renewed += 1


@pytest.fixture
def typed():
    """Keys by script."""
    return Typed()


def test_every_key_does_one_thing():
    """None moves and asks at once; none is a capital, which a terminal is not asked for."""
    assert not MOTIONS.keys() & ACTIONS.keys()
    assert all(key == key.lower() for key in (*MOTIONS, *ACTIONS))
    assert all(direction in (1.0, -1.0) for _, direction in MOTIONS.values())
    assert "STOP" in HELP and {"stop", "quit", "joint 7"} < set(ACTIONS.values())


def test_keys_move_and_ask(typed):
    """A motion while it is pressed, an action once; an action lets go of what was pressed."""
    board = Keyboard(typed)
    typed.type("w", "", "]x", "")
    assert board.read(0).demand == {"x": 0.15}
    assert board.read(100 * MS).demand == {"x": 0.15}
    asked = board.read(200 * MS)
    assert asked.demand == {} and asked.actions == ("faster", "relax")
    assert board.read(300 * MS).actions == ()


def test_a_sequence_that_arrives_in_pieces_is_one_key_and_an_unknown_one_is_none(typed):
    """No letter of it is taken for a key; arrows of both kinds of terminals are known."""
    board = Keyboard(typed)
    typed.type("\x1b", "[a", "\x1bod", "\x1b[1;5", "s", "\x1b[6~", "\x1b", "q")
    seen = [board.read(n * 100 * MS) for n in range(8)]
    assert [list(wish.demand) for wish in seen] == [[], ["vx"], ["wz"], ["wz"], [], ["lift"], ["lift"], []]
    assert [wish.actions for wish in seen] == [()] * 7 + [("quit",)]


def test_of_what_was_typed_while_nobody_read_only_stop_and_quit_count(typed):
    """It was meant for another moment: nothing moves, and nobody goes home. The terminal is asked for single keys again."""
    board = Keyboard(typed)
    typed.type("w", "wwhy\r wq", "w")
    assert board.read(1).demand
    wish = board.read(500 * MS)
    assert wish.demand == {} and wish.actions == ("stop", "quit") and typed.renewed == 1
    assert board.read(600 * MS).demand == {"x": 0.15} and typed.renewed == 1


def test_beside_another_device_keys_only_ask(typed):
    """And a terminal that is gone is no end."""
    board = Keyboard(typed, moves=False)
    typed.type("w ")
    wish = board.read(0)
    assert wish.demand == {} and wish.actions == ("stop",)
    typed.are_there = False
    assert board.read(1).gone == "" and "gone" in Keyboard(typed).read(1).gone
