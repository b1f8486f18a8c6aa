"""Requests about what a hand holds: who may, what is counted on, worked out, and refused."""

from __future__ import annotations

import math

import pytest

from gateway.core.requests.authorisation import Authorisation
from gateway.core.requests.weighing import Weighing
from gateway.core.robot_state.body_model import body_model
from gateway.core.robot_state.contact import Contacts
from gateway.errors import Code, Refusal
from gateway.kinematics.dynamics.parameters import Load
from gateway.messages.requests import SetPayload, Weigh
from gateway.robot.limits import MAX_PAYLOAD_KG, MAX_PAYLOAD_M
from gateway.settings.settings import ModelSettings, Settings
from gateway.values import Side
from tests.core.stage import L, R, Stage
from tests.kinematics.dynamics.plants import Plant

ZEROS = ((0.0,) * 7,) * 3
POSTURES = tuple((float(number),) * 7 for number in range(3))
NOISE = ((0.01,) * 7,) * 3


class Scene(Stage):
    """A stage that feels, and a place that takes requests for loads; `refused` is why the model cannot be relied on."""

    def __init__(self, *, feels: bool = True) -> None:
        super().__init__()
        self.weighing = Weighing(self.coordinator, Authorisation(self.coordinator, self.phases.starting))
        self.arms = {side: Plant() for side in Side}
        self.refused: Refusal | None = None
        self.coordinator.model = body_model(Settings(model=ModelSettings()))
        assert self.coordinator.model is not None
        if feels:
            self.coordinator.model.contacts = Contacts(self.arms, lambda side, now_ns: self.refused)

    def say(self, mass_kg=0.3, com_m=(0.1, 0.0, -0.02), side=L, client="ann", epoch=None):
        """Say what a hand holds."""
        epoch = self.epoch if epoch is None else epoch
        request = SetPayload(epoch=epoch, side=side, mass_kg=mass_kg, com_m=com_m)
        return self.weighing.set_payload(self.command(request, client), request, self.now_ns)

    def weigh(self, client="ann", **changes):
        """Ask what it holds."""
        rows = {"q_rad": POSTURES, "up_nm": ZEROS, "down_nm": ZEROS, "noise_nm": NOISE, **changes}
        request = Weigh(epoch=self.epoch, side=L, **rows)
        return self.weighing.weigh(self.command(request, client), request, self.now_ns)


def test_what_a_hand_is_said_to_hold_is_counted_on_until_it_is_said_to_be_empty():
    """The other hand is not concerned."""
    scene = Scene()
    assert scene.say() == {} and scene.arms[L].load == Load(mass_kg=0.3, com_m=(0.1, 0.0, -0.02))
    assert scene.arms[R].load is None
    assert scene.say(0.0) == {} and scene.arms[L].load is None
    assert scene.say(MAX_PAYLOAD_KG, (-MAX_PAYLOAD_M, MAX_PAYLOAD_M, 0.0), R) == {} and scene.arms[R].load is not None


def test_only_the_owner_says_or_asks():
    """Under the current epoch."""
    scene = Scene()
    for answer in (scene.say(client="bob"), scene.say(epoch=0), scene.weigh(client="bob")):
        assert isinstance(answer, Refusal) and answer.code is Code.NOT_OWNER
    assert scene.arms[L].load is None


def test_without_dynamics_there_is_nothing_to_count_on():
    """With the setting to change; nor without a model at all."""
    scene = Scene(feels=False)
    for _ in range(2):
        for answer in (scene.say(), scene.weigh()):
            assert isinstance(answer, Refusal) and answer.code is Code.MODEL_OFF and "dynamics = true" in answer.hint
        scene.coordinator.model = None


