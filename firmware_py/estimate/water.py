"""Speed through the water, current and leeway, as the wave filter knows them, and whether the current is too strong.

On a steady heading only the sum of the speed and the current along it can be seen; every turn tells the two apart, and
the leeway from the current across. What is not seen stays as uncertain as the standard deviations say.

The filter's values scatter from fix to fix within that uncertainty, and across a current nearly as fast as the boat a
course becomes a heading that swings with them, and the rudder after it. So they are steered by and told slowly, never
further from the filter's than its standard deviation.
"""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.angles import clamp
from firmware_py.common.reports import Water
from firmware_py.estimate import kalman
from firmware_py.estimate.wave_filter_state import FIRST, FIRST_COURSE_LAG_S, WaveFilterState, water_of

# The current counts as stronger when it is by a standard deviation, for so long; and no longer when weaker.
STRONG_AFTER_S, WEAK_AFTER_S = 120.0, 120.0
WEAK_PART = 0.97
SLOW_S = 30.0
# The filter takes the water for smoother than small eddies leave it: so much it may have changed while it averaged.
CHANGES_M_S = 0.03


class WaterState(msgspec.Struct, frozen=True):
    """How long the current has been stronger (+) or weaker (-) than the boat, until t_s, and the verdict.

    `slow_m_s`: current north and east and the speed as they are steered by, None for the filter's own.
    """

    t_s: float | None = None
    strong_s: float = 0.0
    too_strong: bool = False
    slow_m_s: tuple[float, float, float] | None = None


def report(state: WaterState, waves: WaveFilterState) -> Water:
    """Return the estimate for those who steer by it; before the first heading it is what was expected."""
    north_m_s, east_m_s, speed_m_s, leeway_rad = known(waves)
    if state.slow_m_s is not None:
        north_m_s, east_m_s, speed_m_s = state.slow_m_s
    x, model, course_lag_s = waves.x, waves.noise_model, FIRST_COURSE_LAG_S
    if x:
        nn, ne, _, ee, _, uu = waves.water_covariance()
        half, differ = 0.5 * (nn + ee), 0.5 * (nn - ee)
        worst = half + math.sqrt(differ * differ + ne * ne)
        speed_sd_m_s, leeway_sd_rad = math.hypot(math.sqrt(uu), CHANGES_M_S), waves.spread(kalman.LEEWAY)
        course_lag_s = x[kalman.COURSE_LAG]
    else:
        worst, speed_sd_m_s = FIRST[kalman.NORTH] ** 2, FIRST[kalman.SPEED]
        leeway_sd_rad = FIRST[kalman.LEEWAY]
    return Water(
        speed_m_s,
        speed_sd_m_s,
        north_m_s,
        east_m_s,
        math.sqrt(max(worst, 0.0) + CHANGES_M_S * CHANGES_M_S),
        leeway_rad,
        leeway_sd_rad,
        model.follow_rad_s,
        course_lag_s,
        model.orbit_m_s,
        state.too_strong,
    )


def known(waves: WaveFilterState) -> tuple[float, float, float, float]:
    """Return current north and east [m/s], speed through the water [m/s] and leeway [rad], without their spreads."""
    return (*water_of(waves), waves.x[kalman.LEEWAY] if waves.x else 0.0)


def over_ground_m_s(waves: WaveFilterState, heading_rad: float | None) -> tuple[float, float]:
    """Return the boat's velocity over ground on a heading, north and east; without one that of the water."""
    north_m_s, east_m_s, speed_m_s, leeway_rad = known(waves)
    if heading_rad is None:
        return north_m_s, east_m_s
    way_rad = heading_rad + leeway_rad
    return north_m_s + speed_m_s * math.cos(way_rad), east_m_s + speed_m_s * math.sin(way_rad)


def update(state: WaterState, waves: WaveFilterState, now_s: float) -> WaterState:
    """Judge, with patience both ways, whether the current is stronger than the boat, while a receiver tells of it."""
    if not waves.x or waves.fix_t_s is None or now_s - waves.fix_t_s > WEAK_AFTER_S:
        return WaterState(None, 0.0, state.too_strong, state.slow_m_s)  # the last that was known
    step_s = 0.0 if state.t_s is None else max(now_s - state.t_s, 0.0)
    north, east, speed, _ = known(waves)
    current = math.hypot(north, east)
    a, b = (north / current, east / current) if current > 1e-6 else (1.0, 0.0)
    strong_s = state.strong_s
    nn, ne, nu, ee, eu, uu = waves.water_covariance()
    # Of the current along (a, b) less the speed.
    variance = a * a * nn + b * b * ee + 2.0 * a * b * ne + uu - 2.0 * (a * nu + b * eu)
    if current > speed + math.sqrt(max(0.0, variance)):
        strong_s = max(0.0, strong_s) + step_s
    elif current < WEAK_PART * speed:
        strong_s = min(0.0, strong_s) - step_s
    else:
        strong_s = 0.0
    too_strong = state.too_strong
    if strong_s >= STRONG_AFTER_S:
        too_strong = True
    elif strong_s <= -WEAK_AFTER_S:
        too_strong = False
    if state.slow_m_s is not None:
        part, (slow_north, slow_east, slow_speed) = min(step_s / SLOW_S, 1.0), state.slow_m_s
        north = _followed(slow_north, north, part, math.sqrt(nn))
        east = _followed(slow_east, east, part, math.sqrt(ee))
        speed = _followed(slow_speed, speed, part, math.sqrt(uu))
    return WaterState(now_s, strong_s, too_strong, (north, east, speed))


def _followed(before: float, now: float, part: float, spread: float) -> float:
    """Return what follows slowly, and never further off than the spread."""
    return clamp(before + part * (now - before), now - spread, now + spread)
