"""Tests of calibration files: whose they are, what must be in them, what the numbers become."""

from __future__ import annotations

import json

import numpy as np
import pytest
from msgspec.structs import asdict

from gateway.errors import Code, ConfigError
from gateway.kinematics.calibration import Calibration, RobotIdentity, load, read
from gateway.kinematics.frames import Origin
from gateway.kinematics.transform import Transform
from tests.kinematics.calibrations import CENTER_T_LEFT, OTHER_ROBOT, PAIR, ROBOT, WRIST, document, row, written

A3 = {
    "parent_frame": "virtual_base",
    "child_frame": "left_base_virtual",
    "source": "mechanical_design",
    "device_specific": False,
    "matrix": [[1, 0, 0, -105.61], [0, 1, 0, 220.0], [0, 0, 1, -193.11], [0, 0, 0, 1]],
}


def test_a_robots_own_file_is_read_by_its_conventions(tmp_path):
    """Millimetres become metres, each transform knows its source and that it is this robot's (A.4)."""
    found = load(written(tmp_path, document()), ROBOT)
    edges = {edge.transform.name: edge for edge in found.edges}
    np.testing.assert_allclose(edges[CENTER_T_LEFT.name].transform.matrix, CENTER_T_LEFT.matrix, atol=1e-12)
    np.testing.assert_allclose(edges[WRIST.name].transform.matrix, WRIST.matrix, atol=1e-12)
    assert edges[CENTER_T_LEFT.name].origin is Origin.STEREO_CALIBRATION
    assert edges[WRIST.name].origin is Origin.ARM_CAMERA_CALIBRATION
    assert all(edge.is_of_one_robot for edge in found.edges)
    assert set(found.cameras) == {"head", "left_wrist"}
    other_eye = edges["left_wrist_camera_T_left_wrist_right_camera"].transform
    np.testing.assert_allclose(other_eye.p_m, (0.05, 0, 0), atol=1e-12)


@pytest.mark.parametrize(
    "robot", [OTHER_ROBOT, RobotIdentity(serial="TA2-0042", model="lite"), RobotIdentity(serial="", model="lift"), None]
)
def test_another_robots_file_is_refused_loudly(tmp_path, robot):
    """FOREIGN_CALIBRATION names both robots; a gateway that does not know which robot it has is no exception (A.4, A.6)."""
    with pytest.raises(ConfigError) as caught:
        load(written(tmp_path, document()), robot)
    assert caught.value.code is Code.FOREIGN_CALIBRATION
    assert "TA2-0042 (lift)" in str(caught.value) and "calibration.json" in str(caught.value)
    assert ("nobody said" if robot is None else str(robot)) in str(caught.value)
    assert caught.value.hint and caught.value.field == "robot.serial"
    assert read(written(tmp_path, document())).robot == ROBOT, "it can still be looked at"


def test_the_serial_number_is_compared_as_people_write_it(tmp_path):
    """Case and outer spaces do not make it another robot."""
    assert load(written(tmp_path, document()), RobotIdentity(serial=" ta2-0042 ", model="lift")).cameras


def test_a_file_must_say_whose_it_is(tmp_path):
    """What belongs to one robot, without its name, is refused even for looking; so is half a name."""
    content = document()
    del content["robot"]
    for kept in ("transforms", "cameras"):
        part = {name: content[name] for name in ("conventions", kept)}
        with pytest.raises(ConfigError, match="section 'robot'"):
            read(written(tmp_path, part))
    for robot in ({}, {"serial": "x"}, {"serial": "", "model": "lift"}, {"serial": 3, "model": "lift"}, "TA2-0042"):
        with pytest.raises(ConfigError, match="robot"):
            read(written(tmp_path, {**content, "robot": robot}))


