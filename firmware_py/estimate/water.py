"""Speed through the water and the current, from the velocity over ground and the heading.

    v_north = U cos(psi) + c_north        v_east = U sin(psi) + c_east

is linear in (c_north, c_east, U) for a known heading, so a Kalman filter of three states
takes it in, one average after the other: of ten seconds in a turn, of a minute on a steady
heading. Waves swing the bow to and fro within one, and a receiver's noise averages out;
and on a straight leg the heading is that of the leg, for what the compass errs by from one
average to the next would be taken for turns that the track did not follow, and so for a
slower boat. On a steady heading only the sum
of the speed and the current along it can be seen; every turn tells the two apart. What is
not seen stays as uncertain as the standard deviations say: they grow from turn to turn, and
no further than to what was known of the sea beforehand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from firmware_py.common.angles import clamp
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import PositionSample
from firmware_py.common.reports import Water
from firmware_py.estimate.track_average import BLOCK_S, Average, Block, add_tick, mean_velocity

MOST_BLOCKS = 6  # that are joined while the boat goes straight
LEG_MEMORY = 60.0  # blocks: the heading of a straight leg is their mean
LONGEST_BLOCK_S = 60.0
# What is known beforehand, and what everything returns to when nothing more is seen.
SPEED_SPREAD_M_S, CURRENT_SPREAD_M_S = 0.5, 0.25
SPEED_MEMORY_S, CURRENT_MEMORY_S = 12.0 * 3600.0, 6.0 * 3600.0
SLOWEST_M_S, SPEED_MAXIMUM_M_S = 0.05, 5.0
# Noise of an average: learned from the innovations, within bounds.
NOISE_START, NOISE_LEAST, NOISE_MOST = 0.05**2, 0.02**2, 0.5**2
NOISE_LEARNING = 0.03
GATE = 25.0  # normalised innovation squared, of two components
MOST_OUTLIERS = 6
# The current counts as stronger when it is by a standard deviation, for so long; and no longer when weaker.
STRONG_AFTER_S, WEAK_AFTER_S = 120.0, 120.0
WEAK_PART = 0.97

Vector = tuple[float, float, float]
Matrix = tuple[float, float, float, float, float, float]  # upper triangle: nn, ne, nu, ee, eu, uu


@dataclass(frozen=True, slots=True)
class WaterState:
    """Estimate (c_north, c_east, U) at t_s with its covariance, the noise learned, and the block under way."""

    t_s: float | None = None
    mean: Vector = (0.0, 0.0, 0.5)
    covariance: Matrix = (CURRENT_SPREAD_M_S**2, 0.0, 0.0, CURRENT_SPREAD_M_S**2, 0.0, SPEED_SPREAD_M_S**2)
    noise: float = NOISE_START
    outliers: int = 0
    strong_s: float = 0.0  # how long the current has been stronger (+) or weaker (-) than the boat
    too_strong: bool = False
    block: Block | None = None
    average: Average | None = None
    leg: Average | None = None

    @classmethod
    def at_start(cls, parameters: ParameterSet) -> WaterState:
        """Return the state before the first fix."""
        return cls(mean=(0.0, 0.0, parameters["CRUISE_SPEED"]))


def report(state: WaterState) -> Water:
    """Return the estimate for those who steer by it."""
    north_m_s, east_m_s, speed_m_s = state.mean
    nn, ne, _, ee, _, uu = state.covariance
    half, differ = 0.5 * (nn + ee), 0.5 * (nn - ee)
    worst = half + math.sqrt(differ * differ + ne * ne)
    return Water(
        speed_m_s,
        math.sqrt(max(uu, 0.0)),
        north_m_s,
        east_m_s,
        math.sqrt(max(worst, 0.0)),
        state.too_strong,
    )


def update(state: WaterState, heading_rad: float | None, fixes: Sequence[PositionSample], now_s: float) -> WaterState:
    """Take the heading of a tick (None: not known) and the fixes that came with it."""
    block = state.block
    if heading_rad is None:
        return state if block is None else replace(state, block=None)
    if block is None:
        if not fixes:
            return state
        block = Block(now_s, first=fixes[-1], last=fixes[-1])
    block = add_tick(block, heading_rad, fixes)
    age_s = now_s - block.start_s
    if age_s < BLOCK_S or not (fixes or age_s > LONGEST_BLOCK_S):
        return replace(state, block=block)
    velocity = mean_velocity(block)
    if velocity is None:
        return replace(state, block=None if age_s > LONGEST_BLOCK_S else block)
    size = max(math.hypot(block.cosine, block.sine), 1e-9)
    latest = Average(block.cosine / size, block.sine / size, *velocity)
    return _add_block(replace(state, block=Block(now_s, first=block.last, last=block.last)), latest, now_s)


def _add_block(state: WaterState, latest: Average, now_s: float) -> WaterState:
    """Join a block to the average under way while the boat goes straight on, and take a whole one in."""
    before = state.average
    if before is not None and not before.has_heading_of(latest):
        state, before = _correct(_predict(state, now_s), before, now_s), None
    average = latest if before is None else before.plus(latest)
    if average.blocks >= MOST_BLOCKS or state.t_s is None:
        return _correct(_predict(replace(state, average=None), now_s), average, now_s)
    return replace(state, average=average)


def _predict(state: WaterState, now_s: float) -> WaterState:
    """Carry the estimate on: all wanders, and slowly returns to its prior."""
    if state.t_s is None or now_s <= state.t_s:
        return replace(state, t_s=now_s)
    step_s = now_s - state.t_s
    c, u = math.exp(-step_s / CURRENT_MEMORY_S), math.exp(-step_s / SPEED_MEMORY_S)
    nn, ne, nu, ee, eu, uu = state.covariance
    current_noise = CURRENT_SPREAD_M_S**2 * (1.0 - c * c)
    north, east, speed = state.mean
    return replace(
        state,
        t_s=now_s,
        # The speed has no home to return to: whatever was seen last is the best guess.
        mean=(c * north, c * east, speed),
        covariance=(
            c * c * nn + current_noise,
            c * c * ne,
            c * u * nu,
            c * c * ee + current_noise,
            c * u * eu,
            u * u * uu + SPEED_SPREAD_M_S**2 * (1.0 - u * u),
        ),
    )


def _correct(state: WaterState, average: Average, now_s: float) -> WaterState:
    """Take an average in; outliers are left out unless there is nothing else."""
    leg = average
    if state.leg is not None and state.leg.has_heading_of(average):
        leg = state.leg.weighted(max(0.0, 1.0 - average.blocks / LEG_MEMORY)).plus(average)
    size = max(math.hypot(leg.cosine, leg.sine), 1e-9)
    cosine, sine = leg.cosine / size, leg.sine / size
    state = replace(state, leg=leg)
    north, east, speed = state.mean
    n = average.north_m_s / average.blocks - north - speed * cosine
    e = average.east_m_s / average.blocks - east - speed * sine
    nn, ne, nu, ee, eu, uu = state.covariance
    # P H', columns for the north and the east component.
    n_north, n_east = nn + nu * cosine, ne + nu * sine
    e_north, e_east = ne + eu * cosine, ee + eu * sine
    u_north, u_east = nu + uu * cosine, eu + uu * sine
    s_nn = n_north + cosine * u_north + state.noise
    s_ne = n_east + cosine * u_east
    s_ee = e_east + sine * u_east + state.noise
    determinant = s_nn * s_ee - s_ne * s_ne
    if not determinant > 0.0:
        return replace(state, covariance=WaterState().covariance)
    i_nn, i_ne, i_ee = s_ee / determinant, -s_ne / determinant, s_nn / determinant
    if n * n * i_nn + 2.0 * n * e * i_ne + e * e * i_ee > GATE and state.outliers < MOST_OUTLIERS:
        return replace(state, outliers=state.outliers + 1)
    if state.outliers >= MOST_OUTLIERS:
        # They bear each other out: the sea has changed.
        state = replace(state, outliers=0, covariance=WaterState().covariance)
        return _correct(state, average, now_s)
    k = [
        (north_part * i_nn + east_part * i_ne, north_part * i_ne + east_part * i_ee)
        for north_part, east_part in ((n_north, n_east), (e_north, e_east), (u_north, u_east))
    ]
    mean = (
        north + k[0][0] * n + k[0][1] * e,
        east + k[1][0] * n + k[1][1] * e,
        speed + k[2][0] * n + k[2][1] * e,
    )
    covariance = (
        nn - k[0][0] * n_north - k[0][1] * n_east,
        ne - k[0][0] * e_north - k[0][1] * e_east,
        nu - k[0][0] * u_north - k[0][1] * u_east,
        ee - k[1][0] * e_north - k[1][1] * e_east,
        eu - k[1][0] * u_north - k[1][1] * u_east,
        uu - k[2][0] * u_north - k[2][1] * u_east,
    )
    measured = 0.5 * (n * n + e * e) - 0.5 * (s_nn + s_ee) + state.noise
    noise = clamp(state.noise + NOISE_LEARNING * (measured - state.noise), NOISE_LEAST, NOISE_MOST)
    state = replace(state, mean=_bound_speed(mean, covariance), covariance=covariance, noise=noise, outliers=0)
    return _judge_strength(state, BLOCK_S * average.blocks)


def _bound_speed(mean: Vector, covariance: Matrix) -> Vector:
    """Keep the speed within reason, and move the current along with it as their correlation says."""
    north, east, speed = mean
    bounded = clamp(speed, SLOWEST_M_S, SPEED_MAXIMUM_M_S)
    _, _, nu, _, eu, uu = covariance
    if bounded == speed or uu <= 0.0:
        return mean
    moved = (bounded - speed) / uu
    return north + nu * moved, east + eu * moved, bounded


def _judge_strength(state: WaterState, step_s: float) -> WaterState:
    """Judge, with patience both ways, whether the current is stronger than the boat."""
    north, east, speed = state.mean
    current = math.hypot(north, east)
    nn, ne, nu, ee, eu, uu = state.covariance
    a, b = (north / current, east / current) if current > 1e-6 else (1.0, 0.0)
    spread = math.sqrt(max(0.0, a * a * nn + b * b * ee + uu + 2.0 * (a * b * ne - a * nu - b * eu)))
    if current - speed > spread:
        strong_s = max(0.0, state.strong_s) + step_s
    elif current < WEAK_PART * speed:
        strong_s = min(0.0, state.strong_s) - step_s
    else:
        strong_s = 0.0
    too_strong = state.too_strong
    if strong_s >= STRONG_AFTER_S:
        too_strong = True
    elif strong_s <= -WEAK_AFTER_S:
        too_strong = False
    return replace(state, strong_s=strong_s, too_strong=too_strong)
