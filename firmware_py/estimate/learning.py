"""What the wave filter learns of the sea and of its sensors from its own innovations.

The wave period, and how fast the float follows the glider, follow the gradient of the likelihood (recursive
prediction error method: Ljung and Soderstrom, Theory and Practice of Recursive Identification, 1983).
The strength of the waves follows the energy of the swing that the filter sees, with what it may err by (Shumway and
Stoffer, J. Time Series Analysis 3, 1982): innovations from tenth to tenth of a second would tell the roughness of the
sea instead, and a compass that is damped would make large waves small ones, and the rest of them a wandering rudder
bias. Compass noise follows the size of the innovations that this leaves. The motion of the receiver in the waves and
its noise follow size and correlation of the innovations (Mehra, IEEE Trans. AC-15, 1970): too large means that both
are taken too small, correlated as waves of that period would leave them that the waves are. How fast the rudder bias
wanders, and how far down the receiver's motion reaches, follow the innovations averaged over a while: more than white
noise would leave there means more than it is taken to be. How the receiver's motion goes with the yaw is the
regression of the one on the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import clamp, radians
from firmware_py.estimate.kalman import DAMPING

LARGEST_NORMALISED: Final = 4.0  # one slap of the sea must not teach more than this
PERIOD_MEMORY_S, FOLLOW_MEMORY_S = 300.0, 3600.0
PRIOR, FOLLOW_PRIOR = 5.0, 4.0  # information that the first guess of a frequency counts for
LARGEST_STEP: Final = 0.05  # of the logarithm of a frequency
STRENGTH_TIME_S: Final = 20.0
FIRST_SAMPLES: Final = 20.0
SWING_TIME_S: Final = 120.0
FIRST_SWINGS: Final = 600.0  # samples
SMOOTH_SHARE, SMALL_PART = 4.0, 4.0
SLOW_TIME_S: Final = 10.0
BIAS_GAIN: Final = 0.1
BIAS_PULL: Final = 0.2  # toward the usual wandering, so that chance does not carry it far
FIX_GAIN: Final = 0.02
MEAN_FIX_GAIN: Final = 0.04  # of a mean over a while there are few
SHARE_GAIN, SHARE_PULL = 0.6, 0.3
COUPLING_MEMORY_S, LONGEST_FADE_S = 240.0, 10.0
COUPLING_PRIOR: Final = 5.0  # samples that the first guess, none, counts for
COUPLING_DOUBT: Final = 2.0  # how many times more than chance
LARGEST_FIX: Final = 3.0
LONGEST_GAP_S: Final = 1.0  # beyond it two innovations say nothing of each other
AVERAGE_S: Final = 60.0

FIRST_PERIOD_S: Final = 5.0
FIRST_SPREAD_RAD: Final = radians(5.0)
FIRST_NOISE_RAD: Final = radians(0.3)
FIRST_VELOCITY_NOISE_M_S, FIRST_ORBIT_M_S = 0.1, 0.1
FIRST_SLOW_SHARE: Final = 0.25
FIRST_FOLLOW_RAD_S: Final = 0.8  # between a boat without an umbilical and the slowest floats; a turn or two tell
# By the boat's turning ability: a float behind by 1.2 / 0.8 of a second would be 15 deg behind in a turn of 10 deg/s.
# A boat that turns as quickly hangs on no umbilical. That of the paper has 0.049 / s.
FOLLOW_BY_ABILITY: Final = 16.0
BIAS_NOISE: Final = 0.08 * radians(1.0) ** 2  # [rad^2/s]: 2 deg of spread with 100 s of memory

LOW_OMEGA, HIGH_OMEGA = math.log(2.0 * math.pi / 14.0), math.log(2.0 * math.pi / 1.6)
LOW_NOISE, HIGH_NOISE = math.log(radians(0.01) ** 2), math.log(radians(5.0) ** 2)
LOW_POWER, HIGH_POWER = math.log(1e-4 * radians(1.0) ** 2), math.log(1e4 * radians(1.0) ** 2)
LOW_BIAS, HIGH_BIAS = math.log(2e-4 * radians(1.0) ** 2), math.log(0.36 * radians(1.0) ** 2)
LOW_VELOCITY, HIGH_VELOCITY = math.log(0.02**2), math.log(2.0**2)
LOW_ORBIT, HIGH_ORBIT = math.log(0.003**2), math.log(2.0**2)
LOW_SHARE, HIGH_SHARE = math.log(0.02), math.log(0.99)
LOW_FOLLOW, HIGH_FOLLOW = math.log(0.15), math.log(6.0)


def power_of(spread_rad: float, omega_rad_s: float) -> float:
    """Return the white noise [rad^2/s^3] that drives waves of this spread and frequency."""
    return 4.0 * DAMPING * omega_rad_s * omega_rad_s * omega_rad_s * spread_rad * spread_rad


class Coupling(msgspec.Struct, frozen=True):
    """By what the receiver's velocity goes with the yaw of the waves: a regression with a fading memory.

    `shares`: north by the angle and by the rate in units of the frequency, east by both [m/s per rad]. The rest are
    the sums: squares of angle, both, rate [rad^2]; their products with north, then with east; squares of the two.
    """

    shares: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    yaw: tuple[float, ...] = (0.0, 0.0, 0.0)
    products: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    velocities: tuple[float, ...] = (0.0, 0.0)
    count: float = 0.0


def learn_coupling(
    before: Coupling, swing_rad: tuple[float, float], velocities_m_s: Sequence[float], step_s: float
) -> Coupling:
    """Take angle and rate of the yaw in, and the velocities that speed and current do not explain."""
    fade = math.exp(-min(step_s, LONGEST_FADE_S) / COUPLING_MEMORY_S)
    angle, rate = swing_rad
    count = fade * before.count + 1.0
    a, b, d = yaw = _faded(before.yaw, fade, (angle * angle, angle * rate, rate * rate))
    products = _faded(before.products, fade, [part * v for v in velocities_m_s for part in swing_rad])
    squares = _faded(before.velocities, fade, [v * v for v in velocities_m_s])
    ridge = 0.5 * COUPLING_PRIOR * (a + d) / count
    a, d = a + ridge, d + ridge
    determinant = a * d - b * b
    if determinant <= 0.0:
        return Coupling(before.shares, yaw, products, squares, count)
    shares: list[float] = []
    for by_angle, by_rate, square in zip(products[::2], products[1::2], squares, strict=True):
        of_angle, of_rate = (d * by_angle - b * by_rate) / determinant, (a * by_rate - b * by_angle) / determinant
        explained = of_angle * by_angle + of_rate * by_rate
        # What chance would explain, by two numbers, is not believed (James and Stein).
        chance = COUPLING_DOUBT * 2.0 * max(square - explained, 0.0) / max(count - 2.0, 1.0)
        kept = max(0.0, 1.0 - chance / explained) if explained > 0.0 else 0.0
        shares += (kept * of_angle, kept * of_rate)
    return Coupling(tuple(shares), yaw, products, squares, count)


def _faded(sums: Sequence[float], fade: float, more: Sequence[float]) -> tuple[float, ...]:
    return tuple([fade * old + new for old, new in zip(sums, more, strict=True)])


class NoiseModel(msgspec.Struct, frozen=True):
    """Waves and noise as learned, and what learning remembers.

    Logarithms of the frequency of the waves [rad/s], of the power of the wave yaw, of the variances of compass,
    velocity and of the receiver's motion in the waves, of what the rudder bias gains in a second, of the frequency at
    which the float follows the glider. `velocities` are the last two normalised innovations, newest first, and
    `slow_velocities` their averages. `log_slow_share`: that part of the variance of the receiver's motion which goes
    with the swing itself and so reaches down to slow motion; the rest goes with its rate, as on an orbit. `coupling`:
    what of the receiver's motion is in step with the yaw, beside all that.
    """

    log_omega: float = math.log(2.0 * math.pi / FIRST_PERIOD_S)
    information: float = 0.0
    log_power: float = math.log(power_of(FIRST_SPREAD_RAD, 2.0 * math.pi / FIRST_PERIOD_S))
    log_noise: float = math.log(FIRST_NOISE_RAD**2)
    log_bias_noise: float = math.log(BIAS_NOISE)
    log_velocity_noise: float = math.log(FIRST_VELOCITY_NOISE_M_S**2)
    log_orbit: float = math.log(FIRST_ORBIT_M_S**2)
    log_follow: float = math.log(FIRST_FOLLOW_RAD_S)
    follow_information: float = 0.0
    last_innovation: float = 0.0
    slow_innovation: float = 0.0
    count: int = 0
    average_square: float = 1.0
    velocities: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    slow_velocities: tuple[float, float] = (0.0, 0.0)
    log_slow_share: float = math.log(FIRST_SLOW_SHARE)
    coupling: Coupling = Coupling()

    @property
    def omega_rad_s(self) -> float:
        """Frequency at which the waves swing the boat."""
        return math.exp(self.log_omega)

    @property
    def wave_spread_rad(self) -> float:
        """Standard deviation of the wave yaw."""
        return math.sqrt(math.exp(self.log_power - 3.0 * self.log_omega) / (4.0 * DAMPING))

    @property
    def follow_rad_s(self) -> float:
        """Frequency of the second-order system as which the float follows the glider."""
        return math.exp(self.log_follow)

    @property
    def orbit_shares(self) -> tuple[float, float]:
        """By what the receiver's velocity shows the swing, and its rate in units of the frequency."""
        share = math.exp(self.log_slow_share)
        return math.sqrt(share), math.sqrt(1.0 - share)

    @property
    def orbit_m_s(self) -> float:
        """Standard deviation of the receiver's velocity in the waves along either axis, in step with the yaw or not."""
        in_step = 0.5 * sum([share * share for share in self.coupling.shares])
        return math.sqrt(math.exp(self.log_orbit) + in_step * self.wave_spread_rad * self.wave_spread_rad)

    @property
    def orbit_power(self) -> float:
        """White noise [m^2/s^5] that drives the receiver's velocity in the waves."""
        return power_of(math.exp(0.5 * self.log_orbit), self.omega_rad_s)


