"""Tests of the decoder: pictures come out as they went in, nothing is raised, and it is never dropped with pictures in it."""

from __future__ import annotations

import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gateway.sim.camera.composite import Size
from gateway.sim.camera.hevc import KeyFrames
from gateway.video.decoding import decoder as module
from gateway.video.decoding import nvdec
from gateway.video.decoding.damage import Damage
from gateway.video.decoding.decoder import Decoder
from gateway.video.decoding.libav import av
from gateway.video.decoding.rgb import RgbConverter
from tests.video.code_reader import read_codes, read_composite
from tests.video.pictures import broken, coded, units
from tests.video.stage import until

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def decoder():
    """A software decoder."""
    made = Decoder("software")
    yield made
    made.close()


def counters(decoder, given):
    """Return the counters of the pictures that come out, with the marks that went in."""
    convert = RgbConverter().convert
    done = (done for unit in given for done in decoder.decode(unit, unit.seq))
    return [(each.mark, read_composite(convert(each.picture))) for each in done]


def test_each_picture_comes_out_when_it_goes_in(decoder):
    """No delay, the right mark at each, the pixels that were sent."""
    given = units(coded(25))
    for n, unit in enumerate(given):
        assert counters(decoder, [unit]) == [(n, n)]
    assert decoder.errors == 0 and decoder.name.startswith("software")


def test_the_same_decoder_goes_on_after_a_restart_of_the_sender(decoder):
    """Also of another size: the stream says how large its pictures are (§5.2 gives the robot's)."""
    counters(decoder, units(coded(13)))
    again = units(coded(12), life=1)
    assert [counters(decoder, [unit]) for unit in again] == [[(n, n)] for n in range(12)]
    large = units(coded(3, Size(320, 680)), life=2)
    shapes = [done.picture.height for unit in large for done in decoder.decode(unit, 0, begins=unit.seq == 0)]
    assert shapes == [680, 680, 680]


def test_nothing_that_a_network_does_is_raised(decoder):
    """Truncated, empty, random, without parameter sets: counted or concealed."""
    given = units(coded(20))
    for unit in given:
        decoder.decode(broken(unit), None)
    for data in (b"", b"\x00", b"\x00\x00\x00\x01", bytes(range(256)), b"\x00\x00\x01\x26\x01" + bytes(300)):
        decoder.decode(replace(given[0], data=data), None)
    assert counters(decoder, given[10:])[-1] == (19, 19)


def test_errors_are_counted_with_the_newest_in_words(decoder, monkeypatch):
    """A decoder that refuses every packet raises nothing."""

    class Refusing:
        is_open = False

        def decode(self, packet):
            raise av.error.InvalidDataError(1, "no picture in it")

    monkeypatch.setattr(decoder, "_context", Refusing())
    for unit in units(coded(20))[:3]:
        assert decoder.decode(unit, None) == []
    assert decoder.errors == 3 and "no picture in it" in decoder.last_error


@pytest.mark.parametrize("kind", [KeyFrames.IDR, KeyFrames.CRA])
def test_what_is_judged_clean_is_what_was_sent(decoder, kind):
    """Every flag is true over a loss in the middle of a group of pictures; the next key picture ends it (notes §11)."""
    given = units(coded(40, key_frames=kind))
    whole = dict(counters(decoder, given))
    assert whole == {n: n for n in range(40)}
    given[13] = broken(given[13])
    del given[25]
    damage, convert, found = Damage(), RgbConverter().convert, {}
    for unit in given:
        verdict = damage.judge(unit)
        for done in decoder.decode(unit, (unit.seq, verdict.clean), begins=verdict.begins):
            seq, clean = done.mark
            found[seq] = clean
            if clean:
                assert read_composite(convert(done.picture)) == seq
    assert [seq for seq, clean in found.items() if not clean] == [*range(13, 20), *range(26, 30)]


