"""The helm of a tick: from samples to what is known of her heading, and from there to a rudder order.

Only puts together what the estimate and the control compute; `step` calls it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_py.control.helmsman import HelmSettings, Known, followed, steered
from firmware_py.control.reference import Reference
from firmware_py.control.s_surface import Gains, rudder_demand
from firmware_py.estimate import heading, kalman, wave_filter
from firmware_py.estimate.heading import HeadingState, ObserverSettings
from firmware_py.estimate.wave_filter import FilterSettings, FilterState
from firmware_py.params import ParameterSet
from firmware_py.records import Estimate, FixType, HeadingSample, PositionSample

SLOWEST_COURSE_M_S = 0.02  # below it a receiver gives no course worth the name


@dataclass(frozen=True, slots=True)
class Settings:
    """How the heading is estimated and steered."""

    observer: ObserverSettings
    filter: FilterSettings
    gains: Gains
    helm: HelmSettings
    plain_estimate: bool
    plain_control: bool

    @classmethod
    def of(cls, parameters: ParameterSet) -> Settings:
        """Read the settings from the parameters."""
        plain_estimate = parameters["EST_MODE"] == 0
        return cls(
            ObserverSettings.of(parameters),
            FilterSettings.of(parameters),
            Gains.of(parameters),
            HelmSettings.of(parameters),
            plain_estimate,
            plain_estimate or parameters["CTL_MODE"] == 0,
        )


def estimated(
    settings: Settings,
    before: HeadingState,
    waves: FilterState,
    headings: Sequence[HeadingSample],
    positions: Sequence[PositionSample],
    rudder_rad: float,
    now_s: float,
) -> tuple[HeadingState, FilterState]:
    """Take a tick's samples in; return what is steered by, and the filter behind it."""
    if settings.plain_estimate:
        return heading.update(settings.observer, before, headings, rudder_rad, now_s), FilterState()
    seen = [(sample.t_s, heading.true_heading_rad(settings.observer, sample)) for sample in headings]
    waves = wave_filter.update(settings.filter, waves, seen, velocities_of(positions), rudder_rad)
    if not waves.x:
        return before, waves
    heading_rad, yaw_rate_rad_s = wave_filter.ahead(settings.filter, waves, now_s)
    roll_rad, pitch_rad = (
        (headings[-1].roll_rad, headings[-1].pitch_rad) if headings else (before.roll_rad, before.pitch_rad)
    )
    return HeadingState(now_s, heading_rad, yaw_rate_rad_s, waves.sample_t_s, roll_rad, pitch_rad), waves


def velocities_of(positions: Sequence[PositionSample]) -> list[wave_filter.Velocity]:
    """Return time, speed and course over the ground of the fixes that state them."""
    found = []
    for sample in positions:
        speed_m_s, course_rad = sample.speed_over_ground_m_s, sample.course_over_ground_rad
        if sample.fix is FixType.NONE or speed_m_s is None:
            continue
        if course_rad is not None and math.isfinite(course_rad):
            found.append((sample.t_s, speed_m_s, course_rad))
        elif speed_m_s < SLOWEST_COURSE_M_S:
            found.append((sample.t_s, speed_m_s, 0.0))
    return found


def known_of(waves: FilterState, heading_state: HeadingState) -> Known:
    """Return what the helmsman steers by."""
    return Known(
        heading_state.heading_rad,
        waves.spread(kalman.HEADING),
        heading_state.yaw_rate_rad_s,
        waves.x[kalman.BIAS],
        waves.x[kalman.SPEED],
        waves.spread(kalman.SPEED),
        waves.x[kalman.FACTOR],
    )


def ordered(
    settings: Settings,
    heading_state: HeadingState,
    waves: FilterState,
    reference: Reference | None,
    error_rad: float,
    command_rad: float,
    step_s: float,
) -> tuple[float, Reference | None]:
    """Return the rudder demand for a heading error, and the reference of the turn."""
    if settings.plain_control or not waves.x:
        return rudder_demand(settings.gains, error_rad, heading_state.yaw_rate_rad_s), None
    known = known_of(waves, heading_state)
    reference, order = steered(settings.helm, reference, known, error_rad, step_s)
    return (command_rad if order is None else followed(command_rad, order)), reference


def estimate_of(waves: FilterState, heading_state: HeadingState) -> Estimate | None:
    """Return what the filter knows, for the log and the link; None without a filter."""
    if not waves.x:
        return None
    x, learned = waves.x, waves.learned
    return Estimate(
        heading_rad=heading_state.heading_rad,
        heading_sd_rad=waves.spread(kalman.HEADING),
        yaw_rate_rad_s=heading_state.yaw_rate_rad_s,
        yaw_rate_sd_rad_s=waves.spread(kalman.RATE),
        bias_rad=x[kalman.BIAS],
        bias_sd_rad=waves.spread(kalman.BIAS),
        wave_period_s=2.0 * math.pi / learned.omega_rad_s,
        wave_sd_rad=learned.wave_spread_rad,
        compass_noise_rad=math.exp(0.5 * learned.log_noise),
        speed_m_s=x[kalman.SPEED],
        speed_sd_m_s=waves.spread(kalman.SPEED),
        current_north_m_s=x[kalman.NORTH],
        current_east_m_s=x[kalman.EAST],
        turning_factor=x[kalman.FACTOR],
        innovation_rad=waves.innovation_rad,
        innovation_sd_rad=waves.innovation_sd_rad,
        innovation_square=learned.average_square,
    )
