"""What pulls at the arms: an observer per arm, fed as joints arrive, and the reasons why nothing may be said.

Made only where the configuration asks for it (`[model] dynamics`); the dynamics, which stand on pinocchio, are handed in. An
observer takes each believed sample of joints once, by the robot's own stamps; a wrench is worked out when somebody looks. What
a hand is said to hold is part of its arm, until it is said anew or the robot is lost. An
estimate, never a safety function: efforts come from motors, through gears, and a model is one of a robot, not of this one.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Mapping

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from gateway.errors import Code, Refusal
from gateway.kinematics.dynamics.observer import Dynamics, MomentumObserver
from gateway.kinematics.dynamics.parameters import Load
from gateway.kinematics.dynamics.weighing import CannotTell, Swings, Weighed, weigh
from gateway.kinematics.dynamics.wrench import Wrench, wrench_of
from gateway.messages.body_views import ContactView
from gateway.robot.limits import MOST_NM
from gateway.values import ArmState, Side, Vector

__all__ = ["Contact", "Contacts", "Unfelt"]

Array = NDArray[np.float64]

MS = 1_000_000
STALE_NS = 100 * MS
"""Joints older than this say nothing about now [ns]."""

MOST_RADPS = 100.0
"""Faster no motor of an arm turns [rad/s]: what says so measures nothing."""

NO_EFFORTS, NOT_CONVERGED, BROKEN = "NO_EFFORTS", "NOT_CONVERGED", "BROKEN"
"""Reasons beside those of the model and of its age: they refuse nothing, and are no codes of refusals."""

NOT_KNOWN = ContactView(
    state="unknown",
    code="",
    reason="",
    basis="",
    torque_nm=(),
    torque_sd_nm=(),
    frame="",
    point="",
    wrench=(),
    wrench_sd=(),
    unknown=(),
    sigmas=0.0,
    age_ns=0,
    load_kg=0.0,
    load_com_m=(),
)


class Contact(Struct, frozen=True, kw_only=True):
    """What pulls at an arm.

    Attributes:
        torque_nm: External torques of the joints, shape (7,) [N·m].
        torque_sd_nm: Their standard deviations, shape (7,) [N·m].
        wrench: Force and moment at the hand, with what cannot be known of them.
        sigmas: By how many standard deviations the clearest joint is pulled.
    """

    torque_nm: Array
    torque_sd_nm: Array
    wrench: Wrench
    sigmas: float


class Unfelt(Struct, frozen=True, kw_only=True):
    """Why nothing is known of what pulls at an arm: one word for programs, and the same for people."""

    code: str
    reason: str


class Contacts:
    """Both arms' observers.

    Args:
        dynamics: Of each arm.
        refusal: Says why an arm's model cannot be relied on (`BodyModel.refusal`); None while it can.
    """

    def __init__(
        self,
        dynamics: Mapping[Side, Dynamics],
        refusal: Callable[[Side, int], Refusal | None],
    ) -> None:
        self._dynamics = dynamics
        self._broken = ""
        self._refusal = refusal
        self._observers = {side: MomentumObserver(one) for side, one in dynamics.items()}
        self._heard: dict[Side, tuple[ArmState, int]] = {}

    def hear(self, side: Side, state: ArmState, received_ns: int, base: Vector) -> None:
        """Take joints of an arm.

        Args:
            side: Which arm.
            state: As measured, believed.
            received_ns: When they came, monotonic [ns].
            base: What the chassis is commanded: x, y [m/s], yaw [rad/s]; it publishes no odometry (§4.5).
        """
        if self._broken:
            return
        self._heard[side] = state, received_ns
        try:
            if _has_efforts(state):
                self._observers[side].update(state.stamp_ns, state.q_rad, state.dq_radps, state.tau_nm, base)
            else:
                self._observers[side].restart()
        except Exception as error:  # noqa: BLE001  an estimate, on libraries that raise what they like: the loop goes on
            self._break(error)

    def forget(self) -> None:
        """Begin anew: the link was gone, or it is another robot; nobody knows what its hands hold."""
        self._heard.clear()
        for side, observer in self._observers.items():
            observer.restart()
            self.carry(side, 0.0)

    def carry(self, side: Side, mass_kg: float, com_m: Vector = ()) -> None:
        """Count on what a hand holds from now on; 0 kg for nothing. The estimate begins anew where that is something else."""
        load = Load(mass_kg=mass_kg, com_m=com_m) if mass_kg else None
        if load != self._dynamics[side].load:
            self._dynamics[side].carry(load)
            self._observers[side].restart()

    def weigh(self, side: Side, now_ns: int, *, beside_empty: bool, **measured: ArrayLike) -> Weighed | Refusal:
        """Return what a hand holds, or why that cannot be told.

        Args:
            side: Which arm.
            now_ns: Monotonic time [ns].
            beside_empty: Whether what the empty hand weighs was taken off.
            **measured: The rows of `Swings`, all finite.
        """
        refusal = self._refusal(side, now_ns)
        if refusal is not None:
            return refusal
        try:
            rows = {name: np.asarray(values, dtype=np.float64) for name, values in measured.items()}
            found = weigh(self._dynamics[side], Swings(**rows, beside_empty=beside_empty))
        except Exception as error:  # noqa: BLE001  as in `hear`
            found = CannotTell(f"these numbers have no solution ({error})")
        if isinstance(found, CannotTell):
            return Refusal(code=Code.CANNOT_WEIGH, message=found.message, field=f"{side}_arm")
        return found

    def contact(self, side: Side, now_ns: int) -> Contact | Unfelt:
        """Return what pulls at an arm now, or why that is not known.

        Args:
            side: Which arm.
            now_ns: Monotonic time [ns].
        """
        why = self._why_not(side, now_ns)
        if why is not None:
            return why
        observer = self._observers[side]
        variance = observer.variance_nm2()
        torque, sd = observer.torque_nm, np.sqrt(variance)
        wrench = wrench_of(self._dynamics[side].jacobian(observer.q_rad), torque, variance)
        return Contact(torque_nm=torque, torque_sd_nm=sd, wrench=wrench, sigmas=float(np.max(np.abs(torque) / sd)))

    def view(self, side: Side, now_ns: int) -> ContactView:
        """Return the same for the outside."""
        dynamics = self._dynamics[side]
        load = dynamics.load or Load(mass_kg=0.0, com_m=())
        try:
            found = self.contact(side, now_ns)
        except Exception as error:  # noqa: BLE001  as in `hear`
            self._break(error)
            found = self._given_up()
        if isinstance(found, Unfelt):
            basis = dynamics.drives.source
            return replace(
                NOT_KNOWN,
                code=found.code,
                reason=found.reason,
                basis=basis,
                load_kg=load.mass_kg,
                load_com_m=load.com_m,
            )
        values, sd, unknown = found.wrench
        return ContactView(
            state="known",
            code="",
            reason="",
            basis=dynamics.drives.source,
            torque_nm=tuple(found.torque_nm.tolist()),
            torque_sd_nm=tuple(found.torque_sd_nm.tolist()),
            frame=dynamics.frame,
            point=dynamics.point,
            wrench=tuple(None if math.isnan(value) else value for value in values.tolist()),
            wrench_sd=tuple(None if math.isinf(value) else value for value in sd.tolist()),
            unknown=tuple(tuple(direction) for direction in unknown.tolist()),
            sigmas=found.sigmas,
            age_ns=now_ns - self._heard[side][1],
            load_kg=load.mass_kg,
            load_com_m=load.com_m,
        )

    def _break(self, error: Exception) -> None:
        place = traceback.extract_tb(error.__traceback__)[-1]
        self._broken = f"{type(error).__name__} in {place.name}, line {place.lineno}: {error}"[:200]

    def _given_up(self) -> Unfelt:
        return Unfelt(
            code=BROKEN, reason=f"the estimate failed and is off until the gateway starts anew: {self._broken}"
        )

    def _why_not(self, side: Side, now_ns: int) -> Unfelt | None:
        if self._broken:
            return self._given_up()
        heard = self._heard.get(side)
        if heard is None:
            return Unfelt(code=Code.PART_STALE.value, reason="no joints have been heard yet")
        state, received_ns = heard
        if now_ns - received_ns > STALE_NS:
            age_ms = (now_ns - received_ns) / MS
            return Unfelt(code=Code.PART_STALE.value, reason=f"the newest joints are {age_ms:.0f} ms old")
        if not _has_efforts(state):
            what = "all zero, or more than any motor gives" if state.tau_nm else "not there"
            return Unfelt(code=NO_EFFORTS, reason=f"the robot's efforts, or its velocities, are {what} (§4.8)")
        refusal = self._refusal(side, now_ns)
        if refusal is not None:
            return Unfelt(code=refusal.code.value, reason=refusal.message)
        observer = self._observers[side]
        if not observer.is_converged:
            return Unfelt(code=NOT_CONVERGED, reason=f"observed for {observer.settled_ns / MS:.0f} ms only")
        return None


def _has_efforts(state: ArmState) -> bool:
    """Return whether efforts and velocities are there and can be meant; motors that all give exactly nothing cannot."""
    efforts, speeds = map(abs, state.tau_nm), map(abs, state.dq_radps)
    return bool(state.dq_radps) and 0.0 < max(efforts, default=0.0) <= MOST_NM and max(speeds) <= MOST_RADPS
