"""Which settings a running gateway takes from its file when that is read anew, and which need a restart. Reads that file.

Rules
    * All or nothing: where one setting that has changed needs a restart, nothing of the file is taken.
    * Taken is what is looked at when something is asked for, so that nothing that moves can jump.
    * The limits that the gate and the guard judge by are those of the start. A speed limit may be lowered, and raised again
      up to that; a higher one needs a restart.
    * Files that the settings name are not read anew: one that has changed needs a restart.
    * What is named may be anything meanwhile: a pipe is not waited for, and of a large file no more is read than is allowed.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from gateway.errors import Code, failure
from gateway.settings.settings import Settings
from gateway.settings.toml_file import ENCODING, KEYS, SECTIONS, lines

__all__ = ["AT_MOST", "FILES", "MOST_BYTES", "MOST_LINE", "TAKEN", "changes", "marks", "read_regular"]

MOST_BYTES, MOST_LINE = 32_768, 512
"""A larger file, or one with a longer line [bytes], is not read: its reader shares a processor with the control loop. A key of
32,000 dots takes the parser 9 s; inside these bounds the worst file that was found takes 0.13 s, our own 2 to 4 ms."""


def _names(fields: Mapping[str, str]) -> frozenset[str]:
    return frozenset(f"{section}.{field}" for section, named in fields.items() for field in named.split())


AT_MOST = _names({"arm": "v_radps", "chassis": "v_mps w_radps", "pose": "v_mps w_radps"})
"""Taken up to what they were at the start."""
TAKEN = AT_MOST | _names(
    {
        "arm": "settle_rad settle_ns settle_timeout_ns target_expiry_ns start_margin_rad",
        "chassis": "expiry_ns",
        "lift": "v_max expiry_ns",
        "pose": "settle_m settle_rad start_margin_m",
        "enable": "timeout_ns",
        "local": "audit_log_mb demand_stop_endpoint",
    }
)
"""By section of the file and field. Any other needs a restart: the guard has it too, clients were told it, or it made what is
there since the start."""
FILES = _names(
    {"local": "users_file roles_file tls_certificate tls_private_key tls_root_ca", "model": "urdf calibration"}
)
"""Settings that name a file which is read at the start."""


def read_regular(path: Path) -> str:
    """Return the text of a regular file of at most `MOST_BYTES`.

    Raises:
        OSError: It is none, cannot be read, or has a line of more than `MOST_LINE`.
        UnicodeDecodeError: It is no text.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "it is no regular file")
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise OSError(errno.EFBIG, f"it is larger than {MOST_BYTES} bytes")
    if max(map(len, content.split(b"\n"))) > MOST_LINE:
        raise OSError(errno.EFBIG, f"it has a line of more than {MOST_LINE} bytes")
    return content.decode(ENCODING)


def marks(settings: Settings) -> dict[str, tuple[int, ...]]:
    """Return what changes with each file that the settings name; nothing of one that is not there."""
    found: dict[str, tuple[int, ...]] = {}
    for name in sorted(FILES):
        path = _value(settings, name)
        try:
            status = os.stat(path) if path else None
        except (OSError, ValueError):
            status = None
        found[name] = () if status is None else (status.st_ino, status.st_size, status.st_mtime_ns)
    return found


def changes(
    began: Settings, running: Settings, fresh: Settings, changed: Iterable[str] = ()
) -> tuple[dict[str, Any], str]:
    """Return what is taken of settings that were read anew.

    Args:
        began: Those of the start.
        running: Those in force.
        fresh: Those of the file.
        changed: Which of `FILES` have another content than at the start.

    Returns:
        The new values by section and field, and the same in the words of the file.

    Raises:
        ConfigError: BAD_CONFIG. Something needs a restart; all of it is named, and nothing is taken.
    """
    taken: dict[str, Any] = {}
    told: list[str] = []
    refused = [f"the file of {name}" for name in changed]
    for section, keys in KEYS.items():
        for key in keys.values():
            name = f"{section}.{key.field}"
            value, before = _value(fresh, name), _value(running, name)
            if value == before:
                continue
            if name in AT_MOST and value > (most := _value(began, name)):
                refused.append(f"{section}.{key.name} above the {most:g} of the start")
            elif name not in TAKEN:
                refused.append(f"{section}.{key.name}")
            else:
                taken[name] = value
                told += [f"{section}.{line}" for line in lines(key, value)]
    if refused:
        hint = "start the gateway anew while nothing moves, or put it back; nothing of the file was taken"
        raise failure(Code.BAD_CONFIG, f"needs a restart: {', '.join(refused)}", hint=hint)
    return taken, ", ".join(told)


def _value(settings: Settings, name: str) -> Any:  # noqa: ANN401  any field of any section
    section, _, field = name.partition(".")
    return getattr(getattr(settings, SECTIONS[section]), field)
