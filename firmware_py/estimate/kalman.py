"""The arithmetic of the wave filter: its states, how they are carried on, and how a measurement corrects them.

States: heading, yaw rate and rudder bias of the glider (K-T equation, driven by the measured rudder and scaled to
the speed by similarity); heading and yaw rate of the float above it, which follows the glider as a second-order
system; current north and east, speed through the water, by what factor the boat turns better than its model says;
leeway, by how much the way through the water lies to starboard of the heading, and by how long it lags behind the
heading in a turn (the boat slides, and a receiver is late); the angle that the rudder bias wanders about, and forgets
its way back to in BIAS_MEMORY_S (Gauss-Markov); and three motions of the waves' frequency, second-order processes of
damping 0.1: the yaw of the float, and what the waves carry the receiver to and fro by, north and east.

Arrays are added and multiplied element by element, and never by a matrix product, whose order of sums is the
library's: so the numbers are the same to the last bit on every machine.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from operator import add
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from firmware_py.model.kt import KtModel, decay_over, scaled, settled_yaw_rate

HEADING, RATE, BIAS, FLOAT, FLOAT_RATE, NORTH, EAST, SPEED, FACTOR, LEEWAY, COURSE_LAG, BIAS_MEAN = range(12)
WAVE, WAVE_RATE, ORBIT_NORTH, ORBIT_NORTH_RATE, ORBIT_EAST, ORBIT_EAST_RATE = range(12, 18)
STATES: Final = 18
COLUMNS: Final = 20  # of a covariance with the slopes beside it: by another ln omega of the waves, by another ln follow
DAMPING: Final = 0.1  # of the waves' motions; docs/explanation/physics.md, "The sea that acts on the boat"
FLOAT_DAMPING: Final = 0.6  # of the float; 0.4 to 0.9 are known, which the frequency that is learned makes up for

BIAS_MEMORY_S: Final = 100.0  # of the wandering of wind and trim, as there

Numbers = tuple[float, ...]
Floats = NDArray[np.float64]
Noise = tuple[float, float, float]  # what a motion gains in a step: angle, covariance of both, rate
Response = tuple[float, float, float, float]  # of a second-order system over a step, row by row
# What turns the glider, for each of the five that it makes.
_DRIVING: Final = np.array((HEADING, RATE, BIAS, SPEED, FACTOR, BIAS_MEAN)).reshape(6, 1).repeat(5, 1)
_TURNING: Final = _DRIVING.size * COLUMNS
_MOTIONS: Final = range(WAVE, STATES, 2)
# Angle, then rate, of what swings, for each of the two that they make of themselves.
_SWINGING: Final = np.array((FLOAT, FLOAT_RATE, *range(WAVE, STATES))).reshape(4, 2).T.repeat(2, 1)
# Where the noise of a step goes in the lower triangle of a covariance, flat: the diagonal, then rate by angle.
_NOISY: Final = np.array([(COLUMNS + 1) * i for i in range(STATES)] + [COLUMNS * (i + 1) + i for i in _MOTIONS])
# Of each number of a covariance, where it stands in the lower triangle, flat.
_LOWER: Final = np.array([[COLUMNS * max(i, k) + min(i, k) for k in range(STATES)] for i in range(STATES)])
# Of each number of its transpose, where it stands in a covariance with the slopes beside it, flat; those stay there.
_ACROSS: Final = np.array(
    [[COLUMNS * k + i if k < STATES else COLUMNS * i + k for k in range(COLUMNS)] for i in range(STATES)]
)
# Where what pulls the motions and the float back goes in the slopes beside a covariance, flat.
_PULLED: Final = np.array(
    [COLUMNS * i + STATES for i in range(WAVE, STATES)] + [COLUMNS * i + STATES + 1 for i in (FLOAT, FLOAT_RATE)]
)
sum_of: Final = np.add.reduce  # looked up once: that costs as much as to take a row of an array
_outer: Final = np.multiply.outer
# Numbers for an array: so made it takes a third of the time that numpy takes to look at each.
_pack_shares: Final = struct.Struct(f"{_DRIVING.size + _SWINGING.size}d").pack
_pack_gains: Final = struct.Struct(f"{_NOISY.size}d").pack
_pack_pulls: Final = struct.Struct(f"{_PULLED.size}d").pack


def response(omega_rad_s: float, damping: float, step_s: float) -> Response:
    """Return the transition matrix of angle and rate of a free second-order system over a step, damping below 1."""
    damped_rad_s = omega_rad_s * math.sqrt(1.0 - damping * damping)
    decay = math.exp(-damping * omega_rad_s * step_s)
    cosine, sine = decay * math.cos(damped_rad_s * step_s), decay * math.sin(damped_rad_s * step_s) / damped_rad_s
    lead = damping * omega_rad_s * sine
    return cosine + lead, sine, -omega_rad_s * omega_rad_s * sine, cosine - lead


class Turn(msgspec.Struct, frozen=True):
    """The K-T equation over a step: the new heading and yaw rate, and their derivatives.

    A disturbance that adds `d` to the new yaw rate adds `share * d` to the new heading.
    """

    heading_rad: float
    yaw_rate_rad_s: float
    reach_s: float
    share_s: float
    by_rate: float
    by_bias: float
    by_speed: float
    by_factor: float


class Transition(msgspec.Struct, frozen=True):
    """A step of all states: the glider's turn, what float and waves do by themselves, and how much bias is kept."""

    turn: Turn
    follow: Response
    wave: Response
    keep: float


