"""Twin of firmware_py/estimate/kalman.py: how the states of the wave filter are carried on and corrected.

Every sum is made in the order of the original, so every number is its number.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py.model.kt import decay_over, settled_yaw_rate
from hil.lab.compiled import compiled
from hil.lab.lane_division import inverse_rest, quotient
from hil.lab.lane_math import fails
from hil.lab.lane_rows import lanes_of, put_lanes, rows
from hil.lab.lanes import COUNT, any_of, where

Floats = NDArray[np.float64]
Covariances = Any  # a record of COVARIANCES
Lanes = Any
Rows = Any  # of the states, side by side

HEADING, RATE, BIAS, FLOAT, FLOAT_RATE, NORTH, EAST, SPEED, FACTOR, LEEWAY, COURSE_LAG, BIAS_MEAN = range(12)
WAVE, WAVE_RATE, ORBIT_NORTH, ORBIT_NORTH_RATE, ORBIT_EAST, ORBIT_EAST_RATE = range(12, 18)
STATES = 18
COLUMNS = STATES + 2  # of the covariance and the slopes beside it
DAMPING, FLOAT_DAMPING, BIAS_MEMORY_S = 0.1, 0.6, 100.0
MOVING = (HEADING, RATE, BIAS, FLOAT, FLOAT_RATE, *range(WAVE, STATES))  # what a step moves; the others stay
MOVED = np.array(MOVING)
STAYING = (NORTH, EAST, SPEED, FACTOR, LEEWAY, COURSE_LAG, BIAS_MEAN)

# Of all lanes, side by side: covariance and slopes, what carries them on (`by`, and what is added), and what a
# measurement shows. `on` is above 0 for the lanes that take part. `nothing` is always 0, which the compiler does
# not know: so it does not write loops out, turn by turn, into more code than a processor keeps at hand.
COVARIANCES = np.dtype(
    [
        (name, np.float64, (*shape, COUNT))
        for name, *shape in (
            ("p", STATES, COLUMNS), ("by", 28), ("noise", STATES), ("both", 3), ("force", 8),
            ("parts", 10), ("shown", COLUMNS), ("moved", STATES),
            ("innovation",), ("expected",), ("variance",), ("total",), ("least",), ("on",), ("to_s",),
            ("noted", 7), ("sample",), ("fix", 4), ("nothing",),
        )
    ]
)  # fmt: skip

# What can be multiplied and divided without coming near the end of what numbers can be.
LEAST_ORDINARY, MOST_ORDINARY = 1e-90, 1e90
# Of a turn.
TURNED, TURNING, REACH, SHARE, BY_RATE, BY_BIAS, BY_SPEED, BY_FACTOR = range(8)


@compiled
def response(omega_rad_s: Lanes, damping: float, step_s: Lanes) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    """Return the transition matrix of angle and rate of a second-order system."""
    damped_rad_s = omega_rad_s * math.sqrt(1.0 - damping * damping)
    decay = math.exp(-damping * omega_rad_s * step_s)
    cosine, sine = decay * math.cos(damped_rad_s * step_s), decay * math.sin(damped_rad_s * step_s) / damped_rad_s
    lead = damping * omega_rad_s * sine
    return cosine + lead, sine, -omega_rad_s * omega_rad_s * sine, cosine - lead


@compiled
def wave_noise(wave: tuple[Lanes, Lanes, Lanes, Lanes], omega_rad_s: Lanes, power: Lanes) -> tuple[Lanes, Lanes, Lanes]:
    """Return the noise that keeps a wave motion stationary: angle, covariance, rate."""
    w00, w01, w10, w11 = wave
    rate_square = power / (4.0 * DAMPING * omega_rad_s)
    angle_square = rate_square / (omega_rad_s * omega_rad_s)
    return (
        angle_square - w00 * w00 * angle_square - w01 * w01 * rate_square,
        -w00 * w10 * angle_square - w01 * w11 * rate_square,
        rate_square - w10 * w10 * angle_square - w11 * w11 * rate_square,
    )


@compiled
def turn(
    x: Rows, rudder_rad: Lanes, step_s: Lanes, model: Rows, bias_variance: Lanes
) -> tuple[Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes]:
    """Return how the boats turn in a step, by their models' K, T, alpha and speed."""
    ratio = x[SPEED] / model[3]
    ability_1_s, lag_s, norrbin = model[0] * ratio, model[1] / ratio, model[2] / (ratio * ratio)
    r, factor, push_rad = x[RATE], x[FACTOR], rudder_rad - x[BIAS]
    cubic = norrbin * r * r * r
    steady = factor * ability_1_s * push_rad - cubic
    decay = decay_over(step_s, lag_s)
    gone = 1.0 - decay
    reach_s = lag_s * gone
    felt = where(bias_variance > 0.0, push_rad * push_rad / (push_rad * push_rad + 25.0 * bias_variance), 1.0)
    by_speed = (factor * ability_1_s * push_rad + 2.0 * cubic) * gone + (steady - r) * decay * step_s / lag_s
    return (
        x[HEADING] + steady * step_s + (r - steady) * reach_s,
        settled_yaw_rate(r, steady, decay),
        reach_s,
        where(gone > 1e-12, (step_s - reach_s) / gone, 0.5 * step_s),
        decay - 3.0 * norrbin * r * r * gone,
        -factor * ability_1_s * gone,
        felt * by_speed / x[SPEED],
        felt * ability_1_s * push_rad * gone,
    )


