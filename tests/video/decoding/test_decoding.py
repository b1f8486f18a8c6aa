"""Tests of the decoding thread's work, on coded pictures without a network."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from gateway.video.decoding.decoder import Decoder
from gateway.video.decoding.decoding import HELD_BACK, Decoding
from gateway.video.decoding.newest import Newest
from gateway.video.decoding.rgb import RgbConverter
from gateway.video.errors import VideoCode, VideoError
from tests.video.code_reader import read_codes, read_composite
from tests.video.pictures import STEP, broken, coded, units


class Waiting:
    """Coded pictures that have all come already."""

    def __init__(self, waiting):
        self._waiting = list(waiting)

    @property
    def is_over(self):
        return not self._waiting

    def take(self, timeout_s):
        return self._waiting.pop(0)


class Gathered:
    """Everything that a decoding publishes."""

    def __init__(self, given, **options):
        self.newest, self.frames = Newest(), []
        self.decoder = Decoder("software")
        self.work = Decoding(Waiting(given), self.newest, self.decoder, RgbConverter(), **options)
        with self.newest.listening(self._note):
            self.work.run()
        self.reading = self.work.meter.reading(0)

    def _note(self):
        frame = self.newest.frame
        if frame is not None and (not self.frames or self.frames[-1] is not frame):
            self.frames.append(frame)


def test_every_picture_becomes_a_frame_with_its_times():
    """Numbered, in order, with the six views; all of them from one picture."""
    given = units(coded(25))
    frames = Gathered(given).frames
    assert [frame.seq for frame in frames] == list(range(25))
    assert [frame.rtp_time for frame in frames] == [STEP * n for n in range(25)]
    assert [frame.received_ns for frame in frames] == [unit.first_packet_ns for unit in given]
    for n, frame in enumerate(frames):
        assert set(read_codes(frame.rgb).values()) == {n}
        assert frame.clean and frame.lost == () and frame.rgb.shape == (340, 160, 3)


def test_a_frame_cannot_be_changed_and_is_never_overwritten():
    """Not by its readers, whatever they try, and not by the pictures after it."""
    frames = Gathered(units(coded(25))).frames
    kept = [frame.rgb.copy() for frame in frames]
    for array in (frames[0].rgb, frames[0]["left_wrist_left_eye"], frames[0].views["head_left_eye"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 0
        with pytest.raises(ValueError, match="cannot set WRITEABLE"):
            array.flags.writeable = True
        assert not array.flags.owndata
    assert all((frame.rgb == copy).all() for frame, copy in zip(frames, kept, strict=True))
    assert len({frame.rgb.__array_interface__["data"][0] for frame in frames}) == 25


def test_a_frame_outlives_its_decoder():
    """Its memory is its own."""
    gathered = Gathered(units(coded(25)))
    frame = gathered.frames[3]
    del gathered
    assert read_composite(frame.rgb) == 3


def test_damaged_pictures_are_published_and_say_so():
    """With what was lost; the next key picture is clean."""
    given = units(coded(25))
    given[13] = broken(given[13], (41, 44))
    gathered = Gathered(given)
    assert [frame.seq for frame in gathered.frames if not frame.clean] == list(range(13, 20))
    assert {frame.lost for frame in gathered.frames[13:20]} == {((41, 44),)}
    assert gathered.reading.damaged == 7 and gathered.reading.frames == 25


def test_strict_withholds_whatever_is_not_clean():
    """And counts it; the numbers of frames have no gap."""
    given = units(coded(25))
    given[13] = broken(given[13])
    gathered = Gathered(given, is_strict=True)
    assert [read_composite(frame.rgb) for frame in gathered.frames] == [*range(13), *range(20, 25)]
    assert [frame.seq for frame in gathered.frames] == list(range(18))
    assert gathered.reading.withheld == 7 and gathered.reading.damaged == 0


def test_pictures_before_the_first_key_picture_are_counted():
    """Nothing can be made of them."""
    gathered = Gathered(units(coded(25))[3:])
    assert gathered.reading.undecodable == 7 and read_composite(gathered.frames[0].rgb) == 10


def test_another_sender_goes_on_in_the_same_frames():
    """Numbers go on, its life is another; what it sent before its key picture is left out."""
    given = [*units(coded(25)), *units(coded(25), life=1)[5:]]
    frames = Gathered(given).frames
    assert [frame.seq for frame in frames] == list(range(25 + 15))
    assert [frame.life for frame in frames] == [0] * 25 + [1] * 15
    assert read_composite(frames[25].rgb) == 10


def test_a_start_after_a_stop_goes_on_numbering():
    """`after_seq` of a reader must not hide new frames from it."""
    assert Gathered(units(coded(25)), first_seq=100).frames[0].seq == 100


def test_an_error_of_the_thread_surfaces_where_frames_are_waited_for(caplog):
    """It is logged, and nobody waits for ever."""

    class Failing(Waiting):
        def take(self, timeout_s):
            raise ZeroDivisionError("in the thread")

    newest = Newest()
    Decoding(Failing([None]), newest, Decoder("software"), RgbConverter()).run()
    with pytest.raises(VideoError) as caught:
        newest.wait(-1, 60.0)
    assert caught.value.code is VideoCode.DECODER_FAILED and "in the thread" in str(caught.value)
    assert "ended" in caplog.text


def test_what_the_decoder_makes_nothing_of_is_counted():
    """FFmpeg is silent about most of it: what is no slice of anything gives no picture and no error."""
    given = units(coded(25))
    nonsense = [replace(given[1], seq=25 + n, data=b"\x00\x00\x00\x01\x02\x01\x00") for n in range(40)]
    gathered = Gathered([*given, *nonsense])
    assert len(gathered.frames) == 25 and gathered.newest.peek(-1).seq == 24
    assert gathered.reading.errors >= 40 - HELD_BACK


WEIGHTS = {"bt601": (0.299, 0.114, 5), "bt709": (0.2126, 0.0722, 1), "bt2020": (0.2627, 0.0593, 9)}
"""Of red and blue in luma (ITU-R BT.601, 709, 2020), and the number in a stream (H.265, Table E.5)."""


def red(matrix, *, is_full=False):
    """Return a picture that is all red, as YUV by a matrix."""
    from gateway.video.decoding.libav import av

    of_red, of_blue, _ = WEIGHTS[matrix]
    y, cb = of_red, -0.5 * of_red / (1 - of_blue)
    planes = np.full((96, 64), round(255 * y if is_full else 16 + 219 * y), np.uint8)
    planes[64:80] = round(128 + (255 if is_full else 224) * cb)
    planes[80:] = 255 if is_full else 240
    picture = av.VideoFrame.from_ndarray(planes, format="yuv420p")
    picture.color_range = 2 if is_full else 1
    return picture


def is_red(rgb):
    """Return whether a picture is all red."""
    return np.abs(rgb.astype(int) - (255, 0, 0)).max() <= 3


@pytest.mark.parametrize("matrix", WEIGHTS)
def test_the_matrix_of_unnamed_colours_is_the_callers_choice(matrix):
    """A pure colour is what that matrix makes of it."""
    assert is_red(RgbConverter(matrix).convert(red(matrix)))
    assert not is_red(RgbConverter("bt601" if matrix == "bt709" else "bt709").convert(red(matrix)))


@pytest.mark.parametrize("is_full", [False, True])
@pytest.mark.parametrize("matrix", WEIGHTS)
def test_a_stream_that_names_its_matrix_and_range_is_believed(matrix, is_full):
    """Whatever the caller takes for unnamed ones (H.265, E.3.1)."""
    for assumed in WEIGHTS:
        picture = red(matrix, is_full=is_full)
        picture.colorspace = WEIGHTS[matrix][2]
        assert is_red(RgbConverter(assumed).convert(picture))


def test_lines_with_padding_become_a_picture_without():
    """A width that is no multiple of the decoder's alignment."""
    from gateway.video.decoding.libav import av

    planes = np.full((510, 162), 128, np.uint8)
    planes[:340, :80] = 16
    rgb = RgbConverter().convert(av.VideoFrame.from_ndarray(planes, format="yuv420p"))
    assert rgb.shape == (340, 162, 3) and rgb[:, :78].max() < 5 and rgb[:, 84:].min() > 100
    with pytest.raises(ValueError, match="cannot set WRITEABLE"):
        rgb.flags.writeable = True


