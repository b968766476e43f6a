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
from hil.lab.lane_rows import lanes_of, put_lanes, rows
from hil.lab.lanes import COUNT, where

Floats = NDArray[np.float64]
Covariances = Any  # a record of COVARIANCES
Lanes = Any
Rows = Any  # of the states, side by side

HEADING, RATE, BIAS, FLOAT, FLOAT_RATE, NORTH, EAST, SPEED, FACTOR, LEEWAY, COURSE_LAG, BIAS_MEAN = range(12)
WAVE, WAVE_RATE, ORBIT_NORTH, ORBIT_NORTH_RATE, ORBIT_EAST, ORBIT_EAST_RATE = range(12, 18)
STATES = 18
COLUMNS = STATES + 2  # of the covariance and the slopes beside it
DAMPING, FLOAT_DAMPING, BIAS_MEMORY_S = 0.1, 0.6, 100.0
TURNING = FLOAT_RATE + 1  # so many states the turn moves; those from here to the waves stay as they are

# Of all lanes, side by side: the lower triangle of the covariance and the slopes beside it (above the diagonal is room
# to work in, as is `once`), what carries them on (`by`, and what is added), and what a measurement shows. `on` is above
# 0 for the lanes that take part. `nothing` is always 0, which the compiler does not know: so it does not write loops
# out, turn by turn, into more code than a processor keeps at hand.
COVARIANCES = np.dtype(
    [
        (name, np.float64, (*shape, COUNT))
        for name, *shape in (
            ("p", STATES, COLUMNS), ("once", TURNING, TURNING),
            ("by", 22), ("noise", STATES), ("both", 3), ("force", 8), ("parts", 10),
            ("shown", COLUMNS), ("root", COLUMNS), ("moved", STATES),
            ("innovation",), ("expected",), ("variance",), ("total",), ("least",), ("on",), ("to_s",),
            ("noted", 7), ("sample",), ("fix", 4), ("nothing",),
        )
    ]
)  # fmt: skip

# Of a turn.
TURNED, TURN_RATE, REACH, SHARE, BY_RATE, BY_BIAS, BY_SPEED, BY_FACTOR = range(8)


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
    x[HEADING], x[RATE] = turned[TURNED], turned[TURN_RATE]
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
    bias, speed, factor, by_push = turned[BY_BIAS], turned[BY_SPEED], turned[BY_FACTOR], 0.5 * turned[SHARE]
    by[0], by[1], by[2], by[3] = turned[REACH], share * bias, share * speed, share * factor
    by[4], by[5], by[6], by[7] = turned[BY_RATE], bias, speed, factor
    by[8], by[9], by[10], by[11] = half, by_push * bias, by_push * speed, by_push * factor
    by[12], by[13], by[14], by[15] = follow
    by[16], by[17], by[18], by[19] = wave
    by[20], by[21] = keep, 1.0 - keep


@compiled
def place(i: int, k: int) -> int:
    """Return where the covariance of two states stands, or a slope of the first."""
    return k * COLUMNS + i if i < k < STATES else i * COLUMNS + k


@compiled
def turn_on(
    by: Floats, h: Lanes, r: Lanes, d: Lanes, f: Lanes, g: Lanes, u: Lanes, q: Lanes, m: Lanes
) -> tuple[Lanes, Lanes, Lanes, Lanes, Lanes]:
    """Return heading, rate, bias, float and its rate carried on; speed, factor and mean of the bias are beside them."""
    heading = h + lanes_of(by, 0) * r + lanes_of(by, 1) * d + lanes_of(by, 2) * u + lanes_of(by, 3) * q
    rate = lanes_of(by, 4) * r + lanes_of(by, 5) * d + lanes_of(by, 6) * u + lanes_of(by, 7) * q
    middle = h + lanes_of(by, 8) * r + lanes_of(by, 9) * d + lanes_of(by, 10) * u + lanes_of(by, 11) * q
    behind = f - middle
    floating = lanes_of(by, 12) * behind + lanes_of(by, 13) * g + middle
    float_rate = lanes_of(by, 14) * behind + lanes_of(by, 15) * g
    return heading, rate, lanes_of(by, 20) * d + lanes_of(by, 21) * m, floating, float_rate


@compiled
def turn_column(c: Covariances, k: int) -> tuple[Lanes, Lanes, Lanes, Lanes, Lanes]:
    """Return the covariances of what the turn moves with a state, carried on in the former alone."""
    p = c.p
    return turn_on(
        c.by,
        lanes_of(p, place(HEADING, k)), lanes_of(p, place(RATE, k)), lanes_of(p, place(BIAS, k)),
        lanes_of(p, place(FLOAT, k)), lanes_of(p, place(FLOAT_RATE, k)),
        lanes_of(p, place(SPEED, k)), lanes_of(p, place(FACTOR, k)), lanes_of(p, place(BIAS_MEAN, k)),
    )  # fmt: skip


@compiled
def swing_on(p: Rows, by: Floats, above: int, below: int) -> None:
    """Carry what belongs to angle and rate of a motion of the waves on, in place."""
    angle, rate = p[above], p[below]
    p[above] = lanes_of(by, 16) * angle + lanes_of(by, 17) * rate
    p[below] = lanes_of(by, 18) * angle + lanes_of(by, 19) * rate


@compiled
def predict(c: Covariances) -> None:
    """Carry covariances and slopes on, of the lanes that are `on`; what a step leaves as it is is left as it is."""
    on, nothing = lanes_of(c.on, 0) > 0.0, int(c.nothing[0])
    turn_covariances(c, rows(c.p, on), nothing)
    swing_covariances(c, rows(c.p, on), nothing)
    carry_slopes(c, rows(c.p, on), nothing)
    add_noise(c, rows(c.p, on))


