"""Tests of the loop of `ta2 teleop`, with the real engine and a robot in virtual time."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.cli.teleop.keyboard import Wish
from gateway.client import connect
from gateway.errors import Code, GatewayError, LeaseError, failure
from gateway.robot.limits import HOME_Q_RAD
from gateway.sim.robot.faults import parse_fault
from gateway.values import Side
from tests.cli.teleop.world import Turn

pytestmark = pytest.mark.timeout(600)  # the robot's seconds are ours, on a machine that does much else minutes

AXES = [("x", 0), ("y", 1), ("z", 2)]


@pytest.fixture(params=["joint", "pose"])
def turn(request):
    """A turn with a robot in either control mode, and a bent arm."""
    turn = Turn(is_modelled=True, left_mode=request.param)
    if request.param == "joint":
        turn.own.move_to({"left": [0.0, 1.0, -0.3, 1.2, 0.0, 0.0, 0.0]}).result()
    else:
        turn.run((0.1, {}, "faster", "faster"), (1.0, {"z": 1.0}), (0.8, {"x": 1.0}), (0.7, {}, "slower", "slower"))
    turn.world.run(0.5)
    assert turn.said == []
    return turn


def open_streams(turn):
    """How many streams of targets there are."""
    return sum(view.open for view in turn.robot.fresh_state().view.targets)


@pytest.mark.parametrize(("axis", "row"), AXES)
def test_the_hand_goes_where_it_is_wished_in_both_modes(turn, axis, row):
    """Along the axis of the shoulder frame and nowhere else, no further than full speed takes it; its orientation stays."""
    before = turn.left.pose
    turn.run((1.0, {axis: -1.0}), (1.0, {}))
    after = turn.left.pose
    way = after.p - before.p
    assert -0.052 < way[row] < -0.035, turn.said
    assert np.abs(np.delete(way, row)).max() < 0.003
    assert abs(float(np.dot(before.quat_xyzw, after.quat_xyzw))) > 0.9999
    assert turn.said == [] and open_streams(turn) == 0


@pytest.mark.parametrize(("axis", "row"), [("roll", 0), ("pitch", 1), ("yaw", 2)])
def test_the_hand_turns_on_the_spot(turn, axis, row):
    """About the axis of the shoulder frame that was wished for."""
    before = turn.left.pose
    turn.run((0.5, {axis: 1.0}), (1.0, {}))
    after = turn.left.pose
    assert np.abs(after.p - before.p).max() < 0.003
    turned = times(after.quat_xyzw, before.quat_xyzw * [-1, -1, -1, 1])
    turned = turned * np.sign(turned[3])
    assert 0.03 < turned[row] < 0.06 and np.abs(np.delete(turned[:3], row)).max() < 0.003


def times(a, b):
    """Return the product of two quaternions, xyzw."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return np.array(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def test_in_the_axes_of_the_hand_it_goes_along_those(turn):
    """After `frame`."""
    before = turn.left.pose
    turn.run((0.02, {}, "frame"), (1.0, {"x": 1.0}), (1.0, {}))
    way = turn.left.pose.p - before.p
    x, y, z, w = before.quat_xyzw
    along = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])
    assert 0.035 < float(way @ along) < 0.052 and float(np.linalg.norm(way - along * (way @ along))) < 0.003


def test_what_is_told_never_jumps_and_is_never_too_fast(turn):
    """From step to step the told reference goes no faster than full speed, whatever is wished when."""
    seen = []
    turn.each = lambda: seen.append((turn.world.now_ns(), turn.robot.state.view.at_ns, turn.robot.state.left_arm))
    turn.run((0.3, {"y": 1.0}), (0.1, {}), (0.5, {"y": -1.0, "z": 1.0}), (0.05, {"x": float("nan")}), (1.0, {}))
    speeds = [float(np.linalg.norm(arm.dq_ref[:7])) for _, _, arm in seen if arm.q_ref.size]
    fastest_mps = [float(np.linalg.norm(view.ref_v_mps)) for _, _, arm in seen if (view := arm._view).ref_v_mps]
    assert all(speed < 0.4 for speed in speeds) and all(v < 0.05 * 1.1 for v in fastest_mps)
    assert open_streams(turn) == 0 and turn.said == []


