"""Supervisor of a tick: monitors of rudder and steering, failsafes, and limit of the rudder without a heading."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import radians
from firmware_py.common.intents import Arm, Intent, PauseMission, SetMissionItem, SetMode, SteerHeading, SteerPosition
from firmware_py.common.mode_table import FAILSAFE_MODES, MODES, Mode, RudderBy
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Event, RudderStatus, Severity
from firmware_py.faults.table import TABLE, Fault
from firmware_py.model.kt import KtModel
from firmware_py.modes import ModeState, Situation, enter, mode_refusal
from firmware_py.safety import convergence, oscillation, rudder_monitor, steering_monitor
from firmware_py.safety.convergence import ConvergenceState
from firmware_py.safety.failsafe import FailsafeInput, FailsafeState, decide
from firmware_py.safety.oscillation import OscillationInput, OscillationState
from firmware_py.safety.rudder_monitor import RudderMonitorSettings, RudderMonitorState
from firmware_py.safety.steering_monitor import SteeringInput, SteeringMonitorState

# Without a heading: command that would turn the boat in circles; larger than any rudder angle for trim and wind.
HARD_OVER_RAD: Final = radians(8.0)
HARD_OVER_S: Final = 30.0
# Intents that end a failsafe.
OVERRULING: Final[tuple[type[Intent], ...]] = (Arm, PauseMission, SetMissionItem, SetMode, SteerHeading, SteerPosition)


class SupervisorSettings(msgspec.Struct, frozen=True):
    """Settings of the monitors, failsafe mode of each fault, and limits of the faults.

    `failsafe_modes`: for the faults with a parameter; None: alert only. `resume`: the interrupted mode resumes.
    `hot_c`: servo temperature. `low_v`: supply voltage at the servo. `station_s`: time without a ground station.
    """

    rudder_monitor: RudderMonitorSettings
    model: KtModel
    servo_reversed: bool
    rudder_limit_rad: float
    failsafe_modes: Mapping[Fault, Mode | None]
    resume: bool
    hot_c: float
    low_v: float
    station_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> SupervisorSettings:
        """Read the settings from the parameters."""
        return cls(
            rudder_monitor=RudderMonitorSettings.of(parameters),
            model=KtModel.of(parameters),
            servo_reversed=bool(parameters["RUD_REVERSE"]),
            rudder_limit_rad=radians(parameters["RUD_LIMIT_DEG"]),
            failsafe_modes={
                fault: FAILSAFE_MODES.get(int(parameters[row.parameter]))
                for fault, row in TABLE.items()
                if row.parameter
            },
            resume=bool(parameters["FS_RESUME"]),
            hot_c=parameters["RUD_TEMP_MAX"],
            low_v=parameters["BAT_LOW_VOLT"],
            station_s=parameters["FS_GCS_S"],
        )


class SupervisorState(msgspec.Struct, frozen=True):
    """States of the monitors and the failsafes.

    `interrupted`: mode and goal before the failsafe. `left`: mode and goal of the failsafe, which stay after it without
    FS_RESUME. `hard_over_s`: time since which the rudder command exceeds HARD_OVER_RAD without a heading.
    `kept_amidships`: the rudder is centred, because this has lasted for HARD_OVER_S.
    """

    rudder_monitor: RudderMonitorState = RudderMonitorState()
    steering_monitor: SteeringMonitorState = steering_monitor.START
    oscillation: OscillationState = oscillation.START
    convergence: ConvergenceState = convergence.IDLE
    failsafe: FailsafeState = FailsafeState()
    interrupted: ModeState | None = None
    left: ModeState | None = None
    hard_over_s: float | None = None
    kept_amidships: bool = False

    def mode_after_failsafe(self, *, resume: bool) -> ModeState | None:
        """Return mode and goal for after the active failsafe, or None without one; `resume`: FS_RESUME."""
        return self.interrupted if resume or self.left is None else self.left


def update(
    settings: SupervisorSettings, state: SupervisorState, rudder: RudderStatus, *, is_engaged: bool
) -> SupervisorState:
    """Update the rudder monitor; `is_engaged`: the servo torque is on, or not known to be off."""
    monitor = rudder_monitor.update(settings.rudder_monitor, state.rudder_monitor, rudder, is_engaged=is_engaged)
    return state if monitor is state.rudder_monitor else replace(state, rudder_monitor=monitor)


def judge_steering(
    settings: SupervisorSettings,
    state: SupervisorState,
    steering: SteeringInput,
    oscillation_input: OscillationInput,
    now_s: float,
) -> SupervisorState:
    """Update the monitors of steering, limit cycle and convergence of the heading."""
    return replace(
        state,
        steering_monitor=steering_monitor.update(
            settings.model, settings.servo_reversed, state.steering_monitor, steering, now_s
        ),
        oscillation=oscillation.update(settings.model, state.oscillation, oscillation_input, now_s),
        convergence=convergence.update(
            state.convergence,
            oscillation_input.error_rad,
            oscillation_input.rudder_rad,
            settings.rudder_limit_rad,
            now_s,
        ),
    )


def apply_failsafe(
    settings: SupervisorSettings,
    state: SupervisorState,
    modes: ModeState,
    active: int,
    situation: Situation,
    *,
    overruled: bool,
) -> tuple[SupervisorState, ModeState, tuple[Event, ...]]:
    """Return the state and the mode after the decision of the failsafes, and the events."""
    failsafe_input = FailsafeInput(
        active,
        modes.mode,
        modes.by_failsafe,
        modes.armed,
        overruled,
        settings.failsafe_modes,
        lambda mode: not mode_refusal(mode, situation),
        settings.resume,
    )
    previous = state.failsafe
    failsafe, decision = decide(previous, failsafe_input)
    if failsafe is previous and decision.enter is None and not decision.resume:
        return state, modes, ()
    if failsafe.fault is None:
        ended = replace(state, failsafe=failsafe, interrupted=None, left=None)
        resumed_modes = state.mode_after_failsafe(resume=settings.resume)
        if decision.resume and resumed_modes is not None:
            return ended, *_resume(modes, resumed_modes, situation)
        return ended, modes, decision.events
    interrupted, left = state.interrupted, state.left
    if previous.fault is None or overruled:
        interrupted, left = modes, None
    if decision.enter is not None:
        entered, _ = enter(modes, decision.enter, situation)
        modes = entered if entered.mode is decision.enter else replace(modes, mode=decision.enter, goal=None)
        modes = replace(modes, by_failsafe=True)
    if not TABLE[failsafe.fault].always_resumes and (failsafe.fault, failsafe.mode) != (previous.fault, previous.mode):
        left = modes
    return replace(state, failsafe=failsafe, interrupted=interrupted, left=left), modes, decision.events


def _resume(modes: ModeState, interrupted: ModeState, situation: Situation) -> tuple[ModeState, tuple[Event, ...]]:
    """Return the interrupted mode if it is possible, otherwise the present one, and the event."""
    if interrupted.mode is modes.mode:
        event = Event(Severity.NOTICE, f"Failsafe ended: {modes.mode.name} stays until a mode is set")
        return replace(modes, by_failsafe=interrupted.by_failsafe), (event,) if interrupted.by_failsafe else ()
    # The operator has to choose MANUAL again, because it is not known whether the stick is in use.
    is_manual = MODES[interrupted.mode].rudder_by is RudderBy.STICK
    if refusal := "no stick input" if is_manual else mode_refusal(interrupted.mode, situation):
        text = f"Failsafe ended: {modes.mode.name} kept, {refusal}"
        return modes, (Event(Severity.NOTICE, text[:50]),)
    resumed = replace(modes, mode=interrupted.mode, goal=interrupted.goal, by_failsafe=interrupted.by_failsafe)
    return resumed, (Event(Severity.NOTICE, f"Failsafe ended: {interrupted.mode.name} resumed"),)


def limit_without_heading(
    state: SupervisorState, demand_rad: float, command_rad: float, modes: ModeState, now_s: float, *, has_heading: bool
) -> tuple[SupervisorState, float]:
    """Return state and demand [rad]; without a heading 0, after HARD_OVER_S with a command above HARD_OVER_RAD."""
    if has_heading or MODES[modes.mode].rudder_by is RudderBy.STICK or not modes.armed:
        if state.hard_over_s is None and not state.kept_amidships:
            return state, demand_rad
        return replace(state, hard_over_s=None, kept_amidships=False), demand_rad
    if state.kept_amidships:
        return state, 0.0
    if abs(command_rad) <= HARD_OVER_RAD:
        return (state if state.hard_over_s is None else replace(state, hard_over_s=None)), demand_rad
    since_s = now_s if state.hard_over_s is None else state.hard_over_s
    if now_s - since_s >= HARD_OVER_S:
        return replace(state, hard_over_s=None, kept_amidships=True), 0.0
    return replace(state, hard_over_s=since_s), demand_rad
