"""One tick as a pure function: estimate, faults, failsafe, guidance, control, rudder limits, torque.

`step` reads no clock and does no I/O, so that the loop, the tests and the replay of a log compute the same rudder
command, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from msgspec.structs import replace

from firmware_py.common.absence import or_nan
from firmware_py.common.geodesy import Place
from firmware_py.common.intents import Request, Verdict
from firmware_py.common.mode_table import MODES, RudderBy
from firmware_py.common.records import Event, Inputs, RudderCommand, RudderStatus, Severity
from firmware_py.common.reports import Output
from firmware_py.control.rudder_limit import limit_command
from firmware_py.core import rudder as rudder_state
from firmware_py.core.accept import accept
from firmware_py.core.estimate_step import estimate
from firmware_py.core.fault_conditions import fault_input
from firmware_py.core.instruments_step import watch_instruments
from firmware_py.core.rudder_demand import compute_rudder_demand
from firmware_py.core.snapshot import snapshot_of
from firmware_py.core.state import (
    Settings,
    State,
    first_item,
    freshness_of,
    heading_timeouts_of,
    parameters_in_force,
    settings_of,
    situation_of,
)
from firmware_py.core.vessels_step import avoid_vessels, watch_vessels
from firmware_py.estimate import heading_filter, heading_tick, position, sources, water
from firmware_py.faults import latch
from firmware_py.faults.fault import Fault
from firmware_py.guidance import guidance, guidance_reports
from firmware_py.guidance.guidance import GuidanceInput
from firmware_py.guidance.steering import SteeringTarget, steering_target, update_goal
from firmware_py.modes import Situation, bench_deflection
from firmware_py.safety import energy_meter, power_monitor, rudder_monitor, supervisor, torque_release
from firmware_py.safety.oscillation import OscillationInput
from firmware_py.safety.steering_monitor import SteeringInput
from firmware_py.safety.supervisor import SupervisorState


def step(state: State, inputs: Inputs) -> tuple[State, Output]:
    """Compute one tick: the next state, the rudder command, the snapshot and the events."""
    previous, now_s = state, inputs.tick.t_s
    state, is_overruled = _accept_requests(state, inputs.requests)
    settings = settings_of(parameters_in_force(state))
    step_s = previous.timing.step_s(now_s)

    state, rudder, estimate_events = estimate(settings, state, inputs)
    state = _monitor_rudder(settings, state, rudder, step_s)
    if inputs.power:
        state = replace(state, power=power_monitor.update(state.power, inputs.power))
    timeouts = heading_timeouts_of(settings, state.devices)
    freshness = freshness_of(settings, state, timeouts, now_s)
    state, vessel_events = watch_vessels(settings, state, inputs, freshness)
    state, instrument_events = watch_instruments(settings, state, inputs, freshness)

    conditions = latch.judge_conditions(fault_input(settings, state, freshness, timeouts, now_s))
    faults, fault_events = latch.update(state.fault_latch, conditions, now_s)
    if faults is not state.fault_latch:
        state = replace(state, fault_latch=faults)
    situation = situation_of(settings, state, freshness)

    supervised, modes, failsafe_events = supervisor.apply_failsafe(
        settings.supervisor, state.supervisor, state.modes, faults.active, situation, overruled=is_overruled
    )
    modes = update_goal(settings.guidance, modes, situation, now_s, step_s)
    if supervised is not state.supervisor or modes is not state.modes:
        state = replace(state, supervisor=supervised, modes=modes)

    state = _guide(settings, state, situation, inputs)
    mission_events = guidance_reports.mission_events(
        previous.guidance.mission, state.guidance.mission, first_item(state)
    )
    target = steering_target(modes, state.guidance.status, situation)
    state, target, aside_events = avoid_vessels(settings, state, target, situation, now_s)
    supervised = _judge_steering(settings, state, rudder, target, situation)

    state, command = _steer(settings, state, supervised, situation, rudder, target, step_s)
    is_position_lost = (faults.active & ~previous.fault_latch.active) >> Fault.POSITION_LOST & 1
    guidance_events = (
        *mission_events,
        *guidance_reports.fence_events(previous.guidance, state.guidance, state.plans),
        *guidance_reports.circle_events(settings.guidance.tasks, previous.guidance, state.guidance),
        *guidance_reports.dead_reckoning_events(
            previous.guidance.follower,
            state.guidance.follower,
            begins=bool(is_position_lost and situation.dead_reckoning_sd_m is not None),
        ),
    )
    vessel_events = (*vessel_events, *aside_events)
    events = (
        *_change_events(previous, state),
        *estimate_events,
        *fault_events,
        *failsafe_events,
        *guidance_events,
        *vessel_events,
        *instrument_events,
    )
    return state, Output(command, snapshot_of(settings, state, situation, rudder, target, inputs), events)


def _accept_requests(state: State, requests: Sequence[Request]) -> tuple[State, bool]:
    """Apply the requests of a tick; return the state, and whether one of them overrules an active failsafe."""
    is_overruled = False
    for request in requests:
        state, answer = accept(state, request)
        is_overruled |= answer.verdict is Verdict.ACCEPTED and isinstance(request.intent, supervisor.OVERRULING)
    return state, is_overruled


def _monitor_rudder(settings: Settings, state: State, rudder: RudderStatus, step_s: float) -> State:
    """Update the rudder monitor and the energy meter."""
    needs_torque = _needs_torque(settings, state, rudder.t_s)
    is_engaged = needs_torque and not state.torque_release.is_released and rudder.torque_on is not False
    return replace(
        state,
        supervisor=supervisor.update(settings.supervisor, state.supervisor, rudder, is_engaged=is_engaged),
        energy_meter=energy_meter.update(state.energy_meter, rudder, step_s),
    )


def _guide(settings: Settings, state: State, situation: Situation, inputs: Inputs) -> State:
    """Return the state after the guidance of a tick."""
    heading_rad, motion = situation.heading_rad, None
    if situation.is_position_known and situation.water is not None:
        place = Place(state.position.latitude_rad, state.position.longitude_rad)
        # Without a heading, the predicted heading is the best estimate for the motion.
        heading_rad = state.heading_estimator.heading.heading_rad
        motion = guidance.make_vessel_motion(place, heading_rad, situation.water, situation.dead_reckoning_sd_m or 0.0)
    guidance_input = GuidanceInput(
        inputs.tick.t_s,
        heading_rad,
        motion,
        bool(inputs.positions),
        state.modes,
        state.plans,
        state.home,
        position.utc_s(state.position, inputs.tick.t_s),
        settings.fence_enabled,
    )
    output = guidance.update(settings.guidance, state.guidance, guidance_input)
    if output.state is state.guidance and output.home is None:
        return state
    return replace(state, guidance=output.state, home=output.home or state.home)


def _judge_steering(
    settings: Settings, state: State, rudder: RudderStatus, target: SteeringTarget, situation: Situation
) -> SupervisorState:
    """Return the supervisor state after the monitors of steering, limit cycle and heading convergence.

    The steering monitor needs an armed boat and a servo that responds. A limit cycle is possible only in modes in which
    the heading controller steers.
    """
    is_armed, estimator = state.modes.armed, state.heading_estimator
    tick, water_state = estimator.tick, estimator.water
    has_started, heading_sd_rad = heading_filter.has_started(tick.filter), heading_tick.heading_sd(tick)
    speed_m_s = water.model_speed(water_state)
    diffusion_rad2_s, trim_rad = heading_tick.learned_disturbance(tick)
    steering = SteeringInput(
        rudder_rad=rudder.angle_rad,
        heading_rad=or_nan(situation.heading_rad if is_armed and situation.rudder_ok else None),
        heading_sd_rad=heading_sd_rad,
        speed_m_s=speed_m_s,
        error_rad=or_nan(target.error_rad),
        compass_rad=sources.compass_in_use(tick.sources).raw_rad,
        diffusion_rad2_s=diffusion_rad2_s,
        trim_rad=trim_rad,
    )
    is_controlled = is_armed and MODES[state.modes.mode].rudder_by is not RudderBy.STICK
    oscillation = OscillationInput(
        or_nan(target.error_rad if is_controlled and has_started else None),
        or_nan(target.heading_rad),
        heading_sd_rad,
        rudder_rad=state.rudder.command_rad,
        trim_rad=tick.bias_mean_rad,
        speed_m_s=speed_m_s,
        wave_period_s=math.exp(tick.filter.levels.wave_period),
        delay_log_ratio=tick.delay.log_ratio,
    )
    return supervisor.judge_steering(settings.supervisor, state.supervisor, steering, oscillation, rudder.t_s)


def _steer(
    settings: Settings,
    state: State,
    supervised: SupervisorState,
    situation: Situation,
    rudder: RudderStatus,
    target: SteeringTarget,
    step_s: float,
) -> tuple[State, RudderCommand]:
    """Return the state and the servo command for the target; the supervisor can override the demand."""
    now_s = rudder.t_s
    gain_reduction = supervised.oscillation.gain_reduction
    demand_rad, controller = compute_rudder_demand(settings, state, target, gain_reduction, now_s, step_s)
    supervised, demand_rad = supervisor.limit_without_heading(
        supervised,
        demand_rad,
        rudder.command_rad,
        state.modes,
        now_s,
        has_heading=situation.heading_rad is not None,
    )
    command_rad = limit_command(settings.rudder.limits, rudder.command_rad, demand_rad, step_s)
    command_rad = rudder_monitor.release_command(supervised.rudder_monitor, command_rad, now_s)
    torque = torque_release.update(settings.torque_release, state.torque_release, command_rad, rudder, now_s)
    torque_on = not torque.is_released and _needs_torque(settings, state, now_s)
    state = replace(
        state,
        supervisor=supervised,
        controller=controller,
        torque_release=torque,
        rudder=replace(state.rudder, command_rad=command_rad),
    )
    return state, RudderCommand(settings.rudder.linkage.to_shaft(command_rad), torque_on)


def _needs_torque(settings: Settings, state: State, now_s: float) -> bool:
    """Return whether the servo needs torque: while armed, if RUD_DISARMED is 0, or during a bench command."""
    return (
        state.modes.armed or not settings.rudder.released_disarmed or bench_deflection(state.modes, now_s) is not None
    )


def _change_events(previous: State, current: State) -> tuple[Event, ...]:
    """Return the events of start, mode, arming, rudder angle and heading convergence."""
    is_first_tick = previous.timing.started_s is None
    events: list[Event] = []
    if is_first_tick or previous.modes.mode is not current.modes.mode:
        events.append(Event(Severity.INFO, f"Mode {current.modes.mode.name}"))
    if is_first_tick and current.greeting:
        events.append(Event(Severity.NOTICE, current.greeting))
    if previous.modes.armed is not current.modes.armed:
        events.append(Event(Severity.NOTICE, "Armed" if current.modes.armed else "Disarmed"))
    events += rudder_state.source_events(previous.rudder, current.rudder)
    if current.supervisor.convergence.not_converging and not previous.supervisor.convergence.not_converging:
        events.append(Event(Severity.WARNING, "Rudder at limit 5 min: heading not converging"))
    return tuple(events)
