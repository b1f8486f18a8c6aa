"""Of LeRobot 0.6 what the plugin stands on, without its 5 GB: base classes, registries of configurations, errors.

For speed in CI only. **The real thing is `bin/interop lerobot`**: LeRobot's own commands, with the plugin, in an environment of
their own. What is abstract here is abstract there, and what a base class does by itself it does here, but for files.
"""

from __future__ import annotations

import abc
import sys
from dataclasses import dataclass
from types import ModuleType

__all__ = ["install"]


class ChoiceRegistry:
    """As draccus has it: subclasses by name."""

    @classmethod
    def register_subclass(cls, name):
        def register(subclass):
            cls.__dict__.get("choices", None) or setattr(cls, "choices", {})
            cls.choices[name] = subclass
            return subclass

        return register

    @classmethod
    def get_choice_name(cls, subclass):
        return next(name for name, known in cls.choices.items() if known is subclass)

    @property
    def type(self):
        return self.get_choice_name(self.__class__)


@dataclass(kw_only=True)
class RobotConfig(ChoiceRegistry, abc.ABC):
    id: str | None = None
    calibration_dir: str | None = None

    def __post_init__(self):
        if getattr(self, "cameras", None):
            raise AssertionError("LeRobot would ask for width, height and fps of these")


@dataclass(kw_only=True)
class TeleoperatorConfig(ChoiceRegistry, abc.ABC):
    id: str | None = None
    calibration_dir: str | None = None


class _Device(abc.ABC):
    def __init__(self, config):
        self.id = config.id
        self.calibration = {}

    def __str__(self):
        return f"{self.id} {self.__class__.__name__}"

    def __enter__(self):
        self.connect()
        return self

    def __exit__(self, *_):
        self.disconnect()

    @property
    @abc.abstractmethod
    def action_features(self): ...

    @property
    @abc.abstractmethod
    def is_connected(self): ...

    @property
    @abc.abstractmethod
    def is_calibrated(self): ...

    @abc.abstractmethod
    def connect(self, calibrate=True): ...

    @abc.abstractmethod
    def calibrate(self): ...

    @abc.abstractmethod
    def configure(self): ...

    @abc.abstractmethod
    def disconnect(self): ...


class Robot(_Device):
    def __init__(self, config):
        self.robot_type = self.name
        super().__init__(config)

    @property
    @abc.abstractmethod
    def observation_features(self): ...

    @abc.abstractmethod
    def get_observation(self): ...

    @abc.abstractmethod
    def send_action(self, action): ...


class Teleoperator(_Device):
    @property
    @abc.abstractmethod
    def feedback_features(self): ...

    @abc.abstractmethod
    def get_action(self): ...

    @abc.abstractmethod
    def send_feedback(self, feedback): ...


class DeviceNotConnectedError(ConnectionError):
    pass


class DeviceAlreadyConnectedError(ConnectionError):
    pass


def install():
    """Let `import lerobot` find this."""
    held = {
        "lerobot": (),
        "lerobot.robots": (Robot, RobotConfig),
        "lerobot.teleoperators": (Teleoperator, TeleoperatorConfig),
        "lerobot.utils": (),
        "lerobot.utils.errors": (DeviceAlreadyConnectedError, DeviceNotConnectedError),
    }
    for name, classes in held.items():
        module = sys.modules[name] = ModuleType(name)
        for one in classes:
            setattr(module, one.__name__, one)
