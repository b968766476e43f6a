"""The watch of a tick: rudder, energy, devices and failsafes; only puts together what its parts judge."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.common.intents import Arm, Intent, PauseMission, SetMissionItem, SetMode, SteerHeading, SteerPosition
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import DeviceHealth, DeviceRole, Event, Inputs, Mode, RudderFeedback, Severity
from firmware_py.faults.page import TABLE, Action, Fault
from firmware_py.model.kt import KtModel
from firmware_py.modes import ModeState, Situation, enter, obstacle_to
from firmware_py.safety import energy_meter, rudder_monitor, steering_monitor, torque_release
from firmware_py.safety.energy_meter import EnergyMeterState
from firmware_py.safety.failsafe import FailsafeInput, FailsafeState, decide
from firmware_py.safety.rudder_monitor import RudderMonitorState, RudderSight
from firmware_py.safety.steering_monitor import SteeringMonitorState
from firmware_py.safety.torque_release import ServoSight, TorqueReleaseState

HARD_OVER_RAD: Final = radians(8.0)  # more than trim and wind can ask for
HARD_OVER_S: Final = 30.0
BLOCK_S: Final = 2.0
ENOUGH_BLOCKS: Final = 30
# An order after which a failsafe that has acted is over.
ORDERS: Final[tuple[type[Intent], ...]] = (Arm, PauseMission, SetMissionItem, SetMode, SteerHeading, SteerPosition)


@dataclass(frozen=True, slots=True)
class SupervisorSettings:
    """What the watch is set to."""

    actions: Mapping[Fault, Action]
    resume: bool
    most_a: float
    hot_c: float
    low_v: float
    rest_s: float
    station_s: float
    model: KtModel

    @classmethod
    def of(cls, parameters: ParameterSet) -> SupervisorSettings:
        """Read the settings from the parameters."""
        return cls(
            {row.fault: Action(int(parameters[row.parameter])) for row in TABLE if row.parameter},
            bool(parameters["FS_RESUME"]),
            parameters["RUD_AMP_MAX"],
            parameters["RUD_TEMP_MAX"],
            parameters["BAT_LOW_VOLT"],
            parameters["RUD_REST_S"],
            parameters["FS_GCS_S"],
            KtModel.of(parameters),
        )


@dataclass(frozen=True, slots=True)
class SupervisorState:
    """What the watch remembers.

    `heard_s`: when each compass last spoke. `restarted_s`: when the servo was last seen to
    have come up anew. `bent_s`: since when the rudder is far over without a heading;
    `straightened`: that has been ended. `block`: time and heading at the beginning of the
    block over which her turn is measured, `turn_square` the mean square of such turns,
    `blocks` how many there were. `interrupted`: what a failsafe broke off.
    """

    rudder: RudderMonitorState = RudderMonitorState()  # noqa: RUF009 - frozen
    energy: EnergyMeterState = EnergyMeterState()  # noqa: RUF009 - frozen
    rest: TorqueReleaseState = TorqueReleaseState()  # noqa: RUF009 - frozen
    authority: SteeringMonitorState = SteeringMonitorState()  # noqa: RUF009 - frozen
    failsafe: FailsafeState = FailsafeState()  # noqa: RUF009 - frozen
    interrupted: ModeState | None = None
    heard_s: tuple[float | None, float | None] = (None, None)
    restarts: int = 0
    restarted_s: float | None = None
    clock: DeviceHealth | None = None
    link: DeviceHealth | None = None
    block: tuple[float, float] | None = None
    turn_square: float = 0.0
    blocks: int = 0
    bent_s: float | None = None
    straightened: bool = False


@dataclass(frozen=True, slots=True)
class RudderNow:
    """The rudder in a tick: what was sent last, the angle known and the one newly measured, and the servo's word."""

    sent_rad: float
    angle_rad: float
    measured_rad: float | None
    torque_wanted: bool
    servo: RudderFeedback | None


def update(
    settings: SupervisorSettings, state: SupervisorState, inputs: Inputs, seen: RudderNow, step_s: float
) -> SupervisorState:
    """Take the inputs of a tick in."""
    now_s, servo = inputs.tick.t_s, seen.servo
    a_s, b_s = state.heard_s
    for sample in inputs.headings:
        if sample.source == 0:
            a_s = sample.t_s
        else:
            b_s = sample.t_s
    clock, link = state.clock, state.link
    for device in inputs.devices:
        clock = device if device.role is DeviceRole.CLOCK else clock
        link = device if device.role is DeviceRole.LINK else link
    restarts = state.restarts if servo is None else servo.restarts
    engaged = seen.torque_wanted and state.rest.resting_s is None and (servo is None or servo.torque_on is not False)
    current_a = servo.current_a if servo is not None and inputs.rudder else None
    sight = RudderSight(now_s, seen.sent_rad, seen.measured_rad, current_a, engaged)
    return replace(
        state,
        rudder=rudder_monitor.update(state.rudder, sight, settings.most_a),
        energy=energy_meter.update(state.energy, seen.angle_rad, _power(inputs.rudder), step_s),
        heard_s=(a_s, b_s),
        restarts=restarts,
        restarted_s=now_s if restarts > state.restarts else state.restarted_s,
        clock=clock,
        link=link,
    )


def _power(feedback: tuple[RudderFeedback, ...]) -> tuple[float, float] | None:
    if not feedback or feedback[-1].voltage_v is None or feedback[-1].current_a is None:
        return None
    power_w = feedback[-1].voltage_v * abs(feedback[-1].current_a)
    return (feedback[-1].t_s, power_w) if math.isfinite(power_w) else None