def test_a_stream_without_periodic_key_pictures_stays_flagged(decoder):
    """It cannot be known when damage has left such a picture."""
    given = units(coded(40, key_frames=KeyFrames.ONCE))
    damage = Damage()
    given[5] = broken(given[5])
    assert [damage.judge(unit).clean for unit in given] == [True] * 5 + [False] * 35


@pytest.mark.parametrize("kind", [KeyFrames.ONCE, KeyFrames.REFRESH])
def test_a_lost_picture_does_not_end_a_stream_without_key_pictures(decoder, kind):
    """FFmpeg would show nothing for ever after: pictures go on, flagged."""
    given = units(coded(40, key_frames=kind))
    del given[12]
    damage, found = Damage(), []
    for unit in given:
        clean = damage.judge(unit).clean
        found += [(done.mark, clean) for done in decoder.decode(unit, unit.seq)]
    assert found == [*((n, True) for n in range(12)), *((n, False) for n in range(13, 40))]


def test_views_of_the_rgb_picture_bear_each_their_own_code(decoder):
    """All six, where §5.2 has them."""
    (done,) = decoder.decode(units(coded(25))[0], None)
    assert set(read_codes(RgbConverter().convert(done.picture)).values()) == {0}


class OtherSoftware:
    """Stands where a GPU's decoder would: a real decoder that may go wrong.

    Args:
        spoil: Done to each picture.
    """

    is_open = True

    def __init__(self, spoil=lambda picture: picture):
        self._context, self._spoil = av.VideoCodecContext.create("hevc", "r"), spoil
        self.thread_type, self.flags = None, 0
        self.colorspace, self.color_range = 2, 1

    def decode(self, packet):
        return [self._spoil(picture) for picture in self._context.decode(packet)]

    def flush_buffers(self):
        self._context.flush_buffers()


def spoilt(picture):
    """Return a picture with one sample changed."""
    planes = picture.to_ndarray()
    planes[7, 9] ^= 1
    return av.VideoFrame.from_ndarray(planes, format="yuv420p")


def unnamed(picture):
    """Return a picture as it comes out of a GPU's memory: it does not say how its colours were made."""
    picture.colorspace, picture.color_range = 2, 0
    return picture


def test_what_the_stream_says_of_its_colours_is_not_lost_on_the_way_from_a_gpu(decoder, monkeypatch):
    """PyAV copies the samples and the time stamp."""
    other = OtherSoftware(unnamed)
    other.colorspace, other.color_range = 1, 2
    monkeypatch.setattr(decoder, "_context", other)
    (done,) = decoder.decode(units(coded(25))[0], None)
    assert (done.picture.colorspace, done.picture.color_range) == (1, 2)


def probed(monkeypatch, ways):
    """Return a decoder that has taken these ways to a GPU, and what came out of two groups of pictures."""
    monkeypatch.setattr(nvdec, "WAYS", ways)
    made, given, found = Decoder("auto"), units(coded(25)), []
    for unit in given:
        found += counters(made, [unit])
        if made._probe is not None:
            until(lambda: made._probe.take() is not None, "the proof's end")
    made.close()
    return made, found


def test_a_gpu_that_decodes_as_the_software_does_is_taken_at_the_next_key_picture(monkeypatch):
    """Pictures come meanwhile; none is lost and none comes twice when it takes over."""
    made, found = probed(monkeypatch, {"hevc on cuda": OtherSoftware})
    assert found == [(n, n) for n in range(25)]
    assert made.is_nvdec and made.name == "nvdec (hevc on cuda)" and "exactly" in made.note


