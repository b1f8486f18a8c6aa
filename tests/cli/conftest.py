"""Fixtures of the tests of commands."""

from __future__ import annotations

import pytest

from tests.cli.shell import Shell


@pytest.fixture
def shell(monkeypatch, capsys, tmp_path):
    """A shell whose commands find a scripted engine, and never the gateway of whoever runs the tests."""
    monkeypatch.setenv("TA2_SOCKET", str(tmp_path / "nobody.sock"))
    return Shell(monkeypatch, capsys)
