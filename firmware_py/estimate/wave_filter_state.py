"""What the wave filter remembers from tick to tick, and how it begins."""

from __future__ import annotations

import math
import struct
from operator import itemgetter
from typing import Final, NamedTuple

import msgspec
import numpy as np

from firmware_py.common.angles import clamp, radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.estimate import kalman
from firmware_py.estimate.kalman import Numbers
from firmware_py.estimate.learning import NoiseModel, expecting_float
from firmware_py.model.kt import KtModel

# What a boat can have; no rudder stands to more than the bias (RUD_LIMIT_DEG as delivered).
LEAST_SPEED_M_S, MOST_SPEED_M_S = 0.08, 2.5
LEAST_FACTOR, MOST_FACTOR = 0.4, 2.5
LEAST_BIAS_RAD, MOST_BIAS_RAD = radians(-30.0), radians(30.0)
_bounded_of: Final = itemgetter(kalman.SPEED, kalman.FACTOR, kalman.BIAS, kalman.BIAS_MEAN)
# Standard deviations at the start. The first heading lies anywhere on a wave: how far the heading itself is from it is
# left open, so that the waves are found out of what follows.
FIRST: Final = (
    *(radians(30.0), radians(1.0), radians(5.0), radians(30.0), radians(1.0)),
    *(0.2, 0.2, 0.4, 0.2, radians(5.0), 0.7, radians(4.5)),
    *(radians(10.0), radians(8.0), 0.1, 0.1, 0.1, 0.1),
)
# What each state gains in a second, in their order, but for the rudder bias and the motions of the waves, which learn
# it, and the float's yaw rate, which gains by the square of its frequency, up to a bound.
WHITE: Final = (
    *(0.0, 1e-6 * radians(1.0) ** 2, 0.0, 0.0, 0.1 * radians(1.0) ** 2),
    *(5e-7, 5e-7),  # the current 2 cm/s in a quarter of an hour
    *(1e-5, 1e-6, 1e-7, 0.0, 1e-4 * radians(1.0) ** 2),
)
FLOAT_WANDERS: Final = 0.64  # [rad^2/s^2]; of a quick float no more than of one of 0.8 rad/s
TOGETHER: Final = 0.98  # correlation of the headings of float and glider at the start
FIRST_COURSE_LAG_S: Final = 0.5
_number_at: Final = struct.Struct("d").unpack_from
_NUMBER_BYTES: Final = 8
_ROW_BYTES: Final = kalman.STATES * _NUMBER_BYTES
_BETWEEN: Final = _ROW_BYTES - 2 * _NUMBER_BYTES  # from the end of a row of the triangle below to the next, of one less
# North, east and speed lie behind each other: the triangle of their covariances, row by row.
_water_at: Final = struct.Struct(f"3d{_BETWEEN}x2d{_BETWEEN + _NUMBER_BYTES}xd").unpack_from


class Velocity(NamedTuple):
    """A velocity over the ground; `mean` as in wave_filter.correct_velocity."""

    t_s: float
    speed_m_s: float
    course_rad: float
    mean: tuple[float, float] | None = None


class Heading(NamedTuple):
    """A true heading."""

    t_s: float
    heading_rad: float


class WaveFilterSettings(msgspec.Struct, frozen=True):
    """The K-T model of the vehicle file."""

    model: KtModel

    @classmethod
    def of(cls, parameters: ParameterSet) -> WaveFilterSettings:
        """Read the settings from the parameters."""
        return cls(model=KtModel.of(parameters))


