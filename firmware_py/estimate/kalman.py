"""The arithmetic of the wave filter: nine states, scalar measurements, plain numbers.

States: low-frequency heading, yaw rate and rudder bias (K-T equation, driven by the measured
rudder and scaled to the speed by similarity), angle and rate of the wave-frequency yaw (a
second-order process of damping 0.1), current north and east, speed through the water, and by
what factor the boat turns better than its model says.

A covariance is its upper triangle, row by row: 45 numbers. Everything is written out, because that
is ten times as fast in Python as loops over rows and columns, and the tick has little time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from firmware_py.model.kt import KtModel, decay_over, settled_yaw_rate

HEADING, RATE, BIAS, WAVE, WAVE_RATE, NORTH, EAST, SPEED, FACTOR = range(9)
STATES: Final = 9
DIAGONAL: Final = (0, 9, 17, 24, 30, 35, 39, 42, 44)
DAMPING: Final = 0.1  # of the wave process; docs/explanation/physics.md, "The sea that acts on the boat"

Numbers = tuple[float, ...]
Transition = tuple[float, float, float, float]  # of the wave process over a step, row by row


def covariance_index(row: int, column: int) -> int:
    """Return where the covariance of two states stands."""
    low, high = min(row, column), max(row, column)
    return DIAGONAL[low] + high - low


def wave_transition(omega_rad_s: float, step_s: float) -> Transition:
    """Return the transition matrix of the wave process over a step."""
    damped_rad_s = omega_rad_s * math.sqrt(1.0 - DAMPING * DAMPING)
    decay = math.exp(-DAMPING * omega_rad_s * step_s)
    cosine, sine = decay * math.cos(damped_rad_s * step_s), decay * math.sin(damped_rad_s * step_s) / damped_rad_s
    lead = DAMPING * omega_rad_s * sine
    return cosine + lead, sine, -omega_rad_s * omega_rad_s * sine, cosine - lead


@dataclass(frozen=True, slots=True)
class Turn:
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


def turn(x: Numbers, rudder_rad: float, step_s: float, model: KtModel) -> Turn:
    """Return how the boat turns in a step at constant rudder, by the exact step of its model at the estimated speed."""
    ability_1_s, lag_s, norrbin = model.scaled(x[SPEED] / model.speed_m_s)
    r, factor, push_rad = x[RATE], x[FACTOR], rudder_rad - x[BIAS]
    cubic = norrbin * r * r * r
    steady = factor * ability_1_s * push_rad - cubic
    decay = decay_over(step_s, lag_s)
    gone = 1.0 - decay
    reach_s = lag_s * gone
    return Turn(
        # kt.exact_step in another order of its sums, which logs of earlier versions hold to the last bit.
        x[HEADING] + steady * step_s + (r - steady) * reach_s,
        settled_yaw_rate(r, steady, decay),
        reach_s,
        (step_s - reach_s) / gone if gone > 1e-12 else 0.5 * step_s,
        decay - 3.0 * norrbin * r * r * gone,
        -factor * ability_1_s * gone,
        ((factor * ability_1_s * push_rad + 2.0 * cubic) * gone + (steady - r) * decay * step_s / lag_s) / x[SPEED],
        ability_1_s * push_rad * gone,
    )


def predict(p: Numbers, turn: Turn, wave: Transition, noise: Numbers) -> Numbers:
    """Return F P F' + Q; noise is what heading, rate, bias, wave (3: both variances, covariance), current ... gain."""
    # fmt: off
    (
        p00, p01, p02, p03, p04, p05, p06, p07, p08,
        p11, p12, p13, p14, p15, p16, p17, p18,
        p22, p23, p24, p25, p26, p27, p28,
        p33, p34, p35, p36, p37, p38,
        p44, p45, p46, p47, p48,
        p55, p56, p57, p58,
        p66, p67, p68,
        p77, p78,
        p88,
    ) = p
    # fmt: on
    reach, share, rr = turn.reach_s, turn.share_s, turn.by_rate
    rb, rs, rf = turn.by_bias, turn.by_speed, turn.by_factor
    w00, w01, w10, w11 = wave
    # What bias, speed and factor do to the yaw rate, by column of P; then the rows of F P that differ from P.
    s0 = rb * p02 + rs * p07 + rf * p08
    s1 = rb * p12 + rs * p17 + rf * p18
    s2 = rb * p22 + rs * p27 + rf * p28
    s3 = rb * p23 + rs * p37 + rf * p38
    s4 = rb * p24 + rs * p47 + rf * p48
    s5 = rb * p25 + rs * p57 + rf * p58
    s6 = rb * p26 + rs * p67 + rf * p68
    s7 = rb * p27 + rs * p77 + rf * p78
    s8 = rb * p28 + rs * p78 + rf * p88
    f00, f01 = p00 + reach * p01 + share * s0, p01 + reach * p11 + share * s1
    f02, f12 = p02 + reach * p12 + share * s2, rr * p12 + s2
    f07, f17 = p07 + reach * p17 + share * s7, rr * p17 + s7
    f08, f18 = p08 + reach * p18 + share * s8, rr * p18 + s8
    f11 = rr * p11 + s1
    f03, f13 = p03 + reach * p13 + share * s3, rr * p13 + s3
    f04, f14 = p04 + reach * p14 + share * s4, rr * p14 + s4
    f33, f34 = w00 * p33 + w01 * p34, w00 * p34 + w01 * p44
    f43, f44 = w10 * p33 + w11 * p34, w10 * p34 + w11 * p44
    t0, t1 = rb * f02 + rs * f07 + rf * f08, rb * f12 + rs * f17 + rf * f18
    q1, q2, q33, q34, q44, q5, q7, q8 = noise
    # fmt: off
    return (
        f00 + reach * f01 + share * t0, rr * f01 + t0, f02, w00 * f03 + w01 * f04, w10 * f03 + w11 * f04,
        p05 + reach * p15 + share * s5, p06 + reach * p16 + share * s6, f07, f08,
        rr * f11 + t1 + q1, f12, w00 * f13 + w01 * f14, w10 * f13 + w11 * f14, rr * p15 + s5, rr * p16 + s6, f17, f18,
        p22 + q2, w00 * p23 + w01 * p24, w10 * p23 + w11 * p24, p25, p26, p27, p28,
        w00 * f33 + w01 * f34 + q33, w10 * f33 + w11 * f34 + q34,
        w00 * p35 + w01 * p45, w00 * p36 + w01 * p46, w00 * p37 + w01 * p47, w00 * p38 + w01 * p48,
        w10 * f43 + w11 * f44 + q44,
        w10 * p35 + w11 * p45, w10 * p36 + w11 * p46, w10 * p37 + w11 * p47, w10 * p38 + w11 * p48,
        p55 + q5, p56, p57, p58,
        p66 + q5, p67, p68,
        p77 + q7, p78,
        p88 + q8,
    )
    # fmt: on


