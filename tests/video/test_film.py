"""Rules of `gateway.sim.camera.film` and `rig`: pictures in order of their counters, a loop encoded once and kept whole."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from gateway.sim.camera.composite import Size
from gateway.sim.camera.film import Coded, Film, Interrupted, live
from gateway.sim.camera.hevc import Coding
from gateway.sim.camera.rig import Rig
from tests.video.code_reader import read_composite

pytest.importorskip("av")

SMALL = Size(160, 340)
CODING = Coding(width=160, height=340, gop=3, bit_rate_bps=1_000_000)


def test_a_rig_delivers_every_trigger_when_no_camera_fails() -> None:
    """In whatever order the cameras deliver; all crops are of that trigger."""
    rig = Rig(SMALL)
    pictures = [rig.shoot(counter) for counter in range(5)]
    assert [picture and read_composite(picture.y) for picture in pictures] == [*range(5)]
    assert (rig.mailboxes.stitched, rig.mailboxes.ts_drop) == (5, 0)


def test_a_trigger_that_a_camera_misses_is_left_out_and_never_torn() -> None:
    """Half of them here: what comes out is of one trigger, and the mailboxes have counted the rest."""
    rig = Rig(SMALL, miss_p=0.2, seed=3)
    pictures = {counter: rig.shoot(counter) for counter in range(60)}
    whole = {counter: picture for counter, picture in pictures.items() if picture is not None}
    assert 10 < len(whole) < 50
    assert all(read_composite(picture.y) == counter for counter, picture in whole.items())
    assert sum(rig.mailboxes.overwritten) + sum(rig.mailboxes.dropped) > 0


@pytest.mark.parametrize("slices", [1, 3])
def test_live_pictures_carry_the_counter_of_their_pixels(slices: int) -> None:
    """Also when the encoder is a picture behind; missed triggers leave a gap."""
    import av

    coding = Coding(width=160, height=340, gop=3, bit_rate_bps=1_000_000, slices=slices)
    coded = list(itertools.islice(live(coding, Rig(SMALL, miss_p=0.1, seed=1), first=100), 12))
    decoder = av.CodecContext.create("hevc", "r")
    frames = [frame for picture in coded for frame in decoder.decode(av.Packet(picture.data))] + decoder.decode(None)
    counters = [read_composite(frame.to_ndarray()[: SMALL.height]) for frame in frames]
    assert counters == [picture.counter for picture in coded]
    assert counters[0] is not None and counters[0] >= 100 and counters != [*range(100, 112)]


def test_a_film_is_whole_groups_and_plays_for_ever() -> None:
    """From any picture on, key frame or not."""
    film = Film.of(CODING, 4)
    assert [picture.counter for picture in film.pictures] == [0, 1, 2, 3, 4, 5]
    played = itertools.islice(film.play(first=4), 5)
    assert [picture.counter for picture in played] == [4, 5, 0, 1, 2]


def test_a_kept_film_is_not_encoded_again(tmp_path: Path) -> None:
    """The same pictures, although nobody may encode any more."""
    assert not Film.is_kept(CODING, 3, 0, tmp_path)
    film = Film.of(CODING, 3, folder=tmp_path / "new")
    assert Film.is_kept(CODING, 3, 0, tmp_path / "new")
    again = Film.of(CODING, 3, folder=tmp_path / "new", should_stop=lambda: True)
    assert again.pictures == film.pictures


@pytest.mark.parametrize("other", ["seed", "count", "coding"])
def test_another_film_has_another_file(tmp_path: Path, other: str) -> None:
    """Whatever differs."""
    Film.of(CODING, 3, folder=tmp_path)
    coding = Coding(width=160, height=340, gop=3, bit_rate_bps=1_000_001) if other == "coding" else CODING
    assert not Film.is_kept(coding, 6 if other == "count" else 3, 1 if other == "seed" else 0, tmp_path)


@pytest.mark.parametrize("cut", [0, 5, 11, 20, -1, None])
def test_a_damaged_file_is_encoded_again(tmp_path: Path, cut: int | None) -> None:
    """Cut short anywhere, or a byte changed."""
    film = Film.of(CODING, 3, folder=tmp_path)
    (path,) = tmp_path.iterdir()
    content = path.read_bytes()
    path.write_bytes(content[:cut] if cut is not None else content[:-9] + b"?" + content[-8:])
    with pytest.raises(Interrupted):
        Film.of(CODING, 3, folder=tmp_path, should_stop=lambda: True)
    assert Film.of(CODING, 3, folder=tmp_path).pictures[0] == film.pictures[0]
    assert len(path.read_bytes()) == len(content)


def test_a_cache_that_cannot_be_written_does_no_harm(tmp_path: Path) -> None:
    """The film is played all the same."""
    (tmp_path / "file").write_text("no folder")
    assert len(Film.of(CODING, 3, folder=tmp_path / "file").pictures) == 3


def test_encoding_ends_when_nobody_wants_it_any_more() -> None:
    """Asked before each picture."""
    answers = iter([False, False, True])
    with pytest.raises(Interrupted, match="2 of 3"):
        Film.of(CODING, 3, should_stop=lambda: next(answers))
    assert Coded(0, b"").counter == 0