@compiled
def turn_covariances(c: Covariances, p: Rows, nothing: int) -> None:
    """Carry the covariances of what the turn moves on: with each other in both, with the other states in the former."""
    once = rows(c.once, True)
    for k in range(TURNING + nothing):
        at = TURNING + k
        once[k], once[at], once[at + TURNING], once[at + 2 * TURNING], once[at + 3 * TURNING] = turn_column(c, k)
    for k in range(TURNING, STATES + nothing):
        at = k * COLUMNS
        p[at], p[at + 1], p[at + 2], p[at + 3], p[at + 4] = turn_column(c, k)
    for k in range(TURNING + nothing):
        at = k * TURNING
        carried = turn_on(
            c.by,
            once[at], once[at + 1], once[at + 2], once[at + 3], once[at + 4],
            p[SPEED * COLUMNS + k], p[FACTOR * COLUMNS + k], p[BIAS_MEAN * COLUMNS + k],
        )  # fmt: skip
        # Above the diagonal it is a number that nobody reads.
        p[k], p[COLUMNS + k], p[2 * COLUMNS + k], p[3 * COLUMNS + k], p[4 * COLUMNS + k] = carried


@compiled
def swing_covariances(c: Covariances, p: Rows, nothing: int) -> None:
    """Carry the covariances of the waves' motions on: with each other in both, with the other states in the former."""
    for i in range(WAVE, STATES + nothing, 2):
        p[i * COLUMNS + i + 1] = p[(i + 1) * COLUMNS + i]
        for k in range(WAVE, i + 1, 2):
            swing_on(p, c.by, i * COLUMNS + k, i * COLUMNS + k + 1)
            swing_on(p, c.by, (i + 1) * COLUMNS + k, (i + 1) * COLUMNS + k + 1)
        for k in range(i + 2):
            swing_on(p, c.by, i * COLUMNS + k, (i + 1) * COLUMNS + k)


@compiled
def carry_slopes(c: Covariances, p: Rows, nothing: int) -> None:
    """Carry the slopes on."""
    for k in range(STATES, COLUMNS + nothing):
        carried = turn_on(
            c.by, p[k], p[COLUMNS + k], p[2 * COLUMNS + k], p[3 * COLUMNS + k], p[4 * COLUMNS + k],
            p[SPEED * COLUMNS + k], p[FACTOR * COLUMNS + k], p[BIAS_MEAN * COLUMNS + k],
        )  # fmt: skip
        p[k], p[COLUMNS + k], p[2 * COLUMNS + k], p[3 * COLUMNS + k], p[4 * COLUMNS + k] = carried
        for i in range(WAVE, STATES, 2):
            swing_on(p, c.by, i * COLUMNS + k, (i + 1) * COLUMNS + k)


@compiled
def add_noise(c: Covariances, p: Rows) -> None:
    """Add what the states gain in a step, and what pulls the motions and the float back."""
    for i in range(STATES):
        p[place(i, i)] = p[place(i, i)] + lanes_of(c.noise, i)
    for number in range(3):
        angle, rate = WAVE + 2 * number, WAVE + 2 * number + 1
        p[place(rate, angle)] = p[place(rate, angle)] + lanes_of(c.both, number)
        p[angle * COLUMNS + STATES] = p[angle * COLUMNS + STATES] + lanes_of(c.force, 2 * number)
        p[rate * COLUMNS + STATES] = p[rate * COLUMNS + STATES] + lanes_of(c.force, 2 * number + 1)
    for i, number in ((FLOAT, 6), (FLOAT_RATE, 7)):
        at = i * COLUMNS + STATES + 1
        p[at] = p[at] + lanes_of(c.force, number)


@compiled
def show_heading(c: Covariances) -> None:
    """Fill how a heading shows the states."""
    for k in range(COLUMNS):
        put_lanes(c.shown, k, lanes_of(c.p, place(FLOAT, k)) + lanes_of(c.p, place(WAVE, k)))


@compiled
def correct(c: Covariances) -> None:
    """Take a scalar measurement in, of the lanes that are `on`; fill by what it moves each state.

    `shown` is P H' with the slopes' beside it, and `variance` that of the innovation; the product of two numbers of
    `root` is what becomes known.
    """
    on, nothing = lanes_of(c.on, 0) > 0.0, int(c.nothing[0])
    share = 1.0 / math.sqrt(lanes_of(c.variance, 0))
    moved = share * lanes_of(c.innovation, 0)
    for k in range(COLUMNS):
        put_lanes(c.root, k, where(on, share * lanes_of(c.shown, k), 0.0))
    for i in range(STATES + nothing):
        part = lanes_of(c.root, i)
        put_lanes(c.moved, i, part * moved)
        for k in range(i + 1):
            take_off(c, i * COLUMNS + k, part * lanes_of(c.root, k))
        for k in range(STATES, COLUMNS):
            take_off(c, i * COLUMNS + k, part * lanes_of(c.root, k))


@compiled
def take_off(c: Covariances, at: int, less: Lanes) -> None:
    """Take from a number of the covariances."""
    put_lanes(c.p, at, lanes_of(c.p, at) - less)


@compiled
def add_up(c: Covariances) -> None:
    """Fill the sum of each lane's covariance, by which it is seen whether all are numbers, and its least variance."""
    total, least = 0.0 * lanes_of(c.p, 0), lanes_of(c.p, 0)
    for i in range(STATES):
        of_row = variance = lanes_of(c.p, place(i, i))
        least = where(least > variance, variance, least)
        for k in range(i):
            of_row = of_row + lanes_of(c.p, i * COLUMNS + k)
        total = total + of_row  # row by row: the sums of one do not wait for those of another
    put_lanes(c.total, 0, total)
    put_lanes(c.least, 0, least)
