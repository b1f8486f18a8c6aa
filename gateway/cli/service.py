"""`ta2 service`: gateway, recorder and page as services of systemd, whose units are written, looked at, and taken away again.

Rules it obeys
    * The guard outlives its daemon (`KillMode=process`), and its sockets and pipes stay where they are
      (`RuntimeDirectoryPreserve=`): the next daemon takes the hold over.
    * Beside its own folders a service writes to /run/lock alone: who starts a gateway by hand has the same locks there.
    * An installation restarts nothing that runs: that is for a person to decide, while nothing moves.
"""

from __future__ import annotations

import json
import os
import pwd
import re
import shutil
import subprocess
import sys
from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

from gateway.api.address import SYSTEM_SOCKET
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, Refusal, failure, to_exception
from gateway.process.own_module import own_module
from gateway.settings import toml_file

__all__ = ["GATEWAY", "RECORDER", "WEB", "carry_out"]

GATEWAY, RECORDER, WEB = "ta2-gateway.service", "ta2-recorder.service", "ta2-web.service"
UNITS = Path("/etc/systemd/system")
SHOWN = (
    "Id LoadState ActiveState SubState StateChangeTimestamp StatusText MainPID NRestarts WatchdogUSec "
    "WatchdogTimestamp FragmentPath"
)

GATEWAY_UNIT = """\
[Unit]
Description=TeleAvatar 2 gateway
After=network-online.target
Wants=network-online.target
StartLimitIntervalSec=30
StartLimitBurst=5

[Service]
ExecStart={command}
ExecReload=/bin/kill -HUP $MAINPID
# The control loop itself says that it is alive. The guard is not ended with it: it holds the robot for the next daemon.
WatchdogSec=5
WatchdogSignal=SIGKILL
KillMode=process
RestartSec=200ms
TimeoutStopSec=15
OOMScoreAdjust=-500
StateDirectory=ta2
"""
RECORDER_UNIT = """\
[Unit]
Description=TeleAvatar 2 recorder
After=network-online.target ta2-gateway.service
Wants=network-online.target
StartLimitIntervalSec=0

[Service]
ExecStart={command}
WorkingDirectory={folder}
ReadWritePaths="{folder}"
# It ends when nothing comes from the robot, and tries again.
WatchdogSec=60
RestartSec=10
KillSignal=SIGINT
SuccessExitStatus=130 143
TimeoutStopSec=60
StateDirectory=ta2 ta2/bags
"""
WEB_UNIT = """\
[Unit]
Description=TeleAvatar 2 page
After=network-online.target ta2-gateway.service
Wants=network-online.target
StartLimitIntervalSec=60
StartLimitBurst=5

[Service]
ExecStart={command}
RestartSec=5
SuccessExitStatus=143
TimeoutStopSec=15
# It takes 70 MB, 100 while somebody logs in, and 50 more for each look. Whatever is sent to it, the rest is the gateway's.
MemoryMax=1G
"""
YES = (
    "NoNewPrivileges ProtectClock ProtectControlGroups ProtectHostname ProtectKernelLogs ProtectKernelModules "
    "ProtectKernelTunables PrivateDevices PrivateTmp PrivateUsers LockPersonality MemoryDenyWriteExecute "
    "RestrictNamespaces RestrictSUIDSGID"
)
ALL = f"""\
Type={{type}}
NotifyAccess=main
User={{user}}
Restart=on-failure
RestartPreventExitStatus=2
RuntimeDirectory=ta2
RuntimeDirectoryPreserve=yes
Environment=TA2_STATE_DIR=%S/ta2
UMask=0077
LimitRTPRIO=90
LimitMEMLOCK=infinity
{"".join(f"{name}=yes{chr(10)}" for name in YES.split())}\
CapabilityBoundingSet=
ProtectSystem=strict
ReadWritePaths=-/run/lock
ProtectHome=read-only
ProtectProc=invisible
KeyringMode=private
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallFilter=~@privileged
SystemCallErrorNumber=EPERM

[Install]
WantedBy=multi-user.target
"""


