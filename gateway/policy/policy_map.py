"""What a policy is shown and what it says, as a TOML file: names of state and views in, columns of actions out.

`vendor_openpi`, `left_eyes` and `lerobot` come with the package. An unknown key is an error.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec

from gateway.errors import Code, failure
from gateway.robot.vector_layout import STATE_NAMES, STATE_WIDTHS
from gateway.video.decoding.views import COMPOSITE, VIEWS

if sys.version_info >= (3, 11):
    import tomllib
else:  # the same parser under its old name
    import tomli as tomllib

__all__ = ["COLUMNS", "PRESETS", "Actions", "Observed", "PolicyMap", "load_map"]

PRESETS = ("vendor_openpi", "left_eyes", "lerobot")
COLUMNS: Mapping[str, int] = {
    f"{side}_{part}": width
    for side in ("left", "right")
    for part, width in (("arm", 7), ("gripper_effort", 1), ("gripper_command", 1))
} | {"chassis_velocity": 3, "lift_velocity": 1}
"""What actions may consist of, and how many numbers each has; see `chunks.Chunk` for units."""
IGNORED: Mapping[str, int] = {f"ignored_{width}": width for width in range(1, 129)}
"""Numbers between them that are not played."""


class Observed(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a policy is shown.

    Attributes:
        state_key: Key of the state in an observation.
        state: How many dims of the layout, 48, 62 or 72; or their names.
        prompt_key: Key of the prompt; empty where none is sent.
        resize: Side of the square that pictures are made, with bars [pixels]; 0 leaves them as they come.
        images: Key of the observation -> view of the cameras.
    """

    state_key: str = "observation/state"
    state: int | tuple[str, ...] = STATE_WIDTHS[0]
    prompt_key: str = "prompt"
    resize: int = 0
    images: Mapping[str, str] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the state's dims, in order."""
        return STATE_NAMES[: self.state] if isinstance(self.state, int) else self.state

    def __post_init__(self) -> None:
        if isinstance(self.state, int) and self.state not in STATE_WIDTHS:
            raise ValueError(f"state = {self.state}; one of {STATE_WIDTHS}, or a list of names")
        if unknown := sorted(set(self.names) - set(STATE_NAMES)):
            raise ValueError(f"state: {unknown[0]!r} is no dim of the layout, as {STATE_NAMES[0]!r} is")
        if unknown := sorted(set(self.images.values()) - {COMPOSITE, *VIEWS}):
            raise ValueError(f"images: {unknown[0]!r} is no view of {', '.join(VIEWS)}")
        if self.resize and not 16 <= self.resize <= 2048:
            raise ValueError(f"resize = {self.resize}; 0, or 16 to 2048 pixels (openpi's models take 224)")


class Actions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a policy says.

    Attributes:
        columns: What a row of actions consists of, in order; see `COLUMNS` and `IGNORED`.
        key: Key of the actions in an answer.
    """

    columns: tuple[str, ...]
    key: str = "actions"

    @property
    def places(self) -> Iterator[tuple[str, slice]]:
        """Each column that is played, and where it is in a row."""
        begin = 0
        for column in self.columns:
            end = begin + (COLUMNS.get(column) or IGNORED[column])
            if column in COLUMNS:
                yield column, slice(begin, end)
            begin = end

    @property
    def width(self) -> int:
        """Numbers in a row."""
        return sum(COLUMNS.get(column) or IGNORED[column] for column in self.columns)

    def __post_init__(self) -> None:
        if unknown := sorted(set(self.columns) - {*COLUMNS, *IGNORED}):
            raise ValueError(
                f"columns: {unknown[0]!r} is none of {', '.join(COLUMNS)}, ignored_N (N to {len(IGNORED)})"
            )
        played = [column for column in self.columns if column in COLUMNS]
        parts = [column.removesuffix("_effort").removesuffix("_command") for column in played]
        if len(set(parts)) != len(parts) or not {"left_arm", "right_arm"} & set(parts):
            raise ValueError(f"columns: {', '.join(self.columns)}: an arm is needed, and each part once at most")


class PolicyMap(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A policy's observations and actions, as in the file."""

    observation: Observed
    actions: Actions


def load_map(name: str, resize: int | None = None) -> PolicyMap:
    """Return a map.

    Args:
        name: Of a preset, or the path of a file.
        resize: In place of the map's own; None leaves it.

    Raises:
        Rejected: BAD_REQUEST, there is none, or something in it is unknown or malformed.
    """
    path = Path(__file__).with_name(f"{name}.toml") if name in PRESETS else Path(name)
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
        if resize is not None:
            document.setdefault("observation", {})["resize"] = resize
        return msgspec.convert(document, PolicyMap)
    except (OSError, ValueError, TypeError) as error:  # not there, no TOML, or none of ours
        message, hint = f"the policy's map {name}: {error}", f"name a file, or one of {', '.join(PRESETS)}"
        raise failure(Code.BAD_REQUEST, message, field="file", value=name, hint=hint) from None
