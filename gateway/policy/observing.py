"""What a policy is shown: the state as a vector by name, views of the newest undamaged picture, and the task in words.

An arm that is not heard is an error, never a zero. Dims that nobody publishes (manual §4.12), or of parts never heard, are zero
and named.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from gateway.client import RobotState
from gateway.errors import Code, failure
from gateway.policy.policy_map import Observed
from gateway.robot.vector_layout import STATE_NAMES

if TYPE_CHECKING:
    from gateway.video.decoding.frame import Frame

__all__ = ["OLD_S", "Observation", "Observer", "resized", "state_vector"]

STALE_S = 0.1
"""An arm's state must not be older [s]."""
OLD_S = 0.5
"""Nor a picture, a gripper, a pose or the chassis [s]."""
INDEX = {name: index for index, name in enumerate(STATE_NAMES)}


class Observation(Struct, frozen=True, kw_only=True):
    """What a policy is shown.

    Attributes:
        values: For the server.
        observed_ns: When the arms were where it says, monotonic [ns].
        measured: Per side its seven joints [rad].
        uncovered: Dims of its state that are zero because nobody knows them.
    """

    values: Mapping[str, Any]
    observed_ns: int
    measured: Mapping[str, NDArray[np.float64]]
    uncovered: tuple[str, ...]


def state_vector(state: RobotState) -> tuple[NDArray[np.float32], frozenset[str]]:
    """Return the 72 dims of a state, and the names of those that are not known and therefore zero.

    Raises:
        Stale: PART_STALE, an arm was not heard for 0.1 s, or something else that was heard once for 0.5 s.
    """
    vector, known = np.zeros(len(STATE_NAMES), np.float32), set[str]()

    def put(first: str, values: NDArray[np.float64]) -> None:
        begin = INDEX[first]
        vector[begin : begin + len(values)] = values
        known.update(STATE_NAMES[begin : begin + len(values)])

    parts = [("left_joint1", state.left_arm), ("left_gripper", state.left_gripper)]
    parts += [("right_joint1", state.right_arm), ("right_gripper", state.right_gripper)]
    for first, motor in [*parts, ("chassis_motor1", state.chassis)]:
        _require_young(motor.name, motor.age, STALE_S if "arm" in motor.name else OLD_S)
        if motor.is_known:
            for quantity, values in (("position", motor.q), ("velocity", motor.dq), ("effort", motor.tau)):
                put(f"{first}_{quantity}", values)
    for side in ("left", "right"):
        if state.view.arms[side].pose_age_ns is not None:
            pose = state.arm(side).pose
            _require_young(f"{side}_arm's pose", pose.age, OLD_S)
            put(f"{side}_ee_position_x", pose.p)
            put(f"{side}_ee_orientation_x", pose.quat_xyzw)
    return vector, frozenset(STATE_NAMES) - known


def _require_young(name: str, age_s: float, most_s: float) -> None:
    if age_s > most_s and (age_s != float("inf") or name.endswith("_arm")):
        message = f"the newest state of the {name.replace('_', ' ')} is {age_s:.2f} s old, {most_s:g} s is the bound"
        raise failure(Code.PART_STALE, message, field=name, value=f"{age_s:.3g}", unit="s")


def resized(picture: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """Return a picture in a square of `side` pixels: whole, bilinear, centred between black bars, as openpi does it."""
    from PIL import Image

    height, width = picture.shape[:2]
    ratio = max(width, height) / side
    inner = max(1, int(width / ratio)), max(1, int(height / ratio))
    square = Image.new("RGB", (side, side))
    corner = (side - inner[0]) // 2, (side - inner[1]) // 2
    square.paste(Image.fromarray(picture).resize(inner, Image.Resampling.BILINEAR), corner)
    return np.asarray(square)


class Observer:
    """Makes observations.

    Args:
        layout: What the policy is shown.
        prompt: The task, in words.
        look: Returns a fresh state of the robot.
        newest: Returns the newest undamaged picture, None before the first; not asked where the policy is shown none.
        now_ns: The monotonic clock [ns].
    """

    def __init__(
        self,
        layout: Observed,
        prompt: str,
        look: Callable[[], RobotState],
        newest: Callable[[], Frame | None],
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._layout, self._prompt, self._look, self._newest, self._now_ns = layout, prompt, look, newest, now_ns

    def observe(self) -> Observation:
        """Look.

        Raises:
            Stale: PART_STALE, arms or cameras are not heard.
        """
        layout, values = self._layout, dict[str, Any]()
        state = self._look()  # first: it may wait, and pictures grow old
        observed_ns = self._now_ns() - round(1e9 * max(state.left_arm.age, state.right_arm.age))
        vector, unknown = state_vector(state)
        if layout.images:
            picture = self._newest()
            if picture is None or picture.age > OLD_S:
                age = (
                    "there is none yet"
                    if picture is None
                    else f"it is {picture.age:.2f} s old, {OLD_S:g} s is the bound"
                )
                message, hint = f"the cameras' newest undamaged picture: {age}", "see `ta2 video check`"
                raise failure(Code.PART_STALE, message, field="cameras", hint=hint)
            for key, view in layout.images.items():
                values[key] = resized(picture[view], layout.resize) if layout.resize else picture[view]
        values[layout.state_key] = vector[[INDEX[name] for name in layout.names]]
        if layout.prompt_key:
            values[layout.prompt_key] = self._prompt
        return Observation(
            values=values,
            observed_ns=observed_ns,
            measured={side: np.array(state.arm(side).q) for side in ("left", "right")},
            uncovered=tuple(name for name in layout.names if name in unknown),
        )