@compiled
def advance(
    x: Rows,
    turned: tuple[Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes],
    follow: tuple[Lanes, Lanes, Lanes, Lanes],
    wave: tuple[Lanes, Lanes, Lanes, Lanes],
    keep: Lanes,
) -> None:
    """Carry the states on."""
    middle = 0.5 * (x[HEADING] + turned[TURNED])
    behind, float_rate = x[FLOAT] - middle, x[FLOAT_RATE]
    x[HEADING], x[RATE] = turned[TURNED], turned[TURNING]
    x[BIAS] = x[BIAS_MEAN] + keep * (x[BIAS] - x[BIAS_MEAN])
    x[FLOAT] = middle + follow[0] * behind + follow[1] * float_rate
    x[FLOAT_RATE] = follow[2] * behind + follow[3] * float_rate
    for place in (WAVE, ORBIT_NORTH, ORBIT_EAST):
        angle, rate = x[place], x[place + 1]
        x[place] = wave[0] * angle + wave[1] * rate
        x[place + 1] = wave[2] * angle + wave[3] * rate


@compiled
def set_transition(
    c: Covariances,
    turned: tuple[Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes],
    follow: tuple[Lanes, Lanes, Lanes, Lanes],
    wave: tuple[Lanes, Lanes, Lanes, Lanes],
    keep: Lanes,
) -> None:
    """Fill what `carry` carries on by; terms that are 0 are left out, which changes no number."""
    by, half, share = rows(c.by, True), 0.5 * turned[REACH], turned[SHARE]
    bias, speed, factor = turned[BY_BIAS], turned[BY_SPEED], turned[BY_FACTOR]
    left, right, by_push = 1.0 - follow[0], -follow[2], 0.5 * share
    by[0], by[1], by[2], by[3] = turned[REACH], share * bias, share * speed, share * factor
    by[4], by[5], by[6], by[7] = turned[BY_RATE], bias, speed, factor
    by[8], by[9], by[10], by[11] = follow
    by[12], by[13], by[14], by[15] = wave
    by[16], by[17], by[18], by[19] = left, left * half, left * by_push * bias, left * by_push * speed
    by[20], by[21], by[22], by[23] = left * by_push * factor, right, right * half, right * by_push * bias
    by[24], by[25], by[26], by[27] = right * by_push * speed, right * by_push * factor, keep, 1.0 - keep


