"""Settings that were read anew: taken whole or not at all, and told either way. What moves ends as it began.

What is taken is looked at when something is asked for, settled or enabled; speed limits count from the next plan and the next
target on (`body.py`). Which settings these are, and who says so, stands in `settings/reloading.py`.
"""

from __future__ import annotations

from msgspec.structs import replace

from gateway.core.messages.events import SettingsRead
from gateway.core.messages.outputs import Level
from gateway.core.supervision.coordinator import Coordinator
from gateway.errors import Code

__all__ = ["take_settings"]


def take_settings(coordinator: Coordinator, reading: SettingsRead) -> None:
    """Take what was read, or tell why none of it is taken."""
    coordinator.reading = reading
    if reading.is_refused:
        text = f"the settings stay as they are: {reading.message}"
        coordinator.notice(Code.SETTINGS_REFUSED, Level.WARNING, text, reading.at_ns)
        return
    settings = coordinator.settings
    for name, value in reading.values.items():
        section, _, field = name.partition(".")
        settings = replace(settings, **{section: replace(getattr(settings, section), **{field: value})})
    coordinator.settings = settings
    coordinator.body.renew(settings)
    text = f"the settings were read anew: {reading.message or 'none has changed'}"
    coordinator.notice(Code.SETTINGS_READ, Level.INFO, text, reading.at_ns)
