"""What the rudder did between two samples: the motion that follows tells.

A measured rudder goes on between samples, and a straight line is the best that can be said of it. A
logged command, or a simulated rudder, jumps: some loggers write what will hold until the next row,
others what has held since the last one. To take one for another shifts the rudder by half an
interval or a whole one, which goes into T: small, but many standard errors in a long log.

Only a rudder that is seen to jump can be taken for one that does. The motion alone does not tell: where an autopilot
steers, the rudder has moved by the next row because of what pushed her since this one, and that looks as if it did
nothing until then. In a log kept on course by ourselves T came out a third too short by that, with a certainty of ten
standard errors. Half an interval that is missed in a rudder that does not jump shows as a dead time (left_out.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hil.lab.identify.fit import Fit, error_pieces
from hil.lab.identify.noise import fit_noise
from hil.lab.identify.refine import refine
from hil.lab.identify.stretch import Data, Timing, timed

NEEDED = 1.0  # in -2 ln likelihood, against a ramp
MATTERS = 0.1  # of the standard error of T
JUMPING = 0.5  # of all that the rudder travels


@dataclass(frozen=True, slots=True)
class TimingChoice:
    """What was taken, and why; empty where it makes no difference."""

    timing: Timing
    why: str


AS_RAMPS = TimingChoice(Timing.RAMP, "")


def choose_timing(data: Data, found: Fit, tell: Callable[[], None]) -> tuple[TimingChoice, int]:
    """Return what the rudder does between samples, given a fit that takes it for ramps, and the evaluations spent."""
    if not _jumps(data):
        return AS_RAMPS, 0
    usual_s = data.usual_step_s
    lag_se_s = float(found.physical[1]) * math.sqrt(max(float(found.covariance[1, 1]), 0.0))
    if not 0.5 * usual_s > MATTERS * lag_se_s:
        return AS_RAMPS, 0
    spent, errors = 0, {Timing.RAMP: error_pieces(found.problem, found.state)}
    for timing in (Timing.HELD, Timing.AHEAD):
        problem = replace(found.problem, data=timed(found.problem.data, timing))
        refined = refine(problem, found.state, tell)
        spent += refined.evaluations
        errors[timing] = error_pieces(problem, refined.state)
    noise = fit_noise(errors[Timing.RAMP])
    surprises = {timing: noise.surprise(pieces) for timing, pieces in errors.items()}
    gains = {timing: surprises[Timing.RAMP] - surprises[timing] for timing in (Timing.HELD, Timing.AHEAD)}
    best = max(gains, key=lambda timing: gains[timing])
    if gains[best] > NEEDED:
        why = f"the rudder {best.value} (by {gains[best]:.0f} in -2 ln likelihood)"
        return TimingChoice(best, why), spent
    return TimingChoice(Timing.RAMP, f"the rudder {Timing.RAMP.value} (against steps: {-gains[best]:+.0f})"), spent


def _jumps(data: Data) -> bool:
    """Whether the rudder mostly moves from one sample to the next and stands still before and after."""
    total = lone = 0.0
    for stretch in data.stretches:
        moves = np.abs(np.diff(stretch.rudder_rad))
        still = np.concatenate(([True], moves < 1e-9, [True]))
        total += float(np.sum(moves))
        lone += float(np.sum(moves[still[:-2] & still[2:]]))
    return lone > JUMPING * total
