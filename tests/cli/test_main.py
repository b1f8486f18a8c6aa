"""Tests of `ta2`: which arguments there are, who is called with what, how commands end. What they do: tests/cli."""

from __future__ import annotations

import fcntl
import io
import json
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from functools import partial
from pathlib import Path

import pytest

from gateway import __version__
from gateway.cli import main as cli
from gateway.cli.body.calibration_writing import write_arms
from gateway.cli.command_line import arguments
from gateway.cli.command_line.arguments import joints, parse
from gateway.cli.command_line.robot_arguments import endpoint
from gateway.kinematics.calibration import RobotIdentity
from gateway.kinematics.calibration_file.arm_section import ArmCalibration, fingerprint
from gateway.kinematics.correction import ArmCorrection
from gateway.kinematics.description import nominal
from gateway.robot.topics import VARIANTS
from gateway.settings.settings import Settings
from gateway.values import Side
from tests.cli.shell import Shell
from tests.e2e.system import ATTEMPTS, STALLED, free_port, run_apart
from tests.thoroughness import IS_THOROUGH

ROOT = Path(__file__).parents[2]
NOBODY = "tcp/127.0.0.1:19591"


@pytest.fixture
def shell(monkeypatch, capsys):
    """A shell whose commands find a scripted engine."""
    monkeypatch.setattr("gateway.process.blas_threads.one_blas_thread", lambda: None)  # for a process of its own
    return Shell(monkeypatch, capsys)


# ----------------------------------------------------------------------------------------------------------- arguments


@pytest.mark.parametrize("words", [[], *([name] for name in cli.COMMANDS), ["sim", "fault"], ["sim", "clear"]])
def test_every_command_has_help(shell, words):
    """`--help` of every command says what it does and ends with 0."""
    ended = shell.run(*words, "--help")
    assert ended.status == 0 and ended.out.startswith("usage: ta2") and len(ended.out) > 150


def test_the_help_tells_every_command_and_every_exit_status(shell):
    """`ta2 --help` lists all commands and what each exit status means."""
    text = shell.run("--help").out
    for name in cli.COMMANDS:
        assert f"\n    {name} " in text or f"\n    {name}\n" in text
    for status in (0, 1, 2, 3, 4, 5, 130):
        assert f"\n  {status} " in text
    assert "physical emergency stop" in text
    assert shell.run("--version").out == f"ta2 {__version__}\n"


@pytest.mark.parametrize(("words", "status"), [(["home"], 0), (["stop-endpoint"], 1)])
def test_a_closed_standard_input_is_nobody_to_ask(shell, monkeypatch, words, status):
    """`ta2 home <&-`: as in a script; a command that needs a person says so."""
    monkeypatch.setattr("sys.stdin", None)
    ended = shell.run(*words)
    sys.stdin.close()
    assert ended.status == status and "Traceback" not in ended.err


@pytest.mark.parametrize("closed", ["<&- >&- 2>&-", "2>&-", "<&-"])
def test_no_file_is_taken_for_a_standard_one_that_is_closed(tmp_path, closed):
    """`ta2 run 2>&-`: number 2 is nobody's, here and in the guard, never a lock or a pipe that is opened next."""
    report = tmp_path / "report.json"
    program = """
import json, os, subprocess, sys
from gateway.cli import main as cli

def look(options):
    first = os.open(sys.argv[1], os.O_RDWR | os.O_CREAT)
    files = {number: os.readlink(f"/proc/self/fd/{number}") for number in range(3)}
    streams = [stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr)]
    print("said", file=sys.stderr, flush=True)
    os.write(first, json.dumps([first, files, [os.get_inheritable(number) for number in range(3)], streams]).encode())
    return 0

cli.COMMANDS["status"] = look
sys.exit(cli.main(["status"]))
"""
    shell = ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-c", program, str(report)]
    assert subprocess.run(shell, stdin=subprocess.PIPE, capture_output=True, timeout=60, check=False).returncode == 0
    first, files, inheritable, streams = json.loads(report.read_text())
    assert first > 2 and inheritable == [True] * 3 and streams == [False] * 3
    numbers = {"<": "0", ">": "1", "2": "2"}
    assert all(files[numbers[one[0]]] == os.devnull for one in closed.split())


