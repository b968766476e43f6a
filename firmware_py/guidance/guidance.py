"""Guidance of a tick: selects the task by mode, goal and plans and follows it.

Called by core/step. Tasks are updated twice a second and at each fix; in between, the last result stays in force.
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

UPDATE_INTERVAL_S = 0.5
MAX_STEP_S = 5.0


class GuidanceSettings(msgspec.Struct, frozen=True):
    """Settings of tasks, of RTL destinations, and of the stick that turns a heading goal."""

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
    """State of guidance: last mode and arming, mission progress, task and its status."""

    mode: Mode | None = None
    armed: bool = False
    mission: MissionProgress = MissionProgress()
    task: Task | None = None
    follower: TaskFollowerState = TaskFollowerState()
    status: TaskStatus = TaskStatus()
    reached: tuple[int, ...] = ()
    updated_s: float | None = None
    fence: FenceState = FenceState()
    fence_enabled: bool | None = None  # None: FENCE_ENABLE applies


class GuidanceInput(msgspec.Struct, frozen=True):
    """Inputs of a tick; `heading_rad` is None without a heading, `motion` without a position.

    `fence_enabled` is FENCE_ENABLE; a later command overrides it.
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
    """State after a tick, and the new home if the mission sets one."""

    state: GuidanceState
    home: Home | None = None


def vessel_motion(place: Place, heading_rad: float, water: Water, spread_m: float = 0.0) -> VesselMotion:
    """Return the motion of the boat; `spread_m` as in VesselMotion."""
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


def update(settings: GuidanceSettings, state: GuidanceState, inputs: GuidanceInput) -> GuidanceOutput:
    """Advance guidance by a tick."""
    modes, motion = inputs.modes, inputs.motion
    before, state = state, apply_changes(state, modes, inputs.plans)
    is_new = state is not before or inputs.new_fix
    if not is_new and state.updated_s is not None and inputs.t_s - state.updated_s < UPDATE_INTERVAL_S:
        return GuidanceOutput(state)
    step_s = 0.0 if state.updated_s is None else min(max(0.0, inputs.t_s - state.updated_s), MAX_STEP_S)
    state = replace(state, updated_s=inputs.t_s)
    if motion is not None:
        state = replace(state, fence=fence.update(state.fence, inputs.plans.fence, motion.place))
    if modes.mode is Mode.AUTO:
        return _update_mission(settings, state, inputs, step_s)
    return GuidanceOutput(_follow_task(settings, state, _task(settings, state, inputs), inputs, step_s))


def apply_changes(state: GuidanceState, modes: ModeState, plans: Plans) -> GuidanceState:
    """Return the state for the present mode, arming and mission; the same object if nothing has changed."""
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
    """Return the initial state in a mode; AUTO continues its item from the present position."""
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


def _follow_task(
    settings: GuidanceSettings, state: GuidanceState, task: Task | None, inputs: GuidanceInput, step_s: float
) -> GuidanceState:
    fence_enabled = inputs.fence_enabled if state.fence_enabled is None else state.fence_enabled
    follower, status = task_follower.update(
        settings.tasks, state.follower, task, inputs.motion, step_s, inputs.plans.fence if fence_enabled else None
    )
    if status is None:
        return state  # without a position, the last target stays in force
    return replace(state, task=task, follower=follower, status=status)


def _task(settings: GuidanceSettings, state: GuidanceState, inputs: GuidanceInput) -> Task | None:
    """Return the task of a mode other than AUTO, or None."""
    task = _TASKS.get(inputs.modes.mode)
    return None if task is None else task(settings, state, inputs)


def _guided_task(settings: GuidanceSettings, _state: GuidanceState, inputs: GuidanceInput) -> Task | None:
    goal, radii = inputs.modes.goal, settings.tasks
    if not isinstance(goal, PositionGoal):
        return None
    place = Place(goal.latitude_rad, goal.longitude_rad)
    return GoTo(place, None, radii.acceptance_radius_m, radii.station_radius_m)


def _loiter_task(settings: GuidanceSettings, state: GuidanceState, inputs: GuidanceInput) -> Task | None:
    """Return the task of LOITER, whose centre is chosen once."""
    if isinstance(state.task, HoldStation):
        return HoldStation(state.task.centre, settings.tasks.station_radius_m)
    return None if inputs.motion is None else HoldStation(inputs.motion.place, settings.tasks.station_radius_m)


def _rtl_task(settings: GuidanceSettings, state: GuidanceState, inputs: GuidanceInput) -> Task | None:
    """Return the task of RTL; its destination is chosen once, and again if home or the rally points change."""
    return _return_task(settings, inputs, state.task) or state.task


# Tasks of the modes other than AUTO. A task is None if a position is needed to choose it and none is known.
_TASKS: Mapping[Mode, Callable[[GuidanceSettings, GuidanceState, GuidanceInput], Task | None]] = {
    Mode.GUIDED: _guided_task,
    Mode.LOITER: _loiter_task,
    Mode.RTL: _rtl_task,
}


def _return_task(settings: GuidanceSettings, inputs: GuidanceInput, chosen: Task | None) -> GoTo | None:
    with_home, radii = settings.rally_includes_home, settings.tasks
    if isinstance(chosen, GoTo) and chosen.place in places(inputs.home, inputs.plans.rally, with_home=with_home):
        return GoTo(chosen.place, None, radii.acceptance_radius_m, radii.station_radius_m)
    if inputs.motion is None:
        return None
    return return_task(radii, inputs.motion, inputs.home, inputs.plans.rally, with_home=with_home)


def _update_mission(
    settings: GuidanceSettings, state: GuidanceState, inputs: GuidanceInput, step_s: float
) -> GuidanceOutput:
    """Advance the mission; it stands still while disarmed."""
    if not inputs.modes.armed:
        return GuidanceOutput(state)
    motion = inputs.motion
    mission_input = MissionInput(
        settings=settings.tasks,
        steps=steps_of(inputs.plans.mission),
        heading_rad=inputs.heading_rad,
        place=None if motion is None else motion.place,
        spread_m=0.0 if motion is None else motion.spread_m,
        follower=state.follower,
        step_s=step_s,
        utc_s=inputs.utc_s,
        return_task=lambda chosen: _return_task(settings, inputs, chosen),
    )
    output = mission.update(state.mission, mission_input)
    progress, home = output.progress, None
    if output.home is not None:
        altitude_m = 0.0 if inputs.home is None else inputs.home.altitude_m
        home = Home(output.home.latitude_rad, output.home.longitude_rad, altitude_m)
    fence_enabled = state.fence_enabled if output.fence_enabled is None else output.fence_enabled
    state = replace(state, mission=progress, reached=output.reached, fence_enabled=fence_enabled)
    task = progress.pause_task if progress.paused else progress.task
    if task is not None:  # None while no position is known: the last target stays in force
        state = _follow_task(settings, state, task, inputs, step_s)
    return GuidanceOutput(state, home)


def fence_margin_m(state: GuidanceState, plans: Plans, *, enabled: bool) -> float | None:
    """Return the margin of the fence, None if it is disabled or not computed yet."""
    known = state.fence.identity == plans.fence.identity and state.fence.place is not None
    return state.fence.margin_m if enabled and plans.fence.items and known else None
