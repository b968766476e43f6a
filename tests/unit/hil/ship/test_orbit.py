"""Orbital motion of a short-crested sea and its correlation with the yaw."""

import math

import numpy as np
import pytest

from hil.ship.noise import NormalNumbers, Stream, generator
from hil.ship.orbit import ShortCrestedOrbit
from hil.ship.waves import WaveYaw

STEP_S = 0.4
TOWARD_RAD = math.radians(40.0)


def motion(heading_rad, spread_deg=25.0, yaw_rad=0.35, count=60_000):
    """Return the velocities along and across the waves, the displacements along them, and the yaw rates."""
    yaw = WaveYaw(yaw_rad, 8.0, STEP_S, NormalNumbers(generator(5, Stream.WAVES)))
    numbers = (NormalNumbers(generator(5, Stream.ORBIT)), NormalNumbers(generator(5, Stream.ORBIT_ALONE)))
    orbit = ShortCrestedOrbit(0.4, math.radians(spread_deg), 8.0, TOWARD_RAD, STEP_S, (yaw, yaw_rad), numbers)
    rows = np.empty((count, 4))
    for row in rows:
        north, east = orbit.velocity_m_s(0.0, heading_rad)
        row[0] = north * math.cos(TOWARD_RAD) + east * math.sin(TOWARD_RAD)
        row[1] = east * math.cos(TOWARD_RAD) - north * math.sin(TOWARD_RAD)
        north, east = orbit.position_m(0.0, heading_rad)
        row[2] = north * math.cos(TOWARD_RAD) + east * math.sin(TOWARD_RAD)
        row[3] = yaw.rate_rad_s(0.0)
        yaw.step()
        orbit.step()
    return rows.T


@pytest.mark.parametrize("yaw_rad", [0.35, 0.0])
def test_rms_along_and_across_follows_the_spread(yaw_rad):
    along, across, _, _ = motion(0.3, yaw_rad=yaw_rad)
    assert math.hypot(np.std(along), np.std(across)) == pytest.approx(0.4, rel=0.04)
    assert np.corrcoef(along, across)[0, 1] == pytest.approx(0.0, abs=0.05)
    # The share of the energy across is the mean squared sine of random directions.
    sines = np.sin(np.random.default_rng(1).normal(0.0, math.radians(25.0), 100_000))
    assert np.var(across) / 0.4**2 == pytest.approx(np.mean(sines**2), rel=0.08)


def test_velocity_has_the_period_and_is_the_derivative_of_the_position():
    from scipy.signal import welch  # noqa: PLC0415 - takes a second to import

    along, _, position, _ = motion(0.3)
    frequency, power = welch(along, fs=1.0 / STEP_S, nperseg=1024)
    assert 1.0 / frequency[np.argmax(power)] == pytest.approx(8.0, rel=0.08)
    mean_velocity = np.diff(position) / STEP_S
    assert np.corrcoef(mean_velocity, along[1:] + along[:-1])[0, 1] > 0.99


@pytest.mark.parametrize(("relative_deg", "with_along", "with_across"), [(45.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_yaw_is_correlated_with_the_component_that_turns_the_float(relative_deg, with_along, with_across):
    along, across, _, rate = motion(TOWARD_RAD - math.radians(relative_deg))
    assert np.corrcoef(along, rate)[0, 1] == pytest.approx(with_along, abs=0.05)
    assert np.corrcoef(across, rate)[0, 1] == pytest.approx(with_across, abs=0.05)


def test_long_crested_sea_has_no_motion_across():
    _, across, _, _ = motion(0.3, spread_deg=0.0, count=1000)
    assert np.max(np.abs(across)) < 1e-12
