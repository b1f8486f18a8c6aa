"""`ta2 service`: the text of the units, what an installation changes and what not, and what is said where it cannot be."""

from __future__ import annotations

import os
import pwd
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.cli import service
from gateway.cli.service import GATEWAY, RECORDER, WEB
from tests.cli.shell import Shell

ROOT = Path(__file__).resolve().parents[2]
MOST_EXPOSED = 2.5
"""Of 10, by `systemd-analyze security`."""

RUNNING = """\
Id=ta2-gateway.service
LoadState=loaded
ActiveState=active
SubState=running
StateChangeTimestamp=Thu 2026-01-01 10:00:00 UTC
StatusText=HOLDING; a=b
MainPID=42
NRestarts=1
WatchdogUSec=5s
WatchdogTimestamp=Thu 2026-01-01 10:00:05 UTC
FragmentPath=/etc/systemd/system/ta2-gateway.service

Id=ta2-recorder.service
LoadState=not-found
ActiveState=inactive
"""
NOT_INSTALLED = RUNNING.replace("LoadState=loaded", "LoadState=not-found").replace("=active", "=inactive")


class Systemctl:
    """A `systemctl` on PATH that writes down what it is told, and says what it shall."""

    def __init__(self, folder: Path) -> None:
        self.told = folder / "told"
        self.shown = folder / "shown"
        self.program = folder / "systemctl"
        self.says(RUNNING)

    def says(self, text: str, status: int = 0, error: str = "") -> None:
        self.shown.write_text(text)
        show = f'case "$1" in show) cat "{self.shown}";; esac'
        self.program.write_text(f'#!/bin/sh\necho "$*" >> "{self.told}"\n{show}\necho "{error}" >&2\nexit {status}\n')
        self.program.chmod(0o755)

    def heard(self) -> list[str]:
        """Return what it was told since the last look, without the questions how things are."""
        lines = self.told.read_text().splitlines() if self.told.exists() else []
        self.told.unlink(missing_ok=True)
        return [line for line in lines if not line.startswith("show ")]


@pytest.fixture
def systemctl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Systemctl:
    """One that shows a gateway that runs."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    return Systemctl(folder)


@pytest.fixture
def host(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, systemctl: Systemctl) -> Path:
    """A host on which we are root, with one more user, `op`; its folder of units, and sockets elsewhere."""
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(pwd, "getpwnam", lambda name: {"op": SimpleNamespace()}[name])
    monkeypatch.setattr(service, "UNITS", tmp_path / "units")
    monkeypatch.setattr(service, "SYSTEM_SOCKET", tmp_path / "run" / "ta2" / "gateway.sock")
    return tmp_path / "units"


def printed(shell: Shell, *words: str) -> dict[str, str]:
    """Return the units that are printed, by their names."""
    done = shell.run("service", "install", "--print", *words)
    assert done.status == 0, done.err
    parts = re.split(r"^# /etc/systemd/system/(\S+)\n", done.out, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def keys(unit: str) -> dict[str, str]:
    """Return the last value of each key of a unit."""
    return dict(line.split("=", 1) for line in unit.splitlines() if "=" in line and not line.startswith("#"))


# ---------------------------------------------------------------------------------------------------------- the units


def test_the_units_are_printed_and_nothing_is_written_or_asked(
    shell: Shell, systemctl: Systemctl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Anybody may: no root, no systemd."""
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    before = sorted(tmp_path.rglob("*"))
    assert list(printed(shell)) == [GATEWAY, RECORDER]
    assert sorted(tmp_path.rglob("*")) == before


def test_the_gateway_is_watched_and_its_guard_is_left_alive(shell: Shell) -> None:
    """What the hand-over of a hold takes: the guard outlives the daemon, and finds its sockets where they were."""
    unit = keys(printed(shell, "--user", "op")[GATEWAY])
    wanted = {
        "Type": "notify",
        "NotifyAccess": "main",
        "User": "op",
        "KillMode": "process",
        "Restart": "on-failure",
        "RuntimeDirectory": "ta2",
        "RuntimeDirectoryPreserve": "yes",
        "StateDirectory": "ta2",
        "Environment": "TA2_STATE_DIR=%S/ta2",
        "LimitRTPRIO": "90",
        "LimitMEMLOCK": "infinity",
        "MemoryDenyWriteExecute": "yes",
    }
    assert {name: unit.get(name) for name in wanted} == wanted
    assert unit["WatchdogSec"] == "5" and unit["WatchdogSignal"] == "SIGKILL"
    assert unit["ExecStart"].endswith(" run --socket /run/ta2/gateway.sock")
    assert "RestrictRealtime" not in unit and "RemoveIPC" not in unit


