"""The TeleAvatar 2 for LeRobot, which imports this by its name: that registers `teleavatar` and `teleavatar_leader`."""

from __future__ import annotations

from lerobot_robot_teleavatar.config_teleavatar import TeleavatarConfig, TeleavatarLeaderConfig
from lerobot_robot_teleavatar.teleavatar import Teleavatar
from lerobot_robot_teleavatar.teleavatar_leader import TeleavatarLeader

__all__ = ["Teleavatar", "TeleavatarConfig", "TeleavatarLeader", "TeleavatarLeaderConfig"]
