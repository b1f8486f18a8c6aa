"""Which topic fills which dimension of a dataset, in which unit, and by which rule: the vendor's layout, or one's own in TOML.

```toml
[[feature]]
name = "observation.state"

[[feature.part]]
names = ["left_joint1_position", "left_joint2_position"]
unit = "rad"
source = [{ topic = "/left_arm/joint_states", field = "position", rule = "linear" }]
```

Dimensions follow each other as the parts do. Of several sources the first is taken whose topic is in the bag.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec

from gateway.dataset.episode import INTEGERS
from gateway.dataset.videos import IMAGES
from gateway.errors import Code, Refusal, to_exception
from gateway.recording.topics import STALE_NS
from gateway.robot.topics import (
    CHASSIS_STATE,
    arm_state,
    ee_pose,
    gripper_command,
    gripper_state,
    joint_command,
    pose_command,
)
from gateway.robot.vector_layout import STATE_NAMES, STATE_WIDTHS
from gateway.values import Side

__all__ = ["ACTION", "STATE", "Feature", "Layout", "Part", "Rule", "Source", "load", "vendor_layout"]

STATE: Final = "observation.state"
ACTION: Final = "action"
RESERVED: Final = ("timestamp", *INTEGERS, "task")
"""LeRobot fills these itself."""
ACTION_SHIFT_S: Final = 1 / 90
"""The vendor's converter takes an action so long after the state [s]: what answers it, not what led to it."""

Rule = Literal["hold", "next", "nearest", "linear", "slerp"]
"""The last sample before; the first after; the nearer; between both; between both on the sphere (quaternions xyzw)."""
Need = Literal["always", "if_recorded", "never"]
Name = Annotated[str, msgspec.Meta(min_length=1)]
Seconds = Annotated[float, msgspec.Meta(gt=0.0)]


