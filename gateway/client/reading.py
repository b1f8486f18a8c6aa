"""What a user reads: the robot's state and health at one instant, as frozen views with numpy vectors.

Rules
    * A view never changes. Vectors are read-only copies; ages [s] are counted to the moment the view was made, from the
      daemon's own count and the time since the snapshot arrived here (the transport adds less than a millisecond on one
      host). They are lower bounds: the robot stamps what it publishes, not what its motors measured (manual §4.1.1).
    * What was never measured raises `Stale` when it is read: no made-up numbers. `is_known` tells beforehand.
    * Units: rad, rad/s, N·m, m; quaternions xyzw; poses in the arm's own shoulder frame (manual §4.0.1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from gateway.api import protocol
from gateway.client.requests import read_only
from gateway.client.session import Session, Sighting
from gateway.errors import Code, Refusal, to_exception

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["ArmState", "Health", "MotorState", "Pose", "RobotState", "health_of", "state_of"]


OLD_NS = 1_000_000_000
"""An older snapshot says nothing about the robot's health [ns]."""


@dataclass(frozen=True, slots=True)
class Pose:
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


@dataclass(frozen=True, slots=True)
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

    def _known(self) -> protocol.MotorView:
        if self._measured is None:
            raise to_exception(
                Refusal(code=Code.PART_STALE, message=f"no state of {self.name} has arrived yet", field=self.name)
            )
        return self._measured


@dataclass(frozen=True, slots=True)
class ArmState(MotorState):
    """One arm: seven joints in the order of manual §4.0.3, its pose, and where it is being sent."""

    _view: protocol.ArmView
    _side: str

    @property
    def pose(self) -> Pose:
        """Measured end-effector pose. Raises `Stale` before the first sample."""
        view = self._view
        if view.pose_age_ns is None:
            raise to_exception(
                Refusal(code=Code.PART_STALE, message=f"no pose of {self.name} has arrived yet", field=self.name)
            )
        return Pose(
            p=read_only(view.p_m),
            quat_xyzw=read_only(view.quat_xyzw),
            age=(view.pose_age_ns + self._since_ns) / 1e9,
            frame=f"{self._side}_shoulder_base",
        )

    @property
    def is_streaming(self) -> bool:
        """Whether setpoints are being sent to it."""
        return self._view.streaming

    @property
    def q_ref(self) -> NDArray[np.float64]:
        """The last setpoint [rad], shape (7,); empty while no setpoints are sent."""
        return read_only(self._view.q_ref_rad)

    @property
    def dq_ref(self) -> NDArray[np.float64]:
        """Its velocity [rad/s], shape (7,); empty while no setpoints are sent."""
        return read_only(self._view.dq_ref_radps)

    @property
    def tracking_error(self) -> float | None:
        """Largest joint distance between setpoint and measured [rad]; None while no setpoints are sent."""
        return self._view.tracking_rad


@dataclass(frozen=True, slots=True)
class RobotState:
    """The robot and the gateway at one instant.

    Attributes:
        age: Since the snapshot arrived here [s].
        view: The whole snapshot as it came, documented in `gateway/core/snapshot.py`.
    """

    age: float
    view: protocol.Snapshot
    _since_ns: int

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
    def lease(self) -> protocol.LeaseView:
        """Who owns the robot."""
        return self.view.lease

    @property
    def link(self) -> protocol.LinkView:
        """The connection to the robot."""
        return self.view.link

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

    @property
    def motions(self) -> tuple[protocol.MotionView, ...]:
        """The running motions and the latest ended ones, oldest first."""
        return self.view.motions


