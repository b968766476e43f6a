"""What a velocity over the ground shows of the filter's states.

North is U cos(way) + c_north, east U sin(way) + c_east, the way being heading and leeway; a momentary velocity lags
behind it and shows besides how the waves move the receiver: in part in step with the yaw that they give the float,
in part by itself. The part in step matters most: by the swing that it states, it tells how the shown heading is to
be divided between float and waves, and taken for something else it would tell it with the wrong sign.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.estimate import kalman
from firmware_py.estimate.kalman import Numbers
from firmware_py.estimate.learning import NoiseModel

LEG_RAD: Final = radians(12.0)
# While she keeps a heading, what the water changes by is shared out between current and speed, and current and leeway,
# by what each gains (wave_filter_state.WHITE), and not as it was: so much of it, along the way, is open.
CHANGE_M_S2: Final = 3e-5  # by axis; docs/explanation/estimation.md
LONGEST_CHANGE_S: Final = 3600.0  # after it the water wanders
ACROSS: Final = 0.03  # that part of the variance is open across the way, where the current has most of a change
LONGEST_SEEN_S: Final = 60.0  # between two fixes: what nobody sees is not taken for anything else
SLOWEST_M_S: Final = 0.2  # of a slower boat a leeway becomes no more uncertain
_GROWTH_M2_S4: Final = 2.0 * CHANGE_M_S2 * CHANGE_M_S2
LATE_S: Final = 0.5  # a receiver tells how the waves move it so much later, or less; what they do meanwhile is noise
_CURRENT, _ORBIT = (kalman.NORTH, kalman.EAST), (kalman.ORBIT_NORTH, kalman.ORBIT_EAST)


_PAIRS: Final = (
    (kalman.NORTH, kalman.EAST),
    (kalman.NORTH, kalman.SPEED),
    (kalman.EAST, kalman.SPEED),
    (kalman.NORTH, kalman.LEEWAY),
    (kalman.EAST, kalman.LEEWAY),
)
# Where `open_shares` go in a covariance with the slopes beside it, flat.
OPEN: Final = np.array(
    [(kalman.COLUMNS + 1) * place for place in (kalman.NORTH, kalman.EAST, kalman.SPEED, kalman.LEEWAY)]
    + [kalman.COLUMNS * row + column for row, column in _PAIRS]
    + [kalman.COLUMNS * column + row for row, column in _PAIRS]
)


class Expected(NamedTuple):
    """A velocity along an axis: as the states give it, by the way alone, its derivatives by them, its noise."""

    velocity_m_s: float
    way_m_s: float
    parts: tuple[tuple[int, float], ...]
    noise: float


def leg_rad(before_rad: float | None, x: Numbers) -> float:
    """Return the way of the leg that the boat is on: it stays the same until the boat has turned from it."""
    way_rad = x[kalman.HEADING] + x[kalman.LEEWAY]
    return way_rad if before_rad is None or abs(wrap_pi(way_rad - before_rad)) > LEG_RAD else before_rad


def open_shares(x: Numbers, on_leg_rad: float, leg_s: float, step_s: float) -> list[float]:
    """Return what the covariance gains, where OPEN says, in a step of a leg that has lasted leg_s.

    It is that of a change of the current that speed, or leeway, takes back: on this way nothing of it is seen, and the
    heading is as well known as without.
    """
    along = _GROWTH_M2_S4 * clamp(leg_s, 0.0, LONGEST_CHANGE_S) * clamp(step_s, 0.0, LONGEST_SEEN_S)
    across, speed_m_s = ACROSS * along, max(x[kalman.SPEED], SLOWEST_M_S)
    cosine, sine = math.cos(on_leg_rad), math.sin(on_leg_rad)
    pairs = [
        (along - across) * sine * cosine,
        -along * cosine,
        -along * sine,
        across * sine / speed_m_s,
        -across * cosine / speed_m_s,
    ]
    return [
        along * cosine * cosine + across * sine * sine,
        along * sine * sine + across * cosine * cosine,
        along,
        across / (speed_m_s * speed_m_s),
        *pairs,
        *pairs,
    ]


def expect(
    x: Numbers, axis: int, on_leg_rad: float, noise_model: NoiseModel, mean: tuple[float, float] | None
) -> Expected:
    """Return the velocity north (axis 0) or east (1) that is expected.

    By the speed it is derived on the way of the leg: what the estimated way errs by from fix to fix would be
    taken for turns that the track did not follow, and so for a slower boat that is surely known.
    """
    speed_m_s, rate_rad_s, lag_s = x[kalman.SPEED], x[kalman.RATE], x[kalman.COURSE_LAG]
    if mean is None:
        way_rad = x[kalman.HEADING] + x[kalman.LEEWAY] - lag_s * rate_rad_s
        cosine, sine = math.cos(way_rad), math.sin(way_rad)
    else:
        along, across = math.cos(x[kalman.LEEWAY]), math.sin(x[kalman.LEEWAY])
        cosine, sine = mean[0] * along - mean[1] * across, mean[1] * along + mean[0] * across
    towards, by_way = ((cosine, -speed_m_s * sine), (sine, speed_m_s * cosine))[axis]
    by_speed = (math.cos, math.sin)[axis](on_leg_rad)
    current, orbit = _CURRENT[axis], _ORBIT[axis]
    way_m_s = speed_m_s * towards + x[current]
    noise = math.exp(noise_model.log_velocity_noise)
    parts = ((kalman.HEADING, by_way), (kalman.LEEWAY, by_way), (kalman.SPEED, by_speed), (current, 1.0))
    if mean is not None:
        return Expected(way_m_s, way_m_s, parts, noise)
    lagging = ((kalman.RATE, -lag_s * by_way), (kalman.COURSE_LAG, -rate_rad_s * by_way))
    omega_rad_s = noise_model.omega_rad_s
    by_swing, by_swing_rate = noise_model.orbit_shares
    by_yaw, by_yaw_rate = noise_model.coupling.shares[2 * axis : 2 * axis + 2]
    late = by_yaw_rate / omega_rad_s
    noise += LATE_S * math.exp(noise_model.log_power) * late * late
    swinging = ((orbit, by_swing), (orbit + 1, by_swing_rate / omega_rad_s), (kalman.WAVE, by_yaw))
    moving = (*swinging, (kalman.WAVE_RATE, late))
    moved_m_s = 0.0
    for place, part in moving:
        moved_m_s += part * x[place]
    return Expected(way_m_s + moved_m_s, way_m_s, (*parts, *lagging, *moving), noise)
