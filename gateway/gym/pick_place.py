"""`TeleAvatar-PickPlace-v0`: a block is to be picked from the table and put on the green mark.

The robot is the simulated lift model with forces, standing at its table. Actions go through the gateway's engine as a client's
stream of targets does: limits of position, velocity, acceleration and jerk, and, if the settings say so, arms kept apart.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from msgspec.structs import replace
from numpy.typing import NDArray

from gateway.gym.virtual_robot import STATE, VirtualRobot
from gateway.robot.limits import GRIPPER_RELAXED
from gateway.robot.vector_layout import EYES
from gateway.settings.settings import Settings
from gateway.sim.robot.geometry import quat_from_rotation, rotation_from_quat
from gateway.sim.robot.manual import Side as SimSide
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side

if TYPE_CHECKING:
    from gateway.sim.physics.drawing import Drawing
    from gateway.sim.physics.lens import Lens

__all__ = ["PickPlace"]

Array = NDArray[Any]

S: Final = 1_000_000_000
ABOVE_RAD: Final = (1.03, 0.71, -1.70, 2.10, -1.33, -1.22, 0.36)
START_RAD: Final = {SimSide.LEFT: ABOVE_RAD, SimSide.RIGHT: tuple(-q for q in ABOVE_RAD)}
"""Both hands over the table, pointing down and a little ahead [rad]."""
PLACES_M: Final = ((0.90, 0.96), (0.18, 0.26))
"""Where the block may lie, x and y on the ground's frame [m]."""
NEAR_M, LYING_M, SLOW_MPS, OPEN_M, AWAY_M = 0.025, 0.005, 0.02, 0.045, 0.06
"""Success: the block that near to the mark's middle, that low, that slow; pads that far apart, or that far from it."""
PADS_M: Final = {SimSide.LEFT: (0.185, -0.0068, 0.0), SimSide.RIGHT: (0.185, 0.0068, 0.0)}
"""Where the pads hold a thing, in the hand's frame [m]."""
SIDE_PX: Final = 224
"""Pictures are squares of this side [pixels]."""
BOUNDS: Final = {"position": 3.2, "velocity": 20.0, "effort": 100.0, "orientation": 1.0}
"""What is shown of the state is clipped to this, either way [rad or m, rad/s, N·m]: healthy values are far from it."""


