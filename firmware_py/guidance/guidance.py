"""The guidance of a tick: from mode, goal and plans to the heading to steer.

Only puts together what modes and guidance compute; `step` calls it. Orders are carried out
twice a second and at each fix: in between the last answer stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from firmware_py.common.angles import wrap_pi, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.records import Activity, Event, Home, MissionReport, Mode, Navigation, Severity, Water
from firmware_py.guidance import fence, mission, task_follower
from firmware_py.guidance.fence import FenceState
from firmware_py.guidance.mission import MissionInput, MissionProgress
from firmware_py.guidance.mission_step import steps_of
from firmware_py.guidance.return_point import way_back
from firmware_py.guidance.task_follower import TaskFollowerState, TaskStatus
from firmware_py.guidance.tasks import GoTo, HoldStation, Task, TaskSettings, VesselMotion
from firmware_py.model.crab import heading_for_course
from firmware_py.modes import HeadingGoal, ModeState, PositionGoal, Situation, heading_to_steer, live_stick

INTERVAL_S = 0.5
LONGEST_STEP_S = 5.0
_GOING_MODES = (Mode.GUIDED, Mode.LOITER, Mode.AUTO, Mode.RTL)


@dataclass(frozen=True, slots=True)
class GuidanceSettings:
    """What guidance is set to."""

    guidance: TaskSettings
    rally_includes_home: bool
    stick_timeout_s: float
    stick_rate_rad_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> GuidanceSettings:
        """Read the settings from the parameters."""
        return cls(
            TaskSettings.of(parameters),
            bool(parameters["RALLY_INCL_HOME"]),
            parameters["MAN_TIMEOUT_S"],
            math.radians(parameters["STK_RATE_DEG_S"]),
        )


@dataclass(frozen=True, slots=True)
class GuidanceState:
    """What guidance remembers: mode and arming that it knows of, mission, order, and what came of it."""

    mode: Mode | None = None
    armed: bool = False
    mission: MissionProgress = MissionProgress()  # noqa: RUF009 - frozen
    order: Task | None = None
    follow: TaskFollowerState = TaskFollowerState()  # noqa: RUF009 - frozen
    followed: TaskStatus = TaskStatus()  # noqa: RUF009 - frozen
    reached: tuple[int, ...] = ()
    done_s: float | None = None
    fence: FenceState = FenceState()  # noqa: RUF009 - frozen
    fence_enabled: bool | None = None  # None: as FENCE_ENABLE says


@dataclass(frozen=True, slots=True)
class GuidanceInput:
    """What guidance looks at in a tick; `motion` is None without a position."""

    t_s: float
    motion: VesselMotion | None
    new_fix: bool
    modes: ModeState
    plans: Plans
    home: Home | None
    utc_s: float | None


@dataclass(frozen=True, slots=True)
class GuidanceOutput:
    """What came of it: the state, what to tell, and home where the mission sets it."""

    nav: GuidanceState
    events: tuple[Event, ...] = ()
    home: Home | None = None


@dataclass(frozen=True, slots=True)
class SteeringTarget:
    """What guidance asks for: the heading to steer and the error that the controller sees."""

    heading_rad: float | None = None
    error_rad: float | None = None


def vessel_motion(place: Place, heading_rad: float, water: Water) -> VesselMotion:
    """Return how she moves, for guidance."""
    return VesselMotion(
        place,
        heading_rad,
        water.speed_m_s,
        water.current_north_m_s,
        water.current_east_m_s,
        water.too_strong,
    )


def update(settings: GuidanceSettings, nav: GuidanceState, scene: GuidanceInput) -> GuidanceOutput:
    """Carry mode, goal and mission on by a tick."""
    modes, motion = scene.modes, scene.motion
    before = nav
    if (modes.mode, modes.armed) != (nav.mode, nav.armed):
        nav = _enter_mode(nav, modes)
    if nav.mission.identity != scene.plans.mission.identity:
        nav = replace(nav, mission=mission.for_plan(nav.mission, scene.plans.mission.identity))
        if modes.mode is Mode.AUTO and before.mission.started:
            nav = replace(nav, mission=mission.enter(nav.mission))
    if nav.reached:
        nav = replace(nav, reached=())
    changed = nav is not before or scene.new_fix
    if not changed and nav.done_s is not None and scene.t_s - nav.done_s < INTERVAL_S:
        return GuidanceOutput(nav)
    step_s = 0.0 if nav.done_s is None else min(max(0.0, scene.t_s - nav.done_s), LONGEST_STEP_S)
    nav = replace(nav, done_s=scene.t_s)
    if motion is None:
        # Without a position what was wanted last stands; a goal without any is none.
        return GuidanceOutput(nav if _going(modes) else replace(nav, followed=TaskStatus()))
    nav = replace(nav, fence=fence.update(nav.fence, scene.plans.fence, motion.place))
    if modes.mode is Mode.AUTO:
        return _update_mission(settings, nav, scene, motion, step_s)
    order = _task(settings, nav, scene, motion)
    follow, followed = task_follower.update(settings.guidance, nav.follow, order, motion, step_s)
    return GuidanceOutput(replace(nav, order=order, follow=follow, followed=followed))


def _going(modes: ModeState) -> bool:
    return modes.mode in _GOING_MODES and not isinstance(modes.goal, HeadingGoal)


def _enter_mode(nav: GuidanceState, modes: ModeState) -> GuidanceState:
    """Begin anew in a mode; AUTO goes on with its item, from where she is."""
    progress = nav.mission
    if modes.mode is Mode.AUTO and modes.armed:
        progress = mission.enter(progress)
    return GuidanceState(
        modes.mode, modes.armed, progress, done_s=nav.done_s, fence=nav.fence, fence_enabled=nav.fence_enabled
    )


def _task(settings: GuidanceSettings, nav: GuidanceState, scene: GuidanceInput, motion: VesselMotion) -> Task | None:
    """Return the order of a mode other than AUTO; LOITER and RTL choose their place once."""
    modes, guidance = scene.modes, settings.guidance
    if modes.mode is Mode.GUIDED and isinstance(modes.goal, PositionGoal):
        to = Place(modes.goal.latitude_rad, modes.goal.longitude_rad)
        return GoTo(to, None, guidance.accept_m, guidance.keep_m)
    if modes.mode is Mode.LOITER:
        centre = nav.order.centre if isinstance(nav.order, HoldStation) else motion.place
        return HoldStation(centre, guidance.keep_m)
    if modes.mode is Mode.RTL:
        return nav.order or _way_back(settings, scene, motion)
    return None


def _way_back(settings: GuidanceSettings, scene: GuidanceInput, motion: VesselMotion) -> GoTo | None:
    with_home = settings.rally_includes_home
    return way_back(settings.guidance, motion, scene.home, scene.plans.rally, with_home=with_home)


def _update_mission(
    settings: GuidanceSettings, nav: GuidanceState, scene: GuidanceInput, motion: VesselMotion, step_s: float
) -> GuidanceOutput:
    """Carry the mission on; disarmed she is where she is, and so is the mission."""
    if not scene.modes.armed:
        return GuidanceOutput(nav)
    voyage = MissionInput(
        settings.guidance,
        steps_of(scene.plans.mission),
        motion,
        nav.follow,
        step_s,
        scene.utc_s,
        lambda: _way_back(settings, scene, motion),
    )
    done = mission.update(nav.mission, voyage)
    progress = done.progress
    order = progress.halt if progress.paused else progress.order
    follow, followed = task_follower.update(settings.guidance, nav.follow, order, motion, step_s)
    home = None
    if done.home is not None:
        altitude_m = 0.0 if scene.home is None else scene.home.altitude_m
        home = Home(done.home.latitude_rad, done.home.longitude_rad, altitude_m)
    events = _events(nav.mission, progress)
    nav = replace(nav, mission=progress, order=order, follow=follow, followed=followed, reached=done.reached)
    return GuidanceOutput(nav, events, home)


def _events(before: MissionProgress, after: MissionProgress) -> tuple[Event, ...]:
    if after.unusable and not before.unusable:
        return ()  # a fault of its own
    if after.complete and not before.complete:
        return (Event(Severity.NOTICE, "Mission complete: keeping station"),)
    if after.paused is not before.paused:
        return (Event(Severity.NOTICE, "Mission paused: keeping station" if after.paused else "Mission goes on"),)
    if after.begun and (after.index != before.index or not before.begun):
        return (Event(Severity.INFO, f"Mission: item {after.index}"),)
    return ()


# ---------------------------------------------------------------------------- steering


def update_goal(
    settings: GuidanceSettings, modes: ModeState, situation: Situation, now_s: float, step_s: float
) -> ModeState:
    """Give a goal to a mode that has none yet, turn it by the stick, end a turn the long way."""
    if modes.mode not in (Mode.STEERING, Mode.GUIDED) or situation.heading_rad is None:
        return modes
    goal = modes.goal
    if goal is None:
        return replace(modes, goal=HeadingGoal(situation.heading_rad))
    if isinstance(goal, PositionGoal):
        return modes
    if modes.mode is Mode.STEERING and (stick := live_stick(modes, now_s, settings.stick_timeout_s)):
        turned_rad = stick * settings.stick_rate_rad_s * min(max(0.0, step_s), 1.0)
        return replace(modes, goal=HeadingGoal(wrap_two_pi(goal.heading_rad + turned_rad), goal.over_ground))
    if goal.turn:
        remaining_rad = wrap_two_pi(goal.turn * (heading_to_steer(goal, situation.water) - situation.heading_rad))
        if remaining_rad <= math.pi:
            return replace(modes, goal=replace(goal, turn=0))
    return modes


def steering_target(modes: ModeState, followed: TaskStatus, situation: Situation) -> SteeringTarget:
    """Return what the helm is to do."""
    goal, turn = modes.goal, 0
    if isinstance(goal, HeadingGoal):
        steer_rad, turn = heading_to_steer(goal, situation.water), goal.turn
    elif followed.wanted is None:
        return SteeringTarget()
    elif followed.wanted.over_ground and (water := situation.water) is not None:
        steer_rad = heading_for_course(
            followed.wanted.angle_rad, water.speed_m_s, water.current_north_m_s, water.current_east_m_s
        )
    else:
        steer_rad = followed.wanted.angle_rad
    if situation.heading_rad is None:
        return SteeringTarget(steer_rad, None)
    # On a turn the long way the error stays at half a turn until the shorter way is the right one.
    error_rad = turn * math.pi if turn else wrap_pi(steer_rad - situation.heading_rad)
    return SteeringTarget(steer_rad, error_rad)


# ----------------------------------------------------------------------------- reports


def fence_margin_m(nav: GuidanceState, plans: Plans, *, enabled: bool) -> float | None:
    """Return the margin of a fence that is heeded and known."""
    if not enabled or not plans.fence.items or nav.fence.identity != plans.fence.identity or nav.fence.place is None:
        return None
    return nav.fence.margin_m


def report(nav: GuidanceState, plans: Plans, *, fence_enabled: bool) -> Navigation:
    """Return where guidance takes her, for the log and the link."""
    followed = nav.followed
    return Navigation(
        followed.activity,
        None if followed.target is None else followed.target.latitude_rad,
        None if followed.target is None else followed.target.longitude_rad,
        followed.radius_m,
        followed.cross_track_m,
        nav.follow.arrived and followed.activity is not Activity.NOTHING,
        fence_enabled,
        fence_margin_m(nav, plans, enabled=fence_enabled),
    )


def mission_report(nav: GuidanceState, plans: Plans, modes: ModeState) -> MissionReport:
    """Return the mission as the operator follows it."""
    count = len(plans.mission.items)
    progress = mission.for_plan(nav.mission, plans.mission.identity)
    return MissionReport(
        mission.state_of(progress, count, running=modes.mode is Mode.AUTO and modes.armed),
        min(progress.index, count - 1) if count else None,
        count,
        nav.reached,
        (plans.mission.identity, plans.fence.identity, plans.rally.identity),
    )