@pytest.mark.parametrize(
    ("mass_kg", "com_m", "field", "code"),
    [
        (-0.01, (0.0, 0.0, 0.0), "mass_kg", Code.OUT_OF_RANGE),
        (3.01, (0.0, 0.0, 0.0), "mass_kg", Code.OUT_OF_RANGE),
        (math.nan, (0.0, 0.0, 0.0), "mass_kg", Code.NOT_FINITE),
        (math.inf, (0.0, 0.0, 0.0), "mass_kg", Code.NOT_FINITE),
        (0.3, (0.0, 0.51, 0.0), "com_m", Code.OUT_OF_RANGE),
        (0.3, (0.0, 0.0, -math.inf), "com_m", Code.NOT_FINITE),
        (0.3, (0.0, 0.0), "com_m", Code.WRONG_SHAPE),
        (0.3, (), "com_m", Code.WRONG_SHAPE),
    ],
)
def test_a_load_that_nobody_believes_is_refused_with_its_bound(mass_kg, com_m, field, code):
    """What was counted on before stays."""
    scene = Scene()
    scene.say()
    refusal = scene.say(mass_kg, com_m)
    assert isinstance(refusal, Refusal) and (refusal.code, refusal.field) == (code, field)
    assert refusal.bound and scene.arms[L].load == Load(mass_kg=0.3, com_m=(0.1, 0.0, -0.02))


def test_what_was_weighed_is_told_with_standard_deviations_and_changes_nothing():
    """What may be nothing has no centre."""
    scene = Scene()
    nothing = scene.weigh()
    assert nothing["mass_kg"] == pytest.approx(0.0) and nothing["com_m"] is None and nothing["com_sd_m"] is None
    pulls = tuple(tuple((scene.arms[L].load_columns(q) @ (0.5, 0.1, 0.0, -0.05)).tolist()) for q in POSTURES)
    found = scene.weigh(up_nm=pulls, down_nm=pulls, beside_empty=True)
    assert found["mass_kg"] == pytest.approx(0.5) and found["com_m"] == pytest.approx((0.2, 0.0, -0.1), abs=1e-9)
    assert found["mass_sd_kg"] > 0.0 and len(found["com_sd_m"]) == 3 and found["condition"] > 1.0
    assert scene.arms[L].load is None


@pytest.mark.parametrize(
    ("changes", "field", "code"),
    [
        ({"q_rad": ()}, "q_rad", Code.WRONG_SHAPE),
        ({"q_rad": POSTURES[:2]}, "up_nm", Code.WRONG_SHAPE),
        ({"down_nm": ((0.0,) * 6,) * 3}, "down_nm", Code.WRONG_SHAPE),
        ({"noise_nm": ZEROS * 3}, "noise_nm", Code.WRONG_SHAPE),
        ({name: ZEROS * 3 for name in ("q_rad", "up_nm", "down_nm", "noise_nm")}, "q_rad", Code.WRONG_SHAPE),
        ({"up_nm": ((0.0, 1e300, *ZEROS[0][2:]),) * 3}, "up_nm", Code.OUT_OF_RANGE),
        ({"q_rad": ((0.0, math.nan, *ZEROS[0][2:]),) * 3}, "q_rad", Code.NOT_FINITE),
        ({"noise_nm": ((-math.inf, *ZEROS[0][1:]),) * 3}, "noise_nm", Code.NOT_FINITE),
    ],
)
def test_what_no_arm_can_have_measured_is_refused(changes, field, code):
    """Before anything is worked out."""
    refusal = Scene().weigh(**changes)
    assert isinstance(refusal, Refusal) and (refusal.code, refusal.field) == (code, field)


def test_what_cannot_be_told_is_refused_and_a_model_that_differs_too():
    """With the words of whoever worked it out."""
    scene = Scene()
    one = {
        name: rows[:1]
        for name, rows in (("q_rad", POSTURES), ("up_nm", ZEROS), ("down_nm", ZEROS), ("noise_nm", NOISE))
    }
    refusal = scene.weigh(**one)
    assert isinstance(refusal, Refusal) and refusal.code is Code.CANNOT_WEIGH
    scene.refused = Refusal(code=Code.MODEL_DIFFERS, message="the model of the left arm cannot be relied on: 9 mm off")
    assert scene.weigh() is scene.refused


def test_the_wildest_numbers_that_are_let_pass_give_finite_ones_or_a_refusal():
    """Nothing that a client sends ends the loop."""
    scene = Scene()
    for most in (0.0, 1e-12, 1000.0, -1000.0):
        for q_rad in (POSTURES, ((most,) * 7, (-most,) * 7)):
            wild = {
                name: ((most,) * 7, (-most,) * 7, (most,) * 7)[: len(q_rad)]
                for name in ("up_nm", "down_nm", "noise_nm")
            }
            answer = scene.weigh(q_rad=q_rad, **wild)
            assert isinstance(answer, Refusal) or math.isfinite(answer["mass_kg"] + answer["mass_sd_kg"])
