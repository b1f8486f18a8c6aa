"""The episodes of a bag by another name: `recording.episodes` knows the buttons itself."""

from __future__ import annotations

from gateway.recording.episodes import episodes as all_episodes

__all__ = ["all_episodes"]
