"""What can be said on LeRobot's command line as `--robot.NAME` and `--teleop.NAME`.

Annotations are read while the program runs (draccus), so they are no strings here.
"""

from dataclasses import dataclass, field
from typing import Literal

from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig

from gateway.robot.vector_layout import EYES

__all__ = ["TeleavatarConfig", "TeleavatarLeaderConfig"]


@RobotConfig.register_subclass("teleavatar")
@dataclass(kw_only=True)
class TeleavatarConfig(RobotConfig):
    """A robot that is owned through its gateway.

    Attributes:
        gateway: `unix:/path`, `tcp/HOST:PORT` or `tls/HOST:PORT`; None finds the socket of this host.
        video: Address that the robot's pictures come from; `any` takes them from whoever sends, None takes none.
        video_port: UDP port that they come to (manual §2.6.3).
        views: Name of each camera -> view of the composite (manual §5.2).
        resize: Pictures are so many pixels wide and high, with bars, as openpi makes them; 0 leaves them as they come.
        speed: Factor on the gateway's velocity limit, 0 < speed <= 1.
        patience_s: So long a loss is borne while the robot is held [s]; a longer one is an error.
        on_disconnect: `release` brakes, rests and pauses the robot (the grip is lost); `hold` leaves it held for 60 s.
    """

    gateway: str | None = None
    video: str | None = None
    video_port: int = 8890
    views: dict[str, str] = field(default_factory=lambda: dict(EYES["vendor_openpi"]))
    resize: int = 0
    speed: float = 1.0
    patience_s: float = 2.0
    on_disconnect: Literal["release", "hold"] = "release"


@TeleoperatorConfig.register_subclass("teleavatar_leader")
@dataclass(kw_only=True)
class TeleavatarLeaderConfig(TeleoperatorConfig):
    """A robot that is only looked at, through its gateway, and leads.

    Attributes:
        gateway: Of the leading robot; as for `TeleavatarConfig`.
        patience_s: So long a loss is borne, with the last pose [s]; a longer one is an error.
    """

    gateway: str | None = None
    patience_s: float = 2.0
