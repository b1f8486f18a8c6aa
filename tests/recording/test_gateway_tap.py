"""Rules of `gateway.recording.gateway_tap`: what is told of the gateway, whatever else there is to tell."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

from gateway.core.messages.outputs import Level, Notice
from gateway.errors import Code
from gateway.recording import gateway_tap as module
from gateway.recording.gateway_tap import GatewayTap
from gateway.recording.topics import EVENTS, GATEWAY


def test_whoever_has_much_told_keeps_state_and_owner_out_of_no_recording(monkeypatch):
    """A notice in less than 0.1 s, again and again: anybody can cause them."""
    told, now_s = [], itertools.count(0.0, 0.05)

    def tell(topic, facts):
        told.append(topic)
        if told.count(GATEWAY) == 2:
            tap._is_closing.set()

    tap = GatewayTap(None, tell)
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: next(now_s)))
    notice = Notice(code=Code.ENDPOINT_CHANGED, level=Level.INFO, message="again", at_ns=1)
    owners = itertools.count()

    class Told:
        @property
        def view(self):
            lease = SimpleNamespace(name=f"owner {next(owners)}", client_id="c", epoch=1)
            return SimpleNamespace(state="ACTIVE", lease=lease, latches={}, arms={}, seq=1)

    tap._listen(SimpleNamespace(events=lambda timeout: itertools.repeat(notice), state=Told()))
    assert told.count(GATEWAY) == 2 and 2 <= told.count(EVENTS) <= 10
