"""Rules of `gateway.cli.cameras.check`: the manual's acceptance of the video (§2.7.2), and why a point fails."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from gateway.cli.cameras.check import check
from gateway.cli.terminal.ending import ExitStatus
from gateway.video.decoding.views import VIEWS
from gateway.video.video import Video
from tests.video.sending import camera, udp_port

pytestmark = pytest.mark.e2e


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A cache folder of the tests' own for the camera's loop."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
    yield


def test_a_good_stream_passes_and_leaves_six_views(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """First picture in time, packets and pictures rising, six files, the rate measured."""
    port = udp_port()
    with camera(port):
        status = check(
            Video("127.0.0.1", port=port, decoder="software"),
            seconds=3.0,
            first_s=20.0,
            folder=tmp_path / "kept",
            as_json=True,
        )
    report = json.loads(capsys.readouterr().out)
    assert status is ExitStatus.OK, report
    assert report["ok"] is True
    assert [point["ok"] for point in report["points"]] == [True] * 4
    assert 20.0 < report["fps"] < 45.5  # a camera that gets no processor skips periods
    assert report["first_s"] < 20.0
    assert report["counts"]["packets"] > 100
    assert report["recording"]["timing"]["pictures"] > 90
    names = {path.name for path in (tmp_path / "kept").iterdir()}
    assert {f"{view}.mp4" for view in VIEWS} | {"check.mkv", "check.mkv.jsonl", "damaged.json"} == names


def test_without_a_stream_each_point_fails_and_says_why(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In words, and nothing is left behind."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    status = check(
        Video("127.0.0.1", port=udp_port(), decoder="software"), seconds=1.0, first_s=0.5, folder=None, as_json=False
    )
    said = capsys.readouterr().out.splitlines()
    assert status is ExitStatus.REFUSED
    assert [line[:4] for line in said if not line.startswith("   ")][:4] == ["FAIL"] * 4
    for line, following in pairwise(said):
        assert not line.startswith("FAIL") or following.startswith("       ")
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_payload_type_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    """What fails says why, as far as it can be known."""
    port = udp_port()
    with camera(port, "--payload-type", "97"):
        video = Video("127.0.0.1", port=port, decoder="software")
        status = check(video, seconds=1.0, first_s=4.0, folder=None, as_json=True)
    report = json.loads(capsys.readouterr().out)
    assert status is ExitStatus.REFUSED
    assert report["points"][0]["why"][0].startswith("WRONG_PAYLOAD_TYPE: ")
    assert "97" in report["points"][0]["why"][0]


@pytest.mark.thorough
def test_a_stream_that_stops_fails_the_second_point(capsys: pytest.CaptureFixture[str]) -> None:
    """Packets and pictures must become more in each second."""
    port = udp_port()
    with camera(port, "--for", "1.5"):
        status = check(
            Video("127.0.0.1", port=port, decoder="software"), seconds=4.0, first_s=20.0, folder=None, as_json=True
        )
    report = json.loads(capsys.readouterr().out)
    assert status is ExitStatus.REFUSED
    assert [point["ok"] for point in report["points"]] == [True, False, True, True]
    assert any(why.startswith("no packets in second") for why in report["points"][1]["why"])
    assert report["folder"] is None
