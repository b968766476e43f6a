"""Twin of `correct_velocity` of firmware_py/estimate/wave_filter.py, and of over_ground.py."""

from __future__ import annotations

import math

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.lane_math import fails, most, within, wrap_pi
from hil.lab.lane_rows import lanes_of, put_lanes, rows
from hil.lab.lanes import any_of, where
from hil.lab.twin import kalman, learning
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
    Covariances,
    Lanes,
    Rows,
)  # fmt: skip
from hil.lab.twin.learning import LOG_OMEGA, LOG_POWER, LOG_SHARE, LOG_VELOCITY, SHARES
from hil.lab.twin.wave_filter import LATEST_S, LONGEST_SILENCE_S, finish, predict_to, take
from hil.lab.twin.wave_filter_state import FIX_T, LEG, LEG_T, OMEGA, STARTED, Boats, Filters, T, exp_of

FASTEST_M_S = 10.0
FIX_LIMIT = 9.0
LEG_RAD = radians(12.0)
CHANGE_M_S2, LONGEST_CHANGE_S, ACROSS, LONGEST_SEEN_S, SLOWEST_M_S = 3e-5, 3600.0, 0.03, 60.0, 0.2
GROWTH_M2_S4 = 2.0 * CHANGE_M_S2 * CHANGE_M_S2
LATE_S = 0.5

# Rows of what is noted of velocities while they are taken in: the leg, the swing before it, and by axis the innovation
# as it was expected to be, and what the way leaves.
LEG_NOW, ANGLE, ANGLE_RATE, NORMALISED, MOVED = 0, 1, 2, 3, 5


@compiled
def correct_velocities(f: Filters, c: Covariances, boats: Boats, on: Lanes) -> None:
    """Take momentary velocities over the ground in, each a `fix` as devices.tell_fix fills it."""
    w, fix = rows(f.w, on), rows(c.fix, on)
    t_s, speed_m_s = fix[THERE_S], fix[SPEED_M_S]
    known = (w[STARTED] > 0.0) & (speed_m_s >= 0.0) & (speed_m_s <= FASTEST_M_S)
    on = on & known & (t_s - w[T] >= -LATEST_S) & (t_s - w[T] <= LONGEST_SILENCE_S)
    if not any_of(on):
        return
    rows(c.to_s, on)[0] = t_s
    predict_to(f, c, boats, on)
    note_way(f, c, on)
    open_shares(f, c, on)
    for axis in range(2):
        set_parts(f, c, on, axis)
        show_velocity(c, axis)
        expect_velocity(f, c, on, axis)
        take(f, c, on)
    kalman.add_up(c)
    finish_velocity(f, c, on)


@compiled
def velocity_places(axis: int) -> tuple[int, int, int, int, int, int, int, int, int]:
    """Return which states a velocity north (axis 0) or east (1) shows beside the heading, in the order of `parts`."""
    orbit = ORBIT_NORTH + 2 * axis
    return LEEWAY, SPEED, NORTH + axis, RATE, COURSE_LAG, orbit, orbit + 1, WAVE, WAVE_RATE


@compiled
def show_velocity(c: Covariances, axis: int) -> None:
    """Fill how a velocity north (axis 0) or east (1) shows the states, by its `parts`."""
    p, parts = c.p, c.parts
    for k in range(COLUMNS):
        part = lanes_of(parts, 0) * lanes_of(p, kalman.place(HEADING, k))
        for number, state in enumerate(velocity_places(axis)):
            part = part + lanes_of(parts, number + 1) * lanes_of(p, kalman.place(state, k))
        put_lanes(c.shown, k, part)


@compiled
def note_way(f: Filters, c: Covariances, on: Lanes) -> None:
    """Note the leg, and how the waves stand, before a velocity is taken in."""
    x, leg_rad, noted = rows(f.x, on), rows(f.w, on)[LEG], rows(c.noted, on)
    way_rad = x[HEADING] + x[LEEWAY]
    other = math.isnan(leg_rad) | (abs(wrap_pi(way_rad - leg_rad)) > LEG_RAD)
    noted[LEG_NOW] = where(other, way_rad, leg_rad)
    t_s, w = lanes_of(c.to_s, 0), rows(f.w, on)
    w[LEG_T] = where(other, t_s, w[LEG_T])
    noted[ANGLE], noted[ANGLE_RATE] = x[WAVE], x[WAVE_RATE] / exp_of(f, OMEGA, rows(f.n, on)[LOG_OMEGA])


@compiled
def open_shares(f: Filters, c: Covariances, on: Lanes) -> None:
    """Leave open how a change of the water is shared out, of the time since the last fix."""
    x, w, t_s = rows(f.x, on), rows(f.w, on), lanes_of(c.to_s, 0)
    leg_rad, on = rows(c.noted, on)[LEG_NOW], on & fails(math.isnan(w[FIX_T]))
    along = GROWTH_M2_S4 * within(t_s - w[LEG_T], 0.0, LONGEST_CHANGE_S) * within(t_s - w[FIX_T], 0.0, LONGEST_SEEN_S)
    across, speed_m_s = ACROSS * along, most(x[SPEED], SLOWEST_M_S)
    cosine, sine, p = math.cos(leg_rad), math.sin(leg_rad), rows(c.p, on)
    gain(p, NORTH, NORTH, along * cosine * cosine + across * sine * sine)
    gain(p, EAST, EAST, along * sine * sine + across * cosine * cosine)
    gain(p, SPEED, SPEED, along)
    gain(p, LEEWAY, LEEWAY, across / (speed_m_s * speed_m_s))
    gain(p, EAST, NORTH, (along - across) * sine * cosine)
    gain(p, SPEED, NORTH, -along * cosine)
    gain(p, SPEED, EAST, -along * sine)
    gain(p, LEEWAY, NORTH, across * sine / speed_m_s)
    gain(p, LEEWAY, EAST, -across * cosine / speed_m_s)