def test_the_recorder_ends_its_bag_well(shell: Shell, tmp_path: Path) -> None:
    """With Ctrl-C's signal, into the folder that was named, and with all of its threads."""
    unit = keys(printed(shell)[RECORDER])
    assert unit["WorkingDirectory"] == "%S/ta2/bags" and unit["StateDirectory"] == "ta2 ta2/bags"
    assert unit["KillSignal"] == "SIGINT" and "KillMode" not in unit and unit["Type"] == "notify"
    assert unit["ExecStart"].endswith(" record --socket /run/ta2/gateway.sock")
    unit = keys(printed(shell, "--recorder", str(tmp_path / "100 % bags"))[RECORDER])
    assert unit["WorkingDirectory"] == f"{tmp_path}/100 %% bags"
    assert f'"{tmp_path}/100 %% bags"' in printed(shell, "--recorder", str(tmp_path / "100 % bags"))[RECORDER]


def test_the_page_is_served_to_the_users_that_were_named(shell: Shell, tmp_path: Path) -> None:
    """Where that is asked for; its log holds no secret that opens it, and its memory is not the gateway's."""
    unit = keys(printed(shell, "--web", str(tmp_path / "users"))[WEB])
    assert unit["ExecStart"].endswith(f" web --socket /run/ta2/gateway.sock --users {tmp_path}/users")
    assert unit["Type"] == "exec" and unit["ProtectSystem"] == "strict" and "WatchdogSec" not in unit
    assert unit["MemoryMax"] == "1G"
    done = shell.run("service", "install", "--print", "--web", "/srv/us\ners")
    assert done.status == 1 and "cannot stand in a unit" in done.err


def test_options_stand_in_the_gateways_command(shell: Shell, tmp_path: Path) -> None:
    """The robot and the settings file, by its whole path, whatever is in it."""
    file = tmp_path / "my $robot 1%.toml"
    file.write_text("[arm]\nv_radps = 0.4\n")
    command = keys(printed(shell, "--robot", "10.0.0.7", "--config", str(file))[GATEWAY])["ExecStart"]
    assert command.endswith(f' --robot tcp/10.0.0.7:9000 --config "{tmp_path}/my $$robot 1%%.toml"')


def test_an_installation_without_the_script_is_found_all_the_same(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the interpreter and the package that print the unit; backslashes and quotes are those of systemd."""
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    command = keys(printed(shell)[GATEWAY])["ExecStart"]
    assert command.startswith(f"{tmp_path}/python -c \"import runpy, sys; sys.path[:] = ['{ROOT}'")
    (tmp_path / "ta2").touch()
    assert keys(printed(shell)[GATEWAY])["ExecStart"].startswith(f"{tmp_path}/ta2 run ")


@pytest.mark.parametrize(
    ("environ", "user"),
    [
        ({"SUDO_USER": "ann", "USER": "root"}, "ann"),
        ({"USER": "bob"}, "bob"),
        ({"SUDO_USER": "root", "USER": "root"}, "ta2"),
        ({}, "ta2"),
    ],
)
def test_services_are_those_of_who_typed_sudo(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, environ: Mapping[str, str], user: str
) -> None:
    """His programs find the socket by themselves. Never root's."""
    for name in ("SUDO_USER", "USER"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environ.items():
        monkeypatch.setenv(name, value)
    assert {keys(unit)["User"] for unit in printed(shell).values()} == {user}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--user", "root"], "does not run as 'root'"),
        (["--user", "a\nExecStartPre=rm"], "does not run as"),
        (["--recorder", "/data\nUser=root"], "cannot stand in a unit"),
        (["--recorder", '/da"ta'], "cannot stand in a unit"),
    ],
)
def test_nothing_gets_into_a_unit_that_does_not_belong_there(shell: Shell, words: list[str], told: str) -> None:
    """A line break, a quote, root."""
    done = shell.run("service", "install", "--print", *words)
    assert (done.status, done.out) == (1, "") and told in done.err and " -> " in done.err


def test_a_settings_file_that_is_wrong_is_not_installed(shell: Shell, host: Path, tmp_path: Path) -> None:
    """The gateway would not start with it."""
    file = tmp_path / "a.toml"
    file.write_text("[arm]\nv_radps = 40\n")
    done = shell.run("service", "install", "--user", "op", "--config", str(file))
    assert done.status == 2 and "arm.v_radps" in done.err and not host.exists()


