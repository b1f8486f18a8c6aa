"""Tests of `ta2 frames`: the tree, one chain, JSON by the manual's conventions, the picture, and whose calibration it is."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import combinations

import numpy as np
import pytest

from gateway.cli.body.frames import MEANINGS, Posture, document, kind_of, lines
from gateway.kinematics.description import nominal
from gateway.kinematics.frames import ROOT
from gateway.kinematics.sight import robot_frames
from gateway.robot.limits import HOME_Q_RAD
from gateway.values import Side
from tests.kinematics.arms import WITNESSES, joints_at
from tests.kinematics.calibrations import WRIST, written
from tests.kinematics.calibrations import document as calibration

HOME = {side: joints_at(HOME_Q_RAD[side]) for side in Side}
TREE = robot_frames(nominal(), WITNESSES)


def row(text, frame):
    """Return the line of a frame."""
    (found,) = [line for line in text.splitlines() if frame in line.split()]
    return found


def test_the_tree_is_drawn_with_every_frame_once(shell):
    """Without a gateway: all fourteen, children under parents, the arms at the initial position and said so (§6.6)."""
    ended = shell.run("frames")
    assert ended.status == 0 and shell.names == [], "nobody was asked"
    assert "initial position of §6.6" in ended.out.splitlines()[0]
    names = [line for line in ended.out.splitlines() if "─ " in line]
    assert len(names) == len(TREE.frames) - 1
    assert row(ended.out, "left_ee").startswith("│  ├─ left_ee ")
    assert row(ended.out, "left_wrist_camera").startswith("│  │  └─ left_wrist_camera ")
    assert row(ended.out, "right_shoulder_base").startswith("   └─ right_shoulder_base ")
    assert all(len(line) <= 110 for line in ended.out.splitlines())
    for frame in TREE.frames[1:]:
        assert row(ended.out, frame).endswith(f" {kind_of(TREE, frame)}")
    assert "-105.6  +220.0   -193.1" in row(ended.out, "left_base_virtual"), "A.3, in mm"


@pytest.mark.parametrize("side", Side)
def test_places_are_those_of_the_witness(shell, side):
    """The end effector where the simulator's own kinematics puts it, for joints given on the command line."""
    q = np.array(HOME_Q_RAD[side]) + 0.05
    ended = shell.run("frames", "--json", f"--{side}", *map(str, q))
    found = ended.json["transforms"][f"{side}_base_virtual_T_{side}_ee"]
    placed = WITNESSES[side].forward(q)
    np.testing.assert_allclose(np.array(found["matrix"])[:3, 3], np.array(placed.p_m) * 1e3, atol=1e-6)
    np.testing.assert_allclose(np.array(found["matrix"])[:3, :3], placed.rows, atol=1e-9)
    assert f"{side} as given" in ended.json["joints"] and found["stamp_ns"] is None, "nobody measured that"


def test_json_obeys_the_conventions_that_it_names(shell):
    """A.1 and A.4: parent_T_child, row-major, mm; source and device_specific beside each matrix."""
    shown = shell.run("frames", "--json").json
    assert shown["conventions"]["translation_unit"] == "mm" and shown["conventions"]["matrix_layout"] == "row_major"
    assert len(shown["transforms"]) == len(TREE.frames) - 1
    for name, entry in shown["transforms"].items():
        assert name == f"{entry['parent_frame']}_T_{entry['child_frame']}"
        assert np.array(entry["matrix"]).shape == (4, 4) and entry["device_specific"] is False
        assert entry["kind"] in MEANINGS and entry["source"]
    head = shown["transforms"]["virtual_base_T_head_camera_center"]
    np.testing.assert_allclose(head["matrix"][0], (0, -0.4384, 0.8988, 0), atol=5e-5)
    camera = shown["transforms"]["left_ee_T_left_wrist_camera"]
    expected = TREE.locate(ROOT, "left_wrist_camera", HOME).transform.p_m
    np.testing.assert_allclose(np.array(camera["in_virtual_base"])[:3, 3], 1e3 * expected, atol=1e-6)


