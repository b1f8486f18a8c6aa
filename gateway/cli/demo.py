"""`ta2 demo`: the whole path on one machine: a simulated robot, the daemon, and a client that moves both arms.

Starts `ta2 sim` and `ta2 run` as processes of their own, moves both arms to the initial position of manual §6.6 through
waypoints and back to where they hung, and tells what the robot saw: velocity and acceleration against the limits, final
error, rate and worst gap of the setpoint streams. Exit status 0 only when all of it is as it should be.

It commands the robot through the client library like any other program, and asks the simulated robot for its figures
through the control channel that no real robot has.
"""

from __future__ import annotations

import socket
import tempfile
import time
from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from gateway.cli.terminal.children import child, when_live
from gateway.cli.terminal.ending import ExitStatus
from gateway.client import Control, MotionHandle, Robot
from gateway.errors import Code, GatewayError, failure
from gateway.robot.limits import HOME_Q_RAD
from gateway.sim.remote import SimControl
from gateway.values import Side

if TYPE_CHECKING:
    from gateway.cli.demo_plot import Recording

__all__ = ["carry_out"]

FINAL_ERROR_RAD = 0.05
"""How near both arms must come to their goals [rad] (manual §6.6)."""
GRIPPER_WATCHDOG_S = 0.1
"""A longer gap in an arm's stream would cost the grip [s] (manual §4.4)."""
PAUSE_TIMEOUT_S = 3.0

