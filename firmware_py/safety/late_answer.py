"""How late she answers the rudder, told by her turns.

A helm that swings her shows of her ship only what its own law makes of heading and rudder: whatever the cause, the
rudder stands to the turning as the law says. A turn that is ordered is another thing. So while she turns to a goal,
what she turns is compared with what two boats would: one as told, and one that answers later by LATE_S besides (three
lags of a third of it), each turning as much as suits it best. The likelihoods of the two, by what gusts and the
uncertainty of the heading make of it, give the evidence of a turn; it adds up within bounds, so that a few turns
outweigh what was.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.model.kt import KtModel, decay_over

SAMPLE_S: Final = 1.0
LATE_S: Final = 12.0
SPEED_MEMORY_S: Final = 300.0  # a turn that does not come is taken for lost way at first
FAR_RAD: Final = radians(8.0)  # from the goal: nearer, the helm answers the sea
LEAST_GAIN, MOST_GAIN = 0.25, 4.0  # of what the model turns
OTHERS_RAD: Final = radians(6.0)  # of rudder, that waves and gusts turn her as much as
UNSURE_S: Final = 4.0  # in which the heading errs by half its standard deviation
ALIKE_S: Final = 4.0  # for so long what is seen errs to one side
# Of a log-likelihood ratio. That she is as told weighs less: a swing has causes besides.
LEAST, MOST = -4.0, 4.0


class LateAnswerState(msgspec.Struct, frozen=True):
    """The last sample, the rudder as the boats feel it, what a turn has shown so far, and the evidence.

    `shown_as_told` and `shown_late` are the sums over the turn of what she turned, in rudder, by what the boat feels;
    `felt_as_told` and `felt_late` those of its square.
    """

    t_s: float | None = None
    heading_rad: float = 0.0
    rudder_rad: float = 0.0
    speed_m_s: float = 0.0
    first_rad: float = 0.0
    second_rad: float = 0.0
    third_rad: float = 0.0
    as_told_rad: float = 0.0
    late_rad: float = 0.0
    shown_as_told: float = 0.0
    felt_as_told: float = 0.0
    shown_late: float = 0.0
    felt_late: float = 0.0
    evidence: float = 0.0


def update(
    model: KtModel,
    state: LateAnswerState,
    heading_rad: float,
    rudder_rad: float,
    speed_m_s: float,
    now_s: float,
    *,
    turns: bool,
) -> LateAnswerState:
    """Take a sample in, once a second: the heading, the rudder from where she runs straight, the speed."""
    if state.t_s is None:
        return replace(state, t_s=now_s, heading_rad=heading_rad, rudder_rad=rudder_rad, speed_m_s=speed_m_s)
    step_s = now_s - state.t_s
    if step_s < SAMPLE_S:
        return state
    slow_m_s = state.speed_m_s + (1.0 - math.exp(-step_s / SPEED_MEMORY_S)) * (speed_m_s - state.speed_m_s)
    ratio = max(slow_m_s / model.speed_m_s, 0.1)
    gone = 1.0 - decay_over(step_s, model.turning_lag_s / ratio)
    part = 1.0 - math.exp(-step_s / (LATE_S / 3.0))
    first_rad = state.first_rad + part * (state.rudder_rad - state.first_rad)
    second_rad = state.second_rad + part * (state.first_rad - state.second_rad)
    third_rad = state.third_rad + part * (state.second_rad - state.third_rad)
    as_told_rad = state.as_told_rad + gone * (state.rudder_rad - state.as_told_rad)
    late_rad = state.late_rad + gone * (state.third_rad - state.late_rad)
    shown_as_told, felt_as_told = state.shown_as_told, state.felt_as_told
    shown_late, felt_late = state.shown_late, state.felt_late
    if turns:
        shown_rad = wrap_pi(heading_rad - state.heading_rad) / (model.turning_ability_1_s * ratio * step_s)
        shown_as_told, felt_as_told = shown_as_told + shown_rad * as_told_rad, felt_as_told + as_told_rad * as_told_rad
        shown_late, felt_late = shown_late + shown_rad * late_rad, felt_late + late_rad * late_rad
    return LateAnswerState(
        now_s, heading_rad, rudder_rad, slow_m_s, first_rad, second_rad, third_rad, as_told_rad, late_rad,
        shown_as_told, felt_as_told, shown_late, felt_late, state.evidence,
    )  # fmt: skip


def turned(model: KtModel, state: LateAnswerState, heading_sd_rad: float) -> LateAnswerState:
    """End a stretch on one side of the goal: add the evidence of what was seen of a turn in it, and forget that."""
    if state.felt_as_told == 0.0:
        return state
    ratio = max(state.speed_m_s / model.speed_m_s, 0.1)
    unsure_rad = 0.5 * heading_sd_rad / (UNSURE_S * model.turning_ability_1_s * ratio)
    weight = SAMPLE_S / (2.0 * ALIKE_S * (OTHERS_RAD * OTHERS_RAD + unsure_rad * unsure_rad))
    late = explained(state.shown_late, state.felt_late) - explained(state.shown_as_told, state.felt_as_told)
    evidence = clamp(state.evidence + weight * late, LEAST, MOST)
    return replace(state, shown_as_told=0.0, felt_as_told=0.0, shown_late=0.0, felt_late=0.0, evidence=evidence)


def explained(shown: float, felt: float) -> float:
    """Return how much less the squares sum up to once what she turned is explained by what the boat feels."""
    gain = clamp(shown / max(felt, 1e-9), LEAST_GAIN, MOST_GAIN)
    return gain * (2.0 * shown - gain * felt)
