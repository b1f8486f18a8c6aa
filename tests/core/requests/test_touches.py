"""Touches: what ends at one, what is refused before and after it, the way back, and the gateway's own bound."""

from __future__ import annotations

import itertools
import math

import pytest

from gateway.core.messages.outputs import FrameKind
from gateway.core.motion.motion import PlanFailed
from gateway.core.requests import touches
from gateway.core.requests.touches import QUIET_NS
from gateway.errors import Code, Refusal
from gateway.messages.incoming import Until
from gateway.messages.requests import Cancel, CloseStream, Follow, Hold, Move, MovePose, OpenStream, Stop
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import joint_command
from gateway.settings.settings import Settings
from gateway.values import Side
from tests.pair import MS, Pair
from tests.pushed import LEFT, RIGHT, UP, PushedPair

BACK = Until(force_n=8.0, direction=(0.0, 0.0, 1.0), back_off_m=0.03)
HARD = (0.0, 0.0, 20.0)


def chunk(pair: PushedPair, until: Until | None = UP, by_rad: float = 0.2) -> Follow:
    """Return a chunk of the left arm that begins where it is held, and ends at rest."""
    here = pair.see().arms["left"].q_ref_rad
    points = tuple((here[0] + by_rad * (0.5 - 0.5 * math.cos(math.pi * n / 20)), *here[1:]) for n in range(21))
    return Follow(epoch=pair.epoch, points={LEFT: points}, dt_s=0.1, until=until)


def gone_m(pair: PushedPair) -> float:
    """Return how far the left hand's setpoint is from home [m]."""
    forward = pair.model.arms[LEFT].forward
    return math.dist(forward(pair.see().arms["left"].q_ref_rad).p_m, forward(HOME_Q_RAD[LEFT]).p_m)


# ------------------------------------------------------------------------------------------------------- what ends


def test_a_touch_ends_the_motion_and_the_arm_brakes_in_that_tick():
    """It tells force, wrench, place and time; the arm comes to rest as quickly as its limits allow and stays."""
    pair = PushedPair()
    motion_id = pair.begun()
    pair.push(*HARD)
    touched_ns = pair.step() and pair.now_ns
    sent = pair.sent_on(joint_command(LEFT), touched_ns)
    assert [frame.kind for _, frame in sent] == [FrameKind.BRAKE]
    view = pair.motion_view(motion_id)
    assert (view.state, view.code) == ("touched", "CONTACT") and "20.0 N" in view.message
    touch = view.touch
    assert touch is not None and touch == pair.touch
    assert (touch.number, touch.side, touch.at_ns, touch.is_own, touch.back_id) == (1, "left", touched_ns, False, 0)
    assert (touch.force_n, touch.sd_n, touch.threshold_n, touch.direction) == (20.0, 2.0, 8.0, (0.0, 0.0, 1.0))
    assert touch.wrench == (*HARD, 0.1, 0.2, 0.3) and touch.frame == "left_shoulder_base"
    assert touch.p_m == pytest.approx(
        pair.model.arms[LEFT].forward(pair.see().arms["left"].measured.q_rad).p_m, abs=0.02
    )
    held = pair.settled()
    pair.run(1.0)
    assert pair.see().arms["left"].q_ref_rad == held and pair.state == "ACTIVE"
    assert Code.CONTACT in pair.codes()


def test_a_push_that_may_be_noise_counts_when_it_stays():
    """9 N, 2 N of deviation, 8 N of threshold: one tick of it is nothing, 20 ms are."""
    pair = PushedPair()
    motion_id = pair.begun()
    pair.push(0.0, 0.0, 9.0)
    pair.run(0.02)
    pair.push(0.0, 0.0, 7.0)
    pair.run(0.02)
    assert pair.motion_view(motion_id).state == "executing"
    pair.push(0.0, 0.0, 9.0)
    pair.run(0.03)
    assert pair.motion_view(motion_id).state == "touched"


def test_pushes_of_another_direction_or_arm_are_no_touch():
    """Down, aside, and the other hand."""
    pair = PushedPair()
    motion_id = pair.begun()
    for force in ((0.0, 0.0, -50.0), (50.0, 50.0, 0.0)):
        pair.push(*force)
        pair.run(0.05)
    pair.push(*HARD, side=RIGHT)
    pair.run(0.05)
    assert pair.motion_view(motion_id).state == "executing"