def test_a_gpu_that_decodes_one_sample_wrongly_is_not_taken(monkeypatch):
    """The next way to it is tried; the reasons are told."""

    def broken_driver():
        raise RuntimeError("no driver")

    ways = {
        "without driver": broken_driver,
        "wrong": lambda: OtherSoftware(spoilt),
        "small": lambda: OtherSoftware(lambda picture: picture.reformat(width=80)),
        "strange": lambda: OtherSoftware(lambda picture: picture.reformat(format="p010le")),
    }
    made, found = probed(monkeypatch, ways)
    assert found == [(n, n) for n in range(25)] and not made.is_nvdec
    for reason in (
        "without driver: RuntimeError: no driver",
        "wrong: decoded 1 of 54400 pixels wrongly",
        "small: gave a picture of 80 x 340, not 160 x 340",
        "strange: pictures of format p010le cannot be compared",
    ):
        assert reason in made.note


def test_where_the_better_way_fails_the_other_is_taken(monkeypatch):
    """hevc_cuvid comes second: it shows each picture one later."""
    made, found = probed(monkeypatch, {"wrong": lambda: OtherSoftware(spoilt), "hevc_cuvid": OtherSoftware})
    assert found == [(n, n) for n in range(25)] and made.name == "nvdec (hevc_cuvid)"


def test_a_proof_that_nobody_waits_for_is_ended(monkeypatch):
    """Closing comes first: what it opened is flushed like any other."""
    monkeypatch.setattr(nvdec, "WAYS", {"hevc on cuda": OtherSoftware})
    made = Decoder("auto")
    made.decode(units(coded(25))[0], None)
    made.close()
    assert not made.is_nvdec


def test_a_decoder_of_the_gpu_that_gives_nothing_any_more_is_given_up(decoder, monkeypatch, caplog):
    """Back to software, from the next key picture on; it is said."""
    given = units(coded(60))

    class Dead:
        is_open = False

        def decode(self, packet):
            return []

    monkeypatch.setattr(decoder, "_context", Dead())
    decoder.name = "nvdec (hevc on cuda)"
    for unit in given[: module.BARREN]:
        assert decoder.decode(unit, None) == [] and decoder.is_nvdec is not decoder.has_begun_anew
    assert decoder.has_begun_anew and not decoder.is_nvdec and "given up" in decoder.note and "given up" in caplog.text
    assert counters(decoder, given[module.BARREN :]) == [(n, n) for n in range(module.BARREN, 60)]
    assert not decoder.has_begun_anew


@pytest.mark.parametrize(
    "error", [av.error.ExternalError(1, "device lost"), RuntimeError("gone"), MemoryError()], ids=repr
)
def test_a_decoder_of_the_gpu_that_fails_later_is_given_up_soon(monkeypatch, error):
    """It was proved and taken, then refuses everything: software goes on at the next key picture, and the reason is told."""
    given = units(coded(60))

    class Failing(OtherSoftware):
        left = 15  # the key picture of the proof, the end of it, then 13 pictures

        def decode(self, packet):
            self.left -= 1
            if self.left < 0:
                raise error
            return super().decode(packet)

    monkeypatch.setattr(nvdec, "WAYS", {"hevc on cuda": Failing})
    made, damage, found = Decoder("auto"), Damage(), []
    for unit in given:
        verdict = damage.judge(unit)
        if not verdict.is_decodable:
            continue
        found += counters(made, [unit])
        if made.has_begun_anew:
            damage.begin_anew()
        if made._probe is not None:
            until(lambda: made._probe.take() is not None, "the proof's end")
    made.close()
    assert found == [(n, n) for n in (*range(23), *range(30, 60))]
    assert not made.is_nvdec and "given up" in made.note and type(error).__name__ in made.note
    assert made.errors == 3


def test_a_damaged_picture_that_a_gpu_refuses_does_not_end_it(decoder, monkeypatch):
    """That is no fault of its own."""

    class Refusing:
        is_open = False

        def decode(self, packet):
            raise av.error.InvalidDataError(1, "no picture in it")

    monkeypatch.setattr(decoder, "_context", Refusing())
    decoder.name = "nvdec (hevc on cuda)"
    for unit in units(coded(60))[: module.BARREN]:
        decoder.decode(broken(unit), None)
    assert decoder.is_nvdec and decoder.errors == module.BARREN


