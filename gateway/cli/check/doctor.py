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
import subprocess
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from importlib.metadata import version
from importlib.util import find_spec
from math import inf
from pathlib import Path
from typing import Any, Final, NamedTuple

from gateway.api.protocol import default_socket
from gateway.cli.command_line.robot_arguments import ROBOT_PORT
from gateway.cli.command_line.video_arguments import PORT
from gateway.cli.terminal.ending import ExitStatus
from gateway.process.realtime import CAP_IPC_LOCK, CAP_SYS_NICE, has_capability

__all__ = ["PROBES", "Advice", "Probe", "advice", "carry_out", "readings"]

TICKS, TICK_S, LATE_MS = 100, 0.01, 5.0
"""A tick of 10 ms that comes later costs half a setpoint (choice)."""
RMEM_BYTES = 4_194_304
"""Holds a second of the robot's pictures (choice)."""
DISK_BYTES = 5e9
FIREWALLS: Final = ("firewalld", "nftables", "netfilter-persistent")
"""Services beside ufw."""
NEEDED: Final = ("eclipse-zenoh", "numpy", "ruckig", "msgspec", "rich")
EXTRAS: Final = dict(
    body="pinocchio",
    dataset="pyarrow",
    demo="matplotlib",
    gym="gymnasium",
    keys="cryptography",
    lerobot="grpc",
    policy="websockets",
    record="mcap",
    sim="mujoco",
    teleop="sdl2",
    video="av",
    view="rerun",
    web="starlette",
)
"""Extra -> a module that is there with it."""


class Advice(NamedTuple):
    """One row: `ok`, `advice`, `problem` or `unknown`, what was found, and what to type."""

    name: str
    verdict: str
    found: str
    do: str


def _limit(which: int) -> float:
    """Return a hard limit of this process; none where a capability lifts it, which root in a container may lack."""
    hard = resource.getrlimit(which)[1]
    lifting = CAP_SYS_NICE if which == resource.RLIMIT_RTPRIO else CAP_IPC_LOCK
    return inf if hard == resource.RLIM_INFINITY or has_capability(lifting) else hard


def _late_ms() -> tuple[float, float]:
    """Return median and worst lateness of a tick of 10 ms over a second [ms]."""
    begin_s, late_ms = time.monotonic(), []
    for number in range(1, TICKS + 1):
        due_s = begin_s + number * TICK_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        late_ms.append(1e3 * (time.monotonic() - due_s))
    return sorted(late_ms)[TICKS // 2], max(late_ms)


def _is_synchronised() -> bool:
    """Ask the kernel whether something keeps its clock: adjtimex, which changes nothing when it is handed zeros."""
    state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.create_string_buffer(512))
    if state < 0:
        raise OSError(ctypes.get_errno(), "adjtimex")
    return bool(state != 5)


