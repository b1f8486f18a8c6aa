"""The body for a view in three dimensions: the capsules of the collision model, the frames, and the nearest pair.

All is in `chest`: midway between the shoulders, x forward, y left, z up [m]. Grippers are wide open and the lift is at its
top, as the gateway has them when it keeps arms apart (§4.12): what is drawn is what it reckons with. Pure; about 1 ms a look.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from gateway.api.protocol import Snapshot
from gateway.kinematics.calibration import RobotIdentity, load
from gateway.kinematics.collision import CollisionModel, Posture
from gateway.kinematics.configured import configured
from gateway.kinematics.frames import ROOT
from gateway.kinematics.sight import robot_frames
from gateway.kinematics.solving.chain import ArmChain
from gateway.robot.topics import shoulder_frame
from gateway.values import ArmState, Side, ValueRefused, Vector

if TYPE_CHECKING:
    from gateway.settings.settings import Settings

__all__ = ["Body", "BodySeen", "BodyShape", "NearPair", "Part"]

FIXED = (ROOT, *(shoulder_frame(side) for side in Side))
STALE_NS = 200_000_000
"""Joints that are older are not drawn [ns]."""
MOVING = tuple(f"{side}_{name}" for side in Side for name in ("ee", "wrist_camera"))


class Part(Struct, frozen=True):
    """A capsule: its name, the arm that moves it (or empty), and its radius [m]."""

    name: str
    side: str
    radius_m: float


class BodyShape(Struct, frozen=True, kw_only=True):
    """What does not change: the capsules in their order, and frames that no joint moves.

    A frame is the place of its origin [m], then its axes x, y and z, shape (12,). `why` says why there are none.
    """

    parts: tuple[Part, ...]
    frames: dict[str, tuple[float, ...]]
    why: str = ""


class NearPair(Struct, frozen=True, kw_only=True):
    """Two parts, the free distance between them, negative inside each other, and the nearest points on their lines [m]."""

    first: str
    second: str
    gap_m: float
    from_m: tuple[float, ...]
    to_m: tuple[float, ...]


class BodySeen(Struct, frozen=True, kw_only=True):
    """The body at measured joints: both ends of each capsule's line, shape (6,) [m]; frames that joints move; nearest parts."""

    lines_m: tuple[tuple[float, ...], ...]
    frames: dict[str, tuple[float, ...]]
    near: NearPair


class Body:
    """One robot's body.

    Args:
        settings: Of its gateway: they name its model and its calibration.

    Raises:
        ConfigError: A file that they name cannot be used.
    """

    def __init__(self, settings: Settings) -> None:
        link, file = settings.link, settings.model.calibration
        description = configured(settings)
        self._model = CollisionModel(description)
        identity = RobotIdentity(serial=link.serial, model=link.model) if link.serial else None
        own = load(Path(file).expanduser(), identity) if file else None
        self._tree = robot_frames(description, {side: ArmChain(description, side) for side in Side}, own)
        shoulders = [self._tree.locate(ROOT, shoulder_frame(side)).transform for side in Side]
        self._middle_m = np.mean([shoulder.p_m for shoulder in shoulders], axis=0)
        self._chest_R_root = shoulders[0].rotation.T
        names = [capsule.name for capsule in self._model.capsules]
        self._pairs = {frozenset({names[i], names[j]}): n for n, (i, j, *_) in enumerate(self._model.pairs)}
        parts = tuple(Part(one.name, str(one.side) if one.after else "", one.radius_m) for one in self._model.capsules)
        self.shape = BodyShape(parts=parts, frames={name: self._frame(name, {}) for name in FIXED})

    def seen(self, view: Snapshot) -> BodySeen | None:
        """Return it at a state; None while the joints of an arm are not known, or are older than 0.2 s."""
        measured = {side: view.arms[side.value].measured for side in Side}
        joints = {side: one.q_rad for side, one in measured.items() if one is not None and one.age_ns < STALE_NS}
        if len(joints) < len(Side):
            return None
        try:
            posture = self._model.posture(joints)
        except ValueRefused:  # no joints of this robot
            return None
        arms = {side: ArmState(q_rad=q, dq_radps=(), tau_nm=(), stamp_ns=0) for side, q in joints.items()}
        lines = tuple(_rounded((x, y, z, x + u, y + v, z + w)) for x, y, z, u, v, w, _ in posture.segments)
        frames = {name: self._frame(name, arms) for name in MOVING}
        return BodySeen(lines_m=lines, frames=frames, near=self._near(posture, view))

    def _near(self, posture: Posture, view: Snapshot) -> NearPair:
        told = view.spacing  # what the gateway itself says, where it keeps parts apart
        pair = None if told is None else self._pairs.get(frozenset({told.first, told.second}))
        near = posture.nearest() if pair is None else posture.told(pair)
        gap_m = near.gap_m if pair is None or told is None or told.gap_m is None else told.gap_m
        points = {"from_m": _rounded(near.first_m), "to_m": _rounded(near.second_m)}
        return NearPair(first=near.first, second=near.second, gap_m=gap_m, **points)

    def _frame(self, name: str, arms: dict[Side, ArmState]) -> Vector:
        at = self._tree.locate(ROOT, name, arms).transform
        p_m, axes = self._chest_R_root @ (at.p_m - self._middle_m), self._chest_R_root @ at.rotation
        return _rounded([*p_m, *axes.T.ravel()])


def _rounded(numbers: Iterable[float]) -> Vector:
    return tuple(round(float(number), 4) for number in numbers)
