"""A robot with forces and its gateway in virtual time: the left arm yields to whoever pulls at its hand, on another plant."""

from __future__ import annotations

import mujoco
import numpy as np

from gateway.core.messages.events import TargetArrived
from gateway.core.robot_state.body_model import body_model
from gateway.core.robot_state.contact import Contacts
from gateway.kinematics.description import arm_joint, nominal
from gateway.kinematics.dynamics.arm_dynamics import ArmDynamics
from gateway.kinematics.dynamics.parameters import nominal_parameters
from gateway.messages.incoming import Admittance
from gateway.messages.requests import OpenStream
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import STATE_TOPICS, shoulder_frame
from gateway.settings.settings import LinkSettings, LocalSettings, PoseSettings, Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side, Space
from tests.changed import replace
from tests.pair import MS, Pair, S

__all__ = ["FREE", "LEFT", "Yielding", "held", "let_go", "steady"]

LEFT = Side.LEFT
FREE = {"mass": (10.0,) * 3 + (None,) * 3, "damping": (150.0,) * 3 + (0.0,) * 3, "stiffness": (0.0,) * 6}
"""A mass that may be shifted, and stays where it is let go."""
IDENTIFIED = {"unsure_part": 0.05, "friction_sd_nm": (0.4, 0.4, 0.4, 0.4, 0.15, 0.15, 0.15)}
"""How sure parameters are that `ta2 identify --dynamics` found."""


def let_go(place, speed):
    """Nobody is there."""
    return np.zeros(6)


def held(where_m, stiffness=300.0, damping=20.0):
    """Somebody leads the hand: a spring to where it shall be [m], and a damper."""
    return lambda place, speed: np.array([*(stiffness * (where_m - place) - damping * speed[:3]), 0.0, 0.0, 0.0])


def steady(force_n):
    """Something pulls, the same all the time [N]."""
    return lambda place, speed: np.array([*force_n, 0.0, 0.0, 0.0])


class Yielding(Pair):
    """An ACTIVE robot at home whose left arm takes poses.

    Args:
        off: By how much masses and friction of the left arm are off the model.
        sim: Of the robot, beside.
        is_identified: Whether the model is as sure of itself as one that was identified.
    """

    def __init__(self, off=0.05, *, is_identified=True, **sim):
        pose = PoseSettings(tracking_m=0.1)  # its servos are soft: 20 N shift the hand by 4 to 8 cm
        settings = Settings(link=LinkSettings(model="lift"), local=LocalSettings(snapshot_hz=10.0), pose=pose)
        settings = replace(settings, model=replace(settings.model, dynamics=True))
        body, more = body_model(settings), IDENTIFIED if is_identified else {}
        arms = {side: replace(nominal_parameters(nominal(), side), **more) for side in Side}
        dynamics = {side: ArmDynamics(nominal(), side, drives) for side, drives in arms.items()}
        body.contacts = Contacts(dynamics, body.refusal)
        start = {"start_rad": {side: HOME_Q_RAD[side] for side in Side}, "start_lowered_m": 0.20}
        robot = {"model": "lift", "physics": "mujoco", "left_mode": "pose", "state_period_ns": 10 * MS}
        super().__init__(settings, SimSettings(**robot, **start, **sim), model=body)
        self.topics = STATE_TOPICS
        self.world = self.robot.dynamics.world
        self._spoil(off)
        self.site = self.world.model.site("left_ee").id
        self.link = self.world.model.site_bodyid[self.site]
        self.pull = let_go
        """Force and moment on the hand by its place and its velocity, all in the ground's axes."""
        self.seq = 0
        self.epoch = self.activate()
        self.run_until(lambda: self.model.contacts.view(LEFT, self.now_ns).state == "known")
        self.arm = self.engine._coordinator.body.pose_arms[LEFT]

    def _spoil(self, off):
        rng, model, data = np.random.default_rng(1), self.world.model, self.world.data
        for number in range(1, 8):
            joint = model.joint(arm_joint(LEFT, number)).id
            link, dof = model.jnt_bodyid[joint], model.jnt_dofadr[joint]
            heavier, rubs = 1.0 + off * rng.choice([-1.0, 1.0], 2)
            model.body_mass[link] *= heavier
            model.body_inertia[link] *= heavier
            model.dof_frictionloss[dof] *= rubs
        stood = data.qpos.copy()
        mujoco.mj_setConst(model, data)
        data.qpos[:] = stood
        mujoco.mj_forward(model, data)

    def asked(self, wish=None, **how):
        """The request to let the left arm yield."""
        wish = Admittance(**{**FREE, **(wish or {})})
        frame = shoulder_frame(LEFT)
        return OpenStream(epoch=self.epoch, side=LEFT, space=Space.POSE, frame=frame, admittance=wish, **how)

    def yields(self, wish=None, **how):
        """Let the left arm yield."""
        facts = self.granted(self.asked(wish, **how))
        self.stream_id, self.anchor = facts["stream_id"], tuple(facts["values"])

    @property
    def hand(self):
        """Place [m] and velocity [m/s, rad/s] of the hand in the ground's axes, which are the shoulder's."""
        data, speed = self.world.data, np.zeros(6)
        mujoco.mj_objectVelocity(self.world.model, data, mujoco.mjtObj.mjOBJ_SITE, self.site, speed, 0)
        return data.site_xpos[self.site].copy(), np.roll(speed, 3)

    def touches_table(self):
        """Whether a part of the left hand does."""
        geoms, touches = self.world.model.geom, self.world.data.contact
        pairs = [{geoms(touch.geom1).name, geoms(touch.geom2).name} for touch in touches]
        return any("table" in pair and any(name.startswith("left_") for name in pair) for pair in pairs)

    def step(self, to_ns=None):
        """Let the hand be pulled as it is now."""
        place, speed = self.hand
        wrench = self.pull(place, speed)
        lever = np.cross(place - self.world.data.xipos[self.link], wrench[:3])
        self.world.data.xfrc_applied[self.link] = (*wrench[:3], *(wrench[3:] + lever))
        return super().step(to_ns)

    def says(self):
        """The client says that it is there, and where the anchor is."""
        self.seq += 1
        asked = {"client_id": "user", "stream_id": self.stream_id, "epoch": self.epoch, "seq": self.seq}
        self.receive(TargetArrived(**asked, values=self.anchor, received_ns=self.now_ns))

    def guide(self, seconds, pull=let_go):
        """Let time pass while somebody pulls; return places of the hand and setpoints, each tick's [m], shape (n, 2, 3)."""
        self.pull, rows, said_ns, until_ns = pull, [], 0, self.now_ns + round(seconds * S)
        while self.now_ns < until_ns:
            if self.now_ns - said_ns >= 100 * MS:
                said_ns = self.now_ns
                self.says()
            self.step()
            rows.append((self.hand[0], self.arm.values[:3]))
        return np.array(rows)