class PickPlace(gymnasium.Env[dict[str, Array], Array]):
    """A task for one arm, or both.

    Action, -1..1: per arm seven joints over their limits (§4.13, or tighter settings) and the gripper's command, 0 (opens) to
    1 (closes, §4.4); the left arm first. What is beyond is clipped. `to_units` and `to_action` translate.

    Observation: `state`, the first 62 of `robot.vector_layout.STATE_NAMES` as measured (rad, rad/s, N·m, m, quaternions xyzw);
    `block`, where it truly is in the left shoulder's frame, and `goal`, where it shall be: x, y, z [m], the block's quaternion
    xyzw after it. With `pictures` what the eyes of `EYES["vendor_openpi"]` see by these names: RGB, shape (224, 224, 3), whole
    between black bars, as policies are shown a robot's.

    Reward: 1 for success, else 0. If `dense`, besides how much nearer [m] pads came to the block and, twice, the block to
    its goal in this step: a difference of potentials, so that the best policy stays the same.

    Terminated: success, the block lies still within 25 mm of the mark's middle, in no hand; or the engine latched, as when an
    arm is pushed against the table: a robot would have to be recovered, wherever the block lies. Truncated after 400 steps
    (`max_episode_steps`).

    Info: `is_success`; `limited`, sides whose arm lags behind its targets because they ask for more than the limits of motion
    allow; `told`, what the engine refused or warned of in this step (`CODE: message`); `latches`, the causes of such an end.

    Args:
        arms: Whose actions are taken; another arm is held, its gripper relaxed. Another word is a ValueError.
        dense: Whether the reward is dense.
        rate_hz: Actions per second of virtual time, 1 to 50 [Hz]; ValueError beyond.
        pictures: Whether there are pictures; they need EGL or OSMesa.
        settings: Of the gateway, None for its defaults; the model is always `lift`.
        render_mode: `rgb_array` for pictures of the scene from the side, shape (480, 640, 3).
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012  Gymnasium's own

    def __init__(
        self,
        arms: Literal["both", "left", "right"] = "both",
        *,
        dense: bool = False,
        rate_hz: float = 20.0,
        pictures: bool = False,
        settings: Settings | None = None,
        render_mode: str | None = None,
    ) -> None:
        if not 1.0 <= rate_hz <= 50.0:
            raise ValueError(f"rate_hz is {rate_hz}, outside [1, 50] Hz")
        self.metadata = {**self.metadata, "render_fps": round(rate_hz)}
        self.render_mode, self._dense, self._period_ns = render_mode, dense, round(S / rate_hz)
        chosen = settings or Settings()
        link, local = replace(chosen.link, model="lift"), replace(chosen.local, snapshot_hz=max(rate_hz, 10.0))
        self._settings = replace(chosen, link=link, local=local)
        self._sides = tuple(Side) if arms == "both" else (Side(arms),)
        lower, upper = chosen.arm.lower_rad, chosen.arm.upper_rad
        self._low = np.array([number for side in self._sides for number in (*lower[side], 0.0)])
        self._high = np.array([number for side in self._sides for number in (*upper[side], 1.0)])
        self.action_space = spaces.Box(-1.0, 1.0, self._low.shape, np.float32)
        state = np.array([next(BOUNDS[part] for part in BOUNDS if part in name) for name in STATE], np.float32)
        self._bounds = {"state": state, "block": np.full(7, 10.0, np.float32), "goal": np.full(3, 10.0, np.float32)}
        self._eyes = EYES["vendor_openpi"] if pictures else {}
        self.observation_space = spaces.Dict(  # type: ignore[assignment]  # mypy takes a Dict's numbers for any
            {name: spaces.Box(-bound, bound) for name, bound in self._bounds.items()}
            | {name: spaces.Box(0, 255, (SIDE_PX, SIDE_PX, 3), np.uint8) for name in self._eyes}
        )
        self._drawing: Drawing | None = None
        self._lenses: dict[str, Lens] = {}
        self._robot: VirtualRobot  # made by `reset`

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Put the robot at its table, enabled, and the block somewhere before it; `seed` decides where, and about the noise.

        Raises:
            PhysicsMissing: MuJoCo is not installed; with the remedy.
            GatewayError: The engine does not enable the robot with these settings; with code and remedy.
        """
        super().reset(seed=seed)
        x_m, y_m = [float(self.np_random.uniform(*span)) for span in PLACES_M]
        noise = int(self.np_random.integers(2**31))
        sim = SimSettings(
            model="lift", physics="mujoco", seed=noise, start_rad=START_RAD, start_x_m=0.54, start_lowered_m=0.165
        )
        self._robot = robot = VirtualRobot(self._settings, sim)
        from gateway.sim.physics.scene import MARK_M, TABLE_TOP_M, THINGS  # not before the robot said what it lacks

        self._goal_m = np.array([*MARK_M, TABLE_TOP_M + THINGS["block"][1][2]])
        robot.world.pose_thing("block", (x_m, y_m, float(self._goal_m[2])))
        self._potential_m, self._block_m = self._measure()
        return self._observation(), {"is_success": False, **robot.report()}

    def step(self, action: Array) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """Send an action's targets and let a period pass. ValueError: another shape than the space's, or not finite."""
        robot, units = self._robot, self.to_units(action).reshape(-1, 8)
        wanted = dict(zip(self._sides, units.tolist(), strict=True))
        for side in Side:
            *q_rad, gripper = wanted.get(side, (*START_RAD[SimSide(side.value)], GRIPPER_RELAXED))
            robot.aim(side, tuple(q_rad), gripper)
        robot.run(robot.now_ns + self._period_ns)
        before, before_m = self._potential_m, self._block_m
        self._potential_m, self._block_m = self._measure()
        told, speed_mps = robot.report(), float(np.linalg.norm(self._block_m - before_m)) * S / self._period_ns
        is_success = self._is_done(speed_mps) and not told["latches"]
        reward = float(is_success) + (self._potential_m - before if self._dense else 0.0)
        info = {"is_success": is_success, **told}
        return self._observation(), reward, is_success or bool(told["latches"]), False, info

    def to_units(self, action: Array) -> Array:
        """Return joints [rad] and grippers' commands 0..1 of an action; ValueError: another shape, or not finite."""
        normal = np.asarray(action, np.float64)
        if normal.shape != self._low.shape or not np.isfinite(normal).all():
            raise ValueError(f"an action of shape {normal.shape}: {self._low.shape} finite numbers are needed")
        units: Array = np.clip(self._low + 0.5 * (normal + 1.0) * (self._high - self._low), self._low, self._high)
        return units

    def to_action(self, units: Array) -> Array:
        """Return the action for joints [rad] and grippers' commands: the inverse of `to_units`."""
        return np.asarray(2.0 * (units - self._low) / (self._high - self._low) - 1.0, np.float32)

    def render(self) -> Array | None:
        """Return the scene from the side, RGB; None without a `render_mode`. DrawingMissing: nothing here can draw."""
        return self._draws().draw(self._robot.world.positions()) if self.render_mode else None

    def close(self) -> None:
        """Give back what draws; safe to call twice. What is drawn after it begins anew."""
        if self._drawing is not None:
            self._drawing.close()
            self._drawing = None

    def _placed(self, name: str) -> tuple[Array, Array]:
        """Return position [m] and rotation of a thing or a frame of the robot, on the ground's frame."""
        place = self._robot.world.place(name)
        return np.array(place.position_m), rotation_from_quat(place.quat_xyzw)

    def _away_m(self, side: SimSide, block_m: Array) -> float:
        """Return how far the block is from between a hand's pads [m]."""
        wrist_m, turned = self._placed(f"{side.value}_ee")
        return float(np.linalg.norm(block_m - wrist_m - turned @ PADS_M[side]))

    def _measure(self) -> tuple[float, Array]:
        """Return the potential [m], and where the block is on the ground's frame [m]."""
        block_m, _ = self._placed("block")
        away_m = min(self._away_m(SimSide(side.value), block_m) for side in self._sides)
        return -away_m - 2.0 * float(np.linalg.norm(block_m - self._goal_m)), block_m

    def _is_done(self, speed_mps: float) -> bool:
        block_m, opening_m = self._block_m, self._robot.world.opening_m
        x_m, y_m, z_m = np.abs(block_m - self._goal_m)
        lies = np.hypot(x_m, y_m) < NEAR_M and z_m < LYING_M and speed_mps < SLOW_MPS
        return bool(lies and all(opening_m(side) > OPEN_M or self._away_m(side, block_m) > AWAY_M for side in SimSide))

    def _observation(self) -> dict[str, Array]:
        (shoulder_m, frame), (_, turned) = self._placed("left_shoulder_base"), self._placed("block")
        block = (*(frame.T @ (self._block_m - shoulder_m)), *quat_from_rotation((frame.T @ turned).tolist()))
        goal = frame.T @ (self._goal_m - shoulder_m)
        numbers = {"state": self._robot.state(), "block": block, "goal": goal}
        bounds = self._bounds
        seen: dict[str, Array] = {k: np.array(v, np.float32).clip(-bounds[k], bounds[k]) for k, v in numbers.items()}
        if self._eyes:
            self._draws().pose(self._robot.world.positions())
        for name, lens in self._lenses.items():
            view = lens.see(self._draws().look(self._eyes[name], *lens.drawn, lens.fovy_deg))
            bar = (SIDE_PX - len(view)) // 2
            seen[name] = np.pad(view, ((bar, SIDE_PX - len(view) - bar), (0, 0), (0, 0)))
        return seen

    def _draws(self) -> Drawing:
        if self._drawing is None:
            from gateway.sim.physics.body_numbers import body_numbers
            from gateway.sim.physics.drawing import Drawing
            from gateway.sim.physics.lens import lens_of

            self._drawing = Drawing(has_lift=True, width=640, height=480)
            for name, eye in self._eyes.items():
                camera = body_numbers().cameras[eye.split("_eye")[0].rpartition("_")[0]]
                width, height = camera["sensor_px"]
                self._lenses[name] = lens_of(camera, (SIDE_PX, SIDE_PX * height // width))
        return self._drawing