def expecting_float(model: NoiseModel, turning_ability_1_s: float) -> NoiseModel:
    """Return the model with the frequency at which a float is expected to follow, where none has shown its own yet."""
    if model.follow_information > 0.0:
        return model
    follow_rad_s = max(FIRST_FOLLOW_RAD_S, FOLLOW_BY_ABILITY * turning_ability_1_s)
    return replace(model, log_follow=min(math.log(follow_rad_s), HIGH_FOLLOW))


def _shift(gradient: float, information: float) -> float:
    return clamp(gradient / information, -LARGEST_STEP, LARGEST_STEP)


def learn_frequencies(
    model: NoiseModel, innovation: float, variance: float, by_omega: float, by_follow: float, step_s: float
) -> NoiseModel:
    """Learn from an innovation and from what a change of ln omega, or of ln follow, would have added to it."""
    information = model.information * math.exp(-step_s / PERIOD_MEMORY_S) + by_omega * by_omega / variance
    follow = model.follow_information * math.exp(-step_s / FOLLOW_MEMORY_S) + by_follow * by_follow / variance
    score = innovation / variance
    return replace(
        model,
        log_omega=clamp(model.log_omega + _shift(score * by_omega, information + PRIOR), LOW_OMEGA, HIGH_OMEGA),
        information=information,
        log_follow=clamp(model.log_follow + _shift(score * by_follow, follow + FOLLOW_PRIOR), LOW_FOLLOW, HIGH_FOLLOW),
        follow_information=follow,
    )


