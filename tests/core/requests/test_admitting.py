"""Streams whose arm yields: what pushes it and what does not, when it stops, and why. The estimate is a stand-in."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from gateway.core.motion.motion import ReferenceMode
from gateway.core.requests.admitting import DOUBTED, SURE, Admitting, felt
from gateway.core.supervision.supervisor import State
from gateway.errors import Code, Refusal
from gateway.messages.body_views import ContactView, SlowingView
from gateway.messages.incoming import Admittance
from gateway.messages.requests import Hold, OpenStream
from gateway.robot.topics import shoulder_frame
from gateway.values import Space
from tests.core.requests.test_moves import Scene as MovesScene
from tests.core.stage import PLACE, TICK_NS, L, R, S

HOLD, _, FOLLOW, _, BRAKE = ReferenceMode
X = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
WISH = Admittance(mass=(5.0,) * 3 + (None,) * 3, damping=(150.0,) * 6, stiffness=(0.0,) * 6)


class Feeling:
    """What a body model knows of contacts: what the test says."""

    def __init__(self):
        self.seen = {side: ContactView(state="known", wrench=(0.0,) * 6, wrench_sd=(1.0,) * 6) for side in (L, R)}

    def view(self, side, now_ns):
        """What is known of an arm."""
        return self.seen[side]

    def push(self, size, sd=1.0, side=L):
        """Something pushes along x; None where that is not felt."""
        wrench, sds = (size, *(0.0,) * 5), (None if size is None else sd, *(1.0,) * 5)
        self.seen[side] = ContactView(state="known", wrench=wrench, wrench_sd=sds)

    def lose(self, reason="the robot's efforts are all zero", side=L):
        """Nobody knows any more."""
        self.seen[side] = ContactView(state="unknown", code="NO_EFFORTS", reason=reason)


class Scene(MovesScene):
    """Ann owns a robot that feels, and whose arms are in end-effector mode."""

    def __init__(self):
        super().__init__(poses=(L, R))
        self.feeling = Feeling()
        self.coordinator.model = SimpleNamespace(contacts=self.feeling)
        self.admitting = Admitting(self.coordinator)
        self.seq = 0

    def opening(self, side=L, **how):
        """The request."""
        how = {"admittance": WISH, **how}
        return OpenStream(epoch=self.epoch, side=side, space=Space.POSE, frame=shoulder_frame(side), **how)

    def yields(self, side=L, **how):
        """Open such a stream; return its id."""
        return self.granted(self.opening(side, **how))["stream_id"]

    def says(self, stream_id, values=PLACE[L]):
        """Its client is there, and says where the anchor is."""
        self.seq += 1
        self.target(stream_id, self.seq, values)

    def pass_time(self, seconds, stream_id=None):
        """Let time pass as the engine does; return where the left hand goes to along x from where it was [m]."""
        for _ in range(round(seconds * S / TICK_NS)):
            if stream_id is not None:
                self.says(stream_id)
            for side, arm in self.body.pose_arms.items():  # it is where its setpoint is
                self.pose[side] = arm.values
            self.now_ns += TICK_NS
            self.hear()
            self.admitting.step(self.now_ns)
            for side in self.body.expire_targets(self.now_ns):
                self.body.arms[side].brake()
            for stream in self.body.streams:
                if stream.running:
                    stream.frame(self.now_ns)
        return self.body.arms[L].values[0] - PLACE[L][0]


@pytest.fixture
def scene():
    """One at rest that nobody pushes."""
    return Scene()


def test_a_hand_goes_where_it_is_pushed_and_only_while_its_client_is_there(scene):
    """Its first target begins it; without targets it brakes and holds, and the next one goes on from there."""
    stream_id = scene.yields(expiry_ns=S // 2)
    scene.feeling.push(20.0)
    assert scene.pass_time(0.5) == 0.0 and scene.body.arms[L].reference.mode is HOLD
    assert scene.pass_time(0.5, stream_id) > 0.01
    far = scene.pass_time(1.5)
    assert scene.body.arms[L].reference.mode is HOLD and scene.body.arms[L].is_at_rest
    assert scene.pass_time(0.5) == far
    assert scene.pass_time(0.3, stream_id) > far, "on from where it is held"
    assert scene.body.targets.find(stream_id).is_open


def test_it_begins_where_the_arm_comes_to_rest(scene):
    """One that is still under way is not led back."""
    other = scene.granted(scene.opening(admittance=None))["stream_id"]
    scene.target(other, 1, (PLACE[L][0] + 0.1, *PLACE[L][1:]))
    scene.pass_time(0.4)
    facts = scene.granted(scene.opening())
    rest = scene.body.arms[L].reference.rest_values()
    assert facts["values"] == pytest.approx(rest, abs=1e-12) and rest[0] > scene.body.arms[L].values[0] + 1e-3
    scene.seq = 0
    for _ in range(100):
        scene.seq += 1
        scene.target(facts["stream_id"], scene.seq, tuple(facts["values"]))
        scene.pass_time(0.01)
    assert scene.body.arms[L].values == pytest.approx(rest, abs=1e-6)


def test_without_a_push_nothing_moves(scene):
    """Whatever is within two standard deviations, for as long as you like."""
    scene.feeling.push(SURE * 0.99)
    assert scene.pass_time(2.0, scene.yields()) == 0.0


def test_an_axis_that_the_posture_does_not_feel_is_pushed_by_nothing(scene):
    """The number is missing, and none is invented."""
    scene.feeling.push(None)
    assert scene.pass_time(0.5, scene.yields()) == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_force_counts_once_it_is_sure_and_until_it_is_doubted(scene, sign):
    """In between it pushes as it did before; it never pushes with more than is felt."""

    def now(size, before):
        scene.feeling.push(sign * size)
        found = felt(scene.coordinator, L, scene.now_ns, (sign * before, *(0.0,) * 5))
        assert not isinstance(found, Refusal) and found[1:] == (0.0,) * 5
        return sign * found[0]

    assert now(SURE + 3.0, 0.0) == pytest.approx(3.0), "less what is not sure"
    assert now(SURE + 2.5, 3.0) == pytest.approx(3.0), "a little less changes nothing"
    assert now(DOUBTED + 1.0, 3.0) == pytest.approx(1.0), "much less does"
    assert now(DOUBTED, 3.0) == 0.0 and now(0.0, 3.0) == 0.0
    assert now(-SURE - 3.0, 3.0) == pytest.approx(-3.0), "and the other way at once"


def test_once_nobody_knows_what_pulls_it_brakes_and_says_why(scene):
    """The stream has ended with a code of its own; what comes after it moves nothing."""
    stream_id = scene.yields()
    scene.feeling.push(20.0)
    scene.pass_time(0.5, stream_id)
    scene.feeling.lose()
    scene.pass_time(0.02, stream_id)
    assert scene.body.arms[L].reference.mode is BRAKE
    assert scene.body.targets.find(stream_id).code is Code.CONTACT_UNKNOWN
    (told,) = scene.told(Code.CONTACT_UNKNOWN)
    assert "left arm brakes and holds" in told and "efforts are all zero" in told
    far = scene.pass_time(1.0, stream_id)
    scene.feeling.push(20.0)
    assert scene.pass_time(0.5, stream_id) == far


def test_it_is_refused_at_once_where_nobody_knows_what_pulls(scene):
    """With the estimate's own reason, before anything that is under way is ended."""
    scene.feeling.lose("observed for 100 ms only")
    refusal = scene.refused(scene.opening())
    assert (refusal.code, refusal.value) == (Code.CONTACT_UNKNOWN, "NO_EFFORTS")
    assert "observed for 100 ms only" in refusal.message


