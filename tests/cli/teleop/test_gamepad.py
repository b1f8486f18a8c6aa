"""Tests of a gamepad as wishes, with a virtual one of SDL."""

from __future__ import annotations

import sys
import warnings

import pytest

from gateway.cli.teleop.gamepad import ASKED, Gamepad
from gateway.cli.teleop.keyboard import Wish
from gateway.errors import Rejected

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    sdl2 = pytest.importorskip("sdl2")

LEFT_SHOULDER, RIGHT_SHOULDER, FULL = 9, 10, 32767
ASKS_HOME = 8


class Pad:
    """A virtual gamepad."""

    def __init__(self):
        kind = sdl2.SDL_JOYSTICK_TYPE_GAMECONTROLLER
        self.number = sdl2.SDL_JoystickAttachVirtual(kind, 6, 15, 0)
        if self.number < 0:
            pytest.skip(f"SDL makes no virtual gamepad here: {sdl2.SDL_GetError()}")
        self.joystick = sdl2.SDL_JoystickOpen(self.number)
        for axis in (4, 5):  # triggers rest at their low end
            self.put(axis, -FULL)

    def put(self, axis, value):
        """Move an axis."""
        assert sdl2.SDL_JoystickSetVirtualAxis(self.joystick, axis, value) == 0

    def press(self, button, is_down=True):
        """Press a button, or let it go."""
        assert sdl2.SDL_JoystickSetVirtualButton(self.joystick, button, int(is_down)) == 0

    def unplug(self):
        """Take it away, once."""
        if self.joystick is not None:
            sdl2.SDL_JoystickDetachVirtual(self.number)
            sdl2.SDL_JoystickClose(self.joystick)
            self.joystick = None


@pytest.fixture
def plug_in(monkeypatch):
    """Plugs in virtual gamepads; whatever else this computer has is none."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(sdl2, "SDL_IsGameController", sdl2.SDL_JoystickIsVirtual)
    if sdl2.SDL_Init(sdl2.SDL_INIT_GAMECONTROLLER) != 0:
        pytest.skip(f"SDL knows no gamepads here: {sdl2.SDL_GetError()}")
    plugged = []

    def plug():
        plugged.append(Pad())
        return plugged[-1]

    yield plug
    for pad in plugged:
        pad.unplug()
    while sdl2.SDL_WasInit(sdl2.SDL_INIT_GAMECONTROLLER):
        sdl2.SDL_QuitSubSystem(sdl2.SDL_INIT_GAMECONTROLLER)


@pytest.fixture
def pad(plug_in):
    """One that is plugged in."""
    return plug_in()


def test_without_sdl_or_a_gamepad_it_says_what_to_do(plug_in, monkeypatch):
    """The pip command, or whose files must be readable."""
    with pytest.raises(Rejected) as none:
        Gamepad()
    assert "input" in none.value.hint and none.value.field == "device"
    monkeypatch.setitem(sys.modules, "sdl2", None)
    with pytest.raises(Rejected) as missing:
        Gamepad()
    assert "teleavatar-gateway[teleop]" in missing.value.hint


def test_nothing_moves_unless_a_shoulder_button_is_held(pad):
    """The left one for the hand, both for turning it, the right one for chassis and lift."""
    device = Gamepad()
    for axis, value in enumerate((-FULL, -FULL, FULL, -FULL)):  # sticks: left and ahead, right and up
        pad.put(axis, value)
    assert not device.read(0).demand
    pad.press(LEFT_SHOULDER)
    assert device.read(0).demand == pytest.approx({"x": 1.0, "y": 1.0, "z": 1.0, "yaw": -1.0})
    pad.press(RIGHT_SHOULDER)
    assert device.read(0).demand == pytest.approx({"pitch": 1.0, "roll": -1.0, "yaw": -1.0})
    pad.press(LEFT_SHOULDER, False)
    assert device.read(0).demand == pytest.approx({"vx": 1.0, "vy": 1.0, "wz": -1.0, "lift": 1.0})
    pad.press(RIGHT_SHOULDER, False)
    assert not device.read(0).demand


def test_the_middle_of_a_stick_is_nothing_and_its_way_is_fine(pad):
    """A stick that does not quite spring back moves nothing; half of the way is less than half of the speed."""
    device = Gamepad()
    pad.press(LEFT_SHOULDER)
    pad.put(1, -4000)
    assert device.read(0).demand["x"] == 0.0
    pad.put(1, FULL // 2)
    assert -0.3 < device.read(0).demand["x"] < -0.1


def test_buttons_ask_once_for_each_press(pad):
    """Triggers too; those of a device beside it count as well."""
    device = Gamepad()
    device.read(0)
    for button, action in ASKED.items():
        if button >= 100:
            pad.put(button - 100, FULL)
        else:
            pad.press(button)
        assert device.read(0).actions == (action,)
    assert device.read(0).actions == ()
    device.beside = lambda now_ns: Wish({"x": 1.0}, ("quit",))
    wish = device.read(0)
    assert wish.actions == ("quit",) and not wish.demand


def test_one_that_is_unplugged_wishes_nothing_and_the_next_goes_on(plug_in):
    """With a word on it, also where the next one is there at once; a button that is held when one comes is no press."""
    pads = [plug_in()]
    pads[0].press(ASKS_HOME)
    device = Gamepad()
    assert not device.read(0).actions
    pads[0].press(LEFT_SHOULDER)
    pads[0].put(1, -FULL)
    assert device.read(0).demand["x"] == pytest.approx(1.0)
    for is_at_once in (False, True):
        pads[-1].unplug()
        if not is_at_once:
            gone = device.read(0)
            assert not gone.demand and "plug it in" in gone.missing
        pads.append(plug_in())
        for button in (LEFT_SHOULDER, ASKS_HOME):
            pads[-1].press(button)
        pads[-1].put(1, FULL)
        assert device.read(0).missing
        back = device.read(0)
        assert not back.missing and back.demand["x"] == pytest.approx(-1.0) and not back.actions
    pads[-1].press(ASKS_HOME, False)
    device.read(0)
    pads[-1].press(ASKS_HOME)
    assert device.read(0).actions == ("home",)