class WaveFilterState(msgspec.Struct, frozen=True):
    """State and covariance at t_s; empty before the first heading.

    The covariance (18 x 18) and the slopes (18 x 2) are the bytes of their numbers, row by row. The slopes are by how
    much the state would differ for another ln omega of the waves, or ln of the frequency at which the float follows.
    `sample_t_s` and `fix_t_s` are the times of the last heading and velocity taken, `refusals` how many headings in a
    row the gate has refused. `expected_water` is what the filter begins with: current north and east, speed through
    the water [m/s]; `leg_rad` the way through the water of the leg that the boat is on, since `leg_t_s`.
    `slow_wave_rad` is the mean of the yaw that has been taken for waves.
    """

    t_s: float = 0.0
    x: tuple[float, ...] = ()
    p: bytes = b""
    slopes: bytes = b""
    noise_model: NoiseModel = NoiseModel()
    rudder_rad: float = 0.0
    sample_t_s: float | None = None
    fix_t_s: float | None = None
    refusals: int = 0
    innovation_rad: float = 0.0
    innovation_sd_rad: float = 0.0
    expected_water: tuple[float, float, float] = (0.0, 0.0, 0.5)
    leg_rad: float | None = None
    slow_wave_rad: float = 0.0
    leg_t_s: float = 0.0

    def spread(self, index: int) -> float:
        """Return the standard deviation of a state."""
        return math.sqrt(_number_at(self.p, (_ROW_BYTES + _NUMBER_BYTES) * index)[0]) if self.p else 0.0

    def water_covariance(self) -> tuple[float, ...]:
        """Return those of current north, east and the speed, for a filter that has started: nn, ne, nu, ee, eu, uu."""
        return _water_at(self.p, (_ROW_BYTES + _NUMBER_BYTES) * kalman.NORTH)

    def covariance(self, row: int, column: int) -> float:
        """Return the covariance of two states of a filter that has started."""
        number: float = _number_at(self.p, _ROW_BYTES * row + _NUMBER_BYTES * column)[0]
        return number


def bound(x: Numbers) -> Numbers:
    """Keep speed, turning factor and rudder bias within what a boat can have."""
    speed_m_s, factor, bias_rad, mean_rad = _bounded_of(x)
    if (
        LEAST_SPEED_M_S <= speed_m_s <= MOST_SPEED_M_S
        and LEAST_FACTOR <= factor <= MOST_FACTOR
        and LEAST_BIAS_RAD <= bias_rad <= MOST_BIAS_RAD
        and LEAST_BIAS_RAD <= mean_rad <= MOST_BIAS_RAD
    ):
        return x
    bounded = list(x)
    bounded[kalman.SPEED] = clamp(speed_m_s, LEAST_SPEED_M_S, MOST_SPEED_M_S)
    bounded[kalman.FACTOR] = clamp(factor, LEAST_FACTOR, MOST_FACTOR)
    bounded[kalman.BIAS] = clamp(bias_rad, LEAST_BIAS_RAD, MOST_BIAS_RAD)
    bounded[kalman.BIAS_MEAN] = clamp(mean_rad, LEAST_BIAS_RAD, MOST_BIAS_RAD)
    return tuple(bounded)


def start(state: WaveFilterState, t_s: float, heading_rad: float, turning_ability_1_s: float = 0.0) -> WaveFilterState:
    """Return the filter at its first heading, with the sea and the water that the state has learned or expects."""
    north_m_s, east_m_s, speed_m_s = water_of(state)
    x = [0.0] * kalman.STATES
    x[kalman.HEADING] = x[kalman.FLOAT] = heading_rad
    x[kalman.NORTH], x[kalman.EAST] = north_m_s, east_m_s
    x[kalman.SPEED], x[kalman.FACTOR] = clamp(speed_m_s, LEAST_SPEED_M_S, MOST_SPEED_M_S), 1.0
    x[kalman.COURSE_LAG] = FIRST_COURSE_LAG_S
    p = np.diag(np.square(FIRST))
    both = TOGETHER * FIRST[kalman.HEADING] * FIRST[kalman.FLOAT]
    p[kalman.HEADING, kalman.FLOAT] = p[kalman.FLOAT, kalman.HEADING] = both
    of_bias = FIRST[kalman.BIAS_MEAN] * FIRST[kalman.BIAS_MEAN]  # what it wanders by comes on top
    p[kalman.BIAS, kalman.BIAS_MEAN] = p[kalman.BIAS_MEAN, kalman.BIAS] = of_bias
    slopes = np.zeros((kalman.STATES, 2))
    return WaveFilterState(
        t_s,
        tuple(x),
        p.tobytes(),
        slopes.tobytes(),
        expecting_float(state.noise_model, turning_ability_1_s),
        sample_t_s=t_s,
        expected_water=(north_m_s, east_m_s, speed_m_s),
    )


def water_of(state: WaveFilterState) -> tuple[float, float, float]:
    """Return current north and east and the speed through the water [m/s], as estimated or else as expected."""
    x = state.x
    return (x[kalman.NORTH], x[kalman.EAST], x[kalman.SPEED]) if x else state.expected_water
