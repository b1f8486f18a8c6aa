"""A person's turn in virtual time: a robot, the real engine, a client, and wishes by script."""

from __future__ import annotations

from gateway.cli.teleop.keyboard import Wish
from gateway.cli.teleop.session import Session
from gateway.client import connect
from gateway.kinematics.description import nominal
from tests.client.robot_world import RobotWorld

__all__ = ["Turn"]


class Turn:
    """A session whose device says what a test wants, in a world whose time passes when the session waits."""

    def __init__(self, **sim):
        self.world = RobotWorld(**sim)
        self.said, self.shown = [], []
        self.script = []
        """(for so long [s], demand, actions): what is wished, one after the other; then `quit`."""
        self.robot = connect(transport=self.world.transport(), name="ta2 teleop")
        self.own = self.robot.control().acquire()
        self.own.enable()
        self._until_ns, self._now = 0, Wish({})
        self.each = lambda: None
        self.session = Session(
            robot=self.robot, own=self.own, device=self, body=nominal(), say=self.said.append, show=self.shown.append,
            now_ns=self.world.now_ns, pause=self.world.run, help="help",
        )  # fmt: skip

    def read(self, now_ns):
        """Be the device."""
        self.each()
        if now_ns >= self._until_ns:
            if not self.script:
                return Wish({}, ("quit",))
            seconds, demand, *actions = self.script.pop(0)
            self._until_ns, self._now = now_ns + round(seconds * 1e9), Wish(demand)
            return Wish(demand, tuple(actions))
        return self._now

    def run(self, *script):
        """Play a script to its end."""
        self.script = list(script)
        self.session.run()
        return self

    @property
    def left(self):
        """The left arm as the client sees it."""
        self.world.run(0.05)
        return self.robot.state.left_arm
