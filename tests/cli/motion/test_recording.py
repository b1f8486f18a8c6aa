"""Tests of trajectories in files: each documented form is read, whatever is none is refused with its place and a remedy."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gateway.cli.motion.recording import MAX_BYTES, read
from gateway.errors import Code, Rejected

LEFT = np.arange(21.0).reshape(3, 7)
RIGHT = -LEFT
BOTH = np.hstack([LEFT, RIGHT])
TIMES = np.array([0.0, 0.1, 0.3])
NAMES = [f"{side}_{n}" for side in ("left", "right") for n in range(1, 8)]
POSE_NAMES = [f"right_{name}" for name in ("x", "y", "z", "qx", "qy", "qz", "qw")]


def written(path, what):
    """Write what a test says into a file of the path's kind."""
    if path.suffix == ".npy":
        np.save(path, what)
    elif path.suffix == ".npz":
        np.savez(path, **what)
    elif path.suffix == ".json":
        path.write_text(json.dumps(what, default=lambda array: array.tolist()))
    else:
        path.write_text(what)
    return path


def lines(*rows):
    """Rows of numbers as CSV."""
    return "".join(",".join(map(str, row)) + "\n" for row in rows)


@pytest.mark.parametrize(
    ("name", "what", "sides", "times", "space"),
    [
        ("a.npy", LEFT, [""], None, ""),
        ("a.npy", BOTH.astype(np.float32), ["left", "right"], None, ""),
        ("a.npz", {"left": LEFT}, ["left"], None, ""),
        ("a.npz", {"right": RIGHT, "left": LEFT, "times": TIMES, "space": "pose"}, ["left", "right"], TIMES, "pose"),
        ("a.json", BOTH, ["left", "right"], None, ""),
        ("a.json", {"right": RIGHT, "times": TIMES, "space": "joint"}, ["right"], TIMES, "joint"),
        ("a.csv", lines(*LEFT), [""], None, ""),
        ("a.csv", lines(*BOTH), ["left", "right"], None, ""),
        ("a.CSV", lines(*np.column_stack([TIMES, LEFT])), [""], TIMES, ""),
        ("a.csv", lines(*np.column_stack([TIMES, BOTH])), ["left", "right"], TIMES, ""),
        ("a.csv", lines(["time", *NAMES], *np.column_stack([TIMES, BOTH])), ["left", "right"], TIMES, "joint"),
        ("a.csv", lines(POSE_NAMES, *RIGHT), ["right"], None, "pose"),
    ],
    ids=str,
)
def test_every_documented_form_is_read(tmp_path, name, what, sides, times, space):
    """One arm or both, named or not, with times or without."""
    recording = read(written(tmp_path / name, what))
    assert list(recording.points) == sides and len(recording) == 3 and recording.space == space
    assert (recording.times_s is None) if times is None else np.array_equal(recording.times_s, times)
    for side in sides:
        assert np.allclose(recording.points[side], RIGHT if side == "right" else LEFT)


def test_a_distance_in_time_may_stand_in_the_file(tmp_path):
    """As a number of an archive or an object."""
    assert read(written(tmp_path / "a.npz", {"left": LEFT, "dt": np.float32(0.5)})).dt_s == 0.5
    assert read(written(tmp_path / "a.json", {"left": LEFT, "dt": 1})).dt_s == 1.0


def test_named_columns_stand_in_any_order_between_comments_and_empty_lines(tmp_path):
    """A point is found by its line; the byte order mark of a spreadsheet is none of the names."""
    order = [*reversed(NAMES), "time"]
    text = "\ufeff# made by hand\n" + lines(order) + "\n" + lines(*np.column_stack([BOTH[:, ::-1], TIMES]))
    recording = read(written(tmp_path / "a.csv", text.replace("0.3\n", "0.3  # the last\n")))
    assert np.allclose(recording.points["left"], LEFT) and np.allclose(recording.times_s, TIMES)
    assert recording.place(0) == "a.csv line 4" and recording.place(2) == "a.csv line 6"


def test_a_row_is_found_by_its_number_where_there_are_no_lines(tmp_path):
    """From 0 on, as numpy counts."""
    assert read(written(tmp_path / "a.npy", LEFT)).place(2) == "a.npy row 2"


def test_numbers_are_not_judged_here(tmp_path):
    """What is not finite is refused by the gateway, as a point of the trajectory."""
    assert np.isnan(read(written(tmp_path / "a.csv", lines([*LEFT[0][:6], "nan"]))).points[""][0][6])