def turn(x: Numbers, rudder_rad: float, step_s: float, model: KtModel, bias_variance: float = 0.0) -> Turn:
    """Return how the boat turns in a step at constant rudder, by the exact step of its model at the estimated speed.

    The derivatives by speed and factor count as far as the rudder is surely felt: beside a bias that is hardly known,
    a small one tells nothing of them, and what the estimates err by from step to step would pass for knowledge.
    """
    ability_1_s, lag_s, norrbin = scaled(model, x[SPEED] / model.speed_m_s)
    r, factor, push_rad = x[RATE], x[FACTOR], rudder_rad - x[BIAS]
    cubic = norrbin * r * r * r
    steady = factor * ability_1_s * push_rad - cubic
    decay = decay_over(step_s, lag_s)
    gone = 1.0 - decay
    reach_s = lag_s * gone
    felt = push_rad * push_rad / (push_rad * push_rad + 25.0 * bias_variance) if bias_variance > 0.0 else 1.0
    by_speed = (factor * ability_1_s * push_rad + 2.0 * cubic) * gone + (steady - r) * decay * step_s / lag_s
    return Turn(
        # kt.exact_step in another order of its sums, which logs of earlier versions hold to the last bit.
        x[HEADING] + steady * step_s + (r - steady) * reach_s,
        settled_yaw_rate(r, steady, decay),
        reach_s,
        (step_s - reach_s) / gone if gone > 1e-12 else 0.5 * step_s,
        decay - 3.0 * norrbin * r * r * gone,
        -factor * ability_1_s * gone,
        felt * by_speed / x[SPEED],
        felt * ability_1_s * push_rad * gone,
    )


def advance(x: Numbers, transition: Transition) -> Numbers:
    """Return the states after a step; the float follows the middle of the glider's way."""
    _, _, bias, floating, float_rate, north, east, speed, factor, leeway, course_lag, mean = x[:WAVE]
    a, a_rate, b, b_rate, c, c_rate = x[WAVE:]
    turned, (f00, f01, f10, f11), (w00, w01, w10, w11) = transition.turn, transition.follow, transition.wave
    middle = 0.5 * (x[HEADING] + turned.heading_rad)
    behind = floating - middle
    # fmt: off
    return (
        turned.heading_rad, turned.yaw_rate_rad_s, mean + transition.keep * (bias - mean),
        middle + f00 * behind + f01 * float_rate, f10 * behind + f11 * float_rate,
        north, east, speed, factor, leeway, course_lag, mean,
        w00 * a + w01 * a_rate, w10 * a + w11 * a_rate,
        w00 * b + w01 * b_rate, w10 * b + w11 * b_rate,
        w00 * c + w01 * c_rate, w10 * c + w11 * c_rate,
    )
    # fmt: on


class Measured(NamedTuple):
    """How a scalar measurement shows states and slopes, P H' (18) and H S (2), and the innovation's variance."""

    shown: Floats
    variance: float


