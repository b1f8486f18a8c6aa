"""Robot and gateway on two computers, as far as the network goes: two network namespaces and a cable that can be cut.

A cut is silent, as a lost radio link is: each end sends to an Ethernet address that nobody has, no interface goes down
and nothing is answered. Both namespaces are made for one test and go with it; this computer's own network is not
touched. Questions to the robot and to the daemon go through sockets in the file system, which know no namespaces.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from itertools import count
from pathlib import Path
from typing import ClassVar, Final

import pytest

from tests.e2e.system import System

__all__ = ["Cable", "FarSystem", "demand_cable"]

ROBOT_ADDRESS: Final = "10.29.0.1"
GATEWAY_ADDRESS: Final = "10.29.0.2"
NOBODY: Final = "02:00:00:00:29:ff"
_MACS: Final = {"robot": "02:00:00:00:29:01", "gateway": "02:00:00:00:29:02"}

_numbers = count(1)


def _ip(*arguments: str) -> None:
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True, timeout=10, check=False)
    if done.returncode:
        raise OSError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")


def demand_cable() -> None:
    """Skip the test where no network namespaces can be made: that takes more rights than every machine gives."""
    try:
        if shutil.which("ip") is None:
            raise OSError("no program `ip`: apt-get install iproute2")
        Cable().close()
    except OSError as error:
        # Namespaces take rights that containers and users may lack: the line says which, and no other test needs them.
        pytest.skip(f"no network namespaces here: {error}")


class Cable:
    """Two namespaces with a cable between them, which works.

    Attributes:
        robot: Name of the robot's namespace.
        gateway: Name of the gateway's.

    Raises:
        OSError: If that is not permitted here.
    """

    def __init__(self) -> None:
        number = next(_numbers)
        self.robot, self.gateway = (f"ta2-{end}-{os.getpid()}-{number}" for end in ("robot", "gateway"))
        try:
            for name in (self.robot, self.gateway):
                _ip("netns", "add", name)
                _ip("-n", name, "link", "set", "lo", "up")
            _ip(
                "link", "add", "cable", "netns", self.robot, "address", _MACS["robot"], "type", "veth",
                "peer", "name", "cable", "netns", self.gateway, "address", _MACS["gateway"],
            )  # fmt: skip
            for name, address in ((self.robot, ROBOT_ADDRESS), (self.gateway, GATEWAY_ADDRESS)):
                _ip("-n", name, "address", "add", f"{address}/24", "dev", "cable")
                _ip("-n", name, "link", "set", "cable", "up")
            self.mend()
        except OSError:
            self.close()
            raise

    def cut(self) -> None:
        """Let nothing through any more, both ways."""
        self._address(NOBODY, NOBODY)

    def mend(self) -> None:
        """Let everything through."""
        self._address(_MACS["robot"], _MACS["gateway"])

    def _address(self, robot: str, gateway: str) -> None:
        _ip("-n", self.gateway, "neigh", "replace", ROBOT_ADDRESS, "lladdr", robot, "dev", "cable", "nud", "permanent")
        _ip(
            "-n", self.robot, "neigh", "replace", GATEWAY_ADDRESS, "lladdr", gateway, "dev", "cable", "nud", "permanent"
        )

    def close(self) -> None:
        """Remove both namespaces; safe to call twice. Whoever lives in one keeps it until he ends."""
        for name in (self.robot, self.gateway):
            if Path("/run/netns", name).exists():
                _ip("netns", "del", name)


class FarSystem(System):
    """A robot, its bridge and its DDS graph at one end of a cable, the daemon at the other.

    Args:
        folder: For sockets, state and logs.
        config: Text of a configuration file for the daemon.
    """

    kind: ClassVar[str] = "dds"

    def __init__(self, folder: Path, *, config: str = "") -> None:
        self.cable = Cable()
        self.robot_place = ("ip", "netns", "exec", self.cable.robot)
        self.daemon_place = ("ip", "netns", "exec", self.cable.gateway)
        super().__init__(folder, config=config)

    def endpoints(self) -> tuple[str, str]:
        """Return where the robot listens, and where it is asked by the tests: beside the network."""
        return f"tcp/{ROBOT_ADDRESS}:9000", f"unixsock-stream/{self.folder / 'ask'}"

    def close(self) -> None:
        """End everything, the namespaces last."""
        super().close()
        self.cable.close()
