"""Tests of the manual's receiver class (§5.2, §6.9) on ours: same arguments, same methods, programs run as they are."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gateway.cli.cameras.shim import MODULE
from gateway.cli.main import main
from gateway.video import RTPH265VideoInterface, VideoError
from tests.video.code_reader import read_code, read_composite
from tests.video.stage import HOST, free_udp_port, sending, until

ROOT = Path(__file__).resolve().parents[2]
KEYS = {
    "head_camera",
    "head_right_eye",
    "head_left_eye",
    "left_wrist_left_eye",
    "left_wrist_right_eye",
    "right_wrist_left_eye",
    "right_wrist_right_eye",
}

PROGRAM = '''
"""What the manual's recorder asks of the interface, in its order (§6.8), with a JSON line instead of files."""
import json, signal, sys, threading, time
try:
    from .rtp_video_interface import RTPH265VideoInterface
except ImportError:
    from rtp_video_interface import RTPH265VideoInterface

ended = threading.Event()
signal.signal(signal.SIGTERM, lambda number, frame: ended.set())
interface = RTPH265VideoInterface(
    camera_name="head_camera", port=int(sys.argv[1]), payload=96, udp_buffer_size=20_000_000,
    decoder="nvh265dec max-display-delay=0", log_interval_s=0.2,
)
counts, shapes, last = {}, {}, {}
interface.start()
try:
    if not interface.wait_for_initial_data(timeout=20.0):
        raise SystemExit(1)
    began = time.monotonic()
    while not ended.is_set() and time.monotonic() - began < 1.0:
        images, timestamps = interface.get_latest_images_with_timestamps()
        for name in interface.split_image_names:
            image, stamp = images.get(name), timestamps.get(name)
            if image is None or stamp is None or last.get(name) == stamp:
                continue
            image[:4] = 0
            last[name], shapes[name] = stamp, image.shape
            counts[name] = counts.get(name, 0) + 1
        if interface.wait(timeout=0.002):
            raise SystemExit(2)
finally:
    interface.stop()
print(json.dumps({"counts": counts, "shapes": shapes}))
'''


@pytest.mark.e2e
def test_a_program_that_imports_the_manuals_module_runs_unchanged(tmp_path, capsys):
    """`ta2 video shim` puts the module beside it; every view is counted once per frame, in the size of its box."""
    (tmp_path / "record.py").write_text(PROGRAM)
    assert main(["video", "shim", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"{tmp_path / MODULE}\n"
    port = free_udp_port()
    with sending(port):
        ended = subprocess.run(
            [sys.executable, str(tmp_path / "record.py"), str(port)],
            env={"PYTHONPATH": str(ROOT)},
            cwd=tmp_path,
            timeout=60,
            check=True,
            capture_output=True,
            text=True,
        )
    told = json.loads(ended.stdout)
    assert set(told["counts"]) == KEYS - {"head_camera"} and set(told["counts"].values()) == {
        max(told["counts"].values())
    }
    assert max(told["counts"].values()) > 3 and told["shapes"]["head_left_eye"] == [120, 120, 3]


@pytest.mark.e2e
def test_images_are_writable_copies_of_one_frame(caplog):
    """All of §5.2's keys; writing into one changes nothing else; the log tells the first frame and the rates."""
    caplog.set_level(logging.INFO)
    interface = RTPH265VideoInterface(port=0, decoder="avdec_h265", log_interval_s=0.1, source=HOST)
    assert interface.get_observation() is None and interface.get_latest_image() is None
    assert interface.get_latest_images() == {} and interface.latest_images == {} == interface.image_timestamps
    assert not interface.has_initial_frame()
    interface.start()
    interface.start()
    try:
        with sending(interface.video.port):
            assert interface.wait_for_initial_data(timeout=20.0) and interface.has_initial_frame()
            until(lambda: "fps=" in caplog.text, "a line of statistics")
            images, timestamps = interface.get_latest_images_with_timestamps()
            observation = interface.get_observation()
            assert set(images) == set(timestamps) == set(observation["images"]) == KEYS
            assert len(set(timestamps.values())) == 1 and abs(time.time() - timestamps["head_camera"]) < 20.0
            counter = read_composite(images["head_camera"])
            assert {read_code(images[name]) for name in interface.split_image_names} == {counter} != {None}
            for image in (*images.values(), interface.get_latest_image()):
                image[:] = 0
            assert interface.get_latest_image().any()
            assert set(interface.latest_images) == KEYS == set(interface.image_timestamps)
            with pytest.raises(ValueError, match="read-only"):
                interface.latest_images["head_camera"][:] = 0
            assert not interface.wait(timeout=0.002)
    finally:
        interface.stop()
    interface.stop()
    assert "Initial video frame received" in caplog.text and "software" in caplog.text
    assert interface.get_latest_image().any()


@pytest.mark.e2e
def test_a_wait_without_a_sender_says_why_in_the_log(caplog):
    """False, as in the manual, and the numbers that tell whether anything came."""
    interface = RTPH265VideoInterface(port=0)
    interface.start()
    try:
        assert not interface.wait_for_initial_data(timeout=0.05)
    finally:
        interface.stop()
    assert "rtp_packets=0" in caplog.text


@pytest.mark.e2e
def test_a_failure_of_its_threads_ends_the_wait(caplog):
    """`wait` is how the manual's programs learn of it."""
    interface = RTPH265VideoInterface(port=0)
    interface.start()
    try:
        interface.video.newest.close(ZeroDivisionError("in a thread"))
        assert interface.wait(timeout=20.0) and "in a thread" in caplog.text
    finally:
        interface.stop()


@pytest.mark.e2e
def test_a_port_that_is_taken_is_told_at_the_start():
    """The manual's class only logs it and waits in vain."""
    first = RTPH265VideoInterface(port=0)
    first.start()
    try:
        second = RTPH265VideoInterface(port=first.video.port)
        with pytest.raises(VideoError, match="PORT_BUSY"):
            second.start()
        second.stop()
    finally:
        first.stop()


def test_a_module_of_that_name_that_is_not_ours_is_left_alone(tmp_path, capsys):
    """It may be the manual's own."""
    assert main(["video", "shim", str(tmp_path)]) == 0
    assert main(["video", "shim", str(tmp_path)]) == 0
    (tmp_path / MODULE).write_text("import gi\n")
    assert main(["video", "shim", str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith("CANNOT_WRITE: ") and (tmp_path / MODULE).read_text() == "import gi\n"
    assert main(["video", "shim", str(tmp_path / "nowhere")]) == 1
