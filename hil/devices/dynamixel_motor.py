"""Measurements of a Dynamixel servo, and its shutdown on errors."""

from __future__ import annotations

import math

import numpy as np

from hil.devices.dynamixel_table import POSITION_MODE, WATCHDOG_TRIPPED, Address, ControlTable
from hil.devices.emulator import Shaft

_COUNTS_PER_RADIAN = 4096 / math.tau
_CENTRE = 2048
_MAX_HOMING_OFFSET = 1024  # in position mode a larger homing offset is ignored
_POSITION_MODES = (POSITION_MODE, 4, 5)  # position, extended position, current-based position
_REVERSE = 0x01  # bit of the drive mode
_VOLTAGE_ERROR, _OVERHEATING, _OVERLOAD = 0x01, 0x04, 0x20
_CURRENT_UNIT_A = 0.00269
_VELOCITY_UNIT_RAD_S = 0.229 * math.tau / 60.0
_HOLDING_A, _MOVING_A, _STALL_A = 0.015, 0.25, 4.9  # stall at 12 V: XW540-T260 specification
_CURRENT_NOISE_A, _VOLTAGE_NOISE_V = 0.005, 0.02
_IN_POSITION_COUNTS = 20  # a smaller distance is not a stall
_MIN_INTERVAL_S = 1e-3  # a shorter interval would not distinguish motion from standstill
_STANDSTILL_RAD = 1e-7


