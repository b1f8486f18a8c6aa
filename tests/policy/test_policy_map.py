"""Tests of what policies are shown and say: the presets, and what a file may not be."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.errors import Code, Rejected
from gateway.policy.policy_map import PRESETS, load_map
from gateway.robot.vector_layout import EYES, STATE_NAMES

HEAD, LEFT, RIGHT = (f"observation/images/{key}" for key in ("head_camera", "left_color", "right_color"))


def test_presets_are_the_vendors_layout_with_either_eyes() -> None:
    """48 dims, three views, 16 numbers in a row; the wrists' inner eyes, or the left ones."""
    inner, left = (load_map(name) for name in PRESETS[:2])
    for found in (inner, left):
        assert found.observation.names == STATE_NAMES[:48] and found.observation.resize == 0
        assert (found.observation.state_key, found.observation.prompt_key) == ("observation/state", "prompt")
        assert found.actions.key == "actions" and found.actions.width == 16
        assert found.observation.images[HEAD] == "head_left_eye"
    assert inner.observation.images[LEFT] == "left_wrist_right_eye"
    assert inner.observation.images[RIGHT] == left.observation.images[RIGHT] == "right_wrist_left_eye"
    assert left.observation.images[LEFT] == "left_wrist_left_eye"
    assert load_map("left_eyes", 224).observation.resize == 224


def test_lerobots_preset_has_the_layout_of_our_data_sets() -> None:
    """72 dims both ways; of the action's the arms are played, and the grippers' efforts, which are dims 39 and 47."""
    found = load_map("lerobot")
    assert found.observation.names == STATE_NAMES and found.actions.width == len(STATE_NAMES)
    places = {column: STATE_NAMES[place][0] for column, place in found.actions.places}
    assert places == {
        "left_arm": "left_joint1_position",
        "right_arm": "right_joint1_position",
        "left_gripper_effort": "left_gripper_effort",
        "right_gripper_effort": "right_gripper_effort",
    }
    assert set(found.observation.images) == {f"observation.images.{key}" for key in EYES["vendor_openpi"]}


def test_a_file_may_name_dims_and_leave_out_the_rest(tmp_path: Path) -> None:
    """No pictures, dims by name in an order of their own, one arm."""
    file = tmp_path / "map.toml"
    file.write_text(
        '[observation]\nstate = ["right_joint1_position", "kinco_velocity"]\n[actions]\ncolumns = ["right_arm"]\n'
    )
    found = load_map(str(file))
    assert found.observation.names == ("right_joint1_position", "kinco_velocity")
    assert not found.observation.images and found.actions.width == 7


def test_a_map_may_drive_and_the_presets_do_not(tmp_path: Path) -> None:
    """Chassis and lift only where a file says so."""
    file = tmp_path / "map.toml"
    file.write_text('[observation]\n[actions]\ncolumns = ["left_arm", "chassis_velocity", "lift_velocity"]\n')
    assert load_map(str(file)).actions.width == 7 + 3 + 1
    assert not any({"chassis_velocity", "lift_velocity"} & set(load_map(name).actions.columns) for name in PRESETS)


GOOD = '[actions]\ncolumns = ["left_arm"]\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[observation", "at the end of a table declaration"),
        ("[observation]\n", "missing required field `actions`"),
        ("[observation]\nstat = 48\n" + GOOD, "unknown field `stat`"),
        ("[observation]\nstate = 50\n" + GOOD, "state = 50; one of (48, 62, 72)"),
        ('[observation]\nstate = ["left_joint8_position"]\n' + GOOD, "'left_joint8_position' is no dim"),
        ("[observation]\nresize = 3\n" + GOOD, "resize = 3; 0, or 16 to 2048"),
        ('[observation.images]\na = "head"\n' + GOOD, "'head' is no view of head_right_eye"),
        ('[observation]\n[actions]\ncolumns = ["arm"]\n', "'arm' is none of left_arm"),
        ('[observation]\n[actions]\ncolumns = ["left_gripper_effort"]\n', "an arm is needed"),
        (
            '[observation]\n[actions]\ncolumns = ["left_arm", "left_gripper_effort", "left_gripper_command"]\n',
            "each part once",
        ),
        (GOOD, "missing required field `observation`"),
    ],
)
def test_what_a_map_may_not_be_is_named(tmp_path: Path, text: str, words: str) -> None:
    """As an error of the command line, with the file."""
    file = tmp_path / "map.toml"
    file.write_text(text)
    with pytest.raises(Rejected) as caught:
        load_map(str(file))
    assert caught.value.code is Code.BAD_REQUEST and caught.value.field == "file"
    assert words in caught.value.message and str(file) in caught.value.message


def test_a_file_that_is_not_there_is_refused_with_the_presets() -> None:
    """So that a person sees what there is."""
    with pytest.raises(Rejected, match="No such file") as caught:
        load_map("nowhere.toml")
    assert "vendor_openpi, left_eyes" in caught.value.hint
