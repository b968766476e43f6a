"""Random boats in a disturbed sea, simulated independently of the identification: Euler steps of 0.05 s."""

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
    rng = np.random.default_rng((seed, 7))
    lag = 4.0 * np.exp(0.8 * rng.standard_normal())
    gain = 0.25 * np.exp(0.7 * rng.standard_normal()) / lag
    cubic = 0.04 * np.exp(rng.standard_normal()) / gain**2
    return Ship(
        gain, lag, cubic, np.radians(2.0) * rng.standard_normal(), diffusion,
        rng.uniform(0.5, 3.0), rng.uniform(2.0, 6.0), rng.uniform(0.05, 0.3),
    )  # fmt: skip


@numba.njit
def _run(kind, gain, lag, cubic, offset, disturbance, wave, compass, steps, row_steps, step):
    rows = steps // row_steps
    table = np.empty((rows, 3))
    psi = rate = rudder = 0.0
    side, start_heading = 1.0, 0.0
    for n in range(steps):
        now = n * step
        compass_heading = psi + wave[n] + compass[n]
        if kind == 0:  # zigzag: the rudder changes sides after each turn of 20 deg
            if side * (compass_heading - start_heading) > 0.35:
                side = -side
            rudder_goal = 0.35 * side
        elif kind == 1:  # circle: full and half rudder to both sides, each for 10 T
            leg = int(now / (10.0 * lag)) % 4
            rudder_goal = (0.52, -0.52, 0.26, -0.26)[leg]
        else:  # course: a controller whose goal changes by 60 deg every 200 s
            goal = 1.05 * (int(now / 200.0) % 2)
            rudder_goal = min(max(1.2 * (goal - compass_heading) - 0.6 * lag * rate + offset, -0.52), 0.52)
        rudder += min(max(rudder_goal - rudder, -0.5 * step), 0.5 * step)
        if n % row_steps == 0:
            table[n // row_steps] = now, rudder, compass_heading
        rate += step * (gain * (rudder - offset) - rate - cubic * rate**3) / lag + disturbance[n]
        psi += step * rate
    return table


def wave_yaw(count, sd, period, rng, damping=0.15):
    omega = 2.0 * np.pi / period
    decay, turn = np.exp(-damping * omega * STEP_S), omega * np.sqrt(1.0 - damping**2) * STEP_S
    noise = rng.standard_normal(count + 4000)
    return _resonance(noise, 2.0 * decay * np.cos(turn), -(decay**2), sd)


@numba.njit
def _resonance(noise, coefficient_1, coefficient_2, sd):
    out = np.zeros(noise.size)
    for n in range(2, noise.size):
        out[n] = coefficient_1 * out[n - 1] + coefficient_2 * out[n - 2] + noise[n]
    out = out[4000:]
    return sd * out / np.std(out)


def record(ship, manoeuvre, seconds, seed):
    """Return the recording of a manoeuvre of a boat."""
    rng = np.random.default_rng((seed, 11))
    steps = int(seconds / STEP_S)
    disturbance = np.radians(np.sqrt(ship.diffusion)) / ship.lag * np.sqrt(STEP_S) * rng.standard_normal(steps)
    wave = wave_yaw(steps, np.radians(ship.wave_deg), ship.period_s, rng)
    compass = np.radians(ship.compass_deg) * rng.standard_normal(steps)
    table = _run(
        MANOEUVRES.index(manoeuvre), ship.gain, ship.lag, ship.cubic, ship.offset, disturbance, wave, compass, steps,
        ROW_STEPS, STEP_S,
    )  # fmt: skip
    return Recording(f"{manoeuvre} {seed}", *table.T.copy(), None, None)