def test_a_touch_of_one_arm_ends_the_motion_of_both():
    """Both brake."""
    pair = PushedPair()
    goals = {side: pair.goal(side, 0.3) for side in Side}
    motion_id = pair.granted(Move(epoch=pair.epoch, targets_rad=goals, until=UP))["motion_id"]
    pair.run(0.4)
    pair.push(*HARD, side=RIGHT)
    pair.step()
    begin_ns = pair.now_ns + 1
    assert pair.motion_view(motion_id).touch.side == "right"
    pair.run(1.0)
    assert pair.kinds_since(begin_ns) & {FrameKind.MOTION} == set()
    assert not any(pair.see().arms["right"].dq_ref_radps)


def test_chunks_and_streams_end_at_a_touch_for_good():
    """What is under way to them comes too late."""
    pair = PushedPair()
    motion_id = pair.granted(chunk(pair))["motion_id"]
    pair.run(0.5)
    pair.push(*HARD)
    pair.run(0.03)
    assert pair.motion_view(motion_id).state == "touched"
    pair.push(0.0, 0.0, 0.0)
    pair.run(1.0)
    opened = OpenStream(epoch=pair.epoch, side=LEFT, until=UP)
    stream_id = pair.granted(opened)["stream_id"]
    pair.target(pair.epoch, stream_id, pair.goal())
    pair.run(0.3)
    pair.push(*HARD)
    pair.step()
    held = pair.settled()
    pair.target(pair.epoch, stream_id, pair.goal(by_rad=-0.4))
    pair.run(0.5)
    view = pair.see().targets[-1]
    assert (view.open, view.code, view.touch.number, view.refusal_code) == (False, "CONTACT", 2, "STREAM_ENDED")
    assert pair.see().arms["left"].q_ref_rad == held


def test_motions_of_end_effectors_end_at_a_touch_and_go_back_in_either_mode():
    """An arm in end-effector mode, and one in joint mode that goes straight by the model."""
    pair = PushedPair(right_mode="pose")
    for side in Side:
        arm = pair.see().arms[side.value]
        begin_m = arm.p_m
        target = (arm.p_m[0], arm.p_m[1], arm.p_m[2] + 0.08, *arm.quat_xyzw)
        pair.run_until(lambda side=side: pair.model.refusal(side, pair.now_ns) is None)
        wish = MovePose(
            epoch=pair.epoch,
            targets={side: target},
            frames={side: f"{side}_shoulder_base"},
            straight=True,
            until=BACK,
            speed=0.5,
        )
        motion_id = pair.granted(wish)["motion_id"]
        pair.run_until(lambda m=begin_m, s=side: pair.see().arms[s.value].p_m[2] > m[2] + 0.05)
        there_m = pair.see().arms[side.value].p_m
        pair.push(*HARD, side=side)
        pair.step()
        pair.push(0.0, 0.0, 0.0, side=side)
        touch = pair.motion_view(motion_id).touch
        pair.run_until(lambda t=touch: pair.motion_view(t.back_id).state == "reached")
        assert pair.see().arms[side.value].p_m[2] < there_m[2] - 0.015


def test_a_motion_that_is_still_worked_out_ends_at_a_touch():
    """It never begins."""
    pair = PushedPair()
    arm = pair.see().arms["left"]
    pair.run_until(lambda: pair.model.refusal(LEFT, pair.now_ns) is None)
    target = (arm.p_m[0], arm.p_m[1], arm.p_m[2] + 0.08, *arm.quat_xyzw)
    frames = {LEFT: "left_shoulder_base"}
    wish = MovePose(epoch=pair.epoch, targets={LEFT: target}, frames=frames, straight=True, until=UP)
    pair.push(*HARD)
    motion_id = pair.granted(wish)["motion_id"]
    view = pair.motion_view(motion_id)
    assert (view.state, view.progress) == ("touched", 0.0)
    held = pair.settled()
    pair.run(1.0)
    assert pair.see().arms["left"].q_ref_rad == held


