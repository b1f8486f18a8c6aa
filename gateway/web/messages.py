"""What a page and the server say to each other, defined once: checked on arrival, and described in `/openapi.json`.

A page that commands sends these as JSON by its WebSocket; each is answered by `{"type": "reply", "id": ...}` when it was
accepted or refused. Numbers have the units of their names; limits are the gateway's own, and are judged there.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from msgspec import Meta, Struct

__all__ = [
    "BOUNDARY",
    "Acquire",
    "Alive",
    "Asked",
    "CamerasSeen",
    "Disable",
    "Drive",
    "Enable",
    "Episode",
    "Grip",
    "Hold",
    "Home",
    "Jog",
    "Lift",
    "LoginAsked",
    "Release",
    "StopAsked",
    "StopDone",
]

BOUNDARY = "picture"
"""Between the pictures of one view."""
Side: TypeAlias = Literal["left", "right"]
Text: TypeAlias = Annotated[str, Meta(max_length=200)]


class _Asked(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="do", tag=str.lower):
    """What a page asks for; `id` comes back with the reply."""

    id: int


class Acquire(_Asked, frozen=True):
    """Become the owner; with a reason in `take` from whoever it is. The reply's `epoch` is that of the states' `lease`."""

    take: Text = ""


class Release(_Asked, frozen=True):
    """Give the robot back: it brakes, rests and pauses."""


class Enable(_Asked, frozen=True):
    """Bring the robot's FSM to READY; arms are held where they are."""


class Disable(_Asked, frozen=True):
    """Brake, then pause the robot; the page stays its owner."""


class Hold(_Asked, frozen=True):
    """Brake both arms and hold them."""


class Home(_Asked, frozen=True):
    """Move the arms to the initial position of manual §6.6, at a third of the speed limit."""


class Jog(_Asked, frozen=True):
    """Move one joint by a step: `joint` 1 to 7 in the order of manual §4.0.3, `step_rad` at most 0.2."""

    side: Side
    joint: Annotated[int, Meta(ge=1, le=7)]
    step_rad: Annotated[float, Meta(ge=-0.2, le=0.2)]


class Grip(_Asked, frozen=True):
    """Close a gripper with a part of its greatest torque, `force` 0 (none) to 1; negative opens."""

    side: Side
    force: Annotated[float, Meta(ge=-1.0, le=1.0)]


class Drive(_Asked, frozen=True):
    """Drive the chassis for 0.4 s from now on [m/s, rad/s]; said again as long as a button is held."""

    vx_mps: float
    vy_mps: float
    wz_radps: float


class Lift(_Asked, frozen=True):
    """Lift for 0.4 s from now on, `velocity_ratio` -1 (down) to 1 (up); said again as long as a button is held."""

    velocity_ratio: float


class Episode(_Asked, frozen=True):
    """Tell the recorder of this robot about an episode: `event`; the task of a start, a text of a mark or a verdict."""

    event: Literal["start", "stop", "mark", "success", "failure", "discard"]
    text: Text = ""


class Alive(_Asked, frozen=True):
    """The page is alive; said once a second, or the robot is held as if the page had been closed. Not answered."""


Asked: TypeAlias = Acquire | Release | Enable | Disable | Hold | Home | Jog | Grip | Drive | Lift | Episode | Alive


class LoginAsked(Struct, frozen=True, kw_only=True):
    """A login; what it gives is a cookie."""

    name: Text
    password: Annotated[str, Meta(max_length=1000)]


class StopAsked(Struct, frozen=True, kw_only=True):
    """What may be said with a stop; all of it may be missing, or wrong: a stop is its arrival."""

    reason: str = ""


class StopDone(Struct, frozen=True, kw_only=True):
    """What became of a stop.

    Attributes:
        confirmed: Whether the gateway or its guard has said that it knows; else it only lies in the pipe.
        dropped: Whether it lies in the gateway's pipe already, which its control loop or its guard reads.
        by_guard: Whether the guard of a dead gateway answered.
        undelivered: Whether there was no way to the robot: use the physical emergency stop.
    """

    confirmed: bool
    dropped: bool
    by_guard: bool
    undelivered: bool


class CamerasSeen(Struct, frozen=True, kw_only=True):
    """How the cameras are seen.

    Attributes:
        views: What can be looked at under `/api/video/NAME`.
        is_receiving: Whether anybody looks now.
        age_s: Age of the newest picture [s], from its first packet on; None before the first.
        rate_hz: Pictures that were decoded in a second.
        why: What is wrong, the worst first.
    """

    views: tuple[str, ...]
    is_receiving: bool
    age_s: float | None
    rate_hz: float
    why: tuple[str, ...]
