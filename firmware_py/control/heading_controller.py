"""The helm of a tick: from what the lookout knows and what guidance asks to a rudder demand."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.common.parameters import ParameterSet
from firmware_py.control.reference_model import Reference
from firmware_py.control.s_surface import Gains, rudder_demand
from firmware_py.control.scheduled import HeadingEstimate, ScheduledSettings, apply_deadband, scheduled_demand
from firmware_py.estimate import kalman
from firmware_py.estimate.observer import HeadingState
from firmware_py.estimate.wave_filter import WaveFilterState


@dataclass(frozen=True, slots=True)
class HeadingControllerSettings:
    """How the heading is steered: with fixed gains or scheduled."""

    gains: Gains
    scheduled: ScheduledSettings
    plain: bool

    @classmethod
    def of(cls, parameters: ParameterSet) -> HeadingControllerSettings:
        """Read the settings from the parameters."""
        return cls(
            Gains.of(parameters),
            ScheduledSettings.of(parameters),
            parameters["CTL_MODE"] == 0 or parameters["EST_MODE"] == 0,
        )


def demand(
    settings: HeadingControllerSettings,
    known: HeadingState,
    waves: WaveFilterState,
    reference: Reference | None,
    error_rad: float,
    command_rad: float,
    step_s: float,
) -> tuple[float, Reference | None]:
    """Return the rudder demand for a heading error, and the reference of the turn."""
    if settings.plain or not waves.x:
        return rudder_demand(settings.gains, error_rad, known.yaw_rate_rad_s), None
    seen = HeadingEstimate(
        known.heading_rad,
        waves.spread(kalman.HEADING),
        known.yaw_rate_rad_s,
        waves.x[kalman.BIAS],
        waves.x[kalman.SPEED],
        waves.spread(kalman.SPEED),
        waves.x[kalman.FACTOR],
    )
    reference, order = scheduled_demand(settings.scheduled, reference, seen, error_rad, step_s)
    return (command_rad if order is None else apply_deadband(command_rad, order)), reference
