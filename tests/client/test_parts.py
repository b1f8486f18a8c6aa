"""Grippers, chassis and lift through the client: against the real engine and the simulated robot, in virtual time."""

from __future__ import annotations

import asyncio
import math

import numpy as np
import pytest

from gateway.client import aio, connect
from gateway.errors import Aborted, Code, LeaseError, NotReady, Rejected
from gateway.robot.limits import GRIPPER_RELAXED
from gateway.settings.settings import ChassisSettings
from gateway.values import Side
from tests.client.playing import play
from tests.client.robot_world import RobotWorld


@pytest.fixture(params=["standard", "lift"])
def world(request):
    """A robot and its gateway."""
    return RobotWorld(request.param)


@pytest.fixture
def robot(world):
    """A connected client."""
    with connect(transport=world.transport(), name="tester") as robot:
        yield robot


def test_a_drive_takes_its_time_and_ends_at_rest(world, robot):
    """Kept alive by the client, ramped down at its end; no arm is enabled for it."""
    with robot.control() as own:
        begin_ns = world.now_ns()
        own.chassis.drive_for(0.2, 0.0, -0.1, 2.0)
        took_s = (world.now_ns() - begin_ns) / 1e9
        chassis = world.pair.robot.chassis
        assert 2.4 <= took_s <= 3.2 and not robot.state.drive.driven and robot.state.state == "IDLE"
        world.run(0.1)
        assert not any(chassis.velocity) and 0.2 <= chassis.travel[0] <= 0.4 and chassis.travel[2] < -0.1
    assert world.pair.robot.journal.counts.get("CHASSIS_WATCHDOG", 0) == 0


def test_a_stop_ends_a_drive_and_says_so(world, robot):
    """Whoever keeps it alive does not drive on: he hears of the stop."""
    with robot.control() as own:
        world.after(0.7, lambda: robot._session.transport.ask(*_stop(robot), lambda _: None))
        with pytest.raises(Aborted) as aborted:
            own.chassis.drive_for(0.2, 0.0, 0.0, 5.0)
        assert aborted.value.code is Code.STOPPED
        world.run(1.0)
        assert not any(world.pair.robot.chassis.velocity)


def _stop(robot):
    from gateway.api import protocol

    return protocol.COMMAND_KEY, robot._session.encode(protocol.Stop(), robot._session.next_request_id()), 1.0


def test_a_velocity_expires_by_itself(world, robot):
    """One call is one velocity for 0.3 s, or as long as is said."""
    with robot.control() as own:
        own.chassis.set_velocity(0.1, 0.0, 0.0)
        world.run(0.03)
        assert robot.state.drive.wanted_mps == (0.1, 0.0) and robot.state.drive.driven
        world.run(1.0)
        assert robot.state.drive.wanted_mps == (0.0, 0.0) and not any(world.pair.robot.chassis.velocity)
        own.chassis.set_velocity(0.1, 0.0, 0.0, expiry=1.5)
        world.run(1.2)
        assert robot.state.drive.commanded_mps == (0.1, 0.0)
        own.chassis.stop()
        world.run(0.05)
        assert robot.state.drive.commanded_mps == (0.0, 0.0) and robot.state.drive.code == "STOPPED"


def test_what_is_too_fast_is_refused_with_the_bound(robot):
    """As the daemon says it."""
    with robot.control() as own:
        for velocity, field in (((0.4, 0.0, 0.0), "vx_mps, vy_mps"), ((0.0, 0.0, 0.6), "wz_radps")):
            with pytest.raises(Rejected) as refused:
                own.chassis.set_velocity(*velocity)
            assert (refused.value.code, refused.value.field) == (Code.OUT_OF_RANGE, field)
        with pytest.raises(Rejected):
            own.chassis.set_velocity(math.nan, 0.0, 0.0)
        with pytest.raises(Rejected):
            own.chassis.drive_for(0.1, 0.0, 0.0, -1.0)
    with pytest.raises(LeaseError):
        own.chassis.stop()


def test_the_lift_goes_up_and_down_where_there_is_one(world, robot):
    """Elsewhere it is refused with a code of its own; where it is, the robot does not say."""
    lift = world.pair.robot.lift
    with robot.control() as own:
        if lift is None:
            assert robot.state.lift is None
            for ask in (lambda: own.lift.set_velocity(0.1), own.lift.stop, own.lift.disable):
                with pytest.raises(NotReady) as refused:
                    ask()
                assert refused.value.code is Code.NO_LIFT
            return
        begin_m = lift.lowered_m
        own.lift.drive_for(0.3, 1.0)
        world.run(0.2)
        up_m = lift.lowered_m
        assert up_m < begin_m - 0.05 and lift.motor_radps == 0.0 and robot.state.lift.servo_on
        own.lift.set_velocity(-0.3, expiry=0.5)
        world.run(0.3)
        own.lift.stop()
        world.run(0.3)
        assert lift.lowered_m > up_m and lift.is_powered
        own.lift.disable()
        world.run(1.5)
        assert not lift.is_powered and not robot.state.lift.servo_on
        with pytest.raises(Rejected):
            own.lift.set_velocity(1.5)


