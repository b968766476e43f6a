"""A boat whose damping goes with r |r|: told from one with r^3 by the log alone, and where it cannot be, counted."""

from dataclasses import replace

import numpy as np
import pytest

from hil.lab.identify.damping import damping_of
from hil.lab.identify.identify import identify

STEP = 0.1
PLAN = np.radians([20.0, -20.0, 20.0, 0.0, -10.0, 10.0, -20.0, 30.0, -30.0])
TIME = np.arange(6000) * STEP


@pytest.fixture(scope="module")
def sailed(yard):
    """Return rudder, heading and yaw rate by the law of damping and the plan that is steered."""
    target, irregular = PLAN[(TIME // 25.0).astype(int) % PLAN.size], np.zeros(TIME.size)
    for n in range(1, TIME.size):
        irregular[n] = irregular[n - 1] + np.clip(target[n] - irregular[n - 1], -0.017, 0.017)
    boats = {"square": yard.boat(0.1, 6.0, 0.0, 0.01, 4.0), "cube": yard.boat(0.1, 6.0, 60.0, 0.01)}
    plans = {"irregular": irregular, "zigzag": yard.zigzag(TIME, np.radians(20.0), 40.0)}
    return {
        (law, plan): (rudder, *boat.motion(TIME, rudder))
        for law, boat in boats.items()
        for plan, rudder in plans.items()
        if (law, plan) != ("cube", "zigzag")
    }


def off(found):
    """Return by how many of their standard errors K and T are off."""
    return [
        (found.judgement.estimates[name].value - value) / found.judgement.estimates[name].se
        for name, value in (("K", 0.1), ("T", 6.0))
    ]


def told(found):
    return [text for text in found.judgement.warnings if text.startswith("her damping goes rather with the square")]


@pytest.mark.parametrize("channels", ["hr", pytest.param("h", marks=pytest.mark.proof)])
def test_a_damping_by_the_square_is_told_and_counted(yard, sailed, channels):
    """K was 5 % too small, 24 to 54 of its standard errors, without a word."""
    found = identify([yard.recorded(TIME, *sailed["square", "irregular"], channels=channels)])
    assert np.max(np.abs(off(found))) < 2.0
    (warning,) = told(found)
    assert "K +5" in warning or "K +6" in warning
    assert found.judgement.estimates["K"].verdict == "identifiable"


@pytest.mark.proof
def test_a_zigzag_of_one_angle_does_not_tell_the_square_from_the_cube_and_both_count(yard, sailed):
    """K was 10 of its standard errors off; nothing in such a log says so."""
    for seed in range(2):
        found = identify([yard.recorded(TIME, *sailed["square", "zigzag"], seed=seed)])
        assert found.choice.model == "cubic"
        assert np.max(np.abs(off(found))) < 2.0


def test_the_rival_of_a_cube_is_the_square_with_the_true_k_and_t(yard, sailed):
    found = identify([yard.recorded(TIME, *sailed["square", "irregular"])])
    rival = damping_of(found.fit, asked=False)
    assert rival.told
    np.testing.assert_allclose(rival.fit.physical[:4], [0.1, 6.0, 0.0, 0.01], rtol=0.01, atol=1e-9)
    assert rival.fit.state.point.candidate(rival.fit.problem.scales)[4] == pytest.approx(4.0, rel=0.03)


def test_a_damping_by_the_cube_is_not_doubted_where_the_log_tells_it(yard, sailed):
    recording = yard.recorded(TIME, *sailed["cube", "irregular"])
    found = identify([recording])
    assert not told(found)
    assert np.max(np.abs(off(found))) < 3.0
    gain, asked = (one.judgement.estimates["K"].se for one in (found, identify([recording], model="cubic")))
    assert gain == pytest.approx(asked, rel=1e-6)


def test_a_cubic_model_that_was_asked_for_is_doubted_by_the_log_alone(yard, sailed):
    """Which model it is has been said; where nothing tells, that is believed."""
    zigzag = yard.recorded(TIME, *sailed["square", "zigzag"])
    spreads = [identify([zigzag], model=model).judgement.estimates["K"].se for model in ("auto", "cubic")]
    assert spreads[0] > 3.0 * spreads[1]
    assert told(identify([yard.recorded(TIME, *sailed["square", "irregular"])], model="cubic"))


@pytest.mark.proof
def test_a_boat_without_a_bend_has_no_rival(yard):
    rudder = yard.zigzag(TIME, np.radians(20.0), 40.0)
    found = identify([yard.recorded(TIME, rudder, *yard.boat(0.1, 6.0).motion(TIME, rudder))], model="linear")
    assert damping_of(found.fit, asked=False) is None
    flat = replace(found.fit, problem=replace(found.fit.problem, free=(0, 1, 2, 3)))
    assert damping_of(flat, asked=False) is None
