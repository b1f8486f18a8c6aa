"""Touches on a robot with forces whose masses and friction are 5 to 10 % off, in virtual time: found, and not made up."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

REASON = "pinocchio or MuJoCo is not installed: pip install 'teleavatar-gateway[body,sim]'"
pytest.importorskip("pinocchio", reason=REASON)
mujoco = pytest.importorskip("mujoco", reason=REASON)

from gateway.core.body.feeler import Feeler, push_of
from gateway.core.engine import Output
from gateway.core.robot_state.body_model import body_model
from gateway.core.robot_state.contact import Contacts
from gateway.kinematics.description import arm_joint
from gateway.kinematics.dynamics.loading import load_dynamics
from gateway.messages.incoming import Until
from gateway.messages.requests import MovePose
from gateway.robot.limits import HOME_Q_RAD, JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.settings.settings import ModelSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side
from tests.pair import MS, Pair, S
from tests.sim.physics.drawing_needed import demand_drawing
from tests.thoroughness import either

LEFT = Side.LEFT
TABLE = Until(force_n=8.0, direction=(0.0, 0.0, 1.0))
FRAMES = {LEFT: "left_shoulder_base"}
START_M = (0.34, 0.093, -0.2)
"""Where the hand begins: above the table, turned as at home."""
DEEPEST_M = -0.38
LIMITS = tuple(np.array(limit[LEFT]) for limit in (JOINT_LOWER_RAD, JOINT_UPPER_RAD))
SPEED = 0.4
"""Of 0.25 m/s."""


class Other(Pair):
    """A robot that is another one than described, at the table or far from it, and a gateway that feels.

    Args:
        seed: Of what is off.
        start_x_m: How far ahead of the origin it stands; the table begins at 0.86.
        table_m: How much higher than usual the table is.
    """

    def __init__(self, seed: int, start_x_m: float, table_m: float = 0.0) -> None:
        settings = Settings(model=ModelSettings(dynamics=True))
        model = body_model(settings)
        assert model is not None
        model.contacts = Contacts(load_dynamics(settings), model.refusal)
        arm = model.arms[LEFT]
        found = arm.solution(replace(arm.forward(HOME_Q_RAD[LEFT]), p_m=START_M), HOME_Q_RAD[LEFT])
        assert found is not None
        start = {LEFT: found.q_rad, Side.RIGHT: HOME_Q_RAD[Side.RIGHT]}
        sim = SimSettings(physics="mujoco", state_period_ns=5 * MS, start_x_m=start_x_m, start_rad=start, seed=seed)
        super().__init__(settings, sim, model=model)
        self._differ(seed, table_m)
        self.epoch = self.activate()
        self.run_until(lambda: model.refusal(LEFT, self.now_ns) is None)
        self.run(0.3)

    def _differ(self, seed: int, table_m: float) -> None:
        rng, world = np.random.default_rng(seed), self.robot.dynamics.world
        model, posture = world.model, world.data.qpos.copy()
        masses, frictions = (1.0 + rng.uniform(0.05, 0.1, 7) * rng.choice([-1.0, 1.0], 7) for _ in range(2))
        for number, (mass, friction) in enumerate(zip(masses, frictions, strict=True), start=1):
            joint = model.joint(arm_joint(LEFT, number)).id
            body = model.jnt_bodyid[joint]
            model.body_mass[body] *= mass
            model.body_inertia[body] *= mass
            model.dof_frictionloss[model.jnt_dofadr[joint]] *= friction
        model.geom("table").pos[2] += table_m
        mujoco.mj_setConst(model, world.data)
        world.data.qpos[:] = posture
        mujoco.mj_forward(model, world.data)

    @property
    def touches_table(self) -> bool:
        """Whether a part of the robot is in contact with the table."""
        world = self.robot.dynamics.world
        model, data, table = world.model, world.data, world.model.geom("table").id
        pairs = [(data.contact[n].geom1, data.contact[n].geom2) for n in range(data.ncon)]
        others = [second if first == table else first for first, second in pairs if table in (first, second)]
        return any(model.body(model.geom_bodyid[other]).name not in ("block", "can", "ball") for other in others)

    @property
    def hand_m(self) -> float:
        """How high the left hand truly is [m]."""
        return float(self.robot.dynamics.world.place("left_ee").position_m[2])

    def lowered(self, until: Until, x_m: float = START_M[0]) -> int:
        """Begin to lower the hand straight down from where it is, at 0.1 m/s; return the motion."""
        arm = self.see().arms["left"]
        target = (x_m, arm.p_m[1], DEEPEST_M, *arm.quat_xyzw)
        wish = MovePose(
            epoch=self.epoch, targets={LEFT: target}, frames=FRAMES, speed=SPEED, straight=True, until=until
        )
        motion_id = self.granted(wish)["motion_id"]
        assert isinstance(motion_id, int)
        return motion_id

    def state_of(self, motion_id: int) -> str:
        """Return how a motion is."""
        return next(motion.state for motion in self.see().motions if motion.motion_id == motion_id)


@pytest.mark.parametrize("seed", range(either(1, 8)))
def test_a_table_is_found_within_30_ms_and_15_n_at_a_tenth_of_a_metre_a_second(seed):
    """From the first contact on, and by what is felt then; the hand comes to rest within its limits and goes no deeper."""
    pair = Other(seed, start_x_m=0.55)
    motion_id = pair.lowered(TABLE)
    pair.run_until(lambda: pair.touches_table)
    met_ns, met_m = pair.now_ns, pair.hand_m
    pair.run_until(lambda: pair.engine._coordinator.body.touches)
    found_ms = (pair.now_ns - met_ns) / MS
    touch = pair.see().arms["left"].touch
    assert found_ms <= 30.0 and 8.0 < touch.force_n < 15.0, f"{found_ms} ms, {touch.force_n} N"
    assert pair.state_of(motion_id) == "touched" and touch.p_m[2] + 1.1057 == pytest.approx(pair.hand_m, abs=0.01)
    pair.run(0.4)
    assert not any(pair.see().arms["left"].dq_ref_radps)
    held = pair.see().arms["left"].q_ref_rad
    pair.run(0.5)
    assert pair.see().arms["left"].q_ref_rad == held and met_m - pair.hand_m < 0.02


@pytest.mark.parametrize("seed", range(1, either(2, 9)))
def test_free_motion_at_full_speed_is_no_touch(seed):
    """From posture to posture, with the same threshold, upwards and in any direction, also where it would be refused."""
    pair, looks = Other(seed, start_x_m=-1.0), 0
    rng, until_ns = np.random.default_rng(seed), pair.now_ns + either(8, 75) * S
    feelers = [Feeler(force_n=8.0, axis=axis) for axis in ((0.0, 0.0, 1.0), ())]
    while pair.now_ns < until_ns:
        goal = np.clip(np.array(HOME_Q_RAD[LEFT]) + rng.uniform(-0.5, 0.5, 7), *LIMITS)
        pair.move(pair.epoch, {LEFT: tuple(goal.tolist())})
        for _ in range(130):
            pair.step()
            view = pair.model.contacts.view(LEFT, pair.now_ns)
            for feeler in feelers:
                push = push_of(view, feeler.axis)
                looks += not push.why
                assert push.why or not feeler.feels(push, pair.now_ns), push
    assert looks > 500


@pytest.mark.parametrize("seed", range(either(1, 20)))
def test_a_surface_whose_height_nobody_knows_is_found_at_each_place(seed):
    """A search that needs touches: down until the table, back, aside, down again; heights agree with the truth."""
    higher_m = float(np.random.default_rng(seed).uniform(-0.02, 0.05))
    pair, heights = Other(seed, 0.55, higher_m), []
    with filmed(pair, higher_m, "" if seed else os.environ.get("TA2_ARTEFACTS", "")):
        for x_m in (START_M[0], START_M[0] - 0.02):
            motion_id = pair.lowered(replace_back(TABLE), x_m)
            pair.run_until(lambda m=motion_id: pair.state_of(m) == "touched")
            touch = pair.see().arms["left"].touch
            assert touch.back_id
            heights.append(touch.p_m[2] + 1.1057)
            pair.run_until(lambda t=touch: pair.state_of(t.back_id) == "reached")
            assert not pair.touches_table
    under_hand_m = 0.7976 - 0.75  # from its middle to its lowest point, turned as at home
    assert heights == pytest.approx([0.75 + higher_m + under_hand_m] * 2, abs=0.012)


def replace_back(until: Until) -> Until:
    """Return the same touch, with a way back."""
    return Until(force_n=until.force_n, direction=until.direction, back_off_m=0.03)


@contextmanager
def filmed(pair: Other, table_m: float, folder: str) -> Iterator[None]:
    """Film what the robot does into `search.mp4` of a folder, 25 pictures a second of virtual time; nothing without one."""
    if not folder:
        yield
        return
    pytest.importorskip("av")
    demand_drawing()
    from gateway.sim.physics.drawing import Drawing
    from gateway.sim.physics.filming import Movie

    Path(folder).mkdir(parents=True, exist_ok=True)
    with Drawing(has_lift=False) as drawing, Movie(Path(folder, "search.mp4"), drawing.width, drawing.height) as movie:
        drawing._model.geom("table").pos[2] += table_m
        step, began_ns = pair.step, pair.now_ns

        def seen(to_ns: int | None = None) -> Output:
            output = step(to_ns)
            if pair.now_ns - began_ns >= movie.pictures * 40 * MS:
                movie.add(drawing.draw(pair.robot.dynamics.world.positions()), pair.now_ns - began_ns)
            return output

        pair.step = seen
        yield
