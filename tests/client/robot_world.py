"""Clients, the real engine and the simulated robot in one thread and in virtual time: what a user's call does to the robot."""

from __future__ import annotations

from gateway.api.translate import describe
from gateway.core.robot_state.body_model import body_model
from gateway.settings.settings import ChassisSettings, LinkSettings, LocalSettings, Settings
from gateway.sim.robot.settings import SimSettings
from tests.memory_plane import MemoryPlane
from tests.memory_transport import MemoryTransport
from tests.pair import MS, Pair

__all__ = ["RobotWorld"]


class RobotWorld:
    """One robot, one gateway, and as many clients as a test connects.

    Args:
        model: `lite`, `standard` or `lift`.
        chassis: Limits of the chassis and the life of its velocities, where other ones than the usual are needed.
        is_modelled: Whether the gateway has a model of the body.
        sim: Further settings of the robot.
    """

    def __init__(self, model="standard", chassis=None, is_modelled=False, **sim):
        settings = Settings(
            link=LinkSettings(model=model), local=LocalSettings(snapshot_hz=50), chassis=chassis or ChassisSettings()
        )
        body = body_model(settings) if is_modelled else None
        self.pair = Pair(settings, SimSettings(state_period_ns=10 * MS, model=model, **sim), model=body)
        self.plane = MemoryPlane(describe(settings, socket="/s", pid=1), self.now_ns)
        self.transports = []
        self.at = {}
        """What happens at which time [ns]."""
        self.run(0.4)  # the robot is heard, and its mode

    def now_ns(self):
        return self.pair.now_ns

    def transport(self):
        """Return a way for one more client."""
        transport = MemoryTransport(self.plane, self.now_ns, self.pump)
        self.transports.append(transport)
        return transport

    def pump(self):
        """Let one tick pass."""
        for event in self.plane.poll():
            self.pair.receive(event)
        output = self.pair.step()
        self.plane.heed(self.pair.engine.heeded)
        self.plane.send(output.replies, output.notices)
        if output.snapshot is not None:
            self.plane.publish_snapshot(output.snapshot)
        for at_ns in [at_ns for at_ns in self.at if at_ns <= self.pair.now_ns]:
            self.at.pop(at_ns)()

    def run(self, seconds):
        """Let time pass for everybody."""
        until_ns = self.pair.now_ns + round(seconds * 1e9)
        while self.pair.now_ns < until_ns:
            self.pump()
            for transport in self.transports:
                transport.beat()

    def after(self, seconds, action):
        """Let something happen while somebody waits."""
        self.at[self.pair.now_ns + round(seconds * 1e9)] = action
