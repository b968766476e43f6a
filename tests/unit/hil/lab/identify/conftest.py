"""Boats to identify, made without a line of what identifies them: scipy's integrators and plain numpy."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hil.lab.identify.recording import Recording


@dataclass(frozen=True)
class Boat:
    """K, T, alpha, delta0, and a damping by r |r|."""

    gain: float
    lag: float
    cubic: float = 0.0
    offset: float = 0.0
    quadratic: float = 0.0

    def values(self):
        return {"K": self.gain, "T": self.lag, "alpha": self.cubic, "delta0": self.offset}

    def motion(self, time, rudder, held=False):
        """Return heading and yaw rate; the rudder goes evenly from sample to sample, or is held."""

        def angle(t):
            if held:
                return rudder[min(int(np.searchsorted(time, t, side="right")) - 1, rudder.size - 1)]
            return np.interp(t, time, rudder)

        def slope(t, y):
            damping = y[1] + self.cubic * y[1] ** 3 + self.quadratic * y[1] * abs(y[1])
            return [y[1], (self.gain * (angle(t) - self.offset) - damping) / self.lag]

        longest = max(2.0 * (time[1] - time[0]), (time[-1] - time[0]) / 5000.0)
        found = solve_ivp(
            slope, (time[0], time[-1]), [0.0, 0.0], "LSODA", time, rtol=1e-7, atol=[1e-9, 1e-11], max_step=longest
        )
        return found.y[0], found.y[1]


def steps(time, angle, leg, slew):
    """Return a rudder that goes to either side by turns, full and half, at a limited slew."""
    number = (time // leg).astype(int)
    target = angle * np.where(number % 2 == 0, 1.0, -1.0) * np.where(number % 4 >= 2, 0.5, 1.0)
    rudder = np.zeros(time.size)
    for n in range(1, time.size):
        reach = slew * (time[n] - time[n - 1])
        rudder[n] = rudder[n - 1] + np.clip(target[n] - rudder[n - 1], -reach, reach)
    return rudder


def zigzag(time, angle, leg, slew=0.5236):
    target = np.where((time // leg).astype(int) % 2 == 0, angle, -angle)
    rudder = np.zeros(time.size)
    for n in range(1, time.size):
        reach = slew * (time[n] - time[n - 1])
        rudder[n] = rudder[n - 1] + np.clip(target[n] - rudder[n - 1], -reach, reach)
    return rudder


def wave_yaw(count, step, spread, period, source):
    """Return the yaw of a regular sea: white noise through a lightly damped second-order filter."""
    from scipy.signal import cont2discrete, lfilter  # noqa: PLC0415 - takes a second to import

    omega = 2.0 * np.pi / period
    system = ([omega**2], [1.0, 0.2 * omega, omega**2])
    top, bottom, _ = cont2discrete(system, step, "bilinear")
    yaw = lfilter(top.ravel(), bottom, source.standard_normal(count + 2000))[2000:]
    return spread * yaw / np.std(yaw)


def recorded(time, rudder, heading, rate, *, seed=0, noise=0.3, rate_noise=0.1, resolution=0.0, channels="hr"):
    """Return a recording with noise in degrees."""
    source = np.random.default_rng(seed)
    psi = heading + np.radians(noise) * source.standard_normal(time.size)
    r = rate + np.radians(rate_noise) * source.standard_normal(time.size)
    if resolution:
        psi = np.round(psi / np.radians(resolution)) * np.radians(resolution)
    return Recording("boat", time, rudder, psi if "h" in channels else None, r if "r" in channels else None, None)


class Yard:
    boat, steps, zigzag, wave_yaw, recorded = (
        Boat,
        staticmethod(steps),
        staticmethod(zigzag),
        staticmethod(wave_yaw),
        staticmethod(recorded),
    )


@pytest.fixture(scope="session")
def yard():
    return Yard
