"""Tests of zenoh's failures as a person reads them."""

from __future__ import annotations

import json

import pytest
import zenoh

from gateway.process.zenoh_words import in_words


def test_no_place_in_zenohs_sources_is_shown():
    """Of a failure of its own."""
    nowhere = {"mode": "client", "connect": {"endpoints": ["tcp/127.0.0.1:1"], "timeout_ms": 100}}
    with pytest.raises(zenoh.ZError) as caught:
        zenoh.open(zenoh.Config.from_json5(json.dumps(nowhere)))
    assert ".rs:" in str(caught.value)
    assert ".rs" not in in_words(caught.value) and in_words(caught.value).startswith("Unable to connect")
