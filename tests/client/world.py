"""A client and a scripted engine in one thread and in virtual time: what the client's tests play in."""

from __future__ import annotations

from gateway.api.translate import describe
from gateway.settings.settings import Settings
from tests.api.stand_in import TICK_NS, ScriptedEngine
from tests.memory_plane import MemoryPlane
from tests.memory_transport import MemoryTransport


class World:
    """One daemon's plane, its engine, and as many clients as a test connects."""

    def __init__(self):
        self.time_ns = 1_000_000_000
        self.info = describe(Settings(), socket="/run/ta2/gateway.sock", pid=4711)
        self.plane = MemoryPlane(self.info, self.now_ns)
        self.engine = ScriptedEngine(self.plane, self.now_ns)
        self.transports = []
        self.on_tick = None
        self.ticks = 0

    def now_ns(self):
        return self.time_ns

    def transport(self):
        """Return a way for one more client."""
        transport = MemoryTransport(self.plane, self.now_ns, self.pump)
        self.transports.append(transport)
        return transport

    def pump(self):
        """Let one tick pass: the clock, the engine, whatever the test wants to happen, and all keepalives."""
        self.time_ns += TICK_NS
        self.ticks += 1
        self.engine.tick()
        if self.on_tick is not None:
            self.on_tick()

    def run(self, seconds):
        """Let time pass for everybody."""
        for _ in range(round(seconds * 1e9 / TICK_NS)):
            self.pump()
            for transport in self.transports:
                transport.beat()
