"""Detect loss of steering: a sequential test (Page, 1954) of responding boats against one that does not respond.

Each of RESPONSES is a boat that turns by a large part of the turn of the model, with or without a delay and a larger
lag, or in the opposite direction. The alternative is a boat that turns by the disturbance alone: trim, wind and current
as an equivalent rudder angle, a first-order Gauss-Markov process about a mean. For each boat, a Kalman filter of two
states, heading and disturbance, gives the likelihood of the observed headings. Its gain is the same for all boats, so
for the boat without a rudder only the difference is stored. The log-likelihood ratio is summed from the last time that
it favoured the responding boat. Once the sum is against every boat, steering is lost. From then on it is summed for
each boat until it favours one.

The variance of the disturbance is learned while the boat responds. So the test takes longer in gusts or with a wrong
model, and is faster in a calm. A boat that turns in the opposite direction is compared with the first boat without a
rudder, because its own filter explains the rudder by wind.

The likelihood is that of each heading conditional on all earlier ones, so it is valid although the rudder depends on
the heading. With a wrong model, a rudder that balances gusts would add evidence. So evidence against a boat counts only
while the error is large and the rudder acts to reduce it.

Numeric core: functions without I/O that the laboratory compiles unchanged (hil/lab/numeric_core.py); NaN: absent.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, radians
from firmware_py.model.kt import KtModel, decay_over, scaled


class Response(NamedTuple):
    """A responding boat: its delay in blocks, its turning lag by that of the model, and its part of the turn.

    `min_part` is the smallest part of the turn that the test allows for.
    """

    delay_blocks: int
    lags: float
    part: float
    min_part: float


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
SPEED_MEMORY_S: Final = 200.0  # of the mean speed: at first the estimate explains a missing turn by lost speed
LARGE_ERROR_RAD: Final = radians(10.0)
# Disturbance as a rudder angle: initial standard deviation about its mean, correlation time, and time in which both are
# learned.
INITIAL_DISTURBANCE_RAD: Final = radians(2.0)
CORRELATION_S: Final = 100.0
DISTURBANCE_MEMORY_S: Final = 1800.0
MIN_GUST_RAD2_S: Final = radians(6.0) ** 2  # white part of the disturbance in a second, at least
DIFFUSION_PART: Final = 0.5  # of the learned diffusion: another part of it is the disturbance that is learned here
NOISE_SHARE: Final = 0.7  # of the heading's standard deviation, from block to block
# A turn beyond that of any rudder by KNOCK_SDS standard deviations: a breaking sea turned the boat.
FULL_RUDDER_RAD: Final = radians(45.0)
KNOCK_SDS: Final = 3.0
LOSS_EVIDENCE: Final = 7.0  # of a log-likelihood ratio; 6.8 were reached in 38 days of turns in eleven seas
RECOVERY_EVIDENCE: Final = 20.0  # for a recovery: a disturbance without a rudder looks like one


class ResponseState(NamedTuple):
    """State of one of RESPONSES: its rudder after the lag, its filter, and the evidence against it.

    `beyond_rad` is the innovation of the heading after the update, `disturbance_rad` the disturbance, `mean_rad` its
    mean. `lacks_rad` and `lacks_disturbance_rad`: by how much heading and disturbance would be less without a rudder
    since the sum began, for a boat with the whole turn. `evidence`: the sum, against the boat or, after a loss, for it.
    """

    rudder_rad: float = 0.0
    beyond_rad: float = 0.0
    disturbance_rad: float = 0.0
    mean_rad: float = 0.0
    lacks_rad: float = 0.0
    lacks_disturbance_rad: float = 0.0
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
    """Rudder of the latest blocks, newest first, mean speed, the responding boats and the verdict.

    `seen_s` and `near_s`: for how long the speed has been observed, and the boat near its goal. Of the filters: the
    variances of the heading (NaN before the first block) and of the disturbance, their covariance, and `wander`, the
    mean square of the disturbance about its mean.
    """

    rudders_rad: Rudders = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    speed_m_s: float = 0.0
    seen_s: float = 0.0
    near_s: float = 0.0
    heading_variance: float = math.nan
    covariance: float = 0.0
    disturbance_variance: float = INITIAL_DISTURBANCE_RAD * INITIAL_DISTURBANCE_RAD
    wander: float = INITIAL_DISTURBANCE_RAD * INITIAL_DISTURBANCE_RAD
    boats: Boats = INITIAL_BOATS
    lost: bool = False


class Block(NamedTuple):
    """Inputs of a block, the same for all boats: turn, duration, lag of the model, turn per rudder angle, filter gains.

    `near`: the heading error is small. `side`: sign of the error; 0 by hand.
    """

    turned_rad: float
    step_s: float
    lag_s: float
    by_rudder: float
    keep: float
    by_heading: float
    by_disturbance: float
    variance: float
    near: bool
    side: float


def restart_after_gap(state: SteeringLossState) -> SteeringLossState:
    """Restart the sums after a time without a heading; the verdict and the learned values are kept."""
    return SteeringLossState(
        state.rudders_rad, state.speed_m_s, state.seen_s, state.near_s, math.nan, 0.0, state.disturbance_variance,
        state.wander, restart_all(state.boats, INTERRUPTED), state.lost,
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
    """Return the state after a block with its mean rudder, turn and duration; an error of NaN: steered by hand."""
    near, by_hand = abs(error_rad) < LARGE_ERROR_RAD, math.isnan(error_rad)
    seen_s = min(state.seen_s + step_s, SPEED_MEMORY_S)
    speed_m_s = state.speed_m_s + step_s / seen_s * (speed_m_s - state.speed_m_s)
    nominal_m_s = model.speed_m_s
    ability_1_s, lag_s, _ = scaled(model, clamp(speed_m_s, 0.1 * nominal_m_s, 10.0 * nominal_m_s) / nominal_m_s)
    by_rudder, keep = ability_1_s * step_s, math.exp(-step_s / CORRELATION_S)
    noise = (NOISE_SHARE * heading_sd_rad) * (NOISE_SHARE * heading_sd_rad)
    heading = noise if math.isnan(state.heading_variance) else state.heading_variance
    gusts = max(MIN_GUST_RAD2_S, DIFFUSION_PART * diffusion_rad2_s / (ability_1_s * ability_1_s)) / step_s
    heading += by_rudder * (2.0 * state.covariance + by_rudder * (state.disturbance_variance + gusts))
    covariance = keep * (state.covariance + by_rudder * state.disturbance_variance)
    disturbance = keep * keep * state.disturbance_variance + (1.0 - keep * keep) * state.wander
    variance = heading + noise
    by_heading, by_disturbance = heading / variance, covariance / variance
    rudders_rad = (rudder_rad, *state.rudders_rad[:-1])
    by_any_rudder_rad = by_rudder * FULL_RUDDER_RAD
    if turned_rad * turned_rad > KNOCK_SDS * KNOCK_SDS * (variance + by_any_rudder_rad * by_any_rudder_rad):
        return restart_after_gap(state)
    near_s = min(state.near_s + step_s, DISTURBANCE_MEMORY_S) if near else state.near_s
    disturbance_variance = disturbance - by_disturbance * covariance
    side = 0.0 if by_hand else math.copysign(1.0, error_rad)
    block = Block(turned_rad, step_s, lag_s, by_rudder, keep, by_heading, by_disturbance, variance, near, side)
    boats = advance_all(state.boats, rudders_rad, state.lost, near_s, block)
    first, wander = boats[0], state.wander
    if first.evidence == 0.0 and not state.lost:
        off_rad = first.disturbance_rad - first.mean_rad
        wander += step_s / DISTURBANCE_MEMORY_S * (off_rad * off_rad + disturbance_variance - wander)
    lost = max_evidence(boats) <= RECOVERY_EVIDENCE if state.lost else min_evidence(boats) > LOSS_EVIDENCE
    if lost != state.lost:
        boats = restart_all(boats, LOST if lost else RECOVERED)
    return SteeringLossState(
        rudders_rad, speed_m_s, seen_s, near_s, heading * (1.0 - by_heading), covariance * (1.0 - by_heading),
        disturbance_variance, wander, boats, lost,
    )  # fmt: skip


def min_evidence(boats: Boats) -> float:
    """Return the smallest evidence against a boat."""
    smallest = boats[0].evidence
    for boat in boats:
        smallest = min(smallest, boat.evidence)
    return smallest


def max_evidence(boats: Boats) -> float:
    """Return the largest evidence for a boat that does not turn the other way."""
    largest = boats[0].evidence
    for i in range(len(boats)):
        if RESPONSES[i].part > 0.0:
            largest = max(largest, boats[i].evidence)
    return largest


def advance_all(
    b: Boats,
    rudders_rad: Rudders,
    lost: bool,  # noqa: FBT001 - compiled
    near_s: float,
    block: Block,
) -> Boats:
    """Return the boats after a block."""
    first = advance(0, b[0], rudders_rad, lost, near_s, block, b[0])
    return (
        first,
        advance(1, b[1], rudders_rad, lost, near_s, block, first),
        advance(2, b[2], rudders_rad, lost, near_s, block, first),
        advance(3, b[3], rudders_rad, lost, near_s, block, first),
        advance(4, b[4], rudders_rad, lost, near_s, block, first),
        advance(5, b[5], rudders_rad, lost, near_s, block, first),
        advance(6, b[6], rudders_rad, lost, near_s, block, first),
        advance(7, b[7], rudders_rad, lost, near_s, block, first),
        advance(8, b[8], rudders_rad, lost, near_s, block, first),
        advance(9, b[9], rudders_rad, lost, near_s, block, first),
        advance(10, b[10], rudders_rad, lost, near_s, block, first),
        advance(11, b[11], rudders_rad, lost, near_s, block, first),
        advance(12, b[12], rudders_rad, lost, near_s, block, first),
        advance(13, b[13], rudders_rad, lost, near_s, block, first),
        advance(14, b[14], rudders_rad, lost, near_s, block, first),
        advance(15, b[15], rudders_rad, lost, near_s, block, first),
    )


def advance(
    number: int,
    boat: ResponseState,
    rudders_rad: Rudders,
    lost: bool,  # noqa: FBT001 - compiled
    near_s: float,
    block: Block,
    first: ResponseState,
) -> ResponseState:
    """Return the boat of this number in RESPONSES after a block; `first` is the nominal one after it."""
    kind, step_s, by_rudder = RESPONSES[number], block.step_s, block.by_rudder
    commanded_rad, part = rudders_rad[kind.delay_blocks], kind.part
    lag_s, over_rad = kind.lags * block.lag_s, boat.rudder_rad - commanded_rad
    gone = 1.0 - decay_over(step_s, lag_s)
    rudder_rad = commanded_rad + over_rad * gone * lag_s / step_s
    beyond_rad = boat.beyond_rad + block.turned_rad - by_rudder * boat.disturbance_rad
    lacks_rad = boat.lacks_rad + by_rudder * (boat.lacks_disturbance_rad + rudder_rad)
    if lost:
        with_rad = beyond_rad - kind.min_part * lacks_rad
        gained = 0.5 * (beyond_rad * beyond_rad - with_rad * with_rad) / block.variance
    else:
        beyond_rad -= by_rudder * part * rudder_rad
        with_rad, without_rad = beyond_rad + (part - kind.min_part) * lacks_rad, beyond_rad + part * lacks_rad
        gained = 0.5 * (with_rad * with_rad - without_rad * without_rad) / block.variance
        if block.near or block.side * rudder_rad < 0.0:
            gained = min(gained, 0.0)
    drift_rad = boat.disturbance_rad - boat.mean_rad
    disturbance_rad = boat.mean_rad + block.keep * drift_rad + block.by_disturbance * beyond_rad
    lacks_disturbance_rad = block.keep * boat.lacks_disturbance_rad - block.by_disturbance * lacks_rad
    beyond_rad, lacks_rad = (1.0 - block.by_heading) * beyond_rad, (1.0 - block.by_heading) * lacks_rad
    mean_rad, evidence = boat.mean_rad, max(boat.evidence + gained, 0.0)
    if block.near and not lost:
        mean_rad += step_s / max(near_s, CORRELATION_S) * (disturbance_rad - mean_rad)
    if evidence == 0.0:
        lacks_rad = lacks_disturbance_rad = 0.0
        if part < 0.0 and not lost:
            lacks_rad = (first.beyond_rad + first.lacks_rad - beyond_rad) / part
            lacks_disturbance_rad = disturbance_rad - first.disturbance_rad + first.lacks_disturbance_rad
            lacks_disturbance_rad /= part
    return ResponseState(
        boat.rudder_rad - over_rad * gone, beyond_rad, disturbance_rad, mean_rad, lacks_rad, lacks_disturbance_rad,
        evidence,
    )  # fmt: skip


INTERRUPTED, LOST, RECOVERED = 0, 1, 2  # reasons of a restart


def restart_all(b: Boats, reason: int) -> Boats:
    """Return the boats with new sums, and filters that fit the verdict."""
    return (
        restart(0, b[0], reason, b[0]), restart(1, b[1], reason, b[0]), restart(2, b[2], reason, b[0]),
        restart(3, b[3], reason, b[0]), restart(4, b[4], reason, b[0]), restart(5, b[5], reason, b[0]),
        restart(6, b[6], reason, b[0]), restart(7, b[7], reason, b[0]), restart(8, b[8], reason, b[0]),
        restart(9, b[9], reason, b[0]), restart(10, b[10], reason, b[0]), restart(11, b[11], reason, b[0]),
        restart(12, b[12], reason, b[0]), restart(13, b[13], reason, b[0]), restart(14, b[14], reason, b[0]),
        restart(15, b[15], reason, b[0]),
    )  # fmt: skip


def restart(number: int, boat: ResponseState, reason: int, first: ResponseState) -> ResponseState:
    """Return a boat with a new sum.

    After a loss, the filters are those of the nominal boat without a rudder; after a recovery, each is that of its boat
    with one.
    """
    beyond_rad, disturbance_rad, part = 0.0, boat.disturbance_rad, RESPONSES[number].part
    if reason == LOST:
        beyond_rad = first.beyond_rad + first.lacks_rad
        disturbance_rad = first.disturbance_rad - first.lacks_disturbance_rad
    elif reason == RECOVERED:
        beyond_rad = boat.beyond_rad - part * boat.lacks_rad
        disturbance_rad += part * boat.lacks_disturbance_rad
    return ResponseState(boat.rudder_rad, beyond_rad, disturbance_rad, boat.mean_rad, 0.0, 0.0, 0.0)
