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
    watched = SimpleNamespace(
        time_s=time_s,
        motions=np.array(motions),
        levels=np.array(levels),
        models=np.tile(MODEL[:3], (time_s.size, 1)),
        inflation=np.ones(time_s.size),
        rudder_s=time_s,
        rudder_rad=rudder,
    )
    return watched, recorded.hull_rad


def changed(watched, **columns):
    return SimpleNamespace(**(vars(watched) | columns))


def test_it_is_what_the_filter_predicts_with_that_rudder(filtered):
    watched, _ = filtered
    row = 1000
    motion, noise = heading_model.Motion(*watched.motions[row]), heading_model.NoiseLevels(*watched.levels[row])
    for step in range(20):
        motion = heading_model.predict(motion, noise, MODEL, watched.rudder_rad[row + step], 0.5)
    found = predict(watched)[10]
    assert found.heading_rad[row] == pytest.approx(motion.heading_rad, abs=1e-9)
    assert found.sd_rad[row] == pytest.approx(math.sqrt(motion.p00), rel=1e-9)


def test_errors_are_as_large_as_claimed(filtered):
    watched, hull = filtered
    for seconds, prediction in predict(watched).items():
        rows = (watched.time_s > 200.0) & np.isfinite(prediction.heading_rad)
        later = np.interp(watched.time_s + seconds, watched.time_s, hull)
        square = np.mean(((prediction.heading_rad - later) / prediction.sd_rad)[rows] ** 2)
        assert 0.2 < square < 3.0, seconds
        assert np.mean((prediction.heading_rad - later)[rows] ** 2) < np.mean((later - hull)[rows] ** 2), seconds


def test_none_where_the_rudder_is_not_known_until_then(filtered):
    watched, _ = filtered
    end_s = watched.time_s[-1]
    for seconds, prediction in predict(watched).items():
        known = np.isfinite(prediction.heading_rad)
        assert known[: np.searchsorted(watched.time_s, end_s - seconds)].all()
        assert not known[watched.time_s > end_s - 0.9 * seconds].any()
    kept = (watched.time_s < 300.0) | (watched.time_s > 360.0)
    gap = predict(changed(watched, rudder_s=watched.rudder_s[kept], rudder_rad=watched.rudder_rad[kept]))[10]
    assert np.isnan(gap.heading_rad[(watched.time_s > 297.0) & (watched.time_s < 359.0)]).all()
    assert np.isfinite(gap.heading_rad[(watched.time_s > 361.0) & (watched.time_s < 800.0)]).all()
    none = predict(changed(watched, rudder_s=np.zeros(0), rudder_rad=np.zeros(0)))
    assert all(np.isnan(prediction.heading_rad).all() for prediction in none.values())


def test_an_inflated_filter_claims_less(filtered):
    watched, _ = filtered
    wide = predict(changed(watched, inflation=np.full(watched.time_s.size, 3.0)))[5]
    narrow = predict(watched)[5]
    assert np.allclose(wide.sd_rad, 3.0 * narrow.sd_rad, equal_nan=True)
    assert np.array_equal(wide.heading_rad, narrow.heading_rad, equal_nan=True)
