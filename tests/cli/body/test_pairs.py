"""Tests of the files of pairs: both kinds, and the line to blame."""

from __future__ import annotations

import json

import pytest

from gateway.cli.body.pairs import keep, read_pairs
from gateway.errors import Code, ConfigError
from gateway.values import Side
from tests.kinematics.identities import measured, postures

HEAD = "arm,stamp_ns,q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad,q7_rad,x_m,y_m,z_m,qx,qy,qz,qw"
LINE = "left,5,1,2,3,4,5,6,7,0.1,0.2,0.3,0,0,0,1"
ROW = {"arm": "left", "q_rad": [1, 2, 3, 4, 5, 6, 7], "p_m": [0.1, 0.2, 0.3], "quat_xyzw": [0, 0, 0, 1]}


def file_of(folder, text, suffix):
    """Write a file and return its path."""
    path = folder / f"pairs{suffix}"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_is_kept_is_read_again(tmp_path):
    """Both arms, in order: joints and positions to the last digit, quaternions to their rounding."""
    pairs = {side: measured(side, postures(side, 20)) for side in Side}
    keep(pairs, tmp_path / "pairs.jsonl")
    found = read_pairs(tmp_path / "pairs.jsonl")
    for side in Side:
        for one, other in zip(found[side], pairs[side], strict=True):
            assert (one.stamp_ns, one.q_rad, one.pose.p_m) == (other.stamp_ns, other.q_rad, other.pose.p_m)
            assert one.pose.quat_xyzw == pytest.approx(other.pose.quat_xyzw, abs=1e-15)


def test_both_kinds_say_the_same(tmp_path):
    """Other columns and keys are skipped, empty lines too; a stamp may be missing."""
    by_csv = read_pairs(file_of(tmp_path, f"{HEAD},note\n{LINE},x\n", ".csv"))
    by_json = read_pairs(file_of(tmp_path, "\n" + json.dumps({**ROW, "stamp_ns": 5, "note": "x"}) + "\n", ".jsonl"))
    assert by_csv == by_json and len(by_csv[Side.LEFT]) == 1 and by_csv[Side.RIGHT] == []
    assert by_csv[Side.LEFT][0].q_rad == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
    without = read_pairs(file_of(tmp_path, json.dumps(ROW), ".jsonl"))
    assert without[Side.LEFT][0].stamp_ns == 0


@pytest.mark.parametrize(
    ("suffix", "text", "said"),
    [
        (".txt", "", ".jsonl or .csv"),
        (".jsonl", json.dumps(ROW) + "\n{", "line 2"),
        (".jsonl", "[1]", "line 1: is no object"),
        (".jsonl", json.dumps({**ROW, "arm": "head"}), "arm is 'head': there are left, right"),
        (".jsonl", json.dumps({**ROW, "q_rad": [1, 2]}), "q_rad has 2 values, 7 are needed"),
        (".jsonl", json.dumps({**ROW, "p_m": ["1", 2, 3]}), "are not numbers"),
        (".jsonl", json.dumps({**ROW, "quat_xyzw": [0, 0, 0, 2]}), "line 1"),
        (".jsonl", json.dumps({**ROW, "q_rad": [1e999] * 7}), "a finite number is needed"),
        (".jsonl", json.dumps({key: ROW[key] for key in ("arm", "p_m", "quat_xyzw")}), "'q_rad' is missing"),
        (".csv", f"{HEAD}\n{LINE}\n{LINE[:-1]}one\n", "line 3"),
        (".csv", f"{HEAD}\n{LINE[:-4]}\n", "line 2"),
        (".csv", HEAD.replace("q7_rad,", "") + "\n", "columns q7_rad are missing"),
        (".csv", "", "are missing"),
    ],
)
def test_a_line_that_is_none_is_named(tmp_path, suffix, text, said):
    """File, line, and what is wrong with it."""
    with pytest.raises(ConfigError) as caught:
        read_pairs(file_of(tmp_path, text, suffix))
    assert caught.value.code is Code.BAD_CONFIG and said in str(caught.value) and f"pairs{suffix}" in str(caught.value)
    assert caught.value.hint


def test_a_file_that_is_not_there_is_one_line(tmp_path):
    """Neither for reading nor for writing."""
    with pytest.raises(ConfigError, match="No such file"):
        read_pairs(tmp_path / "none.csv")
    with pytest.raises(ConfigError, match="No such file"):
        keep({side: [] for side in Side}, tmp_path / "none" / "pairs.jsonl")
