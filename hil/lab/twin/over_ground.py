"""Twin of `correct_velocity` of firmware_py/estimate/wave_filter.py, and of over_ground.py."""

from __future__ import annotations

import math

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.lanes import COUNT
from hil.lab.tune.twins import wrap_pi
from hil.lab.twin import kalman, learning
from hil.lab.twin.devices import COURSE_RAD, SPEED_M_S, THERE_S
from hil.lab.twin.kalman import (
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
    Covariances,
    Floats,
)  # fmt: skip
from hil.lab.twin.learning import LOG_OMEGA, LOG_POWER, LOG_SHARE, LOG_VELOCITY, SHARES
from hil.lab.twin.wave_filter import LATEST_S, LONGEST_SILENCE_S, finish, predict_to, take
from hil.lab.twin.wave_filter_state import FIX_T, LEG, OMEGA, STARTED, Boats, Filters, T, WaveFilter, exp_of

FASTEST_M_S = 10.0
FIX_LIMIT = 9.0
LEG_RAD = radians(12.0)
LATE_S = 0.5

# What is noted of a velocity while it is taken in, of each lane: the leg, the swing before it, and by axis the
# innovation as it was expected to be, and what the way leaves.
LEG_NOW, ANGLE, ANGLE_RATE, NORMALISED, MOVED = 0, 1, 2, 3, 5
NOTED = 7


@compiled
def correct_velocities(filters: Filters, c: Covariances, boats: Boats, fixes: Floats) -> None:
    """Take a momentary velocity over the ground in, as devices.tell_fix fills it, in each lane that is on."""
    for k in range(COUNT):
        w, t_s = filters[k].w, fixes[k, THERE_S]
        known = w[STARTED] > 0.0 and 0.0 <= fixes[k, SPEED_M_S] <= FASTEST_M_S
        if not (known and -LATEST_S <= t_s - w[T] <= LONGEST_SILENCE_S):
            c.on[k] = 0.0
        if c.on[k] > 0.0:
            c.to_s[k] = t_s
    predict_to(filters, c, boats)
    for k in range(COUNT):
        if c.on[k] > 0.0:
            note_way(filters[k], c.noted[k])
    for axis in range(2):
        for k in range(COUNT):
            if c.on[k] > 0.0:
                set_parts(filters[k], c, axis, c.noted[k])
        kalman.show_velocity(c, axis)
        for k in range(COUNT):
            if c.on[k] > 0.0:
                expect_velocity(filters[k], c, axis, fixes[k], c.noted[k])
        take(filters, c)
    kalman.add_up(c)
    for k in range(COUNT):
        if c.on[k] > 0.0:
            finish_velocity(filters[k], c, c.noted[k])


@compiled
def note_way(f: WaveFilter, noted: Floats) -> None:
    """Note the leg, and how the waves stand, before a velocity is taken in."""
    x, w = f.x, f.w
    way_rad = x[HEADING] + x[LEEWAY]
    noted[LEG_NOW] = way_rad if math.isnan(w[LEG]) or abs(wrap_pi(way_rad - w[LEG])) > LEG_RAD else w[LEG]
    noted[ANGLE], noted[ANGLE_RATE] = x[WAVE], x[WAVE_RATE] / exp_of(f, OMEGA, f.n[LOG_OMEGA])


@compiled
def set_parts(f: WaveFilter, c: Covariances, axis: int, noted: Floats) -> None:
    """Fill how the velocity along an axis depends on the states, what is expected of it and with what noise."""
    x, n, lane = f.x, f.n, f.lane
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
    for number, part in enumerate(
        (by_way, by_way, by_speed, 1.0, by_rate, by_lag, by_swing, by_orbit_rate, by_yaw, late)
    ):
        c.parts[number, lane] = part
    c.innovation[lane], c.expected[lane], noted[MOVED + axis] = way_m_s + moving, noise, way_m_s


@compiled
def expect_velocity(f: WaveFilter, c: Covariances, axis: int, fix: Floats, noted: Floats) -> None:
    """Fill innovation and variance of the velocity along an axis, and learn from it."""
    shown, parts, n, lane = c.shown, c.parts, f.n, f.lane
    variance = parts[0, lane] * shown[HEADING, lane]
    for number, place in enumerate(kalman.velocity_places(axis)):
        variance = variance + parts[number + 1, lane] * shown[place, lane]
    variance = variance + c.expected[lane]
    shown_m_s = fix[SPEED_M_S] * (math.cos(fix[COURSE_RAD]) if axis == 0 else math.sin(fix[COURSE_RAD]))
    innovation = shown_m_s - c.innovation[lane]
    learning.learn_frequencies(n, innovation, variance, shown[STATES, lane], shown[STATES + 1, lane], 0.0)
    c.innovation[lane] = innovation
    c.variance[lane] = variance * max(1.0, innovation * innovation / variance / FIX_LIMIT)
    noted[NORMALISED + axis] = innovation / math.sqrt(variance)
    noted[MOVED + axis] = shown_m_s - noted[MOVED + axis]


@compiled
def finish_velocity(f: WaveFilter, c: Covariances, noted: Floats) -> None:
    """Learn from a velocity that has been taken in, and note it."""
    n, w, t_s = f.n, f.w, c.to_s[f.lane]
    step_s = t_s - w[FIX_T] if not math.isnan(w[FIX_T]) else LONGEST_SILENCE_S
    if step_s > 0.0:
        learning.learn_from_velocity(n, noted[NORMALISED], noted[NORMALISED + 1], step_s)
        learning.learn_coupling(n, noted[ANGLE], noted[ANGLE_RATE], noted[MOVED], noted[MOVED + 1], step_s)
    if finish(f, c):
        w[FIX_T], w[LEG] = t_s, noted[LEG_NOW]
