"""What a person wishes at one instant, and the keys of a terminal for it (`docs/how-to/teleop.md` shows them)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from gateway.cli.teleop.jogging import Demand, KeyDeadman
from gateway.cli.terminal.keys import Keys

__all__ = ["ACTIONS", "HELP", "MOTIONS", "Keyboard", "Wish"]

MOTIONS: Mapping[str, tuple[str, float]] = {
    "w": ("x", 1.0), "s": ("x", -1.0), "a": ("y", 1.0), "d": ("y", -1.0), "r": ("z", 1.0), "f": ("z", -1.0),
    "o": ("roll", 1.0), "u": ("roll", -1.0), "i": ("pitch", 1.0), "k": ("pitch", -1.0), "j": ("yaw", 1.0), "l": ("yaw", -1.0),
    "+": ("joint", 1.0), "=": ("joint", 1.0), "-": ("joint", -1.0),
    "\x1b[a": ("vx", 1.0), "\x1b[b": ("vx", -1.0), "\x1b[d": ("wz", 1.0), "\x1b[c": ("wz", -1.0),
    ",": ("vy", 1.0), ".": ("vy", -1.0), "\x1b[5~": ("lift", 1.0), "\x1b[6~": ("lift", -1.0),
}  # fmt: skip
"""Key, in lower case -> axis and direction. They move while they are repeated."""

ACTIONS: Mapping[str, str] = {
    " ": "stop", "\t": "arm", "m": "frame", "]": "faster", "[": "slower", "g": "grip", "b": "open", "x": "relax", "h": "home",
    "y": "yes", "e": "episode", "n": "failure", "\x7f": "discard", "\x08": "discard", "\r": "enable", "\n": "enable",
    "?": "help", "q": "quit", **{str(number): f"joint {number}" for number in range(1, 8)},
}  # fmt: skip
"""Key -> what is asked for, once."""

HELP = """held: w s ahead/back, a d left/right, r f up/down; o u roll, i k pitch, j l yaw; 1-7 then + - a joint
      arrows the chassis, , . sideways; page up/down the lift
once: space STOP, tab other arm, [ ] slower/faster, m axes of shoulder/hand, g grip, b open, x relax, h home
      e episode begins/ends, y success, n failure, backspace discard; enter enable again, ? this, q end (arms pause)"""

TOKEN = re.compile(r"\x1b(?:\[[0-9;]*[a-z~]|o[a-z])|.", re.DOTALL)
UNFINISHED = re.compile(r"\x1b(?:\[[0-9;]*|o)?\Z")
"""A key as a terminal sends it, one character or a sequence; and the begin of one whose end has not arrived."""
STALL_NS, LATE = 400_000_000, ("stop", "quit")
"""What was typed while nobody read for so long was meant for another moment [ns]; all that counts of it is this."""


class Wish(NamedTuple):
    """What is wished for.

    Attributes:
        demand: What shall move, as long as the deadman says.
        actions: What was asked for since the last look: the values of `ACTIONS`.
        gone: Why nobody can wish anything any more; empty otherwise.
        missing: What is missing but may come back, such as an unplugged gamepad; empty otherwise.
    """

    demand: Demand
    actions: tuple[str, ...] = ()
    gone: str = ""
    missing: str = ""


class Keyboard:
    """A terminal, whose keys move something, or only ask for things beside another device."""

    def __init__(self, keys: Keys, *, moves: bool = True) -> None:
        self._keys, self._moves, self._deadman = keys, moves, KeyDeadman()
        self._rest, self._read_ns = "", 0

    def read(self, now_ns: int) -> Wish:
        """Return what is wished for now; never waits."""
        if not self._keys.are_there:
            return Wish({}, gone="the terminal is gone, or this command runs in its background" if self._moves else "")
        is_late = now_ns - (self._read_ns or now_ns) > STALL_NS
        if is_late:
            self._keys.renew()
            self._deadman.press("", now_ns)
        self._read_ns = now_ns
        typed, actions = self._rest + self._keys.wait(0.0), []
        unfinished = UNFINISHED.search(typed)
        self._rest = "" if unfinished is None else unfinished.group()
        for token in TOKEN.findall(typed.removesuffix(self._rest)):
            key = token.replace("\x1bo", "\x1b[")  # arrows of a terminal in application mode
            actions += [ACTIONS[key]] if key in ACTIONS and (not is_late or ACTIONS[key] in LATE) else []
            self._deadman.press(key if key in MOTIONS and self._moves and not is_late else "", now_ns)
        key, level = self._deadman.level(now_ns)
        axis, direction = MOTIONS.get(key, ("x", 0.0))
        return Wish({axis: direction * level} if key else {}, tuple(actions))
