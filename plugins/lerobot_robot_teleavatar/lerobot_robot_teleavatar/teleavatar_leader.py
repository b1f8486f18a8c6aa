"""LeRobot's teleoperator `teleavatar_leader`: another robot's measured joints and grippers lead. It is only looked at."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

from lerobot.teleoperators import Teleoperator

from gateway.client import connect
from lerobot_robot_teleavatar.config_teleavatar import TeleavatarLeaderConfig
from lerobot_robot_teleavatar.device import Device, Sight
from lerobot_robot_teleavatar.names import ACTION, led_by

__all__ = ["TeleavatarLeader"]


class TeleavatarLeader(Device, Teleoperator):
    """A TeleAvatar 2 that somebody else moves: in VR mode, by hand, or by a program."""

    config_class = TeleavatarLeaderConfig
    name = "teleavatar_leader"

    def __init__(self, config: TeleavatarLeaderConfig) -> None:
        super().__init__(config)
        self.config = config

    @property
    def action_features(self) -> dict[str, type]:
        """16 numbers (`names`)."""
        return dict.fromkeys(ACTION, float)

    @property
    def feedback_features(self) -> dict[str, type]:
        """None: the leader feels nothing of what follows."""
        return {}

    def _open(self, opened: ExitStack) -> None:
        robot = opened.enter_context(connect(self.config.gateway, name=f"lerobot {self.id or 'leader'}"))
        self._sight = Sight(robot, led_by, self.config.patience_s)

    def get_action(self) -> dict[str, float]:
        """Return where the leader is, never waiting. `DeviceNotConnectedError` if nothing new came for `patience_s`."""
        self._require_connected()
        return self._sight.look()

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing. Raises `DeviceNotConnectedError` when it is not connected."""
        del feedback
        self._require_connected()
