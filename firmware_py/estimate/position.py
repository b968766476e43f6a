"""Position of the boat: fixes smoothed by its own motion, with a gate for jumps.

A fix that lies further off than the boat can have sailed is not used. When further fixes agree with it for long enough,
the position was wrong before, and the new one is used. Without fixes the position is dead reckoned (dead_reckoning.py).
"""

from __future__ import annotations

import math

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place, is_possible_position
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, PositionSample
from firmware_py.estimate.dead_reckoning import DeadReckoning

FASTEST_M_S = 4.0  # over the ground, current and gusts of speed included
SPREAD_M = 50.0  # what a sound receiver may be off at worst
SMOOTHING_S = 10.0
LONGEST_GAP_S = 60.0  # after which the estimate begins anew at a fix
LEAST_WITNESSES = 3
FIRST_PLACE_S = 1800.0


class PositionSettings(msgspec.Struct, frozen=True):
    """How long a jump must last before it is believed."""

    jump_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> PositionSettings:
        """Read the settings from the parameters."""
        return cls(jump_s=parameters["POS_JUMP_S"])


class PositionState(msgspec.Struct, frozen=True):
    """The estimated place at t_s, the last fix believed, and the first of those that are not.

    `begun` is the first fix of all, or the one that confirmed a jump. `dead_reckoning` is active while fixes are
    missing, also after a restart without any fix.
    """

    t_s: float = 0.0
    latitude_rad: float = 0.0
    longitude_rad: float = 0.0
    fix: PositionSample | None = None
    suspect: PositionSample | None = None
    witnesses: int = 0
    begun: PositionSample | None = None
    dead_reckoning: DeadReckoning | None = None


def on_earth(sample: PositionSample) -> bool:
    """Return whether the sample has a position that can be."""
    latitude_rad, longitude_rad = sample.latitude_rad, sample.longitude_rad
    if latitude_rad is None or longitude_rad is None or sample.fix is FixType.NONE:
        return False
    return is_possible_position(latitude_rad, longitude_rad) and math.isfinite(sample.t_s)


def predict(state: PositionState, now_s: float, velocity_m_s: tuple[float, float]) -> PositionState:
    """Carry the place on to now_s by the velocity over ground, north and east."""
    step_s = now_s - state.t_s
    if (state.fix is None and state.dead_reckoning is None) or step_s <= 0.0:
        return state
    return _displace(state, velocity_m_s[0] * step_s, velocity_m_s[1] * step_s, now_s)


def update(state: PositionState, sample: PositionSample, jump_s: float) -> tuple[PositionState, bool]:
    """Take a fix in; return whether it is believed. `jump_s` is how long a jump must last."""
    if not on_earth(sample):
        return state, False
    if state.fix is None:
        return _at(sample, sample.t_s, sample), True
    gap_s = sample.t_s - state.fix.t_s
    if _distance_m(state.fix, sample) > _reach_m(gap_s):
        suspect, witnesses = state.suspect, state.witnesses
        if suspect is None or _distance_m(suspect, sample) > _reach_m(sample.t_s - suspect.t_s):
            return replace(state, suspect=sample, witnesses=1), False
        if sample.t_s - suspect.t_s < jump_s or witnesses < LEAST_WITNESSES:
            return replace(state, witnesses=witnesses + 1), False
        return _at(sample, sample.t_s, sample), True
    if gap_s > LONGEST_GAP_S or gap_s < 0.0:
        return _at(sample, max(sample.t_s, state.t_s), state.begun), True
    gain = 1.0 - math.exp(-gap_s / SMOOTHING_S)
    north_m, east_m = Place(state.latitude_rad, state.longitude_rad).nearby_offset_m(place_of(sample))
    state = replace(state, fix=sample, suspect=None, witnesses=0, dead_reckoning=None)
    return _displace(state, gain * north_m, gain * east_m, state.t_s), True


def leap_m(state: PositionState, sample: PositionSample) -> float | None:
    """Return how far from where she was reckoned to be a fix lies by which a jump is believed; None for another."""
    if state.suspect is None or state.fix is None:
        return None
    distance_m = off_m(state, sample)
    return distance_m if distance_m > SPREAD_M else None


def withdrawn(before: PositionState, after: PositionState) -> PositionSample | None:
    """Return the first place if a jump has just proved it wrong; a receiver's first place may be, for FIRST_PLACE_S."""
    first, now = before.begun, after.begun
    if first is None or now is None or now is first or now.t_s - first.t_s > FIRST_PLACE_S:
        return None
    return first


def off_m(state: PositionState, sample: PositionSample) -> float:
    """Return how far a fix lies from where she is taken to be."""
    return math.hypot(*Place(state.latitude_rad, state.longitude_rad).nearby_offset_m(place_of(sample)))


def unfixed_s(state: PositionState) -> float:
    """Return how long there had been no fix when the place was carried on last, or the reckoning had lasted without."""
    if state.fix is not None:
        return state.t_s - state.fix.t_s
    return 0.0 if state.dead_reckoning is None else state.t_s - state.dead_reckoning.begun_s


def utc_s(state: PositionState, now_s: float) -> float | None:
    """Return the time by the last fix believed, however long ago; None when it told none."""
    fix = state.fix
    return None if fix is None or fix.utc_s is None else fix.utc_s + (now_s - fix.t_s)


def _reach_m(gap_s: float) -> float:
    return SPREAD_M + FASTEST_M_S * max(0.0, gap_s)


def place_of(sample: PositionSample) -> Place:
    """Return the place of a sample that has one."""
    return Place(sample.latitude_rad or 0.0, sample.longitude_rad or 0.0)


def _at(sample: PositionSample, t_s: float, begun: PositionSample | None) -> PositionState:
    """Return the state that begins anew at a fix."""
    place = place_of(sample)
    return PositionState(t_s, place.latitude_rad, place.longitude_rad, sample, begun=begun)


def _distance_m(fix: PositionSample, other: PositionSample) -> float:
    return math.hypot(*place_of(fix).nearby_offset_m(place_of(other)))


def _displace(state: PositionState, north_m: float, east_m: float, t_s: float) -> PositionState:
    """Return the state with the place moved north and east."""
    place = Place(state.latitude_rad, state.longitude_rad).at_offset(north_m, east_m)
    suspect, witnesses, begun = state.suspect, state.witnesses, state.begun
    latitude_rad, longitude_rad = place.latitude_rad, place.longitude_rad
    return PositionState(t_s, latitude_rad, longitude_rad, state.fix, suspect, witnesses, begun, state.dead_reckoning)