def test_a_joint_is_jogged_and_told_where_its_limit_is():
    """In joint mode; it stays at the limit, and comes back at once."""
    turn = Turn(is_modelled=True)
    turn.run((0.02, {}, "joint 4", *["faster"] * 5), (4.0, {"joint": 1.0}), (1.0, {}))
    info = turn.robot.info
    assert turn.left.q_ref[3] == pytest.approx(info.upper_rad["left"][3], abs=1e-6)
    assert turn.said == ["joint 4 is at its limit, 2.20 rad"]
    turn.run((0.5, {"joint": -1.0}), (0.5, {}))
    assert turn.left.q_ref[3] < info.upper_rad["left"][3] - 0.15


def test_in_end_effector_mode_joints_are_not_jogged():
    """In one line; nothing moves."""
    turn = Turn(is_modelled=True, left_mode="pose")
    before = turn.left.q
    turn.run((1.0, {"joint": 1.0}), (0.5, {}))
    assert np.abs(turn.left.q - before).max() < 0.01 and len(turn.said) == 1 and "§2.3" in turn.said[0]


def test_without_a_model_that_agrees_the_hand_of_an_arm_in_joint_mode_stays():
    """With the reason; joints can be jogged."""
    turn = Turn(is_modelled=False)
    before = turn.left.q
    turn.run((0.5, {"x": 1.0}), (0.5, {}), (0.5, {"joint": 1.0}), (0.5, {}))
    assert len(turn.said) == 1 and "jog joints" in turn.said[0]
    assert turn.left.q[0] - before[0] > 0.02 and np.abs(turn.left.q[1:] - before[1:]).max() < 0.01


def test_at_the_end_of_its_reach_the_target_waits_for_the_arm(turn):
    """It says so once, and the way back begins at once: nothing has run away."""
    turn.run((0.02, {}, *["faster"] * 3), (4.0, {"x": 1.0}), (1.0, {}))
    out = turn.left.pose.p
    assert len(turn.said) >= 1
    turn.run((0.6, {"x": -1.0}), (1.0, {}))
    assert turn.left.pose.p[0] < out[0] - 0.04, turn.said


def test_a_stop_of_another_ends_it_until_everything_is_let_go_and_enabled_again(turn):
    """The reason is told; a wish that goes on moves nothing; `enable` clears the latch."""
    other = connect(transport=turn.world.transport(), name="other")
    turn.world.after(0.5, lambda: other._session.transport.put("ta2/stop", b"smoke"))
    turn.run((2.0, {"z": 1.0}), (0.5, {}))
    stopped = turn.left.pose.p
    assert "STOPPED_BY_OTHER" in turn.robot.state.latches and turn.said[0].startswith("STOPPED")
    turn.run((0.5, {"z": 1.0}), (0.5, {}))
    assert np.abs(turn.left.pose.p - stopped).max() < 0.002
    assert [line for line in turn.said if "enter" in line] == ["FAULT: enter enables again (start on a gamepad)"]
    turn.run((0.02, {}, "enable"), (0.5, {}), (0.5, {"z": -1.0}), (0.5, {}))
    assert turn.left.pose.p[2] < stopped[2] - 0.01, turn.said


def test_stop_brakes_and_latches_nothing(turn):
    """What is still wished for moves nothing until it was let go."""
    turn.run((0.5, {"z": 1.0}), (0.02, {"z": 1.0}, "stop"))
    stopped = turn.left.pose.p
    turn.run((0.02, {"z": 1.0}, "stop"), (1.0, {"z": 1.0}))
    assert np.abs(turn.left.pose.p - stopped).max() < 0.01 and not turn.robot.state.latches
    assert turn.said[-1] == "stopped: the arms are held"
    turn.run((0.1, {}), (0.5, {"z": 1.0}), (0.5, {}))
    assert turn.left.pose.p[2] > stopped[2] + 0.01


def test_a_robot_that_paused_is_told_once_with_the_key_that_enables_it():
    """Also while nothing is wished."""
    turn = Turn()
    turn.world.after(0.3, lambda: turn.world.pair.robot.inject(parse_fault({"fault": "pause"}), turn.world.now_ns()))
    turn.run((2.0, {}))
    assert [line for line in turn.said if "enter" in line] == ["PAUSED: enter enables again (start on a gamepad)"]


