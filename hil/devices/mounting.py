"""A sensor that is turned in the boat: its orientation and its rates, computed with quaternions.

Source: the order of the rotations in MAVLink's MAV_SENSOR_ORIENTATION. Written independently of the drivers, which use
matrices. A quaternion is (w, x, y, z); it takes vectors of the sensor to north, east and down. Axes of boat and sensor
are forward, starboard and down.
"""

from __future__ import annotations

import math
import re

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]

_AXES = {"roll": 1, "pitch": 2, "yaw": 3}
# Exchanges forward, starboard, down and right, ahead, up: half a turn about the line between the first two axes.
_EXCHANGE = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)


def turn(axis: str, angle_rad: float) -> Quaternion:
    """Return the rotation about the axis of roll, pitch or yaw."""
    parts = [math.cos(angle_rad / 2.0), 0.0, 0.0, 0.0]
    parts[_AXES[axis]] = math.sin(angle_rad / 2.0)
    return parts[0], parts[1], parts[2], parts[3]


def product(first: Quaternion, *others: Quaternion) -> Quaternion:
    """Return the Hamilton product; the last rotation is applied first."""
    w, x, y, z = first
    for a, b, c, d in others:
        w, x, y, z = (
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        )
    return w, x, y, z


def sensor_in_ned(mounting: str, heading_rad: float, pitch_rad: float, roll_rad: float) -> Quaternion:
    """Return the orientation of a sensor with this mounting in a boat of this attitude."""
    orientation = product(turn("yaw", heading_rad), turn("pitch", pitch_rad), turn("roll", roll_rad))
    for axis, angle_deg in reversed(re.findall(r"(roll|pitch|yaw)_(\d+)", mounting)):
        orientation = product(orientation, turn(axis, math.radians(float(angle_deg))))
    return orientation


def to_sensor(orientation: Quaternion, vector: Vector) -> Vector:
    """Return a vector in north, east and down in the axes of the sensor."""
    w, x, y, z = orientation
    rotated = product((w, -x, -y, -z), (0.0, *vector), orientation)
    return rotated[1], rotated[2], rotated[3]


def to_right_ahead_up(orientation: Quaternion) -> Quaternion:
    """Return the orientation in east, north and up of a sensor whose axes point right, ahead and up."""
    return product(_EXCHANGE, orientation, _EXCHANGE)


def euler_deg(orientation: Quaternion) -> tuple[float, float, float]:
    """Return roll, pitch and yaw in degrees, right-handed about the first, second and third axis (sequence Z-Y-X)."""
    w, x, y, z = orientation
    sine = 2.0 * (w * y - z * x)
    if abs(sine) > 1.0 - 1e-13:  # roll and yaw turn about the same axis
        return 0.0, math.copysign(90.0, sine), math.copysign(2.0, -sine) * math.degrees(math.atan2(x, w))
    return (
        math.degrees(math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))),
        math.degrees(math.asin(sine)),
        math.degrees(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))),
    )
