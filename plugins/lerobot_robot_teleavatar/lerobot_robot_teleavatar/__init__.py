"""The TeleAvatar 2 for LeRobot: robot `teleavatar`, teleoperator `teleavatar_leader`, both by a gateway of this robot.

LeRobot imports this by its name (`register_third_party_plugins`); importing it is what registers both.
"""

from __future__ import annotations

from lerobot_robot_teleavatar.config_teleavatar import TeleavatarConfig, TeleavatarLeaderConfig
from lerobot_robot_teleavatar.teleavatar import Teleavatar
from lerobot_robot_teleavatar.teleavatar_leader import TeleavatarLeader

__all__ = ["Teleavatar", "TeleavatarConfig", "TeleavatarLeader", "TeleavatarLeaderConfig"]
