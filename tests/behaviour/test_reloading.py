"""BEHAVIOUR, Settings read anew: nothing that is on the wire changes by it; what is asked for next is judged by it."""

from __future__ import annotations

from itertools import pairwise

import pytest

from gateway.core.messages.events import SettingsRead
from gateway.core.messages.outputs import Frame
from gateway.errors import Code
from gateway.messages.requests import DriveChassis, Move, OpenStream
from gateway.robot.topics import CHASSIS_VELOCITY
from gateway.settings.motion import ArmSettings
from gateway.values import Side, Vector
from tests.behaviour.scene import HOME, Scene, scene
from tests.pair import S

LOWERED = {
    "arm.v_radps": 0.3,
    "arm.settle_rad": 0.01,
    "arm.target_expiry_ns": 300_000_000,
    "arm.start_margin_rad": 0.0,
    "chassis.v_mps": 0.1,
    "chassis.w_radps": 0.1,
    "chassis.expiry_ns": 100_000_000,
    "lift.v_max": 0.1,
    "lift.expiry_ns": 100_000_000,
    "pose.v_mps": 0.05,
    "pose.w_radps": 0.1,
    "pose.settle_m": 0.001,
    "pose.start_margin_m": 0.0,
    "local.demand_stop_endpoint": True,
}


def read_anew(pair: Scene, **how: object) -> None:
    """The daemon has read its file."""
    pair.receive(SettingsRead(**{"values": LOWERED, "message": "arm.v_radps = 0.3", "at_ns": pair.now_ns, **how}))


def turned(pair: Scene, by_rad: float) -> Vector:
    """Where the left arm is held, its first joint turned."""
    first, *others = pair.arm_frames_now()[Side.LEFT]
    return first + by_rad, *others


def course(state: str, seconds: float, **how: object) -> tuple[list[tuple[int, Frame]], str]:
    """What leaves from a state on, and where that ends, with a reading (or, with `values` None, without)."""
    pair = scene(state)
    pair.mark()
    if how.get("values", ()) is not None:
        read_anew(pair, **how)
    pair.run(seconds)
    return [(at_ns, frame) for at_ns, frame in pair.frames if at_ns >= pair.mark_ns], pair.state


STATES = ("READ_ONLY", "IDLE", "ENABLING", "at rest", "ACTIVE", "HOLDING", "PAUSED", "STOPPING", "STALE", "OFFLINE")


@pytest.mark.parametrize("state", STATES)
def test_nothing_on_the_wire_changes_by_a_reading(state: str) -> None:
    """In any state, every frame is bit for bit the one that it would have been: nothing jumps, nothing ends."""
    assert course(state, 0.6) == course(state, 0.6, values=None)


def test_a_motion_under_way_ends_as_it_began_and_the_next_one_obeys() -> None:
    """The first is not slowed, nor made to wait; the second has the new limit, and the acceleration and jerk of the first."""
    pair = scene("at rest")
    pair.granted(Move(epoch=pair.epoch, targets_rad={Side.LEFT: turned(pair, 1.0)}), "ann")
    pair.run(0.5)
    read_anew(pair, values={"arm.v_radps": 0.3})
    pair.mark()
    pair.run_until(lambda: bool(pair.told(Code.MOTION_ENDED)), 5.0)
    assert max(pair.speeds()) > 0.6 and "reached" in pair.told(Code.MOTION_ENDED)[-1]
    pair.mark()
    pair.granted(Move(epoch=pair.epoch, targets_rad=HOME), "ann")
    pair.run_until(lambda: bool(pair.told(Code.MOTION_ENDED)), 10.0)
    assert (
        max(map(max, map(pair.speeds, Side))) == pytest.approx(0.3, rel=1e-3)
        and "reached" in pair.told(Code.MOTION_ENDED)[-1]
    )


def test_a_motion_that_takes_over_from_a_faster_one_brakes_to_the_new_limit() -> None:
    """Inside the limits of acceleration and jerk; the gate, which judges every frame, has nothing to object to."""
    pair = scene("at rest")
    goal = {Side.LEFT: turned(pair, 1.0)}
    pair.granted(Move(epoch=pair.epoch, targets_rad=goal), "ann")
    pair.run(0.6)
    pair.mark()
    read_anew(pair, values={"arm.v_radps": 0.2})
    pair.granted(Move(epoch=pair.epoch, targets_rad=goal), "ann")
    pair.run(0.6)
    speeds, arm = pair.speeds(), ArmSettings()
    assert speeds[0] > 0.6 and speeds[-1] == pytest.approx(0.2, rel=1e-3)
    assert max(abs(b - a) for a, b in pairwise(speeds)) <= arm.a_radps2 * 0.01 + 1e-6
    assert not pair.engine.latches