def test_a_terminal_without_the_letters_is_told_all_the_same(shell, monkeypatch):
    """What was done was done: no traceback for a reason, or a sign of ours, that the terminal's encoding does not have."""
    shell.run("stop", "K\xf6nnte")
    terminal = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr("sys.stdout", terminal)
    assert shell.run("recover").status == 0
    terminal.flush()
    assert b"K\\u00f6nnte" in terminal.buffer.getvalue()


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_json_is_json_on_a_terminal_without_the_letters(shell, monkeypatch, encoding):
    """Only what the encoding does not have is escaped, as JSON escapes it: two of them for what is beyond 16 bits."""
    said = 'K\xf6nnte "\u4e2d" \U0001f600 \udc80'
    print_it = partial(json.dumps, {"said": said}, ensure_ascii=False)
    monkeypatch.setitem(cli.COMMANDS, "recover", lambda options: print(print_it()) or 0)
    terminal = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr("sys.stdout", terminal)
    assert shell.run("recover").status == 0
    terminal.flush()
    text = terminal.buffer.getvalue().decode(encoding)
    assert json.loads(text)["said"] == said
    assert ("\xf6" in text) == (encoding != "ascii") and ("\u4e2d" in text) == (encoding == "utf-8")


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("192.168.1.20", "tcp/192.168.1.20:9000"),
        ("robot.local", "tcp/robot.local:9000"),
        ("192.168.1.20:9001", "tcp/192.168.1.20:9001"),
        ("tcp/192.168.1.20:9001", "tcp/192.168.1.20:9001"),
        ("::1", "tcp/[::1]:9000"),
        ("[fe80::1%eth0]", "tcp/[fe80::1%eth0]:9000"),
        ("[::1]:7000", "tcp/[::1]:7000"),
        ("tls/h:1", "tls/h:1"),
    ],
)
def test_a_robot_is_named_as_people_name_it(typed, meant):
    """A bare host gets protocol and port of the manual (§2.4); what is complete stays as it is."""
    assert endpoint(typed) == meant


def test_a_bare_number_names_no_robot(shell):
    """It is a port, or a slip; the forms are named."""
    ended = shell.run("sim", "--listen", "9001")
    assert ended.status == 2 and "'9001' names no host: tcp/HOST:PORT, HOST:PORT or HOST is needed" in ended.err


@pytest.mark.parametrize(
    "words", [["0.1", "-0.2", "3"], ["0.1,-0.2,3"], ["0.1,", "-0.2,", "3"], ["[0.1", "-0.2", "3]"], ["[0.1; -0.2; 3]"]]
)
def test_joints_may_be_pasted_in_any_notation(words):
    """Spaces, commas and brackets may stand between numbers, as arrays are printed."""
    assert joints(words) == (0.1, -0.2, 3.0)


def test_negative_numbers_are_numbers_in_every_notation():
    """`-1.5e-03` and `-1.`, as numpy prints them, and `-0.1,0.2` are no options."""
    options = parse(["move", "--left", "-1.5e-03", "-.5", "-2E+0", "0", "1e-3", "-0.25", "1", "--by"])
    assert options.left == (-0.0015, -0.5, -2.0, 0.0, 0.001, -0.25, 1.0)
    assert options.right is None and options.by
    options = parse(["move", "--right", "-0.1,-0.2,-3.", "[-4.", "-1e-2]", "-.6,", "7"])
    assert options.right == (-0.1, -0.2, -3.0, -4.0, -0.01, -0.6, 7.0)
    assert parse(["sim", "--seed", "-3"]).seed == -3
    assert parse(["sim", "--clock-offset-s", "-1.5e-2"]).clock_offset_s == -0.015


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["fly"],
        ["move"],
        ["move", "--left", "1", "2"],
        ["move", "--left", *"1234567", "8"],
        ["move", "--left", "one", *"234567"],
        ["home", "--speed", "0"],
        ["home", "--speed", "1.1"],
        ["home", "--speed", "nan"],
        ["home", "--tolerance", "-1"],
        ["status", "--timeout", "0"],
        ["status", "--timeout", "inf"],
        ["stat"],
        ["status", "--js"],
        ["config"],
        ["config", "--show", "--check", "x"],
        ["sim", "--model", "mini"],
        ["sim", "--clock-offset-s", "inf"],
        ["sim", "--clock-drift-ppm", "2000"],
        ["run", "--model", "mini"],
        ["sim", "fault"],
    ],
)
def test_what_makes_no_sense_is_a_usage_error(shell, words):
    """A wrong command line ends with 2 and a line that says how it goes; nothing was connected."""
    ended = shell.run(*words)
    assert ended.status == 2 and "usage: ta2" in ended.err and not ended.out
    assert shell.names == []


