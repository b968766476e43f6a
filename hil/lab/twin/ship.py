"""The hull in compiled code: the model of hil/ship on the same time grid, with series drawn in advance."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import TWO_PI
from firmware_py.model.kt import rk4_step, yaw_acceleration
from hil.lab.compiled import compiled

STEPS_PER_SECOND = 50
GRID_S = 1.0 / STEPS_PER_SECOND
STEERAGE_M_S = 0.05
Floats = NDArray[np.float64]
Series = Floats  # all random processes of a run in one array


class Ship(NamedTuple):
    """Constants of a ship and of its disturbances; the flags `has_...` select the disturbances.

    `_at` are positions of the processes in the series, by grid step. Wave processes have angle and rate: yaw, `orbit`
    along the waves; for a short-crested sea `beside` is the part independent of the yaw, and `alone` replaces the yaw
    if there is none or one of another period; the roll of the compass. `jump` is the jump of the yaw rate at the end of
    a step, times the turning lag.

    f00 to f11: transition of the float in a grid step; float_w2, float_damp: squared natural frequency, damping [1/s].
    body_rad, wind_rad: leeway by the body and by the wind. `slide_...`: sway in turns. `crests_...`: displacement of
    the receiver in a short-crested sea; crests_own: independent of the yaw. c_a to c_e: coefficients A to E of the
    compass deviation [rad]; c_follow: part of its lag that a grid step covers. rotary: ratio of the tide's axes.
    """

    ability_1_s: float
    lag_s: float
    norrbin_s2: float
    model_speed_m_s: float
    bias_rad: float
    speed_m_s: float
    inner_steps: int
    inner_s: float
    has_speed: bool
    has_float: bool
    f00: float
    f01: float
    f10: float
    f11: float
    float_w2: float
    float_damp: float
    has_sideways: bool
    body_rad: float
    wind_rad: float
    wind_from_rad: float
    slide_share: float
    slide_drive: float
    slide_damping_1_m: float
    has_crests: bool
    crests_own: bool
    crests_per_yaw: float
    crests_along_m: float
    crests_across_m: float
    toward_rad: float
    has_orbit: bool
    has_compass: bool
    c_a: float
    c_b: float
    c_c: float
    c_d: float
    c_e: float
    c_lag_s: float
    c_follow: float
    delay_steps: int
    current_north_m_s: float
    current_east_m_s: float
    tide_s: float
    rotary: float
    has_yaw: bool
    has_roll: bool
    has_noise: bool
    offset_at: int
    yaw_at: int
    orbit_at: int
    beside_at: int
    alone_at: int
    roll_at: int
    speed_at: int
    waves_at: int
    jump_at: int
    blade_lost_s: float = math.inf  # from this time the rudder has no effect


# State of a hull, in SI units; RUDDER is the effective angle, COMPASS the lagged heading, SIDEWAYS and SLIDE are sway.
(PSI, YAW_RATE, RUDDER, FLOAT_PSI, FLOAT_RATE, SIDEWAYS, SLIDE, COMPASS, NOW_K, NOW_T, NOW_ALPHA, NOW_SPEED, NORTH_M,
 EAST_M) = range(14)  # fmt: skip
HULL_STATES = 14


@compiled
def set_speed(hull: Floats, ship: Ship, speed_m_s: float) -> None:
    """Set the model to the speed `speed_m_s` (KtModel.at_speed)."""
    ratio = speed_m_s / ship.model_speed_m_s
    hull[NOW_K], hull[NOW_T] = ship.ability_1_s * ratio, ship.lag_s / ratio
    hull[NOW_ALPHA] = ship.norrbin_s2 / (ratio * ratio)
    hull[NOW_SPEED] = speed_m_s


@compiled
def set_wave_speed(hull: Floats, ship: Ship, series: Series, step: int) -> None:
    """Set the model to the wave-driven speed at a grid step."""
    speed_m_s = ship.speed_m_s * series[ship.speed_at + step]
    set_speed(hull, ship, max(speed_m_s, STEERAGE_M_S))
    if speed_m_s < STEERAGE_M_S:
        hull[NOW_K] = hull[NOW_K] * speed_m_s / STEERAGE_M_S
    hull[NOW_SPEED] = speed_m_s


@compiled
def relative_wave_height(ship: Ship, series: Series, step: int) -> float:
    """Return the relative wave height at a grid step."""
    return series[ship.waves_at + step] if ship.has_speed else 1.0


@compiled
def process_angle(series: Series, first: int, step: int, since_s: float) -> float:
    """Return the angle of a wave process, `since_s` after a grid step, by cubic interpolation."""
    first_index = first + 2 * step
    y0, v0, y1, v1 = series[first_index], series[first_index + 1], series[first_index + 2], series[first_index + 3]
    h = GRID_S
    x = since_s / h
    curvature = 3.0 * (y1 - y0) - h * (2.0 * v0 + v1) + x * (2.0 * (y0 - y1) + h * (v0 + v1))
    return float(y0 + x * (h * v0 + x * curvature))


@compiled
def process_rate(series: Series, first: int, step: int, since_s: float) -> float:
    """Return the rate of a wave process, `since_s` after a grid step: the derivative of process_angle."""
    first_index = first + 2 * step
    y0, v0, y1, v1 = series[first_index], series[first_index + 1], series[first_index + 2], series[first_index + 3]
    h = GRID_S
    x = since_s / h
    curvature = 6.0 * (y1 - y0) / h - 2.0 * (2.0 * v0 + v1) + x * (6.0 * (y0 - y1) / h + 3.0 * (v0 + v1))
    return float(v0 + x * curvature)


@compiled
def glider_heading(hull: Floats, ship: Ship, series: Series, step: int, offset_s: float) -> float:
    """Return the heading of the glider, which has the rudder, unwrapped."""
    acceleration = yaw_acceleration(
        hull[YAW_RATE],
        hull[RUDDER],
        hull[NOW_K],
        hull[NOW_T],
        hull[NOW_ALPHA],
        ship.bias_rad + series[ship.offset_at + step],
    )
    return float(hull[PSI] + offset_s * (hull[YAW_RATE] + 0.5 * offset_s * acceleration))


@compiled
def float_heading(hull: Floats, ship: Ship, series: Series, step: int, offset_s: float) -> float:
    """Return the heading of the float, which has the compass, without wave yaw, unwrapped."""
    if not ship.has_float:
        return glider_heading(hull, ship, series, step, offset_s)
    acceleration = ship.float_w2 * (hull[PSI] - hull[FLOAT_PSI]) - ship.float_damp * hull[FLOAT_RATE]
    return float(hull[FLOAT_PSI] + offset_s * (hull[FLOAT_RATE] + 0.5 * offset_s * acceleration))


@compiled
def heading(hull: Floats, ship: Ship, series: Series, step: int, offset_s: float) -> float:
    """Return the heading of a perfect compass, unwrapped."""
    heading_rad = float_heading(hull, ship, series, step, offset_s)
    if ship.has_yaw:
        yaw_rad = process_angle(series, ship.yaw_at, step, offset_s)
        heading_rad += relative_wave_height(ship, series, step) * yaw_rad
    return heading_rad


@compiled
def sensed_heading(ship: Ship, series: Series, step: int, heading_rad: float, offset_s: float) -> float:
    """Return the heading with deviation and heel error of a real compass, without its lag."""
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    deviation_rad = (
        ship.c_a
        + ship.c_b * sine
        + ship.c_c * cosine
        + ship.c_d * 2.0 * sine * cosine
        + ship.c_e * (cosine * cosine - sine * sine)
    )
    roll_rad = process_angle(series, ship.roll_at, step, offset_s) if ship.has_roll else 0.0
    return heading_rad - deviation_rad - relative_wave_height(ship, series, step) * roll_rad * cosine


@compiled
def compass_heading(hull: Floats, ship: Ship, series: Series, step: int, offset_s: float) -> float:
    """Return the heading of the simulated compass, unwrapped."""
    heading_rad = heading(hull, ship, series, step, offset_s)
    if not ship.has_compass:
        return heading_rad
    sensed_rad, last_rad = sensed_heading(ship, series, step, heading_rad, offset_s), hull[COMPASS]
    if ship.c_lag_s > 0.0 and not math.isnan(last_rad):
        return float(last_rad - math.expm1(-offset_s / ship.c_lag_s) * (sensed_rad - last_rad))
    return sensed_rad


@compiled
def velocity_without_waves(hull: Floats, ship: Ship, heading_rad: float, t_s: float) -> tuple[float, float]:
    """Return the velocity over the ground without wave motion, north and east (hil/ship/planar.py)."""
    north_m_s, east_m_s = ship.current_north_m_s, ship.current_east_m_s
    if ship.tide_s > 0.0:
        phase_rad = TWO_PI * np.fmod(t_s, ship.tide_s) / ship.tide_s
        along, across = math.cos(phase_rad), ship.rotary * math.sin(phase_rad)
        north_m_s, east_m_s = along * north_m_s - across * east_m_s, along * east_m_s + across * north_m_s
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    speed_m_s, sideways_m_s = hull[NOW_SPEED], hull[SIDEWAYS]
    return (speed_m_s * cosine - sideways_m_s * sine + north_m_s, speed_m_s * sine + sideways_m_s * cosine + east_m_s)


@compiled
def process_value(series: Series, first: int, step: int, since_s: float, of_rate: bool) -> float:
    """Return the rate or the angle of a wave process, `since_s` after a grid step."""
    return process_rate(series, first, step, since_s) if of_rate else process_angle(series, first, step, since_s)


@compiled
def waves_motion(
    hull: Floats, ship: Ship, series: Series, step: int, offset_s: float, of_rate: bool
) -> tuple[float, float]:
    """Return the orbital velocity (`of_rate`) or displacement, north and east (hil/ship/orbit.py)."""
    ahead, aside = math.cos(ship.toward_rad), math.sin(ship.toward_rad)
    orbit_north = orbit_east = 0.0
    if ship.has_crests:
        yaw_part_at = ship.alone_at if ship.crests_own else ship.yaw_at
        yaw_part = ship.crests_per_yaw * process_value(series, yaw_part_at, step, offset_s, of_rate)
        independent_part = process_value(series, ship.beside_at, step, offset_s, of_rate)
        twice_rad = 2.0 * (ship.toward_rad - float_heading(hull, ship, series, step, offset_s))
        sine, cosine = math.sin(twice_rad), math.cos(twice_rad)
        along_m = ship.crests_along_m * (sine * yaw_part + cosine * independent_part)
        across_m = ship.crests_across_m * (cosine * yaw_part - sine * independent_part)
        orbit_north, orbit_east = along_m * ahead - across_m * aside, along_m * aside + across_m * ahead
    elif ship.has_orbit:
        along = process_value(series, ship.orbit_at, step, offset_s, of_rate)
        orbit_north, orbit_east = along * ahead, along * aside
    wave_height = relative_wave_height(ship, series, step)
    return wave_height * orbit_north, wave_height * orbit_east


@compiled
def velocity(hull: Floats, ship: Ship, series: Series, step: int, offset_s: float) -> tuple[float, float]:
    """Return the velocity over the ground with wave motion, north and east."""
    heading_rad = glider_heading(hull, ship, series, step, offset_s)
    north_m_s, east_m_s = velocity_without_waves(hull, ship, heading_rad, step * GRID_S + offset_s)
    orbit_north_m_s, orbit_east_m_s = waves_motion(hull, ship, series, step, offset_s, True)
    return north_m_s + orbit_north_m_s, east_m_s + orbit_east_m_s


@compiled
def position(hull: Floats, ship: Ship, series: Series, step: int, offset_s: float) -> tuple[float, float]:
    """Return the position north and east of the start with wave motion."""
    middle_s = 0.5 * offset_s
    heading_rad = glider_heading(hull, ship, series, step, middle_s)
    north_m_s, east_m_s = velocity_without_waves(hull, ship, heading_rad, step * GRID_S + middle_s)
    orbit_north_m, orbit_east_m = waves_motion(hull, ship, series, step, offset_s, False)
    return hull[NORTH_M] + north_m_s * offset_s + orbit_north_m, hull[EAST_M] + east_m_s * offset_s + orbit_east_m


@compiled
def begin_hull(hull: Floats, ship: Ship) -> None:
    """Initialise a hull at the mean speed."""
    hull[COMPASS] = math.nan
    set_speed(hull, ship, ship.speed_m_s)


@compiled
def rudder_in_water(ship: Ship, delayed_rad: Floats, step: int, shaft_rad: float) -> float:
    """Return the effective rudder angle; `delayed_rad` is a ring buffer of delayed angles."""
    rudder_rad = 0.0 if step * GRID_S >= ship.blade_lost_s else shaft_rad
    if ship.delay_steps > 0:
        index = step % ship.delay_steps
        delayed_rad[index], rudder_rad = rudder_rad, delayed_rad[index]
    return rudder_rad


@compiled
def step_hull(hull: Floats, ship: Ship, series: Series, step: int, rudder_rad: float) -> None:
    """Advance by a grid step, which ends with the effective rudder angle rudder_rad (hil/ship/kt_plant.py)."""
    psi, r, mean_rudder_rad = hull[PSI], hull[YAW_RATE], 0.5 * (hull[RUDDER] + rudder_rad)
    offset_rad = ship.bias_rad + series[ship.offset_at + step]
    for _ in range(ship.inner_steps):
        psi, r = rk4_step(psi, r, mean_rudder_rad, ship.inner_s, hull[NOW_K], hull[NOW_T], hull[NOW_ALPHA], offset_rad)
    if ship.has_noise:
        r += series[ship.jump_at + step] / hull[NOW_T]
    middle_rad = 0.5 * (hull[PSI] + psi)
    hull[RUDDER], hull[PSI], hull[YAW_RATE] = rudder_rad, psi, r
    if ship.has_sideways:
        update_sideways(hull, ship, middle_rad)
    north_m_s, east_m_s = velocity_without_waves(hull, ship, middle_rad, (step + 0.5) * GRID_S)
    hull[NORTH_M] += north_m_s * GRID_S
    hull[EAST_M] += east_m_s * GRID_S
    if ship.has_float:
        lag_rad, rate_rad_s = hull[FLOAT_PSI] - middle_rad, hull[FLOAT_RATE]
        hull[FLOAT_PSI] = middle_rad + ship.f00 * lag_rad + ship.f01 * rate_rad_s
        hull[FLOAT_RATE] = ship.f10 * lag_rad + ship.f11 * rate_rad_s
    if ship.has_speed:
        set_wave_speed(hull, ship, series, step + 1)
    if ship.has_compass:
        sensed_rad = sensed_heading(ship, series, step + 1, heading(hull, ship, series, step + 1, 0.0), 0.0)
        last_rad = sensed_rad if math.isnan(hull[COMPASS]) else hull[COMPASS]
        hull[COMPASS] = last_rad + ship.c_follow * (sensed_rad - last_rad)


@compiled
def update_sideways(hull: Floats, ship: Ship, middle_rad: float) -> None:
    """Update the sideways velocity, which wind, body and turning cause."""
    speed_m_s = hull[NOW_SPEED]
    angle_rad = ship.body_rad + ship.wind_rad * math.sin(middle_rad - ship.wind_from_rad)
    if ship.slide_share != 0.0:
        last_m_s = -ship.slide_drive / ship.slide_damping_1_m * hull[YAW_RATE]
        keep = math.exp(ship.slide_damping_1_m * speed_m_s * GRID_S)
        hull[SLIDE] = last_m_s + keep * (hull[SLIDE] - last_m_s)
    hull[SIDEWAYS] = speed_m_s * math.tan(angle_rad) + ship.slide_share * hull[SLIDE]
