"""Oscillation of the helm: heading and rudder swing to and fro by themselves, because she is not as she was told.

It is seen in rudder and heading alone. The heading error is cut where it changes sides. A half swing counts when the
error was larger than the estimate of the heading makes it, the rudder went to the same side with it, nobody turned
the goal meanwhile, and it lasted as long as a swing of this boat can last: waves are faster, wind and trim slower.
It counts by the square of its size, as unlikely sizes do, up to what two of them are enough with: the heading's by
what it is uncertain, the rudder's by what wind and waves ask for. Several in a row, about as long as each other and
none of them much smaller than the one before, are an oscillation; a turn that is overshot dies away.

Each time, the helm is softened by a step. Once it swings no more it stays so for a while, and then grows as stiff as
it was over tens of minutes.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.record_class import dataclass
from firmware_py.common.record_copy import replace
from firmware_py.model.kt import KtModel

LEAST_RAD: Final = radians(1.5)
LEAST_SPREADS: Final = 2.0  # of the heading's standard deviation
LEAST_RUDDER_RAD: Final = radians(2.0)  # well beyond the band in which the rudder waits
RETURN_SHARE: Final = 0.2  # of the least error: so far on the other side it must be to have changed sides
SHORTEST_LAGS, LONGEST_LAGS = 1.5, 16.0  # a half swing, by the turning lag that the model has
LONGEST_S: Final = 64.0  # that much at least, for what comes late comes as late at any speed
SHORTEST_WAVES: Final = 0.75  # and by the period of the waves
ALIKE_LENGTH: Final = 1.5  # by how many times one may be longer or shorter than the one before
GROWN, SHRUNK = 2.0, 0.7  # and by how many times larger or smaller
# The size that counts once. In 24 hours of turns in each of twelve seas nothing was told with these; with 8 deg of
# rudder, gusts were taken for an oscillation.
PLAIN_SPREADS: Final = 2.5
PLAIN_RUDDER_RAD: Final = radians(10.0)
MOST_COUNT, ENOUGH = 4.0, 5.0
SOFTER: Final = 4.0
SOFTEST: Final = 8.0
QUIET_HALVES: Final = 2.0  # so many half swings without one that counts, and it is over
HOLD_S: Final = 600.0
RELAX_S: Final = 1200.0  # by a factor of e


@dataclass(frozen=True, slots=True)
class OscillationSettings:
    """The boat's model."""

    model: KtModel

    @classmethod
    def of(cls, parameters: ParameterSet) -> OscillationSettings:
        """Read the settings from the parameters."""
        return cls(model=KtModel.of(parameters))


@dataclass(frozen=True, slots=True)
class OscillationInput:
    """What a tick shows: the error and the goal while the boat is steered for one, else None, and the rest."""

    error_rad: float | None
    goal_rad: float | None
    heading_sd_rad: float
    rudder_rad: float
    trim_rad: float
    speed_m_s: float
    wave_period_s: float


@dataclass(frozen=True, slots=True)
class HalfSwing:
    """A stretch of the error on one side: since when, to which side, how far, the rudder with it, the goal."""

    begun_s: float
    side: int
    goal_rad: float
    peak_rad: float = 0.0
    rudder_rad: float = -math.pi
    turned: bool = False  # the goal


@dataclass(frozen=True, slots=True)
class OscillationState:
    """The half swing under way, the last that counted with what those in a row count, and what came of them.

    `softness`: by what factor the helm is softer than as delivered. `swung_s`: when the last one of an oscillation
    ended. `goal_rad` and `updated_s`: of the last tick.
    """

    half: HalfSwing | None = None
    goal_rad: float = 0.0
    length_s: float = 0.0
    peak_rad: float = 0.0
    halves: float = 0.0
    oscillating: bool = False
    softness: float = 1.0
    swung_s: float = 0.0
    updated_s: float | None = None


