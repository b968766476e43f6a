"""Guidance of a tick: selects the task by mode, goal and plans, and follows it.

core/step calls it. Tasks are updated twice a second and at each fix; the result applies until the next update.
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
from firmware_py.guidance.mission_step import convert_mission
from firmware_py.guidance.return_point import list_destinations, return_task
from firmware_py.guidance.task_follower import TaskFollowerState, TaskStatus
from firmware_py.guidance.tasks import GoTo, HoldStation, Task, TaskSettings, VesselMotion
from firmware_py.modes import ModeState, PositionGoal

UPDATE_INTERVAL_S = 0.5
MAX_STEP_S = 5.0  # of timers and of the line integral; the rest of a longer interval is ignored


class GuidanceSettings(msgspec.Struct, frozen=True):
    """Settings of tasks, of RTL destinations, and of the stick that turns a heading goal."""

    tasks: TaskSettings
    rally_includes_home: bool
    stick_timeout_s: float
    stick_rate_rad_s: float  # at full deflection

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
    """State of guidance: last mode and arming, mission progress, task and its status.

    `reached`: indices of the mission items that ended in the last update.
    """

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


def make_vessel_motion(place: Place, heading_rad: float, water: Water, spread_m: float = 0.0) -> VesselMotion:
    """Make the motion of the boat from the estimates; `spread_m` as in VesselMotion."""
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
    previous, state = state, apply_changes(state, modes, inputs.plans)
    must_update = state is not previous or inputs.new_fix
    if not must_update and state.updated_s is not None and inputs.t_s - state.updated_s < UPDATE_INTERVAL_S:
        return GuidanceOutput(state)
    step_s = 0.0 if state.updated_s is None else min(max(0.0, inputs.t_s - state.updated_s), MAX_STEP_S)
    state = replace(state, updated_s=inputs.t_s)
    if motion is not None:
        state = replace(state, fence=fence.update(state.fence, inputs.plans.fence, motion.place))
    if modes.mode is Mode.AUTO:
        return _update_mission(settings, state, inputs, step_s)
    return GuidanceOutput(_follow_task(settings, state, _select_task(settings, state, inputs), inputs, step_s))


def apply_changes(state: GuidanceState, modes: ModeState, plans: Plans) -> GuidanceState:
    """Return the state for the present mode, arming and mission; the same object if nothing has changed."""
    if (modes.mode, modes.armed) != (state.mode, state.armed):
        state = _enter_mode(state, modes)
    previous = state.mission
    if previous.identity != plans.mission.identity:
        progress = mission_progress.for_plan(previous, plans.mission.identity)
        if modes.mode is Mode.AUTO and previous.started:
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
        return state  # without a position, the last target is kept
    return replace(state, task=task, follower=follower, status=status)


def _select_task(settings: GuidanceSettings, state: GuidanceState, inputs: GuidanceInput) -> Task | None:
    """Return the task of a mode other than AUTO, or None."""
    select = _TASK_SELECTORS.get(inputs.modes.mode)
    return None if select is None else select(settings, state, inputs)


def _select_guided_task(settings: GuidanceSettings, _state: GuidanceState, inputs: GuidanceInput) -> Task | None:
    goal, radii = inputs.modes.goal, settings.tasks
    if not isinstance(goal, PositionGoal):
        return None
    place = Place(goal.latitude_rad, goal.longitude_rad)
    return GoTo(place, None, radii.acceptance_radius_m, radii.station_radius_m)


def _select_loiter_task(settings: GuidanceSettings, state: GuidanceState, inputs: GuidanceInput) -> Task | None:
    """Return the task of LOITER; its centre is the position at the change to LOITER."""
    if isinstance(state.task, HoldStation):
        return HoldStation(state.task.centre, settings.tasks.station_radius_m)
    return None if inputs.motion is None else HoldStation(inputs.motion.place, settings.tasks.station_radius_m)


def _select_rtl_task(settings: GuidanceSettings, state: GuidanceState, inputs: GuidanceInput) -> Task | None:
    """Return the task of RTL; its destination is selected again only if home or the rally points change."""
    return _return_task(settings, inputs, state.task) or state.task


# Selectors of the task in modes other than AUTO; they return None if they need a position and none is known.
_TASK_SELECTORS: Mapping[Mode, Callable[[GuidanceSettings, GuidanceState, GuidanceInput], Task | None]] = {
    Mode.GUIDED: _select_guided_task,
    Mode.LOITER: _select_loiter_task,
    Mode.RTL: _select_rtl_task,
}


def _return_task(settings: GuidanceSettings, inputs: GuidanceInput, present: Task | None) -> GoTo | None:
    """Return the return task; the destination of the present task is kept while it is valid."""
    with_home, radii = settings.rally_includes_home, settings.tasks
    if isinstance(present, GoTo) and present.place in list_destinations(
        inputs.home, inputs.plans.rally, with_home=with_home
    ):
        return GoTo(present.place, None, radii.acceptance_radius_m, radii.station_radius_m)
    if inputs.motion is None:
        return None
    return return_task(radii, inputs.motion, inputs.home, inputs.plans.rally, with_home=with_home)


def _update_mission(
    settings: GuidanceSettings, state: GuidanceState, inputs: GuidanceInput, step_s: float
) -> GuidanceOutput:
    """Advance the mission; it stops while the boat is disarmed."""
    if not inputs.modes.armed:
        return GuidanceOutput(state)
    motion = inputs.motion
    mission_input = MissionInput(
        settings=settings.tasks,
        steps=convert_mission(inputs.plans.mission),
        heading_rad=inputs.heading_rad,
        place=None if motion is None else motion.place,
        spread_m=0.0 if motion is None else motion.spread_m,
        follower=state.follower,
        step_s=step_s,
        utc_s=inputs.utc_s,
        return_task=lambda present: _return_task(settings, inputs, present),
    )
    output = mission.update(state.mission, mission_input)
    progress, home = output.progress, None
    if output.home is not None:
        altitude_m = 0.0 if inputs.home is None else inputs.home.altitude_m
        home = Home(output.home.latitude_rad, output.home.longitude_rad, altitude_m)
    fence_enabled = state.fence_enabled if output.fence_enabled is None else output.fence_enabled
    state = replace(state, mission=progress, reached=output.reached, fence_enabled=fence_enabled)
    task = progress.pause_task if progress.paused else progress.task
    if task is not None:  # None while no position is known: the last target is kept
        state = _follow_task(settings, state, task, inputs, step_s)
    return GuidanceOutput(state, home)


def fence_margin_m(state: GuidanceState, plans: Plans, *, enabled: bool) -> float | None:
    """Return the margin of the fence in metres, or None if the fence is disabled, empty or not computed yet."""
    is_computed = state.fence.identity == plans.fence.identity and state.fence.place is not None
    return state.fence.margin_m if enabled and plans.fence.items and is_computed else None
