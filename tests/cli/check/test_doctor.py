"""`ta2 doctor`: what it makes of a computer. All readings are given here; that it can read some is one test."""

from __future__ import annotations

import os
import re
from math import inf
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.cli.check import doctor
from gateway.cli.check.doctor import EXTRAS, PROBES, advice, readings
from gateway.process import realtime

GOOD = {
    "real time": 95,
    "memlock": inf,
    "tick": (0.1, 1.0),
    "kernel": ("6.1.0", "PREEMPT_DYNAMIC"),
    "governor": ["performance"],
    "cores": 8,
    "clock": True,
    "disk": 200_000_000_000,
    "socket": ("/run/user/1000", True, ""),
    "tcp 9000": True,
    "tcp 7447": True,
    "udp 8890": True,
    "udp buffer": 8_388_608,
    "firewall": "none",
    "python": "3.11.7",
    "packages": "numpy 2.0",
    "extras": "",
}


def verdicts(**changes):
    """Return what is said of a good computer, changed as asked, where it is not ok."""
    return {row.name: row.verdict for row in advice({**GOOD, **changes}) if row.verdict != "ok"}


def test_a_computer_that_is_set_up_needs_nothing():
    """Each reading has its row, and no row has anything to be typed."""
    rows = list(advice(GOOD))
    assert set(GOOD) == set(PROBES) and not verdicts() and not any(row.do for row in rows)


@pytest.mark.parametrize(
    ("name", "fact", "verdict", "do"),
    [
        ("real time", 0, "advice", "rtprio 80"),
        ("memlock", 65_536, "advice", "LimitMEMLOCK=infinity"),
        ("tick", (0.1, 30.0), "advice", "end what loads"),
        ("tick", (6.0, 30.0), "problem", "end what loads"),
        ("governor", ["performance", "powersave"], "advice", "cpupower"),
        ("cores", 1, "advice", "two"),
        ("clock", False, "advice", "timedatectl set-ntp true"),
        ("disk", 1_000, "advice", "--out"),
        ("socket", ("/", False, ""), "problem", "TA2_SOCKET"),
        ("socket", ("/run/ta2", False, "robots"), "problem", "usermod -aG robots $USER"),
        ("tcp 9000", False, "advice", "ss -lntup"),
        ("tcp 7447", False, "advice", "ss -lntup"),
        ("udp 8890", False, "advice", "ss -lntup"),
        ("udp buffer", 212_992, "advice", "sysctl -w net.core.rmem_max="),
        ("kernel", ("5.10.0", "no PREEMPT"), "advice", "real-time kernel"),
        ("firewall", "ufw", "advice", "ufw allow from"),
        ("firewall", "firewalld, nftables", "advice", "firewall-cmd"),
        ("extras", "video, sim", "advice", "pip install"),
    ],
)
def test_what_is_amiss_is_told_with_what_to_type(name, fact, verdict, do):
    """In its own row, and in no other."""
    assert verdicts(**{name: fact}) == {name: verdict}
    (row,) = [row for row in advice({**GOOD, name: fact}) if row.name == name]
    assert do in row.do and row.found


@pytest.mark.parametrize(
    ("name", "fact", "words"),
    [
        ("real time", inf, "priority up to 99"),
        ("memlock", inf, "all may be locked"),
        ("memlock", 65_536, "0.0655 MB may be locked"),
        ("clock", True, "kept by a time service"),
        ("clock", False, "kept by nothing"),
        ("disk", 82_500_000_000, "82.5 GB are free"),
        ("tcp 9000", True, "free for `ta2 sim`"),
        ("tcp 7447", False, "somebody listens there"),
        ("extras", "", "all are here"),
        ("extras", "video, sim", "missing: video, sim"),
    ],
)
def test_what_was_found_is_told_in_words(name, fact, words):
    """And in units that people read."""
    (row,) = [row for row in advice({**GOOD, name: fact}) if row.name == name]
    assert row.found == words


