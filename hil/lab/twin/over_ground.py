"""The wave filter's update by a velocity over the ground (firmware_py/estimate/over_ground.py) for compiled code."""

from __future__ import annotations

import math

from firmware_py.common.angles import clamp, radians, wrap_pi
from hil.lab.compiled import compiled
from hil.lab.twin import learning
from hil.lab.twin.devices import COURSE_RAD, SPEED_M_S, THERE_S
from hil.lab.twin.kalman import (
    COLUMNS,
    COURSE_LAG,
    EAST,
    HEADING,
    LEEWAY,
    NORTH,
    ORBIT_NORTH,
    RATE,
    SPEED,
    STATES,
    WAVE,
    WAVE_RATE,
    Covariance,
    Floats,
    add_covariance,
)  # fmt: skip
from hil.lab.twin.learning import LOG_OMEGA, LOG_POWER, LOG_SHARE, LOG_VELOCITY, SHARES
from hil.lab.twin.wave_filter import LATEST_S, LONGEST_SILENCE_S, correct, finish, predict_to
from hil.lab.twin.wave_filter_state import FIX_T, LEG, LEG_T, STARTED, Filter, T

FASTEST_M_S = 10.0
FIX_LIMIT = 9.0
LEG_RAD = radians(12.0)
CHANGE_M_S2, LONGEST_CHANGE_S, ACROSS, LONGEST_SEEN_S, SLOWEST_M_S = 3e-5, 3600.0, 0.03, 60.0, 0.2
GROWTH_M2_S4 = 2.0 * CHANGE_M_S2 * CHANGE_M_S2
LATE_S = 0.5

# What is noted while a velocity is taken in: the leg, the waves' yaw before it, and by axis the normalised innovation
# and what the way leaves of the velocity.
LEG_NOW, ANGLE, ANGLE_RATE, NORMALISED, MOVED = 0, 1, 2, 3, 5


@compiled
def correct_velocity(f: Filter, c: Covariance, model: Floats, fix: Floats) -> None:
    """Update by a momentary velocity over the ground, as devices.tell_fix fills it."""
    t_s, speed_m_s, late_s = fix[THERE_S], fix[SPEED_M_S], f.w[T] - fix[THERE_S]
    if not (f.w[STARTED] > 0.0 and 0.0 <= speed_m_s <= FASTEST_M_S):
        return
    if not -LONGEST_SILENCE_S <= late_s <= LATEST_S:
        return
    predict_to(f, c, model, t_s)
    note_way(f, c, t_s)
    open_shares(f, c, t_s)
    for axis in range(2):
        shown_m_s = speed_m_s * (math.sin(fix[COURSE_RAD]) if axis else math.cos(fix[COURSE_RAD]))
        set_parts(f, c, axis)
        show_velocity(c, axis)
        expect_velocity(f, c, axis, shown_m_s)
        correct(f, c)
    finish_velocity(f, c, t_s)


@compiled
def velocity_places(axis: int) -> tuple[int, int, int, int, int, int, int, int, int, int]:
    """Return the states that a velocity north (axis 0) or east (1) depends on, in the order of `parts`."""
    orbit = ORBIT_NORTH + 2 * axis
    return HEADING, LEEWAY, SPEED, NORTH + axis, RATE, COURSE_LAG, orbit, orbit + 1, WAVE, WAVE_RATE


@compiled
def show_velocity(c: Covariance, axis: int) -> None:
    """Fill the cross covariance of a velocity north (axis 0) or east (1)."""
    p, shown = c.p, c.shown
    for k in range(COLUMNS):
        shown[k] = c.parts[0] * p[HEADING, k]
    for number, state in enumerate(velocity_places(axis)):
        if number:
            part = c.parts[number]
            for k in range(COLUMNS):
                shown[k] += part * p[state, k]


