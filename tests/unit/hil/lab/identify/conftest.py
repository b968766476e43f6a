"""Simulated recordings for identification, computed by scipy and numpy and not by the code under test."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hil.lab.identify.manoeuvre_file import read
from hil.lab.identify.recording import Recording


@dataclass(frozen=True)
class Boat:
    """K, T, alpha and delta0 of a boat."""

    gain: float
    lag: float
    cubic: float = 0.0
    offset: float = 0.0

    def motion(self, time, rudder, is_stepwise=False):
        """Return heading and yaw rate; the rudder is linear between samples, or constant from sample to sample."""

        def angle(t):
            if is_stepwise:
                return rudder[min(int(np.searchsorted(time, t, side="right")) - 1, rudder.size - 1)]
            return np.interp(t, time, rudder)

        def derivative(t, y):
            damping = y[1] + self.cubic * y[1] ** 3
            return [y[1], (self.gain * (angle(t) - self.offset) - damping) / self.lag]

        max_step = max(2.0 * (time[1] - time[0]), (time[-1] - time[0]) / 5000.0)
        span = (time[0], time[-1])
        return solve_ivp(
            derivative, span, [0.0, 0.0], "LSODA", time, rtol=1e-7, atol=[1e-9, 1e-11], max_step=max_step
        ).y


def _limit_rate(time, target, slew):
    rudder = np.zeros(time.size)
    for n in range(1, time.size):
        max_change = slew * (time[n] - time[n - 1])
        rudder[n] = rudder[n - 1] + np.clip(target[n] - rudder[n - 1], -max_change, max_change)
    return rudder


def steps(time, angle, leg, slew):
    """Return a rudder that alternates between both sides, with full and half angles, at a limited rate."""
    number = (time // leg).astype(int)
    target = angle * np.where(number % 2 == 0, 1.0, -1.0) * np.where(number % 4 >= 2, 0.5, 1.0)
    return _limit_rate(time, target, slew)


def zigzag(time, angle, leg, slew=0.5236):
    return _limit_rate(time, np.where((time // leg).astype(int) % 2 == 0, angle, -angle), slew)


def recorded(time, rudder, heading, rate, *, seed=0, noise=0.3, rate_noise=0.1):
    """Return a recording with noise [deg] and [deg/s]."""
    source = np.random.default_rng(seed)
    psi = heading + np.radians(noise) * source.standard_normal(time.size)
    r = rate + np.radians(rate_noise) * source.standard_normal(time.size)
    return Recording("boat", time, rudder, psi, r, None)


class Simulation:
    boat, steps, zigzag, recorded = Boat, staticmethod(steps), staticmethod(zigzag), staticmethod(recorded)


@pytest.fixture(scope="session")
def simulation():
    return Simulation


@pytest.fixture
def read_table(tmp_path):
    """Write a table file and read it."""

    def write_and_read(content, unit="rad"):
        path = tmp_path / "table.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read(path, unit)

    return write_and_read