def carry_out(options: Namespace) -> ExitStatus:
    """Install, show or remove.

    Raises:
        ConfigError: The settings file is not as it must be.
        Rejected: BAD_REQUEST, a name or a path cannot stand in a unit, or this user may not install.
        Disconnected: systemd does not answer here, or refuses.
    """
    if options.verb == "status":
        return _show(as_json=options.json)
    if options.verb == "remove":
        return _remove(options.root)
    asked = (options.user, os.environ.get("SUDO_USER"), os.environ.get("USER"))
    user = options.user or next((name for name in asked if name not in (None, "", "root")), "ta2")
    units = _units(options, user)
    if not options.prints:
        return _install(options, user, units)
    print("\n".join(f"# {UNITS / name}\n{text}" for name, text in units.items()), end="")
    return ExitStatus.OK


def _units(options: Namespace, user: str) -> Mapping[str, str]:
    """Return the text of each unit by its name."""
    if user == "root" or not re.fullmatch(r"[a-zA-Z_][\w.-]*", user, re.ASCII):
        _refuse(f"a service of ours does not run as {user!r}", "name an ordinary user with --user")
    files = [path.absolute() for path in (options.config, options.web, options.recorder) if path is not None]
    for path in files:
        if not re.fullmatch(r'[^\x00-\x1f"\\]+', str(path)):
            _refuse(f"{str(path)!r} cannot stand in a unit", "choose a path without quotes and backslashes")
    run = ["run", "--socket", str(SYSTEM_SOCKET), *(["--robot", options.robot] if options.robot else [])]
    if options.config is not None:
        toml_file.load(options.config)  # it may be wrong
        run += ["--config", str(files[0])]
    folder = "%S/ta2/bags" if options.recorder is None else str(files[-1]).replace("%", "%%")
    record = _command("record", "--socket", str(SYSTEM_SOCKET))
    units = {GATEWAY: GATEWAY_UNIT.format(command=_command(*run))}
    units[RECORDER] = RECORDER_UNIT.format(command=record, folder=folder)
    if options.web is not None:
        web = _command("web", "--socket", str(SYSTEM_SOCKET), "--users", str(options.web.absolute()))
        units[WEB] = WEB_UNIT.format(command=web)
    types = {WEB: "exec"}  # nothing of it keeps a robot alive
    return {name: text + ALL.format(user=user, type=types.get(name, "notify")) for name, text in units.items()}


def _command(*words: str) -> str:
    """Return a command of this very installation, as a unit has it."""
    script = Path(sys.executable).with_name("ta2")
    command = [str(script), *words] if script.exists() else own_module("gateway.cli", *words)
    escaped = [re.sub(r'(["\\])', r"\\\1", word).replace("%", "%%").replace("$", "$$") for word in command]
    return " ".join(word if re.fullmatch(r"[\w./:\[\]-]+", word) else f'"{word}"' for word in escaped)


def _install(options: Namespace, user: str, units: Mapping[str, str]) -> ExitStatus:
    root: Path | None = options.root
    is_running = root is None and _require_systemd()
    if root is None:
        try:
            pwd.getpwnam(user)
        except KeyError:
            _refuse(f"there is no user {user} here", f"`useradd --system {user}`, or name another one with --user")
        if options.recorder is not None and not options.recorder.exists():
            options.recorder.mkdir(parents=True)
            shutil.chown(options.recorder, user)
    folder = root / str(UNITS)[1:] if root else UNITS
    try:
        folder.mkdir(parents=True, exist_ok=True)
        changed = [name for name, text in units.items() if _write(folder / name, text)]
    except OSError as error:
        _refuse(f"{folder} cannot be written: {error.strerror}", "name another place with --root")
    if root is None and changed:
        _systemctl("daemon-reload")
    if changed and is_running:
        print(f"the gateway runs on as it was started; while nothing moves: systemctl restart {GATEWAY}")
    where, now = (["--root", str(root)], []) if root else ([], ["--now"])
    if options.recorder is None:  # it may have been wanted before, in a folder that its unit names no more
        _systemctl(*where, "disable", RECORDER)
    _systemctl(
        *where, "enable", *now, GATEWAY, *([RECORDER] if options.recorder else []), *([WEB] if options.web else [])
    )
    return ExitStatus.OK


