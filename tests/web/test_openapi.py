"""The description of the API holds together, and is of what is really there."""

from __future__ import annotations

import json
import re

import msgspec
import pytest

from gateway.web import messages
from gateway.web.openapi import description

DOCUMENT = json.loads(description())


def test_every_reference_leads_somewhere() -> None:
    """A generator of clients stops at the first that does not."""
    wanted = set(re.findall(r'"#/components/schemas/([^"]+)"', description().decode()))
    assert wanted and wanted <= set(DOCUMENT["components"]["schemas"])


@pytest.mark.parametrize(
    "name",
    ["acquire", "release", "enable", "disable", "hold", "home", "jog", "grip", "drive", "lift", "episode", "alive"],
)
def test_everything_that_a_page_may_ask_for_is_described(name: str) -> None:
    """Under the word that it is asked for by."""
    schema = DOCUMENT["components"]["schemas"][name.capitalize()]
    assert schema["properties"]["do"] == {"enum": [name]} and "id" in schema["required"]


def test_stops_take_no_secret_and_all_else_does() -> None:
    """As access control has it."""
    secured = {path: bool(next(iter(methods.values()))["security"]) for path, methods in DOCUMENT["paths"].items()}
    assert secured == {
        "/api/state": True,
        "/api/why": True,
        "/api/video": True,
        "/api/body": True,
        "/api/recordings": True,
        "/api/check": True,
        "/api/stop": False,
        "/api/estop": False,
        "/api/recover": True,
        "/api/login": False,
        "/api/logout": True,
    }


@pytest.mark.parametrize(
    "text",
    [
        '{"do": "jog", "id": 1, "side": "left", "joint": 8, "step_rad": 0.1}',
        '{"do": "jog", "id": 1, "side": "left", "joint": 1, "step_rad": 0.3}',
        '{"do": "jog", "id": 1, "side": "up", "joint": 1, "step_rad": 0.1}',
        '{"do": "grip", "id": 1, "side": "left", "force": NaN}',
        '{"do": "episode", "id": 1, "event": "status"}',
        '{"do": "enable"}',
        '{"do": "enable", "id": 1, "more": 2}',
        '{"do": "fly", "id": 1}',
        "[]",
    ],
)
def test_what_is_wrong_is_refused_before_it_is_asked(text: str) -> None:
    """Form and bounds are the structs' own."""
    with pytest.raises(msgspec.MsgspecError):
        msgspec.json.decode(text, type=messages.Asked)
