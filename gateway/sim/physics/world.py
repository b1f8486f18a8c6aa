"""The scene under MuJoCo: motors in, positions out, one step at a time.

Deterministic: the same motors' inputs in the same steps give the same world. Knows parts by side, not topics, modes or
the robot's rules. MuJoCo's own arrays never leave this module.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gateway.sim.physics.body_numbers import quat_wxyz
from gateway.sim.physics.linkage import hand_angles
from gateway.sim.physics.robot_xml import SERVO_GROUPS, arm_joint, hand_link
from gateway.sim.physics.scene import STEP_NS, THINGS, scene_xml
from gateway.sim.robot.manual import DOF, Side
from gateway.sim.robot.parts import WorldUnstable

__all__ = ["Placed", "World"]

Array = NDArray[np.float64]

_WHEELS: Final = ("wheel1", "wheel2", "wheel3")
_BASE: Final = ("base_x", "base_y", "base_yaw")


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """Where something is in the ground's frame (x forward at the start, z up).

    Attributes:
        position_m: x, y, z [m].
        quat_xyzw: Orientation, unit quaternion.
    """

    position_m: tuple[float, float, float]
    quat_xyzw: tuple[float, float, float, float]


class World:
    """Robot, table and things.

    Attributes:
        has_lift: Whether the torso moves.
        steps: Steps made so far.
        model: MuJoCo's model, for a viewer.
        data: MuJoCo's state, for a viewer.
    """

    def __init__(self, *, has_lift: bool) -> None:
        mujoco.set_mju_user_warning(_be_silent)  # else it writes a file where the process was started
        self.has_lift = has_lift
        self.steps = 0
        self.model: Any = mujoco.MjModel.from_xml_string(scene_xml(has_lift=has_lift))
        self.data: Any = mujoco.MjData(self.model)
        joint = {
            name: self.model.joint(name).id
            for name in (*_BASE, *_WHEELS, *(f"{side.value}_rotor" for side in Side), *(["lift"] if has_lift else []))
        }
        self._qpos = {name: int(self.model.jnt_qposadr[number]) for name, number in joint.items()}
        self._qvel = {name: int(self.model.jnt_dofadr[number]) for name, number in joint.items()}
        self._arm_q, self._arm_v, self._follow = {}, {}, {}
        for side in Side:
            names = [arm_joint(side, number) for number in range(1, DOF + 1)]
            numbers = [self.model.joint(name).id for name in names]
            self._arm_q[side] = _run(self.model.jnt_qposadr[numbers])
            self._arm_v[side] = _run(self.model.jnt_dofadr[numbers])
            self._follow[side] = np.array([self.model.actuator(f"{name}_follow").id for name in names])
        self._load = {side: self.model.body(f"{side.value}_load").id for side in Side}
        self._motor = {side: self.model.actuator(f"{side.value}_gripper").id for side in Side}
        self._pulls = np.array([self.model.actuator(f"{name}_pull").id for name in _WHEELS])
        self._spins = np.array([self.model.actuator(name).id for name in _WHEELS])
        self._lift_motor = self.model.actuator("lift").id if has_lift else -1
        self._radius_m = float(self.model.geom(_WHEELS[0]).size[0])
        for side in Side:
            self.drive(side, None)

    # -------------------------------------------------------------------------------------------------------- posing

    def pose_base(self, x_m: float) -> None:
        """Put the base somewhere ahead of where it starts, at rest [m]; for the start."""
        self.data.qpos[self._qpos["base_x"]] = x_m
        mujoco.mj_forward(self.model, self.data)

    def pose_arm(self, side: Side, q_rad: Array) -> None:
        """Put an arm somewhere at rest, without a motion; for the start.

        Args:
            side: Which.
            q_rad: Joint positions, shape (7,) [rad].
        """
        self.data.qpos[self._arm_q[side]] = q_rad
        self.data.qvel[self._arm_v[side]] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def pose_gripper(self, side: Side, motor_rad: float) -> None:
        """Put a gripper's whole linkage at a motor angle at rest; for the start.

        Args:
            side: Which.
            motor_rad: Motor angle, 0 closed [rad].

        Raises:
            ValueError: The linkage cannot be there.
        """
        name = side.value
        self.data.qpos[self._qpos[f"{name}_rotor"]] = motor_rad
        for number, (crank_rad, coupler_rad) in enumerate(hand_angles(motor_rad), start=1):
            for part, angle_rad in (("crank", crank_rad), ("coupler", coupler_rad), ("finger", -crank_rad)):
                self.data.joint(f"{name}_{part}{number}").qpos[0] = angle_rad
        mujoco.mj_forward(self.model, self.data)

    def block_gripper(self, side: Side, motor_rad: float) -> None:
        """Let a gripper's motor meet something hard when it closes to an angle [rad]: a thing that is nowhere else."""
        self.model.jnt_range[self.model.joint(f"{side.value}_rotor").id, 0] = motor_rad

    def pose_lift(self, lowered_m: float) -> None:
        """Put the lift somewhere below its top at rest [m]; for the start. Does nothing where there is no lift."""
        if self.has_lift:
            self.data.qpos[self._qpos["lift"]] = self.data.ctrl[self._lift_motor] = lowered_m
            mujoco.mj_forward(self.model, self.data)

    def pose_thing(self, name: str, position_m: tuple[float, float, float]) -> None:
        """Put a thing somewhere at rest, upright.

        Args:
            name: Of `scene.THINGS`.
            position_m: Its middle [m].
        """
        joint = self.data.joint(name)
        joint.qpos[:] = (*position_m, 1.0, 0.0, 0.0, 0.0)
        joint.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def differ(self, percent: float, seed: int) -> dict[Side, Array]:
        """Make the arms differ from their published numbers, see `SimSettings.differs_percent`; for the start.

        Returns:
            By side the noise of the efforts, one standard deviation, shape (7,) [N·m].
        """
        rng, model, noise = np.random.default_rng(seed), self.model, {}
        for side in Side:
            off = 1.0 + 0.01 * percent * rng.uniform(0.5, 1.0, (2, DOF)) * rng.choice([-1.0, 1.0], (2, DOF))
            joints = [model.joint(arm_joint(side, number)).id for number in range(1, DOF + 1)]
            links, dofs = model.jnt_bodyid[joints], model.jnt_dofadr[joints]
            model.body_mass[links] *= off[0]
            model.body_inertia[links] *= off[0][:, None]
            model.dof_frictionloss[dofs] *= off[1]
            noise[side] = 1e-3 * percent * model.jnt_actfrcrange[joints, 1]
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return noise

    # -------------------------------------------------------------------------------------------------------- motors

    def drive(self, side: Side, target_rad: Array | None) -> None:
        """Have an arm's servos follow a target, or brake without holding a position.

        Args:
            side: Which arm.
            target_rad: Joint positions, shape (7,) [rad]; None for the zero-velocity command (§4.10).
        """
        follow, brake = (1 << group for group in SERVO_GROUPS[side])
        off = self.model.opt.disableactuator
        if target_rad is None:
            self.model.opt.disableactuator = (off | follow) & ~brake
        else:
            self.model.opt.disableactuator = (off | brake) & ~follow
            self.data.ctrl[self._follow[side]] = target_rad

    def grip(self, side: Side, torque_nm: float) -> None:
        """Apply a torque to a gripper's motor [N m], positive opens."""
        self.data.ctrl[self._motor[side]] = torque_nm

    def hold(self, side: Side, load_kg: float) -> None:
        """Have a hand hold a point between its pads that weighs something; 0 for nothing [kg]."""
        load = self._load[side]
        if self.model.body_mass[load] != load_kg:
            self.model.body_mass[load] = load_kg
            mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def roll(self, wheels_radps: Array) -> None:
        """Have the wheels turn at a speed, shape (3,) [rad/s]."""
        self.data.ctrl[self._spins] = wheels_radps
        self.data.ctrl[self._pulls] = wheels_radps * self._radius_m

    def lower(self, lowered_m: float) -> None:
        """Have the lift go to a place below its top [m]."""
        self.data.ctrl[self._lift_motor] = lowered_m

    def step(self) -> None:
        """Let one step pass.

        Raises:
            WorldUnstable: The solver gave up; MuJoCo would start the world anew without a word.
        """
        mujoco.mj_step(self.model, self.data)
        self.steps += 1
        for kind in (
            mujoco.mjtWarning.mjWARN_BADQPOS,
            mujoco.mjtWarning.mjWARN_BADQVEL,
            mujoco.mjtWarning.mjWARN_BADQACC,
        ):
            if self.data.warning[kind].number:
                raise WorldUnstable(f"after {self.time_s:.3f} s of physics: {kind.name}; start the simulation again")

    # -------------------------------------------------------------------------------------------------------- what is

    @property
    def time_s(self) -> float:
        """How much time has passed in here [s]."""
        return self.steps * STEP_NS / 1e9

    def arm(self, side: Side) -> tuple[Array, Array, Array]:
        """Return an arm's joint positions [rad], velocities [rad/s] and motor torques [N m], shape (7,) each."""
        q, v = self._arm_q[side], self._arm_v[side]
        return self.data.qpos[q].copy(), self.data.qvel[v].copy(), self.data.qfrc_actuator[v].copy()

    def gripper(self, side: Side) -> tuple[float, float]:
        """Return a gripper's motor angle [rad] and speed [rad/s], positive opens."""
        name = f"{side.value}_rotor"
        return float(self.data.qpos[self._qpos[name]]), float(self.data.qvel[self._qvel[name]])

    def opening_m(self, side: Side) -> float:
        """Return how far a gripper's pads are apart [m]; 0 closed."""
        hand = self.data.body(hand_link(side)).xmat.reshape(3, 3)
        first, second = (self.data.site(f"{side.value}_tip{number}").xpos for number in (1, 2))
        return float((first - second) @ hand[:, 2]) * (1.0 if side is Side.LEFT else -1.0)

    def wheels(self) -> tuple[Array, Array]:
        """Return the wheels' angles [rad] and speeds [rad/s], shape (3,) each."""
        angles = [self.data.qpos[self._qpos[name]] for name in _WHEELS]
        return np.array(angles), np.array([self.data.qvel[self._qvel[name]] for name in _WHEELS])

    def base(self) -> tuple[float, float, float]:
        """Return where the base is on the ground: x, y [m] and yaw [rad]."""
        x, y, yaw = (float(self.data.qpos[self._qpos[name]]) for name in _BASE)
        return x, y, yaw

    def lowered_m(self) -> float | None:
        """Return how far below its top the lift is [m]; None where there is none."""
        return float(self.data.qpos[self._qpos["lift"]]) if self.has_lift else None

    def positions(self) -> list[float]:
        """Return where everything is, in MuJoCo's own coordinates: for who draws this very scene."""
        return list(map(float, self.data.qpos))

    def place(self, name: str) -> Placed:
        """Return where a thing or a frame of the robot is.

        Args:
            name: A thing of `scene.THINGS`, or a frame such as `left_ee`.

        Raises:
            KeyError: There is no such thing or frame.
        """
        found = self.data.body(name) if name in THINGS else self.data.site(name)
        w, x, y, z = quat_wxyz(np.asarray(found.xmat).reshape(3, 3))
        px, py, pz = np.asarray(found.xpos).tolist()
        return Placed(position_m=(px, py, pz), quat_xyzw=(x, y, z, w))


def _be_silent(_: str) -> None:
    """Take MuJoCo's warnings; `World.step` reads those that count."""


def _run(numbers: Array) -> slice:
    """Return consecutive numbers as a slice: a view instead of a copy at 500 Hz."""
    first = int(numbers[0])
    if numbers.tolist() != list(range(first, first + len(numbers))):
        raise ValueError(f"not consecutive: {numbers.tolist()}")
    return slice(first, first + len(numbers))
