"""Tests of playing a policy: against the real engine and the simulated robot, in virtual time, with scripted answers."""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np
import pytest

from gateway.cli.policy.run import _Owner
from gateway.client import connect, contact
from gateway.core.motion import chunk
from gateway.core.robot_state.body_model import body_model
from gateway.errors import (
    Aborted,
    Code,
    Disconnected,
    GatewayError,
    GatewayTimeout,
    NotReady,
    Refusal,
    Rejected,
    to_exception,
)
from gateway.policy.asking import Answer
from gateway.policy.chunks import MAX_STEPS, MIN_STEPS, Chunk
from gateway.policy.observing import Observation
from gateway.policy.runner import DRIVE_S, JUMP_RAD, Plan, Runner
from gateway.settings.settings import Settings
from tests.changed import replace
from tests.client.robot_world import RobotWorld
from tests.pushed import LEFT, Pushed, felt

HZ = 30.0
PERIOD_NS = round(1e9 / HZ)
PLAN = Plan(seconds=3.0, horizon=0, smoothing_s=0.1, patience_s=1.0, far="refuse")


def failure(code, field="server"):
    """An error as the server's connection has it."""
    return to_exception(Refusal(code=code, message=f"scripted {code}", field=field))


class Policy:
    """A policy that swings both elbows from where they were, and takes its time; what `scripted` holds comes first."""

    def __init__(self, world, robot):
        self.world, self.robot = world, robot
        state = robot.state
        self.start = {side: np.array(state.arm(side).q) for side in ("left", "right")}
        self.began_ns = world.now_ns()
        self.delay_s, self.steps, self.off_rad, self.rate, self.grip = 0.1, 30, 0.0, 1.0, 0.55
        self.scripted, self.due, self.asked_ns, self.late_s, self.jitter_rad = [], None, [], [], 0.0
        self.drives = {}

    def wanted(self, at_ns):
        """Where the left elbow should be."""
        return self.start["left"][3] + self.off_rad + 0.1 * (1 - np.cos(self.rate * (at_ns - self.began_ns) / 1e9))

    def order(self):
        now_ns = self.world.now_ns()
        self.asked_ns.append(now_ns)
        answer = self.scripted.pop(0) if self.scripted else None
        delay_s = self.late_s.pop(0) if self.late_s else self.delay_s
        if answer is None:
            times = now_ns + PERIOD_NS * np.arange(self.steps)
            away = np.array([self.wanted(at) for at in times])[:, None] - self.start["left"][3]
            away[::2] += self.jitter_rad
            arms = {side: q + (away if side == "left" else -away) * np.eye(7)[3] for side, q in self.start.items()}
            grips = {side: np.full(self.steps, self.grip) for side in arms}
            drives = {part: np.tile(np.float64(velocity), (self.steps, 1)) for part, velocity in self.drives.items()}
            found = Chunk(arms=arms, grips=grips, drives=drives, observed_ns=now_ns, period_ns=PERIOD_NS)
            measured = {side: np.array(self.robot.state.arm(side).q) for side in arms}
            seen = Observation(values={}, observed_ns=now_ns, measured=measured, uncovered=())
            answer = Answer(chunk=found, observation=seen, delay_ns=round(delay_s * 1e9))
        self.due = (now_ns + round(delay_s * 1e9), answer)

    def answer(self, timeout_s):
        until_ns = self.world.now_ns() + max(round(timeout_s * 1e9), 1)
        while self.world.now_ns() < until_ns:
            if self.due is not None and self.world.now_ns() >= self.due[0]:
                answer, self.due = self.due[1], None
                return answer
            self.world.run(0.01)
        return None


@pytest.fixture
def world():
    """A robot and its gateway."""
    return RobotWorld()


@pytest.fixture
def robot(world):
    """A connected client."""
    with connect(transport=world.transport(), name="tester") as robot:
        yield robot


@pytest.fixture
def noted():
    """What was noted of the chunks."""
    return []