def state_of(sighting: Sighting, now_ns: int) -> RobotState:
    """Return a snapshot as a user reads it.

    Args:
        sighting: The snapshot and its arrival.
        now_ns: The moment to count ages to [ns].
    """
    since_ns = max(0, now_ns - sighting.received_ns)
    return RobotState(since_ns / 1e9, sighting.view, since_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """Is everything well, and if not, what is it? Plain numbers, ready for a log or a metric.

    Attributes:
        daemon: Whether the daemon is connected.
        ok: It is, the link is fresh, nothing is latched, no stop went undelivered, and this was seen within a second.
        state: What a person should read, e.g. `ACTIVE`, `ESTOP`.
        link_up: Whether there is a transport to the robot.
        link_age: Age of the newest state of the robot [s]; None before the first.
        fsm: Name of the robot's FSM state.
        latches: What holds motion off until `recover()`.
        lease_holder: Name of the owner; None when there is none.
        lease_lost_for: How long the owner has been silent beyond the limit [s]; None while it is alive.
        free_in: Until the lease is free [s]; None when no clock runs.
        down_in: Until everything goes down [s]; None when no clock runs.
        ages: Age of each state topic [s]; None for those that were never heard.
        rates: Measured rate of each state topic [Hz].
        streams: Worst gap of each command stream that runs, in the last 10 s [s].
        loop_late: Latest lateness of the control loop [s].
        loop_worst_late: Worst one in the last 10 s [s].
        loop_skipped: Periods that the control loop skipped since its start.
        snapshot_age: Since the newest snapshot arrived here [s]; None before the first.
        snapshots_dropped: Snapshots that did not reach this client.
        notices_dropped: Notices dropped because `events()` was not read.
        stop_undelivered: The last stop of this client could not be sent to the robot for lack of a transport, or the
            daemon has said so of somebody's. Use the physical emergency stop.
    """

    daemon: bool
    ok: bool = False
    state: str = "UNKNOWN"
    link_up: bool = False
    link_age: float | None = None
    fsm: str = "UNKNOWN"
    latches: tuple[str, ...] = ()
    lease_holder: str | None = None
    lease_lost_for: float | None = None
    free_in: float | None = None
    down_in: float | None = None
    ages: Mapping[str, float | None] = field(default_factory=dict)
    rates: Mapping[str, float] = field(default_factory=dict)
    streams: Mapping[str, float] = field(default_factory=dict)
    loop_late: float | None = None
    loop_worst_late: float | None = None
    loop_skipped: int = 0
    snapshot_age: float | None = None
    snapshots_dropped: int = 0
    notices_dropped: int = 0
    stop_undelivered: bool = False


def health_of(session: Session) -> Health:
    """Return the health as this client sees it; never raises for lack of a daemon."""
    connected = session.is_connected
    seen = Health(
        daemon=connected,
        snapshots_dropped=session.snapshots_dropped,
        notices_dropped=session.notices_dropped,
        stop_undelivered=session.stop_undelivered,
    )
    sighting = session.sighting()
    if sighting is None:
        return seen
    state = state_of(sighting, session.transport.now_ns())
    view, since_ns = state.view, round(state.age * 1e9)
    well = view.link.fresh and not view.latches and not session.stop_undelivered
    return replace(
        seen,
        ok=connected and well and since_ns < OLD_NS,
        state=view.shown,
        link_up=view.link.up,
        link_age=_seconds(view.link.age_ns, since_ns),
        fsm=state.fsm_name,
        latches=tuple(view.latches),
        lease_holder=view.lease.name if view.lease.owned else None,
        lease_lost_for=_seconds(view.lease.lost_ns, since_ns),
        free_in=_seconds(view.lease.free_in_ns, -since_ns),
        down_in=_seconds(view.lease.down_in_ns, -since_ns),
        ages={name: _seconds(topic.age_ns, since_ns) for name, topic in view.topics.items()},
        rates={name: topic.rate_hz for name, topic in view.topics.items()},
        streams={name: stream.worst_gap_ns / 1e9 for name, stream in view.streams.items() if stream.running},
        loop_late=view.loop.late_ns / 1e9,
        loop_worst_late=view.loop.worst_late_ns / 1e9,
        loop_skipped=view.loop.skipped,
        snapshot_age=state.age,
    )


def _seconds(value_ns: int | None, since_ns: int) -> float | None:
    return None if value_ns is None else max(0, value_ns + since_ns) / 1e9