Goal = dict[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One figure of the report.

    Attributes:
        name: What was measured.
        value: Figure with unit.
        bound: What it must keep; empty when it is only told.
        good: Whether it does.
    """

    name: str
    value: str
    bound: str
    good: bool = True


# ------------------------------------------------------------------------------------------------ processes


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


# ------------------------------------------------------------------------------------------------ the ten lines


def _waypoints(hung: Goal) -> list[tuple[str, Goal]]:
    """Return where to go: part of the way, the initial position of §6.6, a pose beside it, and back."""
    home = {side.value: np.array(HOME_Q_RAD[side]) for side in Side}
    part_way = {side: hung[side] + 0.5 * (home[side] - hung[side]) for side in hung}
    beside = {side: home[side] + 0.15 * np.sign(hung[side] - home[side]) for side in hung}
    return [
        ("half way", part_way),
        ("initial position (manual §6.6)", home),
        ("beside it", beside),
        ("initial position again", home),
        ("where they hung", hung),
    ]


def _follow(robot: Robot, move: MotionHandle, recording: Recording, progress: Progress, label: str) -> float:
    """Watch a motion to its end; return the error that was measured then [rad]."""
    task = progress.add_task(label, total=1.0)
    for state in robot.states(timeout=5.0):
        recording.add(state)
        error = move.error_rad
        text = f"{label}  error {error:.3f} rad" if error is not None else label
        progress.update(task, completed=move.progress, description=text)
        if move.done:
            break
    result = move.result(timeout=5.0)
    progress.update(task, completed=1.0)
    return float("inf") if result.error is None else result.error


def _perform(robot: Robot, own: Control, speed: float, recording: Recording, console: Console) -> float:
    """Move through all waypoints; return the last error [rad]."""
    state = robot.state
    hung: Goal = {"left": state.left_arm.q.copy(), "right": state.right_arm.q.copy()}
    columns = (TextColumn("  {task.description:<58}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    error = float("inf")
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        for label, goal in _waypoints(hung):
            move = own.move_to(goal, speed=speed)
            error = _follow(robot, move, recording, progress, label)
            if not console.is_terminal:
                console.print(f"  reached: {label}, error {error:.4f} rad")
    return error


# ------------------------------------------------------------------------------------------------ the report


def _findings(stats: Mapping[str, Any], robot: Robot, error_rad: float) -> list[Finding]:
    info = robot.info
    findings = [
        Finding(
            name="final error, worst joint",
            value=f"{error_rad:.4f} rad",
            bound=f"< {FINAL_ERROR_RAD} rad",
            good=error_rad < FINAL_ERROR_RAD,
        )
    ]
    for side, arm in stats["arms"].items():
        stream = stats["commands"][f"/api/{side}_arm/joint_cmd"]
        gap_ms = float(stream["worst_gap_alive_ms"])
        peaks = (
            ("velocity", "peak_radps", "rad/s", info.v_radps),
            ("acceleration", "peak_radps2", "rad/s²", info.a_radps2),
        )
        for name, key, unit, bound in peaks:
            peak = max(arm["commanded"][key])
            findings.append(
                Finding(
                    name=f"{side} arm, peak commanded {name}",
                    value=f"{peak:.3f} {unit}",
                    bound=f"<= {bound:g} {unit}",
                    good=peak <= bound * 1.001,
                )
            )
        findings += [
            Finding(name=f"{side} arm, setpoints at the robot", value=f"{stream['rate_hz']:.1f} Hz", bound=""),
            Finding(
                name=f"{side} arm, worst gap at the robot",
                value=f"{gap_ms:.1f} ms",
                bound=f"< {GRIPPER_WATCHDOG_S * 1e3:.0f} ms",
                good=gap_ms < GRIPPER_WATCHDOG_S * 1e3,
            ),
            Finding(
                name=f"{side} arm, targets the robot had to clip",
                value=str(arm["clips"]),
                bound="0",
                good=arm["clips"] == 0,
            ),
        ]
    return findings


def _show(findings: Sequence[Finding], console: Console) -> None:
    table = Table(title="what the robot saw", title_justify="left")
    for column in ("figure", "measured", "bound", ""):
        table.add_column(column, justify="left" if column in {"figure", ""} else "right")
    for finding in findings:
        mark = "[green]ok[/]" if finding.good else "[bold red]NOT GOOD[/]"
        table.add_row(finding.name, finding.value, finding.bound, mark if finding.bound else "")
    console.print(table)


def carry_out(options: Namespace) -> int:
    """Run the demo; return the exit status.

    Raises:
        GatewayError: BAD_REQUEST: the plot cannot be drawn, which is said before anything starts; or whatever the gateway
            refused.
    """
    plot = options.plot.absolute()
    recording = _recording(plot)
    from gateway.cli.demo_plot import write_plot

    console = Console()
    with tempfile.TemporaryDirectory(prefix="ta2-demo-") as folder:
        try:
            findings = _run(options.speed, options.seed, recording, Path(folder), console)
        except KeyboardInterrupt:
            console.print("interrupted: the daemon brakes the arms and pauses the robot")
            raise
    write_plot(recording, plot)
    console.print(f"plot of commanded and measured joints: {plot}", soft_wrap=True)
    _show(findings, console)
    is_good = all(finding.good for finding in findings)
    console.print("[bold green]all good[/]" if is_good else "[bold red]something is not as it should be[/]")
    return ExitStatus.OK if is_good else ExitStatus.REFUSED


def _recording(plot: Path) -> Recording:
    """Return an empty recording that can be drawn there."""
    try:
        from gateway.cli.demo_plot import Recording
    except ImportError:
        raise _no_plot("matplotlib is not installed", "pip install 'teleavatar-gateway[demo]'") from None
    try:
        plot.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=plot.parent).close()
    except OSError as error:
        raise _no_plot(f"{plot}: {error.strerror or error}", "name another place: --plot FILE") from None
    return Recording()


def _no_plot(message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_REQUEST, f"no plot: {message}", field="plot", hint=hint)


def _run(speed: float, seed: int, recording: Recording, folder: Path, console: Console) -> list[Finding]:
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    target = str(folder / "gateway.sock")
    sim = ["sim", "--listen", endpoint, "--seed", str(seed)]
    daemon = ["run", "--robot", endpoint, "--socket", target]
    console.print(f"simulated robot at {endpoint}, gateway at {target}", soft_wrap=True)
    with child("the simulated robot", sim, folder / "sim.log"):
        with child("the gateway", daemon, folder / "run.log"):
            with when_live(target, "demo", folder / "run.log") as robot:
                with robot.control() as own:
                    own.enable(timeout=12.0)
                    console.print(
                        f"enabled: FSM {robot.state.fsm_name}; both arms move at {speed:g} of the velocity limit"
                    )
                    error_rad = _perform(robot, own, speed, recording, console)
                    with SimControl(endpoint) as control:
                        stats = control.ask("stats")
                    findings = _findings(stats, robot, error_rad)
                findings.append(_paused(robot))
    return findings


def _paused(robot: Robot) -> Finding:
    """See that leaving the `with` block has paused the robot."""
    deadline = time.monotonic() + PAUSE_TIMEOUT_S
    for state in robot.states(timeout=PAUSE_TIMEOUT_S):
        if state.fsm == 0 or time.monotonic() > deadline:
            break
    return Finding(name="robot at the end", value=f"FSM {state.fsm_name}", bound="FSM PAUSE", good=state.fsm == 0)