@compiled
def carry(c: Covariances, on: Lanes, first: int, apart: int) -> None:
    """Carry a column, or a row, of the covariances on in place: its first number, and how far apart they are."""
    p, by = c.p, c.by
    h, r, d = lanes_of(p, first), lanes_of(p, first + RATE * apart), lanes_of(p, first + BIAS * apart)
    f, g = lanes_of(p, first + FLOAT * apart), lanes_of(p, first + FLOAT_RATE * apart)
    u, q = lanes_of(p, first + SPEED * apart), lanes_of(p, first + FACTOR * apart)
    heading = h + lanes_of(by, 0) * r + lanes_of(by, 1) * d + lanes_of(by, 2) * u + lanes_of(by, 3) * q
    rate = lanes_of(by, 4) * r + lanes_of(by, 5) * d + lanes_of(by, 6) * u + lanes_of(by, 7) * q
    part = lanes_of(by, 16) * h + lanes_of(by, 17) * r + lanes_of(by, 18) * d
    part = part + lanes_of(by, 8) * f + lanes_of(by, 9) * g
    floating = part + lanes_of(by, 19) * u + lanes_of(by, 20) * q
    part = lanes_of(by, 21) * h + lanes_of(by, 22) * r + lanes_of(by, 23) * d
    part = part + lanes_of(by, 10) * f + lanes_of(by, 11) * g
    float_rate = part + lanes_of(by, 24) * u + lanes_of(by, 25) * q
    bias = lanes_of(by, 26) * d + lanes_of(by, 27) * lanes_of(p, first + BIAS_MEAN * apart)
    put_lanes(p, first, where(on, heading, h))
    put_lanes(p, first + RATE * apart, where(on, rate, r))
    put_lanes(p, first + BIAS * apart, where(on, bias, d))
    put_lanes(p, first + FLOAT * apart, where(on, floating, f))
    put_lanes(p, first + FLOAT_RATE * apart, where(on, float_rate, g))
    for place in (WAVE, ORBIT_NORTH, ORBIT_EAST):
        above, below = first + place * apart, first + (place + 1) * apart
        angle, rate = lanes_of(p, above), lanes_of(p, below)
        put_lanes(p, above, where(on, lanes_of(by, 12) * angle + lanes_of(by, 13) * rate, angle))
        put_lanes(p, below, where(on, lanes_of(by, 14) * angle + lanes_of(by, 15) * rate, rate))


@compiled
def predict(c: Covariances) -> None:
    """Carry covariances and slopes on, of the lanes that are `on`; what a step leaves as it is is left as it is.

    The states that stay are the same in rows as in columns, for the covariance is symmetric to the last bit.
    """
    on, nothing = lanes_of(c.on, 0) > 0.0, int(c.nothing[0])
    moving = len(MOVING) + nothing
    for k in range(COLUMNS + nothing):
        carry(c, on, k, COLUMNS)
    for number in range(moving):
        carry(c, on, MOVED[number] * COLUMNS, 1)
    for number in range(moving):
        make_even(c, on, MOVED[number], number + 1, moving)
    for i in range(STATES + nothing):
        add(c, on, i, i, lanes_of(c.noise, i))
    for number in range(3):
        place = WAVE + 2 * number
        add(c, on, place, place + 1, lanes_of(c.both, number))
        add(c, on, place + 1, place, lanes_of(c.both, number))
        add(c, on, place, STATES, lanes_of(c.force, 2 * number))
        add(c, on, place + 1, STATES, lanes_of(c.force, 2 * number + 1))
    add(c, on, FLOAT, STATES + 1, lanes_of(c.force, 6))
    add(c, on, FLOAT_RATE, STATES + 1, lanes_of(c.force, 7))


