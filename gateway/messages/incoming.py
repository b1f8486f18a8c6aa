"""What every request has in common: its base, its tag, and the types of its fields."""

from __future__ import annotations

import re
from enum import Enum
from typing import Annotated, Literal

from msgspec import Meta, Struct

__all__ = [
    "Admittance",
    "ClientId",
    "Count",
    "Incoming",
    "IncomingMotion",
    "Joints",
    "Name",
    "Offset",
    "OnLimit",
    "OnLimitName",
    "OnLoss",
    "OnLossName",
    "Pid",
    "Points",
    "Secret",
    "SideName",
    "SpaceName",
    "Text",
    "Times",
    "Tolerances",
    "Until",
]

Count = Annotated[int, Meta(ge=0, le=2**62)]
Pid = Annotated[int, Meta(ge=0, le=2**31)]
Name = Annotated[str, Meta(min_length=1, max_length=64)]
Text = Annotated[str, Meta(max_length=512)]
ClientId = Annotated[str, Meta(pattern=r"^[0-9A-Za-z_-]{1,64}\Z")]
Secret = Annotated[str, Meta(pattern=r"^[0-9A-Za-z_-]{0,64}\Z")]
Joints = Annotated[tuple[float, ...], Meta(max_length=64)]
Points = Annotated[tuple[Joints, ...], Meta(max_length=4096)]
Times = Annotated[tuple[float, ...], Meta(max_length=4096)]
Tolerances = Annotated[tuple[float | None, ...], Meta(max_length=64)]
Offset = Annotated[int, Meta(ge=-(2**62), le=2**62)]

# How a user writes them.
SideName = Literal["left", "right"]
SpaceName = Literal["joint", "pose"]
OnLossName = Literal["hold", "pause"]
OnLimitName = Literal["reject", "clip"]


class OnLoss(str, Enum):
    """What happens when the owner vanishes: keep holding, or pause the robot at once."""

    HOLD = "hold"
    PAUSE = "pause"


class OnLimit(str, Enum):
    """What happens to a target outside the limits: refused, or clipped and reported."""

    REJECT = "reject"
    CLIP = "clip"


def _tag(class_name: str) -> str:
    """Return the tag of a request class: `OpenStream` -> `open_stream`."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", class_name).lower()


class Incoming(
    Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True, tag_field="type", tag=_tag
):
    """A request; its JSON form has a `type` beside its fields.

    What has its default is not sent: an older daemon, which refuses fields that it does not know, understands all that a
    later client wants of it. So a default never changes while `PROTOCOL_VERSION` stays; `tests/api/wire` holds them.
    """


class Until(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """A touch at which a motion or a stream ends before its goal, by what `model.dynamics` estimates; `contact()` makes one.

    Attributes:
        force_n: From what force on the hand on [N].
        direction: Along which the surroundings push, x, y, z in the arm's shoulder frame, of any length; empty for any.
        back_off_m: How far the hand then goes back along the way it came [m]; 0 to stay.
        seen: Number of the newest touch that who asks was told of; 0 for none.
    """

    force_n: float
    direction: Joints = ()
    back_off_m: float = 0.0
    seen: Count = 0


class IncomingMotion(Incoming, frozen=True, kw_only=True):
    """A request that moves arms; it ends at a touch where it has an `until`."""

    until: Until | None = None


class Admittance(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the hand of an arm yields to what pushes it: per axis x, y, z of the arm's shoulder frame, then about them.

    Attributes:
        mass: Virtual mass [kg], then moment of inertia [kg·m²]; None where it does not yield.
        damping: Of its velocity [N·s/m, N·m·s/rad].
        stiffness: Of its spring to the anchor [N/m, N·m/rad].
    """

    mass: Tolerances
    damping: Joints
    stiffness: Joints