def _slow_excess(average: float, part: float) -> float:
    """Return by how much an average of normalised innovations is larger than white noise would leave it."""
    return min(average * average * (2.0 - part) / part - 1.0, LARGEST_NORMALISED)


def learn_from_heading(
    model: NoiseModel, innovation_rad: float, variance: float, step_s: float, swing_square: float
) -> NoiseModel:
    """Learn noise and the wandering of the bias from a heading's innovation, the waves' strength from their swing.

    `swing_square` [rad^2] is the mean square of the wave yaw as the filter sees it now: half of angle and rate, the
    rate in units of the frequency.
    """
    z = clamp(innovation_rad / math.sqrt(variance), -LARGEST_NORMALISED, LARGEST_NORMALISED)
    count = model.count + 1
    near_s = min(step_s, LONGEST_GAP_S)
    gain = max(1.0 / (count + FIRST_SAMPLES), near_s / STRENGTH_TIME_S)
    part = min(step_s / SLOW_TIME_S, 0.5)
    slow = model.slow_innovation + part * (z - model.slow_innovation)
    slow_excess = _slow_excess(slow, part)
    pull = BIAS_PULL * (math.log(BIAS_NOISE) - model.log_bias_noise)
    bias = model.log_bias_noise + BIAS_GAIN * part * (slow_excess + pull)
    share = min(step_s / AVERAGE_S, 0.5)
    spread_rad = model.wave_spread_rad
    swing = min(swing_square / (spread_rad * spread_rad) - 1.0, LARGEST_NORMALISED)
    swing_gain = near_s / SWING_TIME_S
    # At first, when it has seen the waves swing but few times, it judges them by the correlation of the innovations.
    early = FIRST_SWINGS / (count + FIRST_SWINGS)
    excess = z * z - 1.0
    correlation = early * z * model.last_innovation if step_s <= LONGEST_GAP_S else 0.0
    # Noise that is a small part of the innovation has to change by the more to change it.
    weight = min(variance / math.exp(model.log_noise), SMALL_PART)
    noise = model.log_noise + gain * weight * (excess - correlation)
    # A compass that smooths leaves less than waves of that strength would without any noise.
    waves = early * gain * excess + gain * correlation + (1.0 - early) * swing_gain * swing
    waves += SMOOTH_SHARE * min(noise - LOW_NOISE, 0.0)
    return replace(
        model,
        log_power=clamp(model.log_power + waves, LOW_POWER, HIGH_POWER),
        log_noise=clamp(noise, LOW_NOISE, HIGH_NOISE),
        log_bias_noise=clamp(bias, LOW_BIAS, HIGH_BIAS),
        last_innovation=z,
        slow_innovation=slow,
        count=count,
        average_square=model.average_square + share * (z * z - model.average_square),
    )


