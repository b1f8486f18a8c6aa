"""Recording: what a message costs beside the libraries' own writers, and a recorder beside a process that only subscribes.

Each takes turns with its peers in one run. A message is one of the robot's own, 1,420 a second; the writers compress as ours.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from gateway.recording.bag_writer import CHUNK_BYTES
from gateway.recording.recorder import Recorder
from tests.bench.processor import cpu_row, favour, peer_of
from tests.bench.streams import DRIVER
from tests.bench.table import Row
from tests.e2e.system import Process, System, wait_for
from tests.recording.bags import BEGIN_NS, TOPICS, payload

__all__ = ["data_rows"]

MESSAGES = 40_000
ROUNDS = 5
STEP = 360
"""Messages that come between two steps of a recorder."""
GOAL_US = 6.0


def _messages() -> list[tuple[int, int, bytes]]:
    """Return topic, time [ns] and payload of so many messages, mixed as a robot sends them."""
    fast = [n for n, topic in enumerate(TOPICS) if topic.rate_hz >= 200.0]
    return [
        (number, at_ns, payload(TOPICS[number], at_ns))
        for n in range(MESSAGES)
        for number, at_ns in ((fast[n % len(fast)], BEGIN_NS + n * 700_000),)
    ]


def _ours(folder: Path, messages: list[tuple[int, int, bytes]]) -> None:
    recorder = Recorder(folder, TOPICS, {}, wall_ns=lambda: BEGIN_NS, clock=lambda: BEGIN_NS)
    for n, (number, at_ns, data) in enumerate(messages):
        recorder.take(number, at_ns, data)
        if n % STEP == 0:
            recorder.step(at_ns)
    recorder.finish()


def _mcap(folder: Path, messages: list[tuple[int, int, bytes]]) -> None:
    folder.mkdir()
    with (folder / "bag.mcap").open("wb") as file:
        writer = McapWriter(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        schema = writer.register_schema(name="any", encoding="ros2msg", data=b"")
        channels = [writer.register_channel(topic.name, "cdr", schema) for topic in TOPICS]
        for number, at_ns, data in messages:
            writer.add_message(channels[number], at_ns, data, at_ns)
        writer.finish()


def _rosbags(folder: Path, messages: list[tuple[int, int, bytes]]) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = RosbagsWriter(folder, version=8, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = [writer.add_connection(topic.name, topic.type_name, typestore=store) for topic in TOPICS]
        for number, at_ns, data in messages:
            writer.write(connections[number], at_ns, data)


def _best_us(
    write: Callable[[Path, list[tuple[int, int, bytes]]], None], folder: Path, messages: list[tuple[int, int, bytes]]
) -> float:
    begun = time.process_time()
    write(folder / "bag", messages)
    used = time.process_time() - begun
    shutil.rmtree(folder / "bag")
    return used / len(messages) * 1e6


def _writer_rows(folder: Path) -> list[Row]:
    messages, writers = _messages(), {"ours": _ours, "mcap": _mcap, "rosbags": _rosbags}
    best = dict.fromkeys(writers, float("inf"))
    for _ in range(ROUNDS):
        for name, write in writers.items():
            best[name] = min(best[name], _best_us(write, folder, messages))
    return [
        Row(
            name=f"a message into a bag, beside {peer}'s own writer",
            ours=f"{best['ours']:.1f} µs",
            peer=f"{best[peer]:.1f} µs",
            ratio=f"{best['ours'] / best[peer]:.2f}x",
            goal=f"<= {GOAL_US:g} µs" if peer == "mcap" else "",
            good=best["ours"] <= GOAL_US if peer == "mcap" else None,
        )
        for peer in ("mcap", "rosbags")
    ]


def data_rows(folder: Path, seconds: float) -> list[Row]:
    """Measure recording.

    Args:
        folder: For bags, sockets and logs.
        seconds: How long the recorder is watched [s].
    """
    rows = _writer_rows(folder)
    system = System(folder)
    out = ["--out", str(folder / "bag"), "--socket", system.target]
    processes: list[Process] = []
    try:
        system.connect("bench").close()  # the robot is there
        subscriber = Process("subscriber", peer_of(system.endpoint), folder)
        processes.append(subscriber)
        driver = system.client("driver", DRIVER)
        wait_for(lambda: "driving" in driver.text(), "a driver", tell=driver.text)
        recorder = Process("record", ["-m", "gateway.cli", "record", *out], folder)
        processes.append(recorder)
        wait_for(
            lambda: "record: 0" in recorder.text() or " messages" in recorder.text(), "a recording", tell=recorder.text
        )
        wait_for(lambda: "ready" in subscriber.text(), "the plain subscriber", tell=subscriber.text)
        favour(driver)
        rows.append(cpu_row("ta2 record under full load", [recorder.pid], subscriber.pid, time.sleep, seconds, None))
    finally:
        for process in processes:
            process.end()
        system.close()
    return rows