@pytest.mark.parametrize("name", [GATEWAY, RECORDER, WEB])
def test_services_are_hardly_exposed(shell: Shell, tmp_path: Path, name: str) -> None:
    """As systemd itself judges it, where it can; and it knows every word of the units."""
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("no systemd-analyze here")
    file = tmp_path / name
    file.write_text(printed(shell, "--recorder", "/srv/bags", "--web", "/srv/users")[name])
    words = [analyze, "security", "--offline=true", "--no-pager", str(file)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=50, check=False)
    found = re.search(r"exposure level for \S+: (\d+\.\d+)", done.stdout)
    if found is None and "offline" in done.stderr:  # before systemd 250; whatever else it says is a fault of the unit
        pytest.skip(f"this systemd-analyze judges no files: {done.stderr}")
    assert found is not None, done.stderr
    assert float(found[1]) <= MOST_EXPOSED, done.stdout
    assert "Unknown" not in done.stderr and "Failed to parse" not in done.stderr, done.stderr


CANNOT_TELL = ("this kernel has no PR_SET_MDWE", "this interpreter makes code itself", "it is not obeyed here")
WITHOUT_NEW_CODE = """
import ctypes, mmap, sys
if ctypes.CDLL(None).prctl(65, 1, 0, 0, 0) != 0:
    sys.exit("@0@")
try:
    ctypes.CFUNCTYPE(ctypes.c_int)(int)
except MemoryError:
    sys.exit("@1@")
try:
    mmap.mmap(-1, 4096, prot=7)
except OSError:
    pass
else:
    sys.exit("@2@")
print("refused", flush=True)
import numpy, ruckig, zenoh
import gateway.process.daemon, gateway.guard.guard
assert numpy.linalg.inv(numpy.eye(7) * 2)[0, 0] == 0.5
planner, state, plan = ruckig.Ruckig(1, 0.01), ruckig.InputParameter(1), ruckig.OutputParameter(1)
state.target_position = state.max_velocity = state.max_acceleration = state.max_jerk = [1.0]
assert planner.update(state, plan) == ruckig.Result.Working
config = '{"scouting": {"multicast": {"enabled": false}}, "listen": {"endpoints": []}}'
zenoh.open(zenoh.Config.from_json5(config)).close()
print("done", flush=True)
"""
"""No memory is written and run from here on, as `MemoryDenyWriteExecute=yes` has it."""


def test_the_gateway_needs_no_memory_that_is_written_and_run() -> None:
    """numpy, ruckig and zenoh work under `MemoryDenyWriteExecute=yes`."""
    program = WITHOUT_NEW_CODE
    for number, why in enumerate(CANNOT_TELL):
        program = program.replace(f"@{number}@", why)
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=50, check=False)
    if done.stderr.strip() in CANNOT_TELL:  # said before anything of ours was loaded
        pytest.skip(done.stderr)
    assert (done.returncode, done.stdout.split()) == (0, ["refused", "done"]), done.stderr


# ------------------------------------------------------------------------------------------- installing and removing


def test_an_installation_writes_the_units_and_starts_the_gateway(
    shell: Shell, host: Path, systemctl: Systemctl
) -> None:
    """Again, it writes nothing: no unit is touched, and systemd reads none anew."""
    systemctl.says(NOT_INSTALLED)
    done = shell.run("service", "install", "--user", "op")
    assert done.status == 0 and done.out.count(": written") == 2 and "restart" not in done.out
    assert systemctl.heard() == ["daemon-reload", f"disable {RECORDER}", f"enable --now {GATEWAY}"]
    texts = {path.name: path.read_text() for path in host.iterdir()}
    assert sorted(texts) == [GATEWAY, RECORDER]
    assert [path.stat().st_mode & 0o777 for path in host.iterdir()] == [0o644, 0o644]
    before = {path.name: path.stat().st_ino for path in host.iterdir()}
    done = shell.run("service", "install", "--user", "op")
    assert done.status == 0 and done.out.count(": as it was") == 2
    assert systemctl.heard() == [f"disable {RECORDER}", f"enable --now {GATEWAY}"]
    assert {path.name: path.stat().st_ino for path in host.iterdir()} == before


