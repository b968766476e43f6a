"""Whether she answers the rudder: a sequential test (Page's, 1954) of boats that do against one that does not.

Each of BOATS turns by a good part of what her model says, late and slower or not, or the other way; one more is turned
by nothing but what else turns her: trim, wind and current, a rudder angle that wanders about a mean as a first-order
Gauss-Markov process. A Kalman filter of two states, the heading and that angle, says for each boat how likely what is
seen is; its gain is the same for all, so that of each boat without a rudder only the difference to her is kept. The
ratio of the likelihoods is summed up from where it last spoke for her. Once it speaks against every boat, she does not
answer. From then on it is summed up for her, until it speaks for one.

How much that angle wanders is learned while she answers, so the test waits longer in gusts, or where her model is
poor, and less in a calm. A boat that turns the other way is compared with what the first makes of a lost rudder: her
own takes the rudder for wind.

The likelihood of each boat is that of what comes next, given all that was: so it holds though the rudder answers the
heading. A model that is wrong would speak where the rudder holds her against gusts; so what speaks against a boat
counts only while she is far off and the rudder is to bring her there.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import clamp, radians
from firmware_py.model.kt import KtModel, decay_over

# The boats that answer: after so many blocks, by how many times the turning lag, by what part of the turn that the
# model expects, and by what part at least. The first is as told.
BOATS: Final = (
    *((blocks, lags, 1.0, 0.6) for lags in (1.0, 3.0) for blocks in (0, 2, 4, 6)),
    *((blocks, lags, 0.5, 0.5) for lags in (1.0, 3.0) for blocks in (0, 4)),
    *((blocks, lags, -1.0, -0.6) for lags in (1.0, 3.0) for blocks in (0, 4)),
)
SPEED_S: Final = 200.0  # the mean of the speed, for a turn that does not come is taken for lost way at first
FAR_OFF_RAD: Final = radians(10.0)
# What else turns her, as an angle of the rudder: how far from its mean at first, for how long it stays there, and for
# how long both are learned.
OTHERS_RAD: Final = radians(2.0)
OTHERS_S: Final = 100.0
LEARNED_S: Final = 1800.0
GUSTS_SQUARE_S: Final = radians(6.0) ** 2  # what turns her besides, of a second
UNSURE: Final = 0.7  # of the heading's standard deviation, from block to block
ENOUGH: Final = 7.0  # of a log-likelihood ratio; 6.8 were reached in 38 days of turns in eleven seas
AGAIN: Final = 20.0  # that she answers again: what turned her without a rudder looks like it


class Boat(msgspec.Struct, frozen=True):
    """One of BOATS: the rudder as she feels it, the filter, and what speaks against her.

    `beyond_rad` is how far the heading is beyond what her filter says; `other_rad` what else turns her, with its mean.
    `lacks_rad` and `lacks_other_rad`: by how much heading and that would be less without a rudder since the sum began,
    if all of the turn were its. `evidence`: the sum, against her or, once she does not answer, for her.
    """

    felt_rad: float = 0.0
    beyond_rad: float = 0.0
    other_rad: float = 0.0
    mean_rad: float = 0.0
    lacks_rad: float = 0.0
    lacks_other_rad: float = 0.0
    evidence: float = 0.0


class RudderAnswerState(msgspec.Struct, frozen=True):
    """The rudder of the latest blocks, newest first, the mean speed, the boats and the verdict.

    `seen_s` and `near_s`: for how long the speed has been seen, and she near her goal. Of the filters: the variances of
    the heading (None before the first block) and of what else turns her, the covariance, and `wander`, the mean square
    of how far that is from its mean.
    """

    rudders_rad: tuple[float, ...] = (0.0,) * (1 + max(blocks for blocks, _, _, _ in BOATS))
    speed_m_s: float = 0.0
    seen_s: float = 0.0
    near_s: float = 0.0
    heading_variance: float | None = None
    covariance: float = 0.0
    other_variance: float = OTHERS_RAD**2
    wander: float = OTHERS_RAD**2
    boats: tuple[Boat, ...] = (Boat(),) * len(BOATS)
    missing: bool = False


class Seen(msgspec.Struct, frozen=True):
    """A block as all boats see it: the turn, its length, the model's lag, what a rudder turns in it, and the filter's.

    `near`: whether she is about where she is to be. `side`: of her goal; 0 by hand.
    """

    turned_rad: float
    step_s: float
    lag_s: float
    by_rudder: float
    keep: float
    by_heading: float
    by_other: float
    variance: float
    near: bool
    side: float


def interrupted(state: RudderAnswerState) -> RudderAnswerState:
    """Begin the sums anew, with the verdict and what has been learned: the heading has not been seen for a while."""
    boats = tuple(Boat(boat.felt_rad, 0.0, boat.other_rad, boat.mean_rad) for boat in state.boats)
    return replace(state, heading_variance=None, covariance=0.0, boats=boats)


def update(
    model: KtModel,
    state: RudderAnswerState,
    block: tuple[float, float, float],
    heading_sd_rad: float,
    speed_m_s: float,
    error_rad: float | None,
) -> RudderAnswerState:
    """Take a block in: its mean rudder, what she turned in it, and how long it was; an error of None is by hand."""
    rudder_rad, turned_rad, step_s = block
    near = error_rad is not None and abs(error_rad) < FAR_OFF_RAD
    seen_s = min(state.seen_s + step_s, SPEED_S)
    speed_m_s = state.speed_m_s + step_s / seen_s * (speed_m_s - state.speed_m_s)
    model = model.at_speed(clamp(speed_m_s, 0.1 * model.speed_m_s, 10.0 * model.speed_m_s))
    by_rudder, keep = model.turning_ability_1_s * step_s, math.exp(-step_s / OTHERS_S)
    unsure = (UNSURE * heading_sd_rad) ** 2
    heading = unsure if state.heading_variance is None else state.heading_variance
    heading += by_rudder * (2.0 * state.covariance + by_rudder * (state.other_variance + GUSTS_SQUARE_S / step_s))
    covariance = keep * (state.covariance + by_rudder * state.other_variance)
    other = keep * keep * state.other_variance + (1.0 - keep * keep) * state.wander
    variance = heading + unsure
    by_heading, by_other = heading / variance, covariance / variance
    state = replace(
        state,
        rudders_rad=(rudder_rad, *state.rudders_rad[:-1]),
        speed_m_s=speed_m_s,
        seen_s=seen_s,
        near_s=min(state.near_s + step_s, LEARNED_S) if near else state.near_s,
        heading_variance=heading * (1.0 - by_heading),
        covariance=covariance * (1.0 - by_heading),
        other_variance=other - by_other * covariance,
    )
    side = 0.0 if error_rad is None else math.copysign(1.0, error_rad)
    seen = Seen(
        turned_rad, step_s, model.turning_lag_s, by_rudder, keep, by_heading, by_other, variance, near, side
    )  # fmt: skip
    boats: list[Boat] = []
    for kind, boat in zip(BOATS, state.boats, strict=True):
        boats.append(_taken(state, kind, boat, seen, boats))
    first = boats[0]
    if first.evidence == 0.0 and not state.missing:
        square = (first.other_rad - first.mean_rad) ** 2 + state.other_variance
        state = replace(state, wander=state.wander + step_s / LEARNED_S * (square - state.wander))
    return _judged(replace(state, boats=tuple(boats)))


def _taken(
    state: RudderAnswerState, kind: tuple[int, float, float, float], boat: Boat, seen: Seen, before: list[Boat]
) -> Boat:
    """Return a boat after a block, as those `before` her are already."""
    (late, lags, part, least), step_s, by_rudder = kind, seen.step_s, seen.by_rudder
    lag_s, over_rad = lags * seen.lag_s, boat.felt_rad - state.rudders_rad[late]
    gone = 1.0 - decay_over(step_s, lag_s)
    rudder_rad = state.rudders_rad[late] + over_rad * gone * lag_s / step_s
    beyond_rad = boat.beyond_rad + seen.turned_rad - by_rudder * boat.other_rad
    lacks_rad = boat.lacks_rad + by_rudder * (boat.lacks_other_rad + rudder_rad)
    if state.missing:
        gained = 0.5 * (beyond_rad**2 - (beyond_rad - least * lacks_rad) ** 2) / seen.variance
    else:
        beyond_rad -= by_rudder * part * rudder_rad
        with_rad, without_rad = beyond_rad + (part - least) * lacks_rad, beyond_rad + part * lacks_rad
        gained = 0.5 * (with_rad**2 - without_rad**2) / seen.variance
        if seen.near or seen.side * rudder_rad < 0.0:
            gained = min(gained, 0.0)
    other_rad = boat.mean_rad + seen.keep * (boat.other_rad - boat.mean_rad) + seen.by_other * beyond_rad
    lacks_other_rad = seen.keep * boat.lacks_other_rad - seen.by_other * lacks_rad
    beyond_rad, lacks_rad = (1.0 - seen.by_heading) * beyond_rad, (1.0 - seen.by_heading) * lacks_rad
    mean_rad, evidence = boat.mean_rad, max(boat.evidence + gained, 0.0)
    if seen.near and not state.missing:
        mean_rad += step_s / max(state.near_s, OTHERS_S) * (other_rad - mean_rad)
    if evidence == 0.0:
        lacks_rad = lacks_other_rad = 0.0
        if part < 0.0 and not state.missing:
            lacks_rad = (before[0].beyond_rad + before[0].lacks_rad - beyond_rad) / part
            lacks_other_rad = (other_rad - before[0].other_rad + before[0].lacks_other_rad) / part
    return Boat(boat.felt_rad - over_rad * gone, beyond_rad, other_rad, mean_rad, lacks_rad, lacks_other_rad, evidence)


def _judged(state: RudderAnswerState) -> RudderAnswerState:
    """Change the verdict once there is enough to tell; the filters go on as those of what it is now."""
    pairs = tuple(zip(BOATS, state.boats, strict=True))
    if not state.missing:
        if min(boat.evidence for boat in state.boats) <= ENOUGH:
            return state
        first = state.boats[0]
        beyond_rad, other_rad = first.beyond_rad + first.lacks_rad, first.other_rad - first.lacks_other_rad
        boats = tuple(Boat(boat.felt_rad, beyond_rad, other_rad, boat.mean_rad) for boat in state.boats)
        return replace(state, missing=True, boats=boats)
    if max(boat.evidence for (_, _, part, _), boat in pairs if part > 0.0) <= AGAIN:
        return state
    boats = tuple(
        Boat(
            boat.felt_rad,
            boat.beyond_rad - part * boat.lacks_rad,
            boat.other_rad + part * boat.lacks_other_rad,
            boat.mean_rad,
        )
        for (_, _, part, _), boat in pairs
    )
    return replace(state, missing=False, boats=boats)