@pytest.mark.parametrize("words", [["home", "fast"], ["status", "--js"], ["move"], ["frames", "--live", "--left", "0"]])
def test_a_wrong_command_line_shows_the_usage_of_its_command(shell, words):
    """Not the list of all commands."""
    assert shell.run(*words).err.startswith(f"usage: ta2 {words[0]} ")


@pytest.mark.parametrize(
    "words",
    [
        ["record", "--out", "bag", "--task", "k\udcf6nnte"],
        ["dataset", "build", "bag", "--out", "set", "--task", "k\udcf6nnte"],
        ["episode", "start", "k\udcf6nnte"],
        ["episode", "start", "--task", "k\udcf6nnte"],
        ["policy", "run", "--server", "ws://h:1", "--prompt", "k\udcf6nnte"],
        ["teleop", "--task", "k\udcf6nnte"],
    ],
)
def test_words_that_are_no_utf8_are_a_usage_error(shell, monkeypatch, tmp_path, words):
    """Bytes that are none come as lone surrogates: nothing was begun, and no folder is left."""
    monkeypatch.chdir(tmp_path)
    ended = shell.run(*words)
    assert ended.status == 2 and "'k\\udcf6nnte' is no text in UTF-8" in ended.err and not list(tmp_path.iterdir())


def test_models_are_those_of_the_robot():
    """The names written out for the help text are the keys of the table."""
    assert tuple(VARIANTS) == arguments.MODELS


# ----------------------------------------------------------------------------------------------------------- processes


def test_run_hands_the_settings_to_the_daemon(shell, monkeypatch, tmp_path):
    """Options win over the file, the file over the defaults; the log is configured as asked."""
    file = tmp_path / "a.toml"
    file.write_text('[robot]\nendpoint = "tcp/10.0.0.1:9000"\nmodel = "lite"\n[arm]\nv_radps = 0.4\n')
    seen = {}
    monkeypatch.setattr("gateway.process.log.configure_log", lambda *, is_json: seen.update(is_json=is_json))
    monkeypatch.setattr(
        "gateway.process.daemon.run",
        lambda settings, _, *, is_json_log, notifier, read: (
            seen.update(settings=settings, is_guards_log_json=is_json_log, notifier=notifier, again=read()) or 0
        ),
    )
    assert shell.run("run", "--config", str(file), "--robot", "h", "--model", "lift", "--json-log").status == 0
    settings = seen["settings"]
    assert (settings.link.endpoint, settings.link.model, settings.arm.v_radps) == ("tcp/h:9000", "lift", 0.4)
    assert seen["is_json"] is seen["is_guards_log_json"] is True
    assert settings.guard.enabled and seen["notifier"] is None
    assert seen["again"] == settings, "read anew as at the start"
    assert shell.run("run", "--no-guard").status == 0 and not seen["settings"].guard.enabled
    assert shell.run("run", "--config", str(file), "--socket", "/tmp/x.sock").status == 0
    assert seen["settings"].link.endpoint == "tcp/10.0.0.1:9000" and seen["settings"].link.model == "lite"
    assert seen["settings"].local.socket == "/tmp/x.sock" and seen["is_json"] is False


@pytest.mark.parametrize("socket", ["/tmp/with space/gw.sock", ""])
def test_run_says_what_to_do_next(shell, monkeypatch, socket):
    """When clients can connect, the next commands stand there ready to be copied; the default socket needs no option."""
    from gateway.api.protocol import default_socket

    monkeypatch.setattr("gateway.process.log.configure_log", lambda **_: None)
    monkeypatch.setattr(
        "gateway.process.daemon.run", lambda _, on_ready, **__: on_ready(socket or str(default_socket())) or 0
    )
    text = shell.run("run").err
    option = " --socket '/tmp/with space/gw.sock'" if socket else ""
    for command in ("status", "watch", "home", "stop"):
        assert f"ta2 {command}{option}\n" in text
    assert "tcp/127.0.0.1:9000" in text
    assert shell.run("run", "--json-log").err == ""