def test_when_nothing_is_known_any_more_the_arm_brakes_and_holds_and_says_why():
    """Nobody would feel the touch: it goes no further, and not back."""
    pair = PushedPair()
    motion_id = pair.begun(until=BACK)
    pair.deafen()
    pair.step()
    view = pair.motion_view(motion_id)
    assert (view.state, view.code, view.touch) == ("aborted", "CONTACT_UNKNOWN", None)
    assert "NO_EFFORTS: the robot sends none: it brakes" in view.message
    held = pair.settled()
    pair.run(1.0)
    assert pair.see().arms["left"].q_ref_rad == held and len(pair.see().motions) == 1


# ------------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("until", "force", "code", "words"),
    [
        (Until(force_n=8.0, direction=(0.0, 0.0, 0.0)), (0.0,) * 3, Code.OUT_OF_RANGE, "direction"),
        (Until(force_n=2.9), (0.0,) * 3, Code.OUT_OF_RANGE, "cannot be told from none"),
        (Until(force_n=8.0), (None,) * 3, Code.CONTACT_UNKNOWN, "feels no force"),
        (UP, (0.0, 0.0, None), Code.CONTACT_UNKNOWN, "does not feel that direction"),
        (UP, None, Code.CONTACT_UNKNOWN, "NO_EFFORTS"),
    ],
)
def test_what_would_not_feel_its_touch_does_not_begin(until, force, code, words):
    """Motions, chunks, streams and poses alike: refused at once, and nothing moves."""
    pair = PushedPair()
    pair.run_until(lambda: pair.model.refusal(LEFT, pair.now_ns) is None)
    arm = pair.see().arms["left"]
    pose, frames = (*arm.p_m, *arm.quat_xyzw), {LEFT: "left_shoulder_base"}
    pair.deafen() if force is None else pair.push(*force)
    for request in (
        pair.to(until=until),
        chunk(pair, until),
        OpenStream(epoch=pair.epoch, side=LEFT, until=until),
        MovePose(epoch=pair.epoch, targets={LEFT: pose}, frames=frames, until=until),
    ):
        refusal = pair.refused(request)
        assert refusal.code is code and words in refusal.message
    assert pair.see().motions == () and pair.see().targets == ()


def test_without_dynamics_nothing_can_be_asked_to_end_at_a_touch():
    """With a model and without one."""
    for model in (True, False):
        pair = Pair(Settings())
        epoch = pair.activate()
        if model:
            pair.engine._coordinator.model = PushedPair().model
            pair.engine._coordinator.model.contacts = None
        refusal = pair.refused(Move(epoch=epoch, targets_rad=HOME_Q_RAD, until=UP))
        assert (
            refusal.code is Code.MODEL_OFF and refusal.field == "model.dynamics" and "dynamics = true" in refusal.hint
        )


# ------------------------------------------------------------------------------------------------------ the way back


def test_the_hand_goes_back_along_the_way_it_came_by_what_was_asked():
    """From where it comes to rest, to where its setpoints were 3 cm before the touch; with a number of its own."""
    pair = PushedPair()
    motion_id = pair.begun(until=BACK, seconds=0.8)
    pair.push(*HARD)
    pair.step()
    there_m = gone_m(pair)
    pair.push(0.0, 0.0, 0.0)
    back_id = pair.motion_view(motion_id).touch.back_id
    assert pair.motion_view(back_id).state == "queued"
    pair.run_until(lambda: pair.motion_view(back_id).state == "reached")
    assert gone_m(pair) == pytest.approx(there_m - 0.03, abs=0.004)


def test_who_has_come_no_farther_goes_back_to_where_it_began_and_no_farther_back():
    """After 1 cm of way, 3 cm back are 1 cm; after none there is no way back."""
    pair = PushedPair()
    pair.granted(pair.to(until=BACK))
    pair.run_until(lambda: gone_m(pair) > 0.01)
    pair.push(*HARD)
    pair.step()
    back_id = pair.touch.back_id
    pair.push(0.0, 0.0, 0.0)
    pair.run_until(lambda: pair.motion_view(back_id).state == "reached")
    assert gone_m(pair) < 0.002
    pair.push(*HARD)
    pair.run(1.0)
    pair.granted(pair.to(until=BACK))
    assert (pair.touch.number, pair.touch.back_id) == (2, 0)


