"""What robot and leader have in common: being connected, and bearing short losses.

A loop of LeRobot ends with the first error, so a short loss raises none: meanwhile the gateway holds the robot.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Final

from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from gateway.client import Robot, RobotState
from gateway.errors import Code, GatewayError, Stale, failure
from gateway.video.errors import VideoError

__all__ = ["CONNECT_S", "Device", "Patience", "Sight"]

CONNECT_S: Final = 10.0  # longest wait for a first state, and for a first picture [s]
STALE_S: Final = 0.1  # an arm's state that is older is a loss [s]

log = logging.getLogger(__name__)


class Device:
    """Connected or not; stands before LeRobot's own class among the bases."""

    _opened: ExitStack | None = None
    is_calibrated = True

    @property
    def is_connected(self) -> bool:
        """Whether it was connected and not disconnected since; it stays so in a loss."""
        return self._opened is not None

    def connect(self, calibrate: bool = True) -> None:
        """Connect; nothing is to be calibrated. Raises LeRobot's errors, with the gateway's words; then nothing stays open."""
        del calibrate
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected")
        try:
            with ExitStack() as opened:
                self._open(opened)
                self._opened = opened.pop_all()
        except (GatewayError, VideoError) as error:
            raise DeviceNotConnectedError(f"{self}: {error}") from error

    def _open(self, opened: ExitStack) -> None: ...  # what must be undone goes on the stack

    def calibrate(self) -> None:
        """Do nothing: the robot calibrates itself."""

    def configure(self) -> None:
        """Do nothing: modes are set in the robot's system configuration (manual §2.3), limits in the gateway's."""

    def disconnect(self) -> None:
        """Undo what `connect` did. Raises `DeviceNotConnectedError` when it is not connected."""
        opened = self._require_connected()
        self._opened = None
        try:
            opened.close()
        except GatewayError as error:
            log.warning("%s is left, and held if it was owned: %s", self, error)

    def _require_connected(self) -> ExitStack:
        if self._opened is None:
            raise DeviceNotConnectedError(f"{self} is not connected")
        return self._opened


class Patience:
    """Tells a short loss of something (`what`, in words) from one of more than `most_s` [s]."""

    def __init__(self, what: str, most_s: float) -> None:
        self._what, self._most_s, self._since_s = what, most_s, float("inf")

    def well(self) -> None:
        """Nothing is lost, or nothing any more."""
        if self._since_s != float("inf"):
            log.warning("%s: over after %.2f s", self._what, time.monotonic() - self._since_s)
            self._since_s = float("inf")

    def bear(self, error: GatewayError | VideoError) -> None:
        """Bear a loss. Raises `DeviceNotConnectedError`, with the error's words, when it lasts for too long."""
        now_s = time.monotonic()
        if self._since_s == float("inf"):
            self._since_s = now_s
            log.warning("%s: %s", self._what, error)
        if now_s - self._since_s >= self._most_s:
            raise DeviceNotConnectedError(f"{self._what} for {now_s - self._since_s:.1f} s: {error}") from error


class Sight:
    """What is read of a robot, or was read last; waits for the first. Raises `GatewayError` when that does not come."""

    def __init__(self, robot: Robot, read: Callable[[RobotState], dict[str, float]], patience_s: float) -> None:
        self._robot, self._read, self._patience = robot, read, Patience("no new state of the robot", patience_s)
        end_s = time.monotonic() + CONNECT_S
        for state in robot.states(timeout=CONNECT_S):
            try:
                self._seen = read(state)
                self._require_young(state)
                break
            except Stale:
                for side, is_on in (state.mode.arm_enabled if state.mode else {}).items():
                    if not is_on:
                        message = f"the {side} arm is switched off, and nothing is told of it"
                        raise failure(Code.ARM_DISABLED, message, field=f"{side}_arm") from None
                if time.monotonic() > end_s:
                    raise

    def look(self) -> dict[str, float]:
        """Return the newest, never waiting; of what is lost the last. `DeviceNotConnectedError` in a long loss."""
        try:
            state = self._robot.state
            self._seen = self._read(state)  # first: only a part that is silent stays as it was
            self._require_young(state)
            self._patience.well()
        except GatewayError as error:
            self._patience.bear(error)
        return dict(self._seen)

    def _require_young(self, state: RobotState) -> None:
        for part in (state.left_arm, state.right_arm, state.left_gripper, state.right_gripper):
            if part.age > STALE_S:
                message = f"the newest state of the {part.name} is {part.age:.2f} s old"
                raise failure(Code.PART_STALE, message, field=part.name)
