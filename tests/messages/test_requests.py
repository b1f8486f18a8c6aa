"""What clients may ask: plain frozen values, complete, cautious where nothing is said."""

from __future__ import annotations

import inspect
from typing import get_args

import pytest
from msgspec import Struct
from msgspec.structs import fields

from gateway.messages import requests
from gateway.messages.incoming import OnLimit, OnLoss
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side

KINDS = get_args(requests.Request)
OPEN_TO_ALL = {
    requests.Acquire,
    requests.Take,
    requests.Stop,
    requests.Estop,
    requests.Recover,
    requests.CheckFollow,
    requests.RegisterEndpoint,
    requests.LeaveEndpoint,
}
"""What needs no lease: asking for one, stopping, recovering (BEHAVIOUR, stopping and losing), judging what nobody follows,
watching over the robot."""
POINTS = {Side.LEFT: (HOME_Q_RAD[Side.LEFT],) * 2}
LEFT_HOME = {Side.LEFT: (0.0,) * 7}
OPTIONS = {
    requests.Acquire: {"name": "n", "pid": 1},
    requests.RegisterEndpoint: {"name": "n", "timeout_ns": 1},
    requests.Take: {"name": "n", "pid": 1, "reason": "r"},
    requests.Move: {"epoch": 1, "targets_rad": LEFT_HOME},
    requests.Follow: {"epoch": 1, "points": POINTS},
    requests.CheckFollow: {"follow": requests.Follow(epoch=0, points=POINTS)},
    requests.MovePose: {"epoch": 1, "targets": LEFT_HOME, "frames": {}},
    requests.OpenStream: {"epoch": 1, "side": Side.LEFT},
    requests.CloseStream: {"epoch": 1, "stream_id": 1},
    requests.Hold: {"epoch": 1, "sides": (Side.LEFT,)},
    requests.Cancel: {"epoch": 1, "motion_id": 1},
    requests.SetGripper: {"epoch": 1, "side": Side.LEFT, "raw": 0.5},
    requests.SetPayload: {"epoch": 1, "side": Side.LEFT},
    requests.Weigh: {"epoch": 1, "side": Side.LEFT, **dict.fromkeys(("q_rad", "up_nm", "down_nm", "noise_nm"), ())},
    requests.DriveChassis: {"epoch": 1, "vx_mps": 0.1, "vy_mps": 0.0, "wz_radps": 0.0},
    requests.DriveLift: {"epoch": 1, "velocity": 0.1},
    **{kind: {"epoch": 1} for kind in (requests.StopChassis, requests.StopLift, requests.DisableLift)},
    **{kind: {"epoch": 1} for kind in (requests.Release, requests.Abandon, requests.Enable, requests.Disable)},
    **{kind: {} for kind in (requests.Stop, requests.Estop, requests.Recover, requests.LeaveEndpoint)},
}
"""The least that must be said to ask for each."""


def test_the_union_holds_every_request_and_everything_is_exported():
    """A request outside the union would never be answered; some are defined in a module beside."""
    defined = {
        thing
        for thing in vars(requests).values()
        if inspect.isclass(thing) and issubclass(thing, Struct) and thing.__module__.endswith("requests")
    }
    assert set(KINDS) == defined == set(OPTIONS)
    assert {kind.__name__ for kind in KINDS} | {"Request"} == set(requests.__all__) and sorted(
        requests.__all__
    ) == requests.__all__


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_whoever_commands_says_under_which_epoch(kind):
    """Only what is open to all carries none; no request has a default epoch that could be right by chance."""
    epochs = [field for field in fields(kind) if field.name == "epoch"]
    assert bool(epochs) is (kind not in OPEN_TO_ALL)
    assert all(field.required for field in epochs)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_a_request_cannot_be_changed_on_its_way(kind):
    """Frozen and slotted, equal when it says the same, and nothing but keywords builds it."""
    request = kind(**OPTIONS[kind])
    assert request == kind(**OPTIONS[kind]) and not hasattr(request, "__dict__")
    for name in OPTIONS[kind]:
        with pytest.raises(AttributeError, match="immutable"):
            setattr(request, name, None)
        with pytest.raises(TypeError, match=name):
            kind(**{key: value for key, value in OPTIONS[kind].items() if key != name})
    if OPTIONS[kind]:
        with pytest.raises(TypeError):
            kind(*OPTIONS[kind].values())


def test_what_is_not_said_is_the_cautious_choice():
    """Hold on loss; reject at limits; absolute goals at full speed with the configured tolerance and expiry; no reason."""
    assert requests.Acquire(name="n", pid=1).on_loss is OnLoss.HOLD
    assert requests.Take(name="n", pid=1, reason="r").on_loss is OnLoss.HOLD
    move = requests.Move(epoch=1, targets_rad=LEFT_HOME)
    assert (move.relative, move.speed, move.tolerance_rad, move.on_limit) == (
        False, 1.0, None, OnLimit.REJECT,
    )  # fmt: skip
    stream = requests.OpenStream(epoch=1, side=Side.LEFT)
    assert (stream.speed, stream.on_limit, stream.expiry_ns) == (1.0, OnLimit.REJECT, None)
    for drive in (requests.DriveChassis, requests.DriveLift):
        assert (drive(**OPTIONS[drive]).expiry_ns, drive(**OPTIONS[drive]).drive_id) == (None, 0)
    assert requests.Stop().reason == requests.Estop().reason == ""


@pytest.mark.parametrize(("choice", "words"), [(OnLoss, ["hold", "pause"]), (OnLimit, ["reject", "clip"])])
def test_choices_travel_as_words(choice, words):
    """Wire and log show them; they never change."""
    assert [member.value for member in choice] == words and all(choice(word) == word for word in words)
