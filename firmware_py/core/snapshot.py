"""Snapshot of the boat after a tick, for the log and the link."""

from __future__ import annotations

from firmware_py.common.records import Inputs, RudderStatus
from firmware_py.common.reports import DeadReckoningPosition, Snapshot
from firmware_py.core import instruments
from firmware_py.core.state import Settings, State, fence_enabled, first_item
from firmware_py.core.vessels_step import report as traffic_report
from firmware_py.estimate import dead_reckoning, heading_estimator, position
from firmware_py.guidance import guidance_reports
from firmware_py.guidance.steering import SteeringTarget
from firmware_py.modes import Situation, arming_refusal
from firmware_py.safety import energy_meter, power_monitor, power_saving


def snapshot_of(
    settings: Settings,
    state: State,
    situation: Situation,
    rudder: RudderStatus,
    target: SteeringTarget,
    inputs: Inputs,
) -> Snapshot:
    """Collect the states at the end of a tick.

    The situation is the one that decided the mode of this tick; the rudder status is from before the new command.
    """
    heading, has_heading = state.heading_estimator.heading, situation.heading_rad is not None
    guidance_status, wind, depth = state.guidance.status, state.instruments.wind.report, state.instruments.depth
    return Snapshot(
        t_s=inputs.tick.t_s,
        tick=inputs.tick.index,
        mode=state.modes.mode,
        armed=state.modes.armed,
        heading_rad=heading.heading_rad if heading.sample_t_s is not None else None,
        heading_ok=has_heading,
        yaw_rate_rad_s=heading.yaw_rate_rad_s if has_heading else None,
        roll_rad=heading.roll_rad,
        pitch_rad=heading.pitch_rad,
        goal_heading_rad=target.heading_rad,
        heading_error_rad=target.error_rad,
        bearing_rad=guidance_status.bearing_rad,
        distance_m=guidance_status.distance_m,
        rudder_rad=rudder.angle_rad if rudder.measured else None,
        rudder_command_rad=state.rudder.command_rad,
        rudder_ok=situation.rudder_ok,
        servo=state.rudder.feedback,
        position=state.position.fix,
        position_ok=situation.position_ok,
        faults=state.fault_latch.active,
        rate_hz=inputs.tick.rate_hz,
        skipped_total=state.timing.skipped_total,
        late_s=inputs.tick.late_s,
        home=state.home,
        prearm_refusal=arming_refusal(situation),
        mission=guidance_reports.mission_report(state.guidance, state.plans, state.modes, first_item(state)),
        water=situation.water,
        navigation=guidance_reports.navigation_report(
            state.guidance, state.plans, fence_enabled=fence_enabled(settings, state)
        ),
        estimate=heading_estimator.report(settings.heading_estimator, state.heading_estimator),
        energy=energy_meter.report(state.energy_meter, is_torque_released=state.torque_release.is_released),
        gain_reduction=state.supervisor.oscillation.gain_reduction,
        power=power_monitor.report(state.power, inputs.tick.t_s),
        power_saving_level=power_saving.level_of(state.fault_latch.active),
        traffic=traffic_report(state),
        dead_reckoning=_dead_reckoning_position(state, situation.dead_reckoning_sd_m),
        heading_age_s=None if heading.sample_t_s is None else inputs.tick.t_s - heading.sample_t_s,
        rudder_estimate_rad=rudder.angle_rad if rudder.estimated else None,
        wind=wind,
        wind_ok=instruments.is_recent(wind, inputs.tick.t_s),
        depth=depth,
        depth_ok=instruments.is_recent(depth, inputs.tick.t_s),
    )


def _dead_reckoning_position(state: State, sd_m: float | None) -> DeadReckoningPosition | None:
    position_state = state.position
    if position_state.dead_reckoning is None or sd_m is None:
        return None
    heading = state.heading_estimator.heading.heading_rad
    # A step of 0 s: only the velocity is needed.
    _, (north_m_s, east_m_s) = dead_reckoning.advance(position_state.dead_reckoning, heading, 0.0, is_under_way=True)
    return DeadReckoningPosition(
        position_state.latitude_rad,
        position_state.longitude_rad,
        north_m_s,
        east_m_s,
        sd_m,
        position.time_since_fix_s(position_state),
    )