def test_a_stopped_lift_is_not_driven_on(world, robot):
    """As the chassis."""
    if world.pair.robot.lift is None:
        return
    with robot.control() as own:
        world.after(0.5, lambda: robot._session.transport.ask(*_stop(robot), lambda _: None))
        with pytest.raises(Aborted):
            own.lift.drive_for(0.2, 5.0)
        assert world.pair.robot.lift.motor_radps == 0.0 or not robot.state.lift.driven


def test_grippers_close_open_and_relax(world, robot):
    """Parts of the greatest torques become the robot's input by the table (manual §4.4)."""
    sim = world.pair.robot.grippers[Side.LEFT]
    with robot.control() as own:
        with pytest.raises(NotReady) as refused:
            own.left_gripper.grip()
        assert refused.value.code is Code.NOT_ENABLED
        own.enable()
        assert robot.state.grip("left").input_ratio == GRIPPER_RELAXED
        for ask, torque_nm in (
            (lambda: own.left_gripper.grip(), -0.8),
            (lambda: own.left_gripper.grip(1.0), -1.6),
            (lambda: own.left_gripper.grip(0.0), 0.0),
            (lambda: own.left_gripper.open(0.5), 1.0),
            (lambda: own.left_gripper.open(1.0), 2.0),
            (lambda: own.left_gripper.relax(), 0.0),
            (lambda: own.left_gripper.set(0.2), -0.18),
        ):
            ask()
            world.run(0.05)
            assert sim.effort_nm == pytest.approx(torque_nm)
            assert robot.state.grip("left").torque_nm == pytest.approx(torque_nm)
        for ask in (lambda: own.left_gripper.grip(1.1), lambda: own.left_gripper.open(math.nan)):
            with pytest.raises(Rejected) as rejected:
                ask()
            assert rejected.value.field == "force"
        with pytest.raises(Rejected) as rejected:
            own.right_gripper.set(1.1)
        assert rejected.value.field == "right_gripper"
        assert world.pair.robot.grippers[Side.RIGHT].effort_nm == 0.0
    assert robot.state.grip("left").input_ratio is None


def test_the_async_twin_does_the_same(world):
    """Call for call."""

    async def scene():
        async with aio.connect(transport=world.transport(), name="async") as robot:
            async with robot.control() as own:
                await own.chassis.drive_for(0.1, 0.0, 0.0, 0.5)
                await own.chassis.set_velocity(0.1, 0.0, 0.0, expiry=0.5)
                await own.chassis.stop()
                if world.pair.robot.lift is not None:
                    await own.lift.drive_for(0.2, 0.3)
                    await own.lift.set_velocity(-0.2)
                    await own.lift.stop()
                    await own.lift.disable()
                await own.enable()
                await own.left_gripper.grip(0.5)
                await own.left_gripper.set(0.2)
                await own.right_gripper.open(0.5)
                await own.right_gripper.relax()
                await asyncio.sleep(0.01)
                return [type(request).__name__ for request in asked]

    asked = []
    receive = world.pair.receive
    world.pair.receive = lambda event: (asked.append(getattr(event, "request", None)), receive(event))[1]

    names = [name for name in play(world, scene) if name != "NoneType"]
    ground = [name for name in names if name not in ("Acquire", "Enable", "Release")]
    assert ground[0] == "DriveChassis" and ground.count("StopChassis") == 1 and ground[-4:] == ["SetGripper"] * 4
    if world.pair.robot.lift is not None:
        assert {"DriveLift", "StopLift", "DisableLift"} <= set(ground)


def test_a_stream_of_velocities_is_one_drive(world, robot):
    """Set and tick; a normal end ramps down; a stop ends it for good, and the next tick says so."""
    chassis = world.pair.robot.chassis
    with robot.control() as own:
        with own.chassis.stream(rate_hz=20) as out:
            begin_ns = world.now_ns()
            for n in range(30):
                out.set(0.01 * n, 0.0, 0.0)
                out.tick()
            assert 1.4e9 <= world.now_ns() - begin_ns <= 1.7e9 and chassis.velocity[0] > 0.2
        assert not robot.state.drive.driven
        with pytest.raises(Aborted) as ended, own.chassis.stream(rate_hz=20) as out:
            out.set(0.2, 0.0, 0.0)
            for n in range(40):
                out.tick()
                if n == 20:
                    robot.stop()
        assert ended.value.code is Code.STOPPED
        world.run(1.0)
        assert not any(chassis.velocity)
        with pytest.raises(Aborted) as ended:
            own.chassis.stream().tick()
        assert ended.value.code is Code.STREAM_ENDED, "it was not entered"
        with pytest.raises(Rejected):
            own.chassis.stream(rate_hz=100)
        if world.pair.robot.lift is not None:
            begin_m = world.pair.robot.lift.lowered_m
            with own.lift.stream(rate_hz=10, expiry=0.5) as out:
                out.set(0.5)
                for _ in range(10):
                    out.tick()
            world.run(0.4)
            assert world.pair.robot.lift.lowered_m < begin_m and world.pair.robot.lift.motor_radps == 0.0


