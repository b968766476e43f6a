"""What the wave filter learns of the sea and of its sensors from its own innovations.

The wave period follows the gradient of the likelihood (recursive prediction error method: Ljung and
Soderstrom, Theory and Practice of Recursive Identification, 1983). Wave strength and compass noise
follow size and first correlation of the innovations (Mehra, IEEE Trans. AC-15, 1970): too large means
that both are taken too small, positively correlated that the waves are. How fast the rudder bias
wanders follows the innovations averaged over a while: more than white noise would leave there
means that the bias wanders faster than it is taken to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.common.angles import clamp, radians
from firmware_py.estimate.kalman import DAMPING

LARGEST_NORMALISED: Final = 4.0  # one slap of the sea must not teach more than this
PERIOD_MEMORY_S: Final = 300.0
PERIOD_PRIOR: Final = 10.0  # information that the first guess of the period counts for
LARGEST_PERIOD_STEP: Final = 0.05
STRENGTH_TIME_S: Final = 20.0
FIRST_SAMPLES: Final = 20.0
BIAS_TIME_S: Final = 10.0
BIAS_GAIN: Final = 0.1
BIAS_PULL: Final = 0.1  # toward the usual wandering, so that chance does not carry it far
FIX_GAIN: Final = 0.04
LONGEST_GAP_S: Final = 1.0  # beyond it two innovations say nothing of each other
AVERAGE_S: Final = 60.0

FIRST_PERIOD_S: Final = 5.0
FIRST_SPREAD_RAD: Final = radians(5.0)
FIRST_NOISE_RAD: Final = radians(0.3)
FIRST_VELOCITY_NOISE_M_S: Final = 0.3  # a receiver in waves shows their orbital motion until it is known not to
BIAS_NOISE: Final = 0.09 * radians(1.0) ** 2  # [rad^2/s]: about 2 deg of spread, 100 s of memory

LOW_OMEGA, HIGH_OMEGA = math.log(2.0 * math.pi / 14.0), math.log(2.0 * math.pi / 1.6)
LOW_NOISE, HIGH_NOISE = math.log(radians(0.01) ** 2), math.log(radians(5.0) ** 2)
LOW_POWER, HIGH_POWER = math.log(1e-4 * radians(1.0) ** 2), math.log(1e4 * radians(1.0) ** 2)
LOW_BIAS, HIGH_BIAS = math.log(0.002 * BIAS_NOISE), math.log(4.0 * BIAS_NOISE)
LOW_VELOCITY, HIGH_VELOCITY = math.log(0.02**2), math.log(2.0**2)


def power_of(spread_rad: float, omega_rad_s: float) -> float:
    """Return the white noise [rad^2/s^3] that drives waves of this spread and frequency."""
    return 4.0 * DAMPING * omega_rad_s**3 * spread_rad * spread_rad


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Waves and noise as learned: logarithms of frequency [rad/s], powers, variances; and what learning remembers."""

    log_omega: float = math.log(2.0 * math.pi / FIRST_PERIOD_S)
    information: float = 0.0
    log_power: float = math.log(power_of(FIRST_SPREAD_RAD, 2.0 * math.pi / FIRST_PERIOD_S))
    log_noise: float = math.log(FIRST_NOISE_RAD**2)
    log_bias_noise: float = math.log(BIAS_NOISE)
    log_velocity_noise: float = math.log(FIRST_VELOCITY_NOISE_M_S**2)
    last_innovation: float = 0.0
    slow_innovation: float = 0.0
    count: int = 0
    average_square: float = 1.0

    @property
    def omega_rad_s(self) -> float:
        """Frequency at which the waves swing the boat."""
        return math.exp(self.log_omega)

    @property
    def wave_spread_rad(self) -> float:
        """Standard deviation of the wave yaw."""
        return math.sqrt(math.exp(self.log_power - 3.0 * self.log_omega) / (4.0 * DAMPING))


def learn_from_heading(
    model: NoiseModel, innovation_rad: float, variance: float, sensitivity: float, step_s: float
) -> NoiseModel:
    """Learn from a heading's innovation; `sensitivity` is what a change of ln omega would have added to it."""
    z = clamp(innovation_rad / math.sqrt(variance), -LARGEST_NORMALISED, LARGEST_NORMALISED)
    information = model.information * math.exp(-step_s / PERIOD_MEMORY_S) + sensitivity * sensitivity / variance
    shift = clamp(
        innovation_rad * sensitivity / variance / (information + PERIOD_PRIOR),
        -LARGEST_PERIOD_STEP,
        LARGEST_PERIOD_STEP,
    )
    count = model.count + 1
    gain = max(1.0 / (count + FIRST_SAMPLES), min(step_s, LONGEST_GAP_S) / STRENGTH_TIME_S)
    excess = z * z - 1.0
    correlation = z * model.last_innovation if step_s <= LONGEST_GAP_S else 0.0
    part = min(step_s / BIAS_TIME_S, 0.5)
    slow = model.slow_innovation + part * (z - model.slow_innovation)
    slow_excess = min(slow * slow * (2.0 - part) / part - 1.0, LARGEST_NORMALISED)
    pull = BIAS_PULL * (math.log(BIAS_NOISE) - model.log_bias_noise)
    bias = model.log_bias_noise + BIAS_GAIN * part * (slow_excess + pull)
    share = min(step_s / AVERAGE_S, 0.5)
    return replace(
        model,
        log_omega=clamp(model.log_omega + shift, LOW_OMEGA, HIGH_OMEGA),
        information=information,
        log_power=clamp(model.log_power + gain * (excess + correlation), LOW_POWER, HIGH_POWER),
        log_noise=clamp(model.log_noise + gain * (excess - correlation), LOW_NOISE, HIGH_NOISE),
        log_bias_noise=clamp(bias, LOW_BIAS, HIGH_BIAS),
        last_innovation=z,
        slow_innovation=slow,
        count=count,
        average_square=model.average_square + share * (z * z - model.average_square),
    )


def learn_from_velocity(model: NoiseModel, squares: float) -> NoiseModel:
    """Learn the receiver's noise from the sum of two normalised squared innovations, each at most 9."""
    grown = model.log_velocity_noise + FIX_GAIN * (squares - 2.0)
    return replace(model, log_velocity_noise=clamp(grown, LOW_VELOCITY, HIGH_VELOCITY))
