"""Detection of a delayed yaw response (firmware_py/safety/late_answer.py) for compiled code."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.model.kt import decay_over
from hil.lab.compiled import compiled
from hil.lab.twin.helm import E_HEADING_SD, E_SPEED, M_K, M_SPEED, M_T
from hil.lab.twin.kalman import Floats

SAMPLE_S, LATE_S, SPEED_MEMORY_S = 1.0, 12.0, 300.0
FAR_RAD = radians(8.0)
LEAST_GAIN, MOST_GAIN = 0.25, 4.0
OTHERS_RAD = radians(6.0)
UNSURE_S, ALIKE_S = 4.0, 4.0
LEAST, MOST = -4.0, 4.0

# What is remembered; there is no sample where its time is NaN.
(T, HEADING, RUDDER, SPEED, FIRST, SECOND, THIRD, AS_TOLD, LATE,
 SHOWN_AS_TOLD, FELT_AS_TOLD, SHOWN_LATE, FELT_LATE, EVIDENCE) = range(14)  # fmt: skip
LATE_STATES = 14


@compiled
def begin_watch(s: Floats) -> None:
    """Set the state before the first tick."""
    s[T] = np.nan


@compiled
def restart(s: Floats) -> None:
    """Forget all but the evidence, while there is no heading to steer for."""
    for number in range(EVIDENCE):
        s[number] = 0.0
    s[T] = np.nan


@compiled
def update(s: Floats, turns: bool, e: Floats, heading_rad: float, rudder_rad: float, now_s: float) -> None:
    """Take a sample once a second."""
    if math.isnan(s[T]):
        s[SPEED] = e[E_SPEED]
    elif now_s - s[T] >= SAMPLE_S:
        feel(s, turns, e, heading_rad, now_s - s[T])
    else:
        return
    s[T], s[HEADING], s[RUDDER] = now_s, heading_rad, rudder_rad


@compiled
def feel(s: Floats, turns: bool, e: Floats, heading_rad: float, step_s: float) -> None:
    """Propagate both models to a sample, and sum up what was turned."""
    s[SPEED] += (1.0 - math.exp(-step_s / SPEED_MEMORY_S)) * (e[E_SPEED] - s[SPEED])
    ratio = max(s[SPEED] / e[M_SPEED], 0.1)
    gone = 1.0 - decay_over(step_s, e[M_T] / ratio)
    part = 1.0 - math.exp(-step_s / (LATE_S / 3.0))
    first_rad, second_rad, third_rad = s[FIRST], s[SECOND], s[THIRD]
    s[FIRST] = first_rad + part * (s[RUDDER] - first_rad)
    s[SECOND] = second_rad + part * (first_rad - second_rad)
    s[THIRD] = third_rad + part * (second_rad - third_rad)
    s[AS_TOLD] += gone * (s[RUDDER] - s[AS_TOLD])
    s[LATE] += gone * (third_rad - s[LATE])
    if turns:
        shown_rad = wrap_pi(heading_rad - s[HEADING]) / (e[M_K] * ratio * step_s)
        s[SHOWN_AS_TOLD] += shown_rad * s[AS_TOLD]
        s[FELT_AS_TOLD] += s[AS_TOLD] * s[AS_TOLD]
        s[SHOWN_LATE] += shown_rad * s[LATE]
        s[FELT_LATE] += s[LATE] * s[LATE]


@compiled
def explained(shown: float, felt: float) -> float:
    """Return how much less the squares sum up to once what the boat turned is explained by what a model turns."""
    gain = clamp(shown / max(felt, 1e-9), LEAST_GAIN, MOST_GAIN)
    return gain * (2.0 * shown - gain * felt)


@compiled
def turned(s: Floats, e: Floats) -> None:
    """End a stretch on one side of the goal: add the evidence of a turn in it, and forget that."""
    if s[FELT_AS_TOLD] == 0.0:
        return
    ratio = max(s[SPEED] / e[M_SPEED], 0.1)
    unsure_rad = 0.5 * e[E_HEADING_SD] / (UNSURE_S * e[M_K] * ratio)
    weight = SAMPLE_S / (2.0 * ALIKE_S * (OTHERS_RAD * OTHERS_RAD + unsure_rad * unsure_rad))
    late = explained(s[SHOWN_LATE], s[FELT_LATE]) - explained(s[SHOWN_AS_TOLD], s[FELT_AS_TOLD])
    s[EVIDENCE] = clamp(s[EVIDENCE] + weight * late, LEAST, MOST)
    s[SHOWN_AS_TOLD] = s[FELT_AS_TOLD] = s[SHOWN_LATE] = s[FELT_LATE] = 0.0
