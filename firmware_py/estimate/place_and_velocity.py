"""Whether a receiver's places move, and as its velocities say: a jammed or deceived one may be sure of what cannot be.

Over a window the velocities are added up and held against the way between the first place and the last. A place that is
the same to the last digit for minutes was not measured at sea: receivers made for cars hold it when they are slow. One
whose velocity has taken her further meanwhile than the coarsest digit is long hangs, and its place is none.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.records import Event, PositionSample, Severity

WINDOW_S: Final = 120.0  # many waves, and ten times what a place wanders in so long
LONGEST_STEP_S: Final = 5.0  # between fixes whose velocities say what was between them
ODD_M_S: Final = 0.5
ODD_WINDOWS: Final = 2  # in a row
TELL_AGAIN_S: Final = 600.0
STILL_S: Final = 300.0
HANGS_M: Final = 30.0  # a hundredth of a minute of latitude is 18.5 m


class AgreementState(msgspec.Struct, frozen=True):
    """The window under way: its first and its latest fix, the way by velocities; and the windows that were odd.

    `still` is the first of the fixes at the place of the latest, `still_told` whether that was told of them, and their
    velocities have led to still_north_m, still_east_m.
    """

    begun: PositionSample | None = None
    latest: PositionSample | None = None
    north_m: float = 0.0
    east_m: float = 0.0
    odd: int = 0
    told_s: float | None = None
    still: PositionSample | None = None
    still_told: bool = False
    still_north_m: float = 0.0
    still_east_m: float = 0.0


def update(state: AgreementState, fix: PositionSample, *, afloat: bool) -> tuple[AgreementState, tuple[Event, ...]]:
    """Take a fix that is believed or hangs; return what is to be told, of one that stands still only if `afloat`."""
    agreement, odd = _agree(state, fix)
    still = state.still
    if still is None or not _at_the_same_place(still, fix):
        return replace(agreement, still=fix, still_told=False, still_north_m=0.0, still_east_m=0.0), odd
    north_m, east_m = state.still_north_m, state.still_east_m
    velocity_m_s = _velocity_m_s(fix)
    if velocity_m_s is not None and state.latest is not None:
        step_s = min(max(fix.t_s - state.latest.t_s, 0.0), LONGEST_STEP_S)
        north_m, east_m = north_m + step_s * velocity_m_s[0], east_m + step_s * velocity_m_s[1]
    told, lasted_s = state.still_told, fix.t_s - still.t_s
    agreement = replace(agreement, still=still, still_told=told, still_north_m=north_m, still_east_m=east_m)
    if told or not afloat or (lasted_s < STILL_S and not hangs(agreement, fix)):
        return agreement, odd
    text = f"Position has not moved for {lasted_s / 60.0:.0f} min, to the last digit: does the receiver hold it?"
    return replace(agreement, still_told=True), (*odd, Event(Severity.WARNING, text))


def hangs(state: AgreementState, fix: PositionSample) -> bool:
    """Whether a fix is once more at a place from which those before it, there, have moved away by their velocities."""
    if state.still is None or not _at_the_same_place(state.still, fix):
        return False
    return math.hypot(state.still_north_m, state.still_east_m) > HANGS_M


def _at_the_same_place(one: PositionSample, other: PositionSample) -> bool:
    return (one.latitude_rad, one.longitude_rad) == (other.latitude_rad, other.longitude_rad)


def _agree(state: AgreementState, fix: PositionSample) -> tuple[AgreementState, tuple[Event, ...]]:
    velocity_m_s = _velocity_m_s(fix)
    if velocity_m_s is None:
        return AgreementState(told_s=state.told_s), ()
    begun, latest = state.begun, state.latest
    before_m_s = None if latest is None else _velocity_m_s(latest)
    if begun is None or latest is None or before_m_s is None or not 0.0 < fix.t_s - latest.t_s <= LONGEST_STEP_S:
        return AgreementState(fix, fix, odd=state.odd, told_s=state.told_s), ()
    half_s = 0.5 * (fix.t_s - latest.t_s)
    north_m = state.north_m + half_s * (before_m_s[0] + velocity_m_s[0])
    east_m = state.east_m + half_s * (before_m_s[1] + velocity_m_s[1])
    lasted_s = fix.t_s - begun.t_s
    if lasted_s < WINDOW_S:
        return replace(state, latest=fix, north_m=north_m, east_m=east_m), ()
    went_north_m, went_east_m = _place(begun).nearby_offset_m(_place(fix))
    off_m_s = math.hypot(went_north_m - north_m, went_east_m - east_m) / lasted_s
    odd = state.odd + 1 if off_m_s > ODD_M_S else 0
    told_s = state.told_s
    if odd < ODD_WINDOWS or (told_s is not None and fix.t_s - told_s < TELL_AGAIN_S):
        return AgreementState(fix, fix, odd=odd, told_s=told_s), ()
    text = f"Position moves {off_m_s:.1f} m/s otherwise than its velocity says: is the receiver deceived?"
    return AgreementState(fix, fix, odd=odd, told_s=fix.t_s), (Event(Severity.WARNING, text),)


def _velocity_m_s(fix: PositionSample) -> tuple[float, float] | None:
    """Return the velocity of a fix, north and east; None for one that has none."""
    speed_m_s, course_rad = fix.speed_over_ground_m_s, fix.course_over_ground_rad
    if speed_m_s is None or course_rad is None:
        return None
    return speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)


def _place(fix: PositionSample) -> Place:
    return Place(fix.latitude_rad or 0.0, fix.longitude_rad or 0.0)
