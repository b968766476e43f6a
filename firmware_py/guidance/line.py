"""Following a line by integral line of sight, and knowing when its end is reached.

The course over ground is that of the line, turned towards a point on it that lies the
look-ahead further on; a slow integral takes up what the estimated current leaves over
(Lekkas and Fossen, IEEE Trans. Control Syst. Technol. 22(6), 2014; Caharija et al. 2016).
The current itself is met by the crab angle, where the course becomes a heading.
"""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.angles import clamp, wrap_two_pi
from firmware_py.common.geodesy import Place, Track, track
from firmware_py.guidance.tasks import GoTo, TaskSettings, VesselMotion

LONGEST_LOOK_M = 500.0
# The integral works with this part of the speed (sigma in the literature), critically damped at four times it.
INTEGRAL_PART = 0.1
INTEGRAL_ZONE = 0.3  # of the look-ahead, to either side of the line
LARGEST_PULL = 0.5  # of the look-ahead: what the integral may pull sideways
# A place passed this many turning radii off counts as reached: turning again would bring the boat no closer.
PASSED_RADII = 2.0
RECEDING_M = 5.0
MOST_TRIES = 3
FARTHEST_PASSED_M = 1000.0


class LineState(msgspec.Struct, frozen=True):
    """Where the line begins, the integral of line of sight, and how the approach of its end goes."""

    start: Place
    integral_s: float = 0.0
    closest_m: float = math.inf
    tries: int = 0


class LineStatus(msgspec.Struct, frozen=True):
    """The course over ground to steer, how far off the line the boat is (None: too short for one), and its arrival."""

    course_rad: float
    cross_track_m: float | None
    arrived: bool


def update(
    settings: TaskSettings, state: LineState, task: GoTo, motion: VesselMotion, step_s: float
) -> tuple[LineState, LineStatus]:
    """Follow the line for step_s and judge whether its end is reached."""
    on_line = track(state.start, task.place, motion.place)
    state, course_rad = _follow(settings, state, task, motion, on_line, step_s)
    state, arrived = _approach(settings, state, task, motion, on_line)
    return state, LineStatus(course_rad, None if on_line is None else on_line.cross_track_m, arrived)


def _follow(
    settings: TaskSettings, state: LineState, task: GoTo, motion: VesselMotion, on_line: Track | None, step_s: float
) -> tuple[LineState, float]:
    """Return the state and the course over ground to steer."""
    if on_line is None:
        _, bearing_rad = motion.place.distance_and_bearing(task.place)
        return state, bearing_rad
    look_m = look_ahead_m(settings, motion)
    pull_m_s = INTEGRAL_PART * motion.speed_m_s
    aim_m = on_line.cross_track_m + pull_m_s * state.integral_s
    integral_s = state.integral_s
    if abs(on_line.cross_track_m) <= INTEGRAL_ZONE * look_m:
        # Further off the way back onto the line is no error to be learned.
        integral_s += step_s * look_m * on_line.cross_track_m / (look_m * look_m + aim_m * aim_m)
    bound_s = LARGEST_PULL * look_m / max(pull_m_s, 1e-3)
    integral_s = clamp(integral_s, -bound_s, bound_s)
    course_rad = wrap_two_pi(on_line.course_rad - math.atan2(aim_m, look_m))
    return LineState(state.start, integral_s, state.closest_m, state.tries), course_rad


def look_ahead_m(settings: TaskSettings, motion: VesselMotion) -> float:
    """Return the look-ahead, from two turning radii up."""
    shortest_m = 2.0 * settings.turning_radius_m
    return clamp(settings.look_ahead_s * motion.speed_m_s, shortest_m, max(shortest_m, LONGEST_LOOK_M))


def _approach(
    settings: TaskSettings, state: LineState, task: GoTo, motion: VesselMotion, on_line: Track | None
) -> tuple[LineState, bool]:
    """Judge whether the end of the line is reached.

    It is within its radius; or when the boat passes abeam of it, or moves away from it again, no
    further off than it could come by turning; a boat that has only begun to turn for it moves away, too, and has
    not come near yet, and one that points at it and moves away is set back by the current and has not passed it.
    Passed further off, the boat sails for it anew from where it is, a few times: then passing is enough, so that no
    place holds it for ever. Where a stronger current sweeps her past there is nothing to be counted; nor is there
    while the place is reckoned, and less certain than the radius.
    """
    distance_m, bearing_rad = motion.place.distance_and_bearing(task.place)
    passed = on_line is not None and on_line.remaining_m <= 0.0
    if motion.spread_m > task.acceptance_radius_m:
        start, integral_s = (motion.place, 0.0) if passed else (state.start, state.integral_s)
        return LineState(start, integral_s, math.inf, state.tries), False
    if distance_m <= task.acceptance_radius_m:
        return state, True
    closest_m = state.closest_m
    if _closes(motion, bearing_rad):
        closest_m = min(closest_m, distance_m)
    elif math.cos(motion.way_rad - bearing_rad) > 0.0:
        closest_m = math.inf
    reach_m = max(task.acceptance_radius_m, _passable_m(settings, motion))
    receding = distance_m > closest_m + RECEDING_M and closest_m <= reach_m
    if receding or (passed and distance_m <= reach_m):
        return state, True
    if passed and motion.too_strong:
        return LineState(motion.place, 0.0, math.inf, state.tries), False  # swept past; its turning brings her back
    if passed:
        if state.tries >= MOST_TRIES and distance_m <= FARTHEST_PASSED_M:
            return state, True
        return LineState(motion.place, 0.0, math.inf, min(state.tries + 1, MOST_TRIES)), False
    return LineState(state.start, state.integral_s, closest_m, state.tries), False


def _closes(motion: VesselMotion, bearing_rad: float) -> bool:
    """Return whether the boat's way over ground leads nearer to what lies on that bearing."""
    north_m_s = motion.speed_m_s * math.cos(motion.way_rad) + motion.current_north_m_s
    east_m_s = motion.speed_m_s * math.sin(motion.way_rad) + motion.current_east_m_s
    return north_m_s * math.cos(bearing_rad) + east_m_s * math.sin(bearing_rad) > 0.0


def _passable_m(settings: TaskSettings, motion: VesselMotion) -> float:
    """Return how near a boat comes at worst that turns for a place: the turning circle, drawn out by the current."""
    drift = math.hypot(motion.current_north_m_s, motion.current_east_m_s) / max(motion.speed_m_s, 0.05)
    return PASSED_RADII * settings.turning_radius_m * (1.0 + min(drift, 1.0))
