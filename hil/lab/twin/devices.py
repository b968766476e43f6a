"""NMEA compass and receiver and Dynamixel servo of hil/devices for compiled code: what they report, and when."""

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
from hil.lab.compiled import compiled
from hil.lab.twin import ship as ships
from hil.lab.twin.kalman import Floats
from hil.ship.servo import DEFAULT_SLEW_RAD_S, DEFAULT_STOP_RAD

RADIANS_PER_COUNT, COUNTS_PER_RADIAN = TWO_PI / 4096, 4096 / math.tau
CENTRE_COUNTS, LARGEST_COUNTS = 2048.0, 4095.0
COMPASS_BAUD, RECEIVER_BAUD = 38400, 9600
FILTER_SAMPLE_S = 0.1
KILOMETRES_PER_HOUR = 3.6
FRAME_BYTES = len("$GP*hh\r\n")
# Sentences without the digits before the point, which vary; everything else is as wide as it is here.
HEADING_BYTES = FRAME_BYTES + len("HDT,.0,T")
PLACE = "3600.00000,N,12100.00000,E"
FIX_BYTES = sum(
    FRAME_BYTES + len(body)
    for body in (
        f"RMC,000000.00,A,{PLACE},.000,.00,010126,,,A",
        f"GGA,000000.00,{PLACE},1,11,0.9,2.0,M,17.5,M,,",
        "VTG,.00,T,,M,.000,N,.000,K,A",
    )
)
LOST_BYTES = sum(
    FRAME_BYTES + len(body)
    for body in ("RMC,000000.00,V,,,,,,,010126,,,N", "GGA,000000.00,,,,,0,00,99.99,,,,,,", "VTG,,,,,,,,,N")
)

# What is on its way to the autopilot: when it is there, and a heading; or speed, course and whether there is no fix.
THERE_S, SAID_RAD = 0, 1
SPEED_M_S, COURSE_RAD, LOST = 1, 2, 3
# A shaft on its way: from where, since when, and to where.
FROM_RAD, SINCE_S, TO_RAD = range(3)


class Devices(NamedTuple):
    """When compass and receiver sample, and where in the series is what is random about it, sample by sample.

    That of a fix is three numbers: noise of the velocity, north and east [m/s], and above 0 that there is no fix.
    `filter_s` of 0 is a receiver that does not filter.
    """

    compass_phase_s: float
    compass_period_s: float
    compass_at: int  # the compass's noise [deg]
    fix_phase_s: float
    fix_period_s: float
    fix_at: int
    latency_s: float
    filter_s: float


@compiled
def digits_of(number: float) -> int:
    """Return how many digits stand before the point."""
    count = 1
    while number >= 10.0:
        number /= 10.0
        count += 1
    return count


@compiled
def bearing(angle_deg: float, resolution_deg: float) -> float:
    """Round an angle to the resolution and wrap it to [0, 360) (hil/devices/nmea_text.py)."""
    rounded_deg = np.fmod(np.rint(angle_deg / resolution_deg) * resolution_deg, 360.0)
    if rounded_deg < 0.0:
        rounded_deg += 360.0
    return 0.0 if 360.0 - rounded_deg < 0.5 * resolution_deg else rounded_deg


@compiled
def heard(devices: Devices, series: ships.Series, sample: int, now_s: float, heading_rad: float) -> tuple[float, float]:
    """Return when the sentence of a heading is complete, and what the compass says in it, rounded as it is there."""
    shown_deg = bearing(heading_rad * DEGREES_PER_RADIAN + series[devices.compass_at + sample], 0.1)
    printed_deg = np.rint(shown_deg * 10.0) / 10.0
    there_s = now_s + (HEADING_BYTES + digits_of(printed_deg)) * 10 / COMPASS_BAUD
    return there_s, wrap_two_pi(printed_deg * RADIANS_PER_DEGREE)


@compiled
def tell_fix(
    told: Floats, devices: Devices, series: ships.Series, epoch: int, north_m_s: float, east_m_s: float
) -> None:
    """Fill what the receiver says of a velocity, as the sentences round it, and when the burst is complete."""
    at = devices.fix_at + 3 * epoch
    north_m_s, east_m_s, lost = north_m_s + series[at], east_m_s + series[at + 1], series[at + 2]
    speed_m_s = math.hypot(north_m_s, east_m_s)
    knots = np.rint(speed_m_s * KNOTS_PER_METRE_PER_SECOND * 1000.0) / 1000.0
    course_deg = np.rint(bearing(math.atan2(east_m_s, north_m_s) * DEGREES_PER_RADIAN, 0.01) * 100.0) / 100.0
    kilometres_per_hour = np.rint(speed_m_s * KILOMETRES_PER_HOUR * 1000.0) / 1000.0
    size = LOST_BYTES
    if not lost > 0.0:
        size = FIX_BYTES + 2 * digits_of(knots) + 2 * digits_of(course_deg) + digits_of(kilometres_per_hour)
    begun_s = devices.fix_phase_s + epoch * devices.fix_period_s + devices.latency_s
    told[THERE_S] = begun_s + size * 10 / RECEIVER_BAUD
    told[SPEED_M_S] = knots * METRES_PER_SECOND_PER_KNOT
    told[COURSE_RAD] = wrap_two_pi(course_deg * RADIANS_PER_DEGREE)
    told[LOST] = lost


@compiled
def sensed_velocity(
    hull: Floats, ship: ships.Ship, series: ships.Series, step: int, offset_s: float
) -> tuple[float, float]:
    """Return the velocity north and east by way of speed and course, as the world hands it to the receiver."""
    north_m_s, east_m_s = ships.velocity(hull, ship, series, step, offset_s)
    speed_m_s, course_rad = math.hypot(north_m_s, east_m_s), wrap_two_pi(math.atan2(east_m_s, north_m_s))
    return speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)


@compiled
def shaft_angle(shaft: Floats, t_s: float) -> float:
    """Return where the shaft is at a time."""
    way_rad = shaft[TO_RAD] - shaft[FROM_RAD]
    reach_rad = DEFAULT_SLEW_RAD_S * (t_s - shaft[SINCE_S])
    if reach_rad >= abs(way_rad):
        return float(shaft[TO_RAD])
    return float(shaft[FROM_RAD] + math.copysign(reach_rad, way_rad))


@compiled
def counted_angle(shaft: Floats, t_s: float) -> float:
    """Return the angle that the servo's encoder shows at a time."""
    return float(np.rint(shaft_angle(shaft, t_s) * COUNTS_PER_RADIAN) * RADIANS_PER_COUNT)


@compiled
def send_shaft(shaft: Floats, t_s: float, command_rad: float) -> None:
    """Send the shaft to a command, in counts, from now on."""
    counts = np.rint(clamp(CENTRE_COUNTS + command_rad / RADIANS_PER_COUNT, 0.0, LARGEST_COUNTS))
    target_rad = clamp((counts - CENTRE_COUNTS) / COUNTS_PER_RADIAN, -DEFAULT_STOP_RAD, DEFAULT_STOP_RAD)
    if target_rad != shaft[TO_RAD]:
        shaft[FROM_RAD], shaft[SINCE_S], shaft[TO_RAD] = shaft_angle(shaft, t_s), t_s, target_rad