def test_one_chain_tells_its_way(shell):
    """The transforms on the way (A.5), matrix, quaternion, and what is a stand-in."""
    ended = shell.run("frames", "--chain", "virtual_base", "left_wrist_camera")
    assert ended.status == 0
    said = ended.out.splitlines()
    assert said[0] == "virtual_base_T_left_wrist_camera ="
    assert [line.strip() for line in said[1:4]] == [
        "virtual_base_T_left_base_virtual",
        "left_base_virtual_T_left_ee",
        "left_ee_T_left_wrist_camera",
    ]
    assert "joints of the left arm: not measured" in ended.out
    assert "stand-in: left_ee_T_left_wrist_camera" in ended.out
    shown = shell.run("frames", "--json", "--chain", "virtual_base", "left_wrist_camera").json
    located = TREE.locate("virtual_base", "left_wrist_camera", HOME)
    np.testing.assert_allclose(shown["translation"], 1e3 * located.transform.p_m, atol=1e-6)
    np.testing.assert_allclose(shown["quaternion"], located.transform.quat_xyzw, atol=1e-9)
    assert shown["stand_ins"] == list(located.stand_ins) and shown["stamps_ns"] == {"left": None}


def test_live_joints_bring_their_stamps(shell):
    """From the gateway's snapshot: each arm's age in the text, each arm's stamp on the robot's clock in the JSON."""
    ended = shell.run("frames", "--live")
    assert ended.status == 0 and shell.names == ["ta2 frames"]
    assert "measured: left " in ended.out and " ms old" in ended.out.splitlines()[0]
    shown = shell.run("frames", "--live", "--json", "--chain", "left_ee", "right_ee").json
    arms = shell.world.engine.snapshot.arms
    assert shown["stamps_ns"] == {str(side): arms[side].measured.stamp_ns for side in Side}
    assert "clock" in shell.run("frames", "--live", "--chain", "virtual_base", "left_ee").out


def test_an_arm_of_which_nothing_is_known_is_left_open():
    """Its frames have no place, and nothing is made up; the rest is shown."""
    posture = Posture(joints={Side.LEFT: HOME[Side.LEFT]}, source="measured: left 5 ms old", is_measured=True)
    text = "\n".join(line.plain for line in lines(TREE, posture))
    assert "no joints" in row(text, "right_ee") and "no joints" not in row(text, "left_ee")
    assert row(text, "right_wrist_camera").count("no joints") == 1, "fixed on the hand, but the hand is somewhere"
    entry = document(TREE, posture)["transforms"]["right_base_virtual_T_right_ee"]
    assert entry["matrix"] is None and entry["in_virtual_base"] is None


def test_a_robots_own_calibration_is_shown_as_such(shell, tmp_path):
    """With its serial number, from the options or from the settings; frames of the file are green, not yellow."""
    file = written(tmp_path, calibration())
    settings = tmp_path / "robot.toml"
    settings.write_text('[robot]\nserial = "TA2-0042"\nmodel = "lift"\n')
    by_settings = shell.run("frames", "--calibration", str(file), "--config", str(settings))
    assert by_settings.status == 0
    assert row(by_settings.out, "left_wrist_camera").endswith("this robot")
    assert row(by_settings.out, "right_wrist_camera").endswith("stand-in")
    shown = shell.run("frames", "--json", "--calibration", str(file), "--config", str(settings)).json
    entry = shown["transforms"][WRIST.name]
    assert entry["device_specific"] is True and entry["source"] == "arm_camera_calibration"
    np.testing.assert_allclose(np.array(entry["matrix"])[:3, 3], 1e3 * WRIST.p_m, atol=1e-9)


