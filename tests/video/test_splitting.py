"""Rules of `gateway.cli.cameras.splitting` and of the verbs that record: what is asked for on the command line is done."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest

from gateway.cli.cameras.commands import carry_out
from gateway.cli.cameras.info import info_of
from gateway.cli.command_line.video_arguments import add_video
from gateway.cli.terminal.ending import ExitStatus
from gateway.errors import Rejected
from gateway.sim.camera.composite import Size
from gateway.sim.camera.film import live
from gateway.sim.camera.hevc import Coding as SimCoding
from gateway.sim.camera.rig import Rig
from gateway.video.decoding.views import VIEWS
from gateway.video.recording.index import index_path
from gateway.video.recording.take import Take
from tests.e2e.system import wait_for
from tests.video.coded import PERIOD_NS, PERIOD_TICKS, units


def ask(*words: str) -> ExitStatus:
    """Carry out `ta2 video WORDS`."""
    top = argparse.ArgumentParser()
    add_video(top.add_subparsers())
    return carry_out(top.parse_args(["video", *words]))


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Forty pictures."""
    take = Take(tmp_path / "take.mkv")
    for unit in units():
        take.write(unit)
    take.end("it was ended")
    return take.path


def test_split_makes_six_files_beside_the_recording(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By default in H.264."""
    assert ask("split", str(recording)) is ExitStatus.OK
    assert {info_of(recording.parent / "take" / f"{view}.mp4").codec for view in VIEWS} == {"h264"}
    assert "6 views, 40 pictures each, 0.867 s, none damaged" in capsys.readouterr().out


def test_split_tells_how_many_pictures_it_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A second sender's, of another size; none of them is damaged."""
    coding = SimCoding(width=320, height=680, gop=10, bit_rate_bps=500_000)
    take = Take(tmp_path / "take.mkv")
    for unit in units():
        take.write(unit)
    for n, picture in enumerate(islice(live(coding, Rig(Size(320, 680), 45, 0)), 12)):
        first, at_ns = units()[0], units()[-1].first_packet_ns + (n + 1) * PERIOD_NS
        is_key = n % 10 == 0
        take.write(
            replace(
                first,
                data=picture.data,
                seq=40 + n,
                rtp_time=n * PERIOD_TICKS,
                first_packet_ns=at_ns,
                life=1,
                ssrc=8,
                is_irap=is_key,
                has_parameter_sets=is_key,
            )
        )
    take.end("it was ended")
    assert take.counts.pictures == 52
    assert ask("split", str(take.path)) is ExitStatus.OK
    assert "40 pictures each, 0.867 s, none damaged, 12 of another size left out" in capsys.readouterr().out


def test_split_does_what_is_asked_for(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Codec, all-intra, views, folder, JSON."""
    index_path(recording).unlink()
    words = ["--codec", "h265", "--all-intra", "--views", "head_left_eye", "--out", str(tmp_path / "x"), "--json"]
    assert ask("split", str(recording), *words) is ExitStatus.OK
    info = info_of(tmp_path / "x" / "head_left_eye.mp4")
    assert (info.codec, info.key_pictures) == ("hevc", 40)
    told = json.loads(capsys.readouterr().out)
    assert (list(told["files"]), told["damaged"]) == (["head_left_eye"], None)


def test_info_tells_what_it_holds(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In words and as JSON."""
    assert ask("info", str(recording)) is ExitStatus.OK
    assert "40 of 160 x 340" in capsys.readouterr().out
    assert ask("info", str(recording), "--json") is ExitStatus.OK
    assert json.loads(capsys.readouterr().out)["key_pictures"] == 4


@pytest.mark.e2e
def test_ctrl_c_leaves_playable_files(tmp_path: Path) -> None:
    """Of a recording that would go on for long."""
    take = Take(tmp_path / "take.mkv")
    for unit in units(200):
        take.write(unit)
    process = subprocess.Popen(
        [sys.executable, "-m", "gateway.cli", "video", "split", str(take.path)],
        env=os.environ | {"PYTHONPATH": os.getcwd()},
        stderr=subprocess.PIPE,
        text=True,
    )
    view = tmp_path / "take" / "head_left_eye.mp4"
    try:
        wait_for(view.exists, "the split to begin")
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
    finally:
        process.kill()
        take.end("it was ended")
    assert process.returncode == 130, said
    assert "what was split until then is playable" in said
    assert info_of(view).timing.pictures >= 1


def test_what_cannot_be_split_is_refused(recording: Path) -> None:
    """With the remedy, before anything is written."""
    with pytest.raises(Rejected, match="no view left"):
        ask("split", str(recording), "--views", "left")
    (recording.parent / "text.mkv").write_text("text")
    with pytest.raises(Rejected, match="cannot be split"):
        ask("split", str(recording.parent / "text.mkv"), "--out", str(recording.parent / "text"))
