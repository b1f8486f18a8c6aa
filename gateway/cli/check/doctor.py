"""`ta2 doctor`: whether this computer is set up for a gateway, and what to type where it is not. Changes nothing.

What is read and how it is judged are apart. What cannot be read, as in many a container, is `unknown` and no trouble.
"""

from __future__ import annotations

import ctypes
import json
import os
import platform
import resource
import shutil
import socket
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final, NamedTuple

from gateway.api.protocol import default_socket
from gateway.cli.command_line.video_arguments import PORT
from gateway.cli.terminal.ending import ExitStatus

__all__ = ["READERS", "Advice", "advice", "carry_out", "readings"]

TICK_S, TICKS = 0.01, 100
LATE_MS = 5.0
"""A tick of 10 ms that comes so late costs half a setpoint [ms] (choice)."""
RMEM_BYTES = 4_194_304
"""What a receiver of the robot's pictures asks for [bytes]."""
DISK_BYTES = 5_000_000_000
LIMITS = "of the user who runs it: `{0} {1}` in /etc/security/limits.d/ta2.conf, or {2}= in its systemd unit"
EXTRAS: Final = {
    "body": "pin",
    "video": "av",
    "record": "mcap",
    "dataset": "pyarrow",
    "policy": "websockets",
    "sim": "mujoco",
}
MARKS: Final = {"ok": "ok     ", "advice": "ADVICE ", "problem": "PROBLEM", "unknown": "?      "}


class Advice(NamedTuple):
    """One row: `ok`, `advice`, `problem` or `unknown`, what was found, and what to type."""

    name: str
    verdict: str
    found: str
    do: str = ""


# ------------------------------------------------------------------------------------------------------------- reading


def _limit(which: int) -> float:
    hard = resource.getrlimit(which)[1]
    return float("inf") if hard == resource.RLIM_INFINITY else hard


def _late_ms() -> tuple[float, float]:
    """Return median and worst lateness of a tick of 10 ms over a second [ms]."""
    begin_s, late_ms = time.monotonic(), []
    for number in range(1, TICKS + 1):
        due_s = begin_s + number * TICK_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        late_ms.append(1e3 * (time.monotonic() - due_s))
    return sorted(late_ms)[TICKS // 2], max(late_ms)


def _is_synchronised() -> bool:
    """Ask the kernel whether something keeps its clock (adjtimex, which asks only when its modes are 0)."""
    state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.create_string_buffer(512))
    if state < 0:
        raise OSError(ctypes.get_errno(), "adjtimex")
    return bool(state != 5)


