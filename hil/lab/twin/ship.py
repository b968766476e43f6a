"""Twin of hil/ship: the hull in its sea, on the same grid of time, of series that do not depend on the boat.

What is called at each heading is written for numbers side by side and for one alone, the velocity for one alone.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from firmware_py.common.angles import TWO_PI
from firmware_py.model.kt import yaw_acceleration
from hil.lab.compiled import compiled
from hil.lab.lane_math import fails, most
from hil.lab.lane_rows import rows
from hil.lab.lanes import any_of, where
from hil.lab.twin.kalman import Floats

STEPS_PER_SECOND = 50
GRID_S = 1.0 / STEPS_PER_SECOND
STEERAGE_M_S = 0.05


Lanes = Any  # or a number
Hull = Any  # the numbers of one, or rows of those side by side
Series = Floats  # the numbers of everything that moves by itself, one kind behind the other


class Ship(NamedTuple):
    """The numbers of a ship and of what is unkind in its sea; `has_` says what there is of it.

    `_at` is where in the series the numbers of each grid step begin. The processes of the waves are angle and rate:
    yaw, `orbit` along the waves, and of a short-crested sea what is `beside` the yaw and, without a yaw, the motion
    `alone`; the roll of the compass.
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
    has_more: bool  # than a hull: way sideways, a float, a changing speed, a compass as bought
    offset_at: int
    yaw_at: int
    orbit_at: int
    beside_at: int
    alone_at: int
    roll_at: int
    speed_at: int
    waves_at: int
    blade_lost_s: float = math.inf  # from then on the rudder turns nothing


# What a hull remembers; the last two are room to work in.
(PSI, YAW_RATE, RUDDER, FLOAT_PSI, FLOAT_RATE, SIDEWAYS, SLIDE, SHOWN, NOW_K, NOW_T, NOW_ALPHA, NOW_SPEED,
 SWAPPED, PLACE) = range(14)  # fmt: skip
HULL_STATES = 14


@compiled
def be_at(hull: Hull, ship: Ship, speed_m_s: Lanes) -> None:
    """Be the ship at a speed (KtModel.at_speed)."""
    ratio = speed_m_s / ship.model_speed_m_s
    hull[NOW_K], hull[NOW_T] = ship.ability_1_s * ratio, ship.lag_s / ratio
    hull[NOW_ALPHA] = ship.norrbin_s2 / (ratio * ratio)
    hull[NOW_SPEED] = speed_m_s


@compiled
def take_speed(hull: Hull, ship: Ship, series: Series, step: Lanes) -> None:
    """Be the ship of the speed that the waves give at a grid step."""
    speed_m_s = ship.speed_m_s * series[where(ship.has_speed, ship.speed_at + step, 0)]
    be_at(hull, ship, most(speed_m_s, STEERAGE_M_S))
    hull[NOW_K] = where(speed_m_s < STEERAGE_M_S, hull[NOW_K] * speed_m_s / STEERAGE_M_S, hull[NOW_K])
    hull[NOW_SPEED] = speed_m_s


@compiled
def waves_share(ship: Ship, series: Series, step: Lanes) -> Lanes:
    """Return how much of the waves there is, when they die."""
    return where(ship.has_speed, series[where(ship.has_speed, ship.waves_at + step, 0)], 1.0)


@compiled
def process_angle(series: Series, at: Lanes, since_s: Lanes) -> Lanes:
    """Return the angle of a wave process, since_s into a grid step that begins at a place of the series."""
    y0, v0, y1, v1 = series[at], series[at + 1], series[at + 2], series[at + 3]
    h = GRID_S
    x = since_s / h
    bend = 3.0 * (y1 - y0) - h * (2.0 * v0 + v1) + x * (2.0 * (y0 - y1) + h * (v0 + v1))
    return y0 + x * (h * v0 + x * bend)


@compiled
def angle_if(there: Lanes, series: Series, at: Lanes, since_s: Lanes) -> Lanes:
    """Return the angle of a wave process where there is one, 0 where not."""
    return where(there, process_angle(series, where(there, at, 0), since_s), 0.0)