def test_another_owner_ends_the_turn(turn):
    """With a code and the reason, also while nothing is wished."""
    other = connect(transport=turn.world.transport(), name="other")
    with pytest.raises(LeaseError, match=r"other .* took the robot from ta2 teleop: mine"):
        turn.run((0.1, {}), (5.0, {}, *take(turn, other)))


def take(turn, other):
    """Let another client take the robot soon."""
    payload = other._session.encode
    from gateway.api import protocol

    def ask():
        command = protocol.Take(name="other", pid=1, reason="mine", on_loss=protocol.OnLoss.HOLD)
        other._session.transport.ask(protocol.COMMAND_KEY, payload(command, 1), 1.0, lambda _: None)

    turn.world.after(0.3, ask)
    return ()


def test_chassis_and_lift_go_while_they_are_wished_and_stop_after():
    """Their velocities are renewed, and taken back; nothing else moves."""
    turn = Turn(model="lift")
    seen = []
    turn.each = lambda: seen.append((turn.robot.state.drive.driven, turn.robot.state.lift.velocity_ratio))
    turn.run((1.0, {"vx": 1.0, "wz": -1.0}), (1.5, {}), (1.0, {"lift": -1.0}), (1.0, {}))
    assert turn.said == [] and any(driven for driven, _ in seen) and not turn.robot.state.drive.driven
    assert min(velocity for _, velocity in seen) < -0.05 and turn.robot.state.lift.velocity_ratio == 0.0


def test_grippers_grip_open_and_relax_on_the_arm_that_is_jogged():
    """With half of their torque."""
    turn = Turn()
    turn.run((0.1, {}, "arm"), (0.1, {}, "grip"))
    turn.world.run(0.1)
    assert turn.robot.state.grip("right").torque_nm < -0.5 and turn.robot.state.grip("left").torque_nm in (None, 0.0)
    turn.run((0.1, {}, "open"))
    turn.world.run(0.1)
    assert turn.robot.state.grip("right").torque_nm > 0.5
    turn.run((0.1, {}, "relax"))
    turn.world.run(0.1)
    assert turn.robot.state.grip("right").torque_nm == pytest.approx(0.0)


def test_home_is_asked_for_twice_and_ended_by_anything():
    """By the same again or by yes; another key says no; a wish on the way ends it."""
    turn = Turn()
    goal = np.array(HOME_Q_RAD[Side.LEFT])
    turn.run((0.1, {}, "home"), (0.1, {}, "failure"), (0.3, {}))
    assert turn.said[-1] == "no, then" and turn.robot.state.motions == ()
    turn.run((0.1, {}, "home"), (1.0, {}, "yes"), (0.02, {"x": 1.0}), (1.0, {}))
    apart = float(np.abs(turn.left.q_ref - goal).max())
    assert 0.1 < apart < 1.1 and any("CANCELLED" in said for said in turn.said)
    turn.run((0.1, {}, "home"), (0.5, {}, "home"), (0.5, {}, "stop"))
    assert turn.said[-1] == "stopped: the arms are held" and turn.robot.state.motions[-1].state == "aborted"
    turn.run((0.1, {}, "home"), (9.0, {}, "home"))
    assert float(np.abs(turn.left.q_ref - goal).max()) < 1e-6 and "is at its initial position" in turn.said[-1]


@pytest.mark.parametrize("between", [(5.2, {}), (0.2, {"joint": 1.0})], ids=["later", "jogged"])
def test_home_is_asked_for_a_few_seconds_and_until_something_is_wished(tmp_path, monkeypatch, between):
    """A `yes` after that judges an episode, as ever, and nothing moves by itself."""
    turn = Turn()
    monkeypatch.setattr(turn.robot._session.transport, "address", f"unix:{tmp_path}/gw.sock")
    turn.run((0.1, {}, "home"), between, (0.5, {}), (0.5, {}, "yes"))
    assert turn.said[-2] == "no, then" and turn.said[-1].startswith("NO_RECORDER") and turn.robot.state.motions == ()