def test_a_file_of_nominal_transforms_is_nobodys(tmp_path):
    """A.3: the same for all robots of a model, so it needs no name and is loaded for any robot, or for none."""
    content = {"conventions": document()["conventions"], "transforms": {"virtual_base_T_left_base_virtual": A3}}
    path = written(tmp_path, content)
    for robot in (None, ROBOT, OTHER_ROBOT):
        found = load(path, robot)
        assert found.robot is None and not found.edges[0].is_of_one_robot
        np.testing.assert_allclose(found.edges[0].transform.p_m, (-0.10561, 0.22, -0.19311))


def test_toml_is_as_good_as_json(tmp_path):
    """The same file in the other notation; strings of JSON are strings of TOML."""
    content = document()
    lines = []
    for section in ("robot", "conventions"):
        lines += [f"[{section}]", *(f"{key} = {json.dumps(value)}" for key, value in content[section].items())]
    for section in ("transforms", "cameras"):
        for name, table in content[section].items():
            lines += [f"[{section}.{name}]", *(f"{key} = {json.dumps(value)}" for key, value in table.items())]
    found = load(written(tmp_path, "\n".join(lines), "calibration.toml"), ROBOT)
    expected = load(written(tmp_path, content), ROBOT)
    assert [edge.transform.name for edge in found.edges] == [edge.transform.name for edge in expected.edges]
    for mine, other in zip(found.edges, expected.edges, strict=True):
        np.testing.assert_array_equal(mine.transform.matrix, other.transform.matrix)


def test_another_files_conventions_give_the_same_transform(tmp_path):
    """Metres, columns and quaternions wxyz, as that file says, are the same place."""
    content = document()
    said = {
        **content["conventions"],
        "translation_unit": "m",
        "matrix_layout": "column_major",
        "quaternion_order": "wxyz",
    }
    entry = row(WRIST)
    columns = {**entry, "matrix": WRIST.matrix.T.ravel().tolist()}
    x, y, z, w = WRIST.quat_xyzw.tolist()
    parts = {**entry, "translation": WRIST.p_m.tolist(), "quaternion": [w, x, y, z]}
    del parts["matrix"]
    for entry in (columns, parts):
        one = {"robot": content["robot"], "conventions": said, "transforms": {WRIST.name: entry}}
        np.testing.assert_allclose(
            load(written(tmp_path, one), ROBOT).edges[0].transform.matrix, WRIST.matrix, atol=1e-12
        )


def test_few_digits_are_mended_and_told(tmp_path):
    """Four digits, as the manual prints, make the nearest rotation and a note; two are refused."""
    content = document()
    entry = content["transforms"][WRIST.name]
    for digits, is_good in ((4, True), (2, False)):
        entry["matrix"] = np.round(np.array(row(WRIST)["matrix"]), digits).tolist()
        path = written(tmp_path, content)
        if is_good:
            (edge,) = [edge for edge in load(path, ROBOT).edges if edge.transform.name == WRIST.name]
            assert "made orthonormal" in edge.note and edge.transform.angle_to_rad(WRIST) < 2e-4
        else:
            with pytest.raises(ConfigError, match="from orthonormal"):
                load(path, ROBOT)


def changed_transform(**change):
    """Return a change of the wrist's entry; None takes a key away."""

    def apply(content):
        entry = {**content["transforms"][WRIST.name], **change}
        content["transforms"][WRIST.name] = {key: value for key, value in entry.items() if value is not None}

    return apply


def renamed(name):
    """Return a change of the wrist's name."""

    def apply(content):
        entry = content["transforms"].pop(WRIST.name)
        parent, _, child = name.partition("_T_")
        content["transforms"][name] = {**entry, "parent_frame": parent, "child_frame": child}

    return apply


