"""Codec: encode and decode of the hot types against pycdr2 and rosbags, alternating in one process."""

from __future__ import annotations

import time
from collections.abc import Callable

from rosbags.typesys import Stores, get_typestore

from cdr_types import decode, encode, type_name
from cdr_types.messages import geometry_msgs, sensor_msgs, std_msgs
from gateway.robot.topics import ARM_JOINTS
from gateway.values import Side
from tests.bench.table import Row

__all__ = ["codec_rows"]

ROUNDS = 40
LOOPS = 200


def _messages() -> dict[str, object]:
    joints = list(ARM_JOINTS[Side.LEFT])
    seven = [0.1 * n for n in range(7)]
    return {
        "JointState (7)": sensor_msgs.JointState(
            header=std_msgs.Header(frame_id="left_arm"), name=joints, position=seven, velocity=seven, effort=seven
        ),
        "Pose": geometry_msgs.Pose(
            position=geometry_msgs.Point(x=0.1, y=0.2, z=-0.4), orientation=geometry_msgs.Quaternion(w=1.0)
        ),
        "Float32": std_msgs.Float32(data=1.0),
        "Float32MultiArray (3)": std_msgs.Float32MultiArray(data=[0.1, 0.0, 0.2]),
        "Int32": std_msgs.Int32(data=2),
    }


def best_us(*calls: Callable[[], object]) -> list[float]:
    """Return the best mean time of each call [us]; the calls take turns, so a busy moment hits all of them."""
    best = [float("inf")] * len(calls)
    for _ in range(ROUNDS):
        for n, call in enumerate(calls):
            begun = time.perf_counter_ns()
            for _ in range(LOOPS):
                call()
            best[n] = min(best[n], (time.perf_counter_ns() - begun) / LOOPS / 1e3)
    return best


def codec_rows() -> list[Row]:
    """Measure all hot types."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    goals = {("JointState (7)", "decode"): 10.0, ("JointState (7)", "encode"): 6.0}
    rows = []
    for name, message in _messages().items():
        kind = type(message)
        payload = encode(message)
        ros_name = type_name(kind)
        ros_message = store.deserialize_cdr(payload, ros_name)
        decoding = best_us(
            lambda payload=payload, kind=kind: decode(payload, kind),
            lambda payload=payload, kind=kind: kind.deserialize(payload),
            lambda payload=payload, ros_name=ros_name: store.deserialize_cdr(payload, ros_name),
        )
        encoding = best_us(
            lambda message=message: encode(message),
            lambda message=message: message.serialize(),
            lambda ros_message=ros_message, ros_name=ros_name: store.serialize_cdr(ros_message, ros_name),
        )
        for way, (ours, pycdr2, rosbags) in (("decode", decoding), ("encode", encoding)):
            goal = goals.get((name, way))
            rows.append(
                Row(
                    name=f"{way} {name}",
                    ours=f"{ours:.2f} us",
                    peer=f"pycdr2 {pycdr2:.1f} us, rosbags {rosbags:.1f} us",
                    ratio=f"{pycdr2 / ours:.1f}x, {rosbags / ours:.1f}x",
                    goal=f">= {goal:g}x pycdr2" if goal else "",
                    good=pycdr2 / ours >= goal if goal else None,
                )
            )
    return rows