class Counting(RgbConverter):
    """A converter that counts its work, and lets another thread come meanwhile."""

    def __init__(self):
        super().__init__()
        self.converted = 0

    def convert(self, picture):
        self.converted += 1
        time.sleep(0.01)
        return super().convert(picture)


def test_a_picture_that_nobody_looks_at_is_never_converted():
    """Only the one that is looked at, once, whoever looks how often; its views are views of that."""
    newest, converter, frames = Newest(), Counting(), []
    with newest.listening(lambda: frames.append(newest.frame)):
        Decoding(Waiting(units(coded(5))), newest, Decoder("software"), converter).run()
    assert len(frames) >= 5 and converter.converted == 0
    assert read_composite(frames[3].rgb) == 3 and frames[3].rgb is frames[3].rgb
    assert np.shares_memory(frames[3]["left_wrist_left_eye"], frames[3].rgb) and converter.converted == 1


def test_two_threads_that_look_at_once_get_the_same_array():
    """It is converted by one of them."""
    newest, converter = Newest(), Counting()
    Decoding(Waiting(units(coded(1))), newest, Decoder("software"), converter).run()
    with ThreadPoolExecutor(4) as pool:
        arrays = list(pool.map(lambda _: newest.frame.rgb, range(4)))
    assert converter.converted == 1 and all(array is arrays[0] for array in arrays)
