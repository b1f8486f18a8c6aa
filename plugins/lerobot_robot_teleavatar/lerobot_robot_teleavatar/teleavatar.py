"""LeRobot's robot `teleavatar`: observes joints, grippers and cameras, and moves by streams through the gateway.

Rules
    * The gateway owns, limits and holds: what LeRobot sends is checked like anybody's targets.
    * The loop is LeRobot's: nothing here paces, and nothing waits but `connect` and `disconnect`.
    * A loss that is shorter than `patience_s` raises nothing: the gateway holds what it cannot move; what is not heard stays as
      it was observed last, the rest is moved and observed on.
"""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np
from lerobot.robots import Robot

from gateway.client import connect
from gateway.errors import GatewayError, Rejected
from gateway.policy.observing import OLD_S, resized
from gateway.video.decoding.views import COMPOSITE_SHAPE, VIEWS, pixel_box
from lerobot_robot_teleavatar.arm import Arm
from lerobot_robot_teleavatar.config_teleavatar import TeleavatarConfig
from lerobot_robot_teleavatar.device import CONNECT_S, Device, Patience, Sight
from lerobot_robot_teleavatar.names import ACTION, OBSERVATION, measured, picked

if TYPE_CHECKING:
    from gateway.video import Video

__all__ = ["Teleavatar"]


class Teleavatar(Device, Robot):
    """A TeleAvatar 2 behind its gateway. Connecting owns and enables it, where its arms are.

    Attributes:
        cameras: Name of each camera -> view of the composite (manual §5.2); empty where no video is taken.
    """

    config_class = TeleavatarConfig
    name = "teleavatar"

    def __init__(self, config: TeleavatarConfig) -> None:
        super().__init__(config)
        if unknown := set(config.views.values()) - set(VIEWS):
            raise ValueError(f"no view {', '.join(sorted(unknown))}: there are {', '.join(VIEWS)} (manual §5.2)")
        self.config = config
        self.cameras = dict(config.views) if config.video else {}
        self._video: Video | None = None

    @property
    def observation_features(self) -> dict[str, Any]:
        """16 numbers (`names`), and the shape of each camera's picture (height, width, 3)."""
        features: dict[str, Any] = dict.fromkeys(OBSERVATION, float)
        for name, view in self.cameras.items():
            x0, y0, x1, y1 = pixel_box(view, COMPOSITE_SHAPE[1], COMPOSITE_SHAPE[0])
            features[name] = (self.config.resize or y1 - y0, self.config.resize or x1 - x0, 3)
        return features

    @property
    def action_features(self) -> dict[str, type]:
        """16 numbers (`names`)."""
        return dict.fromkeys(ACTION, float)

    def _open(self, opened: ExitStack) -> None:
        config = self.config
        robot = opened.enter_context(connect(config.gateway, name=f"lerobot {self.id or ''}".strip()))
        self._sight = Sight(robot, measured, config.patience_s)
        if config.video:
            from gateway.video import Video

            source = None if config.video == "any" else config.video
            self._video = opened.enter_context(Video(source, port=config.video_port, strict=True))
            if self._video.wait_frame(timeout=CONNECT_S) is None:
                raise self._video.silence(CONNECT_S)
            self._seeing = Patience("no new undamaged picture", config.patience_s)
        own = robot.control(on_exit=config.on_disconnect).acquire()
        opened.callback(own.__exit__, None, None, None)
        own.enable()
        both = ((own.left_arm, own.left_gripper), (own.right_arm, own.right_gripper))
        self._arms = [Arm(arm, gripper, config.speed) for arm, gripper in both]
        self._sending = Patience("not all targets are followed, what cannot be moved is held", config.patience_s)

    def get_observation(self) -> dict[str, Any]:
        """Return the newest numbers and undamaged pictures, never waiting; in a short loss the last.

        Raises:
            DeviceNotConnectedError: No new numbers came for `patience_s`, or no picture that is younger than 0.5 s.
        """
        self._require_connected()
        seen: dict[str, Any] = self._sight.look()
        if self._video is not None:
            frame, side = self._video.latest, self.config.resize
            assert frame is not None, "connect waited for one"
            if frame.age > OLD_S:
                self._seeing.bear(self._video.silence(OLD_S))
            else:
                self._seeing.well()
            for name, view in self.cameras.items():
                seen[name] = resized(frame[view], side) if side else np.array(frame[view])
        return seen

    def send_action(self, action: dict[str, Any]) -> dict[str, float]:
        """Send a target for both arms and grippers; does not wait until they are there.

        Returns:
            What is followed: clipped to the gateway's limits; of what cannot be moved in a short loss, what was followed last.

        Raises:
            ValueError: Something is missing or not a number.
            DeviceNotConnectedError: An arm or a gripper could not be moved for `patience_s`, and is held.
        """
        self._require_connected()
        target = picked(action)
        try:
            for n, arm in enumerate(self._arms):
                arm.send(target[8 * n : 8 * n + 8])
            self._sending.well()
        except Rejected as error:
            raise ValueError(str(error)) from error
        except GatewayError as error:
            self._sending.bear(error)
        return dict(zip(ACTION, (value for arm in self._arms for value in arm.sent), strict=True))
