"""Pairs of joints and end-effector poses: from a file, into a file, or live from the gateway.

JSON lines, one object each; what else is in it is skipped, and `stamp_ns` may be missing:

    {"arm": "left", "stamp_ns": 1234, "q_rad": [7 numbers], "p_m": [x, y, z], "quat_xyzw": [x, y, z, w]}

CSV, with a line of names; other columns are skipped:

    arm,stamp_ns,q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad,q7_rad,x_m,y_m,z_m,qx,qy,qz,qw

Joints are those of manual §4.0.3, poses those of `*_ee` in `*_shoulder_base`; rows of an arm are in the order of time.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gateway.cli.terminal.connection import connected
from gateway.errors import Code, GatewayError, failure
from gateway.kinematics.identification.pairing import Pair, Pairing
from gateway.values import ARM_DOF, EePose, Side, ValueRefused

__all__ = ["Pairs", "keep", "measured_live", "read_pairs"]

Pairs = Mapping[Side, Sequence[Pair]]
"""Per arm, in the order of time."""

JOINT_COLUMNS = tuple(f"q{number}_rad" for number in range(1, ARM_DOF + 1))
POSITION_COLUMNS = ("x_m", "y_m", "z_m")
QUATERNION_COLUMNS = ("qx", "qy", "qz", "qw")
COLUMNS = ("arm", *JOINT_COLUMNS, *POSITION_COLUMNS, *QUATERNION_COLUMNS)
"""Those that a CSV file must have."""

SUFFIXES = (".jsonl", ".csv")

S = 1_000_000_000


def read_pairs(path: Path) -> Pairs:
    """Return the pairs of a file.

    Args:
        path: `.jsonl` or `.csv`.

    Raises:
        ConfigError: BAD_CONFIG, it cannot be read, or a line is none; the message names the line.
    """
    if path.suffix not in SUFFIXES:
        raise _refused(f"{path}: pairs are in a {' or '.join(SUFFIXES)} file")
    found: dict[Side, list[Pair]] = {side: [] for side in Side}
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = _json_rows(file) if path.suffix == ".jsonl" else _csv_rows(file)
            for number, read in rows:
                try:
                    side, pair = read()
                except (ValueRefused, ValueError, KeyError, TypeError) as error:
                    what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
                    raise _refused(f"{path}, line {number}: {what}") from None
                found[side].append(pair)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        message = error.strerror or str(error) if isinstance(error, OSError) else str(error)
        raise _refused(f"{path}: {message}") from None
    return found


def keep(pairs: Pairs, path: Path) -> None:
    """Write pairs as JSON lines.

    Raises:
        ConfigError: BAD_CONFIG, it cannot be written.
    """
    rows = (
        {
            "arm": side.value,
            "stamp_ns": pair.stamp_ns,
            "q_rad": pair.q_rad,
            "p_m": pair.pose.p_m,
            "quat_xyzw": pair.pose.quat_xyzw,
        }
        for side, some in pairs.items()
        for pair in some
    )
    try:
        path.write_text("".join(json.dumps(row) + "\n" for row in rows), encoding="utf-8")
    except OSError as error:
        raise _refused(f"{path}: {error.strerror or error}") from None


def measured_live(
    target: str | None, timeout_s: float, seconds: float, on_second: Callable[[Pairs, float, float], bool]
) -> Pairs:
    """Return the pairs that the gateway sees, until there is enough. Nothing is owned and nothing is moved.

    Joints and pose are paired by when they arrived at the gateway: the pose has no stamp (manual §4.8). Ctrl-C ends it
    early, with what there is.

    Args:
        target: Where the gateway is; None finds its socket.
        timeout_s: Longest wait for it [s].
        seconds: For how long at most [s].
        on_second: Called every second with what there is, how many seconds have passed and how many are left; returns
            whether there is enough.

    Raises:
        Disconnected: No gateway answers.
        GatewayTimeout: It answers, and then tells nothing.
    """
    pairings = {side: Pairing() for side in Side}
    found: dict[Side, list[Pair]] = {side: [] for side in Side}
    begun_ns: int | None = None
    told = 0
    with connected("identify", target, timeout_s) as robot:
        try:
            for state in robot.states(timeout=timeout_s):
                view = state.view
                begun_ns = view.at_ns if begun_ns is None else begun_ns
                for side in Side:
                    arm = view.arms[side.value]
                    if arm.measured is None or arm.pose_age_ns is None:
                        continue
                    pose = EePose(p_m=arm.p_m, quat_xyzw=arm.quat_xyzw)
                    found[side] += pairings[side].joints(arm.measured.q_rad, view.at_ns - arm.measured.age_ns)
                    found[side] += pairings[side].pose(pose, view.at_ns - arm.pose_age_ns)
                passed_s = (view.at_ns - begun_ns) / S
                if passed_s >= seconds:
                    break
                if int(passed_s) > told:
                    told = int(passed_s)
                    if on_second(found, passed_s, seconds - passed_s):
                        break
        except KeyboardInterrupt:
            pass
    return found


def _json_rows(file: Any) -> Iterator[tuple[int, Callable[[], tuple[Side, Pair]]]]:  # noqa: ANN401  an open file
    for number, line in enumerate(file, start=1):
        if line.strip():
            yield number, partial(_of_json, line)


def _csv_rows(file: Any) -> Iterator[tuple[int, Callable[[], tuple[Side, Pair]]]]:  # noqa: ANN401  an open file
    rows = csv.DictReader(file)
    missing = [name for name in COLUMNS if name not in (rows.fieldnames or ())]
    if missing:
        raise csv.Error(f"columns {', '.join(missing)} are missing; {', '.join(COLUMNS)} are needed")
    for row in rows:
        yield rows.line_num, partial(_of_csv, row)


def _of_json(line: str) -> tuple[Side, Pair]:
    return _pair(json.loads(line))


def _of_csv(row: Mapping[str, str]) -> tuple[Side, Pair]:
    table = {
        "arm": row["arm"],
        "stamp_ns": int(row.get("stamp_ns") or 0),
        "q_rad": [float(row[name]) for name in JOINT_COLUMNS],
        "p_m": [float(row[name]) for name in POSITION_COLUMNS],
        "quat_xyzw": [float(row[name]) for name in QUATERNION_COLUMNS],
    }
    return _pair(table)


def _pair(row: object) -> tuple[Side, Pair]:
    if not isinstance(row, dict):
        raise ValueRefused("is no object with names")
    if row["arm"] not in {side.value for side in Side}:
        raise ValueRefused(f"arm is {row['arm']!r}: there are {', '.join(Side)}")
    pose = EePose(p_m=_numbers(row["p_m"]), quat_xyzw=_numbers(row["quat_xyzw"]))
    pair = Pair(stamp_ns=int(row.get("stamp_ns", 0)), q_rad=_numbers(row["q_rad"]), pose=pose)
    return Side(row["arm"]), pair


def _numbers(values: object) -> tuple[float, ...]:
    if not isinstance(values, list) or any(isinstance(value, (bool, str)) for value in values):
        raise ValueRefused(f"{values!r:.60} are not numbers")
    return tuple(float(value) for value in values)


def _refused(message: str) -> GatewayError:
    return failure(Code.BAD_CONFIG, message, hint="the form of both kinds of file is in docs/how-to/body-model.md")
