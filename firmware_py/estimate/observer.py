"""Heading and yaw rate from the compass and the measured rudder.

A fading-memory observer with critical damping: the K-T model carries heading and yaw rate
from sample to sample, each sample corrects both. The gains 1 - theta^2 and (1 - theta)^2
with theta = exp(-dt / tau) put both poles at theta (Brookner, Tracking and Kalman Filtering
Made Easy, 1998, section 1.2.6), at whatever interval the samples come.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from firmware_py.common.angles import clamp, radians, wrap_pi, wrap_two_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.record_class import dataclass
from firmware_py.common.records import HeadingSample, NorthReference
from firmware_py.estimate.deviation import Deviation, deviation_of, deviation_rad
from firmware_py.model.kt import KtModel, decay_over, exact_step


@dataclass(frozen=True, slots=True)
class ObserverSettings:
    """Time constant, compass corrections, age limit and the model, of which the linear part is used.

    offset_rad and deviations (A to E of compass.deviation_rad) are those of compass A and B.
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
            deviations=(deviation_of(parameters, "CMP"), deviation_of(parameters, "CMPB")),
            declination_rad=radians(parameters["CMP_DECL_DEG"]),
            timeout_s=parameters["CMP_TIMEOUT_S"],
            model=model,
            # A yaw rate beyond several times full rudder's is noise, at any speed of the boat.
            yaw_rate_limit_rad_s=10.0 * model.turning_ability_1_s * radians(parameters["RUD_LIMIT_DEG"]) + radians(5.0),
        )


@dataclass(frozen=True, slots=True)
class HeadingState:
    """Heading and yaw rate at t_s, and when the last sample came; None before the first."""

    t_s: float = 0.0
    heading_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0
    sample_t_s: float | None = None
    roll_rad: float | None = None
    pitch_rad: float | None = None

    def fresh(self, now_s: float, timeout_s: float) -> bool:
        """Whether a sample came within the timeout."""
        return self.sample_t_s is not None and now_s - self.sample_t_s <= timeout_s


def true_heading_rad(settings: ObserverSettings, sample: HeadingSample) -> float:
    """Return the sample's heading of the hull from true north, in [0, 2 pi)."""
    number = 1 if sample.source == 1 else 0
    declination_rad = settings.declination_rad if sample.reference is NorthReference.MAGNETIC else 0.0
    mounted_rad = sample.heading_rad + settings.offset_rad[number]
    return wrap_two_pi(mounted_rad + declination_rad + deviation_rad(settings.deviations[number], mounted_rad))


def predict(settings: ObserverSettings, state: HeadingState, t_s: float, rudder_rad: float) -> HeadingState:
    """Carry the state to t_s by the linear K-T model, solved exactly, so stable at any interval."""
    step_s = t_s - state.t_s
    if step_s <= 0.0:
        return state
    lag_s = settings.model.turning_lag_s
    steady_rad_s = settings.model.turning_ability_1_s * rudder_rad
    decay = decay_over(step_s, lag_s)
    turned_rad, yaw_rate_rad_s = exact_step(state.yaw_rate_rad_s, steady_rad_s, decay, step_s, lag_s)
    return HeadingState(
        t_s,
        wrap_two_pi(state.heading_rad + turned_rad),
        yaw_rate_rad_s,
        state.sample_t_s,
        state.roll_rad,
        state.pitch_rad,
    )


def correct(settings: ObserverSettings, state: HeadingState, sample: HeadingSample, rudder_rad: float) -> HeadingState:
    """Take one sample in; the first one, or one after a gap, starts the state anew."""
    measured_rad = true_heading_rad(settings, sample)
    if not math.isfinite(measured_rad) or not math.isfinite(sample.t_s):
        return state
    if not state.fresh(sample.t_s, settings.timeout_s):
        return HeadingState(sample.t_s, measured_rad, 0.0, sample.t_s, sample.roll_rad, sample.pitch_rad)
    predicted = predict(settings, state, sample.t_s, rudder_rad)
    step_s = sample.t_s - state.sample_t_s if state.sample_t_s is not None else 0.0
    innovation_rad = wrap_pi(measured_rad - predicted.heading_rad)
    theta = math.exp(-max(step_s, 0.0) / settings.tau_s)
    yaw_rate_rad_s = predicted.yaw_rate_rad_s
    if step_s > 0.0:
        yaw_rate_rad_s += (1.0 - theta) * (1.0 - theta) * innovation_rad / step_s
    return HeadingState(
        predicted.t_s,
        wrap_two_pi(predicted.heading_rad + (1.0 - theta * theta) * innovation_rad),
        clamp(yaw_rate_rad_s, -settings.yaw_rate_limit_rad_s, settings.yaw_rate_limit_rad_s),
        sample.t_s,
        sample.roll_rad,
        sample.pitch_rad,
    )


def update(
    settings: ObserverSettings,
    state: HeadingState,
    samples: Sequence[HeadingSample],
    rudder_rad: float,
    now_s: float,
) -> HeadingState:
    """Take the samples of a tick in, oldest first, and carry the state to the tick."""
    for sample in samples:
        state = correct(settings, state, sample, rudder_rad)
    if not state.fresh(now_s, settings.timeout_s):
        return state
    return predict(settings, state, now_s, rudder_rad)