def test_a_yes_that_comes_too_late_for_home_judges_no_episode(tmp_path, monkeypatch):
    """It was meant for the way home: an episode that was discarded before would be a success by it. The next one is."""
    turn = Turn()
    monkeypatch.setattr(turn.robot._session.transport, "address", f"unix:{tmp_path}/gw.sock")
    turn.run((0.1, {}, "home"), (3.2, {}), (0.5, {}, "yes"))
    assert turn.said[-2] == "no, then" and turn.said[-1].startswith("too late") and turn.robot.state.motions == ()
    turn.run((0.5, {}, "yes"))
    assert turn.said[-1].startswith("NO_RECORDER")


def test_episodes_need_a_recorder(tmp_path, monkeypatch):
    """What it says is told; the turn goes on."""
    turn = Turn()
    monkeypatch.setattr(turn.robot._session.transport, "address", f"unix:{tmp_path}/gw.sock")
    turn.run((0.1, {}, "episode"), (0.1, {}, "yes"), (0.1, {}, "discard"), (0.1, {}, "help"))
    assert len([said for said in turn.said if said.startswith("NO_RECORDER")]) == 1 and turn.said[-1] == "help"


def test_a_device_that_is_gone_ends_the_turn_and_one_that_is_missing_does_not():
    """Nobody can wish anything then."""
    turn = Turn()
    turn.device = Fixed(Wish({}, gone="the terminal is gone"))
    with pytest.raises(GatewayError) as gone:
        turn.run()
    assert gone.value.code is Code.CANCELLED
    turn.device = Fixed(Wish({}, missing="plug it in"), Wish({}, ("quit",)))
    turn.run()
    assert turn.said == ["plug it in"]


def test_a_device_that_goes_missing_ends_a_way_home():
    """The arm brakes on its way, as docs/how-to/teleop.md says."""
    turn = Turn()
    turn.run((0.1, {}, "home"), (1.0, {}, "yes"), (0.5, None), (1.0, {}))
    assert turn.robot.state.motions[-1].state == "cancelled" and any("CANCELLED" in said for said in turn.said)


def test_after_a_device_was_missing_everything_must_be_let_go():
    """What is still held when it is back moves nothing."""
    turn = Turn()
    before = turn.left.q_ref
    turn.run((0.5, None), (0.5, {"joint": 1.0}), (0.5, {}))
    assert np.abs(turn.left.q_ref - before).max() < 1e-3
    turn.run((0.5, {"joint": 1.0}), (0.5, {}))
    assert turn.left.q_ref[0] > before[0] + 0.01


