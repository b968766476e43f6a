"""Random boats in a disturbed sea, simulated without a line of what identifies them: Euler steps of 0.05 s."""

from dataclasses import dataclass

import numba
import numpy as np

from hil.lab.identify.recording import Recording

STEP_S, ROW_STEPS = 0.05, 4
MANOEUVRES = ("zigzag", "circle", "course")


@dataclass(frozen=True)
class Ship:
    """K [1/s], T [s], alpha [s^2], delta0 [rad], D [deg^2/s], wave sd [deg] and period [s], compass noise [deg]."""

    gain: float
    lag: float
    cubic: float
    offset: float
    diffusion: float
    wave_deg: float
    period_s: float
    compass_deg: float

    def values(self):
        return {"K": self.gain, "T": self.lag, "alpha": self.cubic, "delta0": self.offset}


def draw(seed, diffusion):
    """Draw a boat: T about 4 s (factor 2.2), K T about 0.25 (factor 2), alpha K^2 about 0.04 (factor 2.7)."""
    source = np.random.default_rng((seed, 7))
    lag = 4.0 * np.exp(0.8 * source.standard_normal())
    gain = 0.25 * np.exp(0.7 * source.standard_normal()) / lag
    cubic = 0.04 * np.exp(source.standard_normal()) / gain**2
    return Ship(
        gain, lag, cubic, np.radians(2.0) * source.standard_normal(), diffusion,
        source.uniform(0.5, 3.0), source.uniform(2.0, 6.0), source.uniform(0.05, 0.3),
    )  # fmt: skip


@numba.njit
def _run(kind, gain, lag, cubic, offset, push, wave, compass, steps, row_steps, step):
    rows = steps // row_steps
    table = np.empty((rows, 3))
    psi = rate = rudder = 0.0
    side, began = 1.0, 0.0
    for n in range(steps):
        now = n * step
        seen = psi + wave[n] + compass[n]
        if kind == 0:  # the rudder is turned over whenever the boat has turned 20 deg
            if side * (seen - began) > 0.35:
                side = -side
            wanted = 0.35 * side
        elif kind == 1:  # full and half rudder to either side, each for 10 T
            leg = int(now / (10.0 * lag)) % 4
            wanted = (0.52, -0.52, 0.26, -0.26)[leg]
        else:  # a helm that keeps a course and changes it by 60 deg every 200 s
            goal = 1.05 * (int(now / 200.0) % 2)
            wanted = min(max(1.2 * (goal - seen) - 0.6 * lag * rate + offset, -0.52), 0.52)
        rudder += min(max(wanted - rudder, -0.5 * step), 0.5 * step)
        if n % row_steps == 0:
            table[n // row_steps] = now, rudder, seen
        rate += step * (gain * (rudder - offset) - rate - cubic * rate**3) / lag + push[n]
        psi += step * rate
    return table


def wave_yaw(count, sd, period, source, damping=0.15):
    omega = 2.0 * np.pi / period
    fade, turn = np.exp(-damping * omega * STEP_S), omega * np.sqrt(1.0 - damping**2) * STEP_S
    noise = source.standard_normal(count + 4000)
    return _resonance(noise, 2.0 * fade * np.cos(turn), -(fade**2), sd)


@numba.njit
def _resonance(noise, first, second, sd):
    out = np.zeros(noise.size)
    for n in range(2, noise.size):
        out[n] = first * out[n - 1] + second * out[n - 2] + noise[n]
    out = out[4000:]
    return sd * out / np.std(out)


def record(ship, manoeuvre, seconds, seed):
    """Return the recording of a manoeuvre; two circles or course changes take longer where T is long."""
    source = np.random.default_rng((seed, 11))
    steps = int(seconds / STEP_S)
    push = np.radians(np.sqrt(ship.diffusion)) / ship.lag * np.sqrt(STEP_S) * source.standard_normal(steps)
    wave = wave_yaw(steps, np.radians(ship.wave_deg), ship.period_s, source)
    compass = np.radians(ship.compass_deg) * source.standard_normal(steps)
    table = _run(
        MANOEUVRES.index(manoeuvre), ship.gain, ship.lag, ship.cubic, ship.offset, push, wave, compass, steps,
        ROW_STEPS, STEP_S,
    )  # fmt: skip
    return Recording(f"{manoeuvre} {seed}", *table.T.copy(), None, None)
