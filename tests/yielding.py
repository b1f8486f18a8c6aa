"""A robot with forces and its gateway in virtual time: the left arm yields to whoever pulls at its hand, on another plant."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from gateway.core.messages.events import TargetArrived
from gateway.core.robot_state.body_model import body_model
from gateway.core.robot_state.contact import Contacts
from gateway.kinematics.description import arm_joint
from gateway.kinematics.dynamics.loading import load_dynamics
from gateway.messages.incoming import Admittance
from gateway.messages.requests import OpenStream
from gateway.robot.limits import HOME_Q_RAD
from gateway.robot.topics import STATE_TOPICS, arm_state, ee_pose, shoulder_frame
from gateway.settings.settings import Settings
from gateway.sim.robot.settings import SimSettings
from gateway.values import Side, Space
from tests.pair import MS, S, Pair

__all__ = ["FREE", "LEFT", "Yielding"]

LEFT = Side.LEFT
FREE = {"mass": (8.0,) * 3 + (None,) * 3, "damping": (90.0,) * 3 + (0.0,) * 3, "stiffness": (0.0,) * 6}
"""A mass that may be shifted, and comes to rest where it is let go."""


class Yielding(Pair):
    """An ACTIVE robot at home whose left arm takes poses.

    Args:
        off: By how much masses, friction and efforts of the arms are off the model.
    """

    def __init__(self, off=0.08, seed=1, **model):
        settings = Settings()
        settings = replace(settings, model=replace(settings.model, dynamics=True, **model))
        body = body_model(settings)
        body.contacts = Contacts(load_dynamics(settings), body.refusal)
        sim = SimSettings(
            physics="mujoco", left_mode="pose", state_period_ns=5 * MS, start_rad={side: HOME_Q_RAD[side] for side in Side}
        )
        super().__init__(settings, sim, model=body)
        self.topics = STATE_TOPICS
        self.world = self.robot.dynamics.world
        self._spoil(off, seed)
        self.site = self.world.model.site("left_ee").id
        self.body = self.world.model.site_bodyid[self.site]
        self.pull = None
        """Force on the left hand by where it is and how it moves, in the ground's axes."""
        self.seq = 0
        self.epoch = self.activate()
        self.run(1.0)

    def _spoil(self, off, seed):
        """Let the plant be another one than the model."""
        rng, model = np.random.default_rng(seed), self.world.model
        for number in range(1, 8):
            joint = model.joint(arm_joint(LEFT, number)).id
            link, dof = model.jnt_bodyid[joint], model.jnt_dofadr[joint]
            heavier, rubs = 1.0 + off * rng.choice([-1.0, 1.0], 2)
            model.body_mass[link] *= heavier
            model.body_inertia[link] *= heavier
            model.dof_frictionloss[dof] *= rubs
        stood = self.world.data.qpos.copy()
        mujoco.mj_setConst(model, self.world.data)
        self.world.data.qpos[:] = stood
        mujoco.mj_forward(model, self.world.data)

    def yields(self, **how):
        """Let the left arm yield; return the reply."""
        wish = {**FREE, **how.pop("wish", {})}
        asked = OpenStream(
            epoch=self.epoch, side=LEFT, space=Space.POSE, frame=shoulder_frame(LEFT), admittance=Admittance(**wish), **how
        )
        facts = self.granted(asked)
        self.stream_id, self.anchor = facts["stream_id"], tuple(facts["values"])
        return facts

    @property
    def hand(self):
        """Where the hand is, and how it moves, in the ground's axes, which are the shoulder's but for the place."""
        data = self.world.data
        speed = np.zeros(6)
        mujoco.mj_objectVelocity(self.world.model, data, mujoco.mjtObj.mjOBJ_SITE, self.site, speed, 0)
        return data.site_xpos[self.site].copy(), speed[3:]

    def step(self, to_ns=None):
        """Let the hand be pulled as it is now."""
        if self.pull is not None:
            place, speed = self.hand
            force = self.pull(place, speed)
            lever = place - self.world.data.xipos[self.body]
            self.world.data.xfrc_applied[self.body] = (*force, *np.cross(lever, force))
        return super().step(to_ns)

    def guide(self, seconds, pull=None, *, every_ns=100 * MS):
        """Let time pass while somebody pulls and the client says that it is there; return places, setpoints and forces."""
        self.pull = pull or (lambda place, speed: np.zeros(3))
        until_ns, said_ns, rows = self.now_ns + round(seconds * S), 0, []
        arm = self.engine._coordinator.body.pose_arms[LEFT]
        while self.now_ns < until_ns:
            if self.now_ns - said_ns >= every_ns:
                said_ns, self.seq = self.now_ns, self.seq + 1
                self.receive(
                    TargetArrived(
                        client_id="user",
                        stream_id=self.stream_id,
                        epoch=self.epoch,
                        seq=self.seq,
                        values=self.anchor,
                        received_ns=self.now_ns,
                    )
                )
            self.step()
            place, speed = self.hand
            seen = self.model.contacts.view(LEFT, self.now_ns)
            rows.append((self.now_ns / S, *place, *arm.values[:3], *self.pull(place, speed), *[x or 0.0 for x in (seen.wrench or (0,)*6)[:3]], *[x or 0.0 for x in (seen.wrench_sd or (0,)*6)[:3]]))
        return np.array(rows)


def held(place_m, stiffness=300.0, damping=20.0):
    """A person who leads the hand: a spring to where it shall be, and a damper."""
    return lambda place, speed: stiffness * (np.asarray(place_m) - place) - damping * speed