def test_a_gateway_that_runs_is_not_restarted(shell: Shell, host: Path, systemctl: Systemctl) -> None:
    """It might hold something: who installed is told how, and decides when."""
    assert shell.run("service", "install", "--user", "op").status == 0
    systemctl.heard()
    done = shell.run("service", "install", "--user", "op", "--robot", "10.0.0.7")
    assert f"{host / GATEWAY}: written" in done.out and f"{host / RECORDER}: as it was" in done.out
    assert f"systemctl restart {GATEWAY}" in done.out
    assert not any("restart" in words for words in systemctl.heard())


def test_a_recorder_gets_its_folder(
    shell: Shell, host: Path, systemctl: Systemctl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Made for the service's user where there is none; one that is there is left as it is."""
    owned: list[tuple[Path, str]] = []
    monkeypatch.setattr(shutil, "chown", lambda path, user: owned.append((path, user)))
    for _ in range(2):
        assert shell.run("service", "install", "--user", "op", "--recorder", str(tmp_path / "a" / "bags")).status == 0
        assert systemctl.heard()[-1] == f"enable --now {GATEWAY} {RECORDER}"
    assert owned == [(tmp_path / "a" / "bags", "op")] and (tmp_path / "a" / "bags").is_dir()


@pytest.mark.parametrize("is_image", [False, True])
def test_a_recorder_that_is_asked_for_no_more_starts_at_no_boot(
    shell: Shell, host: Path, systemctl: Systemctl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_image: bool
) -> None:
    """Its unit names the folder of before no more; one that records goes on until somebody ends it."""
    monkeypatch.setattr(shutil, "chown", lambda path, user: None)
    words = ["service", "install", "--user", "op", *(["--root", str(tmp_path / "i")] if is_image else [])]
    assert shell.run(*words, "--recorder", str(tmp_path / "bags")).status == 0
    assert not any(f"disable {RECORDER}" in told for told in systemctl.heard())
    assert shell.run(*words).status == 0
    where, now = (f"--root {tmp_path / 'i'} ", "") if is_image else ("", "--now ")
    assert systemctl.heard()[-2:] == [f"{where}disable {RECORDER}", f"{where}enable {now}{GATEWAY}"]


def test_what_was_installed_goes_and_data_stay(shell: Shell, host: Path, systemctl: Systemctl, tmp_path: Path) -> None:
    """Ended, and of no more effect at the next boot; sockets go, bags stay. Where nothing is, nothing is done."""
    bags = tmp_path / "bags"
    bags.mkdir()
    (tmp_path / "run" / "ta2").mkdir(parents=True)
    assert shell.run("service", "install", "--user", "op", "--recorder", str(bags)).status == 0
    (host / "other.service").touch()
    systemctl.heard()
    done = shell.run("service", "remove")
    assert done.status == 0 and done.out.count(": removed") == 2
    assert systemctl.heard() == [f"disable --now {RECORDER} {GATEWAY}", "daemon-reload"]
    assert [path.name for path in host.iterdir()] == ["other.service"]
    assert bags.is_dir() and not (tmp_path / "run" / "ta2").exists()
    assert shell.run("service", "remove").status == 0 and systemctl.heard() == []


def test_an_image_is_made_without_root_and_without_its_users(
    shell: Shell, systemctl: Systemctl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`--root DIR`: everything is written and enabled there, nothing is started or asked here."""
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(pwd, "getpwnam", lambda name: pytest.fail("asked for a user of this host"))
    root = tmp_path / "image"
    units = root / "etc" / "systemd" / "system"
    words = ("service", "install", "--root", str(root), "--user", "robot", "--recorder", "/srv/bags")
    for state in ("written", "as it was"):
        done = shell.run(*words)
        assert done.status == 0 and done.out == "".join(f"{units / n}: {state}\n" for n in (GATEWAY, RECORDER))
        assert systemctl.heard() == [f"--root {root} enable {GATEWAY} {RECORDER}"]
        assert sorted(path.name for path in root.rglob("*.*")) == [GATEWAY, RECORDER]
    assert {unit: (units / unit).read_text() for unit in (GATEWAY, RECORDER)} == {
        name: text.rstrip("\n") + "\n" for name, text in printed(shell, "--user", "robot", *words[-2:]).items()
    }
    assert shell.run("service", "remove", "--root", str(root)).status == 0
    assert systemctl.heard() == [f"--root {root} disable {RECORDER} {GATEWAY}"]
    assert [path for path in root.rglob("*") if not path.is_dir()] == []


def test_an_image_that_cannot_be_written_is_told_in_a_line(shell: Shell, systemctl: Systemctl, tmp_path: Path) -> None:
    """What stands where a folder must be, say."""
    (tmp_path / "image").write_text("")
    done = shell.run("service", "install", "--root", str(tmp_path / "image"), "--user", "robot")
    assert (
        done.status == 1 and done.err.startswith("BAD_REQUEST: ") and "--root" in done.err and systemctl.heard() == []
    )


def test_the_page_is_installed_and_removed_with_the_others(shell: Shell, systemctl: Systemctl, tmp_path: Path) -> None:
    """Later installations that do not name it leave it as it is."""
    for words in (["--web", "/srv/users"], []):
        assert shell.run("service", "install", "--root", str(tmp_path / "i"), "--user", "op", *words).status == 0
    assert systemctl.heard()[1] == f"--root {tmp_path / 'i'} enable {GATEWAY} {WEB}"
    assert shell.run("service", "remove", "--root", str(tmp_path / "i")).status == 0
    assert systemctl.heard() == [f"--root {tmp_path / 'i'} disable {WEB} {RECORDER} {GATEWAY}"]
    assert [path for path in (tmp_path / "i").rglob("*") if not path.is_dir()] == []


@pytest.mark.parametrize("verb", ["install", "remove"])
def test_only_root_changes_this_host(
    shell: Shell, host: Path, systemctl: Systemctl, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    """The remedy is said, and nothing was done."""
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    done = shell.run("service", verb)
    assert done.status == 1 and "only root" in done.err and "sudo " in done.err and "--print" in done.err
    assert systemctl.heard() == [] and not host.exists()


def test_a_user_that_is_not_there_is_made_first(shell: Shell, host: Path, systemctl: Systemctl) -> None:
    """By whoever installs: the command is named, and nothing was written."""
    done = shell.run("service", "install", "--user", "nemo")
    assert done.status == 1 and "no user nemo" in done.err and "useradd --system nemo" in done.err
    assert systemctl.heard() == [] and not host.exists()


# ------------------------------------------------------------------------------------------------------------ looking


def test_status_says_state_since_when_watchdog_and_place(shell: Shell, systemctl: Systemctl) -> None:
    """On a few lines, or as JSON."""
    done = shell.run("service", "status")
    assert done.status == 0
    assert done.out.splitlines() == [
        "ta2-gateway.service: active (running) since Thu 2026-01-01 10:00:00 UTC",
        "  process 42, 1 restarts; it says: HOLDING; a=b",
        "  watchdog 5s, last fed Thu 2026-01-01 10:00:05 UTC; /etc/systemd/system/ta2-gateway.service",
        "ta2-recorder.service: not installed",
    ]
    told = shell.run("service", "status", "--json").json
    assert told["ok"] is True and told["units"][GATEWAY]["StatusText"] == "HOLDING; a=b"
    assert told["units"][RECORDER]["LoadState"] == "not-found"


def test_a_gateway_that_does_not_run_is_an_exit_status(shell: Shell, systemctl: Systemctl) -> None:
    """3, as of every command that finds no gateway."""
    systemctl.says(NOT_INSTALLED)
    done = shell.run("service", "status")
    assert (done.status, done.out) == (3, "ta2-gateway.service: not installed\nta2-recorder.service: not installed\n")
    assert shell.run("service", "status", "--json").json["ok"] is False
    systemctl.says(RUNNING.replace("ActiveState=active\nSubState=running", "ActiveState=failed\nSubState=failed"))
    done = shell.run("service", "status")
    assert done.status == 3 and "failed (failed)" in done.out


def test_without_systemd_it_is_said(
    shell: Shell, host: Path, systemctl: Systemctl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A container, or another init: status 3, and an installation that writes nothing."""
    systemctl.says("", 1, "System has not been booted with systemd")
    for words in (["status"], ["install", "--user", "op"], ["remove"]):
        done = shell.run("service", *words)
        assert (done.status, done.out) == (3, "") and "has not been booted with systemd" in done.err
        assert "ta2 run" in done.err
    monkeypatch.setenv("PATH", str(tmp_path))
    done = shell.run("service", "status", "--json")
    assert done.status == 3 and done.json["ok"] is False and "systemctl" in done.err
    assert not host.exists()


def test_the_gateway_reads_its_settings_anew_on_a_reload(shell):
    """Its main process alone gets the signal: the guard is not asked."""
    assert keys(printed(shell)[GATEWAY])["ExecReload"] == "/bin/kill -HUP $MAINPID"
