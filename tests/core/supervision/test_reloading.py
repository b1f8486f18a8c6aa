"""Settings that were read anew: all of them are taken in one tick or none, and either is told."""

from __future__ import annotations

from gateway.core.messages.events import SettingsRead
from gateway.core.messages.outputs import Level
from gateway.core.supervision.reloading import take_settings
from gateway.errors import Code
from gateway.settings.settings import Settings
from gateway.values import Space
from tests.core.stage import S, Stage


def test_all_values_are_taken_and_nothing_else_changes():
    """In the sections that they are in; the body is told."""
    stage = Stage()
    values = {
        "arm.v_radps": 0.5,
        "arm.settle_rad": 0.02,
        "enable.timeout_ns": 5 * S,
        "local.demand_stop_endpoint": True,
    }
    reading = SettingsRead(values=values, message="arm.v_radps = 0.5", at_ns=stage.now_ns)
    take_settings(stage.coordinator, reading)
    settings, began = stage.coordinator.settings, Settings()
    assert (settings.arm.v_radps, settings.arm.settle_rad, settings.enable.timeout_ns) == (0.5, 0.02, 5 * S)
    assert settings.local.demand_stop_endpoint and settings.arm.a_radps2 == began.arm.a_radps2
    assert settings.chassis is not None and settings.pose == began.pose and settings.link == began.link
    assert stage.coordinator.body.speed_ratio == {Space.JOINT: 0.5, Space.POSE: 1.0}
    assert stage.coordinator.reading is reading
    (notice,) = stage.coordinator.notices
    assert (notice.code, notice.level) == (Code.SETTINGS_READ, Level.INFO)
    assert notice.message == "the settings were read anew: arm.v_radps = 0.5"


def test_a_file_in_which_nothing_has_changed_is_told_as_such():
    """Who asked for it knows that it was read."""
    stage = Stage()
    take_settings(stage.coordinator, SettingsRead(values={}, message="", at_ns=1))
    assert stage.told(Code.SETTINGS_READ) == ["the settings were read anew: none has changed"]


def test_what_is_refused_changes_nothing_and_is_told_with_its_reason():
    """The values in force are those from before, whatever the file has."""
    stage = Stage()
    before, ratio = stage.coordinator.settings, dict(stage.coordinator.body.speed_ratio)
    reading = SettingsRead(values={}, message="needs a restart: arm.rate_hz", at_ns=1, is_refused=True)
    take_settings(stage.coordinator, reading)
    assert stage.coordinator.settings is before and stage.coordinator.body.speed_ratio == ratio
    assert stage.coordinator.reading is reading
    (notice,) = stage.coordinator.notices
    assert (notice.code, notice.level) == (Code.SETTINGS_REFUSED, Level.WARNING)
    assert notice.message == "the settings stay as they are: needs a restart: arm.rate_hz"
