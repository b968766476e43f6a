"""How honest the filter is, as it is told: the mean of the squared innovations, by their variance, of a minute."""

import math

import pytest

from firmware_py.estimate.learning import NoiseModel, learn_from_heading


def average_square(model, z, step_s, seconds):
    for _ in range(round(seconds / step_s)):
        model = learn_from_heading(model, z * 0.02, 0.02**2, step_s, model.wave_spread_rad**2)
    return model.average_square


@pytest.mark.parametrize("step_s", [0.1, 1.0, 5.0])
@pytest.mark.parametrize("seconds", [30.0, 60.0, 120.0])
@pytest.mark.parametrize("z", [0.5, 2.0])
def test_the_mean_follows_within_a_minute_however_often_the_compass_speaks(z, seconds, step_s):
    left = math.exp(-seconds / 60.0)
    assert average_square(NoiseModel(), z, step_s, seconds) == pytest.approx(z * z + (1.0 - z * z) * left, rel=0.05)


def test_after_a_long_silence_one_heading_counts_for_half_at_most():
    assert average_square(NoiseModel(), 3.0, 3600.0, 3600.0) == pytest.approx(0.5 * (1.0 + 9.0))
