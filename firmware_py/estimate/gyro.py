"""Yaw rate of a gyroscope without north: comparison with the compass, drift, and whether the rate is used.

A gyroscope reports the angle turned since an unknown direction, and it drifts. Its angle minus the heading of the
compass is followed by an observer with the time constant TIME_CONSTANT_S (critically damped: double pole):

    d offset = drift dt + 2 h e,   d drift = h^2 e / dt,   h = dt / TIME_CONSTANT_S,   e = difference - offset

Both devices measure the same waves, so the innovation e contains only their errors. A gyroscope that turns the wrong
way, is not fixed to the boat, or drifts too fast differs by more than MAX_DIFFERENCE_RAD in a turn, or has a drift of
more than MAX_DRIFT_RAD_S. It is not used until it has agreed for AGREEMENT_S with a turn of MIN_TURN_RAD, because on a
straight course any gyroscope agrees. A compass that jumps has the same effect: the comparison does not show which of
the two is wrong, and without the gyroscope the boat steers as before.

Without a compass (heading from the course over ground) the rate is still used, with the last drift.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import TWO_PI, clamp, radians, wrap_pi
from firmware_py.common.records import Event, HeadingSample, Severity

TIME_CONSTANT_S: Final = 60.0
MAX_GAP_S: Final = 5.0  # without a comparison; a longer gap restarts it
MAX_DIFFERENCE_RAD: Final = radians(15.0)
MAX_DRIFT_RAD_S: Final = radians(1.0)
DISAGREEMENT_S: Final = 2.0  # until the rate is no longer used
AGREEMENT_S: Final = 30.0  # until it is used
MIN_TURN_RAD: Final = radians(20.0)  # from the mean over TIME_CONSTANT_S
MAX_AGE_S: Final = 0.15  # of a rate, relative to the heading that it is used with
RATE_SD_RAD_S: Final = radians(0.2)  # resolution, and noise of the gyroscope
DELAY_S: Final = 0.03  # of the rate: half of the time over which it is measured, and of a frame


class GyroState(msgspec.Struct, frozen=True):
    """Comparison with the compass at `t_s` (None: none yet).

    `offset_rad`: gyroscope minus compass. `agreed_s`, `disagreed_s`: duration of the present agreement or
    disagreement. `has_turned`: whether the boat has turned by MIN_TURN_RAD from the smoothed angle `mean_rad` during
    the agreement. `rate_rad_s`: the last rate without its drift, at `rate_t_s`.
    """

    t_s: float | None = None
    offset_rad: float = 0.0
    drift_rad_s: float = 0.0
    agreed_s: float = 0.0
    disagreed_s: float = 0.0
    mean_rad: float = 0.0
    has_turned: bool = False
    is_used: bool = False
    rate_rad_s: float = 0.0
    rate_t_s: float | None = None


START: Final = GyroState()


def update(
    state: GyroState, samples: Sequence[HeadingSample], compass: tuple[float, float] | None
) -> tuple[GyroState, tuple[Event, ...]]:
    """Return the state after the samples of a tick, oldest first, and the events.

    `compass` is the time and the true heading of the last sample of the compass in use in this tick, None without one.
    """
    rates = [sample for sample in samples if sample.yaw_rate_rad_s is not None and _is_finite(sample)]
    if not rates:
        return state, ()
    newest = rates[-1]
    if compass is not None and abs(compass[0] - newest.t_s) <= MAX_AGE_S:
        state = _compare(state, newest, compass[1])
    was_used = state.is_used
    is_used = state.disagreed_s <= DISAGREEMENT_S if was_used else state.agreed_s >= AGREEMENT_S and state.has_turned
    rate_rad_s = (newest.yaw_rate_rad_s or 0.0) - state.drift_rad_s
    state = replace(state, is_used=is_used, rate_rad_s=rate_rad_s, rate_t_s=newest.t_s)
    if is_used == was_used:
        return state, ()
    if is_used:
        return state, (Event(Severity.INFO, "Gyro agrees with compass: yaw rate used"),)
    return state, (Event(Severity.WARNING, "Gyro differs from compass: yaw rate not used"),)


def rate_at(state: GyroState, t_s: float) -> float:
    """Return the yaw rate for the filter at a time; NaN: none that is used and recent."""
    if not state.is_used or state.rate_t_s is None or not abs(t_s - state.rate_t_s) <= MAX_AGE_S:
        return math.nan
    return state.rate_rad_s


def rate_sd_rad_s(wave_sd_rad: float, wave_period_s: float) -> float:
    """Return the standard deviation of a rate with its delay in waves, whose yaw has this standard deviation."""
    omega_rad_s = TWO_PI / wave_period_s
    return math.hypot(RATE_SD_RAD_S, DELAY_S * wave_sd_rad * omega_rad_s * omega_rad_s)


def _is_finite(sample: HeadingSample) -> bool:
    return math.isfinite(sample.t_s + sample.heading_rad + (sample.yaw_rate_rad_s or 0.0))


def _compare(state: GyroState, sample: HeadingSample, compass_rad: float) -> GyroState:
    """Return the state after a comparison with a true heading."""
    difference_rad = wrap_pi(sample.heading_rad - compass_rad)
    if state.t_s is None or not 0.0 <= sample.t_s - state.t_s <= MAX_GAP_S:
        return replace(
            state,
            t_s=sample.t_s,
            offset_rad=difference_rad,
            agreed_s=0.0,
            disagreed_s=0.0,
            mean_rad=sample.heading_rad,
            has_turned=False,
        )
    step_s = sample.t_s - state.t_s
    gain = step_s / TIME_CONSTANT_S
    innovation_rad = wrap_pi(difference_rad - state.offset_rad - state.drift_rad_s * step_s)
    drift_rad_s = state.drift_rad_s + gain * innovation_rad / TIME_CONSTANT_S
    agrees = abs(innovation_rad) <= MAX_DIFFERENCE_RAD and abs(drift_rad_s) <= MAX_DRIFT_RAD_S
    turned_rad = wrap_pi(sample.heading_rad - state.mean_rad)
    return replace(
        state,
        t_s=sample.t_s,
        offset_rad=wrap_pi(state.offset_rad + state.drift_rad_s * step_s + 2.0 * gain * innovation_rad),
        drift_rad_s=clamp(drift_rad_s, -2.0 * MAX_DRIFT_RAD_S, 2.0 * MAX_DRIFT_RAD_S),
        agreed_s=state.agreed_s + step_s if agrees else 0.0,
        disagreed_s=0.0 if agrees else state.disagreed_s + step_s,
        mean_rad=wrap_pi(state.mean_rad + gain * turned_rad) if agrees else sample.heading_rad,
        has_turned=agrees and (state.has_turned or abs(turned_rad) >= MIN_TURN_RAD),
    )
