"""One tick as a pure function: estimate, monitor, modes, guidance, control, limit.

`step(state, inputs)` reads no clock and does no input or output, so the loop, the tests
and the replay of a log compute the same rudder, bit for bit.
"""

from __future__ import annotations

import math
from dataclasses import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.intents import Verdict
from firmware_py.common.records import (
    DeviceRole,
    Event,
    Home,
    Inputs,
    Mode,
    Output,
    PositionSample,
    RudderCommand,
    RudderFeedback,
    Severity,
    Snapshot,
)
from firmware_py.control import heading_controller
from firmware_py.control.heading_controller import HeadingControllerInput, HeadingControllerState
from firmware_py.control.rudder_limit import limited_command
from firmware_py.core import fault_conditions
from firmware_py.core.accept import accept
from firmware_py.core.state import Settings, State, fence_enabled, settings_of, situation_of
from firmware_py.estimate import heading_estimator, kalman, position, water
from firmware_py.faults.latch import update as update_monitor
from firmware_py.faults.page import Fault
from firmware_py.guidance import guidance
from firmware_py.guidance.steering import SteeringTarget, steering_target, update_goal
from firmware_py.modes import ModeState, Situation, arming_obstacle, live_bench, live_stick
from firmware_py.safety import energy_meter, rudder_monitor, supervisor

__all__ = ["State", "accept", "settings_of", "step"]


def step(state: State, inputs: Inputs) -> tuple[State, Output]:
    """Compute one tick: the next state, the rudder command and what is to be told."""
    before, now_s, ordered = state, inputs.tick.t_s, False
    for request in inputs.requests:
        state, answer = accept(state, request)
        ordered |= answer.verdict is Verdict.ACCEPTED and isinstance(request.intent, supervisor.ORDERS)
    settings = settings_of(state.parameters)
    step_s = min(max(0.0, now_s - before.t_s), 1.0) if before.started_s is not None else 0.0
    state, sensed_told = _estimate(settings, state, inputs)
    state = _monitor(settings, state, inputs, step_s)
    monitor, faults_told = update_monitor(state.monitor, fault_conditions.standing(settings, state, now_s), now_s)
    state = replace(state, monitor=monitor)
    situation = situation_of(state, now_s)
    guard, modes, guard_told = supervisor.apply_failsafe(
        settings.watch, state.watch, state.modes, monitor.active, situation, ordered=ordered
    )
    modes = update_goal(settings.pilotage, modes, situation, now_s, step_s)
    state, guided = _guide(settings, replace(state, watch=guard, modes=modes), situation, inputs)
    steering = steering_target(modes, state.nav.status, situation)
    state = _monitor_steering(settings, state, steering.error_rad, now_s)
    state, command = _steer(settings, state, situation, steering, now_s, step_s)
    told = (*_change_events(before, state), *sensed_told, *faults_told, *guard_told, *guided)
    return state, Output(command, _snapshot(settings, state, situation, steering, inputs), told)


# ------------------------------------------------------------------------------ parts


def _estimate(settings: Settings, state: State, inputs: Inputs) -> tuple[State, tuple[Event, ...]]:
    """Take samples, feedback, device states and the tick's own health in; return what is to be told of them too."""
    now_s = inputs.tick.t_s
    servo = inputs.rudder[-1] if inputs.rudder else state.servo
    storage = state.storage
    for device in inputs.devices:
        if device.role is DeviceRole.STORAGE:
            storage = device
    skipped = inputs.tick.skipped
    rudder_rad = _rudder_rad(settings, state, servo)
    lookout_state, heading_state, told = heading_estimator.update(
        settings.lookout, state.lookout, state.heading, inputs.headings, inputs.positions, rudder_rad, now_s
    )
    valid = heading_state.fresh(now_s, settings.observer.timeout_s)
    heading_rad = heading_state.heading_rad if valid else None
    place, home = position.predict(state.place, now_s, _over_ground_m_s(state, heading_rad)), state.home
    believed = []
    for sample in inputs.positions:
        place, good = position.update(place, sample, settings.position_jump_s)
        if good:
            believed.append(sample)
            home = home or _first_home(sample)
    sensed = replace(
        state,
        started_s=now_s if state.started_s is None else state.started_s,
        heading=heading_state,
        lookout=lookout_state,
        current=water.update(state.current, heading_rad, believed, now_s),
        place=place,
        position=place.fix,
        home=home,
        servo=servo,
        storage=storage,
        skipped_total=state.skipped_total + skipped,
        skipped_t_s=now_s if skipped else state.skipped_t_s,
    )
    return sensed, told


