"""What a recording is mended of before it is fitted to."""

from dataclasses import replace

import numpy as np

from hil.lab.identify.identify import identify
from hil.lab.identify.mend import without_speed_noise
from hil.lab.identify.recording import Recording

ROWS, STEP = 6000, 0.1


def wandering(seed):
    """Return a speed about 0.4 m/s that changes by a third within a minute."""
    from scipy.signal import lfilter  # noqa: PLC0415 - takes a second to import

    keep = np.exp(-STEP / 60.0)
    steps = np.sqrt(1.0 - keep**2) * np.random.default_rng(seed).standard_normal(ROWS)
    return 0.4 * np.exp(0.3 * lfilter([1.0], [1.0, -keep], steps))


def with_speed(speed):
    time = np.arange(speed.size) * STEP
    return Recording("boat", time, np.zeros(time.size), np.sin(time), None, speed)


def test_speed_noise_is_smoothed():
    for seed in range(4):
        true, notes = wandering(seed), []
        noise = 0.1 * np.random.default_rng(100 + seed).standard_normal(ROWS)
        smoothed = without_speed_noise(with_speed(true + noise), notes).speed_m_s
        assert np.std(smoothed - true) < 0.25 * np.std(noise)
        assert len(notes) == 1
        assert "has noise of 0." in notes[0]


def test_a_speed_without_noise_and_a_constant_one_are_left_as_they_are():
    for speed in (wandering(1), np.full(ROWS, 0.4), 0.4 + np.arange(ROWS) * 1e-4):
        notes = []
        recording = with_speed(speed)
        assert without_speed_noise(recording, notes) is recording
        assert not notes


def test_a_noisy_speed_does_not_make_k_wrong(yard):
    """Without smoothing, K was 3 % too small on average."""
    time = np.arange(ROWS) * STEP
    rudder = yard.steps(time, 0.6, 30.0, 0.5)
    ratio = wandering(0) / 0.4
    fine = np.linspace(0.0, time[-1], 10 * (ROWS - 1) + 1)
    angle, speed = np.interp(fine, time, rudder), np.interp(fine, time, ratio)
    rate, step = np.zeros(fine.size), fine[1]
    for n in range(fine.size - 1):
        u, r = speed[n], rate[n]
        rate[n + 1] = r + step * (0.049 * u * angle[n] - r - 17.0 / u**2 * r**3) / (4.0 / u)
    heading = np.cumsum(rate) * step
    recording = yard.recorded(time, rudder, heading[::10], rate[::10])
    noise = 0.1 * np.random.default_rng(0).standard_normal(ROWS)
    found = identify([replace(recording, speed_m_s=0.4 * ratio + noise)])
    gain = found.judgement.estimates["K"]
    assert abs(gain.value - 0.049 * found.data.speed_m_s / 0.4) < 3.0 * gain.se
