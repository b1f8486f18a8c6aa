"""`ta2 identify`: what this robot's arms differ in from the description, from measurements; it drives nothing.

One arm after the other: what was found, how sure, what was left before and after; or why nothing, and how to move. What is
found can be written to the calibration file of this very robot.
"""

from __future__ import annotations

import json
import math
import sys
from argparse import Namespace
from collections.abc import Iterator, Mapping
from pathlib import Path

from msgspec import to_builtins
from rich.console import Console
from rich.text import Text

from gateway.cli.body.calibration_writing import robot_to_write_for, write_arms
from gateway.cli.body.observer import Observer
from gateway.cli.body.pairs import keep, measured_live, read_pairs
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, failure
from gateway.kinematics.arm import ArmModel
from gateway.kinematics.calibration import RobotIdentity
from gateway.kinematics.calibration_file.arm_section import ArmCalibration, fingerprint
from gateway.kinematics.description import Description, nominal
from gateway.kinematics.identification.excitation import LEAST_GAIN, Excitation
from gateway.kinematics.identification.parameters import Group
from gateway.kinematics.identify import Estimate, Identification, Misfit, Unidentified, identify
from gateway.kinematics.urdf import from_urdf
from gateway.settings import toml_file
from gateway.values import Side

__all__ = ["carry_out", "document", "lines"]

Result = Identification | Unidentified


def carry_out(options: Namespace) -> ExitStatus:
    """Identify, print, and write what was found; REFUSED when an arm could not be identified.

    Raises:
        ConfigError: A file cannot be read or written, or nobody said whose calibration to write.
        Disconnected: No gateway answers.
        GatewayTimeout: It answers, and then tells nothing.
        Stale: There are no pairs at all.
    """
    if options.dynamics or options.excite is not None:
        return _of_dynamics(options)
    settings = toml_file.load(options.config)
    link, urdf = settings.link, options.urdf or settings.model.urdf
    serial = link.serial if options.serial is None else options.serial
    identity = RobotIdentity(serial=serial, model=link.model) if serial else None
    left_out = {Group.LAG, *((Group.EE,) if options.joints_only else ())}
    if not options.shoulder:
        left_out.add(Group.SHOULDER)
    groups = frozenset(Group) - left_out
    out = None if options.out is None else Path(options.out)
    description = from_urdf(Path(urdf).expanduser()) if urdf else nominal()
    owner = None if out is None else robot_to_write_for(out, identity)
    arms = {side: ArmModel(description, side) for side in Side}
    sides = None if options.arm is None else (Side(options.arm),)
    if options.file is not None:
        pairs = read_pairs(Path(options.file))
    else:
        observer = Observer(arms, sides or tuple(Side), groups)
        pairs = measured_live(options.target, options.timeout_s, options.seconds, observer)
        if options.keep is not None:
            keep(pairs, options.keep)
    asked = sides or tuple(side for side in Side if pairs[side])
    if not any(pairs[side] for side in asked):
        raise failure(
            Code.PART_STALE,
            "no pairs of joints and pose" + (f" of the {asked[0]} arm" if asked else ""),
            hint="does the gateway see the robot, and does the robot publish current_ee_pose? `ta2 topics` tells",
        )
    results = {side: identify(arms[side], pairs[side], groups) for side in asked}
    found = {side: result for side, result in results.items() if isinstance(result, Identification)}
    if options.json:
        print(json.dumps(document(results, description), ensure_ascii=False, indent=2))
    else:
        texts = (line for side, result in results.items() for line in lines(side, result))
        Console(highlight=False).print(*texts, sep="\n", soft_wrap=True)
    if out is not None and owner is not None and found:
        write_arms(out, owner, [_calibration(side, found[side], description) for side in found])
        print(f"{out}: {', '.join(found)} of robot {owner} written", file=sys.stderr)
    return ExitStatus.OK if len(found) == len(results) else ExitStatus.REFUSED


def _of_dynamics(options: Namespace) -> ExitStatus:
    try:
        from gateway.cli.body import dynamics
    except ImportError as error:
        hint = "install it: pip install 'teleavatar-gateway[body]'"
        raise failure(
            Code.BAD_CONFIG, f"dynamics need pinocchio, which is not installed ({error})", hint=hint
        ) from error
    return dynamics.carry_out(options)


