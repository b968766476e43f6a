"""Twin of `correct_velocity` of firmware_py/estimate/wave_filter.py, and of over_ground.py."""

from __future__ import annotations

import math

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.tune.twins import wrap_pi
from hil.lab.twin import learning
from hil.lab.twin.devices import COURSE_RAD, SPEED_M_S, THERE_S
from hil.lab.twin.kalman import (
    COLUMNS,
    COURSE_LAG,
    HEADING,
    LEEWAY,
    NORTH,
    ORBIT_NORTH,
    RATE,
    SPEED,
    STATES,
    WAVE,
    WAVE_RATE,
    Floats,
)  # fmt: skip
from hil.lab.twin.learning import LOG_OMEGA, LOG_POWER, LOG_SHARE, LOG_VELOCITY, SHARES
from hil.lab.twin.wave_filter import (
    FIX_T,
    LATEST_S,
    LEG,
    LONGEST_SILENCE_S,
    STARTED,
    T,
    WaveFilter,
    finish,
    predict_to,
    take,
)  # fmt: skip

FASTEST_M_S = 10.0
FIX_LIMIT = 9.0
LEG_RAD = radians(12.0)
LATE_S = 0.5


@compiled
def correct_along(f: WaveFilter, axis: int, shown_m_s: float, leg_rad: float) -> tuple[float, float]:
    """Take the velocity north (axis 0) or east (1) in; return its normalised innovation and what the way leaves."""
    x, p, n, shown = f.x, f.p, f.n, f.shown
    north = axis == 0
    by_speed = math.cos(leg_rad) if north else math.sin(leg_rad)
    current, orbit = NORTH + axis, ORBIT_NORTH + 2 * axis
    speed, rate_rad_s, lag_s = x[SPEED], x[RATE], x[COURSE_LAG]
    towards_rad = x[HEADING] + x[LEEWAY] - lag_s * rate_rad_s
    cosine, sine = math.cos(towards_rad), math.sin(towards_rad)
    by_way = -speed * sine if north else speed * cosine
    way_m_s = speed * (cosine if north else sine) + x[current]
    omega_rad_s, share = math.exp(n[LOG_OMEGA]), math.exp(n[LOG_SHARE])
    by_swing, by_orbit_rate = math.sqrt(share), math.sqrt(1.0 - share) / omega_rad_s
    by_yaw, late = n[SHARES + 2 * axis], n[SHARES + 2 * axis + 1] / omega_rad_s
    noise = math.exp(n[LOG_VELOCITY]) + LATE_S * math.exp(n[LOG_POWER]) * late * late
    by_rate, by_lag = -lag_s * by_way, -rate_rad_s * by_way
    moving = by_swing * x[orbit] + by_orbit_rate * x[orbit + 1] + by_yaw * x[WAVE] + late * x[WAVE_RATE]
    innovation = shown_m_s - (way_m_s + moving)
    for i in range(COLUMNS):
        part = by_way * p[HEADING, i] + by_way * p[LEEWAY, i] + by_speed * p[SPEED, i] + p[current, i]
        part = part + by_rate * p[RATE, i] + by_lag * p[COURSE_LAG, i] + by_swing * p[orbit, i]
        shown[i] = part + by_orbit_rate * p[orbit + 1, i] + by_yaw * p[WAVE, i] + late * p[WAVE_RATE, i]
    variance = by_way * shown[HEADING] + by_way * shown[LEEWAY] + by_speed * shown[SPEED] + shown[current]
    variance = variance + by_rate * shown[RATE] + by_lag * shown[COURSE_LAG] + by_swing * shown[orbit]
    variance = variance + by_orbit_rate * shown[orbit + 1] + by_yaw * shown[WAVE] + late * shown[WAVE_RATE] + noise
    learning.learn_frequencies(n, innovation, variance, shown[STATES], shown[STATES + 1], 0.0)
    take(f, innovation, variance * max(1.0, innovation * innovation / variance / FIX_LIMIT))
    return innovation / math.sqrt(variance), shown_m_s - way_m_s


@compiled
def correct_velocity(f: WaveFilter, model: tuple[float, float, float, float], fix: Floats) -> None:
    """Take one momentary velocity over the ground in, as devices.tell_fix fills it."""
    x, n, w = f.x, f.n, f.w
    t_s, speed_m_s, course_rad = fix[THERE_S], fix[SPEED_M_S], fix[COURSE_RAD]
    if w[STARTED] == 0.0 or not 0.0 <= speed_m_s <= FASTEST_M_S:
        return
    if not -LATEST_S <= t_s - w[T] <= LONGEST_SILENCE_S:
        return
    predict_to(f, model, t_s)
    way_rad = x[HEADING] + x[LEEWAY]
    leg_rad = way_rad if math.isnan(w[LEG]) or abs(wrap_pi(way_rad - w[LEG])) > LEG_RAD else w[LEG]
    angle, rate = x[WAVE], x[WAVE_RATE] / math.exp(n[LOG_OMEGA])
    north_z = north_moved = east_z = east_moved = 0.0
    for axis in range(2):
        along = math.cos(course_rad) if axis == 0 else math.sin(course_rad)
        z, moved = correct_along(f, axis, speed_m_s * along, leg_rad)
        if axis == 0:
            north_z, north_moved = z, moved
        else:
            east_z, east_moved = z, moved
    step_s = t_s - w[FIX_T] if not math.isnan(w[FIX_T]) else LONGEST_SILENCE_S
    if step_s > 0.0:
        learning.learn_from_velocity(n, north_z, east_z, step_s)
        learning.learn_coupling(n, angle, rate, north_moved, east_moved, step_s)
    if finish(f):
        w[FIX_T], w[LEG] = t_s, leg_rad
