"""Dead reckoning: the place carried on without fixes, by the water as it was last known, and how uncertain it grows.

The place errs by what current, speed and leeway were wrong by when fixes ceased, as the wave filter's covariance says
and all the way since: on one heading only their sum is known, and it stays as good as it was while she keeps that
heading. Beside it grows what nobody sees: the water changes, as if it wandered, and as if all of the current were a
tide that turns round once in 12.42 h.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.estimate import kalman
from firmware_py.estimate.water import CHANGES_M_S
from firmware_py.estimate.wave_filter_state import WaveFilterState

FIX_SD_M: Final = 5.0
WANDER_M2_S3: Final = 1.5e-6  # of the velocity: 10 cm/s in two hours
ANYWHERE_M: Final = 1e5  # she goes on to no place by what is as uncertain
TIDE_RAD_S: Final = 2.0 * math.pi / 44_712.0
_KNOWN: Final = (kalman.NORTH, kalman.EAST, kalman.SPEED, kalman.LEEWAY)
_PAIRS: Final = tuple((row, column) for i, row in enumerate(_KNOWN) for column in _KNOWN[i:])
COVARIANCES: Final = len(_PAIRS)

Velocity = tuple[float, float]  # north and east, m/s


class Reckoning(msgspec.Struct, frozen=True):
    """The water when fixes ceased at begun_s, and what was sailed since.

    `covariance`: the upper triangle, row by row, of that of the four numbers before it. The way through the water leads
    north_s and east_s seconds at the boat's speed; `blind_m` is what she may have gone while nobody knew where to.
    """

    current_north_m_s: float
    current_east_m_s: float
    speed_m_s: float
    leeway_rad: float
    covariance: tuple[float, ...]
    begun_s: float
    north_s: float = 0.0
    east_s: float = 0.0
    blind_m: float = 0.0


def begin(
    waves: WaveFilterState, steered_by_m_s: tuple[float, float, float] | None, begun_s: float
) -> Reckoning | None:
    """Return the reckoning that begins with the water that was steered by; None for a filter that has not started."""
    if not waves.x:
        return None
    north_m_s, east_m_s, speed_m_s = steered_by_m_s or tuple(waves.x[index] for index in _KNOWN[:3])
    covariance = tuple(waves.covariance(row, column) for row, column in _PAIRS)
    return Reckoning(north_m_s, east_m_s, speed_m_s, waves.x[kalman.LEEWAY], covariance, begun_s)


def gone_on(state: Reckoning, away_s: float | None) -> tuple[Reckoning, Velocity]:
    """Return the reckoning after a time in which nobody reckoned, and how far the water carried her in it, in metres.

    Where she headed is not known. Nor is how long it was when `away_s` is None, and then she may be anywhere.
    """
    if away_s is None:
        return replace(state, blind_m=state.blind_m + ANYWHERE_M), (0.0, 0.0)
    blind_m = state.blind_m + away_s * state.speed_m_s
    gone = replace(state, blind_m=blind_m, begun_s=state.begun_s - away_s)
    return gone, (away_s * state.current_north_m_s, away_s * state.current_east_m_s)


def sail(state: Reckoning, heading_rad: float | None, step_s: float, *, under_way: bool) -> tuple[Reckoning, Velocity]:
    """Return the reckoning after a step, and the velocity over ground in it.

    Without a heading she goes with the water; not `under_way`, as on the hook, she is taken to stay.
    """
    north_m_s, east_m_s = state.current_north_m_s, state.current_east_m_s
    if not under_way:
        blind_m = state.blind_m + step_s * (state.speed_m_s + math.hypot(north_m_s, east_m_s))
        return replace(state, blind_m=blind_m), (0.0, 0.0)
    if heading_rad is None:
        return replace(state, blind_m=state.blind_m + step_s * state.speed_m_s), (north_m_s, east_m_s)
    cosine, sine = math.cos(heading_rad + state.leeway_rad), math.sin(heading_rad + state.leeway_rad)
    sailed = replace(state, north_s=state.north_s + step_s * cosine, east_s=state.east_s + step_s * sine)
    return sailed, (north_m_s + state.speed_m_s * cosine, east_m_s + state.speed_m_s * sine)


def spread_m(state: Reckoning, lasted_s: float) -> float:
    """Return the standard deviation of the place, along the axis where it is largest."""
    nn, ne, nu, nl, ee, eu, el, uu, ul, ll = state.covariance
    t, a, b = lasted_s, state.north_s, state.east_s
    c, d = -state.speed_m_s * b, state.speed_m_s * a  # by a radian of leeway
    north = t * t * nn + a * a * uu + c * c * ll + 2.0 * (t * a * nu + t * c * nl + a * c * ul)
    east = t * t * ee + b * b * uu + d * d * ll + 2.0 * (t * b * eu + t * d * el + b * d * ul)
    both = t * t * ne + t * b * nu + t * d * nl + a * t * eu + a * b * uu + a * d * ul + c * t * el + c * b * ul
    both += c * d * ll
    half, differ = 0.5 * (north + east), 0.5 * (north - east)
    worst = half + math.sqrt(differ * differ + both * both)
    return math.sqrt(max(worst, 0.0) + _unseen(state, lasted_s))


def _unseen(state: Reckoning, lasted_s: float) -> float:
    """Return the variance along any axis of what nothing is known of."""
    phase = TIDE_RAD_S * lasted_s
    current_m_s = math.hypot(state.current_north_m_s, state.current_east_m_s)
    by_tide_m = current_m_s / TIDE_RAD_S * math.hypot(phase - math.sin(phase), 1.0 - math.cos(phase))
    fixed = FIX_SD_M * FIX_SD_M + state.blind_m * state.blind_m + 0.5 * by_tide_m * by_tide_m
    return fixed + lasted_s * lasted_s * (CHANGES_M_S * CHANGES_M_S + WANDER_M2_S3 * lasted_s / 3.0)
