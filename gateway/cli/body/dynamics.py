"""`ta2 identify --dynamics`: friction, scale of the efforts and masses of this robot's arms, from motion; it drives nothing.

`--excite FILE` writes a motion that tells them well, for `ta2 follow`; the rest looks on while it is followed, or reads what
was kept: JSON lines `{"arm": "left", "stamp_ns": 1234, "q_rad": [7 numbers], "dq_radps": [...], "tau_nm": [...]}`.
"""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gateway.cli.body.calibration_writing import robot_to_write_for, write_dynamics
from gateway.cli.terminal.connection import connected
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Code, failure
from gateway.kinematics.calibration import RobotIdentity
from gateway.kinematics.calibration_file.arm_section import fingerprint
from gateway.kinematics.calibration_file.dynamics_section import DynamicsCalibration
from gateway.kinematics.capsules import hull
from gateway.kinematics.collision import CollisionModel
from gateway.kinematics.configured import configured
from gateway.kinematics.description import Description
from gateway.kinematics.dynamics.arm_dynamics import ArmDynamics
from gateway.kinematics.dynamics.excitation import DT_S, excite
from gateway.kinematics.dynamics.identification import Found, Motion, TooLittle, identify_dynamics
from gateway.kinematics.dynamics.parameters import DriveParameters
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings import toml_file
from gateway.settings.settings import Settings
from gateway.values import Side

__all__ = ["carry_out"]

CLEAR_M = 0.05
"""What an exciting motion leaves free between any parts of the body [m]: radii of the hull are mostly guesses."""
TOLD = {"scale": "", "coulomb_nm": "N·m", "viscous_nmsprad": "N·m·s/rad", "armature_kgm2": "kg·m²"}
NUMBERS = ("q_rad", "dq_radps", "tau_nm")

Rows = dict[Side, list[dict[str, Any]]]


def carry_out(options: Namespace) -> ExitStatus:
    """Write a motion, or identify, print, and write what was found; REFUSED when an arm could not be identified.

    Raises:
        ConfigError: A file cannot be read or written, or nobody said whose calibration to write.
        Disconnected: No gateway answers.
    """
    settings = toml_file.load(options.config)
    description, sides = configured(settings), (Side(options.arm),) if options.arm else tuple(Side)
    if options.excite is not None:
        return _write_motion(options.excite, description, settings, sides[0])
    serial = settings.link.serial if options.serial is None else options.serial
    identity = RobotIdentity(serial=serial, model=settings.link.model) if serial else None
    out = None if options.out is None else Path(options.out)
    owner = None if out is None else robot_to_write_for(out, identity)
    rows = _read(Path(options.file)) if options.file is not None else _live(options, sides)
    if options.keep is not None:
        lines = (json.dumps({"arm": side.value, **row}) for side in rows for row in rows[side])
        options.keep.write_text("\n".join(lines) + "\n", encoding="utf-8")
    source = str(out or "identified")
    results = {side: identify_dynamics(description, side, _motion(rows[side]), source) for side in sides}
    found = {side: result for side, result in results.items() if isinstance(result, Found)}
    if options.json:
        print(json.dumps({side.value: _row(result) for side, result in results.items()}, ensure_ascii=False, indent=2))
    else:
        print(*(line for side, result in results.items() for line in _lines(side, result)), sep="\n")
    if out is not None and owner is not None and found:
        write_dynamics(out, owner, [_calibration(side, one, description) for side, one in found.items()])
        print(f"{out}: dynamics of {', '.join(found)} of robot {owner} written", file=sys.stderr)
    return ExitStatus.OK if len(found) == len(results) else ExitStatus.REFUSED


def _write_motion(path: Path, description: Description, settings: Settings, side: Side) -> ExitStatus:
    arm, body = ArmDynamics(description, side, DriveParameters()), CollisionModel(description, hull())
    home = {one: HOME_Q_RAD[one] for one in Side}
    found = excite(
        np.array(settings.arm.lower_rad[side]),
        np.array(settings.arm.upper_rad[side]),
        settings.arm.v_radps,
        settings.arm.a_radps2,
        arm.torques,
        lambda q: body.posture({**home, side: tuple(q.tolist())}).nearest().gap_m >= CLEAR_M,
    )
    if found is None:
        print(
            "every motion that was drawn comes too near the body: widen the position limits of [arm]", file=sys.stderr
        )
        return ExitStatus.REFUSED
    times = DT_S * np.arange(len(found.q_rad))
    arrays: dict[str, Any] = {side.value: found.q_rad, "times": times}
    np.savez(path, **arrays)
    print(
        f"{path}: {times[-1]:.0f} s of the {side} arm, condition number {found.condition:.1f}; the other arm at home (§6.6)"
    )
    return ExitStatus.OK


