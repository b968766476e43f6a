"""Results of the water filter: verdict on the current, dead reckoning, and heading from the track.

Numeric core: functions without I/O; NaN: absent. The covariances are those of water_filter.Water, for (c_N, c_E, U, V):
upper triangle, row by row.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, wrap_two_pi
from firmware_py.estimate.water_filter import (
    MAX_GAP_S,
    MEAN_WALK,
    MIN_SPEED_M_S,
    SPEED_MEMORY_S,
    Water,
    WaterFilter,
    mean_heading,
    standard_deviation,
    water_at,
)

Covariance = tuple[float, float, float, float, float, float, float, float, float, float]

STRONG_CURRENT_SDS: Final = 2.33  # one-sided normal quantile of 1 %
DECISION_TIME_S: Final = 120.0  # for which the test must contradict the verdict
TURNED_COSINE: Final = 0.85  # of the smallest turn that separates speed and current, 32 deg
MAX_POSITION_AGE_S: Final = 120.0  # without a newer position the verdict is kept
FIX_SD_M: Final = 5.0
TIDE_RAD_S: Final = 2.0 * math.pi / 44_712.0  # the principal lunar tide, 12.42 h
MAX_HEADING_SD_RAD: Final = 1.0  # of a heading from the track; beyond it the measurement is not linear
MAX_SPEED_SDS: Final = 3.0  # largest difference of the speed on a stretch of track


class CurrentVerdict(NamedTuple):
    """Time of the last test, time for which it has contradicted the verdict, and verdict (1: too strong, 0: not).

    `cosine` and `sine` are those of the first heading; `turned` is 1 after a turn of more than 32 deg from it.
    """

    t_s: float = math.nan
    against_s: float = 0.0
    too_strong: float = 0.0
    cosine: float = math.nan
    sine: float = math.nan
    turned: float = 0.0


class DeadReckoning(NamedTuple):
    """Speed and current at the last position, their covariance, growth of the error, and distance since then.

    `walk_m2_s3`: growth per second of the variance of each axis of the current. `way_m2_s`: that of the position by
    speed deviation and drift. `cosine_s`, `sine_s`: integrals of the heading's cosine and sine. `blind_m`: distance
    through the water for which the heading was not known.
    """

    current_north_m_s: float = 0.0
    current_east_m_s: float = 0.0
    speed_m_s: float = 0.0
    sideways_m_s: float = 0.0
    # For a stored record without one: 0.3 m/s for current and speed, 0.1 m/s for the sideways speed.
    covariance: Covariance = (0.09, 0.0, 0.0, 0.0, 0.09, 0.0, 0.0, 0.09, 0.0, 0.01)
    walk_m2_s3: float = 0.0
    way_m2_s: float = 0.0
    cosine_s: float = 0.0
    sine_s: float = 0.0
    blind_m: float = 0.0


def quadratic(p: Covariance, a: float, b: float, c: float, d: float) -> float:
    """Return the quadratic form g' P g with g = (a, b, c, d)."""
    return (
        a * (a * p[0] + 2.0 * (b * p[1] + c * p[2] + d * p[3]))
        + b * (b * p[4] + 2.0 * (c * p[5] + d * p[6]))
        + c * (c * p[7] + 2.0 * d * p[8])
        + d * d * p[9]
    )


def over_ground(water: Water, heading_rad: float) -> tuple[float, float]:
    """Return the velocity over ground north and east on a heading; that of the current if the heading is NaN."""
    if math.isnan(heading_rad):
        return water.current_north_m_s, water.current_east_m_s
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    return (
        water.current_north_m_s + water.speed_m_s * cosine - water.sideways_m_s * sine,
        water.current_east_m_s + water.speed_m_s * sine + water.sideways_m_s * cosine,
    )


def current_excess(water: Water) -> tuple[float, float]:
    """Return the excess of the current over the mean speed through the water [m/s], and its standard deviation."""
    north, east, u, v = water.current_north_m_s, water.current_east_m_s, water.mean_speed_m_s, water.sideways_m_s
    current, speed = math.sqrt(north * north + east * east), math.sqrt(u * u + v * v)
    per_current, per_speed = 1.0 / max(current, MIN_SPEED_M_S), 1.0 / max(speed, MIN_SPEED_M_S)
    variance = quadratic(water.covariance, north * per_current, east * per_current, -u * per_speed, -v * per_speed)
    return current - speed, standard_deviation(variance)


