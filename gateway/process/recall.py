"""What earlier daemons knew of a robot under other addresses: latches and epochs, found again by the robot's router.

Rules it obeys
    * A state file names the routers (zenoh id and namespace) at whose robot it was kept. When the link is up and the router
      is named in another file, the latches there are latched here too, before anything can be enabled. They are only
      added; what `recover` clears here is cleared there when it is on disk, not before.
    * Epochs go on above those of every file of the folder, from the start on: no router need be known for that.
    * The files are read at the start, and the loop never waits for them. They are written by the thread of `StateWriter`.

A router that takes a new random zenoh id at each start is known by its address alone: latches that were set under another
one (its name, the number of another interface) are not found then. Nor are those that another daemon, which runs
meanwhile, sets later.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Set
from pathlib import Path

from msgspec import Struct, field
from msgspec.structs import replace

from gateway.core.messages.outputs import Remembered
from gateway.errors import Code, GatewayError
from gateway.process.state_file import StateFile, read_state

__all__ = ["Recall"]

_log = logging.getLogger(__name__)


class _Kin(Struct):
    """Another file.

    Attributes:
        taken: Those of its causes that were latched here; the loop's.
        kept: Those of them that our disk has had, or what waited for it; the writer's, as the next.
        cleared: Those of them that it has no more.
    """

    path: Path
    known: Remembered
    taken: frozenset[Code] = frozenset()
    kept: set[Code] = field(default_factory=set)
    cleared: set[Code] = field(default_factory=set)


class Recall:
    """The other state files of a folder, as they were when this was made.

    Args:
        own: This daemon's own file.
    """

    def __init__(self, own: Path) -> None:
        self._kin: list[_Kin] = []
        self._on_disk: frozenset[Code] = frozenset()
        for path in sorted(own.parent.glob("*.json")):
            if path != own:
                try:
                    self._kin.append(_Kin(path, read_state(path)))
                except (OSError, ValueError, RecursionError) as error:
                    _log.warning("what %s knows of its robot is not known here: %s", path, error)

    @property
    def epoch(self) -> int:
        """No file names a higher epoch than this one."""
        return max((kin.known.epoch for kin in self._kin), default=0)

    def known_here(self, own: Remembered) -> None:
        """Begin with what the own file says."""
        self._on_disk = frozenset(own.latches)

    def meet(self, router: str, latch: Callable[[Code, str], None]) -> None:
        """The robot's router has said who it is: latch what is known of it. Once for each file: what was cleared stays so.

        Args:
            router: As `Remembered.routers` has it.
            latch: Takes each cause with its message.
        """
        for kin in self._kin:
            if router in kin.known.routers:
                _take(kin, latch)

    def saved(self, remembered: Remembered, forgotten: Set[Code] = frozenset()) -> None:
        """Clear elsewhere what was cleared here. May wait for the disk; of one thread.

        Args:
            remembered: What is on disk now.
            forgotten: Causes in states that waited for the disk before it, and never got there.
        """
        before, self._on_disk = self._on_disk, frozenset(remembered.latches)
        for kin in self._kin:
            kin.kept |= kin.taken & (before | self._on_disk | forgotten) - kin.cleared
            gone = kin.kept - self._on_disk
            if gone and _clear(kin.path, gone):
                kin.kept -= gone
                kin.cleared |= gone


def _take(kin: _Kin, latch: Callable[[Code, str], None]) -> None:
    latches = kin.known.latches
    kin.known = replace(kin.known, latches={})
    kin.taken |= latches.keys()
    for code, message in latches.items():
        latch(code, f"{message} (known from {kin.path.name})")


def _clear(path: Path, cleared: Set[Code]) -> bool:
    """Return whether a file has these causes no more."""
    try:
        with StateFile(path) as file:
            known = read_state(path)
            file.save(replace(known, latches={c: text for c, text in known.latches.items() if c not in cleared}))
    except (GatewayError, OSError, ValueError) as error:  # tried again with the next state
        _log.warning("%s still has what was cleared: %s", path, error)
        return False
    return True
