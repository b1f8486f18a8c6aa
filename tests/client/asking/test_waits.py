"""Waiting for answers while zenoh ends the queries of a link that is gone."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from gateway.api import protocol
from gateway.client.asking.waits import Answer, Stopped

S = 1_000_000_000


@pytest.mark.parametrize("kind", ["answer", "stop"])
def test_an_answer_that_is_lost_waits_for_nobody_who_asks(kind: str) -> None:
    """Zenoh ends all queries of a link under a lock that its next query takes: one who asks again would wait for ever."""
    asked: list[Callable[[bytes | None], None]] = []
    session = SimpleNamespace(
        changed=threading.Condition(),
        transport=SimpleNamespace(
            ask=lambda key, payload, timeout_s, on_done: asked.append(on_done),
            drop=lambda key, payload: None,
            now_ns=lambda: 0,
        ),
        require_daemon=lambda daemon=None: None,
        require_own_process=lambda: None,
        notify=lambda: None,
        **{"is_connected": True, "is_closed": False, "daemon": "d", "client_id": "c", "secret": "s", "name": "test"},
    )
    if kind == "stop":
        wait = Stopped(session, protocol.Stop(), 10 * S)  # type: ignore[arg-type]  # as much of one as is used
    else:
        wait = Answer(session, "key", b"", bytes, 10 * S, "a question")  # type: ignore[arg-type, assignment]  # as above
    with session.changed:  # as whoever polls holds it
        ending = threading.Thread(target=asked[0], args=(None,), daemon=True)
        ending.start()
        ending.join(10.0)
        assert not ending.is_alive()
        assert wait.poll(S) is None and len(asked) == 2
