"""A recording as a scene: its joints, hands and words at the times of a grid, from its begin on."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from gateway.cli.scene.scene import Scene
from gateway.cli.scene.sink import Sink
from gateway.dataset.resample import resample
from gateway.dataset.series import Instants, Series, read_series
from gateway.errors import Code, failure
from gateway.recording.bag_reader import Bag
from gateway.recording.topics import EPISODES, EVENTS
from gateway.robot.topics import arm_state, ee_pose, joint_command
from gateway.values import Side, Vector

__all__ = ["STALE_NS", "show_bag"]

STALE_NS = 200_000_000
"""Between samples that are farther apart nothing is shown, and live nothing that is older [ns]."""
PLACE, TURN = "position", "orientation"
FIELDS = {"q": (arm_state, PLACE), "q_ref": (joint_command, PLACE), "p": (ee_pose, PLACE), "quat": (ee_pose, TURN)}


def show_bag(bag: Bag, scene: Scene, sink: Sink, rate_hz: float) -> None:
    """Draw all of a bag, so many moments a second [Hz], and wait until nobody looks any more.

    Raises `Rejected`, BAD_REQUEST: there are no joints in it.
    """
    prefix = f"/{bag.facts()['namespace']}" if bag.facts().get("namespace") else ""
    names = {(side, k): (prefix + topic(side), field) for side in Side for k, (topic, field) in FIELDS.items()}
    found = read_series(bag, names.values())
    times_ns = np.arange(bag.begin_ns, bag.end_ns, round(1e9 / rate_hz), dtype=np.int64)
    for at_ns, level, text in _words(bag):
        scene.tell(at_ns - bag.begin_ns, level, text)
    rows = {key: _rows(found[name], times_ns, is_turn=key[1] == "quat") for key, name in names.items() if name in found}
    if not any((side, "q") in rows for side in Side):
        message, hint = f"{bag.path}: no joints of an arm were recorded", "`ta2 bag info` lists what there is"
        raise failure(Code.BAD_REQUEST, message, field="bag", hint=hint)
    for n, at_ns in enumerate(times_ns.tolist()):
        now = {key: row for key, some in rows.items() if (row := some[n])}
        q, q_ref, p, quat = ({side: now[side, k] for side in Side if (side, k) in now} for k in FIELDS)
        hands = {side: (p[side], quat[side]) for side in p if side in quat}
        scene.show(at_ns - int(times_ns[0]), q, q_ref, hands)
        if n % 50 == 0 and not sink.push():
            return
    if sink.push():
        sink.wait()


def _rows(series: Series, times_ns: Instants, *, is_turn: bool) -> list[Vector]:
    """Return the numbers at each time, none where nobody knows."""
    values, ok = resample(series, times_ns, "slerp" if is_turn else "linear", STALE_NS)
    return [tuple(row) if there else () for row, there in zip(values.tolist(), ok.tolist(), strict=True)]


def _words(bag: Bag) -> Iterator[tuple[int, str, str]]:
    """Yield what gateway and users said: when [ns], how loud, and in which words."""
    for topic, at_ns, message in bag.decoded([EVENTS, EPISODES]):
        with suppress(ValueError, KeyError, AttributeError, TypeError):  # what others recorded under such a name
            said = json.loads(message.data)
            if topic == EVENTS:
                yield at_ns, str(said["level"]), f"{said['code']}: {said['message']}"
            else:
                yield (
                    at_ns,
                    "info",
                    f"episode {said['episode']}: {said['event']} {said['task'] or said['text']}".strip(),
                )
