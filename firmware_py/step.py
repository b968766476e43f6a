"""One tick as a pure function: estimate, monitor, modes, guidance, control, limit.

`step(state, inputs)` reads no clock and does no input or output, so the loop, the tests
and the replay of a log compute the same rudder, bit for bit.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from firmware_py import helm, lookout
from firmware_py.angles import radians, wrap_pi, wrap_two_pi
from firmware_py.control.reference import Reference
from firmware_py.control.rudder_limit import Linkage, RudderLimits, limited_command
from firmware_py.estimate import drift, heading
from firmware_py.faults import Fault
from firmware_py.guidance.bearing import distance_and_bearing
from firmware_py.intents import Answer, ReplacePlan, Request, SetHome, SetParameter, Verdict
from firmware_py.modes import (
    ACCEPTED,
    HeadingGoal,
    ModeState,
    PositionGoal,
    Situation,
    decide,
    heading_to_steer,
    live_stick,
)
from firmware_py.monitor import MonitorState
from firmware_py.monitor import update as update_monitor
from firmware_py.params import ParameterError, ParameterSet
from firmware_py.plan import Plans
from firmware_py.plan_rules import fault_of
from firmware_py.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    Event,
    FixType,
    Home,
    Inputs,
    MissionReport,
    MissionState,
    Mode,
    Output,
    PositionSample,
    RudderCommand,
    RudderFeedback,
    Severity,
    Snapshot,
)

LATE_MEMORY_S = 2.0


@dataclass(frozen=True, slots=True)
class Settings:
    """The parameters in the units and groups that the parts compute with."""

    helm: helm.Settings
    lookout: lookout.LookoutSettings
    limits: RudderLimits
    linkage: Linkage
    observer: heading.ObserverSettings
    position_timeout_s: float
    rudder_timeout_s: float
    stick_timeout_s: float
    stick_rate_rad_s: float
    hold_s: float
    release_disarmed: bool


@functools.lru_cache(maxsize=4)
def settings_of(parameters: ParameterSet) -> Settings:
    """Convert the parameters, once for each set of values."""
    return Settings(
        helm.Settings.of(parameters),
        lookout.LookoutSettings.of(parameters),
        RudderLimits.of(parameters),
        Linkage.of(parameters),
        heading.ObserverSettings.of(parameters),
        parameters["POS_TIMEOUT_S"],
        parameters["RUD_TIMEOUT_S"],
        parameters["MAN_TIMEOUT_S"],
        radians(parameters["STK_RATE_DEG_S"]),
        parameters["CTL_HOLD_S"],
        bool(parameters["RUD_DISARMED"]),
    )


@dataclass(frozen=True, slots=True)
class State:
    """All that the autopilot remembers from tick to tick."""

    parameters: ParameterSet
    modes: ModeState
    started_s: float | None = None
    t_s: float = 0.0
    heading: heading.HeadingState = heading.HeadingState()  # noqa: RUF009 - frozen
    drift: drift.DriftState = drift.DriftState()  # noqa: RUF009 - frozen
    lookout: lookout.LookoutState = lookout.LookoutState()  # noqa: RUF009 - frozen
    reference: Reference | None = None
    monitor: MonitorState = MonitorState()  # noqa: RUF009 - frozen
    position: PositionSample | None = None
    servo: RudderFeedback | None = None
    storage: DeviceHealth | None = None
    rudder_command_rad: float = 0.0
    plans: Plans = Plans()  # noqa: RUF009 - frozen
    home: Home | None = None
    skipped_total: int = 0
    skipped_t_s: float | None = None

    @classmethod
    def at_start(cls, parameters: ParameterSet, plans: Plans | None = None) -> State:
        """The state before the first tick."""
        return cls(parameters, ModeState.at_start(parameters), plans=plans or Plans())


def _fresh(t_s: float | None, now_s: float, timeout_s: float) -> bool:
    return t_s is not None and now_s - t_s <= timeout_s


def situation_of(state: State, now_s: float) -> Situation:
    """What a decision at now_s may depend on."""
    settings = settings_of(state.parameters)
    valid = state.heading.fresh(now_s, settings.observer.timeout_s)
    return Situation(
        state.heading.heading_rad if valid else None,
        state.drift.drift_rad,
        state.position is not None and _fresh(state.position.t_s, now_s, settings.position_timeout_s),
        # A released servo of some makes gives no angle, but it answers.
        state.servo is not None and _fresh(state.servo.t_s, now_s, settings.rudder_timeout_s),
    )


def accept(state: State, request: Request) -> tuple[State, Answer]:
    """Judge one request; a refusal leaves the state as it was."""
    intent = request.intent
    judge = _JUDGES.get(type(intent))
    if judge is not None:
        return judge(state, intent, request.t_s)
    modes, answer = decide(state.modes, intent, situation_of(state, request.t_s), request.t_s)
    return (state if modes is state.modes else replace(state, modes=modes)), answer


def _set_parameter(state: State, intent: SetParameter, _t_s: float) -> tuple[State, Answer]:
    try:
        parameters = state.parameters.replaced(intent.name, intent.value)
    except ParameterError as error:
        return state, Answer(Verdict.DENIED, str(error))
    return replace(state, parameters=parameters), ACCEPTED


def _replace_plan(state: State, intent: ReplacePlan, _t_s: float) -> tuple[State, Answer]:
    if fault := fault_of(intent.plan):
        return state, Answer(Verdict.DENIED, fault.text)
    return replace(state, plans=state.plans.replaced(intent.plan)), ACCEPTED


def _set_home(state: State, intent: SetHome, t_s: float) -> tuple[State, Answer]:
    latitude_rad, longitude_rad = intent.latitude_rad, intent.longitude_rad
    if latitude_rad is None or longitude_rad is None:
        fix = state.position if situation_of(state, t_s).position_ok else None
        if fix is None or fix.latitude_rad is None or fix.longitude_rad is None:
            return state, Answer(Verdict.TEMPORARILY_REJECTED, "Home not set: no position")
        home = Home(fix.latitude_rad, fix.longitude_rad, fix.altitude_m or 0.0)
        return replace(state, home=home), ACCEPTED
    # Written so that NaN fails the comparison.
    if not (abs(latitude_rad) <= 0.5 * math.pi and abs(longitude_rad) <= math.pi and abs(intent.altitude_m) <= 1e5):
        return state, Answer(Verdict.DENIED, "Home is out of range")
    return replace(state, home=Home(latitude_rad, longitude_rad, intent.altitude_m)), ACCEPTED


# What is judged on the whole state; the rest is a matter of modes.
_JUDGES: Mapping[type, Callable[..., tuple[State, Answer]]] = {
    SetParameter: _set_parameter,
    ReplacePlan: _replace_plan,
    SetHome: _set_home,
}


def step(state: State, inputs: Inputs) -> tuple[State, Output]:
    """Compute one tick: the next state, the rudder command and what is to be told."""
    before = state
    for request in inputs.requests:
        state, _ = accept(state, request)
    settings = settings_of(state.parameters)
    state, sensed_told = _sensed(settings, state, inputs)
    now_s = inputs.tick.t_s
    monitor, faults_told = update_monitor(state.monitor, _conditions(settings, state, now_s), now_s)
    situation = situation_of(state, now_s)
    modes = _goal_kept(settings, state, situation, now_s)
    steering = _steering(modes, state.position, situation)
    step_s = min(max(0.0, now_s - before.t_s), 1.0) if before.started_s is not None else 0.0
    lost_s = monitor.since_s[Fault.COMPASS_LOST]
    demand_rad, reference = _demand_rad(settings, state, modes, steering, now_s, lost_s, step_s)
    command_rad = limited_command(settings.limits, state.rudder_command_rad, demand_rad, step_s)
    state = replace(state, monitor=monitor, modes=modes, reference=reference, rudder_command_rad=command_rad, t_s=now_s)
    command = RudderCommand(settings.linkage.to_shaft(command_rad), state.modes.armed or not settings.release_disarmed)
    told = (*_changes_told(before, state), *sensed_told, *faults_told)
    return state, Output(command, _snapshot(settings, state, situation, steering, inputs), told)


# ------------------------------------------------------------------------------ parts


def _sensed(settings: Settings, state: State, inputs: Inputs) -> tuple[State, tuple[Event, ...]]:
    """Take samples, feedback, device states and the tick's own health in; return what is to be told of them too."""
    now_s = inputs.tick.t_s
    servo = inputs.rudder[-1] if inputs.rudder else state.servo
    storage = state.storage
    for device in inputs.devices:
        if device.role is DeviceRole.STORAGE:
            storage = device
    skipped = inputs.tick.skipped
    rudder_rad = _rudder_rad(settings, state, servo)
    lookout_state, heading_state, told = lookout.looked_out(
        settings.lookout, state.lookout, state.heading, inputs.headings, inputs.positions, rudder_rad, now_s
    )
    valid = heading_state.fresh(now_s, settings.observer.timeout_s)
    position, drift_state, home = state.position, state.drift, state.home
    for sample in inputs.positions:
        if sample.fix is not FixType.NONE and _on_earth(sample):
            position = sample
            home = home or _first_home(sample)
            heading_rad = heading_state.heading_rad if valid else None
            drift_state = drift.update(drift_state, sample, heading_rad, heading_state.yaw_rate_rad_s)
    sensed = replace(
        state,
        started_s=now_s if state.started_s is None else state.started_s,
        heading=heading_state,
        lookout=lookout_state,
        drift=drift_state,
        position=position,
        home=home,
        servo=servo,
        storage=storage,
        skipped_total=state.skipped_total + skipped,
        skipped_t_s=now_s if skipped else state.skipped_t_s,
    )
    return sensed, told