def _governors() -> set[str]:
    found = {
        path.read_text().strip() for path in Path("/sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    }
    if not found:
        raise FileNotFoundError
    return found


def _folder() -> tuple[str, bool]:
    """Return the folder of the gateway's socket, or what will be its parent, and whether it can be written."""
    folder = next(path for path in default_socket().parents if path.exists())
    return str(folder), os.access(folder, os.W_OK | os.X_OK)


def _is_free(port: int, kind: socket.SocketKind) -> bool:
    with socket.socket(socket.AF_INET, kind) as probe:
        try:
            probe.bind(("0.0.0.0", port))
        except OSError:
            return False
    return True


def _firewall() -> str:
    """Return whether a firewall is set to start; its rules are for root."""
    return "on" if "ENABLED=yes" in Path("/etc/ufw/ufw.conf").read_text() else "off"


def _packages() -> dict[str, str]:
    found = {}
    for name in ("eclipse-zenoh", "numpy", "ruckig", *EXTRAS.values()):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


READERS: Final[Mapping[str, Callable[[], Any]]] = {
    "rtprio": lambda: _limit(resource.RLIMIT_RTPRIO),
    "memlock": lambda: _limit(resource.RLIMIT_MEMLOCK),
    "root": lambda: os.geteuid() == 0,
    "tick": _late_ms,
    "governor": _governors,
    "cores": lambda: len(os.sched_getaffinity(0)),
    "clock": _is_synchronised,
    "disk": lambda: shutil.disk_usage(Path.cwd()).free,
    "socket": _folder,
    "port 7447": lambda: _is_free(7447, socket.SOCK_STREAM),
    f"port {PORT}": lambda: _is_free(PORT, socket.SOCK_DGRAM),
    "udp buffer": lambda: int(Path("/proc/sys/net/core/rmem_max").read_text()),
    "firewall": _firewall,
    "python": platform.python_version,
    "packages": _packages,
}
"""How each of the host's facts is read; Any: each its own type, as `advice` takes it."""


def readings(readers: Mapping[str, Callable[[], Any]] = READERS) -> dict[str, Any]:
    """Return what can be read; None stands for what cannot."""
    found: dict[str, Any] = {}
    for name, read in readers.items():
        found[name] = None
        with suppress(OSError, ValueError, AttributeError, StopIteration):  # not there, or not permitted, here
            found[name] = read()
    return found


# ------------------------------------------------------------------------------------------------------------- judging


def advice(host: Mapping[str, Any]) -> Iterator[Advice]:
    """Yield a row for each of the host's facts, as `readings` gives them; `unknown` for each that is None."""
    for name, judge in JUDGES.items():
        fact = host.get(name)
        said = (name, "unknown", "cannot be read here") if fact is None else (name, *judge(fact, host))
        yield Advice(*said)


Judged = tuple[str, str] | tuple[str, str, str]


def _limited(text: str, words: tuple[str, str, str], least: float) -> Callable[[Any, Mapping[str, Any]], Judged]:
    def judge(fact: float, host: Mapping[str, Any]) -> Judged:
        if host.get("root") or fact >= least:
            return "ok", "root may, unless a container forbids it" if host.get("root") else f"{fact:g}"
        return "advice", f"{fact:g}: {text}", LIMITS.format(*words)

    return judge


def _tick(fact: tuple[float, float], _: Mapping[str, Any]) -> Judged:
    found = f"a tick of 10 ms is {fact[0]:.2f} ms late in the middle, {fact[1]:.2f} ms at worst"
    late = "end what loads this computer; see rows rtprio and governor"
    return ("problem" if fact[0] > LATE_MS else "advice" if fact[1] > LATE_MS else "ok"), found, late


def _governor(fact: set[str], _: Mapping[str, Any]) -> Judged:
    slow = fact - {"performance", "schedutil"}
    return "advice" if slow else "ok", ", ".join(sorted(fact)), "sudo cpupower frequency-set -g performance"


def _port(fact: bool, _: Mapping[str, Any]) -> Judged:
    return "ok" if fact else "advice", "free" if fact else "taken: fine, if you know by whom", "ss -lntup"


def _packed(fact: Mapping[str, str], _: Mapping[str, Any]) -> Judged:
    missing = [extra for extra, package in EXTRAS.items() if package not in fact]
    found = ", ".join(f"{name} {number}" for name, number in fact.items())
    without = f"; without the extras {', '.join(missing)}" if missing else ""
    return "ok", found + without, f"pip install 'teleavatar-gateway[{','.join(missing)}]'" if missing else ""


JUDGES: Final[Mapping[str, Callable[[Any, Mapping[str, Any]], Judged]]] = {
    "rtprio": _limited("ticks come late under load", ("- rtprio", "80", "LimitRTPRIO=80"), 80),
    "memlock": _limited("memory may be swapped out", ("- memlock", "unlimited", "LimitMEMLOCK=infinity"), float("inf")),
    "tick": _tick,
    "governor": _governor,
    "cores": lambda fact, _: ("ok" if fact >= 2 else "advice", str(fact), "give it two cores at least"),
    "clock": lambda fact, _: (
        ("ok", "synchronised")
        if fact
        else ("advice", "nothing keeps it: recordings do not fit the robot's", "sudo timedatectl set-ntp true")
    ),
    "disk": lambda fact, _: (
        "ok" if fact >= DISK_BYTES else "advice",
        f"{fact / 1e9:.0f} GB free",
        "record on another disk",
    ),
    "socket": lambda fact, _: (
        "ok" if fact[1] else "problem",
        fact[0],
        "export TA2_SOCKET=PATH, in a folder of your own",
    ),
    "port 7447": _port,
    f"port {PORT}": _port,
    "udp buffer": lambda fact, _: (
        "ok" if fact >= RMEM_BYTES else "advice",
        f"{fact} bytes",
        f"sudo sysctl -w net.core.rmem_max={RMEM_BYTES}",
    ),
    "firewall": lambda fact, _: (
        "ok" if fact == "off" else "advice",
        f"ufw is {fact}",
        f"sudo ufw allow from ROBOT_IP to any port {PORT} proto udp (§2.6.3)",
    ),
    "python": lambda fact, _: ("ok", fact),
    "packages": _packed,
}


def carry_out(options: Namespace) -> ExitStatus:
    """Print all rows; REFUSED when something is a problem."""
    rows = list(advice(readings()))
    is_good = all(row.verdict != "problem" for row in rows)
    if options.json:
        print(json.dumps({"ok": is_good, "rows": [row._asdict() for row in rows]}, ensure_ascii=False, indent=2))
    else:
        for row in rows:
            print(
                f"{MARKS[row.verdict]} {row.name}: {row.found}"
                + (f"\n        -> {row.do}" if row.do and row.verdict != "ok" else "")
            )
    return ExitStatus.OK if is_good else ExitStatus.REFUSED
