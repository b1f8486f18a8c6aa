"""What the robot publishes, and when: its state on absolute grids, with measurement noise and its own clock.

Rates (§4.1.1, §4.11): joint states, gripper states, chassis and end-effector poses 200 Hz, `/fsm_state` 20 Hz,
`/api/current_mode` 1 Hz. Layout, names and frame ids as sampled in §4.8. The noise of a grid point depends on the
seed and on its number only, never on how the robot is stepped. It favours no direction, not even for those who look at every
n-th point only: what they see would add up where they echo it (§6.2).
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pycdr2 import IdlStruct

from cdr_types.messages import builtin_interfaces, geometry_msgs, sensor_msgs, std_msgs
from gateway.sim.robot.arm import SimArm
from gateway.sim.robot.chassis import SimChassis
from gateway.sim.robot.clock import RobotClock
from gateway.sim.robot.geometry import EePose, arm_geometry
from gateway.sim.robot.gripper import SimGripper
from gateway.sim.robot.manual import (
    CHASSIS_STATE,
    CURRENT_MODE,
    DOF,
    FSM_STATE,
    MS,
    STATE_TOPICS,
    S,
    Side,
    arm_state_topic,
    ee_pose_topic,
    gripper_state_topic,
    joint_names,
)
from gateway.sim.robot.settings import SimSettings

__all__ = ["Grid", "Telemetry"]

Array = NDArray[np.float64]

_ROWS: Final = 1021  # a prime: whoever takes every n-th row sees all of them before any again
_COLUMNS: Final = 2 * (2 * DOF + 2) + 6
_SIDE_TOPICS: Final = {side: (arm_state_topic(side), ee_pose_topic(side), gripper_state_topic(side)) for side in Side}
_ALL: Final[frozenset[str]] = frozenset(STATE_TOPICS)
_CHASSIS_NAMES: Final = ("chassis_joint1", "chassis_joint2", "chassis_joint3")


@lru_cache(maxsize=8)
def _noise_table(seed: int) -> Array:
    """Return unit noise of mean zero, one row per grid point modulo `_ROWS`, shape (1021, 38)."""
    table = np.random.default_rng(seed).standard_normal((_ROWS, _COLUMNS))
    table -= table.mean(axis=0)
    table.setflags(write=False)
    return table


class Grid:
    """An absolute time grid: `start + n * period`.

    Attributes:
        next_ns: The next point [ns].
    """

    def __init__(self, start_ns: int, period_ns: int) -> None:
        self.next_ns = start_ns
        self._period_ns = period_ns

    def advance(self) -> None:
        """Pass the next point."""
        self.next_ns += self._period_ns

    def skip_to(self, now_ns: int) -> None:
        """Leave out every point but the last one that is due."""
        if now_ns > self.next_ns:
            self.next_ns += (now_ns - self.next_ns) // self._period_ns * self._period_ns


class Telemetry:
    """Builds the messages that are due.

    Attributes:
        state_grid: Grid of the 200 Hz topics.
    """

    def __init__(self, settings: SimSettings, start_ns: int, clock: RobotClock) -> None:
        self.state_grid = Grid(start_ns, settings.state_period_ns)
        self._period_ns = settings.state_period_ns
        self._fsm_grid = Grid(start_ns, 50 * MS)
        self._mode_grid = Grid(start_ns, 1 * S)
        self._clock = clock
        noise = _noise_table(settings.seed)
        self._arm_noise = {
            side: (
                noise[:, 2 * DOF * index : 2 * DOF * index + DOF] * settings.noise_rad,
                noise[:, 2 * DOF * index + DOF : 2 * DOF * (index + 1)] * settings.noise_radps,
            )
            for index, side in enumerate(Side)
        }
        self._effort_noise = dict(zip(Side, np.hsplit(_noise_table(settings.seed + 1)[:, : 2 * DOF], 2), strict=True))
        self._noise = noise[:, 4 * DOF :]
        self._noise_rad, self._noise_radps = settings.noise_rad, settings.noise_radps
        self._holding = {side: np.array(settings.holding_nm(side)) for side in Side}
        self._gripper_zero_rad = settings.gripper_zero_rad
        self._told: dict[Side, Array] = {}
        self._names = {side: list(joint_names(side)) for side in Side}

    @property
    def next_ns(self) -> int:
        """When something is due next [ns]."""
        return min(self.state_grid.next_ns, self._fsm_grid.next_ns, self._mode_grid.next_ns)

    def skip_to(self, now_ns: int) -> None:
        """Leave out every message but the last one of each topic that is due."""
        for grid in (self.state_grid, self._fsm_grid, self._mode_grid):
            grid.skip_to(now_ns)

    def collect(
        self,
        now_ns: int,
        arms: Mapping[Side, SimArm],
        grippers: Mapping[Side, SimGripper],
        chassis: SimChassis,
        report: Callable[[], tuple[int, str]],
        topics: Container[str] = _ALL,
    ) -> list[tuple[str, IdlStruct]]:
        """Return the messages due at a point of the grids, and pass it.

        `report` gives the value of `/fsm_state` and the text of `/api/current_mode`; only `topics` are built.
        """
        due: list[tuple[str, IdlStruct]] = []
        if self.state_grid.next_ns <= now_ns:
            self.state_grid.advance()
            number = now_ns // self._period_ns
            for side, arm in arms.items():
                arm_topic, pose_topic, gripper_topic = _SIDE_TOPICS[side]
                told = self._measured(arm, number)
                if arm.stuck.any():
                    told = np.where(arm.stuck, self._told.get(side, told), told)
                self._told[side] = told
                if arm_topic in topics:
                    due.append((arm_topic, self._arm(side, told, now_ns)))
                if pose_topic in topics:
                    due.append((pose_topic, _pose(side, told[0] + arm.zero_rad)))
                if gripper_topic in topics:
                    due.append((gripper_topic, self._gripper(grippers[side], number, now_ns)))
            if CHASSIS_STATE in topics:
                due.append((CHASSIS_STATE, self._chassis(chassis, number, now_ns)))
        if self._fsm_grid.next_ns <= now_ns:
            self._fsm_grid.advance()
            if FSM_STATE in topics:
                due.append((FSM_STATE, std_msgs.Int32(data=report()[0])))
        if self._mode_grid.next_ns <= now_ns:
            self._mode_grid.advance()
            if CURRENT_MODE in topics:
                due.append((CURRENT_MODE, std_msgs.String(data=report()[1])))
        return due

    def _header(self, now_ns: int, frame_id: str) -> std_msgs.Header:
        sec, nanosec = divmod(self._clock.stamp_ns(now_ns), S)
        sec = (sec + 2**31) % 2**32 - 2**31  # an int32, which a fault can make overflow
        return std_msgs.Header(stamp=builtin_interfaces.Time(sec=sec, nanosec=nanosec), frame_id=frame_id)

    def _measured(self, arm: SimArm, number: int) -> Array:
        """Return an arm's measured positions [rad], velocities [rad/s] and efforts [N·m] at a grid point, shape (3, 7)."""
        positions, velocities = self._arm_noise[arm.side]
        row = number % _ROWS
        velocity, effort = arm.v_radps + velocities[row], arm.effort_nm
        if effort is None:  # no forces are simulated
            effort = self._holding[arm.side] - 0.5 * velocity
        effort = effort + arm.effort_noise_nm * self._effort_noise[arm.side][row]
        return np.array((arm.q_rad + arm.measured_offset_rad + positions[row], velocity, effort))

    def _arm(self, side: Side, told: Array, now_ns: int) -> sensor_msgs.JointState:
        """Return the joint state message of an arm at a grid point (§4.8)."""
        position, velocity, effort = told.tolist()
        return sensor_msgs.JointState(
            header=self._header(now_ns, f"{side.value}_arm"),
            name=list(self._names[side]),
            position=position,
            velocity=velocity,
            effort=effort,
        )

    def _gripper(self, gripper: SimGripper, number: int, now_ns: int) -> sensor_msgs.JointState:
        """Return the motor state message of a gripper (§4.8)."""
        begin = 0 if gripper.side is Side.LEFT else 2
        noise = self._noise[number % _ROWS, begin : begin + 2].tolist()
        return sensor_msgs.JointState(
            header=self._header(now_ns, f"{gripper.side.value}_gripper"),
            name=[f"{gripper.side.value[0]}_joint8"],
            position=[gripper.angle_rad + self._gripper_zero_rad + noise[0] * self._noise_rad],
            velocity=[gripper.v_radps + noise[1] * self._noise_radps],
            effort=[gripper.effort_nm],
        )

    def _chassis(self, chassis: SimChassis, number: int, now_ns: int) -> sensor_msgs.JointState:
        """Return the wheel state message (§4.8)."""
        noise = self._noise[number % _ROWS, 4:]
        angles, speeds = chassis.wheels()
        return sensor_msgs.JointState(
            header=self._header(now_ns, "chassis"),
            name=list(_CHASSIS_NAMES),
            position=(angles + noise[:3] * self._noise_rad).tolist(),
            velocity=(speeds + noise[3:] * self._noise_radps).tolist(),
            effort=(0.1 * noise[3:]).tolist(),
        )


def _pose(side: Side, position: Array) -> geometry_msgs.Pose:
    """Return the end-effector pose message that belongs to joint positions, as the geometry has them (§4.0.2)."""
    pose: EePose = arm_geometry(side).forward(position.tolist())
    x, y, z = pose.position_m
    qx, qy, qz, qw = pose.quat_xyzw
    return geometry_msgs.Pose(
        position=geometry_msgs.Point(x=x, y=y, z=z),
        orientation=geometry_msgs.Quaternion(x=qx, y=qy, z=qz, w=qw),
    )