def _on_earth(sample: PositionSample) -> bool:
    """Whether the sample has a position; the comparisons fail for NaN."""
    latitude_rad, longitude_rad = sample.latitude_rad, sample.longitude_rad
    if latitude_rad is None or longitude_rad is None:
        return False
    return abs(latitude_rad) <= 0.5 * math.pi and abs(longitude_rad) <= math.pi


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


def _conditions(settings: Settings, state: State, now_s: float) -> tuple[bool, ...]:
    """Whether the condition of each fault stands, in the order of faults.TABLE."""
    started_s = now_s if state.started_s is None else state.started_s
    position, servo, storage = state.position, state.servo, state.storage

    def lost(t_s: float | None, timeout_s: float) -> bool:
        return now_s - (started_s if t_s is None else t_s) > timeout_s

    return (
        lost(state.heading.sample_t_s, settings.observer.timeout_s),  # COMPASS_LOST
        position is not None and lost(position.t_s, settings.position_timeout_s),  # POSITION_LOST
        lost(servo.t_s if servo else None, settings.rudder_timeout_s),  # RUDDER_SILENT
        servo is not None and servo.hardware_error != 0,  # RUDDER_ERROR
        _fresh(state.skipped_t_s, now_s, LATE_MEMORY_S),  # LOOP_LATE
        storage is not None and storage.state is DeviceState.FAULTY,  # STORAGE_FAILING
    )