def update_steering(
    settings: SupervisorSettings,
    state: SupervisorState,
    rudder_rad: float,
    heading_rad: float | None,
    speed_m_s: float,
    error_rad: float | None,
    now_s: float,
) -> SupervisorState:
    """Watch whether she answers the rudder; nothing is learned without a heading.

    The turn is that of the heading over a block: the estimated yaw rate expects a turn of the
    rudder, and the heading is drawn back to what the compass says.
    """
    if heading_rad is None or state.block is None:
        return replace(state, block=None if heading_rad is None else (now_s, heading_rad))
    begun_s, before_rad = state.block
    step_s = now_s - begun_s
    if step_s < BLOCK_S:
        return state
    yaw_rate_rad_s = wrap_pi(heading_rad - before_rad) / step_s
    ability_1_s, lag_s, _ = settings.model.scaled(clamp(speed_m_s / settings.model.speed_m_s, 0.1, 10.0))
    seen = steering_monitor.update(state.authority, rudder_rad, yaw_rate_rad_s, ability_1_s, lag_s, step_s, error_rad)
    part = max(1.0 / (state.blocks + 1.0), step_s / steering_monitor.MEMORY_S)
    square = state.turn_square + part * (yaw_rate_rad_s * yaw_rate_rad_s - state.turn_square)
    return replace(
        state,
        authority=seen,
        block=(now_s, heading_rad),
        turn_square=square,
        blocks=min(state.blocks + 1, ENOUGH_BLOCKS),
    )


def steering_lost(state: SupervisorState) -> bool:
    """Whether she does not answer the rudder, once the sea lets that be told: to a sixth of the turn."""
    evidence = state.authority.expected_square >= 36.0 * BLOCK_S * state.turn_square
    return state.authority.lost and evidence and state.blocks >= ENOUGH_BLOCKS


def apply_failsafe(
    settings: SupervisorSettings,
    state: SupervisorState,
    modes: ModeState,
    active: int,
    situation: Situation,
    *,
    ordered: bool,
) -> tuple[SupervisorState, ModeState, tuple[Event, ...]]:
    """Let the failsafes decide about the mode."""
    scene = FailsafeInput(
        active,
        modes.mode,
        modes.armed,
        ordered,
        settings.actions,
        lambda mode: not obstacle_to(mode, situation),
        settings.resume,
    )
    acting = state.failsafe.fault is not None
    failsafe, decision = decide(state.failsafe, scene)
    if failsafe is state.failsafe and decision.enter is None and not decision.resume:
        return state, modes, ()
    interrupted = state.interrupted if failsafe.fault is not None else None
    if decision.resume and state.interrupted is not None:
        before, events = _resumed(modes, state.interrupted, situation)
        return replace(state, failsafe=failsafe, interrupted=None), before, events
    if failsafe.fault is not None and not acting:
        interrupted = modes
    if decision.enter is not None:
        entered, _ = enter(modes, decision.enter, situation)
        modes = entered if entered.mode is decision.enter else replace(modes, mode=decision.enter, goal=None)
    return replace(state, failsafe=failsafe, interrupted=interrupted), modes, decision.events


def _resumed(modes: ModeState, before: ModeState, situation: Situation) -> tuple[ModeState, tuple[Event, ...]]:
    if before.mode is modes.mode:
        return modes, ()
    if obstacle := obstacle_to(before.mode, situation):
        text = f"Failsafe over: {modes.mode.name} stays, {obstacle}"
        return modes, (Event(Severity.NOTICE, text[:50]),)
    resumed = replace(modes, mode=before.mode, goal=before.goal)
    return resumed, (Event(Severity.NOTICE, f"Failsafe over: {before.mode.name} goes on"),)


def limit_without_heading(
    state: SupervisorState, demand_rad: float, command_rad: float, modes: ModeState, now_s: float, *, heading_ok: bool
) -> tuple[SupervisorState, float]:
    """Never let the rudder stay far over without a heading: after a while she goes amidships until one is back."""
    if heading_ok or modes.mode is Mode.MANUAL or not modes.armed:
        if state.bent_s is None and not state.straightened:
            return state, demand_rad
        return replace(state, bent_s=None, straightened=False), demand_rad
    if state.straightened:
        return state, 0.0
    if abs(command_rad) <= HARD_OVER_RAD:
        return (state if state.bent_s is None else replace(state, bent_s=None)), demand_rad
    since_s = now_s if state.bent_s is None else state.bent_s
    if now_s - since_s >= HARD_OVER_S:
        return replace(state, bent_s=None, straightened=True), 0.0
    return replace(state, bent_s=since_s), demand_rad


def torque_enable(
    settings: SupervisorSettings, state: SupervisorState, command_rad: float, seen: RudderNow, now_s: float
) -> tuple[SupervisorState, bool]:
    """Return whether the servo may rest now."""
    if settings.rest_s <= 0.0 and state.rest.resting_s is None:
        return state, True
    servo = seen.servo
    sight = ServoSight(seen.angle_rad, None, None)
    if servo is not None and servo.shaft_rad is not None:
        sight = ServoSight(seen.angle_rad, servo.current_a, servo.torque_on)
    rested = torque_release.update(state.rest, command_rad, sight, now_s, settings.rest_s)
    return replace(state, rest=rested), rested.resting_s is None
