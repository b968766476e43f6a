"""Deviation of a compass estimated under way, from its headings and the velocity over ground (compass swing).

A minute in which the boat hardly turns is one observation: the mean velocity over ground, and the means of the basis
functions of the deviation (A to E of deviation.py) over all readings, so that wave yaw causes no bias. A Kalman filter
estimates the five coefficients, current and speed:

    v = U (cos k, sin k) + c        k = compass + declination + A + B sin h + C cos h + D sin 2h + E cos 2h

c and U may change from hour to hour. Limits: the estimated A contains the leeway, and a boat that is 1 % faster in one
direction than in the opposite one causes an error of half a degree in B or C. The result is only proposed; the
autopilot does not steer by it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from firmware_py.common.angles import TWO_PI, radians, wrap_pi
from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import HeadingSample, NorthReference, PositionSample
from firmware_py.estimate.deviation import Deviation, deviation_rad, read_deviation
from firmware_py.estimate.position import place_of

BLOCK_S: Final = 60.0  # duration of an observation
MAX_TURN_RAD: Final = radians(20.0)  # in a minute: in a faster turn the velocity lags behind the heading
MAX_VELOCITY_M_S: Final = 10.0  # a larger one is a receiver error
MIN_HEADINGS, MIN_FIXES = 20, 5  # number in a minute
SECTORS: Final = 12  # of the full circle

COEFFICIENTS: Final = 5
NORTH, EAST, SPEED, STATES = 5, 6, 7, 8  # after the five coefficients
# Initial standard deviations, and variance of the process noise per second, of each state.
INITIAL_SDS: Final = (radians(20.0), *[radians(12.0)] * 2, *[radians(6.0)] * 2, 0.4, 0.4, 0.3)
PROCESS_NOISE: Final = (*[(radians(0.1) ** 2) / 86400.0] * 5, 2e-7, 2e-7, 1e-6)
MAX_STEP_S: Final = 6.0 * 3600.0  # limits the process noise of a gap
MIN_LOG_NOISE: Final = 2.0 * math.log(0.003)  # logarithm of a variance; 0.003 m/s
NOISE_GAIN: Final = 0.05  # change of the log noise at one observation, per excess of its squared innovation
MAX_LEG_TURN_RAD: Final = radians(12.0)  # a larger turn begins another leg
MIN_SPEED_M_S: Final = 0.1  # used instead of a lower speed in sensitivities and residual
OUTLIER_SQUARE: Final = 9.0  # limit of the squared innovation divided by its variance

# A proposal needs this number of sectors sailed in, and this standard deviation on the least certain heading.
MIN_SECTORS: Final = 8
MAX_SD_RAD: Final = radians(0.75)
_CARD_RAD: Final = tuple(TWO_PI * number / 36 for number in range(36))  # headings of the deviation card


class DeviationSettings(msgspec.Struct, frozen=True):
    """Mounting angle and configured deviation of compass A."""

    offset_rad: float
    deviation: Deviation

    @classmethod
    def of(cls, parameters: ParameterSet) -> DeviationSettings:
        """Read the settings of compass A from the parameters."""
        return cls(radians(parameters["CMP_OFFSET_DEG"]), read_deviation(parameters, "CMP"))


class DeviationInput(msgspec.Struct, frozen=True):
    """Inputs of a tick: new headings, declination, a new accepted fix (None: there is none), smoothed heading.

    `water` is the initial state of the filter: current north and east, speed through the water [m/s].
    """

    headings: Sequence[HeadingSample]
    declination_rad: float
    fix: PositionSample | None
    heading_rad: float
    water: tuple[float, float, float]


class Minute(msgspec.Struct, frozen=True):
    """Observation in progress: its start, and the sums since then.

    `heading_rad` is the smoothed heading at the start, `first_rad` the first heading of the compass. `readings`: number
    of headings, sum of the angles turned since the first, sums of sine and cosine of the heading and of twice the
    heading. `velocities`: number, sums north and east. `first_fix`, `last_fix`: fixes of a receiver without velocity.
    """

    begun_s: float
    heading_rad: float
    first_rad: float
    declination_rad: float
    readings: tuple[float, ...] = (0.0,) * 6
    velocities: tuple[float, float, float] = (0.0,) * 3
    first_fix: PositionSample | None = None
    last_fix: PositionSample | None = None


class DeviationEstimate(msgspec.Struct, frozen=True):
    """Estimated coefficients A to E and their standard deviations.

    `sd_rad` is the standard deviation of the deviation on the least certain heading, `off_rad` the largest difference
    from the configured deviation. `ready`: the estimate is certain enough to be proposed.
    """

    coefficients_rad: Deviation
    sds_rad: tuple[float, ...]
    sd_rad: float
    off_rad: float
    ready: bool


class DeviationState(msgspec.Struct, frozen=True):
    """Observation in progress, and state of the filter at t_s.

    The mean `x` and the covariance `p` (8 x 8 float64 as bytes, row by row) are those of A to E, current north and
    east, and speed; both are empty before the first minute. `log_noise`: logarithms of the noise variances along and
    across the course through the water. `leg`: that course and the sensitivities on it. `sectors`: number of minutes in
    each sector. `last_minute`: time, compass heading with declination, basis functions of B to E, velocity north and
    east.
    """

    minute: Minute | None = None
    t_s: float = 0.0
    offset_rad: float = 0.0
    x: tuple[float, ...] = ()
    p: bytes = b""
    log_noise: tuple[float, float] = (2.0 * math.log(0.05),) * 2  # 0.05 m/s, of the mean velocity of a minute
    leg: tuple[float, ...] | None = None
    sectors: tuple[int, ...] = (0,) * SECTORS
    last_minute: tuple[float, ...] = ()


def update(settings: DeviationSettings, state: DeviationState, inputs: DeviationInput, now_s: float) -> DeviationState:
    """Return the state after a tick; a change of the mounting angle restarts the filter."""
    minute = state.minute
    if settings.offset_rad != state.offset_rad:
        state, minute = DeviationState(offset_rad=settings.offset_rad), None
    for sample in inputs.headings:
        is_heading = sample.source == 0 and sample.reference is not NorthReference.RELATIVE
        if is_heading and math.isfinite(sample.heading_rad):
            minute = _with_heading(minute, sample, settings.offset_rad, inputs, now_s)
    if minute is None:
        return state
    if inputs.fix is not None:
        minute = _with_fix(minute, inputs.fix)
    if abs(wrap_pi(inputs.heading_rad - minute.heading_rad)) > MAX_TURN_RAD:
        return replace(state, minute=None)
    if now_s - minute.begun_s < BLOCK_S:
        return state if minute is state.minute else replace(state, minute=minute)
    state = replace(state, minute=None)
    velocity = _velocity(minute)
    if minute.readings[0] < MIN_HEADINGS or velocity is None:
        return state
    return _update_with_minute(settings, state, minute, velocity, inputs.water, now_s)


def without_minute(state: DeviationState) -> DeviationState:
    """Return the state without the observation in progress, because another run begins."""
    return replace(state, minute=None)


def _with_heading(
    minute: Minute | None, sample: HeadingSample, offset_rad: float, inputs: DeviationInput, now_s: float
) -> Minute:
    """Return the minute with a heading added, or a new minute that begins with it."""
    mounted_rad = sample.heading_rad + offset_rad
    if minute is None:
        # A compass that gives true headings has added the declination itself.
        declination_rad = inputs.declination_rad if sample.reference is NorthReference.MAGNETIC else 0.0
        minute = Minute(now_s, inputs.heading_rad, mounted_rad, declination_rad)
    sine, cosine = math.sin(mounted_rad), math.cos(mounted_rad)
    number, turned_rad, sine_sum, cosine_sum, sine_2_sum, cosine_2_sum = minute.readings
    readings = (
        number + 1.0,
        turned_rad + wrap_pi(mounted_rad - minute.first_rad),
        sine_sum + sine,
        cosine_sum + cosine,
        sine_2_sum + 2.0 * sine * cosine,
        cosine_2_sum + cosine * cosine - sine * sine,
    )
    return Minute(
        minute.begun_s,
        minute.heading_rad,
        minute.first_rad,
        minute.declination_rad,
        readings,
        minute.velocities,
        minute.first_fix,
        minute.last_fix,
    )


def _with_fix(minute: Minute, fix: PositionSample) -> Minute:
    """Return the minute with a fix added."""
    speed_m_s, course_rad = fix.speed_over_ground_m_s, fix.course_over_ground_rad
    if speed_m_s is None:
        return replace(minute, first_fix=minute.first_fix or fix, last_fix=fix)
    course_rad = course_rad or 0.0  # receivers state no course at rest
    # With NaN both comparisons are false.
    if not (0.0 <= speed_m_s <= MAX_VELOCITY_M_S and abs(course_rad) <= 2.0 * TWO_PI):
        return minute
    number, north_m_s, east_m_s = minute.velocities
    north_m_s += speed_m_s * math.cos(course_rad)
    east_m_s += speed_m_s * math.sin(course_rad)
    return replace(minute, velocities=(number + 1.0, north_m_s, east_m_s))


def _velocity(minute: Minute) -> tuple[float, float] | None:
    """Return the mean velocity of a minute, or None. Without velocities of the receiver it is that of the positions."""
    number, north_m_s, east_m_s = minute.velocities
    if number >= MIN_FIXES:
        return north_m_s / number, east_m_s / number
    first, last = minute.first_fix, minute.last_fix
    if number or first is None or last is None or last.t_s - first.t_s < 0.75 * BLOCK_S:
        return None
    start, end, duration_s = place_of(first), place_of(last), last.t_s - first.t_s
    north_rad = end.latitude_rad - start.latitude_rad
    east_rad = math.cos(end.latitude_rad) * wrap_pi(end.longitude_rad - start.longitude_rad)
    north_m_s, east_m_s = EARTH_RADIUS_M * north_rad / duration_s, EARTH_RADIUS_M * east_rad / duration_s
    return (north_m_s, east_m_s) if math.hypot(north_m_s, east_m_s) <= MAX_VELOCITY_M_S else None


def _update_with_minute(
    settings: DeviationSettings,
    state: DeviationState,
    minute: Minute,
    velocity: tuple[float, float],
    water: tuple[float, float, float],
    now_s: float,
) -> DeviationState:
    """Return the state updated with the observation of a minute and its mean velocity."""
    if state.x:
        x, p = state.x, np.frombuffer(state.p).reshape(STATES, STATES).copy()
        p.flat[:: STATES + 1] += np.array(PROCESS_NOISE) * min(now_s - state.t_s, MAX_STEP_S)
    else:
        x, p = (*settings.deviation, *water), np.diag(np.square(INITIAL_SDS))
    number, turned_rad, *sums = minute.readings
    basis = (1.0, *(total / number for total in sums))
    compass_rad = minute.first_rad + turned_rad / number + minute.declination_rad
    course_rad = compass_rad + sum(value * factor for value, factor in zip(x, basis, strict=False))
    # The sensitivities are constant until the boat has turned. Otherwise the errors of the estimates from minute to
    # minute would look like turns, and would separate speed, current and deviation on a single course.
    leg = state.leg
    if leg is None or abs(wrap_pi(course_rad - leg[0])) > MAX_LEG_TURN_RAD:
        leg = (wrap_pi(course_rad), *(max(x[SPEED], MIN_SPEED_M_S) * factor for factor in basis))
    cosine, sine = math.cos(leg[0]), math.sin(leg[0])
    residual_m_s = (
        velocity[0] - x[NORTH] - x[SPEED] * math.cos(course_rad),
        velocity[1] - x[EAST] - x[SPEED] * math.sin(course_rad),
    )
    sensitivities = (
        (*(0.0,) * COEFFICIENTS, cosine, sine, 1.0),  # along the course through the water
        (*leg[1:], -sine, cosine, 0.0),  # across it
    )
    previous_x, log_noise = x, list(state.log_noise)
    for axis, sensitivity in enumerate(sensitivities):
        predicted = sum(factor * (now - then) for factor, now, then in zip(sensitivity, x, previous_x, strict=True))
        innovation = sensitivity[NORTH] * residual_m_s[0] + sensitivity[EAST] * residual_m_s[1] - predicted
        cross_covariance = np.zeros(STATES)
        for index, factor in enumerate(sensitivity):
            cross_covariance += factor * p[index]
        variance = sum(factor * float(cross_covariance[index]) for index, factor in enumerate(sensitivity)) + math.exp(
            log_noise[axis]
        )
        square = innovation * innovation / variance
        log_noise[axis] = max(log_noise[axis] + NOISE_GAIN * (min(square, OUTLIER_SQUARE) - 1.0), MIN_LOG_NOISE)
        variance *= max(1.0, square / OUTLIER_SQUARE)
        x = tuple(
            value + gain * innovation for value, gain in zip(x, (cross_covariance / variance).tolist(), strict=True)
        )
        p = p - np.multiply.outer(cross_covariance, cross_covariance) / variance
    if not (math.isfinite(sum(x)) and p.diagonal().min() > 0.0):
        return DeviationState(offset_rad=state.offset_rad)
    sector = int((compass_rad % TWO_PI) / TWO_PI * SECTORS) % SECTORS
    sectors = tuple(minutes + (index == sector) for index, minutes in enumerate(state.sectors))
    noise = (log_noise[0], log_noise[1])
    last_minute = (now_s, compass_rad, *basis[1:], *velocity)
    return replace(
        state, t_s=now_s, x=x, p=p.tobytes(), log_noise=noise, leg=leg, sectors=sectors, last_minute=last_minute
    )


def result(settings: DeviationSettings, state: DeviationState) -> DeviationEstimate | None:
    """Return the estimated deviation; None before the first minute."""
    if not state.x:
        return None
    p = np.frombuffer(state.p).reshape(STATES, STATES)[:COEFFICIENTS, :COEFFICIENTS]
    a, b, c, d, e = state.x[:COEFFICIENTS]
    max_variance = off_rad = 0.0
    for heading_rad in _CARD_RAD:
        sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
        basis = np.array((1.0, sine, cosine, 2.0 * sine * cosine, cosine * cosine - sine * sine))
        max_variance = max(max_variance, float((np.multiply.outer(basis, basis) * p).sum()))
        difference_rad = deviation_rad((a, b, c, d, e), heading_rad) - deviation_rad(settings.deviation, heading_rad)
        off_rad = max(off_rad, abs(difference_rad))
    sd_rad = math.sqrt(max_variance)
    sectors_sailed = sum(minutes > 0 for minutes in state.sectors)
    ready = sectors_sailed >= MIN_SECTORS and sd_rad <= MAX_SD_RAD
    return DeviationEstimate((a, b, c, d, e), tuple(np.sqrt(p.diagonal()).tolist()), sd_rad, off_rad, ready)