def test_a_stream_under_way_brakes_to_the_new_limit_with_its_next_target() -> None:
    """The arm is neither stopped nor left as fast as it was."""
    pair = scene("at rest")
    goal = turned(pair, 1.2)
    stream_id = pair.granted(OpenStream(epoch=pair.epoch, side=Side.LEFT), "ann")["stream_id"]
    for tick in range(120):
        if tick == 60:
            pair.mark()
            read_anew(pair, values={"arm.v_radps": 0.2})
        pair.target(pair.epoch, stream_id, goal, "ann")
        pair.run(0.01)
    speeds = pair.speeds()
    assert speeds[0] > 0.6 and speeds[-1] == pytest.approx(0.2, rel=1e-3)
    assert max(abs(b - a) for a, b in pairwise(speeds)) <= ArmSettings().a_radps2 * 0.01 + 1e-6
    assert not pair.engine.latches


def test_a_chassis_that_is_too_fast_now_ramps_down_when_its_velocity_expires() -> None:
    """The next velocity is refused with the new bound; a slower one is driven."""
    pair = scene("IDLE")
    drive = DriveChassis(epoch=pair.epoch, vx_mps=0.3, vy_mps=0.0, wz_radps=0.0)
    for _ in range(12):
        pair.granted(drive, "ann")
        pair.run(0.1)
    read_anew(pair, values={"chassis.v_mps": 0.1})
    pair.mark()
    assert pair.refused(drive, "ann").code is Code.OUT_OF_RANGE
    pair.run(1.5)
    speeds = [vx for vx, _, _ in pair.values(CHASSIS_VELOCITY)]
    assert speeds[0] == pytest.approx(0.3) and speeds[-1] == 0.0 and sorted(speeds, reverse=True) == speeds
    pair.granted(DriveChassis(epoch=pair.epoch, vx_mps=0.1, vy_mps=0.0, wz_radps=0.0), "ann")


def test_a_limit_that_is_raised_again_is_that_of_the_next_motion() -> None:
    """Never above the one of the start, whatever an event says."""
    pair = scene("at rest")
    for v_radps, by_rad in ((0.2, 1.0), (1.0, -1.0), (1.5, 1.0)):
        read_anew(pair, values={"arm.v_radps": v_radps})
        pair.mark()
        pair.granted(Move(epoch=pair.epoch, targets_rad={Side.LEFT: turned(pair, by_rad)}), "ann")
        pair.run_until(lambda: bool(pair.told(Code.MOTION_ENDED)), 10.0)
        assert max(pair.speeds()) == pytest.approx(min(v_radps, 1.0), rel=1e-3) and not pair.engine.latches


def test_what_is_refused_changes_nothing_and_everybody_hears_of_it() -> None:
    """Event, state and log have the reason; the wire is as without it."""
    refused = {"values": {}, "message": "needs a restart: arm.rate_hz", "is_refused": True}
    assert course("ACTIVE", 0.6, **refused) == course("ACTIVE", 0.6, values=None)
    pair = scene("ACTIVE", Scene(snapshot_hz=50))
    read_anew(pair, **refused)
    read_ns = pair.now_ns
    pair.run(0.1)
    assert pair.told(Code.SETTINGS_REFUSED) == ["the settings stay as they are: needs a restart: arm.rate_hz"]
    seen = pair.see()
    assert (seen.settings_read_ns, seen.settings_refused) == (read_ns, "needs a restart: arm.rate_hz")


def test_an_endpoint_that_is_demanded_from_now_on_ends_nothing_that_moves() -> None:
    """The next request is refused."""
    pair = scene("ACTIVE")
    read_anew(pair, values={"local.demand_stop_endpoint": True})
    pair.run(0.2)
    assert pair.state == "ACTIVE"
    assert pair.refused(Move(epoch=pair.epoch, targets_rad=HOME), "ann").code is Code.ENDPOINT_MISSING
    assert pair.now_ns > S
