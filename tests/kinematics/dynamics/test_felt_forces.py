"""What an arm feels in the simulation with forces, in virtual time: its motors, friction and noise, and a known pull."""

from __future__ import annotations

import numpy as np
import pytest

REASON = "pinocchio or MuJoCo is not installed: pip install 'teleavatar-gateway[body,sim]'"
pytest.importorskip("pinocchio", reason=REASON)
mujoco = pytest.importorskip("mujoco", reason=REASON)

from gateway.core.engine import Engine
from gateway.core.robot_state.contact import Contacts
from gateway.gym import virtual_robot
from gateway.gym.virtual_robot import VirtualRobot
from gateway.kinematics.dynamics.loading import load_dynamics
from gateway.robot.limits import HOME_Q_RAD
from gateway.settings.settings import ModelSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side

S = 1_000_000_000
SETTINGS = Settings(model=ModelSettings(self_collision=True, dynamics=True))
PULL_N = np.array([4.0, -6.0, -12.0])
LEFT = Side.LEFT


class Felt:
    """An enabled robot with forces and its gateway, which feels; snapshots as they come."""

    def __init__(self, monkeypatch):
        made: list[Engine] = []

        class Feeling(Engine):
            def __init__(self, settings, remembered, model):
                model.contacts = Contacts(load_dynamics(settings), model.refusal)
                super().__init__(settings, remembered, model)
                made.append(self)

        monkeypatch.setattr(virtual_robot, "Engine", Feeling)
        sim = SimSettings(physics="mujoco", start_rad={side: HOME_Q_RAD[side] for side in Side})
        self.robot = VirtualRobot(SETTINGS, sim)
        self.world = self.robot.world
        self.body = self.world.model.site_bodyid[self.world.model.site("left_ee").id]

    def run(self, seconds, pull_n=(0.0, 0.0, 0.0), period_ns=10_000_000):
        """Let time pass while something pulls at the left hand, along the ground's axes; return contacts."""
        data, found = self.world.data, []
        for _ in range(round(seconds * S / period_ns)):
            lever = data.site("left_ee").xpos - data.xipos[self.body]
            data.xfrc_applied[self.body] = (*pull_n, *np.cross(lever, pull_n))
            self.robot.run(self.robot.now_ns + period_ns)
            found.append(self.contact)
        return found

    @property
    def contact(self):
        """What the newest snapshot says of the left arm."""
        return self.robot._snapshot.arms["left"].contact


@pytest.fixture
def felt(monkeypatch):
    """One with both arms at the home of §6.6."""
    return Felt(monkeypatch)


def test_a_known_pull_is_found_within_its_time_constant_and_lost_again(felt):
    """What the difference of the estimate says; the rest is the hand's moving parts and friction, within the stated sigma."""
    for side in Side:
        felt.robot.aim(side, HOME_Q_RAD[side], 0.1)
    before = felt.run(1.0)[-1]
    assert before.state == "known" and before.frame == "left_shoulder_base" and before.basis == "nominal"
    assert (np.abs(before.torque_nm) < 3.0 * np.array(before.torque_sd_nm)).all() and before.sigmas < 3.0
    pulled = felt.run(1.5, PULL_N)
    change = np.array(pulled[-1].wrench[:3]) - np.array(before.wrench[:3])
    # Friction of the joints (1 % of the motors' torque) hides what it holds: 0.4 N·m over half a metre.
    assert change == pytest.approx(PULL_N, abs=1.5)  # the axes of shoulder and ground are the same: x forward, z up
    torques = np.array([contact.torque_nm for contact in pulled])
    strongest = np.argmax(np.abs(torques[-1] - before.torque_nm))
    rise = (torques[:, strongest] - before.torque_nm[strongest]) / (torques[-1] - before.torque_nm)[strongest]
    assert rise[5] > 0.5 and rise[10] > 0.7, (
        "after two time constants, and three; what friction takes on it takes later"
    )
    after = felt.run(1.5)[-1]
    assert np.array(after.wrench[:3]) == pytest.approx(np.array(before.wrench[:3]), abs=1.5)


def test_free_motion_is_within_the_stated_sigma(felt):
    """Both arms swing about; no joint is ever pulled by four standard deviations, hardly by three."""
    sigmas, home = [], {side: np.array(HOME_Q_RAD[side]) for side in Side}
    for number in range(150):
        for side in Side:
            swing = 0.25 * np.sin(0.04 * number * np.arange(1.0, 8.0) ** 0.5)
            felt.robot.aim(side, tuple((home[side] + swing).tolist()), 0.1)
        sigmas += [contact.sigmas for contact in felt.run(0.04)]
    assert max(sigmas) < 4.0 and np.mean(np.array(sigmas) > 3.0) < 0.01
