"""Parameters: the numbers that are fitted, in one vector, with their names, and how the end effector moves with each.

Seven joint offsets; five of the end effector's displacement (three lengths, two turns); five of the shoulder's likewise.
Turns about joint 7's and joint 1's own axis are left out (`correction.py` says why). The lag is by how much later than its
stamp a pose was: poses have no stamp of their own, and when they arrived is known to some milliseconds only. In the vector,
turns are radians, lengths are in units of `LENGTH_M` and the lag is seconds, so that a column of the Jacobian is as long as
its effect.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from gateway.kinematics.correction import ArmCorrection
from gateway.kinematics.placement import Placement
from gateway.kinematics.solving.batch import ArmBatch, Many, rotations_of
from gateway.kinematics.solving.chain import ArmChain
from gateway.values import ARM_DOF, Vector

__all__ = ["LENGTH_M", "Group", "Parameters"]

Array = NDArray[np.float64]

LENGTH_M = 0.3
"""About half an arm: what makes a metre and a radian count alike."""


class Group(str, Enum):
    """What may be fitted."""

    JOINTS = "joints"
    EE = "ee"
    SHOULDER = "shoulder"
    LAG = "lag"


class Parameters:
    """A choice of parameters of one arm.

    Attributes:
        names: Of each, for people.
        units: `rad`, `m` or `s`, of each.
        scales: Value of each in its unit for an element of 1 of the vector, shape (k,).
    """

    def __init__(self, chain: ArmChain, groups: frozenset[Group]) -> None:
        self.batch = ArmBatch(chain)
        self.groups = groups
        self._ee_turns = _across(self.batch.last_axis)
        self._shoulder_turns = _across(self.batch.first_axis)
        names: list[str] = []
        units: list[str] = []
        if Group.JOINTS in groups:
            names += [f"joint {number} zero" for number in range(1, ARM_DOF + 1)]
            units += ["rad"] * ARM_DOF
        for group, turns in ((Group.EE, self._ee_turns), (Group.SHOULDER, self._shoulder_turns)):
            if group in groups:
                names += [f"{group.value} {axis}" for axis in "xyz"]
                names += [f"{group.value} turn about {'xyz'[int(np.argmax(np.abs(turn)))]}" for turn in turns]
                units += ["m"] * 3 + ["rad"] * 2
        if Group.LAG in groups:
            names.append("lag")
            units.append("s")
        self.names: tuple[str, ...] = tuple(names)
        self.units: tuple[str, ...] = tuple(units)
        self.scales = np.array([LENGTH_M if unit == "m" else 1.0 for unit in units])

    def correction(self, vector: Array) -> ArmCorrection:
        """Return what a vector of parameters, shape (k,), says of the arm."""
        offsets, ee, shoulder = self._split(vector)
        return ArmCorrection(
            offsets_rad=tuple(offsets.tolist()),
            ee=_placement(ee, self._ee_turns),
            shoulder=_placement(shoulder, self._shoulder_turns),
        )

    def forward(self, vector: Array, q_rad: Array, dq_radps: Array | None = None) -> Many:
        """Return the corrected arm in many configurations.

        Args:
            vector: Parameters, shape (k,).
            q_rad: Reported joints, shape (n, 7) [rad].
            dq_radps: Their velocities, shape (n, 7) [rad/s]; needed where the lag is a parameter.
        """
        offsets, ee, shoulder = self._split(vector)
        if Group.LAG in self.groups and dq_radps is not None:
            q_rad = q_rad + float(vector[-1]) * dq_radps
        at = self.batch.forward(q_rad + offsets)
        p = at.p_m + at.rotation @ ee[:3]
        rotation = at.rotation @ rotations_of(ee[3:] @ self._ee_turns)
        turn = rotations_of(shoulder[3:] @ self._shoulder_turns)
        return Many(p @ turn.T + shoulder[:3], turn @ rotation, at.points_m @ turn.T + shoulder[:3], at.axes @ turn.T)

    def jacobian(self, at: Many, dq_radps: Array | None = None) -> Array:
        """Return how the end effector moves with each parameter.

        Exact where the turns of end effector and shoulder are zero, and off by as much as these otherwise: good enough for
        a search whose residual is exact.

        Args:
            at: The corrected arm in n configurations.
            dq_radps: Velocities of the joints there, shape (n, 7) [rad/s]; needed where the lag is a parameter.

        Returns:
            Shape (n, 6, k): translation in units of `LENGTH_M`, then rotation [rad].
        """
        columns: list[Array] = []
        arms = at.p_m[:, None, :] - at.points_m
        joints = np.concatenate([np.cross(at.axes, arms) / LENGTH_M, at.axes], axis=2).transpose(0, 2, 1)
        if Group.JOINTS in self.groups:
            columns += [joints]
        none = np.zeros((len(at.p_m), 3, 3))
        if Group.EE in self.groups:
            turns = at.rotation @ self._ee_turns.T
            columns += [np.concatenate([at.rotation, none], axis=1), np.concatenate([none[:, :, :2], turns], axis=1)]
        if Group.SHOULDER in self.groups:
            turns = np.broadcast_to(self._shoulder_turns.T, (len(at.p_m), 3, 2))
            swung = np.cross(self._shoulder_turns[None], at.p_m[:, None, :]).transpose(0, 2, 1) / LENGTH_M
            columns += [np.concatenate([none + np.eye(3), none], axis=1), np.concatenate([swung, turns], axis=1)]
        if Group.LAG in self.groups:
            columns += [joints @ (np.zeros(joints.shape[::2]) if dq_radps is None else dq_radps)[:, :, None]]
        return np.concatenate(columns, axis=2)

    def _split(self, vector: Array) -> tuple[Array, Array, Array]:
        """Return offsets (7,), end effector (5,) and shoulder (5,) in radians and metres."""
        values = list(vector * self.scales)
        parts = []
        for group, size in ((Group.JOINTS, ARM_DOF), (Group.EE, 5), (Group.SHOULDER, 5)):
            parts.append(np.array(values[:size]) if group in self.groups else np.zeros(size))
            if group in self.groups:
                del values[:size]
        return parts[0], parts[1], parts[2]


def _across(axis: Array) -> Array:
    """Return two unit vectors across an axis, as near to coordinate axes as can be, shape (2, 3)."""
    first, second = sorted(range(3), key=lambda index: abs(float(axis[index])))[:2]
    rows: list[Array] = []
    for index in sorted((first, second)):
        row = np.eye(3)[index]
        for other in (axis, *rows):
            row = row - (row @ other) * other
        rows.append(row / np.linalg.norm(row))
    return np.array(rows) + 0.0


def _placement(values: Array, turns: Array) -> Placement:
    x, y, z = rotations_of(values[3:] @ turns).tolist()
    p: Vector = tuple(values[:3].tolist())
    return Placement(p, (tuple(x), tuple(y), tuple(z)))
