"""Headings predicted with the recorded rudder: by the filter's own steps, right in the mean and in their spread."""

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
    """The filter's states over a recording, as `tick.watch` returns them, and the hull's heading."""
    recorded = sea(seconds=900.0, diffusion=0.3)
    time_s, heading, rudder = (recorded.columns[name] for name in ("time_s", "heading_rad", "rudder_rad"))
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
    return estimates, recorded.hull_rad


def changed(estimates, **columns):
    return SimpleNamespace(**(vars(estimates) | columns))


def test_predictions_equal_those_of_the_filter(filtered):
    estimates, _ = filtered
    row = 1000
    motion, noise = heading_model.Motion(*estimates.motions[row]), heading_model.NoiseLevels(*estimates.levels[row])
    for step in range(20):
        motion = heading_model.predict(motion, noise, MODEL, estimates.rudder_rad[row + step], 0.5)
    found = predict(estimates)[10]
    assert found.heading_rad[row] == pytest.approx(motion.heading_rad, abs=1e-9)
    assert found.sd_rad[row] == pytest.approx(math.sqrt(motion.p00), rel=1e-9)


def test_standard_deviations_match_the_errors(filtered):
    estimates, hull = filtered
    for seconds, prediction in predict(estimates).items():
        rows = (estimates.time_s > 200.0) & np.isfinite(prediction.heading_rad)
        later = np.interp(estimates.time_s + seconds, estimates.time_s, hull)
        square = np.mean(((prediction.heading_rad - later) / prediction.sd_rad)[rows] ** 2)
        assert 0.2 < square < 3.0, seconds
        assert np.mean((prediction.heading_rad - later)[rows] ** 2) < np.mean((later - hull)[rows] ** 2), seconds


def test_no_prediction_without_a_known_rudder(filtered):
    estimates, _ = filtered
    end_s = estimates.time_s[-1]
    for seconds, prediction in predict(estimates).items():
        known = np.isfinite(prediction.heading_rad)
        assert known[: np.searchsorted(estimates.time_s, end_s - seconds)].all()
        assert not known[estimates.time_s > end_s - 0.9 * seconds].any()
    kept = (estimates.time_s < 300.0) | (estimates.time_s > 360.0)
    gap = predict(changed(estimates, rudder_s=estimates.rudder_s[kept], rudder_rad=estimates.rudder_rad[kept]))[10]
    assert np.isnan(gap.heading_rad[(estimates.time_s > 297.0) & (estimates.time_s < 359.0)]).all()
    assert np.isfinite(gap.heading_rad[(estimates.time_s > 361.0) & (estimates.time_s < 800.0)]).all()
    none = predict(changed(estimates, rudder_s=np.zeros(0), rudder_rad=np.zeros(0)))
    assert all(np.isnan(prediction.heading_rad).all() for prediction in none.values())


def test_inflation_enlarges_the_standard_deviation(filtered):
    estimates, _ = filtered
    wide = predict(changed(estimates, inflation=np.full(estimates.time_s.size, 3.0)))[5]
    narrow = predict(estimates)[5]
    assert np.allclose(wide.sd_rad, 3.0 * narrow.sd_rad, equal_nan=True)
    assert np.array_equal(wide.heading_rad, narrow.heading_rad, equal_nan=True)