@pytest.mark.parametrize("how", ["stop", "hold", "loss"])
@pytest.mark.parametrize("is_queued", [True, False])
def test_whatever_ends_a_motion_ends_the_way_back(how, is_queued):
    """Before it has begun, and on it."""
    pair = PushedPair()
    motion_id = pair.begun(until=BACK, seconds=0.8)
    pair.push(*HARD)
    pair.step()
    back_id = pair.motion_view(motion_id).touch.back_id
    if not is_queued:
        pair.run_until(lambda: pair.motion_view(back_id).state == "executing")
        pair.run(0.1)
    if how == "stop":
        pair.granted(Stop(), client="bob")
    elif how == "hold":
        pair.granted(Hold(epoch=pair.epoch, sides=(LEFT,)))
    else:
        pair.kill()
        pair.run(0.3)
    held = pair.settled()
    pair.run(1.5)
    assert pair.see().arms["left"].q_ref_rad == held
    assert pair.motion_view(back_id).state in ("aborted", "cancelled")


def test_a_way_back_that_may_not_be_gone_is_not_gone(monkeypatch):
    """The checks of a motion are asked again: a goal too near to something, a plan that is not found."""
    too_near = Refusal(
        code=Code.GOAL_TOO_NEAR,
        message="left_palm and right_palm would be 7 mm apart at the goal (now 99 mm apart), "
        "20 mm must stay free between them",
    )
    for where, name, answer in (
        (touches, "check_goals", lambda *_: too_near),
        (None, "plan", _no_plan),
    ):
        pair = PushedPair()
        motion_id = pair.begun(until=BACK, seconds=0.8)
        with monkeypatch.context() as broken:
            broken.setattr(where or pair.engine._coordinator.body, name, answer)
            pair.push(*HARD)
            pair.step()
            held = pair.settled()
            pair.run(0.5)
        view = pair.motion_view(pair.motion_view(motion_id).touch.back_id)
        assert (view.state, view.code) == ("aborted", "GOAL_TOO_NEAR" if where else "PLAN_FAILED")
        assert pair.see().arms["left"].q_ref_rad == held


def _no_plan(*_: object) -> None:
    raise PlanFailed("none")


# ------------------------------------------------------------------------------------- what was under way at the touch


def test_what_was_asked_for_without_knowing_of_the_touch_neither_ends_the_way_back_nor_moves_the_arm():
    """Chunks and streams that are to feel; ends of the stream and the motion that have ended already."""
    pair = PushedPair()
    motion_id = pair.granted(chunk(pair, BACK))["motion_id"]
    pair.run(1.0)
    under_way = chunk(pair, BACK)
    pair.push(*HARD)
    pair.step()
    pair.push(0.0, 0.0, 0.0)
    back_id = pair.motion_view(motion_id).touch.back_id
    pair.granted(Cancel(epoch=pair.epoch, motion_id=motion_id))
    asked = itertools.cycle((under_way, OpenStream(epoch=pair.epoch, side=LEFT, until=UP), pair.to()))
    quiet_ns = pair.now_ns + QUIET_NS
    while pair.now_ns + 10 * MS < quiet_ns or pair.motion_view(back_id).state in ("queued", "executing"):
        reply = pair.ask(next(asked))
        if pair.motion_view(back_id).state != "reached":
            assert reply.refusal is not None and reply.refusal.code is Code.CONTACT
            assert (reply.refusal.value, reply.refusal.bound) == ("0", "1")
    assert pair.motion_view(back_id).state == "reached"
    assert pair.granted(pair.to())["motion_id"]


