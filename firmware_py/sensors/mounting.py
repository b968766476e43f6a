"""Mounting of a sensor in the boat: converts its attitude and rates to the axes of the boat.

Axes are forward, starboard and down, for the boat and for the sensor. The names of the mountings and the order of the
rotations are those of MAVLink's MAV_SENSOR_ORIENTATION and ArduPilot's AHRS_ORIENTATION: the sensor is turned by the
angles of its name about the axes of the boat, first roll, then pitch, then yaw. With `yaw_90` the forward mark of the
sensor points to starboard, with `roll_180` its label points down, with `pitch_90` its forward mark points up.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec

from firmware_py.common.angles import clamp, radians, wrap_two_pi
from firmware_py.common.options import option

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

MOUNTINGS = (
    *("none", "yaw_45", "yaw_90", "yaw_135", "yaw_180", "yaw_225", "yaw_270", "yaw_315"),
    *("roll_180", "roll_180_yaw_45", "roll_180_yaw_90", "roll_180_yaw_135"),
    *("pitch_180", "roll_180_yaw_225", "roll_180_yaw_270", "roll_180_yaw_315"),
    *("roll_90", "roll_270", "pitch_90", "pitch_270"),
)
MAX_PITCH_RAD = radians(80.0)  # of the boat; near 90 degrees, heading and roll turn about the same axis
VERTICAL = "attitude near vertical: check the mounting"  # fault of a compass without an attitude of the boat


class BoatAttitude(msgspec.Struct, frozen=True):
    """Attitude of the boat: heading in [0, 2 pi), pitch positive with the bow up, roll with the starboard side down.

    The yaw rate is the rate of the heading, None without rates of the sensor.
    """

    heading_rad: float
    pitch_rad: float
    roll_rad: float
    yaw_rate_rad_s: float | None


def mounting_option() -> Any:
    """Declare the option `mounting` in the option record of a driver."""
    return option(
        "rotation of the sensor in the boat, as MAVLink names it; none: label up, forward mark to the bow",
        default="none",
        choices=MOUNTINGS,
    )


def rotation(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Matrix:
    """Return Rz(yaw) Ry(pitch) Rx(roll), which takes vectors in the turned axes to the axes before the turn.

    The angles are right-handed about the third, second and first axis, also known as Euler angles in the sequence
    Z-Y-X: with axes forward, starboard and down, the matrix of heading, pitch and roll takes the boat to north, east
    and down.
    """
    sr, cr = math.sin(roll_rad), math.cos(roll_rad)
    sp, cp = math.sin(pitch_rad), math.cos(pitch_rad)
    sy, cy = math.sin(yaw_rad), math.cos(yaw_rad)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def multiply(left: Matrix, right: Matrix) -> Matrix:
    """Return the product of two matrices."""
    return (_row_times(left[0], right), _row_times(left[1], right), _row_times(left[2], right))


def _row_times(row: Vector, matrix: Matrix) -> Vector:
    a, b, c = matrix
    return (
        row[0] * a[0] + row[1] * b[0] + row[2] * c[0],
        row[0] * a[1] + row[1] * b[1] + row[2] * c[1],
        row[0] * a[2] + row[1] * b[2] + row[2] * c[2],
    )


class Mounting:
    """The constant rotation between a sensor and the boat."""

    def __init__(self, name: str) -> None:
        """Set the rotation by its name in MOUNTINGS."""
        words = name.split("_")
        angles_rad = {axis: radians(float(angle)) for axis, angle in zip(words[::2], words[1::2], strict=False)}
        boat_from_sensor = rotation(
            angles_rad.get("roll", 0.0), angles_rad.get("pitch", 0.0), angles_rad.get("yaw", 0.0)
        )
        first, second, third = zip(*boat_from_sensor, strict=True)
        self._sensor_from_boat: Matrix = (first, second, third)

    def boat_attitude(self, ned_from_sensor: Matrix, rates_rad_s: Vector | None = None) -> BoatAttitude | None:
        """Return the attitude of the boat, None if it is nearly vertical, which a wrong mounting also causes.

        `ned_from_sensor` takes vectors of the sensor to north, east and down. `rates_rad_s` are its rates about its
        forward, starboard and down axes.
        """
        forward, starboard, down = zip(*multiply(ned_from_sensor, self._sensor_from_boat), strict=True)
        pitch_rad = -math.asin(clamp(forward[2], -1.0, 1.0))
        if abs(pitch_rad) > MAX_PITCH_RAD:
            return None
        roll_rad = math.atan2(starboard[2], down[2])
        yaw_rate_rad_s = None
        if rates_rad_s is not None:
            # The rate of heading of Euler angles in the sequence Z-Y-X (Fossen, Handbook, 2011, eq. 2.28).
            _, about_starboard_rad_s, about_down_rad_s = _row_times(rates_rad_s, self._sensor_from_boat)
            yaw_rate_rad_s = (
                about_starboard_rad_s * math.sin(roll_rad) + about_down_rad_s * math.cos(roll_rad)
            ) / math.cos(pitch_rad)
        return BoatAttitude(wrap_two_pi(math.atan2(forward[1], forward[0])), pitch_rad, roll_rad, yaw_rate_rad_s)