@compiled
def process_rate(series: Series, first: int, step: int, since_s: float) -> float:
    """Return the rate of a wave process, since_s into a grid step."""
    at = first + 2 * step
    y0, v0, y1, v1 = series[at], series[at + 1], series[at + 2], series[at + 3]
    h = GRID_S
    x = since_s / h
    bend = 6.0 * (y1 - y0) / h - 2.0 * (2.0 * v0 + v1) + x * (6.0 * (y0 - y1) / h + 3.0 * (v0 + v1))
    return float(v0 + x * bend)


@compiled
def glider_heading(hull: Hull, ship: Ship, series: Series, step: Lanes, offset_s: Lanes) -> Lanes:
    """Return where the body with the rudder points, unwrapped."""
    acceleration = yaw_acceleration(
        hull[YAW_RATE],
        hull[RUDDER],
        hull[NOW_K],
        hull[NOW_T],
        hull[NOW_ALPHA],
        ship.bias_rad + series[ship.offset_at + step],
    )
    return hull[PSI] + offset_s * (hull[YAW_RATE] + 0.5 * offset_s * acceleration)


@compiled
def float_heading(hull: Hull, ship: Ship, series: Series, step: Lanes, offset_s: Lanes) -> Lanes:
    """Return where the body with the compass points without the yaw of the waves, unwrapped."""
    glider_rad = glider_heading(hull, ship, series, step, offset_s)
    if not any_of(ship.has_float):
        return glider_rad
    acceleration = ship.float_w2 * (hull[PSI] - hull[FLOAT_PSI]) - ship.float_damp * hull[FLOAT_RATE]
    float_rad = hull[FLOAT_PSI] + offset_s * (hull[FLOAT_RATE] + 0.5 * offset_s * acceleration)
    return where(ship.has_float, float_rad, glider_rad)


@compiled
def heading(hull: Hull, ship: Ship, series: Series, step: Lanes, offset_s: Lanes) -> Lanes:
    """Return the heading that a perfect compass shows, unwrapped."""
    yaw_rad = angle_if(ship.has_yaw, series, ship.yaw_at + 2 * step, offset_s)
    return float_heading(hull, ship, series, step, offset_s) + waves_share(ship, series, step) * yaw_rad


@compiled
def sensed_heading(ship: Ship, series: Series, step: Lanes, heading_rad: Lanes, offset_s: Lanes) -> Lanes:
    """Return what a compass as bought makes of a heading, its lag apart."""
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    deviation_rad = (
        ship.c_a
        + ship.c_b * sine
        + ship.c_c * cosine
        + ship.c_d * 2.0 * sine * cosine
        + ship.c_e * (cosine * cosine - sine * sine)
    )
    roll_rad = angle_if(ship.has_roll, series, ship.roll_at + 2 * step, offset_s)
    return heading_rad - deviation_rad - waves_share(ship, series, step) * roll_rad * cosine


@compiled
def shown_heading(hull: Hull, ship: Ship, series: Series, step: Lanes, offset_s: Lanes) -> Lanes:
    """Return the heading that the sea's compass shows, unwrapped."""
    heading_rad = heading(hull, ship, series, step, offset_s)
    if not any_of(ship.has_compass):
        return heading_rad
    sensed_rad, last_rad = sensed_heading(ship, series, step, heading_rad, offset_s), hull[SHOWN]
    follows = where(ship.c_lag_s > 0.0, fails(math.isnan(last_rad)), False)
    followed_rad = last_rad - math.expm1(-offset_s / ship.c_lag_s) * (sensed_rad - last_rad)
    return where(ship.has_compass, where(follows, followed_rad, sensed_rad), heading_rad)


