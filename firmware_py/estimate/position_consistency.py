"""Consistency check of position and velocity of a receiver: detects spoofing, static hold and stuck positions.

Over a window the integral of the velocity is compared with the displacement. A position that is constant in all digits
for minutes is not measured: receivers for cars repeat it at low speed (static hold). If the integral of the velocity
in that time exceeds the coarsest resolution of positions, the position is stuck and is not used.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.records import Event, PositionSample, Severity

WINDOW_S: Final = 120.0  # many wave periods; the position error changes by about a tenth of the limit meanwhile
MAX_STEP_S: Final = 5.0  # between fixes whose velocities are integrated
MAX_DIFFERENCE_M_S: Final = 0.5
MIN_INCONSISTENT_WINDOWS: Final = 2  # successive windows, for a report
REPORT_INTERVAL_S: Final = 600.0
MAX_STANDSTILL_S: Final = 300.0  # of the position, before it is reported
STUCK_DISTANCE_M: Final = 30.0  # the coarsest resolution, 0.01 minutes of latitude, is 18.5 m


class PositionConsistency(msgspec.Struct, frozen=True):
    """Window in progress, and the position that has not changed since an earlier fix.

    `begun`, `latest`: first and last fix of the window. `north_m`, `east_m`: integral of its velocity.
    `odd`: number of successive inconsistent windows, in which position and velocity differ too much.
    `reported_s`: time of the last report of them.
    `still`: first of the successive fixes with the same position. `still_north_m`, `still_east_m`: integral of the
    velocity since then. `still_reported`: whether the constant position has been reported.
    """

    begun: PositionSample | None = None
    latest: PositionSample | None = None
    north_m: float = 0.0
    east_m: float = 0.0
    odd: int = 0
    reported_s: float | None = None
    still: PositionSample | None = None
    still_reported: bool = False
    still_north_m: float = 0.0
    still_east_m: float = 0.0


def update(
    state: PositionConsistency, fix: PositionSample, *, is_armed: bool
) -> tuple[PositionConsistency, tuple[Event, ...]]:
    """Return the state after an accepted or stuck fix, and the events. Reports a constant position only if armed."""
    checked, events = _compare_with_velocity(state, fix)
    still = state.still
    if still is None or not _has_same_position(still, fix):
        return replace(checked, still=fix, still_reported=False, still_north_m=0.0, still_east_m=0.0), events
    north_m, east_m = state.still_north_m, state.still_east_m
    velocity_m_s = _velocity_m_s(fix)
    if velocity_m_s is not None and state.latest is not None:
        step_s = min(max(fix.t_s - state.latest.t_s, 0.0), MAX_STEP_S)
        north_m, east_m = north_m + step_s * velocity_m_s[0], east_m + step_s * velocity_m_s[1]
    is_reported, duration_s = state.still_reported, fix.t_s - still.t_s
    checked = replace(checked, still=still, still_reported=is_reported, still_north_m=north_m, still_east_m=east_m)
    if is_reported or not is_armed or (duration_s < MAX_STANDSTILL_S and not is_stuck(checked, fix)):
        return checked, events
    text = f"GPS position unchanged for {duration_s / 60.0:.0f} min: static hold?"
    return replace(checked, still_reported=True), (*events, Event(Severity.WARNING, text))


def is_stuck(state: PositionConsistency, fix: PositionSample) -> bool:
    """Return whether a fix repeats the previous position although the integral of the velocity excludes it."""
    if state.still is None or not _has_same_position(state.still, fix):
        return False
    return math.hypot(state.still_north_m, state.still_east_m) > STUCK_DISTANCE_M


def _has_same_position(fix: PositionSample, other: PositionSample) -> bool:
    return (fix.latitude_rad, fix.longitude_rad) == (other.latitude_rad, other.longitude_rad)


def _compare_with_velocity(
    state: PositionConsistency, fix: PositionSample
) -> tuple[PositionConsistency, tuple[Event, ...]]:
    """Return the state with the fix added to the window, and an event after too many inconsistent windows."""
    velocity_m_s = _velocity_m_s(fix)
    if velocity_m_s is None:
        return PositionConsistency(reported_s=state.reported_s), ()
    begun, latest = state.begun, state.latest
    previous_m_s = None if latest is None else _velocity_m_s(latest)
    if begun is None or latest is None or previous_m_s is None or not 0.0 < fix.t_s - latest.t_s <= MAX_STEP_S:
        return PositionConsistency(fix, fix, odd=state.odd, reported_s=state.reported_s), ()
    half_s = 0.5 * (fix.t_s - latest.t_s)
    north_m = state.north_m + half_s * (previous_m_s[0] + velocity_m_s[0])
    east_m = state.east_m + half_s * (previous_m_s[1] + velocity_m_s[1])
    duration_s = fix.t_s - begun.t_s
    if duration_s < WINDOW_S:
        return replace(state, latest=fix, north_m=north_m, east_m=east_m), ()
    moved_north_m, moved_east_m = _place(begun).nearby_offset_m(_place(fix))
    difference_m_s = math.hypot(moved_north_m - north_m, moved_east_m - east_m) / duration_s
    odd = state.odd + 1 if difference_m_s > MAX_DIFFERENCE_M_S else 0
    reported_s = state.reported_s
    if odd < MIN_INCONSISTENT_WINDOWS or (reported_s is not None and fix.t_s - reported_s < REPORT_INTERVAL_S):
        return PositionConsistency(fix, fix, odd=odd, reported_s=reported_s), ()
    text = f"GPS position/velocity differ by {difference_m_s:.1f} m/s: spoofing?"
    return PositionConsistency(fix, fix, odd=odd, reported_s=fix.t_s), (Event(Severity.WARNING, text),)


def _velocity_m_s(fix: PositionSample) -> tuple[float, float] | None:
    """Return the velocity of a fix, north and east; None if it has none."""
    speed_m_s, course_rad = fix.speed_over_ground_m_s, fix.course_over_ground_rad
    if speed_m_s is None or course_rad is None:
        return None
    return speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)


def _place(fix: PositionSample) -> Place:
    return Place(fix.latitude_rad or 0.0, fix.longitude_rad or 0.0)