def test_a_build_without_cuda_does_not_pass_for_a_gpu(monkeypatch):
    """PyAV then decodes in software without a word, and software decodes exactly as software does."""
    monkeypatch.setattr(nvdec, "HWAccel", lambda kind, **words: None)
    context, why = nvdec.open_nvdec(coded(25)[0], expected(coded(25)[0]), module._low_delay)
    assert context is None and "hevc on cuda: RuntimeError: this FFmpeg was built without CUDA" in why


def expected(key_picture):
    """Return a picture as software decodes it."""
    context = av.VideoCodecContext.create("hevc", "r")
    (picture,) = [*context.decode(av.Packet(key_picture)), *context.decode(None)]
    return picture


def test_where_there_is_no_gpu_both_ways_say_why():
    """On this machine as it is: never an exception, and never a decoder that was not proved."""
    context, why = nvdec.open_nvdec(coded(25)[0], expected(coded(25)[0]), module._low_delay)
    if context is None:
        assert why.startswith("hevc on cuda: ") and "; hevc_cuvid: " in why
    else:  # there is one, and it has proved itself
        assert why in nvdec.WAYS
        context.flush_buffers()


def test_a_way_that_raises_what_nobody_expects_is_a_reason_too(monkeypatch, caplog):
    """Another version of PyAV may have another interface: software goes on, with the error in the note and in the log."""

    def changed():
        raise TypeError("create() takes 2 arguments")

    made, found = probed(monkeypatch, {"hevc on cuda": changed})
    assert found == [(n, n) for n in range(25)]
    assert made.note == "NVDEC is not used: the proof ended by an error, TypeError: create() takes 2 arguments"
    assert "the proof of NVDEC" in caplog.text


def test_a_driver_that_hangs_holds_nobody_up(monkeypatch, caplog):
    """Pictures come from software, and closing does not wait for ever; what it opens in the end is of no use to anybody."""
    answer = threading.Event()

    def hangs():
        answer.wait(60.0)
        return OtherSoftware()

    monkeypatch.setattr(nvdec, "WAYS", {"hevc on cuda": hangs})
    monkeypatch.setattr(nvdec, "CLOSE_S", 0.01)
    made = Decoder("auto")
    assert counters(made, units(coded(25))) == [(n, n) for n in range(25)]
    made.close()
    assert "has not answered" in caplog.text and not made.is_nvdec
    answer.set()


@pytest.mark.parametrize("matrix", [1, 2, 6, 9])
@pytest.mark.parametrize("colour_range", [0, 1, 2])
def test_a_picture_of_a_gpu_has_the_colours_of_the_same_picture_decoded_in_software(matrix, colour_range):
    """It comes with its colours in one plane (NV12); the RGB is the same to the bit, whatever the stream says of it."""
    convert, planar = RgbConverter().convert, expected(coded(25)[0])
    interleaved = planar.reformat(format="nv12")
    for picture in (planar, interleaved):
        picture.colorspace, picture.color_range = matrix, colour_range
    assert np.array_equal(convert(interleaved), convert(planar))


def test_dropping_a_decoder_never_hangs():
    """PyAV waits for ever for one with threads that still holds pictures (notes §6): here it is flushed before."""
    program = (
        "from gateway.video.decoding.decoder import Decoder\n"
        "from tests.video.pictures import coded, units\n"
        "for n in range(20):\n"
        "    decoder = Decoder('auto', threads=4)\n"
        "    for unit in units(coded(12))[: n % 12 + 1]:\n"
        "        decoder.decode(unit, None)\n"
        "    decoder.close()\n"
        "    decoder.close()\n"
        "    del decoder\n"
    )
    subprocess.run([sys.executable, "-c", program], cwd=ROOT, timeout=50, check=True)
