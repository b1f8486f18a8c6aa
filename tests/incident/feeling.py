"""An engine with `model.dynamics`."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gateway.core.robot_state.body_model import body_model
from gateway.core.robot_state.contact import Contacts
from gateway.kinematics.dynamics.loading import load_dynamics
from gateway.settings.settings import Settings
from tests.pair import Pair


def feeling() -> Pair:
    """Return an engine that also works out what pulls at its arms, and its robot."""
    pytest.importorskip("pinocchio", reason="pinocchio is not installed: pip install 'teleavatar-gateway[body]'")
    settings = Settings()
    settings = replace(settings, model=replace(settings.model, self_collision=True, dynamics=True))
    model = body_model(settings)
    assert model is not None
    model.contacts = Contacts(load_dynamics(settings), model.refusal)
    return Pair(settings, model=model)
