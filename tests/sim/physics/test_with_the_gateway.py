"""The gateway's engine against the robot on physics, in virtual time: what a user asks is done, and within its tolerances."""

from __future__ import annotations

import pytest

from gateway.errors import Code
from gateway.messages.requests import DriveChassis, SetGripper, Stop
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import ArmSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.pair import MS, Pair
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)

HOME = HOME_Q_RAD


@pytest.fixture
def pair() -> Pair:
    """An engine that drives a robot with forces."""
    return Pair(sim=SimSettings(physics="mujoco", state_period_ns=10 * MS))


def ended(pair: Pair) -> list[object]:
    """How motions ended."""
    return [notice.facts["state"] for notice in pair.notices if notice.code is Code.MOTION_ENDED]


def test_home_is_reached_at_full_speed_without_a_latch(pair):
    """Both arms from hanging to §6.6's home by default limits: reached, within tolerance, no tracking error on the way."""
    epoch = pair.activate()
    pair.move(epoch, HOME)
    worst_rad = 0.0
    while not ended(pair):
        pair.run(0.01)
        worst_rad = max(worst_rad, *(arm.deviation_rad for arm in pair.robot.arms.values()))
    assert ended(pair) == ["reached"]
    assert worst_rad < 0.15  # the aborting bound is 0.3
    assert Code.LATCH_CHANGED not in pair.codes()


def test_the_fastest_limits_stay_within_the_bound_on_the_tracking_error():
    """3 rad/s, 15 rad/s², 300 rad/s³: home and back are reached; 0.3 rad would abort."""
    arm = ArmSettings(v_radps=3.0, a_radps2=15.0, j_radps3=300.0)
    pair = Pair(Settings(arm=arm), SimSettings(physics="mujoco", state_period_ns=10 * MS))
    epoch = pair.activate()
    hanging = {side: tuple(arm.q_rad.tolist()) for side, arm in pair.robot.arms.items()}
    worst_rad = 0.0
    for number, goal in enumerate((HOME, hanging), start=1):
        pair.move(epoch, goal)
        while len(ended(pair)) < number:
            pair.run(0.01)
            worst_rad = max(worst_rad, *(arm.deviation_rad for arm in pair.robot.arms.values()))
    assert ended(pair) == ["reached", "reached"]
    assert 0.1 < worst_rad < 0.28


def test_an_arm_that_meets_the_table_is_stopped_and_gives_way():
    """The base carries stretched hands against the table; TRACKING_ERROR, no further, and no motor strains against it."""
    pair = Pair(sim=SimSettings(physics="mujoco", state_period_ns=10 * MS))
    epoch = pair.activate()
    pair.move(epoch, HOME)
    pair.run_until(lambda: bool(ended(pair)))
    drive = DriveChassis(epoch=epoch, vx_mps=0.2, vy_mps=0.0, wz_radps=0.0, expiry_ns=3_000 * MS)
    pair.granted(drive)
    pair.run_until(lambda: "TRACKING_ERROR" in pair.see().latches, 8.0)
    world = pair.robot.dynamics.world
    straining = abs(world.data.actuator_force).max()
    pair.run(3.0)
    assert 0.15 < world.base()[0] < 0.75
    assert pair.robot.chassis.velocity == [0.0, 0.0, 0.0]
    assert straining > 100.0 and abs(world.data.actuator_force).max() < 5.0


def test_stop_brings_the_arms_to_rest_where_they_are(pair):
    """Braked within limits, held afterwards."""
    epoch = pair.activate()
    pair.move(epoch, HOME)
    pair.run(0.5)
    pair.granted(Stop())
    pair.run(1.0)
    held = [arm.q_rad.copy() for arm in pair.robot.arms.values()]
    pair.run(1.0)
    for before, arm in zip(held, pair.robot.arms.values(), strict=True):
        assert arm.q_rad == pytest.approx(before, abs=5e-3)
    assert pair.state == "HOLDING"


def test_grippers_and_base_do_what_their_owner_asks(pair):
    """The fingers close by the input's torque; 0.2 m/s for a second move the base by what its ramps make of it."""
    epoch = pair.activate()
    pair.granted(SetGripper(epoch=epoch, side=Side.LEFT, raw=0.8))
    pair.granted(DriveChassis(epoch=epoch, vx_mps=0.2, vy_mps=0.0, wz_radps=0.0, expiry_ns=1_000 * MS))
    pair.run(3.0)
    world = pair.robot.dynamics.world
    assert world.opening_m(Side.LEFT) == pytest.approx(0.0, abs=2e-3)
    assert 0.1 < world.base()[0] < 0.3
    assert pair.robot.chassis.velocity == [0.0, 0.0, 0.0]