def test_a_wrong_setting_is_one_line_and_status_2(shell, tmp_path):
    """BAD_CONFIG names file, key, value and bound, and what to do."""
    file = tmp_path / "a.toml"
    file.write_text("[arm]\nv_radps = 30\n")
    for words in (["run", "--config", str(file)], ["config", "--check", str(file)], ["config", "--show", str(file)]):
        ended = shell.run(*words)
        assert ended.status == 2 and ended.err.count("\n") == 1 and not ended.out
        assert ended.err.startswith("BAD_CONFIG: ") and "arm.v_radps" in ended.err and " -> " in ended.err
    assert shell.run("run", "--robot", "udp//x").status == 2


def test_config_shows_what_is_in_effect_and_checks_what_differs(shell, tmp_path):
    """`--show` prints a file that loads back; `--check` lists each changed key with its default."""
    shown = shell.run("config", "--show")
    file = tmp_path / "a.toml"
    file.write_text(shown.out)
    assert shown.status == 0 and "good, no settings differ" in shell.run("config", "--check", str(file)).out
    file.write_text("[arm]\nv_radps = 0.4\n[loss]\nkeepalive_ms = 200\n")
    checked = shell.run("config", "--check", str(file))
    assert checked.status == 0 and "2 settings differ" in checked.out
    assert f"arm.v_radps = 0.4 (default {Settings().arm.v_radps})" in checked.out
    assert "loss.keepalive_ms = 200 (default 250)" in checked.out
    assert "v_radps = 0.4" in shell.run("config", "--show", str(file)).out


def test_config_reads_the_files_of_the_body_model_as_the_daemon_would(shell, tmp_path, monkeypatch):
    """A calibration of this robot, one of another, a URDF that is none; nothing where there shall be no model."""
    arm = ArmCalibration(
        side=Side.LEFT,
        correction=ArmCorrection(offsets_rad=(0.01,) * 7),
        description=nominal().source,
        numbers=fingerprint(nominal(), Side.LEFT),
        note="for tests",
    )
    monkeypatch.setattr("gateway.process.log.configure_log", lambda **_: None)
    monkeypatch.setattr("gateway.process.daemon.share_reactor", lambda: None)  # for a process of its own
    asked: list[str] = []
    monkeypatch.setattr("gateway.process.blas_threads.one_blas_thread", lambda: asked.append("one thread"))
    own, file = tmp_path / "own.json", tmp_path / "a.toml"
    write_arms(own, RobotIdentity(serial="TA2-0042", model="standard"), [arm])

    def checked(model: str, serial: str = "TA2-0042"):
        file.write_text(f'[robot]\nserial = "{serial}"\n[model]\n{model}\n')
        return shell.run("config", "--check", str(file))

    good = checked(f'calibration = "{own}"')
    assert good.status == 0 and f"body model: {nominal().source}, corrected by {own}" in good.out
    other = checked(f'calibration = "{own}"', serial="TA2-0043")
    assert other.status == 2 and other.err.startswith("FOREIGN_CALIBRATION: ") and " -> " in other.err
    assert not asked and shell.run("run", "--config", str(file)).err == other.err, "nothing is opened with it"
    assert asked == ["one thread"]
    file.with_suffix(".urdf").write_text("<robot/>")
    bare = checked(f'urdf = "{file.with_suffix(".urdf")}"')
    assert bare.status == 2 and "lacks 18 of what is needed: joint 'armL1_joint' (or 'l_joint1')" in bare.err
    off = checked(f'check = false\ncalibration = "{own}"', serial="")
    assert off.status == 0 and "body model" not in off.out


