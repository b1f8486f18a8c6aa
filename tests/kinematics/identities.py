"""Measurements of a robot whose arm is not as described: the witness's geometry, displaced and with noise."""

from __future__ import annotations

import math

import numpy as np

from gateway.kinematics.identification.pairing import Pair
from gateway.kinematics.placement import quat_from_rows
from gateway.kinematics.solving.batch import rotations_of
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.sim.robot.geometry import arm_geometry, rotation_from_quat
from gateway.sim.robot.manual import Side as SimSide
from gateway.values import EePose

OFFSETS_RAD = np.array([4.0, -7.0, 11.0, -3.0, 9.0, -6.0, 15.0]) * 1e-3
EE_M = np.array([1.5, -2.5, 4.0]) * 1e-3
EE_TURN_RAD = np.array([6.0, -9.0, 0.0]) * 1e-3
"""No turn about joint 7's axis, which is z of the end effector: that is joint 7's zero."""
NOISE_M, NOISE_RAD = 0.2e-3, 0.5e-3


def postures(side, count=2000, share=0.8, seed=0):
    """Return a smooth motion of all joints through a share of their range, shape (count, 7) [rad]."""
    rng = np.random.default_rng(seed)
    low, high = np.array(JOINT_LOWER_RAD[side]), np.array(JOINT_UPPER_RAD[side])
    time = np.linspace(0.0, 60.0, count)[:, None]
    rates = 2.0 * math.pi * (0.05 + 0.06 * rng.random((3, 7)))
    waves = sum(np.sin(rate * time + phase) for rate, phase in zip(rates, rng.uniform(0.0, 6.3, (3, 7)), strict=True))
    return 0.5 * (low + high) + 0.5 * share * (high - low) * waves / np.abs(waves).max(axis=0)


def measured(side, q_rad, *, offsets=OFFSETS_RAD, ee_m=EE_M, ee_turn=EE_TURN_RAD, noise=1.0, seed=1, lag_s=0.0):
    """Return pairs 20 ms apart, as a robot with these offsets would give them, each pose of so much later than it says."""
    rng = np.random.default_rng(seed)
    arm = arm_geometry(SimSide(side.value))
    hand = rotations_of(np.asarray(ee_turn))
    places = np.arange(len(q_rad))
    later = np.stack([np.interp(places + lag_s / 0.02, places, column) for column in q_rad.T], axis=1)
    pairs = []
    for index, q in enumerate(q_rad):
        at = arm.forward(later[index] + offsets)
        rotation = rotation_from_quat(at.quat_xyzw)
        p = np.array(at.position_m) + rotation @ ee_m + noise * NOISE_M * rng.normal(size=3)
        turned = rotations_of(noise * NOISE_RAD * rng.normal(size=3)) @ rotation @ hand
        pose = EePose(p_m=tuple(p.tolist()), quat_xyzw=quat_from_rows(turned.tolist()))
        pairs.append(Pair(stamp_ns=20_000_000 * index, q_rad=tuple(q.tolist()), pose=pose))
    return pairs
