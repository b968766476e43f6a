"""Rudder demand by mode and faults, before the limits."""

from __future__ import annotations

from firmware_py.common.mode_table import MODES, RudderBy
from firmware_py.control import heading_controller
from firmware_py.control.heading_controller import HeadingControllerInput
from firmware_py.control.law import IDLE, LawState
from firmware_py.core.state import Settings, State
from firmware_py.estimate.heading_estimator import heading_estimate
from firmware_py.faults.table import Fault
from firmware_py.guidance.steering import SteeringTarget
from firmware_py.modes import bench_deflection, stick_deflection


def compute_rudder_demand(
    settings: Settings, state: State, target: SteeringTarget, gain_reduction: float, now_s: float, step_s: float
) -> tuple[float, LawState]:
    """Return the rudder demand [rad] and the state of the heading controller (IDLE while it does not steer)."""
    modes, command_rad = state.modes, state.rudder.command_rad
    limit_rad = settings.rudder.limits.limit_rad
    if (deflection := bench_deflection(modes, now_s)) is not None:
        return deflection * limit_rad, IDLE
    rudder_by = MODES[modes.mode].rudder_by
    if not modes.armed or rudder_by is RudderBy.NOTHING:
        return 0.0, IDLE
    if rudder_by is RudderBy.STICK:
        stick = stick_deflection(modes, now_s, settings.guidance.stick_timeout_s)
        return (0.0 if stick is None else stick * limit_rad), IDLE
    if target.error_rad is not None:
        controller_input = HeadingControllerInput(
            error_rad=target.error_rad,
            yaw_rate_rad_s=state.heading_estimator.heading.yaw_rate_rad_s,
            estimate=heading_estimate(settings.heading_estimator, state.heading_estimator),
            command_rad=command_rad,
            step_s=step_s,
            gain_reduction=gain_reduction,
        )
        controller, demand_rad = heading_controller.update(settings.controller, state.controller, controller_input)
        return demand_rad, controller
    lost_s = state.fault_latch.since_s[Fault.COMPASS_LOST]
    is_held = lost_s is None or now_s - lost_s <= settings.rudder.hold_s
    return (command_rad if is_held else 0.0), IDLE
