"""A shell in virtual time: `ta2` commands in this process, against a scripted engine in memory. For tests."""

from __future__ import annotations

import json
from dataclasses import dataclass

from gateway.cli.main import main
from gateway.client import connect
from tests.client.world import World


@dataclass(frozen=True)
class Ended:
    """What a command left behind."""

    status: int
    out: str
    err: str

    @property
    def json(self):
        """Standard output as JSON."""
        return json.loads(self.out)


class Shell:
    """Runs commands; `world` is what they find."""

    def __init__(self, monkeypatch, capsys):
        self.world = World()
        self.names = []
        self._capsys = capsys
        monkeypatch.setattr("gateway.client.connect", self._connect)
        monkeypatch.delenv("NOTIFY_SOCKET", raising=False)  # whoever runs the tests may be a service

    def _connect(self, target=None, *, name=None, timeout_s=5.0, greet=True):
        self.names.append(name)
        return connect(target, name=name, timeout_s=timeout_s, transport=self.world.transport(), greet=greet)

    def run(self, *words):
        """Run `ta2 WORDS` to its end."""
        self._capsys.readouterr()
        try:
            status = main(words)
        except SystemExit as end:  # argparse
            status = end.code
        self.world.run(0.05)  # what was sent on the way out arrives
        read = self._capsys.readouterr()
        return Ended(int(status), read.out, read.err)

    def after_ticks(self, ticks, action):
        """Let something happen when so many ticks have passed from now on."""
        due = self.world.ticks + ticks

        def on_tick():
            if self.world.ticks == due:
                action()

        self.world.on_tick = on_tick

    def once(self, condition, action):
        """Let something happen in the first tick in which a condition holds."""
        done = []

        def on_tick():
            if not done and condition():
                done.append(True)
                action()

        self.world.on_tick = on_tick