def derivative(transition: Transition) -> tuple[Floats, Floats]:
    """Return the derivative of `advance`, by which `carry` carries columns on.

    What turns (6 x 5 x 20): by each of _DRIVING, of heading, yaw rate, bias and the middle of the glider's way, this
    twice, in the places of the float. What swings (2 x 8 x 20): by the angle, then by the rate of what swings, of angle
    and rate, the float beside this middle. Each is there for every column: numpy multiplies arrays of the same shape in
    a third of the time.
    """
    turned, keep = transition.turn, transition.keep
    reach, share, half = turned.reach_s, turned.share_s, 0.5 * turned.share_s
    bias, speed, factor = turned.by_bias, turned.by_speed, turned.by_factor
    f00, f01, f10, f11 = transition.follow
    w00, w01, w10, w11 = transition.wave
    # fmt: off
    shares = np.frombuffer(_pack_shares(
        1.0, 0.0, 0.0, 1.0, 1.0,
        reach, turned.by_rate, 0.0, 0.5 * reach, 0.5 * reach,
        share * bias, bias, keep, half * bias, half * bias,
        share * speed, speed, 0.0, half * speed, half * speed,
        share * factor, factor, 0.0, half * factor, half * factor,
        0.0, 0.0, 1.0 - keep, 0.0, 0.0,
        f00, f10, w00, w10, w00, w10, w00, w10,
        f01, f11, w01, w11, w01, w11, w01, w11,
    ))
    # fmt: on
    everywhere = shares.repeat(COLUMNS)
    return everywhere[:_TURNING].reshape(6, 5, COLUMNS), everywhere[_TURNING:].reshape(2, 8, COLUMNS)


def carry(columns: Floats, by: tuple[Floats, Floats]) -> Floats:
    """Return F M: the columns of M (18 x 20), carried on by what `derivative` says."""
    turning, swinging = by
    carried = columns.copy()
    turned = carried[:NORTH]
    sum_of(turning * columns.take(_DRIVING, 0), 0, out=turned)
    middle, swing = turned[FLOAT:], columns.take(_SWINGING, 0)
    floating = swing[0, :2]
    np.subtract(floating, middle, floating)
    parts = swinging * swing
    swung = parts[0] + parts[1]
    angle = swung[0]
    np.add(angle, middle[0], angle)
    carried[FLOAT:NORTH] = swung[:2]
    carried[WAVE:] = swung[2:]
    return carried


def predict(columns: Floats, transition: Transition, noise: Sequence[float], motions: Sequence[Noise]) -> Floats:
    """Return F P F' + Q beside F S; `noise`: what each state but the motions gains; `motions`: what those do."""
    by = derivative(transition)
    once = carry(columns, by)
    numbers = carry(once.take(_ACROSS), by).reshape(-1)
    own = [gain for angle, _, rate in motions for gain in (angle, rate)]
    gains = np.frombuffer(_pack_gains(*noise, *own, *[both for _, both, _ in motions]))
    numbers.put(_NOISY, numbers.take(_NOISY) + gains)
    once[:, :STATES] = numbers.take(_LOWER)
    return once


def pull(columns: Floats, swinging: Sequence[tuple[float, float, float, float]], step_s: float) -> None:
    """Add to the slopes what another ln omega, or ln follow, would change: the forces that bring back, and damp.

    `swinging` are frequency, damping, angle and rate of each motion of the waves, then of the float.
    """
    more: list[float] = []
    for rad_s, damping, angle, rate in swinging:
        force = -2.0 * rad_s * (rad_s * angle + damping * rate)
        more += (0.5 * step_s * step_s * force, step_s * force)
    columns.put(_PULLED, columns.take(_PULLED) + np.frombuffer(_pack_pulls(*more)))


def wave_noise(wave: Response, omega_rad_s: float, power: float) -> Noise:
    """Return the noise that keeps a wave motion stationary over any step, P - A P A': angle, covariance, rate."""
    w00, w01, w10, w11 = wave
    rate_square = power / (4.0 * DAMPING * omega_rad_s)
    angle_square = rate_square / (omega_rad_s * omega_rad_s)
    return (
        angle_square - w00 * w00 * angle_square - w01 * w01 * rate_square,
        -w00 * w10 * angle_square - w01 * w11 * rate_square,
        rate_square - w10 * w10 * angle_square - w11 * w11 * rate_square,
    )


def correct(
    x: Numbers, columns: Floats, measured: Measured, innovation: float, variance: float
) -> tuple[Numbers, Floats]:
    """Take a scalar measurement in, its innovation and that one's variance, which may be larger than measured.

    By the innovation's standard deviation, and not its variance: so the covariance stays symmetric to the last bit.
    """
    share = 1.0 / math.sqrt(variance)
    shown = share * measured.shown
    of_states = shown[:STATES]
    moved = of_states * (share * innovation)
    return tuple(map(add, x, moved.tolist())), columns - _outer(of_states, shown)