def test_sim_is_built_as_asked(shell, monkeypatch):
    """Modes of one arm win over the mode of both; parts that are switched off are off."""
    seen = []
    monkeypatch.setattr("gateway.sim.starting.main_sim", lambda listen, settings: seen.append((listen, settings)) or 0)
    words = ["--mode", "pose", "--left-mode", "joint", "--model", "lift", "--seed", "3", "--disable", "chassis"]
    assert shell.run("sim", "--listen", "127.0.0.1:19592", *words).status == 0
    ((listen, settings),) = seen
    assert listen == "tcp/127.0.0.1:19592" and (settings.model, settings.seed) == ("lift", 3)
    assert (settings.left_mode, settings.right_mode) == ("joint", "pose")
    assert not settings.enable_chassis and settings.enable_left_arm and settings.enable_lift_servo


@pytest.mark.parametrize("fault", ["[1]", "nonsense", '{"do": "shutdown"}'])
def test_a_fault_that_is_none_is_refused_before_anything_is_asked(shell, fault):
    """Only an object can be a fault, and it cannot become another request."""
    ended = shell.run("sim", "fault", fault, "--at", NOBODY)
    assert ended.status == 1 and ended.err.startswith("BAD_REQUEST: ") and "ta2 sim faults" in ended.err


# ------------------------------------------------------------------------------------------------------- how they end


def test_no_gateway_is_status_3_and_says_what_to_start(capsys, tmp_path):
    """Every client command without a gateway: one line, status 3; a stop names the physical one instead."""
    shell_like = {"--at": str(tmp_path / "no.sock")}
    at = [word for pair in shell_like.items() for word in pair]
    for command in ("status", "topics", "watch", "enable", "home", "recover"):
        assert cli.main([command, *at]) == 3
        read = capsys.readouterr()
        assert read.err.startswith("DISCONNECTED: ") and "ta2 run" in read.err and read.err.count("\n") == 1
    for command in ("stop", "estop"):
        assert cli.main([command, *at, "--json"]) == 3
        read = capsys.readouterr()
        assert "physical emergency stop" in read.err
        assert json.loads(read.out)["error"]["code"] == "DISCONNECTED" and json.loads(read.out)["exit_status"] == 3


def test_a_target_that_is_none_is_a_usage_error(capsys):
    """What cannot be an address ends with 2."""
    assert cli.main(["status", "--at", "gateway.sock"]) == 2
    assert "unix:PATH" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "status"), [(KeyboardInterrupt(), 130), (cli.Interrupted(15), 143), (cli.Interrupted(1), 129)]
)
def test_interruptions_have_the_shells_numbers(monkeypatch, error, status):
    """128 + the number of the signal, as a shell has it."""

    def interrupted(_):
        raise error

    monkeypatch.setitem(cli.COMMANDS, "status", interrupted)
    assert cli.main(["status"]) == status


def test_sigterm_interrupts_a_client_command_and_is_given_back(monkeypatch):
    """While a client command runs SIGTERM is an exception in it; afterwards it is what it was."""
    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setitem(cli.COMMANDS, "status", lambda _: signal.raise_signal(signal.SIGTERM))
    assert cli.main(["status"]) == 143
    assert signal.getsignal(signal.SIGTERM) is before
    seen = []
    monkeypatch.setitem(cli.COMMANDS, "run", lambda _: seen.append(signal.getsignal(signal.SIGTERM)) or 0)
    assert cli.main(["run"]) == 0 and seen == [before]


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_whose_exception_python_drops_comes_again(monkeypatch, capsys, number, status):
    """In a finaliser nobody would hear of it, and the robot would go on moving."""

    class Finalised:
        def __del__(self):
            signal.raise_signal(number)

    def goes_on(_):
        for _ in range(3):  # dropped three times over
            Finalised()
        deadline = time.monotonic() + 20.0
        while time.monotonic() < deadline:
            time.sleep(5.0)
        return 0

    tell = sys.unraisablehook
    monkeypatch.setitem(cli.COMMANDS, "status", goes_on)
    begun = time.monotonic()
    assert cli.main(["status"]) == status
    assert time.monotonic() - begun < 5.0 and sys.unraisablehook is tell
    assert not capsys.readouterr().err