ROWS = lines(*LEFT)


@pytest.mark.parametrize(
    ("name", "what", "said"),
    [
        ("a.txt", ROWS, "ends with '.txt'"),
        ("a.npy", np.zeros((3, 6)), "has shape (3, 6)"),
        ("a.npy", np.zeros(7), "has shape (7,)"),
        ("a.npy", np.array([["a"] * 7]), "is no array of numbers"),
        ("a.npy", np.array([[True] * 7]), "is no array of numbers"),
        ("a.npy", np.array([[{}] * 7], dtype=object), "is no file of arrays"),
        ("a.npy", np.zeros((0, 7)), "has no points"),
        ("a.npz", {"left": LEFT, "q": LEFT}, "has 'q'"),
        ("a.npz", {"times": TIMES}, "names no arm"),
        ("a.npz", {"left": BOTH}, "'left' has shape (3, 14)"),
        ("a.npz", {"left": LEFT, "right": RIGHT[:2]}, "3 points for the left arm and 2 points for the right arm"),
        ("a.npz", {"left": LEFT, "times": TIMES[:2]}, "times of shape (2,) for 3 points"),
        ("a.npz", {"left": LEFT, "times": TIMES, "dt": 0.1}, "has times and dt"),
        ("a.npz", {"left": LEFT, "dt": TIMES}, "has dt = "),
        ("a.json", {"left": LEFT, "dt": True}, "has dt = True"),
        ("a.json", {"left": LEFT, "space": "cartesian"}, "has space = 'cartesian'"),
        ("a.json", {"left": [[0.0] * 7, [0.0] * 6]}, "left is no array of numbers"),
        ("a.json", "left", "is no array of numbers"),
        ("a.json", [[None] * 7], "is no array of numbers"),
        ("a.csv", "", "has no points"),
        ("a.csv", "# nothing\n", "has no points"),
        ("a.csv", lines(POSE_NAMES), "has no points"),
        ("a.csv", ROWS + "1,2,3\n", "line 4 has 3 numbers, the first has 7"),
        ("a.csv", ROWS.replace("8.0", "eight"), "line 2: 'eight' is no number"),
        ("a.csv", lines([0.0] * 9), "has 9 numbers a line"),
        ("a.csv", lines(["when", *NAMES[:7]], [0.0] * 8), "has a column 'when'"),
        ("a.csv", lines([*NAMES[:7], NAMES[0]], [0.0] * 8), "names left_1 twice"),
        ("a.csv", lines(NAMES[:6], [0.0] * 6), "has no column left_7"),
        ("a.csv", lines([*NAMES[:7], *POSE_NAMES], [0.0] * 14), "has joints and poses"),
        ("a.csv", lines(["time"], [0.0]), "has no column of an arm"),
        ("a.csv", '"' + "x" * 200_000, "is no row"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)
def test_what_is_no_trajectory_is_refused_with_its_place_and_a_remedy(tmp_path, name, what, said):
    """The file is named; the command line is to blame, not the robot."""
    with pytest.raises(Rejected) as caught:
        read(written(tmp_path / name, what))
    error = caught.value
    assert said in error.message and str(tmp_path / name) in error.message
    assert error.code is Code.BAD_REQUEST and error.refusal.field == "file" and error.hint


@pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.json", "a.csv"])
@pytest.mark.parametrize("content", [b"\x93NUMPY\x01\x00", b"PK\x03\x04", b"\xff\xfe\x00", b"[" * 100_000])
def test_what_is_no_file_of_its_kind_is_refused(tmp_path, name, content):
    """Cut off, of another kind, not text, nested without end: never an exception of a library."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(Rejected, match=name):
        read(tmp_path / name)


def test_what_cannot_be_opened_or_is_far_too_large_is_refused(tmp_path):
    """Nothing of it is read."""
    with pytest.raises(Rejected, match="cannot be read: No such file"):
        read(tmp_path / "none.csv")
    (tmp_path / "dir.csv").mkdir()
    with pytest.raises(Rejected, match="cannot be read"):
        read(tmp_path / "dir.csv")
    with (tmp_path / "large.npy").open("wb") as large:
        large.truncate(MAX_BYTES + 1)
    with pytest.raises(Rejected, match="are the most"):
        read(tmp_path / "large.npy")
