"""Apply requests to the state: a pure function, called on arrival and again, with the same answer, in the next tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from msgspec.structs import replace

from firmware_py.common.intents import (
    Answer,
    EnableFence,
    PauseMission,
    ReplacePlan,
    ReportBattery,
    Request,
    SetHome,
    SetMissionItem,
    SetMode,
    SetParameter,
    Verdict,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import index_of
from firmware_py.common.plan import PlanKind
from firmware_py.common.records import PowerSample
from firmware_py.common.reports import Home
from firmware_py.core.state import State, first_item, situation_at
from firmware_py.estimate.position import place_of
from firmware_py.guidance import mission_progress
from firmware_py.guidance.mission_step import convert_mission
from firmware_py.modes import ACCEPTED, decide
from firmware_py.plans.validation import problem_of
from firmware_py.safety import power_monitor
from firmware_py.safety.supervisor import OVERRULING


def accept(state: State, request: Request) -> tuple[State, Answer]:
    """Apply one request; a refusal leaves the state unchanged. An accepted command overrules a failsafe."""
    accepted, answer = _apply(state, request)
    if accepted.modes.by_failsafe and answer.verdict is Verdict.ACCEPTED and isinstance(request.intent, OVERRULING):
        accepted = replace(accepted, modes=replace(accepted.modes, by_failsafe=False))
    return accepted, answer


def _apply(state: State, request: Request) -> tuple[State, Answer]:
    """Return the state after a request, and the answer, without the effect on a failsafe."""
    intent = request.intent
    handler = _HANDLERS.get(type(intent))
    if handler is not None:
        return handler(state, intent, request.t_s)
    modes, answer = decide(state.modes, intent, situation_at(state, request.t_s), request.t_s)
    return (state if modes is state.modes else replace(state, modes=modes)), answer


def _set_parameter(state: State, intent: SetParameter, _t_s: float) -> tuple[State, Answer]:
    try:
        if TABLE[index_of(intent.name)].read_only:
            return state, Answer(Verdict.DENIED, f"{intent.name} is read-only")
        parameters = state.parameters.replaced(intent.name, intent.value)
    except ParameterError as error:
        return state, Answer(Verdict.DENIED, str(error))
    if intent.name == "FENCE_ENABLE":
        # A changed parameter replaces earlier fence commands.
        state = replace(state, guidance=replace(state.guidance, fence_enabled=None))
    return replace(state, parameters=parameters), ACCEPTED


def _replace_plan(state: State, intent: ReplacePlan, _t_s: float) -> tuple[State, Answer]:
    if problem := problem_of(intent.plan):
        first_number = first_item(state) if intent.plan.kind is PlanKind.MISSION else 0
        return state, Answer(Verdict.DENIED, problem.message(first_number))
    return replace(state, plans=state.plans.replaced(intent.plan)), ACCEPTED


def _set_home(state: State, intent: SetHome, t_s: float) -> tuple[State, Answer]:
    latitude_rad, longitude_rad = intent.latitude_rad, intent.longitude_rad
    if latitude_rad is None or longitude_rad is None:
        fix = state.position.fix if situation_at(state, t_s).position_ok else None
        if fix is None:
            return state, Answer(Verdict.TEMPORARILY_REJECTED, "Home refused: no position")
        place = place_of(fix)
        return replace(state, home=Home(place.latitude_rad, place.longitude_rad, fix.altitude_m or 0.0)), ACCEPTED
    # With NaN a comparison is false.
    if not (abs(latitude_rad) <= 0.5 * math.pi and abs(longitude_rad) <= math.pi and abs(intent.altitude_m) <= 1e5):
        return state, Answer(Verdict.DENIED, "Home refused: position out of range")
    return replace(state, home=Home(latitude_rad, longitude_rad, intent.altitude_m)), ACCEPTED


def _set_mission_item(state: State, intent: SetMissionItem, _t_s: float) -> tuple[State, Answer]:
    count = len(state.plans.mission.items)
    if not count:
        return state, Answer(Verdict.TEMPORARILY_REJECTED, "There is no mission")
    if not 0 <= intent.index < count:
        first_number = first_item(state)
        numbers = f"{first_number} to {first_number + count - 1}"
        text = f"Item {first_number + intent.index} refused: mission has items {numbers}"
        return state, Answer(Verdict.DENIED, text)
    progress = mission_progress.for_plan(state.guidance.mission, state.plans.mission.identity)
    progress = mission_progress.at_item(progress, intent.index, restart=intent.restart)
    return replace(state, guidance=replace(state.guidance, mission=progress)), ACCEPTED


def _pause_mission(state: State, intent: PauseMission, _t_s: float) -> tuple[State, Answer]:
    if state.modes.mode is not Mode.AUTO:
        return state, Answer(
            Verdict.TEMPORARILY_REJECTED, f"Pause refused in {state.modes.mode.name}: only AUTO has a mission"
        )
    progress = mission_progress.for_plan(state.guidance.mission, state.plans.mission.identity)
    if intent.paused:
        progress = mission_progress.pause(progress)
    else:
        progress = mission_progress.resume_mission(progress, convert_mission(state.plans.mission))
    return replace(state, guidance=replace(state.guidance, mission=progress)), ACCEPTED


def _set_mode(state: State, intent: SetMode, t_s: float) -> tuple[State, Answer]:
    """Enter a mode; AUTO resumes a paused mission and restarts a complete one."""
    modes, answer = decide(state.modes, intent, situation_at(state, t_s), t_s)
    if answer.verdict is not Verdict.ACCEPTED:
        return state, answer
    previous, guidance = state.guidance.mission, state.guidance
    if modes.mode is Mode.AUTO:
        progress = mission_progress.for_plan(previous, state.plans.mission.identity)
        progress = mission_progress.resume_mission(progress, convert_mission(state.plans.mission))
        if progress.complete and not progress.unusable:
            progress = mission_progress.enter(progress)
        guidance = guidance if progress is previous else replace(guidance, mission=progress)
    return replace(state, modes=modes, guidance=guidance), answer


def _enable_fence(state: State, intent: EnableFence, _t_s: float) -> tuple[State, Answer]:
    if intent.enabled and not state.plans.fence.items:
        return state, Answer(Verdict.TEMPORARILY_REJECTED, "There is no fence")
    return replace(state, guidance=replace(state.guidance, fence_enabled=intent.enabled)), ACCEPTED


# Valid ranges of a battery report, in the units of PowerSample.
_BATTERY_RANGES = {
    "voltage_v": (0.0, 1000.0),
    "current_a": (-5000.0, 5000.0),
    "charge": (0.0, 1.0),
    "temperature_c": (-60.0, 150.0),
}


def _report_battery(state: State, intent: ReportBattery, t_s: float) -> tuple[State, Answer]:
    values = {name: getattr(intent, name) for name in _BATTERY_RANGES}
    for name, (low, high) in _BATTERY_RANGES.items():
        # With NaN a comparison is false.
        if values[name] is not None and not low <= values[name] <= high:
            return state, Answer(Verdict.DENIED, "Battery report refused: value out of range")
    sample = PowerSample(t_s, power_monitor.COMPANION, **values)
    return replace(state, power=power_monitor.update(state.power, (sample,))), ACCEPTED


# Intents that need the whole state; modes.py decides the others.
_HANDLERS: Mapping[type, Callable[..., tuple[State, Answer]]] = {
    SetParameter: _set_parameter,
    ReplacePlan: _replace_plan,
    SetHome: _set_home,
    SetMissionItem: _set_mission_item,
    PauseMission: _pause_mission,
    EnableFence: _enable_fence,
    SetMode: _set_mode,
    ReportBattery: _report_battery,
}