def test_a_reader_that_has_gone_ends_a_command_quietly():
    """`ta2 config --show | head -0`: no traceback, the status of SIGPIPE."""
    program = "import sys; from gateway.cli.main import main; sys.exit(main(['config', '--show']))"
    read, write = os.pipe()
    os.close(read)
    try:
        ended = subprocess.run(
            [sys.executable, "-u", "-c", program],
            cwd=ROOT,
            stdout=write,
            stderr=subprocess.PIPE,
            timeout=50,
            check=False,
        )
    finally:
        os.close(write)
    assert (ended.returncode, ended.stderr) == (141, b"")


# ------------------------------------------------------------------------------------------------------- what it loads


def _loaded(*words):
    """Return the modules that a command line loads in a fresh interpreter."""
    program = (
        "import sys\nfrom gateway.cli.main import main\n"
        f"try:\n    main({list(words)!r})\nexcept SystemExit:\n    pass\n"
        "print('\\n'.join(sys.modules), file=sys.stderr)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=50, check=True
    )
    return set(ended.stderr.split())


@pytest.mark.parametrize("words", [["--help"], ["stop", "--help"], ["move", "--left", "1"]])
def test_help_and_mistakes_load_nothing_but_the_standard_library(words):
    """A person who asks how it goes does not wait for libraries (realtime notes §11)."""
    heavy = {"zenoh", "msgspec", "numpy", "rich", "ruckig", "pycdr2", "gateway.client", "gateway.core", "asyncio"}
    assert not heavy & _loaded(*words)


def test_a_stop_loads_the_client_and_nothing_else(tmp_path):
    """Not even numpy: a stop must not wait for what it does not need."""
    loaded = _loaded("stop", "--at", str(tmp_path / "no.sock"))
    assert "gateway.client" in loaded
    heavy = {"numpy", "rich", "ruckig", "pycdr2", "pinocchio", "asyncio", "gateway.core", "gateway.settings.toml_file"}
    assert not heavy & loaded


def test_a_simulated_robot_loads_only_what_it_was_asked_for(tmp_path):
    """No camera, no physics, no film without a word about them; it ends before it listens."""
    loaded = _loaded("sim", "--record", str(tmp_path / "a.mp4"))
    assert "gateway.sim.node" in loaded
    assert not [name for name in loaded if name.startswith(("gateway.sim.camera", "gateway.sim.physics"))]


# ---------------------------------------------------------------------------------------------------- real processes


