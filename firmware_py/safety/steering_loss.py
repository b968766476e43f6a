"""Detect loss of steering: a sequential test (Page, 1954) of boats that respond against a boat that does not respond.

Each of RESPONSES is a boat that turns by a large part of the turn of the model, with or without a delay and a larger
lag, or in the opposite direction. The alternative is a boat without a rudder, which turns by the disturbance only:
trim, wind and current as an equivalent rudder angle, a first-order Gauss-Markov process about a mean. For each boat, a
Kalman filter with the states heading and disturbance gives the likelihood of the observed headings. The gain is the
same for all filters, so for the boat without a rudder only the difference (`deficit`) is stored. The log-likelihood
ratio is summed from the last time when the sum favoured the responding boat. If the sums are against every boat,
steering is lost. After that, the ratios in favour of each boat are summed until one of them is large.

The variance of the disturbance is learned while the boat responds. So the test takes longer in gusts or with a wrong
model, and less time in calm water. A boat that turns in the opposite direction is compared with the first boat without
a rudder, because its own filter would explain the effect of the rudder by wind.

The likelihood of each heading is conditional on all earlier ones, so it is valid although the rudder depends on the
heading. With a wrong model, a rudder that balances gusts would add evidence. So evidence against a boat counts only
while the error is large and the rudder acts to reduce it.

Numeric core: functions without I/O that the laboratory compiles unchanged (hil/lab/numeric_core.py); NaN: absent.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, radians
from firmware_py.model.kt import KtModel, decay_over, scaled


class Response(NamedTuple):
    """A responding boat: delay in blocks; turning lag and turn divided by those of the model.

    `min_turn_ratio` is the smallest turn in the comparison.
    """

    delay_blocks: int
    lag_ratio: float
    turn_ratio: float
    min_turn_ratio: float


RESPONSES: Final = (
    Response(0, 1.0, 1.0, 0.6),  # nominal
    Response(2, 1.0, 1.0, 0.6),
    Response(4, 1.0, 1.0, 0.6),
    Response(6, 1.0, 1.0, 0.6),
    Response(0, 3.0, 1.0, 0.6),
    Response(2, 3.0, 1.0, 0.6),
    Response(4, 3.0, 1.0, 0.6),
    Response(6, 3.0, 1.0, 0.6),
    Response(0, 1.0, 0.5, 0.5),
    Response(4, 1.0, 0.5, 0.5),
    Response(0, 3.0, 0.5, 0.5),
    Response(4, 3.0, 0.5, 0.5),
    Response(0, 1.0, -1.0, -0.6),
    Response(4, 1.0, -1.0, -0.6),
    Response(0, 3.0, -1.0, -0.6),
    Response(4, 3.0, -1.0, -0.6),
)
SPEED_MEMORY_S: Final = 200.0  # of the mean speed; long, because a missing turn first lowers the estimated speed
LARGE_ERROR_RAD: Final = radians(10.0)
# Disturbance as a rudder angle: initial standard deviation about its mean, correlation time, memory of the learning.
INITIAL_DISTURBANCE_RAD: Final = radians(2.0)
CORRELATION_S: Final = 100.0
DISTURBANCE_MEMORY_S: Final = 1800.0
MIN_GUST_RAD2_S: Final = radians(6.0) ** 2  # minimum of the white part of the disturbance, variance in 1 s
DIFFUSION_SHARE: Final = 0.5  # of the learned diffusion; the other part is the disturbance that is learned here
NOISE_SHARE: Final = 0.7  # share of the heading's standard deviation that is independent in each block
# A turn that exceeds that of FULL_RUDDER_RAD by WAVE_TURN_SDS standard deviations is caused by a breaking wave.
FULL_RUDDER_RAD: Final = radians(45.0)
WAVE_TURN_SDS: Final = 3.0
LOSS_EVIDENCE: Final = 7.0  # log-likelihood ratio; its maximum was 6.8 in 38 days of turns in eleven seas
RECOVERY_EVIDENCE: Final = 20.0  # larger, because a disturbance may look like a recovery


class ResponseState(NamedTuple):
    """State of one of RESPONSES: its rudder after the lag, its filter, and the evidence against it.

    `residual_rad`: heading minus its estimate, `disturbance_rad`: estimated disturbance, `mean_rad`: its mean.
    `heading_deficit_rad` and `disturbance_deficit_rad`: difference of heading and disturbance from those without a
    rudder since the sum began, for turn_ratio 1. `evidence`: the sum, against the boat or, after a loss, in favour.
    """

    rudder_rad: float = 0.0
    residual_rad: float = 0.0
    disturbance_rad: float = 0.0
    mean_rad: float = 0.0
    heading_deficit_rad: float = 0.0
    disturbance_deficit_rad: float = 0.0
    evidence: float = 0.0


INITIAL_RESPONSE: Final = ResponseState()
S = ResponseState
Boats = tuple[S, S, S, S, S, S, S, S, S, S, S, S, S, S, S, S]
INITIAL_BOATS: Final[Boats] = (
    INITIAL_RESPONSE, INITIAL_RESPONSE, INITIAL_RESPONSE, INITIAL_RESPONSE, INITIAL_RESPONSE, INITIAL_RESPONSE,
    INITIAL_RESPONSE, INITIAL_RESPONSE, INITIAL_RESPONSE, INITIAL_RESPONSE, INITIAL_RESPONSE, INITIAL_RESPONSE,
    INITIAL_RESPONSE, INITIAL_RESPONSE, INITIAL_RESPONSE, INITIAL_RESPONSE,
)  # fmt: skip
Rudders = tuple[float, float, float, float, float, float, float]


class SteeringLossState(NamedTuple):
    """Rudder of the latest blocks, newest first, mean speed, state of the responding boats, and the verdict.

    `seen_s`: time in the mean speed. `near_s`: time in which the boat has been near its goal. `heading_variance` (NaN
    before the first block), `disturbance_variance` and `covariance`: covariance of all filters.
    `disturbance_power_rad2`: learned mean square of the disturbance about its mean.
    """

    rudders_rad: Rudders = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    speed_m_s: float = 0.0
    seen_s: float = 0.0
    near_s: float = 0.0
    heading_variance: float = math.nan
    covariance: float = 0.0
    disturbance_variance: float = INITIAL_DISTURBANCE_RAD * INITIAL_DISTURBANCE_RAD
    disturbance_power_rad2: float = INITIAL_DISTURBANCE_RAD * INITIAL_DISTURBANCE_RAD
    boats: Boats = INITIAL_BOATS
    lost: bool = False


class Block(NamedTuple):
    """Inputs of a block for all boats: turn, duration, lag of the model, turn per rudder angle, filter gains.

    `keep`: decay of the disturbance. `variance`: of the innovation. `near`: the heading error is small. `error_rad`:
    heading error; 0: steered by hand.
    """

    turned_rad: float
    step_s: float
    lag_s: float
    turn_per_rudder: float
    keep: float
    heading_gain: float
    disturbance_gain: float
    variance: float
    near: bool
    error_rad: float


def restart_after_gap(state: SteeringLossState) -> SteeringLossState:
    """Return the state with the sums restarted, as after a time without a heading; verdict and learned values stay."""
    return SteeringLossState(
        state.rudders_rad, state.speed_m_s, state.seen_s, state.near_s, math.nan, 0.0, state.disturbance_variance,
        state.disturbance_power_rad2, restart_all(state.boats, INTERRUPTED), state.lost,
    )  # fmt: skip


def update(
    model: KtModel,
    state: SteeringLossState,
    rudder_rad: float,
    turned_rad: float,
    step_s: float,
    heading_sd_rad: float,
    speed_m_s: float,
    error_rad: float,
    diffusion_rad2_s: float,
) -> SteeringLossState:
    """Return the state after a block with its mean rudder, turn and duration; `error_rad` NaN: steered by hand."""
    is_near, is_manual = abs(error_rad) < LARGE_ERROR_RAD, math.isnan(error_rad)
    seen_s = min(state.seen_s + step_s, SPEED_MEMORY_S)
    speed_m_s = state.speed_m_s + step_s / seen_s * (speed_m_s - state.speed_m_s)
    nominal_m_s = model.speed_m_s
    ability_1_s, lag_s, _ = scaled(model, clamp(speed_m_s, 0.1 * nominal_m_s, 10.0 * nominal_m_s) / nominal_m_s)
    turn_per_rudder, decay = ability_1_s * step_s, math.exp(-step_s / CORRELATION_S)
    noise = (NOISE_SHARE * heading_sd_rad) * (NOISE_SHARE * heading_sd_rad)
    heading_variance = noise if math.isnan(state.heading_variance) else state.heading_variance
    gust_variance = max(MIN_GUST_RAD2_S, DIFFUSION_SHARE * diffusion_rad2_s / (ability_1_s * ability_1_s)) / step_s
    heading_variance += turn_per_rudder * (
        2.0 * state.covariance + turn_per_rudder * (state.disturbance_variance + gust_variance)
    )
    covariance = decay * (state.covariance + turn_per_rudder * state.disturbance_variance)
    predicted_variance = (
        decay * decay * state.disturbance_variance + (1.0 - decay * decay) * state.disturbance_power_rad2
    )
    variance = heading_variance + noise
    heading_gain, disturbance_gain = heading_variance / variance, covariance / variance
    rudders_rad = (rudder_rad, *state.rudders_rad[:-1])
    max_rudder_turn_rad = turn_per_rudder * FULL_RUDDER_RAD
    if turned_rad * turned_rad > WAVE_TURN_SDS * WAVE_TURN_SDS * (variance + max_rudder_turn_rad * max_rudder_turn_rad):
        return restart_after_gap(state)
    near_s = min(state.near_s + step_s, DISTURBANCE_MEMORY_S) if is_near else state.near_s
    disturbance_variance = predicted_variance - disturbance_gain * covariance
    block = Block(
        turned_rad, step_s, lag_s, turn_per_rudder, decay, heading_gain, disturbance_gain, variance, is_near,
        0.0 if is_manual else error_rad,
    )  # fmt: skip
    boats = advance_all(state.boats, rudders_rad, state.lost, near_s, block)
    first, disturbance_power_rad2 = boats[0], state.disturbance_power_rad2
    if first.evidence == 0.0 and not state.lost:
        deviation_rad = first.disturbance_rad - first.mean_rad
        disturbance_power_rad2 += (
            step_s
            / DISTURBANCE_MEMORY_S
            * (deviation_rad * deviation_rad + disturbance_variance - disturbance_power_rad2)
        )
    is_lost = max_evidence(boats) <= RECOVERY_EVIDENCE if state.lost else min_evidence(boats) > LOSS_EVIDENCE
    if is_lost != state.lost:
        boats = restart_all(boats, LOST if is_lost else RECOVERED)
    return SteeringLossState(
        rudders_rad, speed_m_s, seen_s, near_s, heading_variance * (1.0 - heading_gain),
        covariance * (1.0 - heading_gain),
        disturbance_variance, disturbance_power_rad2, boats, is_lost,
    )  # fmt: skip


def min_evidence(boats: Boats) -> float:
    """Return the smallest evidence of the boats."""
    minimum = boats[0].evidence
    for boat in boats:
        minimum = min(minimum, boat.evidence)
    return minimum


def max_evidence(boats: Boats) -> float:
    """Return the largest evidence of a boat that turns in the right direction."""
    maximum = boats[0].evidence
    for i in range(len(boats)):
        if RESPONSES[i].turn_ratio > 0.0:
            maximum = max(maximum, boats[i].evidence)
    return maximum


def advance_all(
    b: Boats,
    rudders_rad: Rudders,
    is_lost: bool,  # noqa: FBT001 - compiled
    near_s: float,
    block: Block,
) -> Boats:
    """Return the boats after a block."""
    first = advance(0, b[0], rudders_rad, is_lost, near_s, block, b[0])
    return (
        first,
        advance(1, b[1], rudders_rad, is_lost, near_s, block, first),
        advance(2, b[2], rudders_rad, is_lost, near_s, block, first),
        advance(3, b[3], rudders_rad, is_lost, near_s, block, first),
        advance(4, b[4], rudders_rad, is_lost, near_s, block, first),
        advance(5, b[5], rudders_rad, is_lost, near_s, block, first),
        advance(6, b[6], rudders_rad, is_lost, near_s, block, first),
        advance(7, b[7], rudders_rad, is_lost, near_s, block, first),
        advance(8, b[8], rudders_rad, is_lost, near_s, block, first),
        advance(9, b[9], rudders_rad, is_lost, near_s, block, first),
        advance(10, b[10], rudders_rad, is_lost, near_s, block, first),
        advance(11, b[11], rudders_rad, is_lost, near_s, block, first),
        advance(12, b[12], rudders_rad, is_lost, near_s, block, first),
        advance(13, b[13], rudders_rad, is_lost, near_s, block, first),
        advance(14, b[14], rudders_rad, is_lost, near_s, block, first),
        advance(15, b[15], rudders_rad, is_lost, near_s, block, first),
    )


def advance(
    number: int,
    boat: ResponseState,
    rudders_rad: Rudders,
    is_lost: bool,  # noqa: FBT001 - compiled
    near_s: float,
    block: Block,
    first: ResponseState,
) -> ResponseState:
    """Return the boat with this index in RESPONSES after a block; `first` is the nominal boat after the block."""
    response, step_s, turn_per_rudder = RESPONSES[number], block.step_s, block.turn_per_rudder
    commanded_rad, turn_ratio = rudders_rad[response.delay_blocks], response.turn_ratio
    lag_s, difference_rad = response.lag_ratio * block.lag_s, boat.rudder_rad - commanded_rad
    decayed = 1.0 - decay_over(step_s, lag_s)
    rudder_rad = commanded_rad + difference_rad * decayed * lag_s / step_s
    residual_rad = boat.residual_rad + block.turned_rad - turn_per_rudder * boat.disturbance_rad
    deficit_rad = boat.heading_deficit_rad + turn_per_rudder * (boat.disturbance_deficit_rad + rudder_rad)
    if is_lost:
        smaller_turn_rad = residual_rad - response.min_turn_ratio * deficit_rad
        ratio = 0.5 * (residual_rad * residual_rad - smaller_turn_rad * smaller_turn_rad) / block.variance
    else:
        residual_rad -= turn_per_rudder * turn_ratio * rudder_rad
        smaller_turn_rad = residual_rad + (turn_ratio - response.min_turn_ratio) * deficit_rad
        no_turn_rad = residual_rad + turn_ratio * deficit_rad
        ratio = 0.5 * (smaller_turn_rad * smaller_turn_rad - no_turn_rad * no_turn_rad) / block.variance
        if block.near or block.error_rad * rudder_rad < 0.0:
            ratio = min(ratio, 0.0)
    deviation_rad = boat.disturbance_rad - boat.mean_rad
    disturbance_rad = boat.mean_rad + block.keep * deviation_rad + block.disturbance_gain * residual_rad
    disturbance_deficit_rad = block.keep * boat.disturbance_deficit_rad - block.disturbance_gain * deficit_rad
    residual_rad, deficit_rad = (1.0 - block.heading_gain) * residual_rad, (1.0 - block.heading_gain) * deficit_rad
    mean_rad, evidence = boat.mean_rad, max(boat.evidence + ratio, 0.0)
    if block.near and not is_lost:
        mean_rad += step_s / max(near_s, CORRELATION_S) * (disturbance_rad - mean_rad)
    if evidence == 0.0:
        deficit_rad = disturbance_deficit_rad = 0.0
        if turn_ratio < 0.0 and not is_lost:
            deficit_rad = (first.residual_rad + first.heading_deficit_rad - residual_rad) / turn_ratio
            disturbance_deficit_rad = disturbance_rad - first.disturbance_rad + first.disturbance_deficit_rad
            disturbance_deficit_rad /= turn_ratio
    return ResponseState(
        boat.rudder_rad - difference_rad * decayed, residual_rad, disturbance_rad, mean_rad, deficit_rad,
        disturbance_deficit_rad, evidence,
    )  # fmt: skip


INTERRUPTED, LOST, RECOVERED = 0, 1, 2  # reasons of a restart


def restart_all(b: Boats, reason: int) -> Boats:
    """Return the boats with sums of 0, and with the filters for the verdict."""
    return (
        restart(0, b[0], reason, b[0]), restart(1, b[1], reason, b[0]), restart(2, b[2], reason, b[0]),
        restart(3, b[3], reason, b[0]), restart(4, b[4], reason, b[0]), restart(5, b[5], reason, b[0]),
        restart(6, b[6], reason, b[0]), restart(7, b[7], reason, b[0]), restart(8, b[8], reason, b[0]),
        restart(9, b[9], reason, b[0]), restart(10, b[10], reason, b[0]), restart(11, b[11], reason, b[0]),
        restart(12, b[12], reason, b[0]), restart(13, b[13], reason, b[0]), restart(14, b[14], reason, b[0]),
        restart(15, b[15], reason, b[0]),
    )  # fmt: skip


def restart(number: int, boat: ResponseState, reason: int, first: ResponseState) -> ResponseState:
    """Return the boat with a sum of 0.

    After a loss, each filter continues from the estimate of the nominal boat without a rudder; after a recovery, from
    that of its own boat with a rudder; after an interruption, the residual is 0.
    """
    residual_rad, disturbance_rad, turn_ratio = 0.0, boat.disturbance_rad, RESPONSES[number].turn_ratio
    if reason == LOST:
        residual_rad = first.residual_rad + first.heading_deficit_rad
        disturbance_rad = first.disturbance_rad - first.disturbance_deficit_rad
    elif reason == RECOVERED:
        residual_rad = boat.residual_rad - turn_ratio * boat.heading_deficit_rad
        disturbance_rad += turn_ratio * boat.disturbance_deficit_rad
    return ResponseState(boat.rudder_rad, residual_rad, disturbance_rad, boat.mean_rad, 0.0, 0.0, 0.0)
