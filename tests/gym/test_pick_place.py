"""The environment as Gymnasium's users meet it: its spaces, its determinism, its ends, and that the task can be done."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.sim.physics.drawing_needed import demand_drawing
from tests.sim.physics.mujoco_needed import REASON

pytest.importorskip("mujoco", reason=REASON)
gymnasium = pytest.importorskip("gymnasium", reason="Gymnasium is not installed: pip install -e '.[gym]'")

from gymnasium.utils.env_checker import check_env

from gateway.core.messages.outputs import Frame
from gateway.errors import Code
from gateway.gym import ENV_ID
from gateway.gym.pick_place import PickPlace
from gateway.gym.virtual_robot import STATE
from gateway.kinematics.cameras.eyes import EYES
from gateway.policy.observing import resized
from gateway.robot.limits import JOINT_LOWER_RAD, JOINT_UPPER_RAD
from gateway.robot.topics import joint_command
from gateway.settings.settings import ArmSettings, ModelSettings, Settings
from gateway.sim.physics.body_numbers import body_numbers
from gateway.sim.physics.drawing import Drawing
from gateway.sim.physics.lens import lens_of
from gateway.sim.robot.manual import Side as SimSide
from gateway.sim.robot.settings import HANGING_RAD
from gateway.values import Side
from tests.gym.scripted import actions, joints

ROOT = Path(__file__).parents[2]


def made(**options: object) -> PickPlace:
    """Make an environment without Gymnasium's wrappers."""
    env = gymnasium.make(ENV_ID, **options).unwrapped
    assert isinstance(env, PickPlace)
    return env


def rest(env: PickPlace, observation: dict[str, np.ndarray]) -> np.ndarray:
    """Return the action that leaves both arms where they are, grippers relaxed."""
    state = observation["state"].astype(float)
    return env.to_action(np.array([*state[:7], 0.1, *state[8:15], 0.1]))


def played(env: PickPlace, seed: int, steps: int) -> list[bytes]:
    """Return what an environment tells, bit by bit, about a reset and some random steps."""
    observation, info = env.reset(seed=seed)
    told = [*(value.tobytes() for value in observation.values()), repr(info).encode()]
    env.action_space.seed(seed)
    for _ in range(steps):
        observation, reward, *ends, info = env.step(env.action_space.sample())
        told += [*(value.tobytes() for value in observation.values()), repr((reward, ends, info)).encode()]
    return told


# ---------------------------------------------------------------------------------------------- what Gymnasium asks for


@pytest.mark.parametrize("arms", ["both", "left", "right"])
def test_gymnasium_s_own_checker_has_nothing_to_say(arms):
    """Spaces, types, seeds, data that is not reused; its warnings are errors here. Pictures have a test of their own."""
    check_env(made(arms=arms), skip_render_check=True)


def test_gymnasium_finds_it_by_its_module_s_name():
    """Nothing else needs to be imported; the time limit is a wrapper's, as Gymnasium has it."""
    env = gymnasium.make(f"gateway.gym:{ENV_ID}")
    assert isinstance(env.unwrapped, PickPlace)
    assert env.spec.max_episode_steps == 400


def test_many_at_once_are_each_one_alone():
    """`make_vec`: both get what a single one with their seed gets."""
    envs = gymnasium.make_vec(ENV_ID, num_envs=2, vectorization_mode="sync", arms="left")
    observations, _ = envs.reset(seed=[1, 2])
    told = envs.step(np.zeros((2, 8), np.float32))
    for number, seed in enumerate((1, 2)):
        env = made(arms="left")
        first, _ = env.reset(seed=seed)
        then, *_ = env.step(np.zeros(8, np.float32))
        assert (observations["state"][number] == first["state"]).all()
        assert (told[0]["state"][number] == then["state"]).all()
    envs.close()


