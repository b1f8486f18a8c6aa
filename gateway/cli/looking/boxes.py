"""Where black boxes lie: this user's, and those of a service on this computer, which another user may have."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from gateway.cli.terminal.ending import ExitStatus
from gateway.settings.toml_file import state_dirs

__all__ = ["boxes", "places"]


def places() -> list[Path]:
    """Return the folders in which there may be black boxes."""
    return [folder / "incidents" for folder in state_dirs()]


def boxes(among: Sequence[Path]) -> tuple[list[Path], ExitStatus]:
    """Return the folder of each robot, and REFUSED where some cannot be looked for: nobody takes that for none."""
    found: list[Path] = []
    closed: list[Path] = []
    for place in among:
        try:
            robots = sorted(path for path in place.iterdir() if path.is_dir())
        except FileNotFoundError:
            continue
        except OSError:
            closed.append(place)
            continue
        for folder in robots:
            (found if os.access(folder, os.R_OK | os.X_OK) else closed).append(folder)
    for folder in closed:
        print(f"{folder} cannot be read: look as its user, or with sudo", file=sys.stderr)
    return found, ExitStatus.REFUSED if closed else ExitStatus.OK