class MotorMonitor:
    """Sets the feedback registers of the servo (PRESENT_POSITION and others) and raises hardware errors."""

    def __init__(self, shaft: Shaft, rng: np.random.Generator, table: ControlTable, *, overload_s: float) -> None:
        """Start with the shaft at rest; overload_s is the time of a stall until the overload error."""
        self.voltage_v = 12.0
        self.temperature_c = 25.0
        self.load_a = 0.0  # additional current while the torque is on, as from a shaft with friction
        self._shaft = shaft
        self._rng = rng
        self._table, self._values = table, table.values
        self._overload_s = overload_s
        self.energy_j = 0.0  # used so far; each measured current counts for the time since the previous one
        self._energy_s: float | None = None
        self._observed_s = -math.inf
        self._observed_rad = shaft.angle_rad()
        self._velocity_rad_s = 0.0
        self._stalled_s: float | None = None  # start of a stall

    def restart(self) -> None:
        """Reset as after power-on: released, no errors, goal at the present angle."""
        self._shaft.set_torque(on=False)
        self._table[Address.GOAL_POSITION] = self.position_counts()
        self._observed_s, self._observed_rad = -math.inf, self._shaft.angle_rad()
        self._velocity_rad_s = 0.0
        self._stalled_s = None

    def is_shut_down(self) -> bool:
        """Return whether an error in the Shutdown register has switched the torque off."""
        return bool(self._values[Address.HARDWARE_ERROR] & self._values[Address.SHUTDOWN])

    def raise_error(self, bits: int) -> None:
        """Latch hardware errors until a restart, and switch the torque off for those in the Shutdown register."""
        self._table[Address.HARDWARE_ERROR] |= bits & 0x3F
        if self.is_shut_down():
            self._table[Address.TORQUE] = 0
            self._shaft.set_torque(on=False)

    def set_torque(self, now_s: float, *, on: bool) -> None:
        """Engage or release; an X-series servo sets its goal to the present position when it is engaged."""
        if on:
            self.stop()
        self._shaft.set_torque(on=on)
        self._stalled_s = None
        self._observed_s, self._observed_rad = now_s, self._shaft.angle_rad()

    def stop(self) -> None:
        """Hold the shaft at its present angle, which becomes the goal."""
        self._table[Address.GOAL_POSITION] = self.position_counts()
        self._shaft.set_target(self._shaft.angle_rad())

    def move_to_goal(self) -> None:
        """Move to the goal position, in a position mode with torque on."""
        if self._values[Address.TORQUE] and self._values[Address.OPERATING_MODE] in _POSITION_MODES:
            position_counts = self._values[Address.GOAL_POSITION] - self._homing_offset() - _CENTRE
            self._shaft.set_target(self._sign() * position_counts / _COUNTS_PER_RADIAN)

    def position_counts(self) -> int:
        """Return the present position in encoder counts."""
        return round(self._sign() * self._shaft.angle_rad() * _COUNTS_PER_RADIAN) + _CENTRE + self._homing_offset()

    def is_driving(self) -> bool:
        """Return whether the motor is engaged and not at its goal."""
        is_engaged = self._values[Address.TORQUE] and self._values[Address.OPERATING_MODE] in _POSITION_MODES
        is_tripped = self._values[Address.BUS_WATCHDOG] == WATCHDOG_TRIPPED
        return bool(is_engaged) and not is_tripped and abs(self._distance_counts()) > _IN_POSITION_COUNTS

    def observe(self, now_s: float) -> None:
        """Update the motion since the last call and raise the errors that are due."""
        angle_rad = self._shaft.angle_rad()
        if now_s - self._observed_s >= _MIN_INTERVAL_S:
            displacement_rad = angle_rad - self._observed_rad
            elapsed_s = now_s - self._observed_s
            self._velocity_rad_s = displacement_rad / elapsed_s if math.isfinite(elapsed_s) else 0.0
            is_stalled = self.is_driving() and abs(displacement_rad) < _STANDSTILL_RAD
            if not is_stalled:
                self._stalled_s = None
            elif self._stalled_s is None:
                self._stalled_s = now_s
            self._observed_s, self._observed_rad = now_s, angle_rad
        errors = 0
        if self._stalled_s is not None and now_s - self._stalled_s >= self._overload_s:
            errors |= _OVERLOAD
        if self.temperature_c > self._values[Address.TEMPERATURE_LIMIT]:
            errors |= _OVERHEATING
        if not self._values[Address.MIN_VOLTAGE] <= self.voltage_v * 10.0 <= self._values[Address.MAX_VOLTAGE]:
            errors |= _VOLTAGE_ERROR
        if errors:
            self.raise_error(errors)

    def measure(self, now_s: float) -> None:
        """Set the feedback registers."""
        table, values = self._table, self._values
        velocity = round(self._sign() * self._velocity_rad_s / _VELOCITY_UNIT_RAD_S)
        is_moving = abs(velocity) > values[Address.MOVING_THRESHOLD]
        motor_a = self._current_a(is_moving=is_moving)
        # The velocity is the mean since the last observation, so the power is that of the past interval.
        self.energy_j += 0.0 if self._energy_s is None else abs(motor_a) * self.voltage_v * (now_s - self._energy_s)
        self._energy_s = now_s
        current_a = motor_a + _CURRENT_NOISE_A * self._rng.standard_normal()
        voltage_v = self.voltage_v + _VOLTAGE_NOISE_V * self._rng.standard_normal()
        table[Address.REALTIME_TICK] = int(now_s * 1000.0) % 32_768
        table[Address.MOVING] = int(is_moving)
        position_counts = self.position_counts()
        table[Address.MOVING_STATUS] = int(abs(values[Address.GOAL_POSITION] - position_counts) <= _IN_POSITION_COUNTS)
        table[Address.PRESENT_CURRENT] = round(current_a / _CURRENT_UNIT_A)
        table[Address.PRESENT_VELOCITY] = velocity
        table[Address.PRESENT_POSITION] = position_counts
        table[Address.PRESENT_VOLTAGE] = max(0, round(voltage_v * 10.0))
        table[Address.PRESENT_TEMPERATURE] = round(min(max(self.temperature_c, 0.0), 255.0))

    def _current_a(self, *, is_moving: bool) -> float:
        if not self._values[Address.TORQUE]:
            return 0.0
        if is_moving:
            return math.copysign(_MOVING_A + self.load_a, self._distance_counts())
        if self._stalled_s is None:
            return _HOLDING_A + self.load_a
        limit_a = self._values[Address.CURRENT_LIMIT] * _CURRENT_UNIT_A
        return math.copysign(min(_STALL_A, limit_a), self._distance_counts())

    def _distance_counts(self) -> int:
        return self._values[Address.GOAL_POSITION] - self.position_counts()

    def _sign(self) -> int:
        return -1 if self._values[Address.DRIVE_MODE] & _REVERSE else 1

    def _homing_offset(self) -> int:
        offset = self._values[Address.HOMING_OFFSET]
        is_ignored = self._values[Address.OPERATING_MODE] == POSITION_MODE and abs(offset) > _MAX_HOMING_OFFSET
        return 0 if is_ignored else offset
