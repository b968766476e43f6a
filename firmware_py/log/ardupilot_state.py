"""State of the boat as ArduPilot messages at reduced rates, for log viewers. A replay ignores them.

The names, columns and units are those of ArduPilot's rovers (libraries/AP_Logger/LogStructure.h and the structures of
its libraries), for MAVExplorer, UAVLogViewer and pymavlink's tools. An unknown value is NaN; a value that the boat does
not have (engine, height) is 0. Roll and pitch are 0 if the compass does not measure them. Without a heading no attitude
is logged, because UAVLogViewer needs all three angles.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

from firmware_py.common.angles import compass_degrees, degrees, radians, wrap_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.intents import ManualRudder
from firmware_py.common.parameter_row import SINGLE_MAX
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Inputs
from firmware_py.common.reports import Output, Snapshot
from firmware_py.faults.fault import Fault
from firmware_py.log.ardupilot_formats import (
    ARMING,
    ATTITUDE,
    BATTERY,
    CHANNELS,
    COMPASS_ATTITUDE,
    CONTROL,
    ERROR,
    ESTIMATE,
    EVENT,
    INNOVATION_TESTS,
    INPUTS,
    NAVIGATION,
    OUTPUTS,
    PERFORMANCE,
    POSITION,
    RATES,
    RECEIVER,
    STATE,
    STEERING,
    THROTTLE,
    VERSION,
    WATER_SPEED,
)
from firmware_py.log.message_rows import microseconds

FAST_TICKS: Final = 10  # interval of the motion messages
SLOW_TICKS: Final = 100  # interval of the slowly changing messages
_CENTRE_US, _FULL_US = 1500.0, 500.0
_SECONDS_PER_MAH: Final = 3.6
_ATTITUDE_KNOWN, _POSITION_KNOWN = 1, 2 | 16  # EKF solution flags: attitude; horizontal velocity and position
_ROVER: Final = 1  # build type: sets the mode names

# Numbers of ArduPilot's events and error subsystems.
ARMED, DISARMED, HOME_SET, FENCE_ON, FENCE_OFF = 10, 11, 25, 41, 42
_ALL_CHECKS: Final = 1
_BY_MAVLINK: Final = 1
_MAIN_SUBSYSTEM: Final = 1  # MAIN: of faults without a subsystem of their own
_SUBSYSTEMS: Final[Mapping[Fault, int]] = {
    Fault.COMPASS_LOST: 3,  # COMPASS
    Fault.COMPASS_SILENT: 3,
    Fault.COMPASS_FROZEN: 3,
    Fault.COMPASS_JUMPING: 3,
    Fault.BATTERY_LOW: 6,  # FAILSAFE_BATT
    Fault.BATTERY_CRITICAL: 6,
    Fault.STATION_SILENT: 8,  # FAILSAFE_GCS
    Fault.FENCE_BREACHED: 9,  # FAILSAFE_FENCE
    Fault.POSITION_LOST: 11,  # GPS
    Fault.POSITION_JUMPING: 11,
}


def encode_changes(previous: Snapshot | None, boat: Snapshot) -> bytes:
    """Return the messages of changes since the previous tick; with None, at the start of a file, the present state."""
    time_us, parts = microseconds(boat.t_s), []
    if previous is None or previous.armed is not boat.armed:
        armed = int(boat.armed)
        parts.append(ARMING.pack(time_us, armed, _ALL_CHECKS, 0, _BY_MAVLINK))
        parts.append(EVENT.pack(time_us, ARMED if boat.armed else DISARMED))
        parts.append(STATE.pack(time_us, armed, float(armed), armed, 0))
    if boat.home != (None if previous is None else previous.home):
        parts.append(EVENT.pack(time_us, HOME_SET))
    fence_enabled = boat.navigation.fence_enabled
    if fence_enabled is not (previous is not None and previous.navigation.fence_enabled):
        parts.append(EVENT.pack(time_us, FENCE_ON if fence_enabled else FENCE_OFF))
    changed = boat.faults ^ (0 if previous is None else previous.faults)
    if changed:
        parts.extend(
            ERROR.pack(time_us, _SUBSYSTEMS.get(fault, _MAIN_SUBSYSTEM), boat.faults >> fault & 1)
            for fault in Fault
            if changed >> fault & 1
        )
    return b"".join(parts)


class ArduPilotState:
    """Builds the messages of each tick: changes at once, all values at reduced rates and at the start of each file."""

    def __init__(self) -> None:
        """Initialise with no tick logged."""
        self._previous: Snapshot | None = None
        self._deflection: float | None = None  # manual rudder of the last request, None without one
        self._deflection_s = 0.0  # time of that request
        self._fix_s: float | None = None
        self._fix_interval_s: float | None = None  # of the latest fixes; None if it has been logged
        self._used_mah = [0.0, 0.0]  # since the start: battery discharge, servo consumption
        self._late_s = 0.0
        self._skipped = 0

    def encode_tick(
        self, inputs: Inputs, output: Output, parameters: ParameterSet, *, dropped: int, log_all: bool
    ) -> bytes:
        """Return the messages of a tick; with `log_all` all of them, as at the start of a file."""
        boat, previous = output.snapshot, None if log_all else self._previous
        self._previous = boat
        self._late_s = max(self._late_s, _finite_or_zero(boat.late_s))
        has_stick_changed = self._update_stick(inputs)
        self._count_charge(boat)
        parts = [encode_changes(previous, boat)]
        self._update_fix_interval(inputs)
        if self._fix_interval_s is not None and boat.tick % FAST_TICKS == 0:
            parts.append(RECEIVER.pack(microseconds(boat.t_s), 0, int(self._fix_interval_s * 1e3)))
            self._fix_interval_s = None
        if log_all or boat.tick % FAST_TICKS == 0:
            parts += _encode_fast_messages(boat, radians(parameters["RUD_LIMIT_DEG"]))
        if log_all or has_stick_changed or boat.tick % SLOW_TICKS == 0:
            parts.append(self._encode_inputs(boat, parameters["MAN_TIMEOUT_S"]))
        if log_all or boat.tick % SLOW_TICKS == 0:
            parts += [
                *_encode_slow_messages(boat, parameters["CRUISE_SPEED"], self._used_mah),
                self._encode_performance(boat, dropped),
            ]
        return b"".join(parts)

    def _update_fix_interval(self, inputs: Inputs) -> None:
        for fix in inputs.positions:
            if self._fix_s is not None:
                self._fix_interval_s = min(max(0.0, fix.t_s - self._fix_s), 1e6)
            self._fix_s = fix.t_s

    def _update_stick(self, inputs: Inputs) -> bool:
        previous = self._deflection
        for request in inputs.requests:
            if isinstance(request.intent, ManualRudder):
                self._deflection, self._deflection_s = request.intent.deflection, request.t_s
        return self._deflection != previous

    def _count_charge(self, boat: Snapshot) -> None:
        step_s, power, servo = 1.0 / max(boat.rate_hz, 0.1), boat.power, boat.servo
        if power is not None:
            self._used_mah[0] += max(-_finite_or_zero(power.current_a), 0.0) * step_s / _SECONDS_PER_MAH
        if servo is not None:
            self._used_mah[1] += max(_finite_or_zero(servo.current_a), 0.0) * step_s / _SECONDS_PER_MAH

    def _encode_inputs(self, boat: Snapshot, timeout_s: float) -> bytes:
        """Return the manual rudder as a pulse on channel 1, 0 if it has timed out; the other channels are unused."""
        deflection = self._deflection if boat.t_s - self._deflection_s <= timeout_s else None
        pulse_us = 0 if deflection is None else _pulse_us(deflection)
        return INPUTS.pack(microseconds(boat.t_s), pulse_us, *(0,) * (CHANNELS - 1))

    def _encode_performance(self, boat: Snapshot, dropped: int) -> bytes:
        skipped = min(max(boat.skipped_total - self._skipped, 0), 0xFFFF)
        longest_us = int(min(1.0 / max(boat.rate_hz, 0.1) + self._late_s, 4e3) * 1e6)
        self._skipped, self._late_s = boat.skipped_total, 0.0
        return PERFORMANCE.pack(microseconds(boat.t_s), skipped, SLOW_TICKS, longest_us, dropped)


def encode_version(t_s: float, software: str) -> bytes:
    """Return the version message; numbers and git hash are parsed from the name of the software."""
    numbers = re.search(r"(\d+)\.(\d+)\.(\d+)", software)
    commit = re.search(r"\(git ([0-9a-f]{1,8})", software)
    major, minor, patch = (min(int(text), 0xFF) for text in numbers.groups()) if numbers else (0, 0, 0)
    git_hash = int(commit[1], 16) if commit else 0
    return VERSION.pack(microseconds(t_s), 0, major, minor, patch, 0, git_hash, software.encode(), _ROVER)


def _encode_fast_messages(boat: Snapshot, limit_rad: float) -> list[bytes]:
    """Return attitude, position, estimate, rudder and steering."""
    time_us = microseconds(boat.t_s)
    roll_deg, pitch_deg = _degrees_or_zero(boat.roll_rad), _degrees_or_zero(boat.pitch_rad)
    yaw_deg = _compass_or_nan(boat.heading_rad)
    desired_deg = _compass_or_nan(boat.goal_heading_rad)
    parts = []
    if not math.isnan(yaw_deg):
        parts.append(ATTITUDE.pack(time_us, 0.0, roll_deg, 0.0, pitch_deg, desired_deg, yaw_deg, 0))
    fix = _known_position(boat)
    if fix is not None:
        position, altitude_m = fix
        above_m = 0.0 if boat.home is None else altitude_m - _finite_or_zero(boat.home.altitude_m)
        parts.append(POSITION.pack(time_us, *_scale_position(position), altitude_m, above_m, above_m))
    parts.append(_encode_estimate(boat, None if fix is None else fix[0], time_us, roll_deg, pitch_deg))
    deflection = _finite_or_zero(boat.rudder_command_rad) / limit_rad
    parts.append(OUTPUTS.pack(time_us, _pulse_us(deflection), *(0,) * (CHANNELS - 1)))
    speed_m_s, rudder_deg = _water_speed(boat), _degrees_or_nan(boat.rudder_command_rad)
    turn_rad_s = math.nan if boat.yaw_rate_rad_s is None else _single_or_nan(boat.yaw_rate_rad_s)
    turning = (_single_or_nan(speed_m_s * turn_rad_s), _degrees_or_nan(boat.yaw_rate_rad_s))
    parts.append(STEERING.pack(time_us, rudder_deg, _degrees_or_nan(boat.rudder_rad), *turning))
    parts.append(CONTROL.pack(time_us, 0.0, roll_deg, 0.0, pitch_deg, 0.0, rudder_deg, speed_m_s, 1.0))
    parts.append(RATES.pack(time_us, turning[1], 0.0, 0.0, _single_or_nan(deflection), 0.0))
    cross_track_m = boat.navigation.cross_track_m
    target = (_single_or_nan(boat.distance_m), _compass_or_nan(boat.bearing_rad))
    return [*parts, NAVIGATION.pack(time_us, *target, desired_deg, yaw_deg, _single_or_nan(cross_track_m))]


def _encode_estimate(boat: Snapshot, position: Place | None, time_us: int, roll_deg: float, pitch_deg: float) -> bytes:
    """Return the estimate: heading without wave yaw, velocity over ground, offset from home."""
    heading_rad = boat.heading_rad if boat.estimate is None else boat.estimate.heading_rad
    north_m_s = east_m_s = north_m = east_m = math.nan
    water = boat.water
    if water is not None and heading_rad is not None:
        course_rad = heading_rad + water.leeway_rad
        north_m_s = _single_or_nan(water.speed_m_s * math.cos(course_rad) + water.current_north_m_s)
        east_m_s = _single_or_nan(water.speed_m_s * math.sin(course_rad) + water.current_east_m_s)
    if position is not None and boat.home is not None:
        north_m, east_m = map(_single_or_nan, Place(boat.home.latitude_rad, boat.home.longitude_rad).offset_m(position))
    origin_m = math.nan if boat.home is None else _single_or_nan(boat.home.altitude_m)
    motion = (north_m_s, east_m_s, 0.0, 0.0, north_m, east_m, 0.0, origin_m)
    return ESTIMATE.pack(time_us, 0, roll_deg, pitch_deg, _compass_or_nan(heading_rad), *motion)


def _encode_slow_messages(boat: Snapshot, cruise_m_s: float, used_mah: Sequence[float]) -> list[bytes]:
    """Return arming, speed, innovation tests, compass attitude and batteries."""
    time_us, armed = microseconds(boat.t_s), int(boat.armed)
    parts = [STATE.pack(time_us, armed, float(armed), armed, 0)]
    speed_m_s = _water_speed(boat)
    parts.append(THROTTLE.pack(time_us, 0.0, 0.0, cruise_m_s, speed_m_s))
    parts.append(WATER_SPEED.pack(time_us, 0, speed_m_s))
    parts += _encode_innovation_tests(boat, time_us)
    power, servo = boat.power, boat.servo
    if power is not None and power.voltage_v is not None:
        out_a = None if power.current_a is None else -power.current_a
        rest = (power.temperature_c, None if power.charge is None else 100.0 * power.charge)
        parts.append(_encode_battery(time_us, 0, power.voltage_v, out_a, used_mah[0], rest))
    if servo is not None and servo.voltage_v is not None:
        parts.append(
            _encode_battery(time_us, 1, servo.voltage_v, servo.current_a, used_mah[1], (servo.temperature_c, None))
        )
    return parts


def _encode_innovation_tests(boat: Snapshot, time_us: int) -> list[bytes]:
    """Return the innovation test ratio of the heading, the solution flags and the compass attitude as measured."""
    parts = []
    if boat.estimate is not None:
        solution = _ATTITUDE_KNOWN | (_POSITION_KNOWN if boat.position_ok else 0)
        ratio = _single_or_nan(math.sqrt(max(_finite_or_zero(boat.estimate.innovation_square), 0.0)))
        parts.append(
            INNOVATION_TESTS.pack(time_us, 0, 0.0, 0.0, 0.0, ratio, 0.0, solution, int(not boat.position_ok), 0)
        )
    fix = _known_position(boat)
    if fix is not None and boat.heading_rad is not None:
        position, altitude_m = fix
        attitude_deg = (*map(_degrees_or_zero, (boat.roll_rad, boat.pitch_rad)), _compass_or_nan(boat.heading_rad))
        parts.append(COMPASS_ATTITUDE.pack(time_us, *attitude_deg, altitude_m, *_scale_position(position)))
    return parts


def _encode_battery(
    time_us: int,
    number: int,
    voltage_v: float,
    current_a: float | None,
    used_mah: float,
    rest: tuple[float | None, float | None],
) -> bytes:
    """Return a battery: number 0 is the boat's, 1 the supply of the servo. `rest` is temperature and charge in percent.

    The resting voltage equals the measured one, as in ArduPilot if the internal resistance is unknown.
    """
    voltage_v = _single_or_nan(voltage_v)
    return BATTERY.pack(
        time_us, number, voltage_v, voltage_v, _single_or_nan(current_a), used_mah, *map(_single_or_nan, rest)
    )


def _known_position(boat: Snapshot) -> tuple[Place, float] | None:
    """Return the position and the altitude of a fresh fix; 0 for an unknown altitude."""
    fix = boat.position if boat.position_ok else None
    if fix is None or fix.latitude_rad is None or fix.longitude_rad is None:
        return None
    return Place(fix.latitude_rad, fix.longitude_rad), _finite_or_zero(fix.altitude_m)


def _scale_position(position: Place) -> tuple[int, int]:
    north, east = (round(degrees(wrap_pi(angle)) * 1e7) for angle in (position.latitude_rad, position.longitude_rad))
    return north, east


def _water_speed(boat: Snapshot) -> float:
    return math.nan if boat.water is None else _single_or_nan(boat.water.speed_m_s)


def _pulse_us(deflection: float) -> int:
    return round(_CENTRE_US + _FULL_US * min(max(deflection, -1.0), 1.0))


def _single_or_nan(value: float | None) -> float:
    """Return a number that fits in single precision; NaN for others and for None."""
    return math.nan if value is None or not abs(value) <= SINGLE_MAX else value


def _finite_or_zero(value: float | None) -> float:
    number = _single_or_nan(value)
    return 0.0 if math.isnan(number) else number


def _degrees_or_nan(angle_rad: float | None) -> float:
    return math.nan if angle_rad is None else _single_or_nan(degrees(angle_rad))


def _degrees_or_zero(angle_rad: float | None) -> float:
    return 0.0 if angle_rad is None else _finite_or_zero(degrees(angle_rad))


def _compass_or_nan(angle_rad: float | None) -> float:
    return math.nan if angle_rad is None or not math.isfinite(angle_rad) else compass_degrees(angle_rad)
