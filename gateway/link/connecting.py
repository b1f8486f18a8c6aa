"""Opens the session to the robot's router, however long it takes: the first `open` fails while no router listens."""

from __future__ import annotations

import logging
from collections.abc import Callable

import zenoh

from gateway.process.zenoh_words import in_words

__all__ = ["FIRST_RETRY_S", "MAX_RETRY_S", "connect"]

FIRST_RETRY_S = 0.2
MAX_RETRY_S = 1.0

_log = logging.getLogger(__name__)


def connect(config: Callable[[], str], endpoint: str, goes_on: Callable[[float], bool]) -> zenoh.Session | None:
    """Return an open session; None when the link closes first.

    `config` is asked for at each try: a network interface may come, or come again under another number.
    `goes_on` waits so many seconds, then says whether the link is still wanted.
    """
    retry_s = FIRST_RETRY_S
    has_failed = False
    while goes_on(0.0):
        try:
            session = zenoh.open(zenoh.Config.from_json5(config()))
        except (zenoh.ZError, OSError) as error:
            if not has_failed:
                _log.warning("no zenoh router at %s yet, trying on: %s", endpoint, in_words(error))
            has_failed = True
            goes_on(retry_s)
            retry_s = min(2 * retry_s, MAX_RETRY_S)
            continue
        if not goes_on(0.0):
            session.close()  # type: ignore[no-untyped-call]  # zenoh's stub gives no types here
            break
        _log.info("connected to %s as %s", endpoint, session.zid())
        return session
    return None
