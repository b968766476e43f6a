"""The mechanics of a rudder servo: a shaft with a limited slew, stops, and jams."""

from __future__ import annotations

import math

from firmware_py.common.angles import RADIANS_PER_DEGREE, clamp

DEFAULT_SLEW_RAD_S = 30.0 * RADIANS_PER_DEGREE
DEFAULT_STOP_RAD = 45.0 * RADIANS_PER_DEGREE


class ServoShaft:
    """A shaft that moves to its target at constant speed and stops there.

    Between two events (a target, torque, a jam, `advance`) the motion is exact: one step and a thousand give the same
    angle. Events happen at the time of the last `advance`, so the world advances the shaft before an emulator uses
    it. Positive angles are to starboard.
    """

    def __init__(
        self,
        *,
        angle_rad: float = 0.0,
        slew_rad_s: float = DEFAULT_SLEW_RAD_S,
        low_stop_rad: float = -DEFAULT_STOP_RAD,
        high_stop_rad: float = DEFAULT_STOP_RAD,
        now_s: float = 0.0,
    ) -> None:
        """Start at rest and released; raise ValueError for stops in the wrong order or a negative slew."""
        if not low_stop_rad < high_stop_rad:
            raise ValueError(f"the stops are in the wrong order: {low_stop_rad} and {high_stop_rad} rad")
        if not slew_rad_s >= 0.0:
            raise ValueError(f"the slew must not be negative, not {slew_rad_s} rad/s")
        self._low_rad = low_stop_rad
        self._high_rad = high_stop_rad
        self._slew_rad_s = slew_rad_s
        self._now_s = now_s
        self._angle_rad = clamp(angle_rad, low_stop_rad, high_stop_rad)
        self._start_rad = self._angle_rad
        self._start_s = now_s
        self._target_rad = self._angle_rad
        self._has_torque = False
        self._is_jammed = False

    def angle_rad(self) -> float:
        """Return the true angle at the time of the last advance."""
        return self._angle_rad

    def rate_rad_s(self) -> float:
        """Return the rate of the shaft after the last advance."""
        if not self._can_move() or self._angle_rad == self._target_rad:
            return 0.0
        return math.copysign(self._slew_rad_s, self._target_rad - self._angle_rad)

    def set_target(self, target_rad: float) -> None:
        """Move toward this angle, clipped to the stops; a value that is not finite is ignored."""
        if not math.isfinite(target_rad):
            return
        target_rad = clamp(target_rad, self._low_rad, self._high_rad)
        if target_rad != self._target_rad:
            self._target_rad = target_rad
            self._start_motion()

    def set_torque(self, *, on: bool) -> None:
        """Engage or release the motor; a released shaft keeps its angle."""
        if on != self._has_torque:
            self._has_torque = on
            self._start_motion()

    def jam(self, angle_rad: float | None = None) -> None:
        """Block the shaft at the present or a given angle, regardless of the motor."""
        if angle_rad is not None and math.isfinite(angle_rad):
            self._angle_rad = clamp(angle_rad, self._low_rad, self._high_rad)
        self._is_jammed = True
        self._start_motion()

    def free(self) -> None:
        """End a jam; an engaged motor then moves to its target."""
        self._is_jammed = False
        self._start_motion()

    def advance(self, now_s: float) -> None:
        """Advance the shaft to now_s; an earlier time changes nothing."""
        if not now_s > self._now_s:
            return
        self._now_s = now_s
        if not self._can_move():
            return
        distance_rad = self._target_rad - self._start_rad
        travelled_rad = self._slew_rad_s * (now_s - self._start_s)
        if travelled_rad >= abs(distance_rad):
            self._angle_rad = self._target_rad
        else:
            self._angle_rad = self._start_rad + math.copysign(travelled_rad, distance_rad)

    def _can_move(self) -> bool:
        return self._has_torque and not self._is_jammed

    def _start_motion(self) -> None:
        """Start the motion at the present angle and time, so that rounding errors of steps do not add up."""
        self._start_rad = self._angle_rad
        self._start_s = self._now_s