class Source(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where values come from.

    Attributes:
        topic: ROS name, without the namespace of a bridge.
        field: Of its message, such as `position`, `data` or `pose.position`; a structure counts as its numbers in order.
        first: Which number of the field is the first one taken.
        convert: `gripper_torque`: from a gripper's command 0..1 to its torque [N·m] (manual §4.4).
        rule: How a value between samples is found.
        shift_s: Added to a row's time before it is looked up [s].
        stale_s: How far a sample may be away, for `linear` and `slerp` how far apart two [s].
    """

    topic: Name
    field: Name
    first: Annotated[int, msgspec.Meta(ge=0)] = 0
    convert: Literal["", "gripper_torque"] = ""
    rule: Rule = "hold"
    shift_s: float = 0.0
    stale_s: Seconds = STALE_NS / 1e9


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Dimensions that are filled from one field.

    Attributes:
        names: Of the dimensions.
        unit: Of all of them.
        source: Where they may come from, the preferred one first.
        need: `always`: a bag without it is refused, and no row is made without a value; `if_recorded`: the same, but for a bag
            that has none of it; `never`: where there is no value it is 0. What is 0 for want of a value is told.
    """

    names: Annotated[tuple[Name, ...], msgspec.Meta(min_length=1)]
    unit: str = ""
    source: Annotated[tuple[Source, ...], msgspec.Meta(min_length=1)]
    need: Need = "always"

    @property
    def label(self) -> str:
        """Its dimensions in short."""
        return self.names[0] if len(self.names) == 1 else f"{self.names[0]} .. {self.names[-1]}"


class Feature(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A vector of a dataset: its name and its parts in order."""

    name: Name
    part: Annotated[tuple[Part, ...], msgspec.Meta(min_length=1)]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all dimensions."""
        return tuple(name for part in self.part for name in part.names)


class Layout(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All vectors of a dataset."""

    feature: Annotated[tuple[Feature, ...], msgspec.Meta(min_length=1)]


def load(path: Path) -> Layout:
    """Read a layout from TOML.

    Raises:
        Rejected: BAD_REQUEST, the file cannot be read, is not of this form, names something twice, or as LeRobot does.
    """
    try:
        layout = msgspec.toml.decode(path.read_bytes(), type=Layout)
    except (OSError, msgspec.MsgspecError) as error:
        raise to_exception(_refusal(f"{path}: {error}")) from error
    for kind, names in (
        ("feature", [feature.name for feature in layout.feature]),
        *((f"dimension of {feature.name}", list(feature.names)) for feature in layout.feature),
    ):
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise to_exception(_refusal(f"{path}: {', '.join(twice)}: the same name for more than one {kind}"))
    for feature in layout.feature:
        if feature.name in RESERVED or feature.name.startswith(IMAGES) or "/" in feature.name:
            message = f"{path}: {feature.name!r} cannot be the name of a feature"
            bound = f"no /, none of LeRobot's own ({', '.join(RESERVED)}), and none of a camera ({IMAGES}...)"
            raise to_exception(_refusal(f"{message}: {bound}", value=feature.name, bound=bound))
        for part in feature.part:
            if len(part.names) != 4 and any(source.rule == "slerp" for source in part.source):
                message = (
                    f"{path}: {part.names[0]}: slerp is for the four numbers of a quaternion, not {len(part.names)}"
                )
                raise to_exception(_refusal(message))
    return layout


def vendor_layout(size: int = 72) -> Layout:
    """Return the layout of the maker's datasets, filled from public topics or, in bags of the robot itself, internal ones.

    A policy of the maker's reads joint positions, and is taught joint positions and torques of the grippers: these are needed.

    Args:
        size: 48 (joints, grippers), 62 (and hand poses) or 72 (and chassis motors, lift).

    Raises:
        Rejected: BAD_REQUEST, another size.
    """
    if size not in STATE_WIDTHS:
        message = f"vectors of {size} dimensions are not known"
        raise to_exception(_refusal(message, value=str(size), bound=", ".join(map(str, STATE_WIDTHS))))
    return Layout(feature=(_feature(STATE, size, _state_parts()), _feature(ACTION, size, _action_parts())))


Rows = list[tuple[int, str, Need, tuple[Source, ...]]]
"""Per part: its width, unit, need and sources."""


def _feature(name: str, size: int, rows: Rows) -> Feature:
    parts, begin = [], 0
    for width, unit, need, sources in rows:
        if begin < size:
            parts.append(Part(names=STATE_NAMES[begin : begin + width], unit=unit, need=need, source=sources))
        begin += width
    return Feature(name=name, part=tuple(parts))


QUANTITIES: Final = (("position", "rad"), ("velocity", "rad/s"), ("effort", "N·m"))


def _state_parts() -> Rows:
    rows: Rows = []
    for field, unit in QUANTITIES:
        need: Need = "always" if field == "position" else "if_recorded"
        for side in Side:
            for width, topic in ((7, arm_state(side)), (1, gripper_state(side))):
                rows.append((width, unit, need, (Source(topic=topic, field=field, rule="linear"),)))
    for side in Side:
        place = Source(topic=ee_pose(side), field="position", rule="linear")
        turn = Source(topic=ee_pose(side), field="orientation", rule="slerp")
        rows += [(3, "m", "if_recorded", (place,)), (4, "", "if_recorded", (turn,))]
    for field, unit in QUANTITIES:
        rows.append((3, unit, "if_recorded", (Source(topic=CHASSIS_STATE, field=field, rule="linear"),)))
    return [*rows, (1, "rad/s", "if_recorded", (Source(topic="/kinco/actual_velocity", field="data"),))]


def _action_parts() -> Rows:
    """Return the same of what was commanded: inside the robot (in its own bags), or on the public topics."""
    rows: Rows = []
    for field, unit in QUANTITIES:
        for side in Side:
            arm = [_command(f"/{side}_arm/joint_cmd", field, "linear")]
            gripper = [_command(f"/{side}_gripper/joint_cmd", field)]
            if field == "position":
                arm.append(_command(joint_command(side), field, "linear"))
            if field == "effort":
                gripper.append(_command(gripper_command(side), "data", convert="gripper_torque"))
            rows.append((7, unit, "always" if field == "position" else "never", tuple(arm)))
            rows.append((1, unit, "always" if field == "effort" else "never", tuple(gripper)))
    for side in Side:
        topics = (f"/{side}_arm/target_ee_pose", pose_command(side))
        rows.append((3, "m", "never", tuple(_command(topic, "position", "linear") for topic in topics)))
        rows.append((4, "", "never", tuple(_command(topic, "orientation", "slerp") for topic in topics)))
    for field, unit in QUANTITIES:
        rows.append((3, unit, "never", (_command("/chassis/joint_cmd", field),)))
    return [*rows, (1, "rad/s", "never", (_command("/kinco/cmd_velocity", "data"),))]


def _command(topic: str, field: str, rule: Rule = "hold", convert: Literal["", "gripper_torque"] = "") -> Source:
    """Return where a command comes from: of what moves in many small steps the way, of what is switched the last word."""
    return Source(topic=topic, field=field, convert=convert, rule=rule, shift_s=ACTION_SHIFT_S)


def _refusal(message: str, value: str = "", bound: str = "") -> Refusal:
    return Refusal(code=Code.BAD_REQUEST, message=message, field="layout", value=value, bound=bound)