@pytest.fixture
def played(world, robot, noted):
    """Plays a policy as a plan says; what was said, shown and measured stays."""

    def play(plan=PLAN, on_tick=None, until=None, **traits):
        with robot.control(on_exit="hold") as own:
            own.enable()
            policy = Policy(world, robot)
            for name, value in traits.items():
                setattr(policy, name, value)
            said, shown = [], []

            def show(share, line):
                shown.append((share, line, world.now_ns(), float(robot.state.left_arm.q_ref[3])))
                if on_tick is not None:
                    on_tick(policy)

            driven = {
                "chassis": own.chassis.stream(50.0, expiry=DRIVE_S),
                "lift": own.lift.stream(50.0, expiry=DRIVE_S),
            }
            runner = Runner(policy, _Owner(own, driven, until), plan, said.append, show, world.now_ns, noted.append)
            error = None
            try:
                with ExitStack() as streams:
                    for part in policy.drives:
                        streams.enter_context(driven[part])
                    runner.run()
            except GatewayError as ended:
                error = ended
            return policy, runner.figures, said, shown, error

    return play


def test_arms_are_where_the_policy_says_while_it_thinks(played):
    """Chunks are joined by when the policy looked: its 0.1 s of thinking are steps dropped, not a lag."""
    policy, figures, said, shown, error = played()
    assert error is None and not said and figures.underruns == figures.refused == figures.lost == 0
    assert figures.chunks >= 5 and figures.steps_dropped == pytest.approx(3 * figures.chunks, abs=figures.chunks)
    late = [abs(q - policy.wanted(at_ns)) for share, _, at_ns, q in shown if share > 0.4]
    assert len(late) > 20 and max(late) < 0.015
    assert figures.p50_s == figures.worst_s == pytest.approx(0.1)
    assert "inference 100 ms (worst 100)" in shown[-1][1] and shown[-1][0] > 0.95
    facts = figures.facts()
    assert facts["inference_ms"] == {"p50": 100.0, "worst": 100.0} and facts["chunks"] == figures.chunks


def test_a_policy_that_is_to_end_at_a_touch_ends_well_there(world, played, noted, monkeypatch):
    """Also where a chunk was under way at the touch: it is refused, and nothing moves on."""
    model = body_model(Settings())
    model.contacts = pushed = Pushed()
    world.pair.engine._coordinator.model = model
    looked = Runner._watch
    for is_blind in (False, True):  # the next chunk may come before the touch is seen
        pushed.views[LEFT] = felt(0.0, 0.0, 0.0)
        begun_ns = world.now_ns()
        world.after(1.0, lambda: pushed.views.update({LEFT: felt(0.0, 0.0, 20.0)}))

        def watch(runner, is_blind=is_blind, begun_ns=begun_ns):
            if not is_blind or world.now_ns() - begun_ns > 2_500_000_000:
                looked(runner)

        monkeypatch.setattr(Runner, "_watch", watch)
        noted.clear()
        _, figures, _, _, error = played(until=contact(8.0), steps=20)
        assert error is None and figures.chunks >= 1 and noted[-1]["why"] == "CONTACT"
        assert is_blind == ("CONTACT" in [note.get("verdict") for note in noted])
        assert world.pair.see().arms["left"].touch is not None


def test_a_touch_on_the_way_to_the_first_step_ends_it_too(world, played):
    """Well, and before any chunk is played."""
    model = body_model(Settings())
    model.contacts = pushed = Pushed()
    world.pair.engine._coordinator.model = model
    world.after(1.0, lambda: pushed.views.update({LEFT: felt(0.0, 0.0, 20.0)}))
    policy, figures, said, shown, error = played(
        replace(PLAN, far="approach", seconds=6.0), until=contact(8.0), off_rad=0.5, rate=0.0
    )
    assert error is None and "moved there first" in said[0] and figures.chunks == 0
    assert shown[-1][3] < policy.start["left"][3] + 0.4 and world.pair.see().arms["left"].touch is not None


