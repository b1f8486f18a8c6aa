"""Poses that are followed slower near singularities, as a whole and in virtual time: against the simulated robot's own IK."""

from __future__ import annotations

import pytest

from gateway.core.messages.events import TargetArrived
from gateway.core.robot_state.body_model import body_model
from gateway.errors import Code
from gateway.messages.requests import OpenStream
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import STATE_TOPICS, arm_state, shoulder_frame
from gateway.settings.settings import LocalSettings, ModelSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import ArmState, Side, Space
from tests.kinematics.bodies import ARMS
from tests.pair import MS, Pair

R = Side.RIGHT
BOUND_RADPS = 1.0
AROUND = 0.15
"""Of the bound: noise of the measured speeds, and what the robot's IK does with the seventh joint."""


class PosingPair(Pair):
    """A robot whose right arm is in end-effector mode and is led by a stream of poses, ACTIVE, with a model that agrees."""

    def __init__(self, **model):
        settings = Settings(
            local=LocalSettings(snapshot_hz=10.0), model=ModelSettings(singularity_radps=BOUND_RADPS, **model)
        )
        sim = SimSettings(state_period_ns=10 * MS, right_mode="pose")
        super().__init__(settings, sim, model=body_model(settings))
        self.topics = STATE_TOPICS
        self.epoch = self.activate()
        self.run(1.2)
        asked = OpenStream(epoch=self.epoch, side=R, space=Space.POSE, frame=shoulder_frame(R))
        self.stream_id, self.seq = self.granted(asked)["stream_id"], 0
        self.fastest_radps = 0.0
        """Of all measured joints while the arm was led."""

    def lead(self, q_rad, seconds):
        """Stream the pose of joints, 20 times a second, and look at every joint."""
        target = ARMS[R].forward(q_rad).values
        for step in range(round(100 * seconds)):
            if step % 5 == 0:
                self.seq += 1
                self.receive(
                    TargetArrived(
                        client_id="user",
                        stream_id=self.stream_id,
                        epoch=self.epoch,
                        seq=self.seq,
                        values=target,
                        received_ns=self.now_ns,
                    )
                )
            self.step()
            value = self.heard[arm_state(R)].value
            assert isinstance(value, ArmState)
            self.fastest_radps = max(self.fastest_radps, *map(abs, value.dq_radps))

    @property
    def seen(self):
        """What is shown of the arm."""
        return self.see().slowing["right"]


def test_joints_of_a_robot_with_an_ik_of_its_own_keep_the_bound():
    """From an arm that hangs to home: the fastest joint goes as fast as it may, and the hand arrives."""
    free, kept = PosingPair(singularity_slowdown=False), PosingPair()
    for pair in (free, kept):
        pair.lead(HOME_Q_RAD[R], 5.0)
        assert pair.state == "ACTIVE" and not pair.engine.latches
        x = pair.see().arms["right"]
        assert x.ref_p_m == pytest.approx(ARMS[R].forward(HOME_Q_RAD[R]).p_m, abs=1e-9)
    assert free.fastest_radps > 1.3 * BOUND_RADPS
    assert 0.8 * BOUND_RADPS < kept.fastest_radps < (1.0 + AROUND) * BOUND_RADPS
    assert Code.SINGULARITY_NEAR in kept.codes() and Code.SINGULARITY_NEAR not in free.codes()
    assert kept.seen.on and not free.seen.on and "does not ask for it" in free.seen.why


def test_a_model_that_no_longer_agrees_ends_it_in_the_middle_and_tells():
    """A joint that is elsewhere than it says: followed as without a model, with the reason."""
    pair = PosingPair()
    pair.lead(HOME_Q_RAD[R], 0.6)
    assert pair.seen.on and pair.seen.why == ""
    pair.robot.inject({"fault": "joint_zero", "side": "right", "joint": 4, "delta_rad": 0.06}, pair.now_ns)
    pair.lead(HOME_Q_RAD[R], 4.0)
    assert not pair.seen.on and pair.seen.speed_ratio == 1.0 and "cannot be relied on" in pair.seen.why
    assert pair.codes().count(Code.MODEL_DIFFERS) >= 1 and pair.state == "ACTIVE"
    assert any("not slowed down near singularities" in notice.message for notice in pair.notices)