@pytest.mark.parametrize("model", [None, SimpleNamespace(contacts=None)])
def test_it_is_refused_where_nobody_asked_for_dynamics(scene, model):
    """With what to write into the configuration."""
    scene.coordinator.model = model
    refusal = scene.refused(scene.opening())
    assert (refusal.code, refusal.field) == (Code.MODEL_OFF, "model.dynamics") and "dynamics = true" in refusal.hint


def test_it_is_refused_outside_its_bounds_and_whoever_does_not_own_the_robot(scene):
    """As any stream, and by `admittance_rules.py`."""
    light = Admittance(mass=(0.1,) * 6, damping=(150.0,) * 6, stiffness=(0.0,) * 6)
    assert scene.refused(scene.opening(admittance=light)).code is Code.OUT_OF_RANGE
    assert scene.refused(scene.opening(speed=2.0)).code is Code.OUT_OF_RANGE
    assert scene.refused(scene.opening(), client="bob").code is Code.NOT_OWNER


def test_near_a_singularity_the_mass_is_as_slow_as_its_arm(scene):
    """It does not run ahead of setpoints that are slowed."""
    stream_id = scene.yields()
    slow = SlowingView(on=True, why="", speed_ratio=0.1, held=True, joint=4, joint_radps=9.0, bound_radps=1.0)
    scene.body.slowing[L] = slow
    scene.feeling.push(500.0)
    far = scene.pass_time(1.0, stream_id)
    assert 0.015 < far < 0.1 * scene.coordinator.settings.pose.v_mps * 1.05


def test_a_lowered_speed_limit_holds_for_the_mass_and_its_arm(scene):
    """Settings that are read anew in the middle of it: nothing is faster than the new limit."""
    stream_id = scene.yields()
    scene.body.speed_ratio[Space.POSE] = 0.1
    scene.feeling.push(500.0)
    far = scene.pass_time(1.0, stream_id)
    assert 0.015 < far < 0.1 * scene.coordinator.settings.pose.v_mps * 1.05


def test_a_hold_ends_it_and_another_state_forgets_how_it_went(scene):
    """A stop, a pause or a loss: the engine's states decide, and no mass goes on behind them."""
    stream_id = scene.yields()
    scene.feeling.push(20.0)
    scene.pass_time(0.5, stream_id)
    stream = scene.body.targets.find(stream_id)
    scene.coordinator.supervisor.move(State.HOLDING, scene.now_ns)
    scene.admitting.step(scene.now_ns)
    assert stream.mass.place == ()
    scene.coordinator.supervisor.move(State.ACTIVE, scene.now_ns)
    scene.granted(Hold(epoch=scene.epoch, sides=(L,)))
    assert stream.code is Code.CANCELLED
    far = scene.pass_time(1.0, stream_id)
    assert scene.pass_time(0.5, stream_id) == far


def test_both_arms_yield_each_by_its_own_push_beside_other_streams(scene):
    """One is pushed, the other not; a stream that leads its hand is left alone."""
    left, right = scene.yields(L), scene.yields(R)
    scene.feeling.push(20.0, side=R)
    for _ in range(50):
        scene.seq += 1
        scene.target(left, scene.seq, PLACE[L])
        scene.target(right, scene.seq, PLACE[R])
        scene.pass_time(0.01)
    assert scene.body.arms[R].values[0] > PLACE[R][0] + 0.005 and scene.body.arms[L].values == PLACE[L]
    led = scene.granted(scene.opening(R, admittance=None))["stream_id"]
    far = scene.body.arms[R].reference.rest_values()
    scene.target(led, 1, far)
    for _ in range(50):
        scene.pass_time(0.01)
    assert scene.body.arms[R].values == pytest.approx(far, abs=1e-6)