def test_a_way_that_the_gateway_does_not_take_is_followed_by_the_chunk_itself(played, monkeypatch):
    """What differs too much is not faded: the gateway joins it inside its limits, and nothing is refused for it."""
    asked = []
    follow = _Owner.follow

    def picky(self, chunk, late_s, smoothing_s):
        asked.append(chunk.steps)
        if chunk.steps > 30:
            raise failure(Code.TOO_FAST, "actions")
        return follow(self, chunk, late_s, smoothing_s)

    monkeypatch.setattr(_Owner, "follow", picky)
    _, figures, said, _, error = played()
    assert error is None and not said and figures.refused == 0
    assert figures.chunks >= 5 and asked[0] == asked[2] == 30 < asked[1] and asked.count(30) == figures.chunks


def test_the_next_chunk_is_asked_for_before_the_horizon(played):
    """Half of 30 steps, earlier by the median delay; or as many steps as were wished for."""
    for horizon, steps in ((0, 15), (10, 10)):
        policy, *_ = played(replace(PLAN, horizon=horizon))
        gaps_s = np.diff(policy.asked_ns[1:]) / 1e9
        assert np.median(gaps_s) == pytest.approx(steps / HZ - 0.1, abs=0.025), horizon


def test_grippers_get_their_command_once(played, robot, monkeypatch):
    """As it changes, not with every step: the second one is the chunk's, by whoever asks."""
    sent = []
    monkeypatch.setattr(_Owner, "grip", lambda self, side, command: sent.append((side, command)))
    *_, error = played()
    assert error is None and sent == [("left", 0.55), ("right", 0.55)]
    monkeypatch.undo()
    *_, error = played(grip=0.3)
    assert error is None
    for side in ("left", "right"):
        assert robot.state.grip(side).input_ratio == pytest.approx(0.3)


def test_a_slow_policy_lets_the_arms_brake_and_goes_on(played):
    """The gateway brakes at the chunk's end; the next chunk goes on from there, and that is said."""
    _, figures, said, shown, error = played(replace(PLAN, seconds=4.0), late_s=[0.1, 0.1, 1.2])
    assert error is None and figures.underruns == 1 and figures.chunks >= 4 and figures.worst_s == pytest.approx(1.2)
    assert "no chunk came in time: the arms brake and hold" in said
    steps = np.abs(np.diff([q for *_, q in shown]))
    assert steps.max() < 0.03


def test_a_policy_slower_than_its_chunks_is_too_late(played):
    """Nothing of them is played; after the patience it ends with that."""
    _, figures, said, _, error = played(delay_s=0.5, steps=10)
    assert isinstance(error, Rejected) and error.code is Code.TOO_LATE and "10 steps had passed" in error.message
    assert figures.chunks == 0 and figures.refused >= 2 and figures.steps_dropped >= 20 and len(said) == 1


def test_a_lost_server_is_borne_while_it_may_come_back(played):
    """Arms brake and hold; questions come ever slower; when it is back, it goes on."""
    lost = [failure(Code.DISCONNECTED)] * 3 + [failure(Code.TIMEOUT)]
    policy, figures, said, _, error = played(
        replace(PLAN, patience_s=5.0), delay_s=0.05, rate=0.3, scripted=[None, *lost]
    )
    assert error is None and figures.lost == 1 and figures.chunks >= 2
    assert said[0].startswith("DISCONNECTED: scripted") and "the policy plays again" in said
    waits_s = np.diff(policy.asked_ns[1:6]) / 1e9 - 0.05
    np.testing.assert_allclose(waits_s[:3], [0.1, 0.2, 0.4], atol=0.06)


def test_a_server_that_stays_away_ends_the_run_with_the_arms_held(played, world, robot):
    """After the patience, with what was the matter; no setpoint jumps."""
    _, figures, _, shown, error = played(scripted=[None, None, *[failure(Code.DISCONNECTED)] * 99])
    assert isinstance(error, Disconnected) and error.field == "server" and figures.underruns == 1
    steps = np.abs(np.diff([q for *_, q in shown]))
    assert steps.max() < 0.03 and robot.state.state in ("ACTIVE", "HOLDING")
    assert not any(robot.state.left_arm.dq_ref)