def _calibration(side: Side, found: Identification, description: Description) -> ArmCalibration:
    angle, length = _worst(found.estimates, "rad"), _worst(found.estimates, "m")
    sure = f"±{1e3 * angle:.2g} mrad" + (f", ±{1e3 * length:.2g} mm" if length else "")
    return ArmCalibration(
        side=side,
        correction=found.correction,
        description=description.source,
        numbers=fingerprint(description, side),
        note=f"{found.postures} postures, {sure}; {_told(found.validated)} left on pairs not fitted",
    )


def _worst(estimates: tuple[Estimate, ...], unit: str) -> float:
    return max((row.sigma for row in estimates if row.unit == unit), default=0.0)


# ----------------------------------------------------------------------------------------------------------------- text


def lines(side: Side, result: Result) -> Iterator[Text]:
    """Yield what is to be said of an arm."""
    if isinstance(result, Unidentified):
        yield Text.assemble((f"{side} arm: not identified", "bold red"), f": {result.why.value}")
        yield Text(f"  {result.message}")
        yield Text(f"  -> {result.hint}", style="yellow")
        if result.before is not None:
            yield Text(f"  residual as described: {_told(result.before)} (median)", style="dim")
    else:
        yield Text.assemble(
            (f"{side} arm: identified", "bold green"),
            f" from {result.postures} postures, {result.share:.0%} with a say",
        )
        for row in result.estimates:
            unit = "mrad" if row.unit == "rad" else "mm"
            yield Text(f"  {row.name:<24} {1e3 * row.value:>+9.3f} ± {1e3 * row.sigma:.3f} {unit}")
        if result.lag_s:
            yield Text(f"  poses later than told    {1e3 * result.lag_s:>+9.1f} ms")
        yield Text(f"  residual as described    {_told(result.before)} (median)")
        yield Text(f"  residual corrected       {_told(result.after)}")
        yield Text(f"  ... on pairs not fitted  {_told(result.validated)}")
    if result.excitation is not None:
        yield from _seen(result.excitation)


def _seen(excitation: Excitation) -> Iterator[Text]:
    moved = ", ".join(f"{high - low:.2f}" for low, high in excitation.moved_rad)
    yield Text(f"  joints 1 to 7 moved through {moved} rad", style="dim")
    shown = " ".join(f"{value:.2g}" for value in excitation.singular_values)
    yield Text(f"  gains {shown} (the least must be {LEAST_GAIN:g})", style="dim")


def _told(misfit: Misfit) -> str:
    return f"{1e3 * misfit.position_m:.3f} mm, {1e3 * misfit.angle_rad:.3f} mrad"


# ----------------------------------------------------------------------------------------------------------------- JSON


def document(results: Mapping[Side, Result], description: Description) -> dict[str, object]:
    """Return everything for scripts; lengths in metres, angles in radians."""
    return {"description": description.source, "arms": {side.value: _row(result) for side, result in results.items()}}


def _row(result: Result) -> dict[str, object]:
    facts: dict[str, object] = {
        "identified": isinstance(result, Identification),
        "postures": result.postures,
        "before": None if result.before is None else to_builtins(result.before),
        "excitation": None if result.excitation is None else {**to_builtins(result.excitation), "least": LEAST_GAIN},
    }
    if isinstance(result, Unidentified):
        return {**facts, "why": result.why.name, "message": result.message, "hint": result.hint}
    correction = result.correction
    return {
        **facts,
        "parameters": [to_builtins(row) for row in result.estimates],
        "covariance": result.covariance,
        "after": to_builtins(result.after),
        "validated": to_builtins(result.validated),
        "share": result.share,
        "lag_s": result.lag_s,
        "joint_zero_offsets_rad": correction.offsets_rad,
        "joint_zero_offsets_deg": [math.degrees(offset) for offset in correction.offsets_rad],
        "nominal_ee_T_ee": {"p_m": correction.ee.p_m, "quat_xyzw": correction.ee.pose.quat_xyzw},
        "shoulder_T_nominal_shoulder": {
            "p_m": correction.shoulder.p_m,
            "quat_xyzw": correction.shoulder.pose.quat_xyzw,
        },
    }
