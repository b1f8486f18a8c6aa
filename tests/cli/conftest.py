"""Fixtures of the tests of commands."""

from __future__ import annotations

import pytest

from tests.cli.shell import Shell


@pytest.fixture
def shell(monkeypatch, capsys):
    """A shell whose commands find a scripted engine."""
    return Shell(monkeypatch, capsys)