def _live(options: Namespace, sides: tuple[Side, ...]) -> Rows:
    rows: Rows = {side: [] for side in Side}
    with connected("identify", options.target, options.timeout_s) as robot:
        begun_ns = None
        try:
            for state in robot.states(timeout=options.timeout_s):
                begun_ns = state.view.at_ns if begun_ns is None else begun_ns
                for side in sides:
                    measured = state.view.arms[side.value].measured
                    if measured is not None and measured.dq_radps and measured.tau_nm:
                        row = {
                            "stamp_ns": measured.stamp_ns,
                            **{name: list(getattr(measured, name)) for name in NUMBERS},
                        }
                        if not rows[side] or rows[side][-1]["stamp_ns"] != row["stamp_ns"]:
                            rows[side].append(row)
                if (state.view.at_ns - begun_ns) / 1e9 >= options.seconds:
                    break
        except KeyboardInterrupt:  # early, with what there is
            pass
    return rows


def _read(path: Path) -> Rows:
    rows: Rows = {side: [] for side in Side}
    number = 0
    try:
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):  # noqa: B007  for the error
            row = json.loads(line)
            whole = {name: [float(value) for value in row[name]] for name in NUMBERS}
            if any(len(values) != 7 or not np.isfinite(values).all() for values in whole.values()):
                raise ValueError("seven finite numbers each are needed")
            rows[Side(row["arm"])].append({"stamp_ns": int(row["stamp_ns"]), **whole})
    except OSError as error:
        raise failure(Code.BAD_CONFIG, f"{path}: {error.strerror or error}", hint="name a file that is there") from None
    except (ValueError, KeyError, TypeError) as error:
        hint = "`ta2 identify --dynamics --live --keep FILE` writes one"
        raise failure(Code.BAD_CONFIG, f"{path}, line {number}: {error!r}", hint=hint) from None
    return rows


def _motion(rows: list[dict[str, Any]]) -> Motion:
    at_s = (np.array([row["stamp_ns"] for row in rows], dtype=np.float64) - (rows[0]["stamp_ns"] if rows else 0)) / 1e9
    q, dq, tau = (np.array([row[name] for row in rows], dtype=np.float64).reshape(-1, 7) for name in NUMBERS)
    return Motion(at_s=at_s, q_rad=q, dq_radps=dq, tau_nm=tau)


def _calibration(side: Side, found: Found, description: Description) -> DynamicsCalibration:
    return DynamicsCalibration(
        side=side,
        drives=found.drives,
        description=description.source,
        numbers=fingerprint(description, side),
        note=f"{_percent(found):.1f} % of the range of effort left on motion not fitted, condition {found.condition.max():.1f}",
    )


def _percent(found: Found) -> float:
    return float(100.0 * (found.after_nm / found.range_nm).max())


def _lines(side: Side, result: Found | TooLittle) -> Iterator[str]:
    if isinstance(result, TooLittle):
        yield f"{side} arm: not identified: {result.message}\n  -> {result.hint}"
        return
    yield f"{side} arm: identified; {_percent(result):.1f} % of the range of effort left on motion not fitted"
    for name, unit in TOLD.items():
        pairs = zip(getattr(result.drives, name), result.sd[name], strict=True)
        yield f"  {name:<16} " + "  ".join(f"{value:.3f}±{sd:.3f}" for value, sd in pairs) + f" {unit}"
    masses = zip(result.drives.heavier, result.sd["heavier"], strict=True)
    yield "  heavier by       " + "  ".join(f"{link[0]:+.3f}±{sd[0]:.3f}" for link, sd in masses) + " kg"
    for what, numbers in (("left as described", result.before_nm), ("left now", result.after_nm)):
        yield f"  {what:<17}" + "  ".join(f"{value:<11.3f}" for value in numbers) + " N·m"
    yield f"  condition numbers {' '.join(f'{value:.1f}' for value in result.condition)}"


def _row(result: Found | TooLittle) -> Mapping[str, object]:
    if isinstance(result, TooLittle):
        return {"identified": False, "message": result.message, "hint": result.hint, "condition": result.condition}
    drives = {name: list(getattr(result.drives, name)) for name in (*TOLD, "heavier")}
    left = {name: getattr(result, name).tolist() for name in ("condition", "before_nm", "after_nm", "range_nm")}
    return {"identified": True, **drives, "sd": {name: sd.tolist() for name, sd in result.sd.items()}, **left}
