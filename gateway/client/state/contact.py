"""What pulls at an arm, as a user reads it, or why nothing is known; and the touch that a motion is to end at."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec import Struct

from gateway.api import protocol
from gateway.client.asking.requests import number, read_only, row
from gateway.client.asking.results import Payload
from gateway.client.state.showing import vector
from gateway.errors import Code, failure

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

__all__ = ["Contact", "contact"]

CODES = {"MODEL_UNKNOWN": Code.MODEL_UNKNOWN, "MODEL_DIFFERS": Code.MODEL_DIFFERS}
AXES = 3


def contact(force_n: float, direction: ArrayLike | None = None, back_off_m: float = 0.0) -> protocol.Until:
    """Return a touch, for `until=` of motions, chunks and streams; it is judged by the daemon, by what the arm feels.

    Args:
        force_n: From what force on the hand on [N], 1 to 200; above the standard deviation of what is felt.
        direction: Along which the surroundings push, shape (3,) in the arm's shoulder frame, of any length: (0, 0, 1) is what a
            table under the hand does. None for any direction.
        back_off_m: How far the hand then goes back along the way it came [m], 0 to 0.1; 0 to stay where it braked.

    Raises:
        Rejected: BAD_REQUEST, WRONG_SHAPE or NOT_FINITE, no numbers; how large they are is judged with the motion.
    """
    axis = () if direction is None else row("the direction", direction, AXES, "direction", "x, y, z")
    return protocol.Until(
        force_n=number("force_n", force_n), direction=axis, back_off_m=number("back_off_m", back_off_m)
    )


class Contact(Struct, frozen=True):
    """What pulls at an arm, estimated from the efforts of its motors; never a safety function.

    Attributes:
        name: Of the arm, e.g. `left_arm`.
        view: As it came, documented in `gateway/messages/body_views.py`.
    """

    name: str
    view: protocol.ContactView
    _since_ns: int

    @property
    def is_known(self) -> bool:
        """Whether there is an estimate; everything below raises `Stale` or `NotReady` while there is none."""
        return self.view.state == "known"

    @property
    def reason(self) -> str:
        """Why nothing is known, code and words; empty while it is."""
        return "" if self.is_known else f"{self.view.code}: {self.view.reason}"

    @property
    def torque(self) -> NDArray[np.float64]:
        """External torques of the joints, shape (7,) [N·m]."""
        return read_only(self._known().torque_nm)

    @property
    def torque_sd(self) -> NDArray[np.float64]:
        """Their standard deviations, shape (7,) [N·m]."""
        return read_only(self._known().torque_sd_nm)

    @property
    def wrench(self) -> NDArray[np.float64]:
        """Force [N] and moment [N·m] on the hand in the axes of `frame` at `point`, shape (6,); NaN for what is not felt."""
        return read_only(tuple(float("nan") if value is None else value for value in self._known().wrench))

    @property
    def wrench_sd(self) -> NDArray[np.float64]:
        """Their standard deviations, shape (6,); infinite for what is not felt."""
        return read_only(tuple(float("inf") if value is None else value for value in self._known().wrench_sd))

    @property
    def unknown(self) -> tuple[NDArray[np.float64], ...]:
        """Directions of force [N] and moment [N·m] that this posture does not feel, unit vectors of shape (6,)."""
        return tuple(read_only(direction) for direction in self._known().unknown)

    @property
    def frame(self) -> str:
        """In whose axes the wrench is: `left_shoulder_base` or `right_shoulder_base` (manual §4.0.1)."""
        return self._known().frame

    @property
    def point(self) -> str:
        """At whose origin it acts: `left_ee` or `right_ee`."""
        return self._known().point

    @property
    def sigmas(self) -> float:
        """By how many standard deviations the clearest joint is pulled: below 3 it may be nothing at all."""
        return self._known().sigmas

    @property
    def basis(self) -> str:
        """Where masses, friction and scale come from: `nominal`, or the file that they were identified to."""
        return self.view.basis

    @property
    def payload(self) -> Payload | None:
        """What the hand was said to hold, which is no part of all this; None for nothing. Known whatever else is."""
        view = self.view
        if not view.load_kg:
            return None
        return Payload(mass=view.load_kg, com=view.load_com_m, frame=f"{self.name.partition('_')[0]}_ee")

    @property
    def age(self) -> float:
        """Age of the joints that it is of [s]."""
        return (self._known().age_ns + self._since_ns) / 1e9

    def __repr__(self) -> str:
        """Show force and age, or the reason."""
        if not self.is_known:
            return f"<contact of {self.name}: unknown, {self.reason}>"
        return f"<contact of {self.name}: {vector(tuple(self.wrench[:3]))} N, {self.sigmas:.1f} sigmas, {self.age:.3f} s old>"

    def _known(self) -> protocol.ContactView:
        if not self.is_known:
            code = CODES.get(self.view.code, Code.PART_STALE)
            raise failure(code, f"what pulls at {self.name} is unknown: {self.reason}", field=self.name)
        return self.view