def test_a_late_tick_is_skipped_and_counted(world, robot):
    """The grid is absolute: nothing is caught up."""
    with robot.control() as own, own.chassis.stream(rate_hz=20) as out:
        out.tick()
        world.run(0.2)
        out.tick()
        assert out.skipped >= 3


def test_an_exception_in_a_control_leaves_the_robot_to_its_stages(world, robot):
    """Whoever breaks off with the control is lost: the drive ends as that of a lost client."""
    with pytest.raises(ZeroDivisionError), robot.control() as own, own.chassis.stream() as out:
        out.set(0.2, 0.0, 0.0)
        for _ in range(10):
            out.tick()
        _ = 1 / 0
    world.run(1.5)
    assert not any(world.pair.robot.chassis.velocity) and robot.state.drive.code == "CLIENT_LOST"


def test_a_stream_that_is_left_by_an_exception_ends_its_drive(world, robot):
    """However long its velocities live: the block is over, so nothing is driven on; the exception is the one that is told."""
    with robot.control() as own:
        begin_ns = world.now_ns()
        with pytest.raises(ZeroDivisionError), own.chassis.stream(expiry=3.0) as out:
            out.set(0.2, 0.0, 0.0)
            for _ in range(20):
                out.tick()
            _ = 1 / 0
        assert world.now_ns() - begin_ns <= 1.2e9, "nobody waits for the standstill"
        world.run(0.8)
        assert not any(world.pair.robot.chassis.velocity) and not robot.state.drive.driven
        with pytest.raises(ZeroDivisionError), own.chassis.stream() as out:
            robot.stop()
            _ = 1 / 0
        if world.pair.robot.lift is not None:
            with pytest.raises(ZeroDivisionError), own.lift.stream(expiry=3.0) as out:
                out.set(0.3)
                out.tick()
                _ = 1 / 0
            world.run(0.3)
            assert world.pair.robot.lift.motor_radps == 0.0 and not robot.state.lift.driven


def test_a_cancelled_stream_ends_its_drive(world):
    """The asyncio twin: a time-out of the user's around the block."""

    async def scene():
        async with aio.connect(transport=world.transport(), name="async") as robot, robot.control() as own:
            with pytest.raises(ZeroDivisionError):
                async with own.chassis.stream(expiry=3.0) as out:
                    out.set(0.2, 0.0, 0.0)
                    for _ in range(20):
                        await out.tick()
                    _ = 1 / 0
            if world.pair.robot.lift is not None:
                with pytest.raises(ZeroDivisionError):
                    async with own.lift.stream(expiry=3.0) as out:
                        out.set(0.3)
                        await out.tick()
                        _ = 1 / 0
            world.run(0.8)
            lift = (await robot.state()).lift
            return (await robot.state()).drive.driven or (lift is not None and lift.driven)

    assert play(world, scene) is False and not any(world.pair.robot.chassis.velocity)


@pytest.mark.parametrize(
    "value", [True, np.True_, "0.5", np.str_("0.5"), None, [0.5], 1j, 10**400], ids=lambda value: type(value).__name__
)
def test_what_is_no_number_is_refused_before_anything_is_sent(world, robot, value):
    """`grip(True)` would close with all there is; text and truth values are numbers for nobody here, as for the daemon."""
    with robot.control() as own:
        own.enable()
        sent = len(world.pair.replies)
        for ask in (
            lambda: own.left_gripper.grip(value),
            lambda: own.left_gripper.open(value),
            lambda: own.left_gripper.set(value),
            lambda: own.chassis.set_velocity(0.0, 0.0, value),
            lambda: own.chassis.drive_for(0.0, 0.0, 0.0, value),
            lambda: own.chassis.stream(value),
            lambda: own.chassis.stream().set(value, 0.0, 0.0),
            lambda: own.lift.set_velocity(value),
            lambda: own.lift.stream().set(value),
            lambda: own.left_arm.move_by([0.0] * 7, speed=value),
            lambda: own.left_arm.stream(rate_hz=value),
        ):
            with pytest.raises(Rejected) as refused:
                ask()
            assert refused.value.code is Code.BAD_REQUEST and refused.value.field and refused.value.hint
        assert len(world.pair.replies) == sent


def test_a_drive_is_kept_alive_also_where_velocities_live_shortly():
    """The daemon says how long a velocity lives there; a drive that stutters would be no drive."""
    world = RobotWorld("standard", ChassisSettings(expiry_ns=60_000_000))
    with connect(transport=world.transport(), name="tester") as robot, robot.control() as own:
        own.chassis.drive_for(0.2, 0.0, 0.0, 1.0)
    assert Code.TARGET_EXPIRED not in world.pair.codes() and world.pair.robot.chassis.travel[0] > 0.08
