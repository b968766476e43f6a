"""Disturbances that last longer than the noise's model reaches back: a standard error counts them, too."""

import os

import numpy as np
import pytest
from scipy.signal import lfilter

from hil.lab.identify.identify import identify
from hil.lab.identify.noise import fit_noise, slower

STEP = 0.1


def wandering(seed, rows, spread, lasts_s):
    """Return what wanders about nought: white noise of which each value keeps a part."""
    keep = np.exp(-STEP / lasts_s)
    steps = np.sqrt(1.0 - keep**2) * np.random.default_rng(500 + seed).standard_normal(rows)
    steps[0] /= np.sqrt(1.0 - keep**2)
    return spread * lfilter([1.0], [1.0, -keep], steps)


def densities(seed, spread):
    """Return the density of a yaw rate's noise, of neighbouring rows alone and of averages, too, beside a heading."""
    push, source = wandering(seed, 6000, spread, 60.0), np.random.default_rng(seed)
    push = push - push.mean()
    time = np.arange(push.size) * STEP
    heading = np.cumsum(push) * STEP + 3.0 * source.standard_normal(push.size)
    rate = push + source.standard_normal(push.size)
    pieces = [np.column_stack((heading - np.polyval(np.polyfit(time, heading, 1), time), rate))]
    model = fit_noise(pieces)
    return [one.spectrum(8192)[:, 1, 1].real for one in (model, slower(model, pieces, STEP))]


def test_a_drift_that_outlasts_the_noise_s_model_is_seen_in_averages():
    """A fit keeps the heading from drifting off; beside it the yaw rate seemed to have hardly any slow noise."""
    slowest = np.array([[one[0] for one in densities(seed, 1.0)] for seed in range(8)])
    keep = np.exp(-STEP / 60.0)
    plain, slow = np.exp(np.log(slowest).mean(axis=0)) / ((1.0 + keep) / (1.0 - keep))
    assert plain < 0.3
    assert 0.5 < slow < 3.0


def test_averages_of_white_noise_show_no_drift():
    for seed in range(4):
        plain, slow = densities(seed, 0.0)
        assert np.all((slow > 0.8 * plain) & (slow < 1.6 * plain))


def drifting(yard, seeds, channels):
    """Return errors and standard errors of delta0, of 10 min of a zigzag that a drift of 2 deg over 60 s pushes."""
    time, found = np.arange(6000) * STEP, []
    rudder = yard.zigzag(time, np.radians(20.0), 40.0)
    for seed in range(seeds):
        push = wandering(seed, rudder.size, np.radians(2.0), 60.0)
        heading, rate = yard.boat(0.049, 4.0, 17.0, 0.02).motion(time, rudder - push)
        recording = yard.recorded(time, rudder, heading, rate, seed=seed, channels=channels)
        offset = identify([recording]).judgement.estimates["delta0"]
        found.append((offset.value - 0.02, offset.se))
    return np.array(found).T


@pytest.mark.proof
@pytest.mark.parametrize("channels", ["h", pytest.param("hr", marks=pytest.mark.proof)])
def test_a_rudder_offset_in_a_drift_is_as_unsure_as_the_drift_s_mean(yard, channels):
    """Which is of 2 deg over the root of 600 s / 120 s, 0.9 deg; a third of it was stated."""
    errors, stated = drifting(yard, 1, channels)
    assert np.all(np.abs(errors) < 3.0 * stated)
    assert np.all((stated > np.radians(0.4)) & (stated < np.radians(4.0)))


@pytest.mark.proof
@pytest.mark.parametrize(("channels", "least"), [("h", 0.88), ("hr", 0.9)])
def test_the_interval_of_a_rudder_offset_holds_in_a_drift(yard, channels, least, figures):
    """Ten times the drift's own duration tell little of how long it lasts, which the intervals allow for."""
    errors, stated = drifting(yard, int(os.environ.get("PROOF_SEEDS", "80")), channels)
    share = float(np.mean(np.abs(errors) <= 1.96 * stated))
    figures.keep(f"identify_drift_{channels}_covered_delta0", 100.0 * share, "%")
    assert least <= share <= 0.99