def _over_ground_m_s(state: State, heading_rad: float | None) -> tuple[float, float]:
    """Return her velocity over ground as estimated, north and east."""
    north_m_s, east_m_s, speed_m_s = state.current.mean
    if heading_rad is None:
        return north_m_s, east_m_s
    return north_m_s + speed_m_s * math.cos(heading_rad), east_m_s + speed_m_s * math.sin(heading_rad)


def _first_home(sample: PositionSample) -> Home | None:
    """The first fix since start is home until one is set."""
    if sample.latitude_rad is None or sample.longitude_rad is None:
        return None
    return Home(sample.latitude_rad, sample.longitude_rad, sample.altitude_m or 0.0)


def _rudder_rad(settings: Settings, state: State, servo: RudderFeedback | None) -> float:
    """The measured rudder angle, or the commanded one while the servo gives none."""
    if servo is None or servo.shaft_rad is None or not math.isfinite(servo.shaft_rad):
        return state.rudder_command_rad
    return settings.linkage.to_rudder(servo.shaft_rad)


def _monitor(settings: Settings, state: State, inputs: Inputs, step_s: float) -> State:
    """Let the watch look at the tick: rudder, energy, devices."""
    seen = supervisor.update(settings.watch, state.watch, inputs, _rudder_now(settings, state, inputs), step_s)
    return replace(state, watch=seen)


def _monitor_steering(settings: Settings, state: State, error_rad: float | None, now_s: float) -> State:
    """Let the watch see whether she answers the rudder."""
    valid = state.heading.fresh(now_s, settings.observer.timeout_s)
    waves = state.lookout.wave_filter
    speed_m_s = waves.x[kalman.SPEED] if waves.x else settings.watch.model.speed_m_s
    heading_rad = state.heading.heading_rad if valid and state.modes.armed else None
    rudder_rad = _rudder_rad(settings, state, state.servo)
    seen = supervisor.update_steering(settings.watch, state.watch, rudder_rad, heading_rad, speed_m_s, error_rad, now_s)
    return replace(state, watch=seen)


def _rudder_now(settings: Settings, state: State, inputs: Inputs) -> supervisor.RudderNow:
    """What is known of the rudder in this tick."""
    newest = inputs.rudder[-1].shaft_rad if inputs.rudder else None
    measured = newest is not None and math.isfinite(newest)
    angle_rad = _rudder_rad(settings, state, state.servo)
    wanted = _held(settings, state.modes, inputs.tick.t_s)
    return supervisor.RudderNow(
        state.rudder_command_rad, angle_rad, angle_rad if measured else None, wanted, state.servo
    )


def _held(settings: Settings, modes: ModeState, now_s: float) -> bool:
    """Whether the rudder is to be held or moved, and not released."""
    return modes.armed or not settings.release_disarmed or live_bench(modes, now_s) is not None


def _steer(
    settings: Settings,
    state: State,
    situation: Situation,
    steering: SteeringTarget,
    now_s: float,
    step_s: float,
) -> tuple[State, RudderCommand]:
    """From what guidance asks for to what the servo is told; the watch has the last word."""
    modes, lost_s = state.modes, state.monitor.since_s[Fault.COMPASS_LOST]
    demand_rad, controller = _demand_rad(settings, state, modes, steering, now_s, lost_s, step_s)
    guard, demand_rad = supervisor.limit_without_heading(
        state.watch,
        demand_rad,
        state.rudder_command_rad,
        modes,
        now_s,
        heading_ok=situation.heading_rad is not None,
    )
    command_rad = limited_command(settings.limits, state.rudder_command_rad, demand_rad, step_s)
    command_rad = rudder_monitor.release_command(guard.rudder, command_rad, now_s)
    angle_rad = _rudder_rad(settings, state, state.servo)
    seen = supervisor.RudderNow(command_rad, angle_rad, None, True, state.servo)
    guard, pulls = supervisor.torque_enable(settings.watch, guard, command_rad, seen, now_s)
    torque_on = pulls and _held(settings, modes, now_s)
    state = replace(state, watch=guard, controller=controller, rudder_command_rad=command_rad, t_s=now_s)
    return state, RudderCommand(settings.linkage.to_shaft(command_rad), torque_on)


