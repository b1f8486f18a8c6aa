"""Where Rerun is not installed."""

from __future__ import annotations

import sys


def test_it_is_said_what_to_install(shell, monkeypatch):
    """The command that needs it says so in a line; no other one does."""
    for name in [name for name in sys.modules if name.startswith("gateway.cli.scene")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rerun", None)
    ended = shell.run("view")
    assert ended.status == 1 and "pip install 'teleavatar-gateway[view]'" in ended.err
    assert shell.names == []