def judge_current(verdict: CurrentVerdict, state: WaterFilter, water: Water, t_s: float) -> CurrentVerdict:
    """Return the verdict whether the current is faster than the boat; `water` is the estimate at t_s.

    Null hypothesis: the current is no faster than the mean speed of the boat. It is rejected if the estimated excess is
    more than STRONG_CURRENT_SDS standard deviations for DECISION_TIME_S, and accepted if the excess is below 0 for the
    same time. For a consistent filter and a current as fast as the boat, at most 1 % of the independent estimates
    exceed that limit.

    On a constant heading only the sum of speed and current is observable, and errors of the heading look like a lower
    speed. So until the boat has turned, the hypothesis is rejected only for a current against the heading.
    """
    if not 0.0 <= t_s - state.t_s <= MAX_POSITION_AGE_S:
        return CurrentVerdict(math.nan, 0.0, verdict.too_strong, verdict.cosine, verdict.sine, verdict.turned)
    step_s = t_s - verdict.t_s if t_s > verdict.t_s else 0.0
    excess_m_s, sd_m_s = current_excess(water)
    cosine, sine, turned = verdict.cosine, verdict.sine, verdict.turned
    mean_cosine, mean_sine = mean_heading(state, t_s)
    if math.isnan(cosine):
        cosine, sine = mean_cosine, mean_sine
    elif mean_cosine * cosine + mean_sine * sine < TURNED_COSINE:
        turned = 1.0
    along_m_s = water.current_north_m_s * mean_cosine + water.current_east_m_s * mean_sine
    is_observable = turned > 0.5 or along_m_s < 0.0
    is_against = (
        excess_m_s < 0.0 if verdict.too_strong > 0.5 else is_observable and excess_m_s > STRONG_CURRENT_SDS * sd_m_s
    )
    against_s = verdict.against_s + step_s if is_against else 0.0
    if against_s >= DECISION_TIME_S:
        return CurrentVerdict(t_s, 0.0, 1.0 - verdict.too_strong, cosine, sine, turned)
    return CurrentVerdict(t_s, against_s, verdict.too_strong, cosine, sine, turned)


def begin_dead_reckoning(state: WaterFilter, t_s: float) -> DeadReckoning:
    """Begin dead reckoning at a time, with the estimated speed and current."""
    water = water_at(state, t_s)
    sigma, walk, drift = math.exp(state.levels[0]), math.exp(state.levels[1]), math.exp(state.levels[2])
    return DeadReckoning(
        water.current_north_m_s,
        water.current_east_m_s,
        water.mean_speed_m_s,
        water.sideways_m_s,
        water.covariance,
        walk * walk,
        2.0 * sigma * sigma * SPEED_MEMORY_S + drift * drift,
        0.0,
        0.0,
        0.0,
    )


def advance_dead_reckoning(
    dead_reckoning: DeadReckoning, heading_rad: float, step_s: float
) -> tuple[DeadReckoning, float, float]:
    """Return the dead reckoning after a step, and the velocity over ground north and east; heading NaN: not known."""
    has_heading, u, v = math.isfinite(heading_rad), dead_reckoning.speed_m_s, dead_reckoning.sideways_m_s
    cosine, sine = (math.cos(heading_rad), math.sin(heading_rad)) if has_heading else (0.0, 0.0)
    blind_m = dead_reckoning.blind_m
    if not has_heading:
        blind_m += step_s * math.sqrt(u * u + v * v)
    advanced = DeadReckoning(
        dead_reckoning.current_north_m_s,
        dead_reckoning.current_east_m_s,
        u,
        v,
        dead_reckoning.covariance,
        dead_reckoning.walk_m2_s3,
        dead_reckoning.way_m2_s,
        dead_reckoning.cosine_s + step_s * cosine,
        dead_reckoning.sine_s + step_s * sine,
        blind_m,
    )
    north_m_s = dead_reckoning.current_north_m_s + u * cosine - v * sine
    return advanced, north_m_s, dead_reckoning.current_east_m_s + u * sine + v * cosine