def added(**sections):
    """Return a change of whole sections."""
    return lambda content: content.update(sections)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (added(joints={}), "section 'joints' is not known"),
        (added(conventions={}), "no section 'conventions'"),
        (added(transforms=[]), "transforms is no table"),
        (added(transforms={WRIST.name: 3}), f"transforms.{WRIST.name} is no table"),
        (added(cameras={"chest": {}}), "cameras.chest is not known: there are head"),
        (added(cameras={"head": []}), "cameras.head is no table"),
        (renamed("left_ee_T_camera"), "no transform of the manual's tree"),
        (renamed("left_wrist_camera_T_left_ee"), "no transform of the manual's tree"),
        (renamed("left_base_virtual_T_left_ee"), "moves with the joints"),
        (renamed("left_ee to left_wrist_camera"), "parent_T_child"),
        (renamed("virtual_base_T_right_base_virtual"), "no deviation of a single robot"),
        (changed_transform(parent_frame="right_ee"), "are not those of its name"),
        (changed_transform(child_frame=None), "are not those of its name"),
        (changed_transform(scale=2), "scale is not known"),
        (changed_transform(source=None), "source must be one of"),
        (changed_transform(source="assumption"), "source must be one of"),
        (changed_transform(device_specific=None), "device_specific true or false"),
        (changed_transform(device_specific=1), "device_specific true or false"),
        (changed_transform(note=4), "a note is text"),
        (changed_transform(source="mechanical_design"), "contradict each other"),
        (changed_transform(device_specific=False), "contradict each other"),
        (changed_transform(matrix=None), "a matrix is needed"),
        (changed_transform(matrix=[1, 2, 3]), f"{WRIST.name}: .*numbers are needed"),
        (changed_transform(matrix=np.diag([1, 1, -1, 1]).tolist()), "mirror"),
        (changed_transform(translation=[0, 0, 0]), "leave one out"),
        (changed_transform(matrix=None, translation=[0, 0, 0], quaternion=[0, 0, 0, 2]), "norm 2.0"),
        (
            lambda content: content["transforms"].update(
                {
                    "left_wrist_camera_T_left_wrist_right_camera": row(
                        Transform.of("left_wrist_camera_T_left_wrist_right_camera", p_m=(0.05, 0, 0)),
                        "stereo_calibration",
                    )
                }
            ),
            "leave one out",
        ),
        (
            lambda content: content["transforms"][CENTER_T_LEFT.name]["matrix"][0].__setitem__(3, -29.0),
            "differ by 3.6 mm",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused_with_its_place(tmp_path, change, match):
    """BAD_CONFIG names the file and the entry; nothing of such a file is used."""
    content = document()
    change(content)
    with pytest.raises(ConfigError, match=match) as caught:
        load(written(tmp_path, content), ROBOT)
    assert caught.value.code is Code.BAD_CONFIG
    assert caught.value.message.startswith(f"{tmp_path / 'calibration.json'}: ") and caught.value.hint


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [
        ("a.json", "{", "is no JSON"),
        ("a.toml", "a = ", "is no TOML"),
        ("a.yaml", "a: 1", "not .yaml"),
        ("a", "{}", "without a suffix"),
        ("a.json", "[]", "the file is no table"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path, name, content, match):
    """Notation and kind are said."""
    with pytest.raises(ConfigError, match=match):
        read(written(tmp_path, content, name))


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    """Missing, or no text."""
    with pytest.raises(ConfigError, match="No such file"):
        read(tmp_path / "none.json")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="codec"):
        read(tmp_path / "bytes.json")


def test_one_eye_of_the_head_alone_is_not_compared(tmp_path):
    """The check against R | T needs both mounts; a file with one is taken."""
    content = document()
    del content["transforms"]["head_camera_center_T_head_right_camera"]
    assert isinstance(load(written(tmp_path, content), ROBOT), Calibration)
    assert PAIR.baseline_m == pytest.approx(0.0653, abs=1e-4)


def test_an_identity_shows_serial_and_model():
    """As it stands in messages."""
    assert str(ROBOT) == "TA2-0042 (lift)" and asdict(ROBOT) == {"serial": "TA2-0042", "model": "lift"}
