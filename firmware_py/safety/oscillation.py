"""Oscillation of the helm: heading and rudder swing to and fro by themselves, because she is not as she was told.

It is seen in rudder and heading alone. The heading error is cut where it changes sides. A half swing counts when the
error was larger than the estimate of the heading makes it, the rudder went to the same side with it, nobody turned
the goal meanwhile, and it lasted as long as a swing of this boat can last: waves are faster, wind and trim slower.
It counts by the square of its size, as unlikely sizes do, up to what two of them are enough with: the heading's by
what it is uncertain, the rudder's by what wind and waves ask for, and by what seems to push her the way the rudder
stands: a boat that does not answer yet looks so. Several in a row, about as long as each other and none of them much
smaller than the one before, are an oscillation; a turn that is overshot dies away. The last of them need not be over.

What her turns have told of how late she answers (late_answer.py) counts with them: of a boat that is late, one plain
half swing is enough.

Each time, and while she swings on, the helm is softened by a step. Once it swings no more it stays so for a while, and
then grows as stiff as it was over tens of minutes. If she swings again by that, or before long, it stays soft for twice
as long as it was: a boat that is not as she was told will not be so in half an hour either.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel
from firmware_py.safety import late_answer
from firmware_py.safety.late_answer import LateAnswerState

LEAST_RAD: Final = radians(1.5)
LEAST_SPREADS: Final = 2.0  # of the heading's standard deviation
LEAST_RUDDER_RAD: Final = radians(2.0)  # well beyond the band in which the rudder waits
RETURN_SHARE: Final = 0.2  # of the least error: so far on the other side it must be to have changed sides
SHORTEST_LAGS, LONGEST_LAGS = 1.5, 16.0  # a half swing, by the turning lag that the model has
LONGEST_S: Final = 64.0  # that much at least, for what comes late comes as late at any speed
SHORTEST_WAVES: Final = 0.75  # and by the period of the waves
ALIKE_LENGTH: Final = 1.5  # by how many times one may be longer or shorter than the one before
GROWN, SHRUNK = 2.0, 0.7  # and by how many times larger or smaller
# The size that counts once. Nothing was told in 96 hours of turns in gusts, which look most like it.
PLAIN_SPREADS: Final = 2.5
PLAIN_RUDDER_RAD: Final = radians(10.0)
PLAIN_PUSH_RAD: Final = radians(3.0)
MOST_COUNT, ENOUGH = 4.0, 7.0
SOFTER: Final = 8.0
SOFTEST: Final = 16.0  # where 8 was not enough; by more, a turn takes too long
QUIET_HALVES: Final = ALIKE_LENGTH  # so many half swings without one that counts: one that is alike would be over
PATIENT_HALVES: Final = 2.0  # so many of them a softened helm is given to end it, before it is softened more
HOLD_S, MOST_HOLD_S = 600.0, 86_400.0
AGAIN_HOLDS: Final = 8.0  # at the first hold that is half an hour as stiff as delivered
RELAX_S: Final = 1200.0  # by a factor of e


class OscillationSettings(msgspec.Struct, frozen=True):
    """The boat's model."""

    model: KtModel

    @classmethod
    def of(cls, parameters: ParameterSet) -> OscillationSettings:
        """Read the settings from the parameters."""
        return cls(model=KtModel.of(parameters))


class OscillationInput(msgspec.Struct, frozen=True):
    """What a tick shows: the error and the goal while the boat is steered for one, else None, and the rest.

    `trim_rad` is the rudder with which she runs straight in the mean, `push_rad` by how much it is another just now.
    """

    error_rad: float | None
    goal_rad: float | None
    heading_sd_rad: float
    rudder_rad: float
    trim_rad: float
    push_rad: float
    speed_m_s: float
    wave_period_s: float


class HalfSwing(msgspec.Struct, frozen=True):
    """A stretch of the error on one side: since when, which side, the goal, how far, and with it rudder and push."""

    begun_s: float
    side: int
    goal_rad: float
    peak_rad: float = 0.0
    rudder_rad: float = -math.pi
    push_rad: float = -math.pi
    turned: bool = False  # the goal


class OscillationState(msgspec.Struct, frozen=True):
    """The half swing under way, the last that counted with what those in a row count, and what came of them.

    `softness`: by what factor the helm is softer than as delivered, `hold_s`: how long it stays so after `swung_s`,
    when the last one of an oscillation ended. `softened_s`: when the last step was taken. `goal_rad` and `updated_s`:
    of the last tick.
    """

    half: HalfSwing | None = None
    goal_rad: float = 0.0
    length_s: float = 0.0
    peak_rad: float = 0.0
    halves: float = 0.0
    oscillating: bool = False
    softness: float = 1.0
    hold_s: float = 0.0
    swung_s: float = 0.0
    softened_s: float = -math.inf
    updated_s: float | None = None
    late: LateAnswerState = LateAnswerState()


