"""A real bridge as a process: which one, with what configuration.

The program is what `bin/bridge build` made, or what `TA2_BRIDGE` names. Without one, tests that need it are skipped,
unless `TA2_INTEROP=required` says that they must run, as in CI: a user has no bridge, and building one takes Rust and five
minutes.
"""

from __future__ import annotations

import functools
import importlib.util
import json
import os
import subprocess
from pathlib import Path
from typing import Final

from tests import leaving_out

__all__ = ["BRIDGE_LEASE_MS", "bridge_program", "bridge_settings", "demand", "is_required", "lacking", "start_bridge"]

ROOT: Final = Path(__file__).resolve().parents[2]
_VARIABLE: Final = "TA2_INTEROP"
BRIDGE_LEASE_MS: Final = 10_000
"""The default of zenoh, which a robot's bridge has unless its configuration says otherwise [ms]."""


@functools.cache
def bridge_program() -> Path | None:
    """Return the program, None when there is none."""
    named = os.environ.get("TA2_BRIDGE")
    if named is None:
        found = subprocess.run([ROOT / "bin/bridge", "path"], capture_output=True, text=True, timeout=20, check=False)
        named = found.stdout.strip()
    return Path(named) if named and os.access(named, os.X_OK) else None


def lacking(*, bridge: bool = True) -> str:
    """Return what is missing for a test and how to get it, in one line; empty when nothing is.

    Args:
        bridge: Whether it needs a bridge too, and not only the DDS side of one.
    """
    if importlib.util.find_spec("cyclonedds") is None:
        return "no CycloneDDS for Python: pip install 'teleavatar-gateway[interop]' (bin/test does, once bin/bridge has built)"
    return "no bridge is built: bin/bridge build" if bridge and bridge_program() is None else ""


def is_required() -> bool:
    """Return whether tests that lack something must fail instead of being left out."""
    return leaving_out.is_required(_VARIABLE)


def demand(*, bridge: bool = True, module: bool = False) -> None:
    """Skip the test, or fail it where skipping is not allowed, when something is missing.

    Args:
        bridge: Whether it needs a bridge too, and not only the DDS side of one.
        module: Whether this is called while the module is imported, for all its tests.
    """
    if what := lacking(bridge=bridge):
        leaving_out.leave_out(what, _VARIABLE, module=module)


def bridge_settings(
    listen: str, *, domain: int, namespace: str = "/", connect: tuple[str, ...] = ()
) -> dict[str, object]:
    """Return the configuration of a bridge, as its own program would complete it.

    Args:
        listen: Endpoint of its router; empty for a host bridge, which only connects, although it is a router too.
        domain: DDS domain.
        namespace: Put before every topic's key.
        connect: Endpoints that it connects to, as a host bridge does (§2.4).
    """
    return {
        "mode": "router",
        "listen": {"endpoints": [listen] if listen else []},
        "connect": {"endpoints": list(connect)},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},
        "adminspace": {"enabled": True, "permissions": {"read": True, "write": False}},
        "transport": {"link": {"tx": {"lease": BRIDGE_LEASE_MS}}, "shared_memory": {"enabled": False}},
        "plugins_loading": {"enabled": True},
        "plugins": {"ros2dds": {"domain": domain, "namespace": namespace}},
    }


def start_bridge(
    settings: dict[str, object], folder: Path, *, name: str = "bridge", loopback: str = ""
) -> subprocess.Popen[bytes]:
    """Start a bridge; its output goes to `NAME.log` in the folder.

    Args:
        settings: Its configuration.
        folder: For its configuration and its log.
        name: Of both files.
        loopback: Configuration of its CycloneDDS; empty for what stands in the environment.

    Raises:
        FileNotFoundError: If there is no bridge.
    """
    program = bridge_program()
    if program is None:
        raise FileNotFoundError(lacking())
    config = folder / f"{name}.json5"
    config.write_text(json.dumps(settings, indent=1))
    # Without the name of the release it expects the 16-byte Gid of later ones, and makes no route at all.
    environment = {**os.environ, "ROS_DISTRO": "humble", **({"CYCLONEDDS_URI": loopback} if loopback else {})}
    environment.setdefault("RUST_LOG", "z=info,zenoh_plugin_ros2dds=info")
    with (folder / f"{name}.log").open("ab") as log:
        return subprocess.Popen(
            [program, config], stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, env=environment
        )
