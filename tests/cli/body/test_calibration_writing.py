"""Tests of writing into a calibration file: only this robot's, the rest kept, whole or not at all."""

from __future__ import annotations

import json

import pytest

from gateway.cli.body.calibration_writing import robot_to_write_for, write_arms
from gateway.errors import Code, ConfigError
from gateway.kinematics.calibration import load
from gateway.values import Side
from tests.changed import replace
from tests.kinematics.calibration_file.test_arm_section import entry
from tests.kinematics.calibrations import OTHER_ROBOT, ROBOT, document, written


def test_a_new_file_says_whose_it_is(tmp_path):
    """Robot and conventions stand beside the arms, and it can be loaded on that robot."""
    path = tmp_path / "new.json"
    assert robot_to_write_for(path, ROBOT) == ROBOT
    write_arms(path, ROBOT, [entry(Side.LEFT), entry(Side.RIGHT)])
    found = load(path, ROBOT)
    assert set(found.arms) == set(Side) and found.robot == ROBOT and not found.cameras
    assert [left.name for left in tmp_path.iterdir()] == ["new.json"]


def test_what_is_there_is_kept(tmp_path):
    """Cameras, transforms, the other arm, and the file's own conventions; the same arm is replaced."""
    content = document()
    path = written(tmp_path, content)
    write_arms(path, ROBOT, [entry(Side.LEFT)])
    write_arms(path, ROBOT, [entry(Side.RIGHT)])
    write_arms(path, ROBOT, [entry(Side.LEFT)])
    now = json.loads(path.read_text())
    assert {key: now[key] for key in content} == content
    found = load(path, ROBOT)
    assert set(found.arms) == set(Side) and set(found.cameras) == {"head", "left_wrist"}


@pytest.mark.parametrize(
    ("name", "robot", "code"),
    [
        ("calibration.json", OTHER_ROBOT, Code.FOREIGN_CALIBRATION),
        ("calibration.json", None, Code.BAD_CONFIG),
        ("new.json", None, Code.BAD_CONFIG),
        ("new.toml", ROBOT, Code.BAD_CONFIG),
        ("none/new.json", ROBOT, Code.BAD_CONFIG),
        ("broken.json", ROBOT, Code.BAD_CONFIG),
    ],
)
def test_it_is_known_beforehand_that_it_cannot_be_written(tmp_path, name, robot, code):
    """Before anybody moves an arm for a minute: another robot's file, nobody's, no JSON, no folder, a broken one."""
    written(tmp_path, document())
    written(tmp_path, "{", "broken.json")
    with pytest.raises(ConfigError) as caught:
        robot_to_write_for(tmp_path / name, robot)
    assert caught.value.code is code and caught.value.hint


def test_what_cannot_be_written_leaves_the_old_file(tmp_path):
    """A value that the reader would refuse, or a folder that takes no file: the file is what it was, and no draft is left."""
    path = written(tmp_path, document())
    before = path.read_text()
    absurd = replace(entry(), correction=replace(entry().correction, offsets_rad=(1.0,) * 7))
    with pytest.raises(ConfigError):
        write_arms(path, ROBOT, [absurd])
    assert path.read_text() == before and len(list(tmp_path.iterdir())) == 1
    with pytest.raises(ConfigError, match="No such file"):
        write_arms(tmp_path / "none" / "new.json", ROBOT, [entry()])
