"""Records what a release says over the wire, for `tests/api/test_wire.py`: `python -m tests.tooling.record_wire`, at a release.

A client and an engine in virtual time speak to each other, and every request of `tests/api/samples.py` is written down.
"""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np

from gateway import __version__
from gateway.api import encoding, protocol
from gateway.client import connect
from tests.api.samples import REQUESTS, command
from tests.api.test_wire import whole
from tests.client.world import World

HEARD = {"snapshot": encoding._SNAPSHOT, "info": encoding._INFO, "reply": encoding._REPLY}
EVERY = 6
"""One snapshot of so many is kept."""


def text(payload: bytes) -> str:
    """Return a payload as it stands in the file."""
    return base64.b64encode(payload).decode()


def record() -> dict[str, list[object]]:
    """Return what was said."""
    said: dict[str, list[bytes]] = {what: [] for what in HEARD}
    for what, reader in HEARD.items():

        def read(payload: bytes, encoding: str, what: str = what, reads=reader.read) -> object:
            said[what].append(bytes(payload))
            return reads(payload, encoding)

        reader.read = read  # type: ignore[method-assign]  # heard in passing
    world = World()
    with connect(transport=world.transport(), name="ann") as robot, robot.control(on_exit="hold") as own:
        own.enable()
        own.left_arm.move_by(np.full(7, 0.1))
        world.run(0.3)
        robot.fresh_state()
    facts = {"motion_id": "1"}
    notice = protocol.Notice(code="MOTION_ENDED", level="info", message="motion 1 reached", at_ns=1, facts=facts)
    told: dict[str, list[object]] = {what: [text(payload) for payload in payloads] for what, payloads in said.items()}
    told["snapshot"] = told["snapshot"][::EVERY]
    told["notice"] = [text(protocol.encode(notice))]
    commands = [command(request, number) for number, request in enumerate(REQUESTS, 1)]
    told["commands"] = [{"payload": text(protocol.encode(sent)), "means": whole(sent)} for sent in commands]
    return told


if __name__ == "__main__":
    parts = [f'"{what}": [\n' + ",\n".join(map(json.dumps, items)) + "]" for what, items in record().items()]
    path = Path(__file__).parents[1] / "api" / "wire" / f"{__version__}.json"
    path.write_text("{" + ",\n".join(parts) + "}\n", encoding="utf-8")
    print(path)
