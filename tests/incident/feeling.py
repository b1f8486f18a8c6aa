"""An engine with `model.dynamics`."""

from __future__ import annotations

import pytest

from gateway.core.robot_state.body_model import body_model
from gateway.core.robot_state.contact import Contacts
from gateway.kinematics.dynamics.loading import load_dynamics
from gateway.settings.settings import Settings
from gateway.sim.robot.settings import SimSettings
from tests.changed import replace
from tests.pair import COMPLIANCE_RADPNM, MS, Pair


def feeling(mode: str = "joint") -> Pair:
    """Return an engine that also works out what pulls at its arms, and its robot, its left arm in a control mode."""
    pytest.importorskip("pinocchio", reason="pinocchio is not installed: pip install 'teleavatar-gateway[body]'")
    settings = Settings()
    settings = replace(settings, model=replace(settings.model, self_collision=mode == "joint", dynamics=True))
    model = body_model(settings)
    assert model is not None
    model.contacts = Contacts(load_dynamics(settings), model.refusal)
    sim = SimSettings(state_period_ns=10 * MS, compliance_radpnm=COMPLIANCE_RADPNM, left_mode=mode)
    return Pair(settings, sim, model=model)
