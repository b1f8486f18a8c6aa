"""What a hand holds: found from torques that are worked out, with friction, wrong masses and noise in them."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.dynamics.weighing import CannotTell, Swings, Weighed, weigh
from tests.changed import replace
from tests.kinematics.dynamics.plants import Plant

POSTURES = np.zeros((3, 7))
POSTURES[1:, 0] = 0.3, -0.3
HELD = np.array([0.4, 0.4 * 0.15, -0.4 * 0.02, 0.4 * 0.05])
FRICTION = np.linspace(0.4, 0.05, 7)


def swings(plant, held=HELD, *, friction=FRICTION, wrong=0.0, noise_nm=0.01, seed=0, postures=POSTURES, **more):
    """What is measured of a load, with an own torque that the model does not know of, and noise."""
    pulls = np.array([plant.load_columns(q) @ held for q in postures]) + wrong
    noise = noise_nm * np.random.default_rng(seed).normal(0.0, 1.0, pulls.shape)
    both = {"up_nm": pulls + noise - friction, "down_nm": pulls + noise + friction}
    return Swings(q_rad=postures, noise_nm=np.full(pulls.shape, noise_nm), **both, **{"beside_empty": False, **more})


def test_mass_and_centre_are_found_whatever_friction_is():
    """It is once for and once against, however large; what may differ between both is in the standard deviations."""
    plant = Plant(unsure_part=0.0)
    for friction in (0.0, FRICTION, 10.0 * FRICTION):
        found = weigh(plant, swings(plant, friction=friction, noise_nm=1e-6))
        assert isinstance(found, Weighed) and found.mass_kg == pytest.approx(0.4, abs=1e-4)
        if found.com_m is not None:
            assert found.com_m == pytest.approx((0.15, -0.02, 0.05), abs=1e-3)
    assert found.mass_sd_kg > 0.02, "ten times the friction: a tenth of it may be left"


def test_standard_deviations_are_those_of_repeated_weighings():
    """Of two hundred with noise, and with masses of the arm that are off as is assumed of them."""
    for part, off_nm, close in ((0.0, 0.0, 0.25), (0.05, 0.05, 0.5)):
        plant, found = Plant(unsure_part=part), []
        for seed in range(200):
            weights = plant.terms(POSTURES[0], np.zeros(7), ()).gravity_nm
            wrong = off_nm * weights * np.random.default_rng(seed + 1000).normal(0.0, 1.0, 7)
            found.append(weigh(plant, swings(plant, friction=0.0, wrong=wrong, noise_nm=0.02, seed=seed)))
        masses = np.array([one.mass_kg for one in found])
        assert np.std(masses) == pytest.approx(np.median([one.mass_sd_kg for one in found]), rel=close)
        assert np.mean(masses) == pytest.approx(0.4, abs=4.0 * np.std(masses) / np.sqrt(200))
        if not part:
            centres = np.array([one.com_m for one in found])
            assert np.std(centres, axis=0) == pytest.approx(
                np.median([one.com_sd_m for one in found], axis=0), rel=close
            )


def test_more_postures_do_not_make_wrong_masses_surer():
    """They are wrong in all of them alike."""
    plant = Plant(unsure_part=0.1)
    few, many = (weigh(plant, swings(plant, postures=np.tile(POSTURES, (times, 1)))) for times in (1, 2))
    assert many.mass_sd_kg > 0.9 * few.mass_sd_kg


def test_beside_the_empty_hand_only_the_scale_of_the_efforts_is_unsure():
    """A part of what the load pulls, not of what the arm weighs."""
    plant = Plant(unsure_part=0.15)
    alone, beside = (weigh(plant, swings(plant, beside_empty=is_beside)) for is_beside in (False, True))
    assert beside.mass_kg == pytest.approx(0.4, abs=0.02) and beside.mass_sd_kg < 0.5 * alone.mass_sd_kg


def test_of_an_identified_arm_what_was_left_is_unsure():
    """In each joint, the same in all postures; not beside the empty hand."""
    sure, left = (Plant(unsure_part=0.0, friction_sd_nm=(sd,) * 7) for sd in (0.0, 0.3))
    found = {plant: weigh(plant, swings(plant, friction=0.0)).mass_sd_kg for plant in (sure, left)}
    assert found[left] > 5.0 * found[sure]
    assert weigh(left, swings(left, friction=0.0, beside_empty=True)).mass_sd_kg == pytest.approx(found[sure], rel=0.5)


def test_what_may_be_nothing_has_no_centre():
    """Less than two standard deviations; a lighter arm than described weighs less than nothing."""
    plant = Plant(unsure_part=0.15)
    for held in (np.zeros(4), -0.2 * HELD):
        found = weigh(plant, swings(plant, held))
        assert found.com_m is None and found.com_sd_m is None and found.mass_kg < 2.0 * found.mass_sd_kg


def test_what_fits_no_load_makes_everything_less_sure():
    """Something touches the arm in one posture."""
    plant = Plant(unsure_part=0.0)
    clean = swings(plant)
    touched = clean.up_nm.copy()
    touched[1, 3] += 2.0
    assert weigh(plant, replace(clean, up_nm=touched)).mass_sd_kg > 2.5 * weigh(plant, clean).mass_sd_kg


def test_postures_that_cannot_tell_name_what_they_do_not_tell():
    """One posture does not feel the centre along gravity."""
    found = weigh(Plant(), swings(Plant(), postures=POSTURES[:1]))
    assert isinstance(found, CannotTell) and "its centre along z of left_ee (condition number" in found.message
