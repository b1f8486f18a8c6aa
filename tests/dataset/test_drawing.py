"""Tests of an episode as a picture: all of it is there, of any dataset, as PNG or as one file of HTML."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil

import numpy as np
import pytest

from gateway.dataset.building import PROVENANCE, Choices, build
from gateway.dataset.drawing import draw, groups_of
from gateway.dataset.layout import STATE, vendor_layout
from gateway.dataset.lerobot_reader import Dataset
from gateway.robot.vector_layout import STATE_NAMES
from tests.dataset.motion import moving

pytest.importorskip("matplotlib")
image = pytest.importorskip("PIL.Image")


@pytest.fixture(scope="module")
def built(filmed_bags, layout, tmp_path_factory):
    """Return a dataset with pictures."""
    folder = tmp_path_factory.mktemp("drawn") / "set"
    build(filmed_bags[:1], folder, Choices(layout=layout, least_rows=10))
    return folder


def drawn(folder, out, title="wave"):
    """Draw the first episode and return the picture."""
    dataset = Dataset(folder)
    draw(dataset, next(dataset.episodes()), title, out)
    data = out.read_bytes()
    if out.suffix == ".html":
        (code,) = re.findall(rb'src="data:image/png;base64,([^"]+)"', data)
        data = base64.b64decode(code)
    return np.asarray(image.open(io.BytesIO(data)).convert("RGB"))


def test_vectors_are_grouped_as_their_layout_has_them(tmp_path):
    """With units; without a word on the layout in eights."""
    build([moving(tmp_path / "bag", 0.5)], tmp_path / "set", Choices(layout=vendor_layout(), least_rows=10))
    groups = groups_of(Dataset(tmp_path / "set"))[STATE]
    assert groups[0] == (STATE_NAMES[:7], "rad") and groups[1] == (("left_gripper_position",), "rad")
    (tmp_path / "set" / PROVENANCE).unlink()
    assert [len(names) for names, unit in groups_of(Dataset(tmp_path / "set"))[STATE]] == [8] * 9


def test_pictures_and_vectors_are_drawn_alike_as_png_and_html(built, tmp_path):
    """A title is text, whatever signs it has."""
    png = drawn(built, tmp_path / "a.png", "is $5 < $6 & 挥手")
    assert png.shape[1] == 1400 and png.std() > 10.0
    page = drawn(built, tmp_path / "a.html", "is $5 < $6 & 挥手")
    assert np.array_equal(png, page)
    assert "<h1>is $5 &lt; $6 &amp; 挥手</h1>" in (tmp_path / "a.html").read_text(encoding="utf-8")


def test_datasets_without_cameras_names_or_vectors_are_drawn_too(built, tmp_path):
    """Of others: what there is."""
    tall = drawn(built, tmp_path / "all.png").shape[0]
    shutil.copytree(built, tmp_path / "set")
    path = tmp_path / "set/meta/info.json"
    info = json.loads(path.read_text())
    cameras = {name: feature for name, feature in info["features"].items() if feature["dtype"] == "video"}
    vectors = {name: feature | {"names": None} for name, feature in info["features"].items() if name not in cameras}
    path.write_text(json.dumps(info | {"features": vectors}))
    assert drawn(tmp_path / "set", tmp_path / "vectors.png").shape[0] < tall
    own = {name: feature for name, feature in vectors.items() if name not in ("action", STATE)}
    path.write_text(json.dumps(info | {"features": own | cameras}))
    assert drawn(tmp_path / "set", tmp_path / "pictures.png").shape[0] < tall
    path.write_text(json.dumps(info | {"features": own}))
    assert drawn(tmp_path / "set", tmp_path / "nothing.png").shape[0] < tall
