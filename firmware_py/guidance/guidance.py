"""The guidance of a tick: from mode, goal and plans to the heading to steer.

Only puts together what modes and guidance compute; core/step calls it. Tasks are carried out
twice a second and at each fix: in between the last answer stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.reports import Home, Water
from firmware_py.guidance import fence, mission, mission_progress, task_follower
from firmware_py.guidance.fence import FenceState
from firmware_py.guidance.mission import MissionInput
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.guidance.mission_step import steps_of
from firmware_py.guidance.return_point import places, return_task
from firmware_py.guidance.task_follower import TaskFollowerState, TaskStatus
from firmware_py.guidance.tasks import GoTo, HoldStation, Task, TaskSettings, VesselMotion
from firmware_py.modes import ModeState, PositionGoal

INTERVAL_S = 0.5
LONGEST_STEP_S = 5.0


class GuidanceSettings(msgspec.Struct, frozen=True):
    """How tasks are carried out, where RTL may go, and how the stick turns a goal."""

    tasks: TaskSettings
    rally_includes_home: bool
    stick_timeout_s: float
    stick_rate_rad_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> GuidanceSettings:
        """Read the settings from the parameters."""
        return cls(
            tasks=TaskSettings.of(parameters),
            rally_includes_home=bool(parameters["RALLY_INCL_HOME"]),
            stick_timeout_s=parameters["MAN_TIMEOUT_S"],
            stick_rate_rad_s=math.radians(parameters["STK_RATE_DEG_S"]),
        )


class GuidanceState(msgspec.Struct, frozen=True):
    """What guidance remembers: mode and arming that it knows of, mission, task, and what came of it."""

    mode: Mode | None = None
    armed: bool = False
    mission: MissionProgress = MissionProgress()
    task: Task | None = None
    follower: TaskFollowerState = TaskFollowerState()
    status: TaskStatus = TaskStatus()
    reached: tuple[int, ...] = ()
    updated_s: float | None = None
    fence: FenceState = FenceState()
    fence_enabled: bool | None = None  # None: as FENCE_ENABLE says


class GuidanceInput(msgspec.Struct, frozen=True):
    """What guidance looks at in a tick; `heading_rad` is None without a heading, `motion` without a position.

    `fence_enabled` is what FENCE_ENABLE says, where nobody has asked otherwise since.
    """

    t_s: float
    heading_rad: float | None
    motion: VesselMotion | None
    new_fix: bool
    modes: ModeState
    plans: Plans
    home: Home | None
    utc_s: float | None
    fence_enabled: bool = False


class GuidanceOutput(msgspec.Struct, frozen=True):
    """The state after a tick, and home where the mission sets it."""

    state: GuidanceState
    home: Home | None = None


def vessel_motion(place: Place, heading_rad: float, water: Water, spread_m: float = 0.0) -> VesselMotion:
    """Return how the boat moves, for guidance; spread_m as there."""
    return VesselMotion(
        place=place,
        heading_rad=heading_rad,
        speed_m_s=water.speed_m_s,
        current_north_m_s=water.current_north_m_s,
        current_east_m_s=water.current_east_m_s,
        leeway_rad=water.leeway_rad,
        too_strong=water.too_strong,
        spread_m=spread_m,
    )


def update(settings: GuidanceSettings, state: GuidanceState, given: GuidanceInput) -> GuidanceOutput:
    """Carry mode, goal and mission on by a tick."""
    modes, motion = given.modes, given.motion
    before, state = state, take_changes(state, modes, given.plans)
    is_new = state is not before or given.new_fix
    if not is_new and state.updated_s is not None and given.t_s - state.updated_s < INTERVAL_S:
        return GuidanceOutput(state)
    step_s = 0.0 if state.updated_s is None else min(max(0.0, given.t_s - state.updated_s), LONGEST_STEP_S)
    state = replace(state, updated_s=given.t_s)
    if motion is not None:
        state = replace(state, fence=fence.update(state.fence, given.plans.fence, motion.place))
    if modes.mode is Mode.AUTO:
        return _update_mission(settings, state, given, step_s)
    return GuidanceOutput(_carry_out(settings, state, _task(settings, state, given), given, step_s))


def take_changes(state: GuidanceState, modes: ModeState, plans: Plans) -> GuidanceState:
    """Return the state for the mode, arming and mission that are in force; the very same while nothing changes."""
    if (modes.mode, modes.armed) != (state.mode, state.armed):
        state = _enter_mode(state, modes)
    before = state.mission
    if before.identity != plans.mission.identity:
        progress = mission_progress.for_plan(before, plans.mission.identity)
        if modes.mode is Mode.AUTO and before.started:
            progress = mission_progress.enter(progress)
        state = replace(state, mission=progress)
    return replace(state, reached=()) if state.reached else state


def _enter_mode(state: GuidanceState, modes: ModeState) -> GuidanceState:
    """Begin anew in a mode; AUTO goes on with its item, from where the boat is."""
    progress = state.mission
    if modes.mode is Mode.AUTO and modes.armed:
        progress = mission_progress.enter(progress)
    return GuidanceState(
        modes.mode,
        modes.armed,
        progress,
        updated_s=state.updated_s,
        fence=state.fence,
        fence_enabled=state.fence_enabled,
    )


def _carry_out(
    settings: GuidanceSettings, state: GuidanceState, task: Task | None, given: GuidanceInput, step_s: float
) -> GuidanceState:
    heeded = given.fence_enabled if state.fence_enabled is None else state.fence_enabled
    follower, status = task_follower.update(
        settings.tasks, state.follower, task, given.motion, step_s, given.plans.fence if heeded else None
    )
    if status is None:
        return state  # without a position what was wanted last stands
    return replace(state, task=task, follower=follower, status=status)


def _task(settings: GuidanceSettings, state: GuidanceState, given: GuidanceInput) -> Task | None:
    """Return the task of a mode other than AUTO; None where it has none."""
    task = _TASKS.get(given.modes.mode)
    return None if task is None else task(settings, state, given)


def _guided_task(settings: GuidanceSettings, _state: GuidanceState, given: GuidanceInput) -> Task | None:
    goal, radii = given.modes.goal, settings.tasks
    if not isinstance(goal, PositionGoal):
        return None
    place = Place(goal.latitude_rad, goal.longitude_rad)
    return GoTo(place, None, radii.acceptance_radius_m, radii.station_radius_m)


def _loiter_task(settings: GuidanceSettings, state: GuidanceState, given: GuidanceInput) -> Task | None:
    """LOITER chooses its place once."""
    if isinstance(state.task, HoldStation):
        return HoldStation(state.task.centre, settings.tasks.station_radius_m)
    return None if given.motion is None else HoldStation(given.motion.place, settings.tasks.station_radius_m)


def _rtl_task(settings: GuidanceSettings, state: GuidanceState, given: GuidanceInput) -> Task | None:
    """RTL chooses its place once, and anew where that is none any more: home was set, or stood where she never was."""
    return _return_task(settings, given, state.task) or state.task


# What a mode does that follows a task of its own; AUTO takes its tasks from the mission. A task that needs where the
# boat is to be chosen is None without a position; one that needs it to be carried out stands still (task_follower).
_TASKS: Mapping[Mode, Callable[[GuidanceSettings, GuidanceState, GuidanceInput], Task | None]] = {
    Mode.GUIDED: _guided_task,
    Mode.LOITER: _loiter_task,
    Mode.RTL: _rtl_task,
}


def _return_task(settings: GuidanceSettings, given: GuidanceInput, chosen: Task | None) -> GoTo | None:
    with_home, radii = settings.rally_includes_home, settings.tasks
    if isinstance(chosen, GoTo) and chosen.place in places(given.home, given.plans.rally, with_home=with_home):
        return GoTo(chosen.place, None, radii.acceptance_radius_m, radii.station_radius_m)
    if given.motion is None:
        return None
    return return_task(radii, given.motion, given.home, given.plans.rally, with_home=with_home)


def _update_mission(
    settings: GuidanceSettings, state: GuidanceState, given: GuidanceInput, step_s: float
) -> GuidanceOutput:
    """Carry the mission on; disarmed the boat is where it is, and so is the mission."""
    if not given.modes.armed:
        return GuidanceOutput(state)
    motion = given.motion
    mission_input = MissionInput(
        settings=settings.tasks,
        steps=steps_of(given.plans.mission),
        heading_rad=given.heading_rad,
        place=None if motion is None else motion.place,
        spread_m=0.0 if motion is None else motion.spread_m,
        follower=state.follower,
        step_s=step_s,
        utc_s=given.utc_s,
        return_task=lambda chosen: _return_task(settings, given, chosen),
    )
    output = mission.update(state.mission, mission_input)
    progress, home = output.progress, None
    if output.home is not None:
        altitude_m = 0.0 if given.home is None else given.home.altitude_m
        home = Home(output.home.latitude_rad, output.home.longitude_rad, altitude_m)
    fence_enabled = state.fence_enabled if output.fence_enabled is None else output.fence_enabled
    state = replace(state, mission=progress, reached=output.reached, fence_enabled=fence_enabled)
    task = progress.pause_task if progress.paused else progress.task
    if task is not None:  # None where it is not known yet where to stay: what was wanted last stands
        state = _carry_out(settings, state, task, given, step_s)
    return GuidanceOutput(state, home)


def fence_margin_m(state: GuidanceState, plans: Plans, *, enabled: bool) -> float | None:
    """Return the margin of a fence that is heeded and known."""
    known = state.fence.identity == plans.fence.identity and state.fence.place is not None
    return state.fence.margin_m if enabled and plans.fence.items and known else None
