"""Stand-ins around inbox and outbox: a question whose answer can be read, an audience that keeps what it got."""

from __future__ import annotations

import weakref

from gateway.api import protocol
from gateway.api.access.roles import Asker
from gateway.api.inbox import Inbox
from gateway.api.outbox import Outbox
from gateway.api.stop_lane import StopLane
from gateway.api.translate import describe
from gateway.settings.settings import Settings


class AskedQuestion:
    asker = Asker()

    def __init__(self, payload=b"", key=protocol.COMMAND_KEY, encoding="", received_ns=0):
        self.key, self.payload, self.encoding, self.received_ns = key, payload, encoding, received_ns
        self.answers = []
        self.dropped = False

    def answer(self, payload, encoding):
        self.answers.append((payload, encoding))

    def drop(self):
        self.dropped = True

    @property
    def reply(self):
        """The one answer, decoded."""
        assert len(self.answers) == 1, self.answers
        return protocol.decode_reply(*self.answers[0])

    @property
    def code(self):
        return self.reply.refusal.code


class KeptAudience:
    def __init__(self, listens=True):
        self.listens = listens
        self.snapshots = []
        self.notices = []
        self.numbers = []

    def wants_snapshots(self):
        return self.listens

    def put_snapshot(self, payload, seq):
        self.snapshots.append((protocol.decode_snapshot(payload), seq))

    def put_notice(self, payload, number):
        self.notices.append(protocol.decode_notice(payload))
        self.numbers.append(number)


class Desk:
    """An inbox and an outbox whose threads are the test."""

    def __init__(self):
        self.stops = StopLane()
        weakref.finalize(self, self.stops.close)
        self.outbox = Outbox(describe(Settings(), socket="/s", pid=1), self.stops)
        self.inbox = Inbox(self.outbox)

    def ask(self, *args, **kwargs):
        question = AskedQuestion(*args, **kwargs)
        self.inbox.ask(question)
        return question

    def run(self):
        """Read and send everything that lies there."""
        while self.inbox.sort(0):
            pass
        while self.outbox.deliver(0):
            pass