def dead_reckoning_sd(dead_reckoning: DeadReckoning, duration_s: float) -> float:
    """Return the standard deviation of the position after duration_s, along the axis where it is largest.

    It is the sum of: the errors of speed and current at the last position; the random walks of current and mean speed;
    speed deviation and drift; the change of a current that is all tide; the distance without a heading; the error of
    the last position.
    """
    t, a, b, p = (
        clamp(duration_s, 0.0, MAX_GAP_S),
        dead_reckoning.cosine_s,
        dead_reckoning.sine_s,
        dead_reckoning.covariance,
    )
    north, east = quadratic(p, t, 0.0, a, -b), quadratic(p, 0.0, t, b, a)
    cross = 0.5 * (quadratic(p, t, t, a + b, a - b) - north - east)
    half, half_difference = 0.5 * (north + east), 0.5 * (north - east)
    water_variance = half + math.sqrt(half_difference * half_difference + cross * cross)
    walk_variance = (dead_reckoning.walk_m2_s3 * t * t + MEAN_WALK * MEAN_WALK * (a * a + b * b)) * t / 3.0
    phase = TIDE_RAD_S * t
    current2 = dead_reckoning.current_north_m_s * dead_reckoning.current_north_m_s
    current2 += dead_reckoning.current_east_m_s * dead_reckoning.current_east_m_s
    phase_sine, phase_cosine = phase - math.sin(phase), 1.0 - math.cos(phase)
    tide_variance = 0.5 * current2 / (TIDE_RAD_S * TIDE_RAD_S) * (phase_sine * phase_sine + phase_cosine * phase_cosine)
    fix_variance = FIX_SD_M * FIX_SD_M + dead_reckoning.blind_m * dead_reckoning.blind_m
    return standard_deviation(
        water_variance + walk_variance + dead_reckoning.way_m2_s * t + tide_variance + fix_variance
    )


def heading_from_track(
    state: WaterFilter, t_s: float, north_m: float, east_m: float, duration_s: float
) -> tuple[float, float]:
    """Return the mean heading over a stretch of track that ends at t_s, and its standard deviation.

    The motion through the water is the displacement (north_m, east_m) minus that by the current; the heading is its
    direction minus the leeway. Both results are NaN if the speed through the water differs by more than MAX_SPEED_SDS
    from the estimate: speed or current have changed.
    """
    if not (duration_s > 0.0 and abs(north_m) < math.inf and abs(east_m) < math.inf):
        return math.nan, math.nan
    water = water_at(state, t_s)
    x, y = north_m / duration_s - water.current_north_m_s, east_m / duration_s - water.current_east_m_s
    speed, u, v = math.sqrt(x * x + y * y), water.mean_speed_m_s, water.sideways_m_s
    mean_speed = math.sqrt(u * u + v * v)
    if not (speed > MIN_SPEED_M_S and mean_speed > MIN_SPEED_M_S):
        return math.nan, math.nan
    sigma, drift, noise = math.exp(state.levels[0]), math.exp(state.levels[2]), math.exp(state.levels[3])
    noise_m2_s2 = (2.0 * noise * noise / duration_s + drift * drift) / duration_s
    cosine, sine, per_speed2 = x / speed, y / speed, 1.0 / (mean_speed * mean_speed)
    along_variance = (
        quadratic(water.covariance, -cosine, -sine, -u / mean_speed, -v / mean_speed) + noise_m2_s2 + sigma * sigma
    )
    if abs(speed - mean_speed) > MAX_SPEED_SDS * standard_deviation(along_variance):
        return math.nan, math.nan
    across_variance = quadratic(water.covariance, sine / speed, -cosine / speed, v * per_speed2, -u * per_speed2)
    return wrap_two_pi(math.atan2(y, x) - math.atan2(v, u)), standard_deviation(
        across_variance + noise_m2_s2 / (speed * speed)
    )
