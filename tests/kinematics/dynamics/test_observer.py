"""The momentum observer on an arm that is worked out by hand: what pulls, how soon it is known, and how sure."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.kinematics.dynamics.observer import CONVERGED, GAP_NS, TIME_CONSTANT_NS, MomentumObserver
from tests.kinematics.dynamics.plants import Plant, moved

MS = 1_000_000
PULL = np.array([2.0, -1.0, 0.5, 0.0, 0.2, -0.3, 0.1])
NONE = (0.0,) * 7


@pytest.mark.parametrize("period_ns", [2 * MS, 5 * MS, 10 * MS, 50 * MS])
def test_a_pull_is_found_with_the_time_constant_whatever_the_rate(period_ns):
    """Like a low pass: nearly two thirds after one time constant, all of it after six, also while the arm moves."""
    observer, plant = MomentumObserver(Plant()), Plant()
    found = moved(observer, plant, seconds=1.0, external=PULL, period_ns=period_ns)
    allowed_nm = 0.02 if period_ns <= 10 * MS else 0.1  # of the shaking, which so few samples hardly see
    assert observer.is_converged and found[-1] == pytest.approx(PULL, abs=allowed_nm)
    if period_ns <= 5 * MS:
        after = found[TIME_CONSTANT_NS // period_ns]
        assert after == pytest.approx((1.0 - np.exp(-1.0)) * PULL, abs=0.12)


def test_free_motion_is_no_contact():
    """However it moves."""
    found = moved(MomentumObserver(Plant()), Plant(), seconds=1.0, external=np.zeros(7))
    assert np.abs(found).max() < 0.01


def test_scale_and_friction_of_the_drives_are_taken_out():
    """Efforts in another unit, and friction that the motors overcome."""
    drives = {"scale": (1.1,) * 7, "coulomb_nm": (0.3,) * 7, "viscous_nmsprad": (0.2,) * 7}
    plant = Plant(**drives)
    found = moved(MomentumObserver(plant), plant, seconds=1.0, external=np.zeros(7), dq0=1.0)
    assert np.abs(found[-50:]).max() < 0.05


def test_the_spread_of_the_estimate_is_what_is_said_of_it():
    """With noisy efforts and nothing else unsure, within a sixth; nothing is said of noise that is not there."""
    plant = Plant(unsure_part=0.0)
    observer = MomentumObserver(plant)
    found = moved(observer, plant, seconds=8.0, external=np.zeros(7), noise_nm=0.5)
    assert np.sqrt(observer.variance_nm2()) == pytest.approx(found[100:].std(axis=0), rel=1.0 / 3.0)
    assert np.sqrt(observer.variance_nm2()).mean() == pytest.approx(found[100:].std(axis=0).mean(), rel=1.0 / 6.0)


def test_what_the_parameters_do_not_know_makes_it_less_sure():
    """A part of the load, and friction."""
    plant = Plant(unsure_part=0.1, friction_sd_nm=(0.3,) * 7)
    observer = MomentumObserver(plant)
    moved(observer, plant, seconds=0.5, external=np.zeros(7))
    sd = np.sqrt(observer.variance_nm2())
    assert sd[0] == pytest.approx(np.hypot(0.4, 0.3), rel=0.15) and (sd >= 0.3).all()


def test_it_says_nothing_before_its_beginning_is_forgotten():
    """Converged after six time constants; a gap, and a clock that was set back, begin anew."""
    plant, observer = Plant(), MomentumObserver(Plant())
    assert observer.settled_ns == 0 and not observer.is_converged
    moved(observer, plant, seconds=0.1, external=PULL)
    assert observer.settled_ns == 95 * MS and not observer.is_converged
    moved(observer, plant, seconds=0.3, external=PULL, start_ns=100 * MS)
    assert observer.is_converged and observer.settled_ns >= CONVERGED * TIME_CONSTANT_NS
    for at_ns in (395 * MS + GAP_NS + 1, 100 * MS):
        observer.update(at_ns, NONE, NONE, NONE)
        assert observer.settled_ns == 0 and not any(observer.torque_nm)


def test_the_same_sample_again_changes_nothing():
    """A robot that repeats itself."""
    plant, observer = Plant(), MomentumObserver(Plant())
    moved(observer, plant, seconds=0.1, external=PULL)
    before = observer.torque_nm.copy()
    observer.update(95 * MS, NONE, (9.0,) * 7, NONE)
    assert (observer.torque_nm == before).all()


def test_the_bases_motion_is_handed_on():
    """A base that sets off moves what hangs on it: its momentum is known, and no contact."""
    observer = MomentumObserver(Plant())
    for number in range(100):
        speed = 0.5 if number >= 50 else 0.0
        observer.update(number * 5 * MS, NONE, NONE, NONE, (speed, 0.0, 0.0))
    without = MomentumObserver(Plant())
    for number in range(100):
        without.update(number * 5 * MS, NONE, NONE, NONE)
    assert observer.torque_nm == pytest.approx(without.torque_nm, abs=0.1)
