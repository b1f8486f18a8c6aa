"""A gamepad as wishes, by SDL (wheels `pysdl2` and `pysdl2-dll`), which knows the buttons of common ones by their place.

Nothing moves unless a shoulder button is held: the left one for the hand, both for turning it, the right one for chassis and
lift. A gamepad that is unplugged wishes nothing; the next one that is plugged in goes on.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from typing import Any

from gateway.cli.teleop.keyboard import Wish
from gateway.errors import Code, failure

__all__ = ["HELP", "Gamepad"]

DEAD_ZONE, PULLED, FULL = 0.15, 0.3, 32767.0
"""Parts of the whole way: a stick's middle, and when a trigger counts as pulled; and all of it."""
LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y, LEFT_TRIGGER, RIGHT_TRIGGER, LEFT_SHOULDER, RIGHT_SHOULDER = *range(6), 9, 10
ASKED = {
    0: "episode", 1: "failure", 2: "discard", 3: "yes", 4: "arm", 6: "enable", 7: "stop", 8: "home",
    11: "faster", 12: "slower", 13: "frame", 14: "relax", 100 + LEFT_TRIGGER: "open", 100 + RIGHT_TRIGGER: "grip",
}  # fmt: skip
"""SDL's number of a button, or 100 and that of a trigger -> what it asks for."""
HELP = """held: left shoulder + sticks the hand: ahead, left | up, yaw; both shoulders: pitch, roll | yaw
      right shoulder + sticks the chassis: ahead, left | lift, turn
once: left stick pressed in STOP, right one home; back other arm; cross up/down faster/slower, left axes, right relax
      triggers: right grip, left open; A episode begins/ends, Y success, B failure, X discard; start enable again"""


class Gamepad:
    """The first gamepad there is; `beside` is a device whose actions count as well.

    Raises:
        Rejected: BAD_REQUEST, SDL is not installed, or there is no gamepad.
    """

    def __init__(self) -> None:
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # no window is needed, nor a display
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # it tells which SDL it found
                import sdl2
        except ImportError as error:
            hint = "install it: pip install 'teleavatar-gateway[teleop]'"
            message = f"gamepads are read with SDL, which is not installed ({error})"
            raise failure(Code.BAD_REQUEST, message, field="device", hint=hint) from None
        self.beside: Callable[[int], Wish] = lambda _: Wish({})
        self._sdl: Any = sdl2
        self._pad: Any = None
        self._down = set(ASKED)  # what is held when it comes was not pressed
        sdl2.SDL_SetHint(b"SDL_NO_SIGNAL_HANDLERS", b"1")
        sdl2.SDL_SetHint(sdl2.SDL_HINT_JOYSTICK_ALLOW_BACKGROUND_EVENTS, b"1")
        if sdl2.SDL_Init(sdl2.SDL_INIT_GAMECONTROLLER) != 0 or not self._is_there():
            hint = "plug one in; this user must be able to read /dev/input/event* (group input); or --device keyboard"
            raise failure(Code.BAD_REQUEST, "no gamepad is there", field="device", hint=hint)

    def read(self, now_ns: int) -> Wish:
        """Return what is wished for now; never waits."""
        beside, pad = self.beside(now_ns), self._pad
        if not self._is_there() or self._pad is not pad:  # or another one came meanwhile
            self._down = set(ASKED)
            return Wish({}, beside.actions, missing="the gamepad is gone: plug it in again")
        down = {button for button in range(15) if self._sdl.SDL_GameControllerGetButton(self._pad, button)}
        down |= {100 + axis for axis in (LEFT_TRIGGER, RIGHT_TRIGGER) if self._stick(axis) > PULLED}
        pressed, self._down = down - self._down, down
        asked = [ASKED[button] for button in sorted(pressed) if button in ASKED]
        return Wish(self._demand(), (*beside.actions, *asked))

    def _is_there(self) -> bool:
        """Look for news; open a gamepad where none is."""
        sdl = self._sdl
        sdl.SDL_GameControllerUpdate()
        if self._pad and not sdl.SDL_GameControllerGetAttached(self._pad):
            sdl.SDL_GameControllerClose(self._pad)
            self._pad = None
        for number in range(0 if self._pad else sdl.SDL_NumJoysticks()):
            self._pad = self._pad or (sdl.SDL_IsGameController(number) and sdl.SDL_GameControllerOpen(number)) or None
        return bool(self._pad)

    def _demand(self) -> dict[str, float]:
        left, right = LEFT_SHOULDER in self._down, RIGHT_SHOULDER in self._down
        ahead, aside, up, turn = (-self._stick(axis) for axis in (LEFT_Y, LEFT_X, RIGHT_Y, RIGHT_X))
        if left and right:
            return {"pitch": ahead, "roll": -aside, "yaw": turn}
        if left:
            return {"x": ahead, "y": aside, "z": up, "yaw": turn}
        return {"vx": ahead, "vy": aside, "wz": turn, "lift": up} if right else {}

    def _stick(self, axis: int) -> float:
        """Return where a stick is, -1 to 1, its middle left out; finer near that."""
        value = self._sdl.SDL_GameControllerGetAxis(self._pad, axis) / FULL
        past = min(max(abs(value) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE), 1.0)
        return float(past * past if value > 0.0 else -past * past)
