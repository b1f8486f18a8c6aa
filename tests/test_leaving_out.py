"""Tests that lack something of the machine."""

from __future__ import annotations

import pytest

from tests.leaving_out import is_required, leave_out


def test_what_a_developer_s_machine_lacks_is_a_reason_to_skip(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reason is told."""
    monkeypatch.delenv("TA2_NOTHING", raising=False)
    assert not is_required("TA2_NOTHING")
    with pytest.raises(pytest.skip.Exception, match="no bridge is built"):
        leave_out("no bridge is built", "TA2_NOTHING")


def test_what_ci_has_installed_is_a_reason_to_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """A test that is silently left out proves nothing."""
    monkeypatch.setenv("TA2_NOTHING", "required")
    assert is_required("TA2_NOTHING")
    with pytest.raises(pytest.fail.Exception, match="no bridge is built"):
        leave_out("no bridge is built", "TA2_NOTHING", module=True)