@pytest.mark.parametrize(
    "error",
    [
        failure(Code.POLICY_FAILED),
        failure(Code.NOT_FINITE),
        failure(Code.WRONG_SHAPE),
        failure(Code.DISCONNECTED, ""),
        failure(Code.INTERNAL),
    ],
)
def test_what_will_not_mend_itself_ends_the_run_at_once(played, error):
    """A policy that failed or says nonsense, a gateway that is gone."""
    policy, figures, _, _, ended = played(scripted=[None, error])
    assert ended is error and len(policy.asked_ns) == 2 and figures.chunks == 1


def test_stale_state_is_borne_and_is_no_lost_server(played):
    """As cameras that stutter are."""
    _, figures, said, _, error = played(scripted=[failure(Code.PART_STALE, "cameras")])
    assert error is None and figures.lost == 0 and figures.chunks > 1 and said[0].startswith("PART_STALE")


def test_a_policy_that_begins_far_away_is_refused_with_the_joint(played):
    """Before anything moves."""
    _, figures, _, _, error = played(off_rad=0.2)
    assert (
        isinstance(error, Rejected)
        and error.code is Code.JUMP_TOO_FAR
        and error.field in ("left_arm[3]", "right_arm[3]")
    )
    assert "0.1 rad is the bound" in error.message and "--approach" in error.hint and figures.chunks == 0


def test_with_approach_the_arms_are_moved_there_first(played):
    """By a motion of its own, and the policy is asked anew from there; said once."""
    policy, figures, said, shown, error = played(replace(PLAN, far="approach", seconds=6.0), off_rad=0.2, rate=0.0)
    assert error is None and figures.chunks > 3 and "moved there first" in said[0] and len(said) == 1
    assert shown[-1][3] == pytest.approx(policy.start["left"][3] + 0.2, abs=0.01)


@pytest.mark.parametrize("far", ["refuse", "approach"])
def test_a_first_chunk_that_is_over_when_it_comes_is_too_late_and_nobody_goes_to_its_end(played, far):
    """It is borne as any late one, and the next one plays from where the arms are."""

    def come_near(policy):
        policy.off_rad = 0.0 if policy.due is not None else policy.off_rad

    policy, figures, said, shown, error = played(
        replace(PLAN, far=far, patience_s=5.0), come_near, off_rad=0.2, rate=0.0, late_s=[1.2]
    )
    assert error is None and figures.refused == 1 and figures.chunks > 1
    assert said[0].startswith("TOO_LATE") and said[1:] == ["the policy plays again"]
    assert max(abs(q - policy.start["left"][3]) for *_, q in shown) < 0.01


def test_chunks_that_are_too_fast_are_left_out_and_say_what_helps(played):
    """The gateway judges them; borne for a while, then the run ends with its words."""
    _, figures, said, _, error = played(jitter_rad=0.08)
    assert isinstance(error, Rejected) and error.code is Code.TOO_FAST and "--hz" in error.hint
    assert figures.refused >= 3 and figures.chunks == 0 and len(said) == 1 and "rad/s" in said[0]


def test_what_the_gateway_refuses_for_its_state_is_shown_as_it_says_it(played, world, robot):
    """A stop from elsewhere ends the run; nothing is tried again."""

    def stop(policy):
        if len(policy.asked_ns) == 3 and not stopped:
            stopped.append(True)
            other.estop("somebody")

    stopped = []
    with connect(transport=world.transport(), name="other") as other:
        _, figures, _, _, error = played(on_tick=stop)
    assert isinstance(error, (Aborted, NotReady)) and figures.chunks >= 2