def update(
    settings: OscillationSettings, state: OscillationState, given: OscillationInput, now_s: float
) -> OscillationState:
    """Take a tick in."""
    state = _relaxed(state, now_s)
    error_rad, goal_rad = given.error_rad, given.goal_rad
    if error_rad is None or goal_rad is None or not math.isfinite(error_rad + goal_rad + given.rudder_rad):
        late = LateAnswerState(evidence=state.late.evidence)
        return replace(state, half=None, halves=0.0, oscillating=False, updated_s=now_s, late=late)
    half, rudder_rad, goal_before_rad = state.half, given.rudder_rad - given.trim_rad, state.goal_rad
    turns = half is not None and half.turned and abs(error_rad) >= late_answer.FAR_RAD
    heading_rad = goal_rad - error_rad
    late = late_answer.update(settings.model, state.late, heading_rad, rudder_rad, given.speed_m_s, now_s, turns=turns)
    if half is None:
        begun = HalfSwing(now_s, 1 if error_rad >= 0.0 else -1, goal_rad, turned=True)
        return replace(state, goal_rad=goal_rad, updated_s=now_s, late=late, half=begun)
    least_rad = max(LEAST_RAD, LEAST_SPREADS * given.heading_sd_rad)
    if error_rad * half.side > -RETURN_SHARE * least_rad:
        half = HalfSwing(
            half.begun_s,
            half.side,
            half.goal_rad,
            max(half.peak_rad, error_rad * half.side),
            max(half.rudder_rad, rudder_rad * half.side),
            max(half.push_rad, given.push_rad * half.side),
            half.turned or abs(wrap_pi(goal_rad - half.goal_rad)) > 0.5 * LEAST_RAD,
        )
        state = replace(state, goal_rad=goal_rad, updated_s=now_s, late=late, half=half)
        if state.halves == 0.0 or half.turned:
            return state
        return _counted(settings, state, half, given, now_s, lasts=True)
    state = _counted(settings, replace(state, late=late), half, given, now_s, lasts=False)
    late = late_answer.turned(settings.model, state.late, given.heading_sd_rad)
    jumped = abs(wrap_pi(goal_rad - goal_before_rad)) > LEAST_RAD
    begun = HalfSwing(now_s, -half.side, goal_rad, turned=jumped)
    return replace(state, goal_rad=goal_rad, updated_s=now_s, late=late, half=begun)


def _counted(
    settings: OscillationSettings,
    state: OscillationState,
    half: HalfSwing,
    given: OscillationInput,
    now_s: float,
    *,
    lasts: bool,
) -> OscillationState:
    """Count a half swing, or one that lasts so far, and soften the helm by a step when that makes an oscillation."""
    length_s = now_s - half.begun_s
    count = _count_of(settings, half, given, length_s)
    if count == 0.0:
        return state if lasts else replace(state, halves=0.0)
    alike = (
        state.halves > 0.0
        and length_s <= ALIKE_LENGTH * state.length_s
        and (lasts or state.length_s <= ALIKE_LENGTH * length_s)
        and SHRUNK * state.peak_rad <= half.peak_rad <= GROWN * state.peak_rad
    )
    if lasts and not alike:
        return state
    halves = state.halves + count if alike else count
    if halves + state.late.evidence >= ENOUGH:
        softness, hold_s, softened_s = state.softness, state.hold_s, state.softened_s
        if softness < SOFTEST and half.begun_s - softened_s > PATIENT_HALVES * state.length_s:
            softness, softened_s = min(softness * SOFTER, SOFTEST), now_s
            if not state.oscillating:
                again = now_s - state.swung_s < AGAIN_HOLDS * hold_s
                hold_s = min(2.0 * hold_s, MOST_HOLD_S) if again else HOLD_S
        # What her turns had told has been heeded.
        late = replace(state.late, evidence=0.0)
        state = replace(
            state, oscillating=True, swung_s=now_s, softness=softness, hold_s=hold_s, softened_s=softened_s, late=late
        )
    return state if lasts else replace(state, length_s=length_s, peak_rad=half.peak_rad, halves=halves)


def _count_of(settings: OscillationSettings, half: HalfSwing, given: OscillationInput, length_s: float) -> float:
    """Return how much a half swing of such a length counts."""
    if half.turned or half.peak_rad < max(LEAST_RAD, LEAST_SPREADS * given.heading_sd_rad):
        return 0.0
    if half.rudder_rad < LEAST_RUDDER_RAD or half.push_rad <= 0.0:
        return 0.0
    lag_s = settings.model.at_speed(max(given.speed_m_s, 0.1 * settings.model.speed_m_s)).turning_lag_s
    shortest_s = max(SHORTEST_LAGS * lag_s, SHORTEST_WAVES * given.wave_period_s)
    if not shortest_s <= length_s <= max(LONGEST_LAGS * lag_s, LONGEST_S):
        return 0.0
    plain_rad = max(PLAIN_SPREADS * given.heading_sd_rad, LEAST_RAD)
    size = min(half.peak_rad / plain_rad, half.rudder_rad / PLAIN_RUDDER_RAD, half.push_rad / PLAIN_PUSH_RAD)
    return min(size * size, MOST_COUNT)


def _relaxed(state: OscillationState, now_s: float) -> OscillationState:
    """Return the state with an oscillation over that has not been seen for a while, and the helm stiffer after it."""
    if state.softness == 1.0 and not state.oscillating:
        return state
    step_s = 0.0 if state.updated_s is None else clamp(now_s - state.updated_s, 0.0, 1.0)
    quiet_s = now_s - state.swung_s
    oscillating = state.oscillating and quiet_s < QUIET_HALVES * state.length_s
    softness = state.softness
    if quiet_s > state.hold_s:
        softness = max(softness * math.exp(-step_s / RELAX_S), 1.0)
    return replace(state, oscillating=oscillating, softness=softness)
