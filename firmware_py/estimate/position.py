"""Position of the boat: fixes smoothed with its predicted motion, and a gate for jumps.

A fix that the boat cannot have reached is rejected. If further fixes agree with it for long enough, the former position
was wrong, and the new one is accepted. Without fixes dead reckoning continues the position (dead_reckoning.py).
"""

from __future__ import annotations

import math

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place, is_possible_position
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, PositionSample
from firmware_py.estimate.dead_reckoning import DeadReckoning

MAX_SPEED_M_S = 4.0  # over ground
MAX_FIX_ERROR_M = 50.0  # largest error of a working receiver
SMOOTHING_S = 10.0  # time constant
MAX_GAP_S = 60.0  # after a longer gap the estimate restarts at a fix
MIN_WITNESSES = 3  # fixes that confirm a jump
FIRST_POSITION_PHASE_S = 1800.0  # in which a jump proves the first fix wrong


class PositionSettings(msgspec.Struct, frozen=True):
    """Parameter POS_JUMP_S: time after which a jump is accepted."""

    jump_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> PositionSettings:
        """Read the settings from the parameters."""
        return cls(jump_s=parameters["POS_JUMP_S"])


class PositionState(msgspec.Struct, frozen=True):
    """Estimated position at t_s, the last accepted fix (`fix`), the first of the rejected fixes (`suspect`).

    `witnesses`: number of fixes near `suspect`. `begun`: the very first fix, or the one that confirmed a jump.
    `dead_reckoning`: not None while fixes are missing, also after a restart without any fix.
    """

    t_s: float = 0.0
    latitude_rad: float = 0.0
    longitude_rad: float = 0.0
    fix: PositionSample | None = None
    suspect: PositionSample | None = None
    witnesses: int = 0
    begun: PositionSample | None = None
    dead_reckoning: DeadReckoning | None = None


def has_valid_position(sample: PositionSample) -> bool:
    """Return whether the sample has a valid latitude, longitude and time."""
    latitude_rad, longitude_rad = sample.latitude_rad, sample.longitude_rad
    if latitude_rad is None or longitude_rad is None or sample.fix is FixType.NONE:
        return False
    return is_possible_position(latitude_rad, longitude_rad) and math.isfinite(sample.t_s)


def predict(state: PositionState, now_s: float, velocity_m_s: tuple[float, float]) -> PositionState:
    """Return the state with the position predicted to now_s by the velocity over ground, north and east."""
    step_s = now_s - state.t_s
    if (state.fix is None and state.dead_reckoning is None) or step_s <= 0.0:
        return state
    return _displace(state, velocity_m_s[0] * step_s, velocity_m_s[1] * step_s, now_s)


def update(state: PositionState, sample: PositionSample, jump_s: float) -> tuple[PositionState, bool]:
    """Return the state after a fix, and whether it is accepted. `jump_s`: time after which a jump is accepted."""
    if not has_valid_position(sample):
        return state, False
    if state.fix is None:
        return _restart_at(sample, sample.t_s, sample), True
    gap_s = sample.t_s - state.fix.t_s
    if _distance_m(state.fix, sample) > _max_distance_m(gap_s):
        suspect, witnesses = state.suspect, state.witnesses
        if suspect is None or _distance_m(suspect, sample) > _max_distance_m(sample.t_s - suspect.t_s):
            return replace(state, suspect=sample, witnesses=1), False
        if sample.t_s - suspect.t_s < jump_s or witnesses < MIN_WITNESSES:
            return replace(state, witnesses=witnesses + 1), False
        return _restart_at(sample, sample.t_s, sample), True
    if gap_s > MAX_GAP_S or gap_s < 0.0:
        return _restart_at(sample, max(sample.t_s, state.t_s), state.begun), True
    gain = 1.0 - math.exp(-gap_s / SMOOTHING_S)
    north_m, east_m = Place(state.latitude_rad, state.longitude_rad).nearby_offset_m(place_of(sample))
    state = replace(state, fix=sample, suspect=None, witnesses=0, dead_reckoning=None)
    return _displace(state, gain * north_m, gain * east_m, state.t_s), True


def accepted_jump_m(state: PositionState, sample: PositionSample) -> float | None:
    """Return the distance in metres of an accepted jump; None if the fix is no jump."""
    if state.suspect is None or state.fix is None:
        return None
    distance_m = distance_from_estimate_m(state, sample)
    return distance_m if distance_m > MAX_FIX_ERROR_M else None


def find_wrong_first_fix(previous: PositionState, current: PositionState) -> PositionSample | None:
    """Return the first fix if a jump has just proved it wrong, else None.

    Such a jump is accepted between the two states, and within FIRST_POSITION_PHASE_S of the first fix.
    """
    first_fix, current_first = previous.begun, current.begun
    if (
        first_fix is None
        or current_first is None
        or current_first is first_fix
        or current_first.t_s - first_fix.t_s > FIRST_POSITION_PHASE_S
    ):
        return None
    return first_fix


def distance_from_estimate_m(state: PositionState, sample: PositionSample) -> float:
    """Return the distance of a fix from the estimated position, in metres."""
    return math.hypot(*Place(state.latitude_rad, state.longitude_rad).nearby_offset_m(place_of(sample)))


def time_since_fix_s(state: PositionState) -> float:
    """Return the time from the last fix to the last prediction; without any fix, since dead reckoning began."""
    if state.fix is not None:
        return state.t_s - state.fix.t_s
    return 0.0 if state.dead_reckoning is None else state.t_s - state.dead_reckoning.begun_s


def utc_s(state: PositionState, now_s: float) -> float | None:
    """Return UTC by the last accepted fix, of any age; None if that had no UTC."""
    fix = state.fix
    return None if fix is None or fix.utc_s is None else fix.utc_s + (now_s - fix.t_s)


def _max_distance_m(gap_s: float) -> float:
    """Return the largest distance between two fixes of a boat, with the time gap_s between them."""
    return MAX_FIX_ERROR_M + MAX_SPEED_M_S * max(0.0, gap_s)


def place_of(sample: PositionSample) -> Place:
    """Return the position of a sample; the sample must have one."""
    return Place(sample.latitude_rad or 0.0, sample.longitude_rad or 0.0)


def _restart_at(sample: PositionSample, t_s: float, begun: PositionSample | None) -> PositionState:
    """Return the state restarted at a fix."""
    place = place_of(sample)
    return PositionState(t_s, place.latitude_rad, place.longitude_rad, sample, begun=begun)


def _distance_m(fix: PositionSample, other: PositionSample) -> float:
    return math.hypot(*place_of(fix).nearby_offset_m(place_of(other)))


def _displace(state: PositionState, north_m: float, east_m: float, t_s: float) -> PositionState:
    """Return the state of t_s with the position displaced north and east."""
    place = Place(state.latitude_rad, state.longitude_rad).at_offset(north_m, east_m)
    suspect, witnesses, begun = state.suspect, state.witnesses, state.begun
    latitude_rad, longitude_rad = place.latitude_rad, place.longitude_rad
    return PositionState(t_s, latitude_rad, longitude_rad, state.fix, suspect, witnesses, begun, state.dead_reckoning)