def test_a_deadman_that_is_let_go_ends_the_run_with_the_arms_held(played, world, robot):
    """As docs/how-to/policy.md says: a stop endpoint that checks in only while it is held; pressed again, nothing resumes."""
    with connect(transport=world.transport(), name="deadman") as other:
        deadman = other.stop_endpoint(timeout=0.3)

        def hold(policy):
            if not begun:
                begun.append(deadman.register())
            if len(policy.asked_ns) < 3:
                deadman.check_in()

        begun = []
        _, figures, _, _, error = played(on_tick=hold)
        assert isinstance(error, Aborted) and error.code is Code.ENDPOINT_SILENT and figures.chunks >= 1
        deadman.check_in()
        world.run(1.0)
        assert robot.state.state in ("ACTIVE", "HOLDING") and not any(robot.state.left_arm.dq_ref)
        deadman.leave()


def test_the_bounds_are_the_gateways_own():
    """Said twice, because whoever plays a policy does not know the control core."""
    assert JUMP_RAD == chunk.JUMP_RAD and MAX_STEPS == chunk.MAX_POINTS and MIN_STEPS == chunk.MIN_POINTS


def test_a_server_that_times_out_is_lost_too(played):
    """Its connection was closed."""
    _, figures, *_, error = played(scripted=[None, *[failure(Code.TIMEOUT)] * 99])
    assert isinstance(error, GatewayTimeout) and figures.lost == 1


# ------------------------------------------------------------------------------------------------------- chassis and lift


DRIVING = replace(PLAN, drive_bounds=(0.3, 0.5, 1.0))


@pytest.fixture
def driven():
    """The model that has a lift."""
    return RobotWorld(model="lift")


def speeds(world):
    """How fast the chassis is, along x [m/s], and the lift's motor [rad/s]."""
    return world.pair.robot.chassis.velocity[0], world.pair.robot.lift.motor_radps


