"""Headings predicted with the recorded rudder, compared with the filter's own steps and with the true headings."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from hil.lab.estimate.predictions import predict
from hil.lab.numeric_core import heading_filter, heading_model, kt
from support.recorded_sea import K, T, sea

MODEL = kt.KtModel(K, T, 0.0, 0.0, 0.5)


@pytest.fixture(scope="module")
def filtered():
    """Return the filter's states over a recording, as Estimates contains them, and the heading of the hull."""
    recording = sea(seconds=900.0, diffusion=0.3)
    time_s, heading, rudder = (recording.columns[name] for name in ("time_s", "heading_rad", "rudder_rad"))
    f = heading_filter.begin(0.0, heading[0])
    motions, levels = [f.motion], [f.levels]
    for row in range(1, time_s.size):
        f = heading_filter.update(f, MODEL, time_s[row], heading[row], rudder[row - 1])
        motions.append(f.motion)
        levels.append(f.levels)
    estimates = SimpleNamespace(
        time_s=time_s,
        motions=np.array(motions),
        levels=np.array(levels),
        models=np.tile(MODEL[:3], (time_s.size, 1)),
        inflation=np.ones(time_s.size),
        rudder_s=time_s,
        rudder_rad=rudder,
    )
    return estimates, recording.hull_rad


def replaced(estimates, **columns):
    return SimpleNamespace(**(vars(estimates) | columns))


def test_predictions_equal_those_of_the_filter(filtered):
    estimates, _ = filtered
    row = 1000
    motion, noise = heading_model.Motion(*estimates.motions[row]), heading_model.NoiseLevels(*estimates.levels[row])
    for step in range(20):
        motion = heading_model.predict(motion, noise, MODEL, estimates.rudder_rad[row + step], 0.5)
    prediction = predict(estimates)[10]
    assert prediction.heading_rad[row] == pytest.approx(motion.heading_rad, abs=1e-9)
    assert prediction.sd_rad[row] == pytest.approx(math.sqrt(motion.p00), rel=1e-9)


def test_standard_deviations_match_the_errors(filtered):
    estimates, hull = filtered
    for seconds, prediction in predict(estimates).items():
        rows = (estimates.time_s > 200.0) & np.isfinite(prediction.heading_rad)
        hull_later = np.interp(estimates.time_s + seconds, estimates.time_s, hull)
        mean_square = np.mean(((prediction.heading_rad - hull_later) / prediction.sd_rad)[rows] ** 2)
        assert 0.2 < mean_square < 3.0, seconds
        assert np.mean((prediction.heading_rad - hull_later)[rows] ** 2) < np.mean((hull_later - hull)[rows] ** 2), (
            seconds
        )


def test_prediction_without_a_known_rudder_is_nan(filtered):
    estimates, _ = filtered
    end_s = estimates.time_s[-1]
    for seconds, prediction in predict(estimates).items():
        is_known = np.isfinite(prediction.heading_rad)
        assert is_known[: np.searchsorted(estimates.time_s, end_s - seconds)].all()
        assert not is_known[estimates.time_s > end_s - 0.9 * seconds].any()
    is_kept = (estimates.time_s < 300.0) | (estimates.time_s > 360.0)
    gap = predict(replaced(estimates, rudder_s=estimates.rudder_s[is_kept], rudder_rad=estimates.rudder_rad[is_kept]))[
        10
    ]
    assert np.isnan(gap.heading_rad[(estimates.time_s > 297.0) & (estimates.time_s < 359.0)]).all()
    assert np.isfinite(gap.heading_rad[(estimates.time_s > 361.0) & (estimates.time_s < 800.0)]).all()
    no_predictions = predict(replaced(estimates, rudder_s=np.zeros(0), rudder_rad=np.zeros(0)))
    assert all(np.isnan(prediction.heading_rad).all() for prediction in no_predictions.values())


def test_inflation_multiplies_the_standard_deviation(filtered):
    estimates, _ = filtered
    inflated = predict(replaced(estimates, inflation=np.full(estimates.time_s.size, 3.0)))[5]
    plain = predict(estimates)[5]
    assert np.allclose(inflated.sd_rad, 3.0 * plain.sd_rad, equal_nan=True)
    assert np.array_equal(inflated.heading_rad, plain.heading_rad, equal_nan=True)
