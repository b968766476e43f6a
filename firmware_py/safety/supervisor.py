"""Supervisor of a tick: monitors of rudder and steering, failsafes, and the rudder without a heading."""

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
from firmware_py.modes import ModeState, Situation, enter, obstacle_to
from firmware_py.safety import convergence, oscillation, rudder_monitor, steering_monitor
from firmware_py.safety.convergence import ConvergenceState
from firmware_py.safety.failsafe import FailsafeInput, FailsafeState, decide
from firmware_py.safety.oscillation import OscillationInput, OscillationState
from firmware_py.safety.rudder_monitor import RudderMonitorSettings, RudderMonitorState
from firmware_py.safety.steering_monitor import SteeringInput, SteeringMonitorState

HARD_OVER_RAD: Final = radians(8.0)  # more than trim and wind need
HARD_OVER_S: Final = 30.0
# An intent after which a failsafe that has acted is over.
OVERRULING: Final[tuple[type[Intent], ...]] = (
    Arm,
    PauseMission,
    SetMissionItem,
    SetMode,
    SteerHeading,
    SteerPosition,
)


class SupervisorSettings(msgspec.Struct, frozen=True):
    """Failsafe mode of each fault, whether the interrupted mode resumes after it, and limits of the faults.

    `failsafe_modes`: of the faults with a parameter; None: alert only.
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
    """State of the supervisor.

    `interrupted`: mode and goal before the failsafe. `left`: those that the failsafe chose, which stay without
    FS_RESUME. `hard_over_s`: since when the rudder is far over without a heading. `kept_amidships`: that has ended.
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
        """Return mode and goal after the failsafe that acts; None: none acts. `resume`: FS_RESUME."""
        return self.interrupted if resume or self.left is None else self.left


def update(
    settings: SupervisorSettings, state: SupervisorState, rudder: RudderStatus, *, engaged: bool
) -> SupervisorState:
    """Update the rudder monitor; `engaged`: the servo torque is on, as far as it is known."""
    monitor = rudder_monitor.update(settings.rudder_monitor, state.rudder_monitor, rudder, engaged=engaged)
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
    """Return state and mode after the decision of the failsafes, and the events."""
    failsafe_input = FailsafeInput(
        active,
        modes.mode,
        modes.by_failsafe,
        modes.armed,
        overruled,
        settings.failsafe_modes,
        lambda mode: not obstacle_to(mode, situation),
        settings.resume,
    )
    before = state.failsafe
    failsafe, decision = decide(before, failsafe_input)
    if failsafe is before and decision.enter is None and not decision.resume:
        return state, modes, ()
    if failsafe.fault is None:
        ended = replace(state, failsafe=failsafe, interrupted=None, left=None)
        resumed = state.mode_after_failsafe(resume=settings.resume)
        if decision.resume and resumed is not None:
            return ended, *_resumed(modes, resumed, situation)
        return ended, modes, decision.events
    interrupted, left = state.interrupted, state.left
    if before.fault is None or overruled:
        interrupted, left = modes, None
    if decision.enter is not None:
        entered, _ = enter(modes, decision.enter, situation)
        modes = entered if entered.mode is decision.enter else replace(modes, mode=decision.enter, goal=None)
        modes = replace(modes, by_failsafe=True)
    if not TABLE[failsafe.fault].always_resumes and (failsafe.fault, failsafe.mode) != (before.fault, before.mode):
        left = modes
    return replace(state, failsafe=failsafe, interrupted=interrupted, left=left), modes, decision.events


def _resumed(modes: ModeState, before: ModeState, situation: Situation) -> tuple[ModeState, tuple[Event, ...]]:
    if before.mode is modes.mode:
        stays = Event(Severity.NOTICE, f"Failsafe ended: {modes.mode.name} stays until a mode is set")
        return replace(modes, by_failsafe=before.by_failsafe), (stays,) if before.by_failsafe else ()
    # The operator has to choose MANUAL again, because it is not known whether the stick is in use.
    by_stick = MODES[before.mode].rudder_by is RudderBy.STICK
    if obstacle := "no stick input" if by_stick else obstacle_to(before.mode, situation):
        text = f"Failsafe ended: {modes.mode.name} kept, {obstacle}"
        return modes, (Event(Severity.NOTICE, text[:50]),)
    resumed = replace(modes, mode=before.mode, goal=before.goal, by_failsafe=before.by_failsafe)
    return resumed, (Event(Severity.NOTICE, f"Failsafe ended: {before.mode.name} resumed"),)


def limit_without_heading(
    state: SupervisorState, demand_rad: float, command_rad: float, modes: ModeState, now_s: float, *, heading_ok: bool
) -> tuple[SupervisorState, float]:
    """Return the rudder demand limited without a heading: amidships after HARD_OVER_S with the rudder far over."""
    if heading_ok or MODES[modes.mode].rudder_by is RudderBy.STICK or not modes.armed:
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