@compiled
def note_way(f: Filter, c: Covariance, t_s: float) -> None:
    """Note the leg, and how the waves stand, before a velocity is taken in."""
    x, w, noted = f.x, f.w, c.noted
    way_rad = x[HEADING] + x[LEEWAY]
    noted[LEG_NOW] = w[LEG]
    if math.isnan(w[LEG]) or abs(wrap_pi(way_rad - w[LEG])) > LEG_RAD:
        noted[LEG_NOW], w[LEG_T] = way_rad, t_s
    noted[ANGLE], noted[ANGLE_RATE] = x[WAVE], x[WAVE_RATE] / math.exp(f.n[LOG_OMEGA])


@compiled
def open_shares(f: Filter, c: Covariance, t_s: float) -> None:
    """Leave open how a change of the water is shared out, of the time since the last fix."""
    x, w, p, leg_rad = f.x, f.w, c.p, c.noted[LEG_NOW]
    if math.isnan(w[FIX_T]):
        return
    along = GROWTH_M2_S4 * clamp(t_s - w[LEG_T], 0.0, LONGEST_CHANGE_S) * clamp(t_s - w[FIX_T], 0.0, LONGEST_SEEN_S)
    across, speed_m_s = ACROSS * along, max(x[SPEED], SLOWEST_M_S)
    cosine, sine = math.cos(leg_rad), math.sin(leg_rad)
    add_covariance(p, NORTH, NORTH, along * cosine * cosine + across * sine * sine)
    add_covariance(p, EAST, EAST, along * sine * sine + across * cosine * cosine)
    add_covariance(p, SPEED, SPEED, along)
    add_covariance(p, LEEWAY, LEEWAY, across / (speed_m_s * speed_m_s))
    add_covariance(p, EAST, NORTH, (along - across) * sine * cosine)
    add_covariance(p, SPEED, NORTH, -along * cosine)
    add_covariance(p, SPEED, EAST, -along * sine)
    add_covariance(p, LEEWAY, NORTH, across * sine / speed_m_s)
    add_covariance(p, LEEWAY, EAST, -across * cosine / speed_m_s)


@compiled
def set_parts(f: Filter, c: Covariance, axis: int) -> None:
    """Fill how the velocity along an axis depends on the states, what is expected of it and with what noise."""
    x, n, noted, parts = f.x, f.n, c.noted, c.parts
    north, leg_rad = axis == 0, noted[LEG_NOW]
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
    parts[0], parts[1], parts[2], parts[3] = by_way, by_way, by_speed, 1.0
    parts[4], parts[5], parts[6], parts[7] = by_rate, by_lag, by_swing, by_orbit_rate
    parts[8], parts[9] = by_yaw, late
    c.innovation, c.expected = way_m_s + moving, noise  # less the measurement, and without what the states add
    noted[MOVED + axis] = way_m_s


@compiled
def expect_velocity(f: Filter, c: Covariance, axis: int, shown_m_s: float) -> None:
    """Fill innovation and variance of a velocity along an axis, and learn from them."""
    noted, shown = c.noted, c.shown
    variance = 0.0
    for number, state in enumerate(velocity_places(axis)):
        variance += c.parts[number] * shown[state]
    variance += c.expected
    innovation = shown_m_s - c.innovation
    learning.learn_frequencies(f.n, innovation, variance, shown[STATES], shown[STATES + 1], 0.0)
    c.innovation = innovation
    c.variance = variance * max(1.0, innovation * innovation / variance / FIX_LIMIT)
    noted[NORMALISED + axis] = innovation / math.sqrt(variance)
    noted[MOVED + axis] = shown_m_s - noted[MOVED + axis]


@compiled
def finish_velocity(f: Filter, c: Covariance, t_s: float) -> None:
    """Learn from a velocity that has been taken in, and note it."""
    w, n, noted = f.w, f.n, c.noted
    step_s = LONGEST_SILENCE_S if math.isnan(w[FIX_T]) else t_s - w[FIX_T]
    if step_s > 0.0:
        learning.learn_from_velocity(n, noted[NORMALISED], noted[NORMALISED + 1], step_s)
        learning.learn_coupling(n, noted[ANGLE], noted[ANGLE_RATE], noted[MOVED], noted[MOVED + 1], step_s)
    if finish(f, c):
        w[FIX_T], w[LEG] = t_s, noted[LEG_NOW]