def test_every_extra_that_somebody_installs_is_looked_for():
    """Those of the project file but what its developers take."""
    text = (Path(doctor.__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8")
    table = text.partition("[project.optional-dependencies]")[2].partition("\n[")[0]
    assert {*re.findall(r"^(\w+) = \[", table, re.MULTILINE)} - {"test", "interop", "docs", "dev"} == {*EXTRAS}


def test_what_cannot_be_read_is_unknown():
    """As in a container without /sys: neither good nor bad."""
    assert verdicts(**dict.fromkeys(GOOD)) == dict.fromkeys(GOOD, "unknown")
    assert all(row.verdict == "unknown" for row in advice({}))


@pytest.mark.parametrize(
    "error", [PermissionError("no"), FileNotFoundError("no"), ValueError("no"), AttributeError("no"), ImportError("no")]
)
def test_a_reading_that_fails_is_none(monkeypatch, error):
    """Whatever the kernel or the sandbox says."""

    def fail():
        raise error

    monkeypatch.setattr(doctor, "PROBES", {"tick": PROBES["tick"]._replace(read=fail)})
    assert readings() == {"tick": None}


@pytest.mark.parametrize(("held", "limit"), [(realtime.CAP_SYS_NICE, inf), (realtime.CAP_IPC_LOCK, 0), (None, 0)])
@pytest.mark.parametrize("uid", [0, 1000])
def test_root_without_the_capability_has_the_limit_of_anybody(monkeypatch, uid, held, limit):
    """As in a container; whoever has the capability has none."""
    monkeypatch.setattr(doctor.os, "geteuid", lambda: uid)
    monkeypatch.setattr(doctor.resource, "getrlimit", lambda _: (0, 0))
    monkeypatch.setattr(doctor, "has_capability", lambda number: number == held)
    assert PROBES["real time"].read() == limit


@pytest.mark.parametrize(
    ("is_there", "opens", "owner", "found"),
    [
        (True, True, 77, ("{}/gateway.sock", True, "")),
        (True, False, 77, ("{}", False, "robots")),
        (False, False, 77, ("{}", False, "robots")),
        (False, False, 0, ("{}", False, "")),
        (False, False, 1000, ("{}", False, "")),
    ],
)
def test_the_socket_of_a_service_is_good_for_whoever_may_open_it(monkeypatch, tmp_path, is_there, opens, owner, found):
    """Its folder is another user's: who may not open the socket is told of that user's group, and not led elsewhere."""
    path = tmp_path / "gateway.sock"
    monkeypatch.setenv("TA2_SOCKET", str(path))
    monkeypatch.setattr(Path, "is_socket", lambda at: at == path and is_there)
    monkeypatch.setattr(doctor.os, "access", lambda at, _: at == path and opens)
    monkeypatch.setattr(doctor.os, "getuid", lambda: 1000)
    of = SimpleNamespace(st_uid=owner, st_gid=7, st_mode=tmp_path.stat().st_mode)
    monkeypatch.setattr(Path, "stat", lambda at, **how: of if at == tmp_path else os.stat(at, **how))
    monkeypatch.setattr(Path, "group", lambda _: "robots")
    assert PROBES["socket"].read() == (found[0].format(tmp_path), *found[1:])


@pytest.mark.parametrize(
    ("build", "kind"),
    [
        ("#1 SMP PREEMPT_RT Debian 6.1.90-1", "PREEMPT_RT"),
        ("#1 SMP PREEMPT_DYNAMIC Debian", "PREEMPT_DYNAMIC"),
        ("#1 SMP PREEMPT RT", "PREEMPT"),
        ("#1 SMP Debian 5.10.1", "no PREEMPT"),
    ],
)
def test_a_kernel_says_whether_it_lets_itself_be_interrupted(monkeypatch, build, kind):
    """By its own text, which needs neither root nor /sys."""
    texts = {"/proc/sys/kernel/osrelease": "6.1.0\n", "/proc/sys/kernel/version": f"{build}\n"}
    monkeypatch.setattr(Path, "read_text", lambda path: texts[str(path)])
    assert PROBES["kernel"].read() == ("6.1.0", kind)


@pytest.mark.parametrize(
    ("ufw", "states", "found"),
    [
        ("ENABLED=no\n", "", "none"),
        ("ENABLED=yes\n", "", "ufw"),
        ("ENABLED=yes\n", "active\ninactive\nactive\n", "firewalld, netfilter-persistent, ufw"),
        (None, "inactive\nactive\ninactive\n", "nftables"),
        (None, "inactive\ninactive\nunknown\n", "none"),
        (None, "", None),
        (None, None, None),
        ("ENABLED=yes\n", None, "ufw"),
    ],
)
def test_firewalls_are_found_by_their_services_and_ufw_by_its_file(monkeypatch, ufw, states, found):
    """Whichever is there; where neither systemd nor ufw is, nobody knows."""

    def read(path):
        if ufw is None:
            raise FileNotFoundError(path)
        return ufw

    def run(*_, **__):
        if states is None:
            raise FileNotFoundError("systemctl")
        return SimpleNamespace(stdout=states)

    monkeypatch.setattr(Path, "read_text", read)
    monkeypatch.setattr(doctor.subprocess, "run", run)
    monkeypatch.setattr(doctor, "PROBES", {"firewall": PROBES["firewall"]})
    assert readings() == {"firewall": found}


def test_this_computer_can_be_asked(shell, monkeypatch):
    """Whatever it is, there is a row for everything, for people and for scripts; the status is that of its problems."""
    monkeypatch.setattr(doctor, "TICKS", 3)
    for options in ((), ("--json",)):
        ended = shell.run("doctor", *options)
        assert not ended.err and all(name in ended.out for name in PROBES)
        if options:
            rows = ended.json["rows"]
            assert [row["name"] for row in rows] == list(PROBES)
            assert ended.json["ok"] == (ended.status == 0) == all(row["verdict"] != "problem" for row in rows)


def test_a_problem_is_an_exit_status(shell, monkeypatch):
    """With what to type under it."""
    monkeypatch.setattr(doctor, "readings", lambda: {**GOOD, "socket": ("/", False, "")})
    ended = shell.run("doctor")
    assert ended.status == 1 and "problem  socket      /\n" in ended.out and "-> export TA2_SOCKET=" in ended.out
