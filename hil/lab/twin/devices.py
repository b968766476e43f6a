"""NMEA compass, NMEA receiver and Dynamixel servo of hil/devices in compiled code: contents and times of messages."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from firmware_py.common.angles import (
    DEGREES_PER_RADIAN,
    KNOTS_PER_METRE_PER_SECOND,
    METRES_PER_SECOND_PER_KNOT,
    RADIANS_PER_DEGREE,
    TWO_PI,
    clamp,
    wrap_two_pi,
)  # fmt: skip
from hil.devices.emulator import METRES_PER_DEGREE
from hil.lab.compiled import compiled
from hil.lab.twin import ship as ships
from hil.lab.twin.ship import Floats
from hil.ship.servo import DEFAULT_SLEW_RAD_S, DEFAULT_STOP_RAD

RADIANS_PER_COUNT, COUNTS_PER_RADIAN = TWO_PI / 4096, 4096 / math.tau
CENTRE_COUNTS, MAX_COUNTS = 2048.0, 4095.0
COMPASS_BAUD, RECEIVER_BAUD = 38400, 9600
FILTER_SAMPLE_S = 0.1
KILOMETRES_PER_HOUR = 3.6
FRAME_BYTES = len("$GP*hh\r\n")
# Lengths of the sentences without the digits before the decimal points, whose number varies.
HEADING_BYTES = FRAME_BYTES + len("HDT,.0,T")
POSITION_TEXT = "3600.00000,N,12100.00000,E"
FIX_BYTES = sum(
    FRAME_BYTES + len(body)
    for body in (
        f"RMC,000000.00,A,{POSITION_TEXT},.000,.00,010126,,,A",
        f"GGA,000000.00,{POSITION_TEXT},1,11,0.9,2.0,M,17.5,M,,",
        "VTG,.00,T,,M,.000,N,.000,K,A",
    )
)
LOST_BYTES = sum(
    FRAME_BYTES + len(body)
    for body in ("RMC,000000.00,V,,,,,,,010126,,,N", "GGA,000000.00,,,,,0,00,99.99,,,,,,", "VTG,,,,,,,,,N")
)

UNITS_PER_DEGREE = 60.0 * 1e5  # a position is printed in minutes with five decimals
MIN_COSINE = 1e-3  # as in hil/devices/nmea_gps.py

# Columns of the queued messages. Heading: arrival time and angle. Fix: arrival time, speed, course, a flag that is
# above 0 if there is no fix, and position; without a fix, speed, course and position are NaN.
ARRIVAL_S, MESSAGE_RAD = 0, 1
SPEED_M_S, COURSE_RAD, LOST, LATITUDE_RAD, LONGITUDE_RAD = range(1, 6)
FIX_COLUMNS = 6
# Columns of the random numbers of a fix: errors of position and velocity, north and east, and a flag that is above 0
# without a fix.
NORTH_ERROR_M, EAST_ERROR_M, NORTH_ERROR_M_S, EAST_ERROR_M_S, NO_FIX = range(5)
FIX_NUMBERS = 5
# State of the shaft: start angle and time of its movement, and target.
FROM_RAD, START_S, TO_RAD = range(3)


class Devices(NamedTuple):
    """Sampling times of compass and receiver, and the indices of their random numbers in the series.

    A fix has FIX_NUMBERS random numbers. `latency_s`: from the sample of a fix to its first byte. `filter_s`: time
    constant of the receiver's velocity filter, 0 without a filter.
    """

    compass_phase_s: float
    compass_period_s: float
    compass_at: int  # index of the compass noise [deg]
    fix_phase_s: float
    fix_period_s: float
    fix_at: int
    latency_s: float
    filter_s: float
    start_latitude_deg: float
    start_longitude_deg: float


@compiled
def digits_of(number: float) -> int:
    """Return the number of digits before the decimal point."""
    count = 1
    while number >= 10.0:
        number /= 10.0
        count += 1
    return count


@compiled
def wrap_degrees(angle_deg: float) -> float:
    """Compute the remainder of an angle by 360, as Python does for floats."""
    rest_deg = np.fmod(angle_deg, 360.0)
    return float(rest_deg + 360.0 if rest_deg < 0.0 else rest_deg)


@compiled
def bearing(angle_deg: float, resolution_deg: float) -> float:
    """Round an angle to the resolution and wrap it to [0, 360) (hil/devices/nmea_text.py)."""
    rounded_deg = wrap_degrees(np.rint(angle_deg / resolution_deg) * resolution_deg)
    return 0.0 if 360.0 - rounded_deg < 0.5 * resolution_deg else rounded_deg


@compiled
def compass_message(
    devices: Devices, series: ships.Series, sample: int, now_s: float, heading_rad: float
) -> tuple[float, float]:
    """Return the arrival time of a heading sentence and the heading in it, rounded as in the sentence."""
    noisy_deg = bearing(heading_rad * DEGREES_PER_RADIAN + series[devices.compass_at + sample], 0.1)
    printed_deg = np.rint(noisy_deg * 10.0) / 10.0
    arrival_s = now_s + (HEADING_BYTES + digits_of(printed_deg)) * 10 / COMPASS_BAUD
    return arrival_s, wrap_two_pi(printed_deg * RADIANS_PER_DEGREE)


@compiled
def decoded_coordinate(angle_deg: float) -> float:
    """Return the angle [rad] that the autopilot decodes from the printed degrees and minutes of a coordinate."""
    units = np.rint(abs(angle_deg) * 60.0 * 1e5)
    whole_deg = np.floor(units / UNITS_PER_DEGREE)
    minutes = (units - whole_deg * UNITS_PER_DEGREE) / 1e5
    return math.copysign(whole_deg + minutes / 60.0, angle_deg) * RADIANS_PER_DEGREE


@compiled
def fill_position(
    fix: Floats, devices: Devices, north_m: float, east_m: float, north_error_m: float, east_error_m: float
) -> None:
    """Compute latitude and longitude of a fix, rounded as in the sentences, into `fix`."""
    metres_east = METRES_PER_DEGREE * math.cos(devices.start_latitude_deg * RADIANS_PER_DEGREE)
    latitude_deg = devices.start_latitude_deg + north_m / METRES_PER_DEGREE
    longitude_deg = devices.start_longitude_deg + east_m / metres_east
    cosine = max(math.cos(latitude_deg * RADIANS_PER_DEGREE), MIN_COSINE)
    longitude_deg += east_error_m / (METRES_PER_DEGREE * cosine)
    latitude_deg += north_error_m / METRES_PER_DEGREE
    fix[LATITUDE_RAD] = decoded_coordinate(latitude_deg)
    fix[LONGITUDE_RAD] = decoded_coordinate(wrap_degrees(longitude_deg + 180.0) - 180.0)


@compiled
def fill_fix(
    fix: Floats,
    devices: Devices,
    series: ships.Series,
    epoch: int,
    position_m: tuple[float, float],
    velocity_m_s: tuple[float, float],
) -> None:
    """Compute a fix, rounded as in the sentences, and its arrival time into `fix`, from true position and velocity."""
    first = devices.fix_at + FIX_NUMBERS * epoch
    byte_count, fix[LOST] = LOST_BYTES, series[first + NO_FIX]
    fix[SPEED_M_S] = fix[COURSE_RAD] = fix[LATITUDE_RAD] = fix[LONGITUDE_RAD] = np.nan
    if not fix[LOST] > 0.0:
        north_m_s = velocity_m_s[0] + series[first + NORTH_ERROR_M_S]
        east_m_s = velocity_m_s[1] + series[first + EAST_ERROR_M_S]
        speed_m_s = math.hypot(north_m_s, east_m_s)
        knots = np.rint(speed_m_s * KNOTS_PER_METRE_PER_SECOND * 1000.0) / 1000.0
        course_deg = np.rint(bearing(math.atan2(east_m_s, north_m_s) * DEGREES_PER_RADIAN, 0.01) * 100.0) / 100.0
        kilometres_per_hour = np.rint(speed_m_s * KILOMETRES_PER_HOUR * 1000.0) / 1000.0
        byte_count = FIX_BYTES + 2 * digits_of(knots) + 2 * digits_of(course_deg) + digits_of(kilometres_per_hour)
        fix[SPEED_M_S] = knots * METRES_PER_SECOND_PER_KNOT
        fix[COURSE_RAD] = wrap_two_pi(course_deg * RADIANS_PER_DEGREE)
        fill_position(
            fix, devices, position_m[0], position_m[1], series[first + NORTH_ERROR_M], series[first + EAST_ERROR_M]
        )
    sent_s = devices.fix_phase_s + epoch * devices.fix_period_s + devices.latency_s
    fix[ARRIVAL_S] = sent_s + byte_count * 10 / RECEIVER_BAUD


@compiled
def sensed_velocity(
    hull: Floats, ship: ships.Ship, series: ships.Series, step: int, offset_s: float
) -> tuple[float, float]:
    """Return the velocity north and east, converted to speed and course and back as in the harness."""
    north_m_s, east_m_s = ships.velocity(hull, ship, series, step, offset_s)
    speed_m_s, course_rad = math.hypot(north_m_s, east_m_s), wrap_two_pi(math.atan2(east_m_s, north_m_s))
    return speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)


@compiled
def shaft_angle(shaft: Floats, t_s: float) -> float:
    """Return the angle of the shaft at time `t_s`."""
    distance_rad = shaft[TO_RAD] - shaft[FROM_RAD]
    moved_rad = DEFAULT_SLEW_RAD_S * (t_s - shaft[START_S])
    if moved_rad >= abs(distance_rad):
        return float(shaft[TO_RAD])
    return float(shaft[FROM_RAD] + math.copysign(moved_rad, distance_rad))


@compiled
def counted_angle(shaft: Floats, t_s: float) -> float:
    """Return the angle of the servo's encoder at time `t_s`."""
    return float(np.rint(shaft_angle(shaft, t_s) * COUNTS_PER_RADIAN) * RADIANS_PER_COUNT)


@compiled
def send_shaft(shaft: Floats, t_s: float, command_rad: float) -> None:
    """Start a movement of the shaft to a command, rounded to encoder counts."""
    counts = np.rint(clamp(CENTRE_COUNTS + command_rad / RADIANS_PER_COUNT, 0.0, MAX_COUNTS))
    target_rad = clamp((counts - CENTRE_COUNTS) / COUNTS_PER_RADIAN, -DEFAULT_STOP_RAD, DEFAULT_STOP_RAD)
    if target_rad != shaft[TO_RAD]:
        shaft[FROM_RAD], shaft[START_S], shaft[TO_RAD] = shaft_angle(shaft, t_s), t_s, target_rad
