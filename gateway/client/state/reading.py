"""What a user reads: the robot's state at one instant, as frozen views with numpy vectors.

Rules
    * A view never changes. Vectors are read-only copies; ages [s] are counted to the moment the view was made, from the
      daemon's own count and the time since the snapshot arrived here (the transport adds less than a millisecond on one
      host). They are lower bounds: the robot stamps what it publishes, not what its motors measured (manual §4.1.1).
    * What was never measured raises `Stale` when it is read: no made-up numbers. `is_known` tells beforehand.
    * Units: rad, rad/s, N·m, m; quaternions xyzw; poses in the arm's own shoulder frame (manual §4.0.1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from msgspec import Struct

from gateway.api import protocol
from gateway.client.asking.requests import read_only
from gateway.client.connection.session import Sighting
from gateway.client.state.contact import Contact
from gateway.client.state.showing import state_line, state_table, vector
from gateway.errors import Code, failure

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["ArmState", "MotorState", "Pose", "RobotState", "state_of"]


class Pose(Struct, frozen=True):
    """Measured pose of an end effector in its arm's shoulder frame.

    Attributes:
        p: Position [m], shape (3,).
        quat_xyzw: Orientation, unit norm, shape (4,).
        age: Age of the sample [s].
        frame: `left_shoulder_base` or `right_shoulder_base` (manual §4.0.1).
    """

    p: NDArray[np.float64]
    quat_xyzw: NDArray[np.float64]
    age: float
    frame: str


@dataclass(frozen=True, slots=True, repr=False)
class MotorState:
    """Measured motors: of an arm, a gripper (one) or the chassis (three).

    Attributes:
        name: What it is, e.g. `left_gripper`.
    """

    name: str
    _measured: protocol.MotorView | None
    _since_ns: int

    @property
    def is_known(self) -> bool:
        """Whether anything was ever measured."""
        return self._measured is not None

    @property
    def q(self) -> NDArray[np.float64]:
        """Positions [rad]. Raises `Stale` before the first sample."""
        return read_only(self._known().q_rad)

    @property
    def dq(self) -> NDArray[np.float64]:
        """Velocities [rad/s]. Raises `Stale` before the first sample."""
        return read_only(self._known().dq_radps)

    @property
    def tau(self) -> NDArray[np.float64]:
        """Torques [N·m]. Raises `Stale` before the first sample."""
        return read_only(self._known().tau_nm)

    @property
    def age(self) -> float:
        """Age of the sample [s]; infinite before the first."""
        return float("inf") if self._measured is None else (self._measured.age_ns + self._since_ns) / 1e9

    def __repr__(self) -> str:
        """Show name, positions and age."""
        if self._measured is None:
            return f"<{self.name}: never heard>"
        return f"<{self.name}: q {vector(self._measured.q_rad)} rad, {self.age:.3f} s old>"

    def _known(self) -> protocol.MotorView:
        if self._measured is None:
            raise failure(Code.PART_STALE, f"no state of {self.name} has arrived yet", field=self.name)
        return self._measured


@dataclass(frozen=True, slots=True, repr=False)
class ArmState(MotorState):
    """One arm: seven joints in the order of manual §4.0.3, its pose, and where it is being sent."""

    _view: protocol.ArmView
    _side: str

    @property
    def pose(self) -> Pose:
        """Measured end-effector pose. Raises `Stale` before the first sample."""
        view = self._view
        if view.pose_age_ns is None:
            raise failure(Code.PART_STALE, f"no pose of {self.name} has arrived yet", field=self.name)
        return Pose(
            p=read_only(view.p_m),
            quat_xyzw=read_only(view.quat_xyzw),
            age=(view.pose_age_ns + self._since_ns) / 1e9,
            frame=f"{self._side}_shoulder_base",
        )

    @property
    def touch(self) -> protocol.TouchView | None:
        """The last touch that ended what moved it: force, wrench, place and time; None before the first."""
        return self._view.touch

    @property
    def is_streaming(self) -> bool:
        """Whether setpoints are being sent to it."""
        return self._view.streaming

    @property
    def q_ref(self) -> NDArray[np.float64]:
        """The last setpoint [rad], shape (7,); empty while no joint setpoints are sent."""
        return read_only(self._view.q_ref_rad)

    @property
    def dq_ref(self) -> NDArray[np.float64]:
        """Its velocity [rad/s], shape (7,); empty while no setpoints are sent."""
        return read_only(self._view.dq_ref_radps)

    @property
    def space(self) -> str:
        """`joint` or `pose`: what its setpoints are, by the control mode that the robot has for it (manual §2.3)."""
        return self._view.space

    @property
    def p_ref(self) -> NDArray[np.float64]:
        """Position of the last setpoint of the end effector [m], shape (3,); empty while no poses are sent."""
        return read_only(self._view.ref_p_m)

    @property
    def quat_ref_xyzw(self) -> NDArray[np.float64]:
        """Its orientation, shape (4,); empty while no poses are sent."""
        return read_only(self._view.ref_quat_xyzw)

    @property
    def tracking_error(self) -> float | None:
        """Largest joint distance, or the angle, between setpoint and measured [rad]; None while no setpoints are sent."""
        return self._view.tracking_rad

    @property
    def tracking_error_m(self) -> float | None:
        """Distance between setpoint and measured end effector [m]; None while no poses are sent."""
        return self._view.tracking_m

    @property
    def model(self) -> protocol.ModelView | None:
        """How far the body model agrees with this arm: FK of its joints against its measured pose; None without a model."""
        return self._view.model

    @property
    def contact(self) -> Contact | None:
        """What pulls at it, estimated from its motors' efforts; None where the gateway was asked for no dynamics."""
        view = self._view.contact
        return None if view is None else Contact(self.name, view, self._since_ns)


