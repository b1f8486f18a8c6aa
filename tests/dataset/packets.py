"""Bags of the robot's own recorder, with its cameras: small pictures that count, both eyes of each side by side."""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import av
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gateway.dataset.bag_videos import TOPICS
from gateway.recording.bag_reader import VIDEO_PACKET, VIDEO_PACKET_FIELDS, Bag
from tests.dataset.motion import BEGIN_NS, CLOCK_NS, DELAY_NS, moving
from tests.video.coded import grey_of

STORE = get_typestore(Stores.ROS2_HUMBLE)
STORE.register(get_types_from_msg(VIDEO_PACKET_FIELDS, VIDEO_PACKET))
SIZES = {topic: (128, 64) if name == "head" else (96, 32) for name, topic in TOPICS.items()}
"""Width and height [pixels]; a wrist's picture is wider than twice its height, as the robot's is."""
GOP = 9
PERIOD_NS = round(1e9 / 45.0)
LATE_NS = 30_000_000
"""From a picture's stamp to its packet's arrival [ns]."""
RIGHT = 40
"""Right eyes are so much brighter."""


@cache
def coded(width: int, height: int, count: int, codec: str = "libx265") -> tuple[bytes, ...]:
    """Return pictures that count, of both eyes, coded."""
    coder = av.CodecContext.create(codec, "w")
    coder.width, coder.height, coder.pix_fmt = width, height, "yuv420p"
    coder.time_base, coder.framerate = Fraction(1, 45), Fraction(45)
    coder.gop_size, coder.max_b_frames = GOP, 0
    options = f"keyint={GOP}:min-keyint={GOP}:scenecut=0:repeat-headers=1:log-level=none:pools=1:frame-threads=1"
    coder.options = {"preset": "ultrafast", "tune": "zerolatency"} | (
        {"x265-params": options} if "265" in codec else {}
    )
    packets = []
    for n in range(count):
        planes = np.full((height * 3 // 2, width), 128, np.uint8)
        planes[:height, : width // 2], planes[:height, width // 2 :] = grey_of(n) - 20, grey_of(n) - 20 + RIGHT
        picture = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        picture.pts, picture.time_base = n, Fraction(1, 45)
        packets += coder.encode(picture)
    return tuple(bytes(packet) for packet in [*packets, *coder.encode(None)])


def packet(n: int, width: int, height: int, data: bytes, encoding: str = "hevc;yuv420p", stamp_ns: int = 0) -> bytes:
    """Return a message."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    header = STORE.types["std_msgs/msg/Header"](
        stamp=STORE.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec), frame_id=""
    )
    message = STORE.types[VIDEO_PACKET](
        header=header,
        width=width,
        height=height,
        encoding=encoding,
        pts=n,
        flags=0,
        is_bigendian=False,
        data=np.frombuffer(data, np.uint8),
    )
    return bytes(STORE.serialize_cdr(message, VIDEO_PACKET))


def vendor_bag(
    folder,
    plugin=StoragePlugin.MCAP,
    *,
    count=40,
    first=0,
    topics=tuple(SIZES),
    encoding="hevc;yuv420p",
    broken=(),
    early=(),
):
    """Write a bag in which the robot moves, filmed from its begin on: pictures `first` and later; return its folder.

    Stamps are of the robot's clock, of the instant of the picture, but those of `early` ones half a second before it; the
    packets come 30 ms later, those of `broken` ones with rubbish.
    """
    robot = moving(folder.with_name(folder.name + ".robot"), 0.9)
    codec = "libx265" if "hevc" in encoding else "libx264"
    rows = []
    with Bag(robot) as bag:
        kinds = {topic.name: topic.type_name for topic in bag.topics}
        rows += [(message.log_ns, message.topic, message.payload) for message in bag.messages()]
    for topic in topics:
        kinds[topic] = VIDEO_PACKET
        for n, data in enumerate(coded(*SIZES[topic], count, codec)):
            at_ns = BEGIN_NS + n * PERIOD_NS
            if n >= first:
                stamp_ns = at_ns - CLOCK_NS - DELAY_NS - (500_000_000 if n in early else 0)
                coded_picture = b"rubbish" if n in broken else data
                rows.append((at_ns + LATE_NS, topic, packet(n, *SIZES[topic], coded_picture, encoding, stamp_ns)))
    with Writer(folder, version=8, storage_plugin=plugin) as writer:
        links = {name: writer.add_connection(name, kind, typestore=STORE) for name, kind in kinds.items()}
        for at_ns, name, payload in sorted(rows, key=lambda row: row[0]):
            writer.write(links[name], at_ns, payload)
    return folder