def wave_noise(transition: Transition, omega_rad_s: float, power: float) -> tuple[float, float, float]:
    """Return the noise that keeps the wave process stationary over any step, P - A P A': angle, covariance, rate."""
    w00, w01, w10, w11 = transition
    rate_square = power / (4.0 * DAMPING * omega_rad_s)
    angle_square = rate_square / (omega_rad_s * omega_rad_s)
    return (
        angle_square - w00 * w00 * angle_square - w01 * w01 * rate_square,
        -w00 * w10 * angle_square - w01 * w11 * rate_square,
        rate_square - w10 * w10 * angle_square - w11 * w11 * rate_square,
    )


def correct(x: Numbers, p: Numbers, shown: Numbers, innovation: float, variance: float) -> tuple[Numbers, Numbers]:
    """Take a scalar measurement in; `shown` is P H', and variance that of the innovation."""
    g0, g1, g2, g3, g4, g5, g6, g7, g8 = [each / variance for each in shown]
    h0, h1, h2, h3, h4, h5, h6, h7, h8 = shown
    # fmt: off
    (
        p00, p01, p02, p03, p04, p05, p06, p07, p08,
        p11, p12, p13, p14, p15, p16, p17, p18,
        p22, p23, p24, p25, p26, p27, p28,
        p33, p34, p35, p36, p37, p38,
        p44, p45, p46, p47, p48,
        p55, p56, p57, p58,
        p66, p67, p68,
        p77, p78,
        p88,
    ) = p
    # fmt: on
    # fmt: off
    after = (
        p00 - g0 * h0, p01 - g0 * h1, p02 - g0 * h2, p03 - g0 * h3, p04 - g0 * h4,
        p05 - g0 * h5, p06 - g0 * h6, p07 - g0 * h7, p08 - g0 * h8,
        p11 - g1 * h1, p12 - g1 * h2, p13 - g1 * h3, p14 - g1 * h4, p15 - g1 * h5,
        p16 - g1 * h6, p17 - g1 * h7, p18 - g1 * h8,
        p22 - g2 * h2, p23 - g2 * h3, p24 - g2 * h4, p25 - g2 * h5, p26 - g2 * h6,
        p27 - g2 * h7, p28 - g2 * h8,
        p33 - g3 * h3, p34 - g3 * h4, p35 - g3 * h5, p36 - g3 * h6, p37 - g3 * h7,
        p38 - g3 * h8,
        p44 - g4 * h4, p45 - g4 * h5, p46 - g4 * h6, p47 - g4 * h7, p48 - g4 * h8,
        p55 - g5 * h5, p56 - g5 * h6, p57 - g5 * h7, p58 - g5 * h8,
        p66 - g6 * h6, p67 - g6 * h7, p68 - g6 * h8,
        p77 - g7 * h7, p78 - g7 * h8,
        p88 - g8 * h8,
    )
    # fmt: on
    n = innovation
    x0, x1, x2, x3, x4, x5, x6, x7, x8 = x
    state = (
        x0 + g0 * n,
        x1 + g1 * n,
        x2 + g2 * n,
        x3 + g3 * n,
        x4 + g4 * n,
        x5 + g5 * n,
        x6 + g6 * n,
        x7 + g7 * n,
        x8 + g8 * n,
    )
    return state, after