class RobotState(Struct, frozen=True):
    """The robot and the gateway at one instant.

    Attributes:
        age: Since the snapshot arrived here [s].
        view: The whole snapshot as it came, documented in `gateway/messages/snapshot.py`.
    """

    age: float
    view: protocol.Snapshot
    _since_ns: int

    def __repr__(self) -> str:
        """Show what matters in one line."""
        return state_line(self)

    def _repr_html_(self) -> str:
        """Show it as a table, in a notebook."""
        return state_table(self)

    @property
    def seq(self) -> int:
        """Number of the snapshot."""
        return self.view.seq

    @property
    def state(self) -> str:
        """State of the gateway: OFFLINE, READ_ONLY, IDLE, ENABLING, ACTIVE, HOLDING, PAUSED, STOPPING or STALE."""
        return self.view.state

    @property
    def shown(self) -> str:
        """What a person should read: ESTOP or FAULT when something is latched, else the state."""
        return self.view.shown

    @property
    def latches(self) -> Mapping[str, str]:
        """What holds motion off until `recover()`: code to message."""
        return MappingProxyType(self.view.latches)

    @property
    def fsm(self) -> int | None:
        """The robot's `/fsm_state` (manual §4.11.1); None when it is older than 0.5 s."""
        return self.view.fsm

    @property
    def fsm_name(self) -> str:
        """Name of it, e.g. `READY`; `UNKNOWN` when it is not known."""
        return "UNKNOWN" if self.view.fsm is None else protocol.FSM_NAMES.get(self.view.fsm, str(self.view.fsm))

    @property
    def mode(self) -> protocol.ModeView | None:
        """The robot's modes and enabled parts (manual §4.11.2); None before the first message."""
        return self.view.mode

    @property
    def endpoints(self) -> tuple[protocol.EndpointView, ...]:
        """Stop endpoints: who must be heard, or the robot is held."""
        return self.view.endpoints

    @property
    def lease(self) -> protocol.LeaseView:
        """Who owns the robot."""
        return self.view.lease

    @property
    def link(self) -> protocol.LinkView:
        """The connection to the robot."""
        return self.view.link

    @property
    def others(self) -> protocol.OthersView:
        """Who else commands the robot, or could (manual §3.3.2); and our own zenoh id."""
        return self.view.others

    @property
    def spacing(self) -> protocol.SpacingView | None:
        """How near parts of the body are to each other; None where nobody asked for arms to be kept apart."""
        return self.view.spacing

    @property
    def slowing(self) -> dict[str, protocol.SlowingView]:
        """How near a singularity each arm is whose poses are streamed now, keyed `left`, `right`."""
        return self.view.slowing

    @property
    def left_arm(self) -> ArmState:
        """The left arm."""
        return self.arm("left")

    @property
    def right_arm(self) -> ArmState:
        """The right arm."""
        return self.arm("right")

    def arm(self, side: str) -> ArmState:
        """Return an arm by its side, `left` or `right`."""
        view = self.view.arms[side]
        return ArmState(f"{side}_arm", view.measured, self._since_ns, view, side)

    @property
    def left_gripper(self) -> MotorState:
        """The left gripper: motor angle and torque, neither opening nor force (manual §4.4)."""
        return MotorState("left_gripper", self.view.grippers.get("left"), self._since_ns)

    @property
    def right_gripper(self) -> MotorState:
        """The right gripper: motor angle and torque, neither opening nor force (manual §4.4)."""
        return MotorState("right_gripper", self.view.grippers.get("right"), self._since_ns)

    @property
    def chassis(self) -> MotorState:
        """The three motors of the chassis: no odometry (manual §4.5)."""
        return MotorState("chassis", self.view.chassis, self._since_ns)

    def grip(self, side: protocol.SideName) -> protocol.GripView:
        """What a gripper is told; `holding` is an estimate whether it holds something (`gateway/core/supervision/grip.py`)."""
        return self.view.grips[side]

    @property
    def drive(self) -> protocol.ChassisView:
        """What the chassis is told: wanted, and commanded on its ramp."""
        return self.view.drive

    @property
    def lift(self) -> protocol.LiftView | None:
        """What the lift is told; None on a model without one. Its position is published by nobody (manual §4.12)."""
        return self.view.lift

    @property
    def motions(self) -> tuple[protocol.MotionView, ...]:
        """The running motions and the latest ended ones, oldest first."""
        return self.view.motions


def state_of(sighting: Sighting, now_ns: int) -> RobotState:
    """Return a snapshot as a user reads it."""
    since_ns = max(0, now_ns - sighting.received_ns)
    return RobotState(since_ns / 1e9, sighting.view, since_ns)