def _goal_kept(settings: Settings, state: State, situation: Situation, now_s: float) -> ModeState:
    """Give a goal to a mode that has none yet, turn it by the stick, end a turn the long way."""
    modes = state.modes
    if modes.mode not in (Mode.STEERING, Mode.GUIDED) or situation.heading_rad is None:
        return modes
    goal = modes.goal
    if goal is None:
        return replace(modes, goal=HeadingGoal(situation.heading_rad))
    if isinstance(goal, PositionGoal):
        return modes
    if modes.mode is Mode.STEERING and (stick := live_stick(modes, now_s, settings.stick_timeout_s)):
        turned_rad = stick * settings.stick_rate_rad_s * min(max(0.0, now_s - state.t_s), 1.0)
        return replace(modes, goal=HeadingGoal(wrap_two_pi(goal.heading_rad + turned_rad), goal.over_ground))
    if goal.turn:
        remaining_rad = wrap_two_pi(goal.turn * (heading_to_steer(goal, situation.drift_rad) - situation.heading_rad))
        if remaining_rad <= math.pi:
            return replace(modes, goal=replace(goal, turn=0))
    return modes


@dataclass(frozen=True, slots=True)
class Steering:
    """What guidance asks for: the heading to steer and the error that the controller sees."""

    heading_rad: float | None = None
    error_rad: float | None = None
    bearing_rad: float | None = None
    distance_m: float | None = None