def test_who_knows_of_the_touch_may_go_on_at_once_and_who_feels_nothing_always():
    """The number of the touch says who knows; a motion without `until` is its owner's own affair, as any."""
    for until in (Until(force_n=8.0, seen=1), None):
        pair = PushedPair()
        pair.begun(until=BACK)
        pair.push(*HARD)
        pair.step()
        pair.push(0.0, 0.0, 0.0)
        back_id = pair.touch.back_id
        pair.granted(pair.to(by_rad=-0.2, until=until))
        assert pair.motion_view(back_id).state == "superseded"
    pair = PushedPair()
    stream_id = pair.granted(OpenStream(epoch=pair.epoch, side=LEFT, until=BACK))["stream_id"]
    pair.target(pair.epoch, stream_id, pair.goal())
    pair.run(0.5)
    pair.push(*HARD)
    pair.step()
    pair.granted(CloseStream(epoch=pair.epoch, stream_id=stream_id))
    pair.run_until(lambda: pair.motion_view(pair.touch.back_id).state == "reached")


# ---------------------------------------------------------------------------------------------- the gateway's own bound


def test_the_gateways_own_bound_ends_whatever_moves_the_arm_and_refuses_what_follows_for_a_while():
    """A motion of somebody who asked for no touch; shown, told, and with no way back."""
    pair = PushedPair(bound_n=15.0)
    motion_id = pair.begun(until=None)
    assert pair.see().arms["left"].guard_n == 15.0 and pair.see().arms["right"].guard_n == 0.0
    pair.push(13.0, 13.0, 0.0)
    pair.step()
    view = pair.motion_view(motion_id)
    assert (view.state, view.code, view.touch.is_own) == ("aborted", "CONTACT", True)
    assert pair.refused(pair.to(until=None)).code is Code.CONTACT
    pair.settled()
    pair.run(0.5)
    pair.granted(pair.to(by_rad=-0.2, until=None))


def test_one_can_move_away_from_what_pushes_a_held_arm_but_not_further_into_it():
    """What it is pushed with while it is held does not count; as much again does."""
    pair = PushedPair(bound_n=15.0)
    pair.push(0.0, 0.0, 40.0)
    pair.run(1.0)
    assert pair.touch is None, "an arm that is held is pushed, and nothing moves it"
    motion_id = pair.granted(pair.to(until=None))["motion_id"]
    pair.run(0.2)
    assert pair.motion_view(motion_id).state == "executing"
    pair.push(0.0, 0.0, 60.0)
    pair.step()
    assert pair.motion_view(motion_id).code == "CONTACT"
    pair.run(1.0)
    pair.push(0.0, 0.0, 0.0)
    pair.run(0.1)
    motion_id = pair.granted(pair.to(by_rad=0.0, until=None))["motion_id"]
    pair.run(0.1)
    pair.push(0.0, 0.0, 30.0)
    pair.step()
    assert pair.motion_view(motion_id).code == "CONTACT", "what it is free of counts from the bound on"


def test_where_nothing_is_known_the_own_bound_holds_nobody_back_and_that_is_told_once():
    """It is no safety function: the robot stays usable without its efforts."""
    pair = PushedPair(bound_n=15.0)
    for _ in range(2):
        pair.deafen()
        pair.begun(until=None)
        pair.run(1.0)
        pair.granted(pair.to(by_rad=0.0, until=None))
        pair.run(2.0)
        pair.push(0.0, 0.0, 0.0)
        pair.run(0.1)
    told = [notice.message for notice in pair.notices if notice.code is Code.CONTACT_UNKNOWN]
    assert len(told) == 2 and "nobody feels what pushes it: NO_EFFORTS" in told[0]


def test_an_engine_that_feels_nothing_keeps_no_bound():
    """A guard's, which has no model: it only brakes and holds."""
    pair = PushedPair(bound_n=15.0)
    pair.model.contacts = None
    motion_id = pair.begun(until=None)
    assert pair.motion_view(motion_id).state == "executing"


def test_a_touch_and_the_own_bound_go_together():
    """The lighter one ends the motion; a hand that goes back from a heavy push is not held by the bound."""
    pair = PushedPair(bound_n=10.0)
    motion_id = pair.begun(until=BACK, seconds=0.8)
    pair.push(*HARD)
    pair.step()
    view = pair.motion_view(motion_id)
    assert (view.state, view.touch.is_own) == ("touched", False)
    pair.push(0.0, 0.0, 35.0)
    pair.run_until(lambda: pair.motion_view(view.touch.back_id).state == "reached")
