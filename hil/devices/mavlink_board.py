"""A flight controller with MAVLink on a serial port: heading, position, velocity and battery.

Sources: mavlink.io (common.xml, ardupilotmega.xml); ArduPilot, "Requesting Data From The Autopilot"; PX4, "MAVLink
Peripherals". The frames are those of pymavlink, which the driver does not use.

The errors of the heading are those of a Kalman filter: the gyroscopes remove most of the fast noise of the
magnetometer, and a slow error remains (assumed: a first-order Gauss-Markov process). After power-on the board sends
heartbeats only, until a message is requested; requested intervals are forgotten when the power is cut.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from enum import Enum
from functools import partial
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.devices.emulator import (
    INTERFACE,
    METRES_PER_DEGREE,
    Attitude,
    Device,
    DeviceContext,
    EmulatedDevice,
    Whereabouts,
)
from hil.devices.nmea_gps import Gaps
from hil.devices.timing import Pace, Transmitter
from hil.devices.vedirect import Plant

_REPLY_DELAY_S = 0.005
_PAUSE_S = 0.05  # the rest of an incomplete frame is dropped after such a pause
_POSITION_NOISE_M, _POSITION_NOISE_TIME_S = 1.5, 60.0
VELOCITY_NOISE_M_S = 0.03
_MIN_INTERVAL_S = 0.02
_SATELLITES, _HDOP, _ALTITUDE_M, _ACCURACY_M = 14, 0.8, 2.0, 1.2
_FIXED_BATTERY_V, _FIXED_BATTERY_A, _FIXED_CHARGE = 12.8, -0.4, 0.8  # current into the battery
# Payload bytes without extension fields, which MAVLink 1 does not have but pymavlink would send.
_BASE_BYTES: Mapping[int, int] = {
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 31,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 30,
    dialect.MAVLINK_MSG_ID_COMMAND_ACK: 3,
    dialect.MAVLINK_MSG_ID_BATTERY_STATUS: 36,
    dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 22,
}
_EKF_READY, _EKF_UNINITIALIZED = 0x033F, 0x0400  # EKF_STATUS_FLAGS
# Messages of each data stream.
_GROUPS: Mapping[int, tuple[int, ...]] = {
    dialect.MAV_DATA_STREAM_EXTENDED_STATUS: (dialect.MAVLINK_MSG_ID_SYS_STATUS, dialect.MAVLINK_MSG_ID_GPS_RAW_INT),
    dialect.MAV_DATA_STREAM_POSITION: (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,),
    dialect.MAV_DATA_STREAM_EXTRA1: (dialect.MAVLINK_MSG_ID_ATTITUDE,),
    dialect.MAV_DATA_STREAM_EXTRA3: (
        dialect.MAVLINK_MSG_ID_SYSTEM_TIME,
        dialect.MAVLINK_MSG_ID_BATTERY_STATUS,
        dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    ),
}


class Software(Enum):
    """The software of the board; the older ArduPilot knows REQUEST_DATA_STREAM only."""

    ARDUPILOT = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    OLD_ARDUPILOT = "before 4.0"
    PX4 = dialect.MAV_AUTOPILOT_PX4

    @property
    def autopilot(self) -> int:
        """The value of MAV_AUTOPILOT."""
        return int(dialect.MAV_AUTOPILOT_PX4 if self is Software.PX4 else dialect.MAV_AUTOPILOT_ARDUPILOTMEGA)


class _Receiver:
    """The GNSS receiver of the board; its position error is a first-order Gauss-Markov process."""

    def __init__(self, whereabouts: Whereabouts, rng: np.random.Generator, velocity_noise_m_s: float) -> None:
        self.whereabouts = whereabouts
        self._rng = rng
        self._velocity_noise_m_s = velocity_noise_m_s
        self._time_s = -math.inf
        self._error_m = np.zeros(2)  # north, east

    def measure_position(self, now_s: float) -> tuple[int, int]:
        """Return latitude and longitude in units of 1e-7 degrees."""
        correlation = math.exp((self._time_s - now_s) / _POSITION_NOISE_TIME_S)
        step_m = self._rng.normal(0.0, _POSITION_NOISE_M, 2)
        self._time_s = now_s
        self._error_m = correlation * self._error_m + math.sqrt(1.0 - correlation**2) * step_m
        latitude_deg = self.whereabouts.latitude_deg()
        cos_latitude = max(math.cos(math.radians(latitude_deg)), 1e-3)
        longitude_deg = self.whereabouts.longitude_deg() + self._error_m[1] / (METRES_PER_DEGREE * cos_latitude)
        latitude_deg += self._error_m[0] / METRES_PER_DEGREE
        return round(latitude_deg * 1e7), round(math.remainder(longitude_deg, 360.0) * 1e7)

    def measure_velocity(self) -> tuple[float, float]:
        """Return the velocity north and east in m/s."""
        speed_m_s, course_rad = self.whereabouts.speed_over_ground_m_s(), self.whereabouts.course_over_ground_rad()
        errors = self._rng.normal(0.0, self._velocity_noise_m_s, 2)
        return speed_m_s * math.cos(course_rad) + errors[0], speed_m_s * math.sin(course_rad) + errors[1]


class MavlinkBoardEmulator:
    """A board with its x axis to the bow; its yaw refers to true north.

    May be set at any time: `is_ready` (of the estimator), `test_ratio` (innovation test ratio of the magnetometer),
    `muted` (ids of messages that are not sent), `fix`, `battery` (None: constant), `roll_deg`, `pitch_deg`,
    `second_system` (system id of another autopilot that the board forwards; its heading is wrong), `is_mavlink1`.
    `unexpected` lists the received messages that a sensor board must never be sent. Without `whereabouts` the board has
    no receiver.
    """

    def __init__(
        self,
        attitude: Attitude,
        rng: np.random.Generator,
        *,
        whereabouts: Whereabouts | None = None,
        software: Software = Software.ARDUPILOT,
        system: int = 1,
        noise_deg: float = 0.05,
        slow_error_deg: float = 0.5,
        slow_error_time_s: float = 30.0,
        turn_noise_rad_s: float = 0.001,
        velocity_noise_m_s: float = VELOCITY_NOISE_M_S,
        declination_deg: float = 0.0,
        has_fix: Callable[[float], bool] = lambda _now_s: True,
        phase_s: float = 0.0,
        frequency_error_ppm: float = 0.0,
        boot_s: float = 0.5,
        settle_s: float = 0.5,
        baud: int = 115200,
    ) -> None:
        """Start powered, with its first heartbeat at phase_s and a valid attitude settle_s later.

        `declination_deg` is subtracted from the yaw.
        """
        self.is_ready = True
        self.test_ratio = 0.1
        self.muted: set[int] = set()
        self.fix = True
        self.battery: Plant | None = None
        self.roll_deg, self.pitch_deg = 0.0, 0.0
        self.second_system: int | None = None
        self.is_mavlink1 = False
        self.unexpected: list[str] = []
        self.transmitter = Transmitter(baud)
        self._attitude, self._rng = attitude, rng
        self._software, self._system = software, system
        self._noise_deg, self._turn_noise_rad_s = noise_deg, turn_noise_rad_s
        self._slow_error_deg, self._slow_error_time_s = slow_error_deg, slow_error_time_s
        self._declination_deg, self._has_fix = declination_deg, has_fix
        self._error_ppm, self._boot_s, self._settle_s = frequency_error_ppm, boot_s, settle_s
        self._heading_error = (-math.inf, 0.0)  # time and error [deg]
        self._battery_totals = (0.0, 0.0)  # time and charge [s, C] of the last battery message
        self._builders: dict[int, Callable[[float], Any]] = {
            dialect.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            dialect.MAVLINK_MSG_ID_ATTITUDE: self._attitude_message,
            dialect.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            dialect.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            dialect.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery_status,
        }
        self._receiver: _Receiver | None = None
        if whereabouts is not None:
            self.add_receiver(whereabouts, velocity_noise_m_s)
        if software is Software.PX4:
            self._builders[dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS] = self._estimator_status
        else:
            self._builders[dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT] = self._ekf_status_report
        self._start(0.0, phase_s)

    def add_receiver(self, whereabouts: Whereabouts, velocity_noise_m_s: float = VELOCITY_NOISE_M_S) -> None:
        """Connect a GNSS receiver to the board."""
        self._receiver = receiver = _Receiver(whereabouts, self._rng, velocity_noise_m_s)
        self._builders[dialect.MAVLINK_MSG_ID_GPS_RAW_INT] = partial(self._gps_raw_int, receiver)
        self._builders[dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT] = partial(self._global_position_int, receiver)

    def _start(self, power_s: float, first_s: float) -> None:
        """Set the time of power-on and of the first heartbeat, with no other message requested."""
        self._power_s, self._first_s = power_s, first_s
        self._paces = {
            int(dialect.MAVLINK_MSG_ID_HEARTBEAT): Pace(1.0, start_s=first_s, error_ppm=self._error_ppm),
        }
        self._packer = dialect.MAVLink(None, srcSystem=self._system, srcComponent=1)
        self._parser = _new_parser()
        self._received_s = -math.inf

    def receive(self, now_s: float, data: bytes) -> None:
        """Process requests."""
        if now_s < self._first_s or not data:
            return
        if now_s - self._received_s > _PAUSE_S:
            self._parser = _new_parser()
        self._received_s = now_s
        for message in self._parser.parse_buffer(data) or ():
            if message.get_type() != "BAD_DATA" and not message.get_type().startswith("UNKNOWN"):
                self._handle(message, now_s)

    def next_output_s(self) -> float:
        """Return when the next message is sampled or complete."""
        return min(self.transmitter.next_s(), *(pace.next_s for pace in self._paces.values()))

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete messages."""
        for number, pace in sorted(self._paces.items()):
            for sample_s in pace.take(now_s):
                self._send(number, sample_s)
        return self.transmitter.take(now_s)

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:
        """Interrupt the power for off_s (infinity: until the next call)."""
        self.transmitter.clear()
        self._start(now_s + off_s, now_s + off_s + self._boot_s)

    # ------------------------------------------------------------------ requests

    def _handle(self, message: Any, now_s: float) -> None:
        kind = message.get_type()
        if kind == "COMMAND_LONG" and message.command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
            self._set_interval(message, now_s)
        elif kind == "REQUEST_DATA_STREAM":
            for number in _GROUPS.get(message.req_stream_id, ()):
                self._set_pace(number, 1.0 / max(1, message.req_message_rate), now_s)
        elif kind != "HEARTBEAT" or message.type != dialect.MAV_TYPE_ONBOARD_CONTROLLER:
            self.unexpected.append(kind)

    def _set_interval(self, message: Any, now_s: float) -> None:
        number, result = int(message.param1), dialect.MAV_RESULT_ACCEPTED
        if self._software is Software.OLD_ARDUPILOT:
            result = dialect.MAV_RESULT_UNSUPPORTED
        elif number not in self._builders:
            result = dialect.MAV_RESULT_DENIED
        elif number != dialect.MAVLINK_MSG_ID_HEARTBEAT and message.param2 > 0.0:
            self._set_pace(number, message.param2 * 1e-6, now_s)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        reply = dialect.MAVLink_command_ack_message(message.command, result, 0, 0, *sender)
        self.transmitter.send(now_s + _REPLY_DELAY_S, self._pack(reply))

    def _set_pace(self, number: int, interval_s: float, now_s: float) -> None:
        if number in self._builders:
            interval_s = max(_MIN_INTERVAL_S, interval_s)
            self._paces[number] = Pace(interval_s, start_s=now_s + interval_s, error_ppm=self._error_ppm)

    # ------------------------------------------------------------------ messages

    def _send(self, number: int, now_s: float) -> None:
        if number in self.muted:
            return
        self.transmitter.send(now_s, self._pack(self._builders[number](now_s)))
        if self.second_system is None or number not in (
            dialect.MAVLINK_MSG_ID_HEARTBEAT,
            dialect.MAVLINK_MSG_ID_ATTITUDE,
        ):
            return
        other = dialect.MAVLink(None, srcSystem=self.second_system, srcComponent=1)
        message = self._builders[number](now_s)
        if number == dialect.MAVLINK_MSG_ID_ATTITUDE:
            message.yaw = math.remainder(message.yaw + math.pi / 2, math.tau)
        self.transmitter.send(now_s, bytes(message.pack(other, force_mavlink1=self.is_mavlink1)))

    def _pack(self, message: Any) -> bytes:
        frame = bytes(message.pack(self._packer, force_mavlink1=self.is_mavlink1))
        self._packer.seq = (self._packer.seq + 1) % 256
        return _without_extensions(frame, message) if self.is_mavlink1 else frame

    def _boot_ms(self, now_s: float) -> int:
        return int((now_s - self._power_s) * 1e3) & 0xFFFF_FFFF

    def _heartbeat(self, _now_s: float) -> Any:
        return dialect.MAVLink_heartbeat_message(
            dialect.MAV_TYPE_SURFACE_BOAT, self._software.autopilot, 0, 0, dialect.MAV_STATE_STANDBY, 3
        )

    def _attitude_message(self, now_s: float) -> Any:
        roll_rad, pitch_rad = math.radians(self.roll_deg), math.radians(self.pitch_deg)
        error_deg = self._advance_heading_error(now_s) + self._rng.normal(0.0, self._noise_deg)
        yaw_rad = self._attitude.heading_rad() + math.radians(error_deg - self._declination_deg)
        # A turn about the vertical in the axes of the tilted board.
        rate_rad_s = self._attitude.yaw_rate_rad_s()
        down_in_board = (
            -math.sin(pitch_rad),
            math.cos(pitch_rad) * math.sin(roll_rad),
            math.cos(pitch_rad) * math.cos(roll_rad),
        )
        rates = [rate_rad_s * axis + self._rng.normal(0.0, self._turn_noise_rad_s) for axis in down_in_board]
        yaw_rad = math.remainder(yaw_rad, math.tau)
        return dialect.MAVLink_attitude_message(self._boot_ms(now_s), roll_rad, pitch_rad, yaw_rad, *rates)

    def _advance_heading_error(self, now_s: float) -> float:
        then_s, error_deg = self._heading_error
        correlation = math.exp((then_s - now_s) / self._slow_error_time_s)
        step_deg = self._rng.normal(0.0, self._slow_error_deg)
        self._heading_error = (now_s, correlation * error_deg + math.sqrt(1.0 - correlation**2) * step_deg)
        return self._heading_error[1]

    def _is_settled(self, now_s: float) -> bool:
        return self.is_ready and now_s >= self._first_s + self._settle_s

    def _ekf_status_report(self, now_s: float) -> Any:
        flags = _EKF_READY if self._is_settled(now_s) else _EKF_UNINITIALIZED
        return dialect.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, self.test_ratio, 0.0)

    def _estimator_status(self, now_s: float) -> Any:
        flags = _EKF_READY if self._is_settled(now_s) else 0
        time_us = self._boot_ms(now_s) * 1000
        return dialect.MAVLink_estimator_status_message(
            time_us, flags, 0.1, 0.1, 0.1, self.test_ratio, 0.0, math.nan, 1.0, 1.0
        )

    def _system_time(self, now_s: float) -> Any:
        utc_us = int(self._receiver.whereabouts.utc_s() * 1e6) if self._receiver is not None and self.fix else 0
        return dialect.MAVLink_system_time_message(utc_us, self._boot_ms(now_s))

    def _gps_raw_int(self, receiver: _Receiver, now_s: float) -> Any:
        time_us = self._boot_ms(now_s) * 1000
        if not (self.fix and self._has_fix(now_s)):
            return dialect.MAVLink_gps_raw_int_message(
                time_us, dialect.GPS_FIX_TYPE_NO_FIX, 0, 0, 0, 0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF, 2
            )
        north_m_s, east_m_s = receiver.measure_velocity()
        course_cdeg = round(math.degrees(math.atan2(east_m_s, north_m_s)) * 100.0) % 36000
        return dialect.MAVLink_gps_raw_int_message(
            time_us, dialect.GPS_FIX_TYPE_3D_FIX, *receiver.measure_position(now_s), round(_ALTITUDE_M * 1e3),
            round(_HDOP * 100), 150, round(math.hypot(north_m_s, east_m_s) * 100.0), course_cdeg, _SATELLITES,
            0, round(_ACCURACY_M * 1e3), 2000, 100, 0, 0,
        )  # fmt: skip

    def _global_position_int(self, receiver: _Receiver, now_s: float) -> Any:
        north_cm_s, east_cm_s = (round(value * 100.0) for value in receiver.measure_velocity())
        return dialect.MAVLink_global_position_int_message(
            self._boot_ms(now_s), *receiver.measure_position(now_s), round(_ALTITUDE_M * 1e3), 0, north_cm_s,
            east_cm_s, 0, 0xFFFF,
        )  # fmt: skip

    def _measure_battery(self, now_s: float) -> tuple[int, int, int]:
        """Return voltage [mV], discharge current since the last message [cA] and charge [percent]."""
        if self.battery is None:
            return round(_FIXED_BATTERY_V * 1e3), round(-_FIXED_BATTERY_A * 100.0), round(_FIXED_CHARGE * 100.0)
        self.battery.advance_to(now_s)
        then_s, then_c = self._battery_totals
        charge_c = self.battery.totals.battery_c
        current_a = (charge_c - then_c) / max(1.0, float(int(now_s) - int(then_s)))
        return round(self.battery.voltage_v * 1e3), round(-current_a * 100.0), round(self.battery.charge * 100.0)

    def _sys_status(self, now_s: float) -> Any:
        millivolts, centiamperes, percent = self._measure_battery(now_s)
        return dialect.MAVLink_sys_status_message(0, 0, 0, 120, millivolts, centiamperes, percent, 0, 0, 0, 0, 0, 0)

    def _battery_status(self, now_s: float) -> Any:
        millivolts, centiamperes, percent = self._measure_battery(now_s)
        if self.battery is not None:
            self._battery_totals = (now_s, self.battery.totals.battery_c)
        cells = [millivolts] + [0xFFFF] * 9
        return dialect.MAVLink_battery_status_message(0, 0, 0, 2150, cells, centiamperes, -1, -1, percent)


def _without_extensions(frame: bytes, message: Any) -> bytes:
    """Return a MAVLink 1 frame as an autopilot sends it."""
    size = _BASE_BYTES.get(frame[5], frame[1])
    covered = bytes((size,)) + frame[2 : 6 + size]
    checksum = int(dialect.x25crc(covered + bytes((message.crc_extra,))).crc)
    return frame[:1] + covered + checksum.to_bytes(2, "little")


def _new_parser() -> Any:
    parser = dialect.MAVLink(None)
    parser.robust_parsing = True
    return parser


def _make(context: DeviceContext) -> Device:
    receiver = context.world.disturbances.receiver
    gaps = None if receiver is None else Gaps(receiver.lost, receiver.gap_s, context.gaps)
    return MavlinkBoardEmulator(
        context.world,
        context.rng,
        whereabouts=context.world,
        system=context.options.system or 1,
        velocity_noise_m_s=VELOCITY_NOISE_M_S if receiver is None else receiver.noise_m_s,
        has_fix=(lambda _now_s: True) if gaps is None else lambda now_s: not gaps.is_gap(now_s),
        phase_s=context.phase_s,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(
    interface=INTERFACE, driver="mavlink", baud=115200, make=_make, shared_by=("position", "power")
)
