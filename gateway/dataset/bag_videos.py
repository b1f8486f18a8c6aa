"""The robot's own videos: what its recorder keeps of each camera, both eyes side by side (the vendor's converter).

A packet counts at its stamp, as other messages do. Libraries: PyAV.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from gateway.dataset.series import Series
from gateway.dataset.videos import VideoSource
from gateway.errors import Code, failure
from gateway.recording.bag_reader import VIDEO_PACKET, Bag
from gateway.recording.bag_writer import needed
from gateway.video.decoding.views import COMPOSITE

__all__ = ["FIELD", "TOPICS", "bag_pictures", "bag_video_sources", "packet_topics"]

TOPICS: Final = {
    "head": "/xr_video_topic/ffmpeg",
    "left_wrist": "/left/color/image_raw/ffmpeg",
    "right_wrist": "/right/color/image_raw/ffmpeg",
}
"""By the begin of the names of its views."""
FIELD: Final = "flags"
"""A number of a packet, read for its time."""


def packet_topics(bag: Bag) -> list[str]:
    """Return the topics of a bag that are videos of the robot's cameras."""
    found = {topic.name for topic in bag.topics if topic.count and topic.type_name == VIDEO_PACKET}
    return [topic for topic in TOPICS.values() if topic in found]


def bag_video_sources(bag: Bag, packets: Mapping[str, Series | None], views: Mapping[str, str]) -> list[VideoSource]:
    """Return the videos of a bag from the first picture on that can be decoded.

    Args:
        bag: It.
        packets: Each topic's packets; None for one without any that can be read.
        views: Which view of the composite each camera is: here the half of a picture that shows the same.

    Raises:
        Rejected: BAD_REQUEST, nothing of a topic can be decoded; PyAV is not installed.
    """
    found = []
    for camera, view in views.items():
        name, _, half = view.removesuffix("_eye").rpartition("_")
        topic, series = TOPICS[name], packets.get(TOPICS[name])
        if topic not in packets:
            continue
        pictures = bag_pictures(bag.path, topic)
        first, number = next(pictures, (None, 0))
        pictures.close()
        if series is None or first is None:
            message, hint = f"{bag.path}: no picture of {topic} can be decoded", "does none in it stand alone?"
            raise failure(Code.BAD_REQUEST, message, field="bag", hint=hint)
        seen = {camera: half if first.width >= 2 * first.height else COMPOSITE}
        is_next = series.messages == np.minimum.accumulate(series.messages[::-1])[::-1]  # no stamp goes back
        is_used = is_next & (series.messages >= number)
        times_ns, pts = series.times_ns[is_used], series.messages[is_used]
        decoded = partial(bag_pictures, bag.path, topic)
        found.append(VideoSource(path=bag.path, times_ns=times_ns, pts=pts, views=seen, topic=topic, decoded=decoded))
    return found


def bag_pictures(path: Path, topic: str) -> Generator[tuple[Any, int], None, None]:
    """Yield what can be decoded of a topic: PyAV's frames, and which message each is, counted from 0.

    Raises:
        Rejected: BAD_REQUEST, the bag cannot be read; PyAV is not installed.
    """
    av, decoder = needed("av", "video"), None
    with Bag(path) as bag:
        try:
            for number, (_, _, message) in enumerate(bag.decoded([topic])):
                if message is not None:
                    decoder = decoder or _decoder(av, message.encoding)
                    packet = av.Packet(message.data.tobytes())
                    packet.pts = packet.dts = number
                    yield from _decoded(av, decoder, packet)
            yield from _decoded(av, decoder, None) if decoder is not None else ()
        finally:
            if decoder is not None:
                decoder.flush_buffers()  # one that is dropped with pictures in it can hang


def _decoder(av: Any, encoding: str) -> Any:  # noqa: ANN401
    """Return a decoder of what a packet says it is: `hevc;...`, or the name of an encoder, as older recorders have it."""
    name = encoding.partition(";")[0].strip()
    codec = next((codec for codec, mark in (("hevc", "265"), ("hevc", "hevc"), ("h264", "264")) if mark in name), name)
    try:
        decoder = av.CodecContext.create(codec, "r")
    except ValueError as error:
        raise failure(Code.BAD_REQUEST, f"there is no decoder of {encoding!r}", field="bag", value=encoding) from error
    decoder.thread_type = "AUTO"
    return decoder


def _decoded(av: Any, decoder: Any, packet: Any) -> list[tuple[Any, int]]:  # noqa: ANN401
    try:
        return [(picture, int(picture.pts)) for picture in decoder.decode(packet) if picture.pts is not None]
    except av.InvalidDataError:
        return []
