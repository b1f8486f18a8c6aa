"""Trajectories in files: what a recording may look like, and where in the file each of its points stands.

```
.npy   shape (N, 7) for one arm, (N, 14) for both, the left one first
.npz   `left` and `right`, shape (N, 7); `times` (N,) or `dt`; `space`: joint or pose
.json  an object with the same names, or the rows alone
.csv   rows of 7 or 14 numbers, or 8 or 15 with the time first; `#` begins a comment. Or a first line with names, in any
       order: `time`, `left_1` ... `left_7`, `right_1` ..., of poses `left_x` `left_y` `left_z` `left_qx` `left_qy`
       `left_qz` `left_qw`, `right_x` ...
```

Joints [rad] are in the order of manual §4.0.3; poses are x, y, z [m], qx, qy, qz, qw in the arm's shoulder frame. Times [s]
rise, and count from the first one; where there are none, whoever follows the points says how far apart they are. What the
numbers may be, the gateway judges. Files are read as data: nothing in them is executed.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

from gateway.api.protocol import ARM_DOF
from gateway.errors import Code, GatewayError, failure

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["KINDS", "Recording", "read"]

MAX_BYTES = 64 << 20
"""A larger file is no trajectory that anybody would follow in one go: hours at 50 Hz."""

SIDES = ("left", "right")
NAMES = (*SIDES, "times", "dt", "space")
"""What an object of points may hold."""
POSE_NAMES = ("x", "y", "z", "qx", "qy", "qz", "qw")
COLUMNS = {
    **{f"{side}_{n + 1}": (side, n, "joint") for side in SIDES for n in range(ARM_DOF)},
    **{f"{side}_{name}": (side, n, "pose") for side in SIDES for n, name in enumerate(POSE_NAMES)},
}
"""Names of columns: which arm, which of its numbers, and the space in which it is one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Points of a file, its form checked, its numbers not judged.

    Attributes:
        path: Of the file.
        points: Per side, shape (N, 7), N the same for both; the side is empty where the file does not name the arm.
        times_s: When each point is passed, shape (N,) [s]; None where the file has no times.
        dt_s: Time from point to point [s]; None where the file does not say it.
        space: `joint` or `pose`; empty where the file does not say it.
        lines: Line of each point in the file, from 1 on; empty where there are no lines.
    """

    path: Path
    points: Mapping[str, NDArray[np.float64]]
    times_s: NDArray[np.float64] | None = None
    dt_s: float | None = None
    space: str = ""
    lines: Sequence[int] = ()

    def __len__(self) -> int:
        return len(next(iter(self.points.values())))

    def place(self, index: int) -> str:
        """Return where a point stands in the file, in words."""
        return f"{self.path.name} line {self.lines[index]}" if self.lines else f"{self.path.name} row {index}"


def read(path: Path) -> Recording:
    """Read a trajectory from a file; its ending says what it is.

    Raises:
        Rejected: It cannot be read, or is none of the forms above: with line or row, and what is needed.
    """
    reader = KINDS.get(path.suffix.lower())
    if reader is None:
        raise _refused(
            path, f"ends with {path.suffix or 'nothing'!r}", f"give a file that ends with {', '.join(KINDS)}"
        )
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise _refused(path, f"has {size} bytes, {MAX_BYTES} are the most", "cut it into several files")
        recording = reader(path)
    except OSError as error:
        raise _refused(path, f"cannot be read: {error.strerror or error}", "give the path of a file") from None
    if not len(recording):
        raise _refused(path, "has no points", "at least two are needed")
    return recording


# ------------------------------------------------------------------------------------------------------------- arrays


def _read_numpy(path: Path) -> Recording:
    import numpy as np

    try:
        with path.open("rb") as file:
            loaded = np.load(file, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                return Recording(path=path, points=_rows(path, "", loaded))
            named = {name: loaded[name] for name in loaded.files}
    except (ValueError, EOFError, BadZipFile) as error:
        raise _refused(path, f"is no file of arrays: {error}", "write it with numpy.save or numpy.savez") from None
    return _named(path, {name: value.item() if value.ndim == 0 else value for name, value in named.items()})


def _read_json(path: Path) -> Recording:
    try:
        loaded = json.loads(path.read_bytes())
    except ValueError as error:  # no UTF-8 is one too
        raise _refused(path, f"is no JSON: {error}", "see `ta2 follow --help`") from None
    except RecursionError:
        raise _refused(path, "is no trajectory: it is nested too deep", "see `ta2 follow --help`") from None
    if isinstance(loaded, dict):
        return _named(path, loaded)
    return Recording(path=path, points=_rows(path, "", loaded))


def _named(path: Path, named: Mapping[str, Any]) -> Recording:
    """Return the points of an object with names."""
    unknown = [name for name in named if name not in NAMES]
    if unknown:
        raise _refused(path, f"has {', '.join(map(repr, unknown))}", f"the names are {', '.join(NAMES)}")
    points: dict[str, NDArray[np.float64]] = {}
    for side in SIDES:
        if side in named:
            points |= _rows(path, side, named[side])
    if not points:
        raise _refused(path, "names no arm", "give points as left, right, or both")
    counts = {side: len(rows) for side, rows in points.items()}
    if len(set(counts.values())) > 1:
        words = " and ".join(f"{count} points for the {side} arm" for side, count in counts.items())
        raise _refused(path, f"has {words}", "give both arms as many: they share one clock")
    times = None if named.get("times") is None else _numbers(path, "times", named["times"])
    if times is not None and times.shape != (next(iter(counts.values())),):
        message = f"has times of shape {times.shape} for {next(iter(counts.values()))} points"
        raise _refused(path, message, "give one time for each point")
    dt, space = named.get("dt"), named.get("space", "")
    if dt is not None and (isinstance(dt, bool) or not isinstance(dt, (int, float))):
        raise _refused(path, f"has dt = {dt!r}", "give the seconds from point to point")
    if dt is not None and times is not None:
        raise _refused(path, "has times and dt", "give one of the two")
    if space not in ("", "joint", "pose"):
        raise _refused(path, f"has space = {space!r}", "joint and pose exist")
    return Recording(path=path, points=points, times_s=times, dt_s=None if dt is None else float(dt), space=space)


def _rows(path: Path, side: str, given: object) -> dict[str, NDArray[np.float64]]:
    """Return rows as points: of a named arm, of one that is not named, or of both."""
    array = _numbers(path, side or "it", given)
    wanted = f"(N, {ARM_DOF})" if side else f"(N, {ARM_DOF}) for one arm or (N, {2 * ARM_DOF}) for both"
    if array.ndim == 2 and array.shape[1] == ARM_DOF:
        return {side: array}
    if array.ndim == 2 and array.shape[1] == 2 * ARM_DOF and not side:
        return {"left": array[:, :ARM_DOF], "right": array[:, ARM_DOF:]}
    what = f"{side!r} has" if side else "has"
    raise _refused(path, f"{what} shape {array.shape}", f"the shape {wanted} is needed")


def _numbers(path: Path, name: str, given: object) -> NDArray[np.float64]:
    import numpy as np

    try:
        array = np.asarray(given)
        if array.dtype.kind not in "iuf":
            raise ValueError(f"there is {array.dtype} in it")
        return array.astype(np.float64)
    except ValueError as error:
        raise _refused(path, f"{name} is no array of numbers: {error}", "every row has as many numbers") from None


# --------------------------------------------------------------------------------------------------------------- text


def _read_csv(path: Path) -> Recording:
    import numpy as np

    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise _refused(path, f"is no text: {error}", "write it as UTF-8") from None
    rows: list[tuple[int, list[str]]] = []
    try:
        for number, line in enumerate(text.splitlines(), 1):
            words = next(csv.reader([line.partition("#")[0]]), [])
            if any(word.strip() for word in words):
                rows.append((number, [word.strip() for word in words]))
    except csv.Error as error:
        raise _refused(path, f"line {number} is no row: {error}", "separate numbers by commas") from None
    if not rows:
        raise _refused(path, "has no points", "at least two are needed")
    header = None if _is_number(rows[0][1][0]) else [word.lower() for word in rows.pop(0)[1]]
    width = len(header) if header is not None else len(rows[0][1])
    values: list[list[float]] = []
    for number, words in rows:
        if len(words) != width:
            raise _refused(path, f"line {number} has {len(words)} numbers, the first has {width}", "mend that line")
        wrong = next((word for word in words if not _is_number(word)), None)
        if wrong is not None:
            raise _refused(path, f"line {number}: {wrong!r} is no number", "mend that line")
        values.append([float(word) for word in words])
    table = np.array(values, dtype=np.float64).reshape(len(values), width)
    lines = [number for number, _ in rows]
    if header is not None:
        return _columns(path, header, table, lines)
    has_times = width in (ARM_DOF + 1, 2 * ARM_DOF + 1)
    if not has_times and width not in (ARM_DOF, 2 * ARM_DOF):
        needed = f"{ARM_DOF} for one arm, {2 * ARM_DOF} for both, and the time before them if there is one"
        raise _refused(path, f"has {width} numbers a line", f"{needed}; or name the columns in the first line")
    points = _rows(path, "", table[:, 1:] if has_times else table)
    return Recording(path=path, points=points, times_s=table[:, 0] if has_times else None, lines=lines)


def _columns(path: Path, header: Sequence[str], table: NDArray[np.float64], lines: Sequence[int]) -> Recording:
    """Return the points of columns with names."""
    twice = sorted({name for name in header if header.count(name) > 1})
    unknown = [name for name in header if name not in COLUMNS and name != "time"]
    if twice or unknown:
        words = f"names {twice[0]} twice" if twice else f"has a column {unknown[0]!r}"
        raise _refused(path, words, "columns are time, left_1 to left_7, right_1 to right_7, or left_x, left_y ...")
    found = {COLUMNS[name][::2]: name for name in header if name != "time"}
    spaces = sorted({space for _, space in found})
    if len(spaces) != 1:
        raise _refused(path, "has " + ("joints and poses" if spaces else "no column of an arm"), "give one of the two")
    points: dict[str, NDArray[np.float64]] = {}
    for side in sorted({side for side, _ in found}):
        wanted = [name for name, (of, _, space) in COLUMNS.items() if of == side and space == spaces[0]]
        missing = [name for name in wanted if name not in header]
        if missing:
            raise _refused(path, f"has no column {missing[0]}", f"an arm has {', '.join(wanted)}")
        points[side] = table[:, [header.index(name) for name in wanted]]
    times = table[:, header.index("time")] if "time" in header else None
    return Recording(path=path, points=points, times_s=times, space=spaces[0], lines=lines)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _refused(path: Path, message: str, hint: str) -> GatewayError:
    return failure(Code.BAD_REQUEST, f"{path} {message}", field="file", hint=hint)


KINDS: Mapping[str, Callable[[Path], Recording]] = {
    ".npy": _read_numpy,
    ".npz": _read_numpy,
    ".csv": _read_csv,
    ".json": _read_json,
}
"""By the ending of a file, what reads it."""