@compiled
def velocity(hull: Floats, ship: Ship, series: Series, step: int, offset_s: float) -> tuple[float, float]:
    """Return the velocity over the ground with that of the waves, north and east."""
    heading_rad, t_s = glider_heading(hull, ship, series, step, offset_s), step * GRID_S + offset_s
    north_m_s, east_m_s = ship.current_north_m_s, ship.current_east_m_s
    if ship.tide_s > 0.0:
        phase_rad = TWO_PI * np.fmod(t_s, ship.tide_s) / ship.tide_s
        along, across = math.cos(phase_rad), ship.rotary * math.sin(phase_rad)
        north_m_s, east_m_s = along * north_m_s - across * east_m_s, along * east_m_s + across * north_m_s
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    speed_m_s, sideways_m_s = hull[NOW_SPEED], hull[SIDEWAYS]
    north_m_s = speed_m_s * cosine - sideways_m_s * sine + north_m_s
    east_m_s = speed_m_s * sine + sideways_m_s * cosine + east_m_s
    ahead, aside = math.cos(ship.toward_rad), math.sin(ship.toward_rad)
    more_north = more_east = 0.0
    if ship.has_crests:
        with_yaw_at = ship.alone_at if ship.crests_own else ship.yaw_at
        with_yaw = ship.crests_per_yaw * process_rate(series, with_yaw_at, step, offset_s)
        rest = process_rate(series, ship.beside_at, step, offset_s)
        twice_rad = 2.0 * (ship.toward_rad - float_heading(hull, ship, series, step, offset_s))
        sine, cosine = math.sin(twice_rad), math.cos(twice_rad)
        along_m = ship.crests_along_m * (sine * with_yaw + cosine * rest)
        across_m = ship.crests_across_m * (cosine * with_yaw - sine * rest)
        more_north, more_east = along_m * ahead - across_m * aside, along_m * aside + across_m * ahead
    elif ship.has_orbit:
        along_m_s = process_rate(series, ship.orbit_at, step, offset_s)
        more_north, more_east = along_m_s * ahead, along_m_s * aside
    share = waves_share(ship, series, step)
    return north_m_s + share * more_north, east_m_s + share * more_east


@compiled
def begin_hull(hull: Hull, ship: Ship) -> None:
    """Lie at the start, under way at the mean speed."""
    hull[SHOWN] = math.nan
    be_at(hull, ship, ship.speed_m_s)


@compiled
def drift_on(hulls: Floats, on: Lanes, ship: Ship, series: Series, before_rad: Lanes, step: Lanes) -> None:
    """Let what ships have beside their hulls take a step: way sideways, float, speed, compass."""
    hull = rows(hulls, on)
    r, middle_rad = hull[YAW_RATE], 0.5 * (before_rad + hull[PSI])
    if any_of(ship.has_sideways):
        go_sideways(rows(hulls, on & (ship.has_sideways > 0.0)), ship, middle_rad, r)
    if any_of(ship.has_float):
        behind_rad, rate_rad_s = hull[FLOAT_PSI] - middle_rad, hull[FLOAT_RATE]
        body = rows(hulls, on & (ship.has_float > 0.0))
        body[FLOAT_PSI] = middle_rad + ship.f00 * behind_rad + ship.f01 * rate_rad_s
        body[FLOAT_RATE] = ship.f10 * behind_rad + ship.f11 * rate_rad_s
    if any_of(ship.has_speed):
        take_speed(rows(hulls, on & (ship.has_speed > 0.0)), ship, series, step + 1.0)
    if any_of(ship.has_compass):
        sensed_rad = sensed_heading(ship, series, step + 1.0, heading(hull, ship, series, step + 1.0, 0.0), 0.0)
        last_rad, compass = hull[SHOWN], rows(hulls, on & (ship.has_compass > 0.0))
        last_rad = where(math.isnan(last_rad), sensed_rad, last_rad)
        compass[SHOWN] = last_rad + ship.c_follow * (sensed_rad - last_rad)


@compiled
def go_sideways(hull: Hull, ship: Ship, middle_rad: Lanes, r: Lanes) -> None:
    """Let wind, body and turning take a ship sideways."""
    speed_m_s = hull[NOW_SPEED]
    angle_rad = ship.body_rad + ship.wind_rad * math.sin(middle_rad - ship.wind_from_rad)
    slides = ship.slide_share != 0.0
    if any_of(slides):
        last_m_s = -ship.slide_drive / ship.slide_damping_1_m * r
        keep = math.exp(ship.slide_damping_1_m * speed_m_s * GRID_S)
        hull[SLIDE] = where(slides, last_m_s + keep * (hull[SLIDE] - last_m_s), hull[SLIDE])
    hull[SIDEWAYS] = speed_m_s * math.tan(angle_rad) + ship.slide_share * hull[SLIDE]
