"""Consistency of position and velocity of a receiver, to detect spoofing, static hold and stuck positions.

Over a window the integral of the velocity is compared with the displacement. A position that does not change in its
last digit for minutes is not measured: car receivers hold it at low speed (static hold). If the velocity has moved the
boat by more than the coarsest digit meanwhile, the position is stuck and is not used.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.records import Event, PositionSample, Severity

WINDOW_S: Final = 120.0  # many waves; in it a position wanders by a tenth of the limit
LONGEST_STEP_S: Final = 5.0  # between fixes whose velocities can be integrated
MAX_DIFFERENCE_M_S: Final = 0.5
MIN_ODD_WINDOWS: Final = 2  # in a row
REPORT_INTERVAL_S: Final = 600.0
MAX_STANDSTILL_S: Final = 300.0
STUCK_DISTANCE_M: Final = 30.0  # a hundredth of a minute of latitude is 18.5 m


class PositionConsistency(msgspec.Struct, frozen=True):
    """Window in progress: its first and last fix, the integral of the velocity, and the number of odd windows in a row.

    `still` is the first of the fixes at the position of the last one, `still_reported`: that has been reported. The
    integral of their velocity is still_north_m, still_east_m. `reported_s`: time of the last report of odd windows.
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
    state: PositionConsistency, fix: PositionSample, *, armed: bool
) -> tuple[PositionConsistency, tuple[Event, ...]]:
    """Return the state after an accepted or stuck fix, and the events; a standstill is reported only if `armed`."""
    agreement, odd = _compare_with_velocity(state, fix)
    still = state.still
    if still is None or not _has_same_position(still, fix):
        return replace(agreement, still=fix, still_reported=False, still_north_m=0.0, still_east_m=0.0), odd
    north_m, east_m = state.still_north_m, state.still_east_m
    velocity_m_s = _velocity_m_s(fix)
    if velocity_m_s is not None and state.latest is not None:
        step_s = min(max(fix.t_s - state.latest.t_s, 0.0), LONGEST_STEP_S)
        north_m, east_m = north_m + step_s * velocity_m_s[0], east_m + step_s * velocity_m_s[1]
    reported, lasted_s = state.still_reported, fix.t_s - still.t_s
    agreement = replace(agreement, still=still, still_reported=reported, still_north_m=north_m, still_east_m=east_m)
    if reported or not armed or (lasted_s < MAX_STANDSTILL_S and not is_stuck(agreement, fix)):
        return agreement, odd
    text = f"GPS position unchanged for {lasted_s / 60.0:.0f} min: static hold?"
    return replace(agreement, still_reported=True), (*odd, Event(Severity.WARNING, text))


def is_stuck(state: PositionConsistency, fix: PositionSample) -> bool:
    """Return whether the position of a fix repeats though the velocity has moved the boat away from it."""
    if state.still is None or not _has_same_position(state.still, fix):
        return False
    return math.hypot(state.still_north_m, state.still_east_m) > STUCK_DISTANCE_M


def _has_same_position(one: PositionSample, other: PositionSample) -> bool:
    return (one.latitude_rad, one.longitude_rad) == (other.latitude_rad, other.longitude_rad)


def _compare_with_velocity(
    state: PositionConsistency, fix: PositionSample
) -> tuple[PositionConsistency, tuple[Event, ...]]:
    velocity_m_s = _velocity_m_s(fix)
    if velocity_m_s is None:
        return PositionConsistency(reported_s=state.reported_s), ()
    begun, latest = state.begun, state.latest
    before_m_s = None if latest is None else _velocity_m_s(latest)
    if begun is None or latest is None or before_m_s is None or not 0.0 < fix.t_s - latest.t_s <= LONGEST_STEP_S:
        return PositionConsistency(fix, fix, odd=state.odd, reported_s=state.reported_s), ()
    half_s = 0.5 * (fix.t_s - latest.t_s)
    north_m = state.north_m + half_s * (before_m_s[0] + velocity_m_s[0])
    east_m = state.east_m + half_s * (before_m_s[1] + velocity_m_s[1])
    lasted_s = fix.t_s - begun.t_s
    if lasted_s < WINDOW_S:
        return replace(state, latest=fix, north_m=north_m, east_m=east_m), ()
    went_north_m, went_east_m = _place(begun).nearby_offset_m(_place(fix))
    off_m_s = math.hypot(went_north_m - north_m, went_east_m - east_m) / lasted_s
    odd = state.odd + 1 if off_m_s > MAX_DIFFERENCE_M_S else 0
    reported_s = state.reported_s
    if odd < MIN_ODD_WINDOWS or (reported_s is not None and fix.t_s - reported_s < REPORT_INTERVAL_S):
        return PositionConsistency(fix, fix, odd=odd, reported_s=reported_s), ()
    text = f"GPS position/velocity differ by {off_m_s:.1f} m/s: spoofing?"
    return PositionConsistency(fix, fix, odd=odd, reported_s=fix.t_s), (Event(Severity.WARNING, text),)


def _velocity_m_s(fix: PositionSample) -> tuple[float, float] | None:
    """Return the velocity of a fix, north and east; None if it has none."""
    speed_m_s, course_rad = fix.speed_over_ground_m_s, fix.course_over_ground_rad
    if speed_m_s is None or course_rad is None:
        return None
    return speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)


def _place(fix: PositionSample) -> Place:
    return Place(fix.latitude_rad or 0.0, fix.longitude_rad or 0.0)
