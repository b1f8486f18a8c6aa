"""Folders and files of this user alone, in a place where another one may have been first."""

from __future__ import annotations

import os
import stat
from pathlib import Path

__all__ = ["NEW_FILE", "own_folder"]

NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
"""How a file is made: none that is there, nor what a link leads to."""


def own_folder(folder: Path) -> None:
    """Make a folder with mode 0700, or give it that mode; one that leads elsewhere or is another user's is refused.

    Raises:
        OSError: It is refused, or cannot be made.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    try:
        folder.mkdir(mode=0o700)
    except FileExistsError:
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
            raise PermissionError(1, "it is no folder of this user, or leads elsewhere", str(folder)) from None
        if stat.S_IMODE(found.st_mode) != 0o700:
            folder.chmod(0o700)