def _governors() -> list[str] | None:
    files = Path("/sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    return sorted({path.read_text().strip() for path in files}) or None


def _kernel() -> tuple[str, str]:
    """Return the kernel's release, and what it says of preemption."""
    release, build = (Path("/proc/sys/kernel", name).read_text() for name in ("osrelease", "version"))
    return release.strip(), next((word for word in build.split() if word.startswith("PREEMPT")), "no PREEMPT")


def _firewalls() -> str:
    """Return the names of those that are on; rules that belong to no service are shown to root alone.

    Raises:
        FileNotFoundError: There is nobody to ask.
    """
    said: list[str] = []
    with suppress(OSError, subprocess.TimeoutExpired):
        asked = subprocess.run(
            ["systemctl", "is-active", *FIREWALLS], capture_output=True, text=True, timeout=5, check=False
        )
        said = asked.stdout.split()
    found = [name for name, state in zip(FIREWALLS, said, strict=False) if state == "active"]
    try:
        found += ["ufw"] if "ENABLED=yes" in Path("/etc/ufw/ufw.conf").read_text() else []
    except FileNotFoundError:
        if not said:
            raise
    return ", ".join(found) or "none"


def _socket() -> tuple[str, bool, str]:
    """Return the gateway's socket, or the folder where one will be made, whether we may open or make it, and else who may.

    That is the group of the user whose folder it is, as of a service; empty where the folder is nobody's but root's or ours.
    """
    path = default_socket()
    if os.access(path, os.W_OK) and path.is_socket():
        return str(path), True, ""
    folder = next(each for each in path.parents if each.exists())
    of, group = folder.stat(), ""
    if folder == path.parent and of.st_uid not in (os.getuid(), 0):
        group = str(of.st_gid)
        with suppress(KeyError):  # a group without a name here
            group = folder.group()
    return str(folder), os.access(folder, os.W_OK | os.X_OK), group


def _is_free(port: int, kind: socket.SocketKind) -> bool:
    with socket.socket(socket.AF_INET, kind) as probe, suppress(OSError):
        probe.bind(("0.0.0.0", port))
        return True
    return False


class Probe(NamedTuple):
    """How a fact is read, whether it is good (or how bad), how it is told, and what to type when it is not good."""

    read: Callable[[], Any]
    judge: Callable[[Any], bool | str]
    text: str | Callable[[Any], str]
    do: str | Callable[[Any], str] = ""


def _free(why: str) -> Callable[[bool], str]:
    return lambda is_free: f"free {why}" if is_free else "somebody listens there"


def _be_let_in(found: tuple[str, bool, str]) -> str:
    own, group = "export TA2_SOCKET=PATH, in a folder of yours", found[2]
    theirs = f"its gateway must run, and you be in its group: sudo usermod -aG {group} $USER, and log in anew"
    return theirs if group else own


LIMITS = "`USER - {} {}` in /etc/security/limits.d/ta2.conf, or {} in the unit of systemd"
TAKEN = "`ss -lntup` says by whom; it is fine if you know"
# fmt: off
PROBES: Final[Mapping[str, Probe]] = {
    "real time": Probe(lambda: _limit(resource.RLIMIT_RTPRIO), lambda most: most >= 80,
                       lambda most: f"priority up to {min(most, 99):g}",
                       LIMITS.format("rtprio", 80, "LimitRTPRIO=80")),
    "memlock": Probe(lambda: _limit(resource.RLIMIT_MEMLOCK), lambda most: most == inf,
                     lambda most: "all may be locked" if most == inf else f"{most / 1e6:.3g} MB may be locked",
                     LIMITS.format("memlock", "unlimited", "LimitMEMLOCK=infinity")),
    "tick": Probe(_late_ms, lambda late_ms: "problem" if late_ms[0] > LATE_MS else late_ms[1] <= LATE_MS,
                  "10 ms come {0[0]:.2f} ms late in the middle, {0[1]:.2f} ms at worst", "end what loads this computer"),
    "kernel": Probe(_kernel, lambda found: found[1] != "no PREEMPT", "{0[0]}, {0[1]}",
                    "where `tick` is late: your distribution's low-latency or real-time kernel"),
    "governor": Probe(_governors, lambda names: {*names} <= {"performance", "schedutil"}, "{0}",
                      "sudo cpupower frequency-set -g performance"),
    "cores": Probe(lambda: len(os.sched_getaffinity(0)), lambda count: count >= 2, "{}", "give it two at least"),
    "clock": Probe(_is_synchronised, bool,
                   lambda kept: f"kept by {'a time service' if kept else 'nothing'}", "sudo timedatectl set-ntp true"),
    "disk": Probe(lambda: shutil.disk_usage(Path.cwd()).free, lambda free: free >= DISK_BYTES,
                  lambda free: f"{free / 1e9:.3g} GB are free", "record on another disk: --out DIR"),
    "socket": Probe(_socket, lambda found: found[1] or "problem", "{0[0]}", _be_let_in),
    f"tcp {ROBOT_PORT}": Probe(lambda: _is_free(ROBOT_PORT, socket.SOCK_STREAM), bool, _free("for `ta2 sim`"), TAKEN),
    "tcp 7447": Probe(lambda: _is_free(7447, socket.SOCK_STREAM), bool, _free("(no zenoh router is here)"), TAKEN),
    f"udp {PORT}": Probe(lambda: _is_free(PORT, socket.SOCK_DGRAM), bool, _free("for the robot's pictures"), TAKEN),
    "udp buffer": Probe(lambda: int(Path("/proc/sys/net/core/rmem_max").read_text()), lambda size: size >= RMEM_BYTES,
                        "{} bytes", f"sudo sysctl -w net.core.rmem_max={RMEM_BYTES}"),
    "firewall": Probe(_firewalls, lambda names: names == "none", "{}",
                      f"let udp {PORT} in (§2.6.3): sudo ufw allow from ROBOT_IP to any port {PORT} proto udp, or "
                      f"sudo firewall-cmd --permanent --add-port={PORT}/udp, or a rule of nftables"),
    "python": Probe(platform.python_version, bool, "{}"),
    "packages": Probe(lambda: ", ".join(f"{name} {version(name)}" for name in NEEDED), bool, "{}"),
    "extras": Probe(lambda: ", ".join(extra for extra, name in EXTRAS.items() if find_spec(name) is None),
                    lambda missing: not missing, lambda missing: f"missing: {missing}" if missing else "all are here",
                    "pip install 'teleavatar-gateway[NAME]', where you need one"),
}
"""Every row."""
# fmt: on


def readings() -> dict[str, Any]:
    """Return what can be read; None stands for what cannot. Any: each its own type, as its probe takes it."""
    found: dict[str, Any] = dict.fromkeys(PROBES)
    for name, probe in PROBES.items():
        with suppress(
            OSError, ValueError, AttributeError, ImportError, StopIteration
        ):  # not there, or not permitted, here
            found[name] = probe.read()
    return found


def advice(host: Mapping[str, Any]) -> Iterator[Advice]:
    """Yield a row for each of the host's facts, as `readings` gives them."""
    for name, probe in PROBES.items():
        fact = host.get(name)
        if fact is None:
            yield Advice(name, "unknown", "cannot be read here", "")
            continue
        said = probe.judge(fact)
        verdict = said if isinstance(said, str) else "ok" if said else "advice"
        told = probe.text.format(fact) if isinstance(probe.text, str) else probe.text(fact)
        do = probe.do if isinstance(probe.do, str) else probe.do(fact)
        yield Advice(name, verdict, told, "" if verdict == "ok" else do)


def carry_out(options: Namespace) -> ExitStatus:
    """Print all rows; REFUSED when something is a problem."""
    rows = list(advice(readings()))
    is_good = all(row.verdict != "problem" for row in rows)
    if options.json:
        print(json.dumps({"ok": is_good, "rows": [row._asdict() for row in rows]}, ensure_ascii=False, indent=2))
    else:
        for row in rows:
            print(f"{row.verdict:<8} {row.name:<11} {row.found}" + (f"\n{'':<20} -> {row.do}" if row.do else ""))
    return ExitStatus.OK if is_good else ExitStatus.REFUSED
