"""Line following by integral line of sight, and detection of arrival.

The course over ground points to the point of the line that is one look-ahead distance ahead. A slow integral removes
the cross-track error that an error of the estimated current causes (Lekkas and Fossen, IEEE Trans. Control
Syst. Technol. 22(6), 2014; Caharija et al. 2016). The conversion of the course to a heading compensates for the current
by the crab angle.
"""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.angles import clamp, wrap_two_pi
from firmware_py.common.geodesy import Place, Track, track
from firmware_py.guidance.tasks import GoTo, TaskSettings, VesselMotion

MAX_LOOK_AHEAD_M = 500.0
# Integral gain as a fraction of the speed (sigma in the literature); critical damping needs four times this value.
INTEGRAL_SPEED_FRACTION = 0.1
INTEGRAL_ZONE = 0.3  # cross-track error below which the integral is active, in look-ahead distances
MAX_INTEGRAL_OFFSET = 0.5  # in look-ahead distances
# Maximum distance, in turning radii, at which a passed waypoint is reached: another turn would not come closer.
PASSING_RADII = 2.0
RECEDING_DISTANCE_M = 5.0  # increase of the distance after which the boat moves away
MAX_TRIES = 3
MAX_PASSED_DISTANCE_M = 1000.0  # at which a waypoint is reached after MAX_TRIES


class LineState(msgspec.Struct, frozen=True):
    """Start of the line, integral of the line of sight, and progress of the approach to its end.

    `closest_m`: smallest distance to the end while the boat approaches it. `tries`: passes at too large a distance.
    """

    start: Place
    integral_s: float = 0.0
    closest_m: float = math.inf
    tries: int = 0


class LineStatus(msgspec.Struct, frozen=True):
    """Course over ground to steer, cross-track error to starboard (None: the line is too short), and arrival."""

    course_rad: float
    cross_track_m: float | None
    arrived: bool


def update(
    settings: TaskSettings, state: LineState, task: GoTo, motion: VesselMotion, step_s: float
) -> tuple[LineState, LineStatus]:
    """Follow the line for step_s and decide whether its end is reached."""
    on_line = track(state.start, task.place, motion.place)
    state, course_rad = _follow(settings, state, task, motion, on_line, step_s)
    state, has_arrived = _update_approach(settings, state, task, motion, on_line)
    return state, LineStatus(course_rad, None if on_line is None else on_line.cross_track_m, has_arrived)


def _follow(
    settings: TaskSettings, state: LineState, task: GoTo, motion: VesselMotion, on_line: Track | None, step_s: float
) -> tuple[LineState, float]:
    """Return the state and the course over ground to steer."""
    if on_line is None:
        _, bearing_rad = motion.place.distance_and_bearing(task.place)
        return state, bearing_rad
    look_m = look_ahead_m(settings, motion)
    integral_m_s = INTEGRAL_SPEED_FRACTION * motion.speed_m_s
    offset_m = on_line.cross_track_m + integral_m_s * state.integral_s
    integral_s = state.integral_s
    if abs(on_line.cross_track_m) <= INTEGRAL_ZONE * look_m:
        # At a larger distance, the error is not an effect of the current.
        integral_s += step_s * look_m * on_line.cross_track_m / (look_m * look_m + offset_m * offset_m)
    max_integral_s = MAX_INTEGRAL_OFFSET * look_m / max(integral_m_s, 1e-3)
    integral_s = clamp(integral_s, -max_integral_s, max_integral_s)
    course_rad = wrap_two_pi(on_line.course_rad - math.atan2(offset_m, look_m))
    return LineState(state.start, integral_s, state.closest_m, state.tries), course_rad


def look_ahead_m(settings: TaskSettings, motion: VesselMotion) -> float:
    """Return the look-ahead distance, at least two turning radii."""
    min_m = 2.0 * settings.turning_radius_m
    return clamp(settings.look_ahead_s * motion.speed_m_s, min_m, max(min_m, MAX_LOOK_AHEAD_M))


def _update_approach(
    settings: TaskSettings, state: LineState, task: GoTo, motion: VesselMotion, on_line: Track | None
) -> tuple[LineState, bool]:
    """Decide whether the end of the line is reached.

    It is reached within its radius, or if the boat passes it or moves away from it at a distance that another turn
    would not reduce. Two cases are not moving away: the turn towards the waypoint at the start, and a current that
    sets the boat back while it heads for the waypoint. If the boat passes the waypoint at a larger distance, it tries
    again from its position, up to MAX_TRIES times; after that, passing is sufficient. A pass in a current that is too
    strong, or while the position error exceeds the radius, is not counted.
    """
    distance_m, bearing_rad = motion.place.distance_and_bearing(task.place)
    has_passed = on_line is not None and on_line.remaining_m <= 0.0
    if motion.spread_m > task.acceptance_radius_m:
        start, integral_s = (motion.place, 0.0) if has_passed else (state.start, state.integral_s)
        return LineState(start, integral_s, math.inf, state.tries), False
    if distance_m <= task.acceptance_radius_m:
        return state, True
    closest_m = state.closest_m
    if _is_closing(motion, bearing_rad):
        closest_m = min(closest_m, distance_m)
    elif math.cos(motion.water_course_rad - bearing_rad) > 0.0:
        closest_m = math.inf
    max_passing_m = max(task.acceptance_radius_m, _passing_distance_m(settings, motion))
    is_receding = distance_m > closest_m + RECEDING_DISTANCE_M and closest_m <= max_passing_m
    if is_receding or (has_passed and distance_m <= max_passing_m):
        return state, True
    if has_passed:
        if motion.too_strong:  # the boat can return after the turn of the tide
            return LineState(motion.place, 0.0, math.inf, state.tries), False
        if state.tries >= MAX_TRIES and distance_m <= MAX_PASSED_DISTANCE_M:
            return state, True
        return LineState(motion.place, 0.0, math.inf, min(state.tries + 1, MAX_TRIES)), False
    return LineState(state.start, state.integral_s, closest_m, state.tries), False


def _is_closing(motion: VesselMotion, bearing_rad: float) -> bool:
    """Return whether the velocity over ground has a component in the direction of a bearing."""
    north_m_s = motion.speed_m_s * math.cos(motion.water_course_rad) + motion.current_north_m_s
    east_m_s = motion.speed_m_s * math.sin(motion.water_course_rad) + motion.current_east_m_s
    return north_m_s * math.cos(bearing_rad) + east_m_s * math.sin(bearing_rad) > 0.0


def _passing_distance_m(settings: TaskSettings, motion: VesselMotion) -> float:
    """Return the largest distance that a turn cannot reduce: the turning circle, stretched by the current."""
    drift_ratio = math.hypot(motion.current_north_m_s, motion.current_east_m_s) / max(motion.speed_m_s, 0.05)
    return PASSING_RADII * settings.turning_radius_m * (1.0 + min(drift_ratio, 1.0))