def _guide(settings: Settings, state: State, situation: Situation, inputs: Inputs) -> tuple[State, tuple[Event, ...]]:
    """Let guidance look at the tick."""
    motion = None
    if situation.position_ok and situation.water is not None:
        place = Place(state.place.latitude_rad, state.place.longitude_rad)
        motion = guidance.vessel_motion(place, state.heading.heading_rad, situation.water)
    fix = state.position
    scene = guidance.GuidanceInput(
        inputs.tick.t_s,
        motion,
        bool(inputs.positions),
        state.modes,
        state.plans,
        state.home,
        fix.utc_s if fix else None,
    )
    done = guidance.update(settings.pilotage, state.nav, scene)
    return replace(state, nav=done.state, home=done.home or state.home), done.events


def _demand_rad(
    settings: Settings,
    state: State,
    modes: ModeState,
    steering: SteeringTarget,
    now_s: float,
    heading_lost_s: float | None,
    step_s: float,
) -> tuple[float, HeadingControllerState]:
    """The rudder angle that mode and faults ask for, and what the heading controller remembers if it steers."""
    idle = HeadingControllerState()
    if (bench := live_bench(modes, now_s)) is not None:
        return bench * settings.limits.limit_rad, idle
    if not modes.armed or modes.mode is Mode.HOLD:
        return 0.0, idle
    if modes.mode is Mode.MANUAL:
        stick = live_stick(modes, now_s, settings.pilotage.stick_timeout_s)
        return (0.0 if stick is None else stick * settings.limits.limit_rad), idle
    if steering.error_rad is not None:
        given = HeadingControllerInput(
            error_rad=steering.error_rad,
            yaw_rate_rad_s=state.heading.yaw_rate_rad_s,
            estimate=heading_estimator.heading_estimate(state.lookout, state.heading),
            command_rad=state.rudder_command_rad,
            step_s=step_s,
        )
        controller, demand_rad = heading_controller.update(settings.helm, state.controller, given)
        return demand_rad, controller
    held = heading_lost_s is None or now_s - heading_lost_s <= settings.hold_s
    return (state.rudder_command_rad if held else 0.0), idle


def _change_events(before: State, after: State) -> tuple[Event, ...]:
    told: list[Event] = []
    if before.started_s is None or before.modes.mode is not after.modes.mode:
        told.append(Event(Severity.INFO, f"Mode {after.modes.mode.name}"))
    if before.started_s is None and after.greeting:
        told.append(Event(Severity.NOTICE, after.greeting))
    if before.modes.armed is not after.modes.armed:
        told.append(Event(Severity.NOTICE, "Armed" if after.modes.armed else "Disarmed"))
    return tuple(told)


def _snapshot(
    settings: Settings, state: State, situation: Situation, steering: SteeringTarget, inputs: Inputs
) -> Snapshot:
    valid = situation.heading_rad is not None
    measured = state.servo is not None and state.servo.shaft_rad is not None
    return Snapshot(
        t_s=inputs.tick.t_s,
        tick=inputs.tick.index,
        mode=state.modes.mode,
        armed=state.modes.armed,
        heading_rad=state.heading.heading_rad if state.heading.sample_t_s is not None else None,
        heading_ok=valid,
        yaw_rate_rad_s=state.heading.yaw_rate_rad_s if valid else None,
        roll_rad=state.heading.roll_rad,
        pitch_rad=state.heading.pitch_rad,
        goal_heading_rad=steering.heading_rad,
        heading_error_rad=steering.error_rad,
        bearing_rad=state.nav.status.bearing_rad,
        distance_m=state.nav.status.distance_m,
        rudder_rad=_rudder_rad(settings, state, state.servo) if measured else None,
        rudder_command_rad=state.rudder_command_rad,
        rudder_ok=situation.rudder_ok,
        servo=state.servo,
        position=state.position,
        position_ok=situation.position_ok,
        faults=state.monitor.active,
        rate_hz=inputs.tick.rate_hz,
        skipped_total=state.skipped_total,
        late_s=inputs.tick.late_s,
        home=state.home,
        prearm_refusal=arming_obstacle(situation),
        mission=guidance.mission_report(state.nav, state.plans, state.modes),
        water=situation.water,
        navigation=guidance.report(state.nav, state.plans, fence_enabled=fence_enabled(settings, state)),
        estimate=heading_estimator.report(state.lookout, state.heading),
        energy=energy_meter.report(state.watch.energy, resting=state.watch.rest.resting_s is not None),
    )
