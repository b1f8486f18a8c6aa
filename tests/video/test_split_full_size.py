"""The robot's own size, once: the six files have the sizes of the manual's table (§5.2), and each shows its own camera."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import av
import pytest

from gateway.sim.camera.film import Film
from gateway.sim.camera.hevc import Coding
from gateway.video.decoding.views import VIEWS
from gateway.video.recording.split import Splitter
from gateway.video.recording.take import Take
from tests.video.code_reader import read_code
from tests.video.coded import units

SIZES = {view: (960, 960) if view.startswith("head") else (640, 400) for view in VIEWS}
COUNT = 6


@pytest.mark.e2e
def test_full_size_views_have_the_manuals_sizes_and_every_picture(tmp_path: Path) -> None:
    """The counter in the pixels of each view is that of the picture it was cut from, through two codecs."""
    film = Film.of(Coding(width=1280, height=2720, rate_hz=45, gop=COUNT, bit_rate_bps=20_000_000), COUNT)
    take = Take(tmp_path / "take.mkv")
    for unit, picture in zip(units(), film.pictures, strict=False):
        is_first = unit.seq == 0
        take.write(replace(unit, data=picture.data, is_irap=is_first, has_parameter_sets=is_first))
    take.end("it was ended")
    split = Splitter(take.path, tmp_path / "views").run()
    assert split.pictures == COUNT
    for view, path in split.files.items():
        with av.open(str(path)) as file:
            pictures = list(file.decode(video=0))
        assert {(picture.width, picture.height) for picture in pictures} == {SIZES[view]}
        counters = [read_code(picture.to_ndarray(format="yuv420p")[: picture.height]) for picture in pictures]
        assert counters == [picture.counter for picture in film.pictures]
