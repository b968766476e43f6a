"""Keeping station in a watch circle: quiet legs inside, turned in time, straight back from outside.

The boat cannot stop, so inside it holds one heading after the other, each as long as it stays
within the circle: that takes the fewest turns, and in a current it is the heading into
it. Before a leg leads out, counting the way that the turn itself takes, the next
heading is the one that promises the longest stay.
"""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.angles import TWO_PI, wrap_pi, wrap_two_pi
from firmware_py.guidance.tasks import HeadingTarget, HoldStation, TaskSettings, VesselMotion
from firmware_py.model.crab import against_current, heading_for_course

HEADINGS = 36
MARGIN_PART, MARGIN_M, LARGEST_MARGIN = 0.1, 6.0, 0.25  # of the radius, at least, at most of the radius
TURN_PART = 0.7  # of the rate that full rudder gives: the rudder is eased towards the end of a turn
FORESIGHT_S = 10.0
TURNED_RAD = 0.35  # as near to its heading the boat is on a leg, no longer turning to it
LONGEST_STAY_S = 7200.0
TURN_PRICE_S_RAD = 30.0  # seconds of stay that a radian of turning must bring


class StationKeepingState(msgspec.Struct, frozen=True):
    """The heading of the present leg; None on the way back from outside."""

    way_rad: float | None = None


class _Turn(msgspec.Struct, frozen=True):
    """A turn at once to a heading: where it ends, how far out it leads, how long it takes."""

    north_m: float
    east_m: float
    farthest_m: float
    seconds: float


def update(
    settings: TaskSettings, state: StationKeepingState, task: HoldStation, motion: VesselMotion, distance_m: float
) -> tuple[StationKeepingState, HeadingTarget]:
    """Return the state and what to steer, distance_m from the centre."""
    if distance_m > task.radius_m:
        if motion.too_strong:
            return StationKeepingState(), HeadingTarget(
                wrap_two_pi(against_current(motion.current_north_m_s, motion.current_east_m_s) - motion.leeway_rad),
                over_ground=False,
            )
        _, bearing_rad = motion.place.distance_and_bearing(task.centre)
        return StationKeepingState(), HeadingTarget(bearing_rad, over_ground=True)
    north_m, east_m = task.centre.offset_m(motion.place)
    limit_m = task.radius_m - min(max(MARGIN_M, MARGIN_PART * task.radius_m), LARGEST_MARGIN * task.radius_m)
    way_rad = state.way_rad
    if way_rad is None or _must_end(settings, motion, way_rad, north_m, east_m, limit_m):
        way_rad = _next_leg(settings, motion, north_m, east_m, limit_m)
    return StationKeepingState(way_rad), HeadingTarget(wrap_two_pi(way_rad - motion.leeway_rad), over_ground=False)


def _must_end(
    settings: TaskSettings, motion: VesselMotion, way_rad: float, north_m: float, east_m: float, limit_m: float
) -> bool:
    """Whether the leg must end now for a turn back to stay within the limit."""
    if abs(wrap_pi(way_rad - motion.way_rad)) > TURNED_RAD:
        return False  # still turning to it
    v_north, v_east = _over_ground(motion, way_rad)
    if north_m * v_north + east_m * v_east <= 0.0:
        return False  # the boat comes nearer
    north_m, east_m = north_m + FORESIGHT_S * v_north, east_m + FORESIGHT_S * v_east
    back_rad = heading_for_course(
        math.atan2(-east_m, -north_m), motion.speed_m_s, motion.current_north_m_s, motion.current_east_m_s
    )
    return _turn(settings, motion, back_rad, north_m, east_m).farthest_m >= limit_m


def _next_leg(settings: TaskSettings, motion: VesselMotion, north_m: float, east_m: float, limit_m: float) -> float:
    """Return the heading that keeps the boat inside the longest, or leads least far out when none does."""
    best_rad, best = motion.way_rad, (-math.inf, -math.inf)
    for index in range(HEADINGS):
        way_rad = wrap_two_pi(motion.way_rad + index * TWO_PI / HEADINGS)
        turn = _turn(settings, motion, way_rad, north_m, east_m)
        price_s = TURN_PRICE_S_RAD * abs(wrap_pi(way_rad - motion.way_rad))
        stay_s = _stay_s(turn, _over_ground(motion, way_rad), limit_m)
        # First of all inside; then a long stay.
        value = (min(0.0, limit_m - turn.farthest_m), turn.seconds + stay_s - price_s)
        if value > best:
            best_rad, best = way_rad, value
    return best_rad


def _over_ground(motion: VesselMotion, way_rad: float) -> tuple[float, float]:
    return (
        motion.speed_m_s * math.cos(way_rad) + motion.current_north_m_s,
        motion.speed_m_s * math.sin(way_rad) + motion.current_east_m_s,
    )


def _turn(settings: TaskSettings, motion: VesselMotion, to_rad: float, north_m: float, east_m: float) -> _Turn:
    """Return the turn from here to a heading, along an arc through the water that drifts with it."""
    angle_rad = wrap_pi(to_rad - motion.way_rad)
    radius_m = settings.turning_radius_m / TURN_PART
    rate_rad_s = max(motion.speed_m_s, 0.05) / radius_m
    side_m = math.copysign(radius_m, angle_rad)
    farthest_m, end_north_m, end_east_m, seconds = math.hypot(north_m, east_m), north_m, east_m, 0.0
    for part in (0.5, 1.0):
        turned_rad = motion.way_rad + part * angle_rad
        seconds = part * abs(angle_rad) / rate_rad_s
        end_north_m = (
            north_m + side_m * (math.sin(turned_rad) - math.sin(motion.way_rad)) + seconds * motion.current_north_m_s
        )
        end_east_m = (
            east_m + side_m * (math.cos(motion.way_rad) - math.cos(turned_rad)) + seconds * motion.current_east_m_s
        )
        farthest_m = max(farthest_m, math.hypot(end_north_m, end_east_m))
    return _Turn(end_north_m, end_east_m, farthest_m, seconds)


def _stay_s(turn: _Turn, velocity_m_s: tuple[float, float], limit_m: float) -> float:
    """Return how long a straight track from the end of a turn stays within the limit."""
    v_north, v_east = velocity_m_s
    square = v_north * v_north + v_east * v_east
    spare = limit_m * limit_m - turn.north_m * turn.north_m - turn.east_m * turn.east_m
    if spare <= 0.0:
        return 0.0
    along = turn.north_m * v_north + turn.east_m * v_east
    if square < 1e-6:
        return LONGEST_STAY_S
    return min(LONGEST_STAY_S, (math.sqrt(along * along + square * spare) - along) / square)
