"""What pulls at the arms, and every reason why that is not known, on an arm that is worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.core.robot_state.contact import STALE_NS, Contact, Contacts, Unfelt
from gateway.errors import Code, Refusal
from gateway.kinematics.dynamics.observer import MomentumObserver
from gateway.kinematics.dynamics.parameters import Load
from gateway.kinematics.dynamics.weighing import Weighed
from gateway.messages.body_views import ContactView
from gateway.values import ArmState, Side
from tests.kinematics.dynamics.plants import JACOBIAN, WEIGHT, Plant

MS = 1_000_000
LEFT, RIGHT = Side.LEFT, Side.RIGHT
REST = (0.0,) * 7
PULLED = (-1.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0)
REFUSAL = Refusal(code=Code.MODEL_DIFFERS, message="the model of the left arm cannot be relied on: 9 mm off")
BLIND = np.vstack((np.zeros((1, 7)), np.eye(7)[1:6]))
"""A posture in which a force along x turns no joint."""


class Scene:
    """Arms at rest whose motors hold their weights, and a pull beside."""

    def __init__(self, jacobian=JACOBIAN):
        self.refused: Refusal | None = None
        self.arms = {side: Plant(jacobian, unsure_part=0.0, friction_sd_nm=(0.1,) * 7) for side in Side}
        self.contacts = Contacts(self.arms, lambda side, now_ns: self.refused)
        self.now_ns = 0

    def hear(self, seconds=0.5, *, sides=(LEFT,), pull=PULLED, dq=REST, tau=None):
        """Let time pass."""
        for _ in range(round(100 * seconds)):
            self.now_ns += 10 * MS
            tau_nm = tuple((WEIGHT - np.array(pull)).tolist()) if tau is None else tau
            for side in sides:
                state = ArmState(q_rad=REST, dq_radps=dq, tau_nm=tau_nm, stamp_ns=self.now_ns)
                self.contacts.hear(side, state, self.now_ns, ())
        return self

    def why(self, side=LEFT, after_ns=0):
        """Return the code of the reason."""
        found = self.contacts.contact(side, self.now_ns + after_ns)
        assert isinstance(found, Unfelt) and found.reason
        return found.code


def test_what_pulls_at_an_arm_is_told_with_how_sure_it_is():
    """Torques, the wrench at the hand in a named frame, standard deviations; and the other arm by its own samples."""
    scene = Scene().hear()
    found = scene.contacts.contact(LEFT, scene.now_ns)
    assert isinstance(found, Contact)
    assert found.torque_nm == pytest.approx(PULLED, abs=1e-3) and found.torque_sd_nm == pytest.approx(0.1, rel=1e-3)
    assert found.sigmas == pytest.approx(20.0, rel=1e-3)
    view = scene.contacts.view(LEFT, scene.now_ns + 7 * MS)
    assert (view.state, view.code, view.reason, view.basis) == ("known", "", "", "nominal")
    assert (view.frame, view.point, view.unknown, view.age_ns) == ("left_shoulder_base", "left_ee", (), 7 * MS)
    assert view.torque_nm == tuple(found.torque_nm.tolist()) and len(view.torque_sd_nm) == 7
    assert view.wrench == pytest.approx(PULLED[:6], abs=1e-3) and view.wrench_sd == pytest.approx((0.1,) * 6, rel=1e-3)
    assert scene.why(RIGHT) == "PART_STALE"


def test_an_estimate_that_fails_ends_nothing_but_itself(monkeypatch):
    """From then on it is unknown, with the place, whether it failed as joints came or as somebody looked."""
    for where, name in ((Plant, "terms"), (MomentumObserver, "variance_nm2")):
        scene = Scene().hear()
        with monkeypatch.context() as broken:
            broken.setattr(where, name, _fail)
            scene.hear()
            views = [scene.contacts.view(side, scene.now_ns) for side in (LEFT, RIGHT, LEFT)]
        assert {view.state for view in views} == {"unknown"} and (views[2].code, views[2].torque_nm) == ("BROKEN", ())
        assert "LinAlgError in _fail, line" in views[2].reason and "singular" in views[2].reason
        scene.contacts.forget()
        assert scene.hear().why() == "BROKEN"


def _fail(*_):
    raise np.linalg.LinAlgError("singular")


def test_a_component_that_is_not_felt_is_none_and_its_direction_named():
    """A number would be made of noise."""
    view = Scene(BLIND).hear().contacts.view(LEFT, 500 * MS)
    assert view.wrench[0] is None and view.wrench_sd[0] is None and None not in view.wrench[1:]
    assert view.unknown == (pytest.approx((1.0, 0.0, 0.0, 0.0, 0.0, 0.0)),) or view.unknown[0][0] == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        ({"tau": ()}, "not there"),
        ({"tau": REST}, "all zero"),
        ({"dq": ()}, "velocities"),
        ({"tau": (1e300,) * 7}, "more than any motor gives"),
        ({"tau": (-1e300, *REST[1:])}, "more than any motor gives"),
        ({"dq": (1e300,) * 7}, "more than any motor gives"),
    ],
)
def test_without_efforts_nothing_is_known(sent, words):
    """None, zeros for none, no velocities, or what no motor gives; nor right after they come back."""
    scene = Scene().hear().hear(0.1, **sent)
    assert scene.why() == "NO_EFFORTS" and words in scene.contacts.view(LEFT, scene.now_ns).reason
    scene.hear(0.1)
    assert scene.why() == "NOT_CONVERGED"
    assert isinstance(scene.hear().contacts.contact(LEFT, scene.now_ns), Contact)


def test_whatever_can_be_meant_of_efforts_makes_numbers():
    """Also the wildest that a robot may send, and parameters that are sure of themselves without a doubt."""
    for jacobian in (JACOBIAN, BLIND):
        scene = Scene(jacobian)
        for number in range(50):
            scene.hear(0.01, tau=(1000.0 * (-1) ** number,) * 7, dq=(100.0 * (-1) ** number,) * 7)
        view = scene.contacts.view(LEFT, scene.now_ns)
        assert view.state == "known" and np.isfinite([*view.torque_nm, *view.torque_sd_nm, view.sigmas]).all()
    sure = Contacts({LEFT: Plant(unsure_part=0.0)}, lambda side, now_ns: None)
    for number in range(50):
        state = ArmState(q_rad=REST, dq_radps=REST, tau_nm=tuple(WEIGHT.tolist()), stamp_ns=number * 10 * MS)
        sure.hear(LEFT, state, number * 10 * MS, ())
    assert np.isfinite(sure.view(LEFT, 490 * MS).wrench_sd).all()


def test_while_the_model_cannot_be_relied_on_nothing_is_known():
    """With its own code and words; known again at once when it can."""
    scene = Scene().hear()
    scene.refused = REFUSAL
    assert scene.contacts.view(LEFT, scene.now_ns) == ContactView(
        state="unknown", code="MODEL_DIFFERS", reason=REFUSAL.message, basis="nominal"
    )
    scene.refused = None
    assert isinstance(scene.contacts.contact(LEFT, scene.now_ns), Contact)


def test_old_joints_say_nothing_about_now():
    """A tenth of a second, the age at which no changing setpoint leaves either."""
    scene = Scene().hear()
    assert isinstance(scene.contacts.contact(LEFT, scene.now_ns + STALE_NS), Contact)
    assert scene.why(after_ns=STALE_NS + 1) == "PART_STALE"


def test_another_robot_is_observed_from_its_beginning():
    """Nothing of what was heard before counts."""
    scene = Scene().hear(sides=tuple(Side))
    scene.contacts.forget()
    assert scene.why(LEFT) == scene.why(RIGHT) == "PART_STALE"
    assert scene.hear(0.1).why() == "NOT_CONVERGED"


def swings(count=3, noise_nm=0.01):
    """What is measured of nothing, in postures that tell."""
    rows = np.zeros((count, 7))
    return {"q_rad": rows + np.arange(count)[:, None], "up_nm": rows, "down_nm": rows, "noise_nm": rows + noise_nm}


def test_a_load_is_counted_on_from_when_it_is_said_until_the_robot_is_lost():
    """The estimate begins anew, but not where the same is said again; it is shown whether anything else is known or not."""
    scene, load = Scene().hear(), Load(mass_kg=0.3, com_m=(0.1, 0.0, 0.0))
    assert scene.contacts.view(LEFT, scene.now_ns).load_kg == 0.0
    scene.contacts.carry(LEFT, load.mass_kg, load.com_m)
    assert scene.why() == "NOT_CONVERGED" and scene.arms[LEFT].load == load and scene.arms[RIGHT].load is None
    view = scene.contacts.view(LEFT, scene.now_ns)
    assert (view.state, view.load_kg, view.load_com_m) == ("unknown", 0.3, (0.1, 0.0, 0.0))
    scene.hear().contacts.carry(LEFT, load.mass_kg, load.com_m)
    view = scene.contacts.view(LEFT, scene.now_ns)
    assert (view.state, view.load_kg, view.load_com_m) == ("known", 0.3, (0.1, 0.0, 0.0))
    scene.contacts.forget()
    assert scene.arms[LEFT].load is None and scene.hear().contacts.view(LEFT, scene.now_ns).load_com_m == ()
    scene.contacts.carry(LEFT, load.mass_kg, load.com_m)
    scene.hear().contacts.carry(LEFT, 0.0)
    assert scene.why() == "NOT_CONVERGED" and scene.arms[LEFT].load is None


def test_what_a_hand_holds_is_worked_out_while_the_model_can_be_relied_on(monkeypatch):
    """Else the model's own refusal; what cannot be told, or has no solution, is said with its arm."""
    scene = Scene()
    found = scene.contacts.weigh(LEFT, 0, beside_empty=False, **swings())
    assert isinstance(found, Weighed) and found.mass_kg == pytest.approx(0.0)
    alone = scene.contacts.weigh(LEFT, 0, beside_empty=False, **swings(1))
    assert isinstance(alone, Refusal) and (alone.code, alone.field) == (Code.CANNOT_WEIGH, "left_arm")
    monkeypatch.setattr(Plant, "load_columns", _fail)
    failed = scene.contacts.weigh(LEFT, 0, beside_empty=False, **swings())
    assert isinstance(failed, Refusal) and "no solution (singular)" in failed.message
    scene.refused = REFUSAL
    assert scene.contacts.weigh(LEFT, 0, beside_empty=False, **swings()) is REFUSAL