class TestWhileSomethingWaits:
    """In a real thread, with a stand-in for what waits: enabling may take 12 s, and lead a reference to its arm."""

    @pytest.fixture
    def turn(self):
        """A turn whose enabling waits for whoever lets it end."""
        turn = Turn()
        del turn.session._aside
        turn.ending, turn.stops = threading.Event(), []

        def stop(reason):
            turn.stops.append(turn.ending.is_set())
            turn.ending.set()

        turn.own.enable = lambda timeout: turn.enabled()
        turn.enabled = lambda: turn.ending.wait(5.0) or pytest.fail("it was not let end")
        turn.robot.stop = stop
        return turn

    def test_a_stop_is_heard_and_ends_what_it_began_since(self, turn):
        """At once, and once more at its end; what else is asked for meanwhile is not done."""
        turn.device = Fixed(Wish({}, ("enable",)), Wish({}, ("faster", "stop")), Wish({}, ("quit",)))
        turn.run()
        assert turn.stops == [False, True] and turn.said[-1].startswith("CANCELLED: stopped: the arms are held")
        assert turn.session._level == 2

    @pytest.mark.parametrize("what", ["open", "close", "drive", "lift"])
    def test_a_stop_is_heard_whatever_waits(self, turn, what, monkeypatch):
        """A gateway may take seconds for each of its answers. A stream that opened since is closed."""
        closed = []

        class Stream:
            side, q = "left", np.zeros(7)

            def __enter__(self):
                if what == "open":
                    turn.enabled()
                return self

            def __exit__(self, *_):
                closed.append(turn.ending.is_set())
                if what == "close" and len(closed) == 1:
                    turn.enabled()

        monkeypatch.setattr(type(turn.own.left_arm), "stream", lambda *_, **__: Stream())
        turn.own.chassis.set_velocity = lambda *_, expiry: turn.enabled()
        turn.own.lift = SimpleNamespace(set_velocity=lambda *_, expiry: turn.enabled())
        if what == "close":
            turn.session._open(turn.robot.state)
        wish = {"open": Wish({"joint": 1.0}), "drive": Wish({"vx": 1.0}), "lift": Wish({"lift": 1.0})}
        begin = wish.get(what, Wish({}, ("arm",)))
        turn.device = Fixed(begin, Wish({}, ("stop",)), Wish({}, ("quit",)))
        turn.run()
        assert turn.stops == [False, True] and turn.said[-1].startswith("CANCELLED: stopped: the arms are held")
        assert closed == {"open": [True], "close": [False]}.get(what, [])

    def test_what_is_held_while_a_velocity_is_told_goes_on(self, turn):
        """Over a slow link each takes longer than a look at the keys: it is no other moment that was meant."""
        velocities, looks = [], iter(range(300))

        def tell(*velocity, expiry):
            velocities.append(velocity[0])
            turn.ending.wait(0.15)

        turn.own.chassis.set_velocity = tell
        turn.device = lambda now_ns: Wish(
            {"vx": 1.0}, ("quit",) if len(velocities) > 3 or next(looks, None) is None else ()
        )
        turn.run()
        assert len(velocities) > 3 and velocities == sorted(velocities) and velocities[-1] > velocities[0] > 0.0, (
            "the ramp goes on"
        )

    def test_the_end_is_heard_and_waits_for_it(self, turn):
        """It was pressed once."""
        seen = iter([Wish({}, ("enable",)), Wish({}, ("quit",))])

        def read(now_ns):
            wish = next(seen, Wish({}))
            if "quit" in wish.actions:
                turn.ending.set()
            return wish

        turn.device = read
        turn.run()
        assert turn.said == ["enabled"] and not turn.stops

    def test_what_was_held_before_must_be_let_go_after(self, turn):
        """It may have been let go long ago: nothing moves by it."""
        velocities, looks = [], []
        turn.own.chassis.set_velocity = lambda *velocity, expiry: velocities.append(velocity)

        def read(now_ns):
            looks.append(turn.ending.is_set())
            if len(looks) == 3:
                turn.ending.set()
            return Wish({"vx": 1.0}, ("enable",) if len(looks) == 1 else ("quit",) if looks.count(True) > 5 else ())

        turn.device = read
        turn.run()
        assert turn.said == ["enabled"] and turn.session._must_let_go
        assert not any(any(velocity) for velocity in velocities)

    @pytest.mark.parametrize("error", [failure(Code.NOT_ENABLED, "not yet"), ZeroDivisionError("bug")])
    def test_what_fails_is_told(self, turn, error, caplog):
        """A bug of ours, too: nobody waits for ever."""

        def fail():
            raise error

        turn.enabled, turn.device = fail, Fixed(Wish({}, ("enable",)), Wish({}, ("quit",)))
        turn.run()
        assert turn.said[-1].startswith(("NOT_ENABLED: not yet", "INTERNAL: the thread ta2-teleop-aside ended unasked"))


class Fixed:
    """A device that says the same again and again, the last one for ever."""

    def __init__(self, *wishes):
        self._wishes = list(wishes)

    def __call__(self, now_ns):
        return self._wishes.pop(0) if len(self._wishes) > 1 else self._wishes[0]


def test_the_line_of_status_says_arm_mode_speed_state_and_episode():
    """On one line."""
    turn = Turn()
    turn.run((0.1, {}, "joint 3", "frame", "arm"))
    line = turn.shown[-1]
    for word in ("right arm", "joint mode", "5 cm/s", "joint 3", "axes of hand", "READY", "no episode"):
        assert word in line


def test_a_narrow_terminal_cuts_the_speed_and_not_the_state():
    """State and what was told last stand first."""
    turn = Turn()
    turn.run((0.1, {}, "arm"))
    assert turn.shown[-1].startswith("ACTIVE READY, right arm | the right arm | ")
    assert turn.shown[-1].endswith("axes of shoulder")