def learn_from_velocity(
    model: NoiseModel, normalised: tuple[float, float], step_s: float, *, in_waves: bool
) -> NoiseModel:
    """Learn the receiver's noise, and its motion in the waves where it shows it, from the normalised innovations."""
    north, east = (clamp(z, -LARGEST_FIX, LARGEST_FIX) for z in normalised)
    omega_rad_s, (north_1, east_1, north_2, east_2) = model.omega_rad_s, model.velocities
    correlation = 0.0
    for lag, product in ((1.0, north * north_1 + east * east_1), (2.0, north * north_2 + east * east_2)):
        angle = omega_rad_s * lag * step_s
        correlation += math.exp(-DAMPING * angle) * math.cos(angle) * product
    excess = north * north + east * east - 2.0
    if not in_waves:
        noise = clamp(model.log_velocity_noise + MEAN_FIX_GAIN * excess, LOW_VELOCITY, HIGH_VELOCITY)
        return replace(model, log_velocity_noise=noise)
    noise = model.log_velocity_noise + FIX_GAIN * (excess - correlation)
    orbit = model.log_orbit + FIX_GAIN * (excess + correlation)
    part = min(step_s / SLOW_TIME_S, 0.5)
    slow_north, slow_east = model.slow_velocities
    slow = (slow_north + part * (north - slow_north), slow_east + part * (east - slow_east))
    slow_excess = _slow_excess(slow[0], part) + _slow_excess(slow[1], part)
    pull = SHARE_PULL * (math.log(FIRST_SLOW_SHARE) - model.log_slow_share)
    share = model.log_slow_share + SHARE_GAIN * part * (slow_excess + pull)
    return replace(
        model,
        log_velocity_noise=clamp(noise, LOW_VELOCITY, HIGH_VELOCITY),
        log_orbit=clamp(orbit, LOW_ORBIT, HIGH_ORBIT),
        velocities=(north, east, north_1, east_1),
        slow_velocities=slow,
        log_slow_share=clamp(share, LOW_SHARE, HIGH_SHARE),
    )