def update(
    settings: OscillationSettings, state: OscillationState, given: OscillationInput, now_s: float
) -> OscillationState:
    """Take a tick in."""
    state = _relaxed(state, now_s)
    error_rad, goal_rad = given.error_rad, given.goal_rad
    if error_rad is None or goal_rad is None or not math.isfinite(error_rad + goal_rad + given.rudder_rad):
        return replace(state, half=None, halves=0, oscillating=False)
    least_rad = max(LEAST_RAD, LEAST_SPREADS * given.heading_sd_rad)
    half, goal_before_rad = state.half, state.goal_rad
    if half is None:
        begun = HalfSwing(now_s, 1 if error_rad >= 0.0 else -1, goal_rad, turned=True)
        return replace(state, goal_rad=goal_rad, half=begun)
    if error_rad * half.side > -RETURN_SHARE * least_rad:
        turned = half.turned or abs(wrap_pi(goal_rad - half.goal_rad)) > 0.5 * LEAST_RAD
        beside_rad = (given.rudder_rad - given.trim_rad) * half.side
        peak_rad, rudder_rad = max(half.peak_rad, error_rad * half.side), max(half.rudder_rad, beside_rad)
        half = HalfSwing(half.begun_s, half.side, half.goal_rad, peak_rad, rudder_rad, turned)
        return replace(state, goal_rad=goal_rad, half=half)
    lag_s = settings.model.at_speed(max(given.speed_m_s, 0.1 * settings.model.speed_m_s)).turning_lag_s
    shortest_s = max(SHORTEST_LAGS * lag_s, SHORTEST_WAVES * given.wave_period_s)
    length_s = now_s - half.begun_s
    counts = (
        not half.turned
        and half.peak_rad >= least_rad
        and half.rudder_rad >= LEAST_RUDDER_RAD
        and shortest_s <= length_s <= max(LONGEST_LAGS * lag_s, LONGEST_S)
    )
    count = _count_of(half, given.heading_sd_rad) if counts else 0.0
    state = _counted(state, half.peak_rad, length_s, count, now_s)
    jumped = abs(wrap_pi(goal_rad - goal_before_rad)) > LEAST_RAD
    return replace(state, goal_rad=goal_rad, half=HalfSwing(now_s, -half.side, goal_rad, turned=jumped))


def _count_of(half: HalfSwing, heading_sd_rad: float) -> float:
    """Return how much a half swing counts."""
    size = min(half.peak_rad / max(PLAIN_SPREADS * heading_sd_rad, LEAST_RAD), half.rudder_rad / PLAIN_RUDDER_RAD)
    return min(size * size, MOST_COUNT)


def _counted(state: OscillationState, peak_rad: float, length_s: float, count: float, now_s: float) -> OscillationState:
    """Count a half swing that is over, and soften the helm when that makes an oscillation."""
    if count == 0.0:
        return replace(state, halves=0.0)
    alike = (
        state.halves > 0.0
        and max(length_s, state.length_s) <= ALIKE_LENGTH * min(length_s, state.length_s)
        and SHRUNK * state.peak_rad <= peak_rad <= GROWN * state.peak_rad
    )
    halves = (state.halves if alike else 0.0) + count
    state = replace(state, length_s=length_s, peak_rad=peak_rad, halves=halves)
    if halves < ENOUGH:
        return state
    return replace(state, oscillating=True, swung_s=now_s, softness=min(state.softness * SOFTER, SOFTEST))


def _relaxed(state: OscillationState, now_s: float) -> OscillationState:
    """Return the state with an oscillation over that has not been seen for a while, and the helm stiffer after it."""
    step_s = 0.0 if state.updated_s is None else clamp(now_s - state.updated_s, 0.0, 1.0)
    state = replace(state, updated_s=now_s)
    if state.softness == 1.0 and not state.oscillating:
        return state
    quiet_s = now_s - state.swung_s
    oscillating = state.oscillating and quiet_s < QUIET_HALVES * state.length_s
    softness = state.softness
    if quiet_s > HOLD_S:
        softness = max(softness * math.exp(-step_s / RELAX_S), 1.0)
    return replace(state, oscillating=oscillating, softness=softness)
