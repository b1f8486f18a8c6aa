"""A fleet's router in this process, and the robots that are in it."""

from __future__ import annotations

import contextlib
import json
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import zenoh

from gateway.api import protocol
from gateway.fleet.member import Member
from tests.changed import replace

ROUTER = {
    "mode": "router",
    "connect/endpoints": [],
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
}
PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "fleets.md"


def router(locator: str, **more: Any) -> zenoh.Session:
    """Return a zenoh router that listens there."""
    config = zenoh.Config()
    for key, value in (ROUTER | {"listen/endpoints": [locator]} | more).items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def files_of_the_page() -> list[str]:
    """Return the two files of the how-to page: a robot's, and the router's."""
    return re.findall(r"```json5\n(.*?)```", PAGE.read_text(), re.DOTALL)


@contextlib.contextmanager
def member(fleet: str, name: str, socket: Path, **options: Any) -> Iterator[Member]:
    """A robot in a fleet while the block runs; `fleet` as `TA2_FLEET` has it."""
    made = Member(replace(protocol.fleet_address(fleet), robot=name), name, socket, **options)
    thread = threading.Thread(target=made.run)
    thread.start()
    try:
        yield made
    finally:
        made.close()
        thread.join(10)
        assert not thread.is_alive()
