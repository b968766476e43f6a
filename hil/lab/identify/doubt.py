"""By how much a fit may be off for reasons that are no noise: each a step of its values, one standard error long."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hil.lab.identify.damping import Damping
from hil.lab.identify.estimates import Estimates
from hil.lab.identify.fit import Fit
from hil.lab.identify.left_out import LeftOut
from hil.lab.identify.loop import Loop
from hil.lab.identify.recording import Floats

ANSWERED_BIAS = 0.25  # of what is unexplained: how far off K and T may be where the rudder answers it


def doubted(estimates: Estimates, fit: Fit, loop: Loop, left_out: LeftOut | None, damping: Damping | None) -> Estimates:
    """Return estimates whose errors allow for all that is no noise and may have led the fit astray.

    left_out, damping: a dead time or slack, and another damping; None where they do not show, or are not asked for.
    """
    steps = [*_answers(loop), _disagreement(fit), *([] if left_out is None else [left_out.moved])]
    if damping is not None:
        steps.append(damping.counted(np.sqrt(np.maximum(np.diag(estimates.covariance)[:2], 0.0))))
    by = np.array(steps)[:, list(estimates.free)]
    return replace(estimates, covariance=estimates.covariance + by.T @ by)


def _answers(loop: Loop) -> list[Floats]:
    """Return what a rudder that answers the waves does to ln K and ln T, which are half correlated then."""
    bias = ANSWERED_BIAS * (1.0 - loop.explained) if loop.answered else 0.0
    return [bias * np.array([1.0, 0.5, 0.0, 0.0]), bias * np.array([0.0, math.sqrt(0.75), 0.0, 0.0])]


def _disagreement(fit: Fit) -> Floats:
    """Return what it does to ln K and alpha r^2 that heading and yaw rate turn by different measures."""
    apart = math.log(fit.problem.data.rate_scale)
    return apart * np.array([1.0, 0.0, -2.0 * float(fit.state.point.values[2]), 0.0])
