"""Station keeping in a loiter circle: straight legs inside, and the direct way back from outside.

The boat cannot stop. Inside the circle it keeps each heading as long as possible, because this needs the fewest turns.
A leg ends before the boat and its turn would leave the circle. The next heading is the one with the longest time
inside; in a current this is the heading against the current.
"""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.angles import TWO_PI, wrap_pi, wrap_two_pi
from firmware_py.guidance.tasks import HeadingTarget, HoldStation, TaskSettings, VesselMotion
from firmware_py.model.crab import against_current, heading_for_course

HEADING_COUNT = 36
# Legs end this far inside the circle; the fractions are of its radius.
MARGIN_FRACTION, MIN_MARGIN_M, MAX_MARGIN_FRACTION = 0.1, 6.0, 0.25
TURN_RATE_FRACTION = 0.7  # of the rate at full rudder, because the rudder decreases towards the end of a turn
PREDICTION_S = 10.0  # from now to the predicted start of the turn back
MAX_LEG_ERROR_RAD = 0.35  # with a larger heading error the boat is still turning
MAX_STAY_S = 7200.0  # limit of the predicted time inside
TURN_COST_S_RAD = 30.0  # minimum gain of time inside per radian of turning


class StationKeepingState(msgspec.Struct, frozen=True):
    """Course through the water of the present leg; None on the way back from outside."""

    way_rad: float | None = None


class _Turn(msgspec.Struct, frozen=True):
    """A turn: its end position relative to the centre, largest distance from the centre, and duration."""

    north_m: float
    east_m: float
    max_distance_m: float
    seconds: float


def update(
    settings: TaskSettings, state: StationKeepingState, task: HoldStation, motion: VesselMotion, distance_m: float
) -> tuple[StationKeepingState, HeadingTarget]:
    """Return the new state and the target; `distance_m` is the distance from the centre."""
    if distance_m > task.radius_m:
        if motion.too_strong:
            return StationKeepingState(), HeadingTarget(
                wrap_two_pi(against_current(motion.current_north_m_s, motion.current_east_m_s) - motion.leeway_rad),
                over_ground=False,
            )
        _, bearing_rad = motion.place.distance_and_bearing(task.centre)
        return StationKeepingState(), HeadingTarget(bearing_rad, over_ground=True)
    north_m, east_m = task.centre.offset_m(motion.place)
    limit_m = task.radius_m - min(
        max(MIN_MARGIN_M, MARGIN_FRACTION * task.radius_m), MAX_MARGIN_FRACTION * task.radius_m
    )
    leg_rad = state.way_rad
    if leg_rad is None or _must_end(settings, motion, leg_rad, north_m, east_m, limit_m):
        leg_rad = _choose_leg(settings, motion, north_m, east_m, limit_m)
    return StationKeepingState(leg_rad), HeadingTarget(wrap_two_pi(leg_rad - motion.leeway_rad), over_ground=False)


def _must_end(
    settings: TaskSettings, motion: VesselMotion, leg_rad: float, north_m: float, east_m: float, limit_m: float
) -> bool:
    """Return whether the leg must end now so that a turn back stays within the limit."""
    if abs(wrap_pi(leg_rad - motion.water_course_rad)) > MAX_LEG_ERROR_RAD:
        return False  # the turn has not ended
    v_north, v_east = _velocity_over_ground(motion, leg_rad)
    if north_m * v_north + east_m * v_east <= 0.0:
        return False  # the distance decreases
    north_m, east_m = north_m + PREDICTION_S * v_north, east_m + PREDICTION_S * v_east
    back_rad = heading_for_course(
        math.atan2(-east_m, -north_m), motion.speed_m_s, motion.current_north_m_s, motion.current_east_m_s
    )
    return _predict_turn(settings, motion, back_rad, north_m, east_m).max_distance_m >= limit_m


def _choose_leg(settings: TaskSettings, motion: VesselMotion, north_m: float, east_m: float, limit_m: float) -> float:
    """Return the course with the longest time inside, or with the smallest distance outside if none stays inside."""
    best_rad, best = motion.water_course_rad, (-math.inf, -math.inf)
    for index in range(HEADING_COUNT):
        leg_rad = wrap_two_pi(motion.water_course_rad + index * TWO_PI / HEADING_COUNT)
        turn = _predict_turn(settings, motion, leg_rad, north_m, east_m)
        cost_s = TURN_COST_S_RAD * abs(wrap_pi(leg_rad - motion.water_course_rad))
        stay_s = _stay_time_s(turn, _velocity_over_ground(motion, leg_rad), limit_m)
        # The distance outside is compared first, then the time inside.
        value = (min(0.0, limit_m - turn.max_distance_m), turn.seconds + stay_s - cost_s)
        if value > best:
            best_rad, best = leg_rad, value
    return best_rad


def _velocity_over_ground(motion: VesselMotion, leg_rad: float) -> tuple[float, float]:
    """Return the velocity over ground, north and east in m/s, for a course through the water."""
    return (
        motion.speed_m_s * math.cos(leg_rad) + motion.current_north_m_s,
        motion.speed_m_s * math.sin(leg_rad) + motion.current_east_m_s,
    )


def _predict_turn(settings: TaskSettings, motion: VesselMotion, to_rad: float, north_m: float, east_m: float) -> _Turn:
    """Predict the turn to a course through the water, along an arc that drifts with the current."""
    start_rad = motion.water_course_rad
    angle_rad = wrap_pi(to_rad - start_rad)
    radius_m = settings.turning_radius_m / TURN_RATE_FRACTION
    rate_rad_s = max(motion.speed_m_s, 0.05) / radius_m
    side_m = math.copysign(radius_m, angle_rad)
    max_distance_m, end_north_m, end_east_m, seconds = math.hypot(north_m, east_m), north_m, east_m, 0.0
    for fraction in (0.5, 1.0):
        end_rad = start_rad + fraction * angle_rad
        seconds = fraction * abs(angle_rad) / rate_rad_s
        end_north_m = north_m + side_m * (math.sin(end_rad) - math.sin(start_rad)) + seconds * motion.current_north_m_s
        end_east_m = east_m + side_m * (math.cos(start_rad) - math.cos(end_rad)) + seconds * motion.current_east_m_s
        max_distance_m = max(max_distance_m, math.hypot(end_north_m, end_east_m))
    return _Turn(end_north_m, end_east_m, max_distance_m, seconds)


def _stay_time_s(turn: _Turn, velocity_m_s: tuple[float, float], limit_m: float) -> float:
    """Return the time that a straight track from the end of a turn stays within the limit, in seconds."""
    v_north, v_east = velocity_m_s
    speed_squared = v_north * v_north + v_east * v_east
    spare_m2 = limit_m * limit_m - turn.north_m * turn.north_m - turn.east_m * turn.east_m
    if spare_m2 <= 0.0:
        return 0.0
    along = turn.north_m * v_north + turn.east_m * v_east
    if speed_squared < 1e-6:
        return MAX_STAY_S
    return min(MAX_STAY_S, (math.sqrt(along * along + speed_squared * spare_m2) - along) / speed_squared)
