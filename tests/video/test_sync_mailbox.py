"""Rules of `gateway.sim.camera.mailbox`: the synchronisation of §5.5, for all orders in which cameras can deliver."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.sim.camera.mailbox import Mailboxes, Shot

CAMERAS = 4
PERIOD_MS = 22

arrivals = st.lists(st.tuples(st.integers(0, CAMERAS - 1), st.integers(0, 6), st.booleans()), max_size=60)
"""Camera, how many triggers it went on since its last picture (0: a stamp twice), whether somebody takes after it."""


def boxes_with(*stamps: int) -> Mailboxes[str]:
    """Return full mailboxes."""
    boxes: Mailboxes[str] = Mailboxes(len(stamps))
    for camera, stamp in enumerate(stamps):
        boxes.put(camera, Shot(stamp, f"camera {camera} at {stamp}"))
    return boxes


def run(boxes: Mailboxes[str], events: list[tuple[int, int, bool]]) -> list[tuple[int, ...]]:
    """Deliver and take; return the stamps of each set that left."""
    last = [0] * CAMERAS
    left = []
    for camera, step, is_taken in events:
        last[camera] += step * PERIOD_MS
        boxes.put(camera, Shot(last[camera], ""))
        shots = boxes.take() if is_taken else None
        if shots is not None:
            left.append(tuple(shot.trig_ms for shot in shots))
    return left


@given(arrivals)
def test_what_leaves_has_one_stamp_and_never_goes_back(events):
    """Whatever was late, lost or doubled."""
    left = run(Mailboxes(CAMERAS), events)
    assert all(len(set(stamps)) == 1 and len(stamps) == CAMERAS for stamps in left)
    stamps = [stamps[0] for stamps in left]
    assert stamps == sorted(stamps)


@given(arrivals)
def test_every_picture_is_in_exactly_one_place(events):
    """Put = waiting + stitched + overwritten + dropped; each failed comparison drops at least one, never all."""
    boxes: Mailboxes[str] = Mailboxes(CAMERAS)
    left = run(boxes, events)
    assert boxes.stitched == len(left)
    places = boxes.waiting + CAMERAS * boxes.stitched + sum(boxes.overwritten) + sum(boxes.dropped)
    assert places == len(events)
    assert boxes.ts_drop <= sum(boxes.dropped) <= (CAMERAS - 1) * boxes.ts_drop


@given(arrivals, st.permutations(range(CAMERAS)))
def test_nothing_waits_once_all_cameras_deliver(events, order):
    """Whatever happened before: the next trigger that all four deliver, in any order, leaves with the last of them."""
    boxes: Mailboxes[str] = Mailboxes(CAMERAS)
    run(boxes, events)
    stamp = 1_000_000
    *early, last = order
    for camera in early:
        boxes.put(camera, Shot(stamp, ""))
        assert boxes.take() is None
    boxes.put(last, Shot(stamp, ""))
    shots = boxes.take()
    assert shots is not None and {shot.trig_ms for shot in shots} == {stamp}
    assert boxes.waiting == 0


@given(st.lists(st.permutations(range(CAMERAS)), max_size=20))
def test_healthy_cameras_lose_nothing(orders):
    """One picture of each per trigger, in any order: all are stitched, nothing is counted."""
    boxes: Mailboxes[str] = Mailboxes(CAMERAS)
    for number, order in enumerate(orders):
        for camera in order:
            boxes.put(camera, Shot(number * PERIOD_MS, ""))
            boxes.take()
    assert (boxes.stitched, boxes.ts_drop, boxes.overwritten) == (len(orders), 0, [0] * CAMERAS)


def test_pictures_leave_in_the_order_of_the_cameras():
    """Not in that of their arrival."""
    shots = boxes_with(5, 5, 5, 5).take()
    assert shots is not None
    assert [shot.picture for shot in shots] == [f"camera {camera} at 5" for camera in range(4)]


def test_only_the_oldest_is_dropped_and_the_others_wait_for_its_next():
    """Manual §5.5: the rest keep their newer pictures."""
    boxes = boxes_with(22, 0, 22, 22)
    assert boxes.take() is None
    assert (boxes.ts_drop, boxes.dropped, boxes.waiting) == (1, [0, 1, 0, 0], 3)
    boxes.put(1, Shot(22, "late"))
    assert boxes.take() is not None


def test_all_that_are_equally_old_are_dropped_at_once():
    """The camera that is ahead never goes back: none of them can match any more. One comparison, one count."""
    boxes = boxes_with(0, 0, 22, 0)
    assert boxes.take() is None
    assert (boxes.ts_drop, boxes.dropped, boxes.waiting) == (1, [1, 1, 0, 1], 1)


def test_a_newer_picture_overwrites_and_is_counted():
    """The mailbox has one slot."""
    boxes = boxes_with(0, 0)
    boxes.put(0, Shot(22, "newer"))
    assert boxes.overwritten == [1, 0]


def test_stamps_that_are_always_one_apart_never_match():
    """The comparison is exact: the counter tells it."""
    boxes: Mailboxes[str] = Mailboxes(2)
    for number in range(10):
        for camera in (0, 1):
            boxes.put(camera, Shot(number * PERIOD_MS + camera, ""))
            assert boxes.take() is None
    assert boxes.stitched == 0
    assert boxes.ts_drop == 19


def test_a_camera_that_is_not_there_is_refused():
    """With the range."""
    with pytest.raises(IndexError, match=r"camera 4 is outside \[0, 3\]"):
        Mailboxes(4).put(4, Shot(0, ""))
    with pytest.raises(IndexError, match="camera -1"):
        Mailboxes(4).put(-1, Shot(0, ""))
    with pytest.raises(ValueError, match="at least one"):
        Mailboxes(0)
