"""A person's turn in virtual time: a robot, the real engine, a client, and wishes by script."""

from __future__ import annotations

import pytest

from gateway.cli.teleop.keyboard import Wish
from gateway.cli.teleop.session import Session
from gateway.client import connect
from tests.client.robot_world import RobotWorld

__all__ = ["Turn"]


class Clock:
    """Virtual time."""

    def __init__(self, world):
        self.monotonic_ns, self.sleep = world.now_ns, world.run


class Turn:
    """A session whose device says what a test wants, in a world whose time passes when the session waits."""

    def __init__(self, **sim):
        self.world = RobotWorld(**sim)
        self.said, self.shown = [], []
        self.script = []
        """(for so long [s], demand, actions): what is wished in turn, a demand None while it is missing; then `quit`."""
        self.robot = connect(transport=self.world.transport(), name="ta2 teleop")
        self.own = self.robot.control().acquire()
        self.own.enable()
        self._until_ns, self._now = 0, Wish({})
        self.each = lambda: None
        self.session = Session(self.robot, self.own, lambda now_ns: self.device(now_ns), self)
        self.session._aside = lambda work, goes_on=False: work()  # one thread, in which time passes
        self.session.help, self.device = "help", self.read

    def say(self, text):
        """Be the screen."""
        self.said.append(text)

    def advance(self, phase, progress, detail):
        """Be its line of status."""
        self.shown.append(detail)

    def read(self, now_ns):
        """Be the device."""
        self.each()
        if now_ns >= self._until_ns:
            if not self.script:
                return Wish({}, ("quit",))
            seconds, demand, *actions = self.script.pop(0)
            self._now = Wish({}, missing="plug it in") if demand is None else Wish(demand)
            self._until_ns = now_ns + round(seconds * 1e9)
            return self._now._replace(actions=tuple(actions))
        return self._now

    def run(self, *script):
        """Play a script to its end."""
        self.script = list(script)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("gateway.cli.teleop.session.time", Clock(self.world))
            self.session.run()
        return self

    @property
    def left(self):
        """The left arm as the client sees it."""
        self.world.run(0.05)
        return self.robot.state.left_arm
