"""Wave yaw and rudder drift over long seeded runs."""

import math

import numpy as np
import pytest

from hil.ship.drift import RudderDrift
from hil.ship.gusts import MEAN_PAUSE_S, Gusts
from hil.ship.noise import NormalNumbers, Stream, generator
from hil.ship.orbit import Orbit
from hil.ship.waves import WaveYaw, natural_frequency

STEP_S = 0.02


def waves(spread_rad: float, period_s: float, seed: int = 3, step_s: float = STEP_S) -> WaveYaw:
    return WaveYaw(spread_rad, period_s, step_s, NormalNumbers(generator(seed, Stream.WAVES)))


def sample(process: WaveYaw, count: int) -> np.ndarray:
    angles = np.empty(count)
    for index in range(count):
        angles[index] = process.angle_rad(0.0)
        process.step()
    return angles


@pytest.mark.parametrize("period_s", [2.53, 8.0])
def test_wave_yaw_has_its_spread_and_peak_period(period_s):
    from scipy.signal import welch  # noqa: PLC0415 - takes a second to import

    # The discretisation is exact, so a coarse grid gives the same process.
    step_s = period_s / 10.0
    angles = sample(waves(0.35, period_s, step_s=step_s), 60_000)
    assert np.std(angles) == pytest.approx(0.35, rel=0.05)
    frequency, power = welch(angles, fs=1.0 / step_s, nperseg=1024)
    assert 1.0 / frequency[np.argmax(power)] == pytest.approx(period_s, rel=0.06)


def test_angle_and_rate_are_continuous_between_steps():
    process = waves(0.3, 4.0)
    for _ in range(50):
        end_angle, end_rate = process.angle_rad(STEP_S), process.rate_rad_s(STEP_S)
        slope = (process.angle_rad(0.010001) - process.angle_rad(0.009999)) / 2e-6
        assert process.rate_rad_s(0.010) == pytest.approx(slope, abs=1e-7)
        process.step()
        assert process.angle_rad(0.0) == pytest.approx(end_angle, abs=1e-12)
        assert process.rate_rad_s(0.0) == pytest.approx(end_rate, abs=1e-9)


def test_process_without_deviation_is_zero():
    process = waves(0.0, 0.0)
    process.step()
    assert process.angle_rad(0.01) == 0.0
    assert process.rate_rad_s(0.01) == 0.0
    gusts = Gusts(0.0, 0.1, generator(5, Stream.GUSTS))
    gusts.step()
    assert gusts.angle_rad == 0.0


def test_bias_has_its_spread_and_time_constant():
    drift = RudderDrift(0.1, 10.0, NormalNumbers(generator(5, Stream.DRIFT)))
    angles = np.empty(50_000)
    for index in range(angles.size):
        angles[index] = drift.angle_rad
        drift.step()
    assert np.std(angles) == pytest.approx(0.1, rel=0.05)
    lag = 10  # 100 s
    correlation = np.corrcoef(angles[:-lag], angles[lag:])[0, 1]
    assert correlation == pytest.approx(np.exp(-1.0), abs=0.05)


def test_gusts_have_their_number_and_strength():
    gusts = Gusts(0.1, 0.1, generator(5, Stream.GUSTS))
    angles = np.empty(2_000_000)
    for index in range(angles.size):
        angles[index] = gusts.angle_rad
        gusts.step()
    assert angles.min() == 0.0
    calm = angles == 0.0
    starts = np.flatnonzero(calm[:-1] & ~calm[1:])
    peaks = [piece.max() for piece in np.split(angles, starts)[1:]]
    assert len(peaks) == pytest.approx(200_000.0 / (MEAN_PAUSE_S + 25.0), rel=0.05)
    assert np.sqrt(np.mean(np.square(peaks))) == pytest.approx(0.1, rel=0.05)
    assert np.max(np.abs(np.diff(angles))) < 0.1 * np.pi / 10.0 * max(peaks)  # continuous


def test_orbital_velocity_is_along_the_waves():
    orbit = Orbit(0.4, 8.0, math.radians(90.0), 0.1, NormalNumbers(generator(5, Stream.ORBIT)))
    velocities, positions = np.empty((100_000, 2)), np.empty((100_000, 2))
    for index in range(velocities.shape[0]):
        velocities[index], positions[index] = orbit.velocity_m_s(0.05), orbit.position_m(0.05)
        orbit.step()
    assert np.std(velocities[:, 1]) == pytest.approx(0.4, rel=0.05)
    assert np.std(velocities[:, 0]) < 1e-9
    mean_velocity = np.diff(positions[:, 1]) / 0.1
    assert np.corrcoef(mean_velocity, velocities[1:, 1] + velocities[:-1, 1])[0, 1] > 0.99
    still = Orbit(0.0, 0.0, 0.0, 0.1, NormalNumbers(generator(5, Stream.ORBIT)))
    assert still.velocity_m_s(0.0) == still.position_m(0.0) == (0.0, 0.0)


def test_streams_are_independent_and_repeatable():
    numbers = generator(1, Stream.WAVES).standard_normal(1000)
    assert np.array_equal(numbers, generator(1, Stream.WAVES).standard_normal(1000))
    for other in (generator(1, Stream.DRIFT), generator(2, Stream.WAVES)):
        assert abs(np.corrcoef(numbers, other.standard_normal(1000))[0, 1]) < 0.12


@pytest.mark.parametrize("damping", [0.18, 0.6])
def test_autocorrelation_equals_that_of_the_process(damping):
    process = WaveYaw(0.2, 2.5, 0.1, NormalNumbers(generator(3, Stream.WAVES)), damping)
    angles = sample(process, 60_000)
    assert np.std(angles) == pytest.approx(0.2, rel=0.03)
    omega_rad_s = natural_frequency(2.5, damping)
    damped_rad_s = omega_rad_s * math.sqrt(1.0 - damping**2)
    for steps in (5, 12, 25):
        angle_rad = damped_rad_s * 0.1 * steps
        wave = math.cos(angle_rad) + damping * omega_rad_s / damped_rad_s * math.sin(angle_rad)
        expected = math.exp(-damping * omega_rad_s * 0.1 * steps) * wave
        assert np.corrcoef(angles[:-steps], angles[steps:])[0, 1] == pytest.approx(expected, abs=0.03)


def test_spectral_peak_of_a_damped_process_is_at_the_period():
    from scipy.signal import welch  # noqa: PLC0415 - takes a second to import

    process = WaveYaw(0.2, 2.5, 0.1, NormalNumbers(generator(3, Stream.WAVES)), 0.4)
    frequency_hz, power = welch(sample(process, 120_000), fs=10.0, nperseg=128)
    assert 1.0 / frequency_hz[np.argmax(power)] == pytest.approx(2.5, rel=0.15)
