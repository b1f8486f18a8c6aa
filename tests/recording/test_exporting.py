"""Tests of tables of a bag: names of columns, values, and what makes no table."""

from __future__ import annotations

import csv
import math

import pytest

from cdr_types import encode
from cdr_types.messages.std_msgs import String
from gateway.errors import Rejected
from gateway.recording import exporting
from gateway.recording.bag_reader import Bag
from gateway.recording.bag_writer import BagWriter
from gateway.recording.exporting import export
from gateway.recording.topics import EPISODES
from gateway.robot.topics import arm_state, ee_pose
from gateway.values import Side
from tests.recording.bags import ARM, BEGIN_NS, TOPICS, WORDS, joints, said, written

LEFT = arm_state(Side.LEFT)


def bag_of(folder, *messages):
    """Return an open bag of messages, a number of a topic and bytes each, a nanosecond apart."""
    bag = BagWriter(folder, TOPICS)
    for n, (number, data) in enumerate(messages):
        bag.add(number, BEGIN_NS + n, BEGIN_NS + n, data)
    bag.finish()
    return Bag(folder)


def rows(path):
    """Return the rows of a table, as text."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def test_a_row_for_each_message_and_a_column_for_each_value(tmp_path):
    """Arrival and stamp first, then the fields by name and number; the numbers come back as they were."""
    shares = []
    with Bag(written(tmp_path / "bag", 1.0)) as bag:
        tables = export(bag, tmp_path / "out", on_progress=lambda share, name: shares.append(share))
        assert {table.topic: table.rows for table in tables} == {t.name: t.count for t in bag.topics if t.count}
    head, first, *_ = rows(tmp_path / "out" / "left_arm.joint_states.csv")
    assert head[:4] == ["log_ns", "stamp_ns", "header_frame_id", "position_0"] and head[-1] == "effort_6"
    assert first[:4] == [str(BEGIN_NS), str(BEGIN_NS - 1_000_000), "", "0.5"]
    head, first, *_ = rows(tmp_path / "out" / "left_arm.current_ee_pose.csv")
    assert head[2:6] == ["position_x", "position_y", "position_z", "orientation_x"] and first[1] == ""
    assert shares[0] == 0.0 and shares[-1] == 1.0


def test_parquet_holds_the_same(tmp_path):
    """With types; a missing stamp is null; a table larger than one group of rows is whole."""
    parquet = pytest.importorskip("pyarrow.parquet")
    folder = written(tmp_path / "bag", 1.0, words=(said("start", 1, 0.5, task="é"),))
    with pytest.MonkeyPatch.context() as patch, Bag(folder) as bag:
        patch.setattr(exporting, "ROWS_AT_ONCE", 64)
        export(bag, tmp_path / "out", "parquet", [LEFT, ee_pose(Side.LEFT), EPISODES])
    table = parquet.read_table(tmp_path / "out" / "left_arm.joint_states.parquet")
    assert table.num_rows == 200 and str(table.schema.field("position_0").type) == "double"
    assert table["log_ns"][199].as_py() - table["stamp_ns"][199].as_py() == 1_000_000
    poses = parquet.read_table(tmp_path / "out" / "left_arm.current_ee_pose.parquet")
    assert poses["stamp_ns"].null_count == poses.num_rows
    assert '"task":"é"' in parquet.read_table(tmp_path / "out" / "ta2.episodes.parquet")["data"][0].as_py()


def test_messages_of_different_width_share_one_table(tmp_path):
    """What one has not is empty; NaN stays NaN; malformed ones are left out and counted."""
    wide, narrow = joints(1, width=3, value=math.nan), joints(1, width=1)
    with bag_of(tmp_path / "bag", (ARM, narrow), (ARM, b"\x00\x01"), (ARM, wide)) as bag:
        (table,) = export(bag, tmp_path / "out")
    head, first, second = rows(table.file)
    assert (table.rows, table.columns, table.malformed) == (2, len(head), 1)
    assert first[head.index("position_1")] == "" and second[head.index("position_2")] == "nan"


def test_text_with_commas_and_lines_is_quoted(tmp_path):
    """As any reader of CSV wants it."""
    with bag_of(tmp_path / "bag", (WORDS, encode(String(data='a "b", c\nd')))) as bag:
        (table,) = export(bag, tmp_path / "out")
    assert rows(table.file)[1] == [str(BEGIN_NS), "", 'a "b", c\nd']


def test_what_is_too_wide_makes_no_table(tmp_path, monkeypatch):
    """A picture has millions of values; the other topics are written, and it says why."""
    monkeypatch.setattr(exporting, "MOST_COLUMNS", 10)
    with bag_of(tmp_path / "bag", (ARM, joints(1)), (WORDS, encode(String(data="x")))) as bag:
        left_out, table = export(bag, tmp_path / "out")
    assert left_out.file is None and "more than 10 values" in left_out.why and table.file.exists()


@pytest.mark.parametrize(
    ("value", "kind"), [(True, "bool"), (1, "int64"), (2**63, "uint64"), (0.5, "double"), ("a", "string")]
)
def test_each_value_has_its_type(value, kind):
    """Numbers beyond 63 bits, too."""
    assert exporting._kind_of(value) == kind


def test_what_cannot_be_exported_is_refused(tmp_path, monkeypatch):
    """An unknown topic, a folder that holds something, one that cannot be made, Parquet without its package."""
    (tmp_path / "file").touch()
    with bag_of(tmp_path / "bag", (ARM, joints(1))) as bag:
        for out, only, why in (
            ("out", ["/nobody"], "has no message of /nobody"),
            ("bag", None, "is not empty"),
            ("file/out", None, "cannot be written: Not a directory"),
        ):
            with pytest.raises(Rejected, match=why):
                export(bag, tmp_path / out, "csv", only)
        monkeypatch.setitem(__import__("sys").modules, "pyarrow.parquet", None)
        with pytest.raises(Rejected, match=r"takes pyarrow, which is not installed.*teleavatar-gateway\[dataset\]"):
            export(bag, tmp_path / "out", "parquet")
    assert not (tmp_path / "out").exists()