class Processes:
    """`ta2` as processes, with their output."""

    def __init__(self, folder):
        self._environment = {**os.environ, "TA2_STATE_DIR": str(folder / "state"), "PYTHONUNBUFFERED": "1"}
        self._environment.pop("TA2_SOCKET", None)
        self.socket = str(folder / "gw.sock")
        self._folder = folder
        self._running = []

    def start(self, *words):
        """Start a command that runs on; returns it and its log."""
        log = self._folder / f"{words[0]}{len(self._running)}.log"
        with log.open("w") as stream:
            process = subprocess.Popen(
                [sys.executable, "-m", "gateway.cli", *words],
                cwd=ROOT,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
            )
        self._running.append(process)
        return process, log

    def run(self, *words):
        """Run a client command to its end."""
        return subprocess.run(
            [sys.executable, "-m", "gateway.cli", *words, "--socket", self.socket],
            cwd=ROOT,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    def end(self):
        """End everything that still runs, in the order of stopping: clients, gateway, robot."""
        for process in reversed(self._running):
            if process.poll() is None:
                process.terminate()
                try:
                    process.wait(10.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()


@pytest.fixture
def processes(tmp_path):
    """Processes that are ended after the test."""
    made = Processes(tmp_path)
    yield made
    made.end()


def _until(condition, what, seconds=30.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.05)


def _is_stalled(said):
    return any(f"\n{code}: " in f"\n{said}" for code in STALLED)


def _homed(processes):
    """Run `ta2 home` to its end, once more where the machine stood still under it."""
    for _ in range(ATTEMPTS):
        home = processes.run("home", "--speed", "1", "--json")
        if home.returncode == 0 or not _is_stalled(home.stderr):
            break
    return home


def _holds_or_ended(process, log):
    return "Ctrl-C releases" in log.read_text() or process.poll() is not None


def _holder(processes):
    """Start `ta2 enable`, once more where the machine stood still under it; return it when it holds, and its log."""
    for _ in range(ATTEMPTS):
        holder, log = processes.start("enable", "--socket", processes.socket)
        _until(partial(_holds_or_ended, holder, log), "neither holds nor ends")
        if holder.poll() is None or not _is_stalled(log.read_text()):
            break
    assert "Ctrl-C releases" in log.read_text(), log.read_text()
    return holder, log


@pytest.mark.e2e
def test_the_commands_drive_a_robot(processes):
    """sim, run, status, home, topics, enable, stop and recover as a person types them, with real processes.

    Outside CI others run beside it. A machine that stands still for 80 ms is a frozen daemon to a guard, which ends it:
    there the daemon has none.
    """
    robot = f"tcp/127.0.0.1:{free_port()}"
    sim, _ = processes.start("sim", "--listen", robot)
    daemon, log = processes.start(
        "run", "--robot", robot, "--socket", processes.socket, *(() if IS_THOROUGH else ("--no-guard",))
    )
    _until(lambda: "ta2 watch --socket" in log.read_text(), f"the gateway does not say it is ready: {log.read_text()}")

    def is_ready():
        ended = processes.run("status", "--json")
        return ended.returncode == 0 and json.loads(ended.stdout)["snapshot"]["mode"] is not None

    _until(is_ready, "the gateway does not see the robot")
    run_apart(sim.pid)
    home = _homed(processes)
    assert home.returncode == 0, home.stderr + log.read_text()
    assert json.loads(home.stdout)["error_rad"] < 0.05 and "enable: READY" in home.stderr
    status = processes.run("status")
    assert status.returncode == 0 and "reached" in status.stdout and "READ_ONLY" in status.stdout
    assert processes.run("topics").stdout.count("running") == 0
    frame = processes.run("watch", "--once").stdout
    assert "LEFT ARM" in frame and "READ_ONLY" in frame and frame.count("\n") <= 24

    holder, holding = _holder(processes)
    refused = processes.run("home")
    assert refused.returncode == 1 and refused.stderr.splitlines()[-1].startswith("LEASE_HELD: ")
    holder.send_signal(signal.SIGINT)
    assert holder.wait(20.0) == 0 and holding.read_text().endswith("released\n")

    assert processes.run("stop", "lunch").returncode == 0
    latched = processes.run("home")
    assert latched.returncode == 1 and "LATCHED: " in latched.stderr and "`ta2 recover`" in latched.stderr
    assert "lunch" in processes.run("recover").stdout
    faults = subprocess.run(
        [sys.executable, "-m", "gateway.cli", "sim", "faults", "--at", robot],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert "router_stop" in json.loads(faults.stdout)["known"]
    for process in (daemon, sim):
        process.terminate()
        assert process.wait(10.0) == 0
    assert processes.run("status").returncode == 3


def test_a_namespace_may_be_left_out_or_empty_and_must_be_one():
    """None is what most robots have; a wildcard would command them all."""
    assert parse(["sim"]).namespace == "" and parse(["sim", "--namespace", "/bot1"]).namespace == "/bot1"
    assert parse(["run"]).namespace is None and parse(["run", "--namespace", ""]).namespace == ""
    for words in (["sim", "--namespace", "bot*"], ["run", "--namespace", "a//b"]):
        with pytest.raises(SystemExit):
            parse(words)


LAST_WORDS = """
import time
from gateway.cli import main
def work(options):
    try:
        print("ready", flush=True)
        time.sleep(60)
    finally:
        print("on the way out", flush=True)
main.COMMANDS = {"status": work}
raise SystemExit(main.main(["status"]))
"""


def test_what_is_said_to_a_terminal_that_is_gone_fails_nothing():
    """A recorder has something left to do after a hangup, and to say: its status is that of the hangup."""
    ours, theirs = pty.openpty()

    def take():
        os.setsid()
        fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

    command = [sys.executable, "-c", LAST_WORDS]
    process = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, preexec_fn=take, pass_fds=[theirs])
    os.close(theirs)
    said = b""
    while b"ready" not in said:
        said += os.read(ours, 1024)
    os.close(ours)
    assert process.wait(30) == 128 + signal.SIGHUP
