"""Manoeuvres of a known boat, for tests, proofs and measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.model.kt import KtModel
from hil.lab.identify.filter import simulate
from hil.lab.identify.recording import Floats, Recording
from hil.lab.identify.stretches import Columns, Data, Stretch
from hil.ship.noise import Stream, generator
from hil.ship.servo import DEFAULT_SLEW_RAD_S
from hil.ship.waves import discretised


@dataclass(frozen=True, slots=True)
class Noise:
    """What the sensors add: physics.md section 6 for the compass; waves turn compass and gyro alike."""

    heading_rad: float = radians(0.3)
    resolution_rad: float = radians(0.1)
    yaw_rate_rad_s: float = radians(0.1)
    wave_yaw_rad: float = 0.0
    wave_period_s: float = 2.53


TANK = Noise(wave_yaw_rad=radians(1.5))


def zigzag(time_s: Floats, angle_rad: float, half_period_s: float) -> Floats:
    """Return a rudder that goes to either side by turns, with the servo's slew."""
    return legs(time_s, (angle_rad, -angle_rad), half_period_s)


def legs(time_s: Floats, angles_rad: Sequence[float], leg_s: float) -> Floats:
    """Return a rudder that takes angles in turn, each for a time, over and over, with the servo's slew."""
    number = (time_s // leg_s).astype(int) % len(angles_rad)
    target, rudder = np.asarray(angles_rad)[number], np.zeros(time_s.size)
    reach = DEFAULT_SLEW_RAD_S * np.diff(time_s)
    for n in range(1, time_s.size):
        rudder[n] = rudder[n - 1] + min(max(target[n] - rudder[n - 1], -reach[n - 1]), reach[n - 1])
    return rudder


def record(model: KtModel, time_s: Floats, rudder_rad: Floats, noise: Noise, seed: int) -> Recording:
    """Return what would be recorded of a boat that follows the model."""
    columns = Columns(Data((Stretch("", time_s, rudder_rad, np.zeros(time_s.size), None, np.ones(time_s.size)),), None))
    values = [model.turning_ability_1_s, model.turning_lag_s, model.norrbin_s2, model.rudder_offset_rad, 1.0]
    rudder = columns.rudder_rad(0.0, 0.0)
    out = np.empty((2, time_s.size))
    simulate(np.array(values), np.zeros(1), columns.step_s, columns.first, rudder, columns.speed_ratio, out)
    heading, rate = out
    source = generator(seed, Stream.COMPASS)
    wave, wave_rate = _waves(time_s, noise, generator(seed, Stream.WAVES))
    seen = heading + wave + noise.heading_rad * source.standard_normal(time_s.size)
    if noise.resolution_rad > 0.0:
        seen = np.round(seen / noise.resolution_rad) * noise.resolution_rad
    turning = rate + wave_rate + noise.yaw_rate_rad_s * source.standard_normal(time_s.size)
    return Recording(f"synthetic {seed}", time_s, rudder_rad, seen, turning, None)


def _waves(time_s: Floats, noise: Noise, source: np.random.Generator) -> tuple[Floats, Floats]:
    """Return yaw and yaw rate of the waves, on an even grid of times."""
    if noise.wave_yaw_rad <= 0.0:
        return np.zeros(time_s.size), np.zeros(time_s.size)
    omega_rad_s = 2.0 * np.pi / noise.wave_period_s
    step_s = float(np.median(np.diff(time_s)))
    spreads = (noise.wave_yaw_rad, noise.wave_yaw_rad * omega_rad_s)
    ((a00, a01), (a10, a11)), (n00, n10, n11) = discretised(spreads, omega_rad_s, step_s)
    angle, rate = (spread * float(source.standard_normal()) for spread in spreads)
    angles, rates = np.empty(time_s.size), np.empty(time_s.size)
    for n, (first, second) in enumerate(source.standard_normal((time_s.size, 2)).tolist()):
        angles[n], rates[n] = angle, rate
        angle, rate = a00 * angle + a01 * rate + n00 * first, a10 * angle + a11 * rate + n10 * first + n11 * second
    return angles, rates