def _steering(modes: ModeState, position: PositionSample | None, situation: Situation) -> Steering:
    goal = modes.goal
    if goal is None:
        return Steering()
    bearing_rad = distance_m = None
    turn = 0
    if isinstance(goal, PositionGoal):
        if position is None or position.latitude_rad is None or position.longitude_rad is None:
            return Steering()
        distance_m, bearing_rad = distance_and_bearing(
            position.latitude_rad, position.longitude_rad, goal.latitude_rad, goal.longitude_rad
        )
        steer_rad = wrap_two_pi(bearing_rad - situation.drift_rad)
    else:
        steer_rad, turn = heading_to_steer(goal, situation.drift_rad), goal.turn
    if situation.heading_rad is None:
        return Steering(steer_rad, None, bearing_rad, distance_m)
    # On a turn the long way the error stays at half a turn until the shorter way is the right one.
    error_rad = turn * math.pi if turn else wrap_pi(steer_rad - situation.heading_rad)
    return Steering(steer_rad, error_rad, bearing_rad, distance_m)


def _demand_rad(
    settings: Settings,
    state: State,
    modes: ModeState,
    steering: Steering,
    now_s: float,
    heading_lost_s: float | None,
    step_s: float,
) -> tuple[float, Reference | None]:
    """The rudder angle that mode and faults ask for, and the reference of a turn under way."""
    if not modes.armed or modes.mode is Mode.HOLD:
        return 0.0, None
    if modes.mode is Mode.MANUAL:
        stick = live_stick(modes, now_s, settings.stick_timeout_s)
        return (0.0 if stick is None else stick * settings.limits.limit_rad), None
    if steering.error_rad is not None:
        return helm.ordered(
            settings.helm,
            state.heading,
            state.lookout.waves,
            state.reference,
            steering.error_rad,
            state.rudder_command_rad,
            step_s,
        )
    held = heading_lost_s is None or now_s - heading_lost_s <= settings.hold_s
    return (state.rudder_command_rad if held else 0.0), None


def _changes_told(before: State, after: State) -> tuple[Event, ...]:
    told: list[Event] = []
    if before.started_s is None or before.modes.mode is not after.modes.mode:
        told.append(Event(Severity.INFO, f"Mode {after.modes.mode.name}"))
    if before.modes.armed is not after.modes.armed:
        told.append(Event(Severity.NOTICE, "Armed" if after.modes.armed else "Disarmed"))
    return tuple(told)


def _snapshot(settings: Settings, state: State, situation: Situation, steering: Steering, inputs: Inputs) -> Snapshot:
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
        bearing_rad=steering.bearing_rad,
        distance_m=steering.distance_m,
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
        mission=_mission_report(state),
        estimate=lookout.estimate_of(state.lookout, state.heading),
    )


def _mission_report(state: State) -> MissionReport:
    plans = state.plans
    identities = (plans.mission.identity, plans.fence.identity, plans.rally.identity)
    count = len(plans.mission.items)
    return MissionReport(
        MissionState.NOT_STARTED if count else MissionState.NO_MISSION,
        0 if count else None,
        count,
        (),
        identities,
    )
