"""Identification: estimate a model from recordings and judge it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from firmware_py.model.kt import KtModel
from hil.errors import UsageError
from hil.lab.compiled import compiling
from hil.lab.identify.fit import Fit, fit
from hil.lab.identify.predict import Errors, errors_of
from hil.lab.identify.recording import Recording
from hil.lab.identify.stretches import Data, prepare
from hil.lab.identify.verdict import Judgement, judge

MODELS = ("linear", "cubic", "auto")
SPEEDS = {"auto": None, "scaled": 1.0, "ignored": 0.0}  # exponent of the speed; None: estimated
CONSTANT_RUDDER_RANGE = 1e-9  # relative
MAX_SCALED_RUDDER_RAD = 0.5  # a command that is not an angle is scaled to this maximum, for which the prior is valid


@dataclass(frozen=True, slots=True)
class Identification:
    """Result of an identification; the model is valid at data.speed_m_s, None without recorded speed."""

    data: Data
    fit: Fit
    judgement: Judgement
    train: Errors
    validate: tuple[Errors, ...]
    name: str  # linear or cubic

    def model(self) -> KtModel:
        """Return the K-T model; an unknown speed is NaN."""
        gain, lag_s, cubic, offset, _ = self.fit.model().tolist()
        return KtModel(gain, lag_s, cubic, offset, math.nan if self.data.speed_m_s is None else self.data.speed_m_s)


def identify(
    train: Sequence[Recording],
    validate: Sequence[Recording] = (),
    *,
    model: str = "auto",
    speed: str = "auto",
    is_angle: bool = True,
    report: Callable[[], None] = lambda: None,
) -> Identification:
    """Identify K, T, alpha and delta0; raise UsageError for data without information.

    model: "linear" fixes alpha at zero, "cubic" and "auto" estimate it. is_angle: the rudder is an angle, not a command
    of another unit.
    """
    data = prepare(train)
    _check_motion(data)
    with compiling("the identification"):
        scale = 1.0 if is_angle else MAX_SCALED_RUDDER_RAD / float(np.max(np.abs(data.rudder_rad)))
        scaled = tuple(replace(stretch, rudder_rad=scale * stretch.rudder_rad) for stretch in data.stretches)
        result = fit(replace(data, stretches=scaled), cubic=model != "linear", exponent=SPEEDS[speed], report=report)
        result = result.per_unit(scale)
        errors = errors_of("train", result, data)
        others = tuple(
            errors_of(recording.name, result, prepare((recording,), data.speed_m_s, fitted=False))
            for recording in validate
        )
    judgement = judge(result, data, errors)
    return Identification(data, result, judgement, errors, others, "linear" if model == "linear" else "cubic")


def _check_motion(data: Data) -> None:
    rudder = data.rudder_rad
    low, high = float(np.min(rudder)), float(np.max(rudder))
    names = ", ".join(sorted({stretch.name for stretch in data.stretches}))
    columns = [column for stretch in data.stretches for column in (stretch.heading_rad, stretch.yaw_rate_rad_s)]
    if not any(float(np.ptp(column)) > 0.0 for column in columns if column is not None):
        raise UsageError(f"{names}: heading and yaw rate are constant; record a zigzag")
    if high - low <= CONSTANT_RUDDER_RANGE * max(abs(low), abs(high), 1.0):
        raise UsageError(
            f"{names}: constant rudder {low:g}: no information on the model; "
            "record a zigzag, or give a second file with another rudder angle"
        )
