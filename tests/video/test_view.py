"""Tests of `ta2 video view`: a window where there can be one, else a file that names each view."""

from __future__ import annotations

import pytest
from PIL import Image

from gateway.cli.cameras.view import view
from gateway.cli.main import main
from gateway.video import Video, VideoTimeout
from gateway.video.window import open_window
from tests.video.stage import HOST, free_udp_port, sending

pytestmark = pytest.mark.e2e


class FivePictures:
    """A window that a person closes after five pictures."""

    def __init__(self):
        self.shown, self.is_closed = [], False

    def show(self, picture):
        self.shown.append(picture)
        return len(self.shown) < 5

    def close(self):
        self.is_closed = True


def a_video():
    """Return one that listens to this host on a free port."""
    return Video(HOST, port=free_udp_port(), host=HOST, decoder="software")


def test_a_window_shows_pictures_until_it_is_closed():
    """Moving ones, at no more than the rate that was asked for."""
    window, video = FivePictures(), a_video()
    with sending(video.receiver.settings.port):
        assert view(video, sheet=None, rate_hz=30.0, timeout_s=20.0, open_one=lambda _: window) == 0
    assert len(window.shown) == 5 and window.is_closed and not video.is_running
    assert any((earlier != later).any() for earlier, later in zip(window.shown, window.shown[1:], strict=False))


def test_without_a_display_a_file_is_written_and_named(tmp_path, monkeypatch, capsys):
    """The reason on standard error, the path on standard output, where a script finds it."""
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    port = free_udp_port()
    with sending(port):
        assert main(["video", "view", "--port", str(port), "--robot", HOST, "--timeout", "20"]) == 0
    read = capsys.readouterr()
    assert "no display" in read.err
    with Image.open(tmp_path / read.out.strip()) as image:
        assert image.format == "JPEG"


def test_a_sheet_that_was_asked_for_goes_where_it_was_asked_to(tmp_path, capsys):
    """Also where there is a display."""
    path, port = tmp_path / "sheet.jpg", free_udp_port()
    with sending(port):
        words = ["video", "view", "--port", str(port), "--any-source", "--timeout", "20", "--sheet", str(path)]
        assert main([*words, "--decoder", "software", "--strict"]) == 0
    assert capsys.readouterr().out == f"{path}\n" and path.stat().st_size > 1000


def test_no_picture_is_status_3_and_says_why(capsys):
    """As for a gateway that does not answer; one line."""
    assert main(["video", "view", "--port", str(free_udp_port()), "--robot", HOST, "--timeout", "0.05"]) == 3
    read = capsys.readouterr()
    assert "0.05 s" in read.err and " -> " in read.err and read.out == ""


def test_a_stream_that_ends_closes_the_window(monkeypatch):
    """It says why, instead of showing an old picture as if it were live."""
    monkeypatch.setattr("gateway.cli.cameras.view.SILENCE_S", 0.2)
    window, video = FivePictures(), a_video()
    with pytest.raises(VideoTimeout, match=r"0\.2 s"), sending(video.receiver.settings.port) as sender:

        def show(picture):
            sender.is_silent = True
            return True

        window.show = show
        view(video, sheet=None, rate_hz=30.0, timeout_s=20.0, open_one=lambda _: window)
    assert window.is_closed and not video.is_running


def test_a_port_in_use_is_a_usage_error(capsys):
    """Status 2, and it names the port."""
    with a_video() as video:
        assert main(["video", "view", "--port", str(video.port), "--robot", HOST]) == 2
    assert capsys.readouterr().err.startswith("PORT_BUSY: ")


def test_a_display_that_cannot_be_reached_is_a_reason_and_no_crash(monkeypatch):
    """Tk says so; OpenCV is only asked where it has windows at all."""
    pytest.importorskip("tkinter")
    monkeypatch.setenv("DISPLAY", "127.0.0.1:97")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setitem(__import__("sys").modules, "cv2", None)
    reason = open_window("a title")
    assert isinstance(reason, str) and "Tk cannot open a window" in reason and "OpenCV is not installed" in reason