@pytest.mark.parametrize("words", [[], ["--serial", "TA2-0043"], ["--serial", "TA2-0042"]])
def test_another_robots_calibration_is_refused(shell, tmp_path, words):
    """FOREIGN_CALIBRATION and status 2; the model counts, too (the file is of a lift model, the settings say standard)."""
    ended = shell.run("frames", "--calibration", str(written(tmp_path, calibration())), *words)
    assert ended.status == 2 and ended.err.startswith("FOREIGN_CALIBRATION: ") and "TA2-0042 (lift)" in ended.err
    assert not ended.out


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--chain", "virtual_base", "camera"], "WRONG_FRAME"),
        (["--left", *["nan"] * 7], "NOT_FINITE"),
        (["--plot", "frames.bmp"], "BAD_REQUEST"),
        (["--plot", "/proc/none/frames.png"], "BAD_REQUEST"),
        (["--calibration", "/none.json"], "BAD_CONFIG"),
        (["--urdf", "/none.urdf"], "BAD_CONFIG"),
    ],
)
def test_what_cannot_be_shown_is_one_line(shell, words, code):
    """Code, reason, remedy."""
    ended = shell.run("frames", *words)
    assert ended.status in (1, 2) and ended.err.startswith(f"{code}: ") and " -> " in ended.err and not ended.out


@pytest.mark.parametrize("words", [["--live", "--left", *"1234567"], ["--left", "1", "2"], ["--chain", "left_ee"]])
def test_what_makes_no_sense_is_a_usage_error(shell, words):
    """Joints from two places, too few of them, a chain of one frame."""
    assert shell.run("frames", *words).status == 2


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_picture_is_drawn(shell, tmp_path, suffix):
    """Into a new folder; the file is of its kind, and names every frame (read in the SVG)."""
    path = tmp_path / "new" / f"frames{suffix}"
    assert shell.run("frames", "--plot", str(path)).status == 0
    content = path.read_bytes()
    assert content.startswith({".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix])
    if suffix == ".svg":
        for frame in TREE.frames:
            assert f"<!-- {frame} -->".encode() in content


@pytest.mark.parametrize("words", [[], ["--left", *"0000000", "--right", *"0000000"]], ids=["initial", "zero"])
def test_names_in_the_picture_can_be_read(shell, monkeypatch, tmp_path, words):
    """None lies over another, none leaves the paper: as drawn, with the boxes that matplotlib measures."""
    from matplotlib.text import Text

    plot = pytest.importorskip("gateway.cli.body.frames_plot", reason="matplotlib is not installed")
    drawn = []
    with monkeypatch.context() as patch:
        patch.setattr(plot.plt, "close", drawn.append)
        assert shell.run("frames", *words, "--plot", str(tmp_path / "a.png")).status == 0
    (figure,) = drawn
    renderer = figure.canvas.get_renderer()
    for panel in figure.axes:
        (per_m, _, _), (_, up_per_m, _), _ = panel.transData.frozen().get_matrix()
        assert up_per_m == pytest.approx(per_m), "a metre is as long in both directions"
        names = [text for text in panel.texts if text.get_text()]
        assert {name for text in names for name in text.get_text().split("\n")} == set(TREE.frames)
        boxes = [(text.get_text(), Text.get_window_extent(text, renderer)) for text in names]  # without its line
        for (one, box), (other, beside) in combinations(boxes, 2):
            assert not box.overlaps(beside), f"{one!r} and {other!r}"
        for name, box in boxes:
            assert figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1, name
            assert figure.bbox.y0 <= box.y0 and box.y1 <= figure.bbox.y1, name
    plot.plt.close(figure)


def test_a_picture_needs_matplotlib(shell, monkeypatch, tmp_path):
    """Without it the answer says how to get it."""
    monkeypatch.setitem(sys.modules, "gateway.cli.body.frames_plot", None)
    ended = shell.run("frames", "--plot", str(tmp_path / "a.png"))
    assert ended.status == 1 and "matplotlib is not installed" in ended.err and "[demo]" in ended.err


def test_frames_need_no_pinocchio():
    """Whoever only looks at frames needs no extra: the tree, its kinematics and the calibrations are numpy."""
    code = "import sys; from gateway.cli.main import main; main(['frames']); sys.exit('pinocchio' in sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=50)
    assert ended.returncode == 0 and "left_wrist_camera" in ended.stdout, ended.stderr


def test_the_document_can_be_written_as_json():
    """No numpy value is left in it."""
    assert json.dumps(document(TREE, Posture(joints=HOME, source="home", is_measured=False)))