@compiled
def gain(p: Rows, row: int, column: int, more: Lanes) -> None:
    """Add to the covariance of two states."""
    place = kalman.place(row, column)
    p[place] = p[place] + more


@compiled
def set_parts(f: Filters, c: Covariances, on: Lanes, axis: int) -> None:
    """Fill how the velocity along an axis depends on the states, what is expected of it and with what noise."""
    x, n, noted, parts = rows(f.x, on), rows(f.n, on), rows(c.noted, on), rows(c.parts, on)
    north, leg_rad = axis == 0, noted[LEG_NOW]
    by_speed = math.cos(leg_rad) if north else math.sin(leg_rad)
    current, orbit = NORTH + axis, ORBIT_NORTH + 2 * axis
    speed, rate_rad_s, lag_s = x[SPEED], x[RATE], x[COURSE_LAG]
    towards_rad = x[HEADING] + x[LEEWAY] - lag_s * rate_rad_s
    cosine, sine = math.cos(towards_rad), math.sin(towards_rad)
    by_way = -speed * sine if north else speed * cosine
    way_m_s = speed * (cosine if north else sine) + x[current]
    omega_rad_s, share = exp_of(f, OMEGA, n[LOG_OMEGA]), math.exp(n[LOG_SHARE])
    by_swing, by_orbit_rate = math.sqrt(share), math.sqrt(1.0 - share) / omega_rad_s
    by_yaw, late = n[SHARES + 2 * axis], n[SHARES + 2 * axis + 1] / omega_rad_s
    noise = math.exp(n[LOG_VELOCITY]) + LATE_S * math.exp(n[LOG_POWER]) * late * late
    by_rate, by_lag = -lag_s * by_way, -rate_rad_s * by_way
    moving = by_swing * x[orbit] + by_orbit_rate * x[orbit + 1] + by_yaw * x[WAVE] + late * x[WAVE_RATE]
    parts[0], parts[1], parts[2], parts[3] = by_way, by_way, by_speed, 1.0
    parts[4], parts[5], parts[6], parts[7] = by_rate, by_lag, by_swing, by_orbit_rate
    parts[8], parts[9] = by_yaw, late
    put_lanes(c.innovation, 0, way_m_s + moving)
    put_lanes(c.expected, 0, noise)
    noted[MOVED + axis] = way_m_s


@compiled
def expect_velocity(f: Filters, c: Covariances, on: Lanes, axis: int) -> None:
    """Fill innovations and variances of velocities along an axis, and learn from them."""
    parts, noted, fix = c.parts, rows(c.noted, on), rows(c.fix, on)
    variance = lanes_of(parts, 0) * lanes_of(c.shown, HEADING)
    for number, place in enumerate(velocity_places(axis)):
        variance = variance + lanes_of(parts, number + 1) * lanes_of(c.shown, place)
    variance = variance + lanes_of(c.expected, 0)
    shown_m_s = fix[SPEED_M_S] * (math.cos(fix[COURSE_RAD]) if axis == 0 else math.sin(fix[COURSE_RAD]))
    innovation = shown_m_s - lanes_of(c.innovation, 0)
    by_omega, by_follow = lanes_of(c.shown, STATES), lanes_of(c.shown, STATES + 1)
    learning.learn_frequencies(rows(f.n, on), innovation, variance, by_omega, by_follow, 0.0)
    put_lanes(c.innovation, 0, innovation)
    put_lanes(c.variance, 0, variance * most(1.0, innovation * innovation / variance / FIX_LIMIT))
    noted[NORMALISED + axis] = innovation / math.sqrt(variance)
    noted[MOVED + axis] = shown_m_s - noted[MOVED + axis]


@compiled
def finish_velocity(f: Filters, c: Covariances, on: Lanes) -> None:
    """Learn from velocities that have been taken in, and note them."""
    t_s, last_s, noted = lanes_of(c.to_s, 0), rows(f.w, on)[FIX_T], rows(c.noted, on)
    step_s = where(math.isnan(last_s), LONGEST_SILENCE_S, t_s - last_s)
    n = rows(f.n, on & (step_s > 0.0))
    learning.learn_from_velocity(n, noted[NORMALISED], noted[NORMALISED + 1], step_s)
    learning.learn_coupling(n, noted[ANGLE], noted[ANGLE_RATE], noted[MOVED], noted[MOVED + 1], step_s)
    w = rows(f.w, finish(f, c, on))
    w[FIX_T], w[LEG] = t_s, noted[LEG_NOW]