def test_the_same_seed_gives_the_same_bits():
    """Twice in one environment, in another one, and in another process with another seed of hashes."""
    env = made()
    first = played(env, 7, 5)
    assert played(env, 8, 5) != first
    assert played(env, 7, 5) == first == played(made(), 7, 5)
    program = "from tests.gym.test_pick_place import *; print(b''.join(played(made(), 7, 5)).hex())"
    other = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env={**os.environ, "PYTHONHASHSEED": "1", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert bytes.fromhex(other.stdout) == b"".join(first)


# ------------------------------------------------------------------------------------------------------------ the task


@pytest.mark.parametrize("arms", ["both", "left"])
def test_the_task_can_be_done(arms):
    """Pick from above, put down, let go: success ends the episode with 1, and its dense rewards add up to the way gone."""
    env = made(arms=arms, dense=True)
    observation, info = env.reset(seed=4)
    begin_m = np.linalg.norm(observation["block"][:3] - observation["goal"])
    assert info == {"is_success": False, "limited": (), "told": (), "latches": ()}
    rewards = []
    for action in actions(env, observation):
        observation, reward, terminated, truncated, info = env.step(action)
        rewards.append(reward)
        assert not truncated and not info["latches"]
        if terminated:
            break
    assert terminated and info["is_success"]
    assert np.linalg.norm(observation["block"][:3] - observation["goal"]) < 0.025
    assert sum(rewards) > 1.0 + 1.5 * begin_m
    assert env.step(rest(made(), observation)[: len(action)])[2]  # it stays done


def test_the_block_lies_elsewhere_each_time_and_within_reach():
    """Within its bounds, which the shoulder's frame moves."""
    env = made()
    places = np.array([env.reset(seed=seed)[0]["block"][:3] for seed in range(12)])
    assert (np.ptp(places, axis=0)[:2] > (0.02, 0.03)).all() and np.ptp(places[:, 2]) < 1e-3
    assert places[:, 0].min() > 0.30 and places[:, 0].max() < 0.38


def test_doing_nothing_is_never_rewarded_and_is_truncated():
    """Sparse: 0 at each step; time ends it, not the task."""
    env = gymnasium.make(ENV_ID, max_episode_steps=5)
    observation, _ = env.reset(seed=0)
    action = rest(env.unwrapped, observation)
    told = [env.step(action) for _ in range(5)]
    assert [reward for _, reward, *_ in told] == [0.0] * 5
    assert [ends[2:4] for ends in told] == [(False, False)] * 4 + [(False, True)]
    assert all(info["told"] == () for *_, info in told)


def test_state_is_in_the_order_and_units_of_data_sets():
    """Joints where the arms stand, grippers, no speed; gravity in the efforts; the hand where the block is to be picked."""
    env = made()
    observation, _ = env.reset(seed=0)
    state = dict(zip(STATE, observation["state"].tolist(), strict=True))
    assert len(STATE) == 62
    assert state["left_joint4_position"] == pytest.approx(2.10, abs=0.01)
    assert state["right_joint4_position"] == pytest.approx(-2.10, abs=0.01)
    assert state["left_gripper_position"] == pytest.approx(0.5, abs=0.05)
    assert abs(state["left_joint1_velocity"]) < 0.05 < 0.5 < abs(state["left_joint1_effort"])
    hand = [state[f"left_ee_position_{axis}"] for axis in "xyz"]
    assert np.linalg.norm(np.array(hand) - observation["block"][:3]) < 0.35
    assert env.to_units(rest(env, observation))[:7] == pytest.approx(observation["state"][:7], abs=1e-6)


# ------------------------------------------------------------------------------------------------------------ the gateway


def watched(env: PickPlace) -> tuple[list[Frame], set[Code]]:
    """Return lists that fill with what the engine sends and latches."""
    frames: list[Frame] = []
    latches: set[Code] = set()
    tick = env._robot.engine.tick

    def see(now_ns: int, late_ns: int = 0) -> object:
        output = tick(now_ns, late_ns)
        frames.extend(output.frames)
        latches.update(env._robot.engine.latches)
        return output

    env._robot.engine.tick = see  # type: ignore[method-assign]  # a tap for this test
    return frames, latches


@pytest.mark.parametrize("seed", range(3))
def test_whatever_is_asked_setpoints_keep_the_limits_and_the_gate_refuses_none(seed):
    """Random targets and extreme ones, after the end of an episode too: position, velocity, acceleration and jerk are kept."""
    env = made()
    env.reset(seed=seed)
    frames, latches = watched(env)
    generator = np.random.default_rng(seed)
    limited = set()
    for _ in range(80):
        action = np.clip(generator.normal(0.0, (0.2, 1.0, 5.0)[seed], 16), -9.0, 9.0).astype(np.float32)
        *_, info = env.step(action)
        limited.update(info["limited"])
    arm = Settings().arm
    for side in Side:
        sent = np.array([frame.values for frame in frames if frame.topic == joint_command(side)])
        assert len(sent) > 50 and limited
        assert (sent >= JOINT_LOWER_RAD[side]).all() and (sent <= JOINT_UPPER_RAD[side]).all()
        for order, bound in enumerate((arm.v_radps, arm.a_radps2, arm.j_radps3), start=1):
            steps = np.abs(np.diff(sent, order, axis=0))
            assert steps.max() <= bound / arm.rate_hz**order + order * 2e-6
    assert Code.GATE_VIOLATION not in latches
    assert all(robot_arm.clips == 0 for robot_arm in env._robot.robot.arms.values())


def test_an_arm_that_is_pushed_against_the_table_ends_the_episode_with_the_engine_s_reason():
    """The engine latches, as it would on a robot, and says why; nobody calls it a success."""
    env = made(arms="left")
    env.reset(seed=0)
    through_the_table = env.to_action(np.array([*HANGING_RAD[SimSide.LEFT], 0.1]))
    for _ in range(100):
        _, reward, terminated, _, info = env.step(through_the_table)
        if terminated:
            break
    assert terminated and reward == 0.0 and not info["is_success"]
    assert any(text.startswith("TRACKING_ERROR: ") for text in info["latches"])
    assert any("LATCH_CHANGED: " in text for text in info["told"])


def test_a_block_on_its_mark_is_no_success_where_the_engine_latched():
    """Whoever moves the robot on would be paid for each step of a robot that has to be recovered."""
    env = made(arms="right")
    env.reset(seed=0)
    through_the_table = env.to_action(np.array([*HANGING_RAD[SimSide.RIGHT], 0.1]))
    while not env.step(through_the_table)[2]:
        pass
    env._robot.world.pose_thing("block", tuple(env._goal_m))
    _, env._block_m = env._measure()
    _, reward, terminated, _, info = env.step(through_the_table)
    assert env._is_done(0.0)  # but for that
    assert terminated and reward == 0.0 and not info["is_success"] and info["latches"]


def test_the_gateway_s_settings_hold():
    """Tighter limits are those of actions; with arms kept apart, hands that would meet stop short of it."""
    lower = {**Settings().arm.lower_rad, Side.LEFT: (-0.5, *JOINT_LOWER_RAD[Side.LEFT][1:])}
    settings = Settings(arm=ArmSettings(lower_rad=lower), model=ModelSettings(self_collision=True))
    env = made(settings=settings)
    assert env.to_units(-np.ones(16))[0] == -0.5
    observation, info = env.reset(seed=0)
    assert not info["told"]
    there = joints(np.array([0.33, -0.20, -0.38]), observation["state"][:7].astype(float))
    infos = [env.step(env.to_action(np.array([*there, 0.1, *-there, 0.1])))[-1] for _ in range(60)]
    assert any(text.startswith("COLLISION_AHEAD: ") for info in infos for text in info["told"])
    assert set(infos[-1]["limited"]) == {"left", "right"} and not infos[-1]["latches"]
    hands_m = [np.array(env._robot.world.place(f"{side}_ee").position_m) for side in Side]
    assert np.linalg.norm(hands_m[0] - hands_m[1]) > 0.14  # without it the fingers meet at 0.125


@pytest.mark.parametrize(
    ("options", "text"), [({"arms": "none"}, "none"), ({"rate_hz": 0.5}, "rate_hz is 0.5"), ({"rate_hz": 51.0}, "51")]
)
def test_what_there_is_not_is_refused(options, text):
    """Arms and rates."""
    with pytest.raises(ValueError, match=text):
        PickPlace(**options)


@pytest.mark.parametrize("action", [np.zeros(8), np.full(16, np.nan)])
def test_a_wrong_action_is_refused(action):
    """Another shape, or a number that is none: nothing moves."""
    env = made()
    env.reset(seed=0)
    with pytest.raises(ValueError, match="16"):
        env.step(action)


def test_the_rate_is_that_of_virtual_time():
    """50 actions a second, or 3."""
    for rate_hz in (50.0, 3.0):
        env = made(rate_hz=rate_hz)
        observation, _ = env.reset(seed=0)
        before_ns = env._robot.now_ns
        for _ in range(3):
            env.step(rest(env, observation))
        assert env._robot.now_ns - before_ns == 3 * round(1e9 / rate_hz)
        assert env.metadata["render_fps"] == round(rate_hz)


# ------------------------------------------------------------------------------------------------------------- pictures


@pytest.fixture
def seeing() -> Iterator[PickPlace]:
    """An environment with pictures."""
    demand_drawing()
    env = made(pictures=True, render_mode="rgb_array")
    yield env
    env.close()


def test_pictures_show_the_scene_from_the_eyes_and_from_the_side(seeing):
    """The block is red: the left wrist and who looks from the side see it; a second view in this thread changes nothing."""
    observation, _ = seeing.reset(seed=0)
    assert observation in seeing.observation_space
    head_red, head_green, _ = np.moveaxis(observation["head_camera"].astype(int), -1, 0)
    assert ((head_green > 100) & (head_green > 2 * head_red)).sum() > 20  # the mark
    side = seeing.render()
    for picture in (observation["left_color"], side):
        red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
        assert ((red > 100) & (red > 2 * green) & (red > 2 * blue)).sum() > 20
    other = made(render_mode="rgb_array")
    other.reset(seed=1)
    other.render()
    assert (seeing.render() == side).all()
    other.close()
    assert (seeing.render() == side).all()
    seeing.close()
    seeing.close()
    again, _ = seeing.reset(seed=0)
    assert all((again[name] == picture).all() for name, picture in observation.items())


def test_pictures_are_those_that_policies_are_shown_of_the_robot_s_own_views(seeing):
    """Whole between black bars, and as wide and high an angle as the eye has, but for the sharpness of a smaller drawing."""
    observation, _ = seeing.reset(seed=0)
    positions = seeing._robot.world.positions()
    with Drawing(has_lift=True, width=1280, height=1280) as large:
        large.pose(positions)
        for name, view in seeing._eyes.items():
            lens = lens_of(body_numbers().cameras[view.split("_eye")[0].rpartition("_")[0]], EYES[view].size_px)
            wanted = resized(lens.see(large.look(view, *lens.drawn, lens.fovy_deg)), 224)
            assert np.abs(wanted.astype(int) - observation[name]).mean() < 4.0, name


@pytest.mark.slow
def test_the_checker_has_nothing_to_say_with_pictures(seeing):
    """All of it, rendering included."""
    check_env(seeing)


def test_without_a_render_mode_there_is_no_picture():
    """None, as Gymnasium has it."""
    env = made()
    env.reset(seed=0)
    assert env.render() is None


def test_the_programs_of_its_page_do_what_it_says(capsys):
    """Both run as they stand there, and the second one prints what the page says."""
    page = (ROOT / "docs/how-to/gym.md").read_text(encoding="utf-8")
    first, second = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    (output,) = re.findall(r"```text\n(.*?)```", page, flags=re.DOTALL)
    exec(first, {})
    capsys.readouterr()
    exec(second, {})
    assert capsys.readouterr().out == output
