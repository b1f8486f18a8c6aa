"""Arms that are kept apart, in virtual time: the engine with its body model against the simulated robot, and what is near."""

from __future__ import annotations

from gateway.core.robot_state.body_model import BodyModel, body_model
from gateway.robot.topics import CURRENT_MODE, FSM_STATE, arm_state, ee_pose
from gateway.settings.settings import ArmSettings, LocalSettings, ModelSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import ArmState, Side, Vector
from tests.kinematics.guarded_arms import ZEROS_RAD, calibrated, model, really
from tests.pair import Pair

__all__ = ["SpacedPair"]

TOPICS = (
    FSM_STATE,
    CURRENT_MODE,
    *(topic for side in Side for topic in (arm_state(side), ee_pose(side))),
)


class SpacedPair(Pair):
    """An engine that keeps arms apart, and its robot, ACTIVE, with a model that agrees.

    Args:
        arm: Limits; None for the defaults.
        asked: Whether the configuration asks for it.
        has_model: Whether there is a model at all.
        sim: Of the robot; None for a usual one.
        is_calibrated: Whether joints of robot and model have the zeros `ZEROS_RAD`.
    """

    def __init__(
        self,
        arm: ArmSettings | None = None,
        *,
        asked: bool = True,
        has_model: bool = True,
        sim: SimSettings | None = None,
        is_calibrated: bool = False,
    ) -> None:
        settings = Settings(
            arm=arm or ArmSettings(),
            local=LocalSettings(snapshot_hz=10.0),
            model=ModelSettings(check=has_model, self_collision=asked),
        )
        super().__init__(
            settings, sim, model=BodyModel(calibrated(), settings) if is_calibrated else body_model(settings)
        )
        self._real = really if is_calibrated else dict
        for side, zeros_rad in ZEROS_RAD.items() if is_calibrated else ():
            for joint, delta_rad in enumerate(zeros_rad, start=1):
                fault = {"fault": "joint_zero", "side": side.value, "joint": joint, "delta_rad": delta_rad}
                self.robot.inject(fault, self.now_ns)
        self.topics = TOPICS
        self.epoch = self.activate()
        self.streams: dict[Side, int] = {}
        self.least_m = self.least_measured_m = float("inf")
        """Least gaps of setpoints and of measured joints while arms were led [m]."""
        self.run(1.2)

    @property
    def coordinator(self):
        """What the engine moves."""
        return self.engine._coordinator

    @property
    def setpoints(self) -> dict[Side, Vector]:
        """Of both arms [rad]; where an arm has none, as measured."""
        arms = self.coordinator.body.joint_arms
        return {side: arms[side].values if arms[side].running else self.joints(side) for side in Side}

    def joints(self, side: Side) -> Vector:
        """Return the measured joints of an arm [rad]."""
        value = self.heard[arm_state(side)].value
        assert isinstance(value, ArmState)
        return value.q_rad

    def off_rad(self, goals) -> float:
        """Return how far the setpoint farthest from its goal is [rad]."""
        return max(abs(a - b) for side in goals for a, b in zip(self.setpoints[side], goals[side], strict=True))

    def look(self):
        """Note how near parts really are, by setpoints and as measured; return the nearest pair of the setpoints."""
        near = model().posture(self._real(self.setpoints)).nearest()
        self.least_m = min(self.least_m, near.gap_m)
        measured = model().posture(self._real({side: self.joints(side) for side in Side})).nearest()
        self.least_measured_m = min(self.least_measured_m, measured.gap_m)
        return near

    def lead(self, targets, seconds: float) -> None:
        """Stream targets, 20 a second, and look at every setpoint."""
        for side in targets:
            if side not in self.streams:
                self.streams[side] = self.stream(self.epoch, side)
        for step in range(round(100 * seconds)):
            if step % 5 == 0:
                for side, target in targets.items():
                    self.target(self.epoch, self.streams[side], target)
            self.step()
            self.look()
            if step > 20 and self.off_rad(targets) < 1e-9 and self.coordinator.body.is_at_rest:
                return
