"""Heading and yaw rate from the compass and the measured rudder, by the fixed-gain observer (fixed_gain.py)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import HeadingSample, NorthReference
from firmware_py.estimate import fixed_gain
from firmware_py.estimate.deviation import Deviation, deviation_rad, read_deviation
from firmware_py.model.kt import KtModel, decay_over


class ObserverSettings(msgspec.Struct, frozen=True):
    """Time constant, compass corrections, time-out, and the K-T model, of which only the linear part is used.

    `offset_rad` and `deviations` are those of compass A and B.
    """

    tau_s: float
    offset_rad: tuple[float, float]
    deviations: tuple[Deviation, Deviation]
    declination_rad: float
    timeout_s: float
    model: KtModel
    yaw_rate_limit_rad_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> ObserverSettings:
        """Read the settings from the parameters."""
        model = KtModel.of(parameters)
        return cls(
            tau_s=parameters["EST_TAU_S"],
            offset_rad=(radians(parameters["CMP_OFFSET_DEG"]), radians(parameters["CMPB_OFFSET_DEG"])),
            deviations=(read_deviation(parameters, "CMP"), read_deviation(parameters, "CMPB")),
            declination_rad=radians(parameters["CMP_DECL_DEG"]),
            timeout_s=parameters["CMP_TIMEOUT_S"],
            model=model,
            yaw_rate_limit_rad_s=fixed_gain.yaw_rate_limit(
                model.turning_ability_1_s, radians(parameters["RUD_LIMIT_DEG"])
            ),
        )


class HeadingState(msgspec.Struct, frozen=True):
    """Heading and yaw rate at t_s; sample_t_s: time of the last sample, None before the first."""

    t_s: float = 0.0
    heading_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0
    sample_t_s: float | None = None
    roll_rad: float | None = None
    pitch_rad: float | None = None

    def is_fresh(self, now_s: float, timeout_s: float) -> bool:
        """Return whether there is a sample that is not older than the time-out."""
        return self.sample_t_s is not None and now_s - self.sample_t_s <= timeout_s


def true_heading_rad(settings: ObserverSettings, sample: HeadingSample) -> float:
    """Return the true heading of the boat by a sample, in [0, 2 pi)."""
    index = 1 if sample.source == 1 else 0
    declination_rad = settings.declination_rad if sample.reference is NorthReference.MAGNETIC else 0.0
    mounted_rad = sample.heading_rad + settings.offset_rad[index]
    return wrap_two_pi(mounted_rad + declination_rad + deviation_rad(settings.deviations[index], mounted_rad))


def predict(settings: ObserverSettings, state: HeadingState, t_s: float, rudder_rad: float) -> HeadingState:
    """Return the state at t_s by the exact solution of the linear K-T model, which is stable at any interval."""
    step_s = t_s - state.t_s
    if step_s <= 0.0:
        return state
    model = settings.model
    heading_rad, yaw_rate_rad_s = fixed_gain.predict(
        state.heading_rad,
        state.yaw_rate_rad_s,
        rudder_rad,
        step_s,
        decay_over(step_s, model.turning_lag_s),
        model.turning_ability_1_s,
        model.turning_lag_s,
    )
    return HeadingState(t_s, heading_rad, yaw_rate_rad_s, state.sample_t_s, state.roll_rad, state.pitch_rad)


def correct(settings: ObserverSettings, state: HeadingState, sample: HeadingSample, rudder_rad: float) -> HeadingState:
    """Return the state updated with a sample; the first one, and one after a gap, restart it."""
    measured_rad = true_heading_rad(settings, sample)
    if not math.isfinite(measured_rad) or not math.isfinite(sample.t_s):
        return state
    if not state.is_fresh(sample.t_s, settings.timeout_s):
        return HeadingState(sample.t_s, measured_rad, 0.0, sample.t_s, sample.roll_rad, sample.pitch_rad)
    predicted = predict(settings, state, sample.t_s, rudder_rad)
    step_s = sample.t_s - state.sample_t_s if state.sample_t_s is not None else 0.0
    heading_rad, yaw_rate_rad_s = fixed_gain.correct(
        predicted.heading_rad,
        predicted.yaw_rate_rad_s,
        measured_rad,
        step_s,
        math.exp(-max(step_s, 0.0) / settings.tau_s),
        settings.yaw_rate_limit_rad_s,
    )
    return HeadingState(predicted.t_s, heading_rad, yaw_rate_rad_s, sample.t_s, sample.roll_rad, sample.pitch_rad)


def update(
    settings: ObserverSettings,
    state: HeadingState,
    samples: Sequence[HeadingSample],
    rudder_rad: float,
    now_s: float,
) -> HeadingState:
    """Return the state at now_s, updated with the samples of a tick, oldest first."""
    for sample in samples:
        state = correct(settings, state, sample, rudder_rad)
    if not state.is_fresh(now_s, settings.timeout_s):
        return state
    return predict(settings, state, now_s, rudder_rad)
