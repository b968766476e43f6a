"""Speed variation with the wave groups."""

import numpy as np
import pytest

from hil.ship.disturbances import WaveSpeed
from hil.ship.noise import NormalNumbers, Stream, generator
from hil.ship.wave_speed import DECAY_S, MAX_SPEED_RATIO, SpeedInWaves


def simulate(options, step_s, count):
    """Return the ratios of speed and waves to their means at each step."""
    speed = SpeedInWaves(options, step_s, NormalNumbers(generator(2, Stream.SPEED)))
    ratios = np.empty((count, 2))
    for number in range(count):
        speed.step((number + 1) * step_s)
        ratios[number] = speed.speed_ratio, speed.wave_ratio
    return ratios


def test_speed_has_its_spread_and_time_constant():
    speed = simulate(WaveSpeed(0.2, 90.0), 9.0, 50_000)[:, 0]
    assert np.mean(speed) == pytest.approx(1.0, abs=0.02)
    assert np.std(speed) == pytest.approx(0.2, rel=0.05)
    assert np.corrcoef(speed[:-10], speed[10:])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.05)


def test_speed_is_bounded():
    speed = simulate(WaveSpeed(0.6, 5.0), 1.0, 20_000)[:, 0]
    assert speed.min() == 0.0
    assert speed.max() == MAX_SPEED_RATIO


def test_calm_stops_waves_and_speed_for_its_duration():
    ratios = simulate(WaveSpeed(0.0, 90.0, 100.0, 200.0), 0.5, 1200)
    time_s = 0.5 * np.arange(1, 1201)
    assert np.all(ratios[time_s < 100.0] == 1.0)
    assert ratios[time_s == 100.0 + DECAY_S][0] == pytest.approx(np.exp(-1.0), rel=0.01)
    assert np.argmin(ratios[:, 1]) == np.flatnonzero(time_s == 299.5)[0]
    assert ratios[-1, 0] > 0.99