def _write(path: Path, text: str) -> bool:
    """Write a file, whole or not at all, and tell; return whether it was another one before."""
    if is_new := not path.exists() or path.read_text(encoding="utf-8") != text:
        new = path.with_suffix(".new")
        new.write_text(text, encoding="utf-8")
        new.chmod(0o644)
        new.replace(path)
    print(f"{path}: {'written' if is_new else 'as it was'}")
    return is_new


def _require_systemd() -> bool:
    """Refuse who may not, and where there is no systemd, before anything is changed; return whether the gateway runs."""
    if os.geteuid() != 0:
        _refuse("only root installs and removes services", f"sudo {_command('service')} ...; --print needs no root")
    return _shown().get(GATEWAY, {}).get("ActiveState") == "active"


def _remove(root: Path | None) -> ExitStatus:
    if root is None:
        _require_systemd()
    folder = root / str(UNITS)[1:] if root else UNITS
    if there := [path for name in (WEB, RECORDER, GATEWAY) if (path := folder / name).exists()]:
        how = ["--root", str(root), "disable"] if root else ["disable", "--now"]
        _systemctl(*how, *(path.name for path in there))
    for path in there:
        path.unlink()
        print(f"{path}: removed")
    if there and root is None:
        _systemctl("daemon-reload")
        shutil.rmtree(SYSTEM_SOCKET.parent, ignore_errors=True)
    return ExitStatus.OK


def _show(*, as_json: bool) -> ExitStatus:
    units = _shown()
    is_running = units.get(GATEWAY, {}).get("ActiveState") == "active"
    if as_json:
        print(json.dumps({"ok": is_running, "units": units}))
    for name, of in {} if as_json else units.items():
        if of["LoadState"] == "not-found":
            print(f"{name}: not installed")
            continue
        print(f"{name}: {of['ActiveState']} ({of['SubState']}) since {of['StateChangeTimestamp'] or 'the boot'}")
        print(f"  process {of['MainPID']}, {of['NRestarts']} restarts; it says: {of['StatusText'] or '-'}")
        print(f"  watchdog {of['WatchdogUSec']}, last fed {of['WatchdogTimestamp'] or 'never'}; {of['FragmentPath']}")
    return ExitStatus.OK if is_running else ExitStatus.NO_GATEWAY


def _shown() -> Mapping[str, Mapping[str, str]]:
    """Return what systemd knows of each unit, by its name."""
    text = _systemctl("show", GATEWAY, RECORDER, WEB, "--property", SHOWN.replace(" ", ","))
    blocks = [dict(line.split("=", 1) for line in block.splitlines() if "=" in line) for block in text.split("\n\n")]
    return {of["Id"]: dict.fromkeys(SHOWN.split(), "") | of for of in blocks if "Id" in of}


def _systemctl(*words: str) -> str:
    """Return what systemctl prints; raise `Disconnected` when there is none, it finds no systemd, or refuses."""
    try:
        environ = {**os.environ, "LC_ALL": "C"}
        return subprocess.run(["systemctl", *words], env=environ, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        said = " ".join(getattr(error, "stderr", str(error)).split())
        hint = f"`journalctl -u {GATEWAY}` tells more; without systemd start `ta2 run` by other means"
        failed = Refusal(code=Code.DISCONNECTED, message=f"systemctl {' '.join(words[:2])}: {said}", hint=hint)
        raise to_exception(failed) from None


def _refuse(message: str, hint: str) -> NoReturn:
    raise failure(Code.BAD_REQUEST, message, hint=hint)