class TestOnTheLiftModel:
    """Chassis and lift go as the chunk that plays says, and stand still as soon as none does."""

    @pytest.fixture
    def world(self, driven):
        """The robot of all fixtures."""
        return driven

    def test_they_are_driven_while_a_chunk_plays_and_stand_at_the_end(self, played, world):
        """By its velocities, renewed before they expire."""
        seen = []
        drives = {"chassis": (0.1, 0.0, 0.0), "lift": (0.2,)}
        *_, error = played(DRIVING, lambda _: seen.append(speeds(world)), drives=drives)
        assert error is None
        middle = seen[len(seen) // 2 : -1]
        assert all(v == pytest.approx(0.1, abs=0.01) and lift == pytest.approx(-30.0, abs=1.0) for v, lift in middle)
        world.run(1.0)
        assert speeds(world) == (0.0, 0.0)

    def test_they_stand_when_no_chunk_comes_in_time(self, played, world):
        """As the arms do at an underrun, and go on with the next chunk."""
        seen = []
        drives = {"chassis": (0.1, 0.0, 0.0), "lift": (0.2,)}
        _, figures, *_, error = played(
            replace(DRIVING, seconds=6.0),
            lambda policy: seen.append((*speeds(world), policy.due is not None and len(policy.asked_ns) == 3)),
            drives=drives,
            late_s=[0.1, 0.1, 3.0],
        )
        assert error is None and figures.underruns == 1
        assert seen[-1][0] == pytest.approx(0.1, abs=0.02)
        waiting = [(v, lift) for v, lift, is_waiting in seen if is_waiting]
        assert waiting[-1] == (0.0, 0.0)

    def test_they_stand_when_the_server_is_lost(self, played, world):
        """Before the patience is over; the error ends the drive as well."""
        seen = []
        *_, error = played(
            replace(DRIVING, seconds=9.0, patience_s=3.0),
            lambda _: seen.append(speeds(world)),
            drives={"chassis": (0.1, 0.0, 0.0), "lift": (0.2,)},
            scripted=[None, *[failure(Code.DISCONNECTED)] * 99],
        )
        assert isinstance(error, Disconnected) and max(v for v, _ in seen) > 0.09
        assert seen[-1] == (0.0, 0.0)

    def test_a_stop_from_elsewhere_is_not_undone(self, played, world):
        """The drive is over with the arms' motion, and nothing drives on."""

        def stop(policy):
            if len(policy.asked_ns) == 3 and not stopped:
                stopped.append(True)
                other.stop()

        stopped = []
        with connect(transport=world.transport(), name="other") as other:
            *_, error = played(DRIVING, stop, drives={"chassis": (0.1, 0.0, 0.0)})
        world.run(1.0)
        assert isinstance(error, GatewayError) and speeds(world)[0] == 0.0

    def test_a_velocity_at_the_bound_that_float32_rounds_up_is_driven(self, played, world):
        """Inside the gateway's bound, which allows nothing above it."""
        seen, fastest_mps = [], float(np.float32(0.3))
        assert fastest_mps > 0.3
        *_, error = played(
            DRIVING, lambda _: seen.append(speeds(world)[0]), drives={"chassis": (fastest_mps, 0.0, 0.5)}
        )
        assert error is None and max(seen) == pytest.approx(0.3, abs=0.01)

    def test_a_chunk_that_drives_too_fast_is_left_out_whole(self, played, world, noted):
        """Never clipped: neither arms nor chassis get any of it."""
        seen = []
        _, figures, said, _, error = played(
            DRIVING, lambda _: seen.append(speeds(world)[0]), drives={"chassis": (0.25, 0.25, 0.0)}
        )
        assert isinstance(error, Rejected) and error.code is Code.OUT_OF_RANGE and figures.chunks == 0
        assert "wants 0.354 m/s of the chassis, 0.3 is the bound" in said[0] and not any(seen)
        assert {facts["verdict"] for facts in noted} == {"OUT_OF_RANGE"}


def test_a_lift_that_is_not_there_ends_it_before_anything_moves(played, robot):
    """With the gateway's own words."""
    _, figures, *_, error = played(DRIVING, drives={"lift": (0.2,)})
    assert isinstance(error, NotReady) and error.code is Code.NO_LIFT and figures.chunks == 0


# --------------------------------------------------------------------------------------------------------------- notes


def test_each_chunk_and_what_became_of_it_is_noted(played, noted):
    """When it was asked for, looked and arrived; then how many steps of it were played, and what ended it."""
    _, figures, *_ = played()
    chunks = [facts for facts in noted if facts["event"] == "chunk"]
    ends = [facts for facts in noted if facts["event"] == "end"]
    assert (
        [facts["number"] for facts in chunks]
        == [facts["number"] for facts in ends]
        == list(range(1, figures.chunks + 1))
    )
    assert {facts["verdict"] for facts in chunks} == {"ACCEPTED"}
    assert [facts["why"] for facts in ends] == ["SUPERSEDED"] * (len(ends) - 1) + ["END"]
    for facts in chunks:
        assert facts["asked_ns"] <= facts["observed_ns"] < facts["arrived_ns"] and facts["delay_ns"] == 100_000_000
        assert np.shape(facts["arms"]["left"]) == (30, 7)
    assert all(0 < facts["steps_played"] < 30 for facts in ends)


def test_refusals_losses_and_underruns_are_noted(played, noted):
    """With the code of each."""
    played(
        replace(PLAN, seconds=4.0, patience_s=5.0),
        scripted=[None, failure(Code.DISCONNECTED)],
        late_s=[0.1, 1.2],
        rate=0.3,
    )
    told = [facts.get("verdict") or facts.get("why") or facts["code"] for facts in noted]
    assert told[:4] == ["ACCEPTED", "UNDERRUN", "DISCONNECTED", "ACCEPTED"]
    noted.clear()
    played(delay_s=0.5, steps=10)
    assert {facts["verdict"] for facts in noted} == {"TOO_LATE"}


def test_joints_of_a_chunk_that_no_recorder_takes_are_left_out(played, noted):
    """The rest is noted all the same."""
    played(replace(PLAN, seconds=1.0), steps=101)
    assert noted[0]["verdict"] == "ACCEPTED" and "arms" not in noted[0]