@compiled
def make_even(c: Covariances, on: Lanes, i: int, first: int, moving: int) -> None:
    """Make the covariances of a state that moves the same in its row as in its column."""
    p = c.p
    for k in STAYING:
        put_lanes(p, k * COLUMNS + i, lanes_of(p, i * COLUMNS + k))
    for number in range(first, moving):
        above, below = i * COLUMNS + MOVED[number], MOVED[number] * COLUMNS + i
        one, other = lanes_of(p, above), lanes_of(p, below)
        both = 0.5 * (one + other)
        put_lanes(p, above, where(on, both, one))
        put_lanes(p, below, where(on, both, other))


@compiled
def add(c: Covariances, on: Lanes, i: int, k: int, more: Lanes) -> None:
    """Add to a number of the covariances."""
    before = lanes_of(c.p, i * COLUMNS + k)
    put_lanes(c.p, i * COLUMNS + k, where(on, before + more, before))


@compiled
def show_heading(c: Covariances) -> None:
    """Fill how a heading shows the states."""
    for k in range(COLUMNS):
        put_lanes(c.shown, k, lanes_of(c.p, FLOAT * COLUMNS + k) + lanes_of(c.p, WAVE * COLUMNS + k))


@compiled
def correct(c: Covariances) -> None:
    """Take a scalar measurement in, of the lanes that are `on`; fill by what it moves each state.

    `shown` is P H' with the slopes' beside it, and `variance` that of the innovation.
    """
    on, variance, innovation = lanes_of(c.on, 0) > 0.0, lanes_of(c.variance, 0), lanes_of(c.innovation, 0)
    odd = fails((variance > LEAST_ORDINARY) & (variance < MOST_ORDINARY))
    for i in range(STATES):
        part = lanes_of(c.shown, i)
        size, gain = abs(part), part / variance
        odd = odd | ((size != 0.0) & fails((size > LEAST_ORDINARY) & (size < MOST_ORDINARY)))
        put_lanes(c.moved, i, gain * innovation)
        add(c, on, i, STATES, -(gain * lanes_of(c.shown, STATES)))
        add(c, on, i, STATES + 1, -(gain * lanes_of(c.shown, STATES + 1)))
    if any_of(on & odd):
        less_by_division(c, on, variance)
    else:
        less_by_inverse(c, on, variance)


@compiled
def less_by_division(c: Covariances, on: Lanes, variance: Lanes) -> None:
    """Take from the covariances what is known now."""
    for i in range(STATES):
        part = lanes_of(c.shown, i)
        for k in range(i, STATES):
            put_less(c.p, on, i, k, part * lanes_of(c.shown, k) / variance)


@compiled
def less_by_inverse(c: Covariances, on: Lanes, variance: Lanes) -> None:
    """Take from the covariances what is known now: the same quotients, sooner."""
    inverse = 1.0 / variance
    rest = inverse_rest(variance, inverse)
    for i in range(STATES):
        part = lanes_of(c.shown, i)
        for k in range(i, STATES):
            put_less(c.p, on, i, k, quotient(part * lanes_of(c.shown, k), variance, inverse, rest))


@compiled
def put_less(p: Floats, on: Lanes, i: int, k: int, less: Lanes) -> None:
    """Take from a covariance and its mirror image."""
    before = lanes_of(p, i * COLUMNS + k)
    after = where(on, before - less, before)
    put_lanes(p, i * COLUMNS + k, after)
    put_lanes(p, k * COLUMNS + i, after)


@compiled
def add_up(c: Covariances) -> None:
    """Fill the sum of each lane's covariance, by which it is seen whether all are numbers, and its least variance."""
    total, least = 0.0 * lanes_of(c.p, 0), lanes_of(c.p, 0)
    for i in range(STATES):
        of_row = variance = lanes_of(c.p, i * COLUMNS + i)
        least = where(least > variance, variance, least)
        for k in range(i + 1, STATES):
            of_row = of_row + lanes_of(c.p, i * COLUMNS + k)
        total = total + of_row  # row by row: the sums of one do not wait for those of another
    put_lanes(c.total, 0, total)
    put_lanes(c.least, 0, least)
