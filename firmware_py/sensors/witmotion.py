"""Driver of WitMotion attitude sensors WT901, HWT901 and HWT905 with the maker's standard binary protocol.

Sources: WIT Standard Communication Protocol (wit-motion.gitbook.io), data sheets of WT901 and HWT905; compared with the
maker's wit_c_sdk and with the Signal K plugin signalk-hwt901b-imu, whose heading is 360 degrees minus yaw. A packet is
0x55, type, four numbers of 16 bits (little endian), and the sum of all bytes before modulo 256. A command is FF AA
(hexadecimal), register, value.

The x axis points to the right of the housing, y ahead, z up. Roll, pitch and yaw turn about x, y and z, in the sequence
Z-Y-X from east, north and up: on a level boat, roll of the sensor is the pitch of the boat, pitch its roll, and the
heading is minus yaw.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

from firmware_py.common.angles import degrees, radians
from firmware_py.common.driver import INTERFACE, CaptureFormat, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceHealth, HeadingSample, NorthReference
from firmware_py.sensors.binary_framing import PacketCheck, PacketFramer
from firmware_py.sensors.decode import Result, decode_packets, round_values
from firmware_py.sensors.device_monitor import NO_HEADING_YET
from firmware_py.sensors.message_error import MALFORMED, MessageError, check_range
from firmware_py.sensors.mounting import VERTICAL, Matrix, Mounting, Vector, mounting_option, multiply, rotation
from firmware_py.sensors.packet_receiver import PacketReceiver

COMMAND_INTERVAL_S = 0.1
REPLY_TIMEOUT_S = 0.5
CHECK_INTERVAL_S = 10.0  # between two reads of the registers: a power cut restores stored settings
MAX_RATE_TRIES = 2
DATA_TIMEOUT_S = 2.0  # without a packet, the sensor may have lost power: the set-up starts again
RATE_HOLD_S = 0.1  # maximum age of the angular rate that belongs to an angle

_SIZE = 11
_HEADER = re.compile(rb"\x55[\x50-\x5a\x5f]")
# Takes (right, ahead, up) to (ahead, right, down), and (east, north, up) to (north, east, down); its own inverse.
_EXCHANGE: Matrix = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
# Value of the register RATE by rate in Hz.
_RATE_CODES: Mapping[int, int] = {1: 3, 2: 4, 5: 5, 10: 6, 20: 7, 50: 8, 100: 9, 200: 11}
_RATE_DEG_S, _ANGLE_DEG = 2000.0 / 32768.0, 180.0 / 32768.0  # per unit of the number


class _Type(IntEnum):
    ACCELERATION = 0x51
    ANGULAR_RATE = 0x52
    ANGLE = 0x53
    MAGNETIC_FIELD = 0x54
    REGISTERS = 0x5F


_NAMES = {kind.value: kind.name for kind in _Type}


class _Register(IntEnum):
    SAVE = 0x00
    RATE = 0x03
    SIX_AXES = 0x24
    READ = 0x27
    UNLOCK = 0x69


@dataclass(frozen=True, slots=True)
class WitmotionOptions:
    """Options of the vehicle file for a WitMotion sensor; raises ValueError."""

    algorithm: str = option(
        "read: headings only after the sensor has confirmed its nine-axis algorithm; nine_axis: without asking it",
        default="read",
        choices=("read", "nine_axis"),
    )
    rate_hz: int = option(
        f"headings per second to set in the sensor ({', '.join(map(str, _RATE_CODES))}). 0: leave its setting",
        default=0,
        minimum=0,
        maximum=200,
    )
    save_rate: bool = option(
        "whether to store a changed rate in its flash memory, at most once per start", default=False
    )
    mounting: str = mounting_option()

    def __post_init__(self) -> None:
        """Check the values."""
        check(self)
        if self.rate_hz and self.rate_hz not in _RATE_CODES:
            raise ValueError(
                f"rate_hz: {self.rate_hz} is not supported; use one of 0, {', '.join(map(str, _RATE_CODES))}"
            )


def encode(register: int, value: int) -> bytes:
    """Return the command that writes a register; that of READ requests four registers from `value` on."""
    return b"\xff\xaa" + struct.pack("<BH", register, value)


_UNLOCK = encode(_Register.UNLOCK, 0xB588)  # unlocks the registers for ten seconds


def create_framer() -> PacketFramer:
    """Return a framer for this protocol."""
    return PacketFramer(_HEADER, 2, lambda _header: _SIZE, PacketCheck(_is_checksum_valid))


def _is_checksum_valid(packet: bytes) -> bool:
    return sum(packet[:-1]) & 0xFF == packet[-1]


def read_numbers(packet: bytes) -> tuple[int, int, int, int]:
    """Return the four numbers of a packet."""
    first, second, third, fourth = struct.unpack("<hhhh", packet[2:10])
    return first, second, third, fourth


def read_angles_deg(packet: bytes) -> Vector:
    """Return roll, pitch and yaw of the sensor about its axes, or raise MessageError."""
    roll, pitch, yaw, _version = read_numbers(packet)
    return roll * _ANGLE_DEG, check_range(pitch * _ANGLE_DEG, -90.0, 90.0, "pitch of the sensor"), yaw * _ANGLE_DEG


def ned_from_sensor(angles_deg: Vector) -> Matrix:
    """Return the matrix that takes forward, starboard and down of the sensor to north, east and down."""
    roll_deg, pitch_deg, yaw_deg = angles_deg
    enu_from_sensor = rotation(radians(roll_deg), radians(pitch_deg), radians(yaw_deg))
    return multiply(_EXCHANGE, multiply(enu_from_sensor, _EXCHANGE))


class WitmotionCompass:
    """Reads the angles of the sensor, after it has confirmed that they are referenced to magnetic north.

    With six axes (register SIX_AXES is 1) yaw drifts, so it is no heading: the state is FAULTY, and the samples have
    the reference RELATIVE, of which the estimator uses only the yaw rate. The registers are read at the start, every
    CHECK_INTERVAL_S, and after a silence. The rate is set without being stored, so the flash memory is not worn; it is
    stored only with `save_rate`, if it differs, and once. The checksum is only a sum, so a packet counts only directly
    after another one: two false packets in a row do not occur in noise.
    """

    def __init__(self, line: ByteLine, options: WitmotionOptions) -> None:
        """Store line and options; the first `receive` starts the set-up."""
        self._line = line
        self._options = options
        self._mounting = Mounting(options.mounting)
        self._receiver = PacketReceiver(line, create_framer, 3.0 if options.rate_hz == 1 else DATA_TIMEOUT_S)
        self._is_rate_saved = False  # since the start
        self._is_after_packet = False
        self._packet_s: float | None = None  # time of the last packet
        self._restart(0.0)

    def fileno(self) -> int:
        """Return the descriptor of the line, or -1."""
        return self._line.fileno()

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s; send at most one command."""
        is_silent = self._packet_s is not None and now_s - self._packet_s > DATA_TIMEOUT_S
        if self._receiver.notice_reopening() or is_silent:
            self._restart(now_s)
        for packet in self._receiver.read(now_s):
            if self._is_after_packet and not packet.fault:
                self._packet_s = now_s
                self._handle_packet(packet.data, now_s)
            self._is_after_packet = not packet.fault
        self._continue_set_up(now_s)

    def poll(self) -> Sequence[HeadingSample]:
        """Return the samples since the last poll, oldest first."""
        return self._receiver.poll()

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state; FAULTY while the sensor has no magnetic heading."""
        return self._receiver.monitor.health(now_s, self._fault() or (VERTICAL if self._is_vertical else ""))

    def _fault(self) -> str:
        """Return why the angles are no magnetic heading, empty if they are one."""
        if self._has_nine_axes is False:
            return "six-axis algorithm: no magnetic heading"
        return "" if self._has_field else "no magnetic field measured"

    def _restart(self, now_s: float) -> None:
        self._is_after_packet = False
        self._packet_s = None
        self._has_nine_axes: bool | None = True if self._options.algorithm == "nine_axis" else None  # None: not known
        self._has_field = True
        self._is_vertical = False
        self._rates: tuple[float, Vector | None] = (now_s, None)  # time, rates [rad/s] about forward, starboard, down
        self._temperature_c: float | None = None
        self._commands: list[bytes] = []  # to send next; they have no reply
        self._registers: list[_Register] = []  # to read afterwards
        self._is_read_sent = False
        self._rate_tries = 0
        self._due_s = now_s

    # ------------------------------------------------------------------ set-up

    def _continue_set_up(self, now_s: float) -> None:
        """Send the next command when it is due; a read without a reply is sent again."""
        if now_s < self._due_s or not self._line.connected:
            return
        if self._is_read_sent:
            # No reply. The manual unlocks the registers before a read, the code of the maker does not.
            self._is_read_sent = False
            self._commands = [_UNLOCK]
        if self._commands:
            if self._line.write(self._commands[0]):
                del self._commands[0]
            is_last = not self._commands and not self._registers
            self._due_s = now_s + (CHECK_INTERVAL_S if is_last else COMMAND_INTERVAL_S)
            return
        if not self._registers:
            self._registers = [_Register.SIX_AXES] if self._options.algorithm == "read" else []
            self._registers += [_Register.RATE] if self._options.rate_hz else []
        if self._registers:
            self._is_read_sent = self._line.write(encode(_Register.READ, self._registers[0]))
        self._due_s = now_s + (REPLY_TIMEOUT_S if self._registers else CHECK_INTERVAL_S)

    def _handle_registers(self, first: int, now_s: float) -> None:
        """Process the reply to a read, which does not name the register; `first` is the value of the one read."""
        self._is_read_sent = False
        if self._registers[0] is _Register.SIX_AXES:
            if first not in (0, 1):
                raise MessageError(MALFORMED, f"algorithm {first} is unknown")
            self._has_nine_axes = first == 0
            del self._registers[0]
        else:
            del self._registers[0]
            self._handle_rate(first)
        is_complete = not self._commands and not self._registers
        self._due_s = now_s + (CHECK_INTERVAL_S if is_complete else COMMAND_INTERVAL_S)

    def _handle_rate(self, code: int) -> None:
        """Set the rate and read it again, then store it if the operator wants that."""
        required_code = _RATE_CODES[self._options.rate_hz]
        if code == required_code:
            if self._rate_tries and self._options.save_rate and not self._is_rate_saved:
                self._is_rate_saved = True
                self._commands = [_UNLOCK, encode(_Register.SAVE, 0)]
            self._rate_tries = 0
            self._receiver.monitor.note("")
        elif self._rate_tries < MAX_RATE_TRIES:
            self._rate_tries += 1
            self._commands = [_UNLOCK, encode(_Register.RATE, required_code)]
            self._registers.append(_Register.RATE)
        else:
            self._receiver.monitor.note(f"rate of {self._options.rate_hz} Hz not accepted")

    # ------------------------------------------------------------------ data

    def _handle_packet(self, packet: bytes, now_s: float) -> None:
        monitor = self._receiver.monitor
        monitor.note_unused("algorithm unknown: no answer" if self._has_nine_axes is None else NO_HEADING_YET)
        first, second, third, fourth = read_numbers(packet)
        try:
            if packet[1] == _Type.ANGLE:
                self._handle_angles(read_angles_deg(packet), now_s)
            elif packet[1] == _Type.ANGULAR_RATE:
                self._rates = (now_s, _rates_rad_s(first, second, third))
            elif packet[1] == _Type.ACCELERATION:
                self._temperature_c = _read_temperature_c(fourth)
            elif packet[1] == _Type.MAGNETIC_FIELD:
                self._has_field = (first, second, third) != (0, 0, 0)
            elif packet[1] == _Type.REGISTERS and self._is_read_sent:
                self._handle_registers(first, now_s)
        except MessageError as error:
            monitor.reject(now_s, str(error))

    def _handle_angles(self, angles_deg: Vector, now_s: float) -> None:
        if self._has_nine_axes is None:
            return
        self._receiver.monitor.accept(now_s)
        rates_s, rates_rad_s = self._rates
        is_recent = now_s - rates_s <= RATE_HOLD_S
        boat = self._mounting.boat_attitude(ned_from_sensor(angles_deg), rates_rad_s if is_recent else None)
        self._is_vertical = boat is None
        if boat is None or not self._has_field:
            return
        self._receiver.samples.append(
            HeadingSample(
                t_s=now_s,
                heading_rad=boat.heading_rad,
                reference=NorthReference.MAGNETIC if self._has_nine_axes else NorthReference.RELATIVE,
                yaw_rate_rad_s=boat.yaw_rate_rad_s,
                roll_rad=boat.roll_rad,
                pitch_rad=boat.pitch_rad,
                temperature_c=self._temperature_c,
            )
        )


def _rates_rad_s(about_x: int, about_y: int, about_z: int) -> Vector:
    """Return the rates about forward, starboard and down."""
    return radians(about_y * _RATE_DEG_S), radians(about_x * _RATE_DEG_S), radians(-about_z * _RATE_DEG_S)


def _read_temperature_c(number: int) -> float | None:
    """Return the temperature, None if it is impossible: some models send something else."""
    return number / 100.0 if -40.0 <= number / 100.0 <= 85.0 else None


def _decode_capture(data: bytes) -> Iterator[Result]:
    return decode_packets(data, create_framer(), _decode_packet)


def _decode_packet(packet: bytes) -> Result:
    numbers = read_numbers(packet)
    label = {"packet": _NAMES.get(packet[1], f"{packet[1]:02X}")}
    if packet[1] == _Type.ANGLE:
        roll_deg, pitch_deg, yaw_deg = angles_deg = read_angles_deg(packet)
        boat = Mounting("none").boat_attitude(ned_from_sensor(angles_deg))
        heading_deg = None if boat is None else degrees(boat.heading_rad)
        values = {"heading_magnetic_deg": heading_deg, "x_deg": roll_deg, "y_deg": pitch_deg, "z_deg": yaw_deg}
        return {"type": "heading", **label, **round_values("heading", values)}
    if packet[1] == _Type.ANGULAR_RATE:
        rates = zip(("x_deg_s", "y_deg_s", "z_deg_s"), numbers, strict=False)
        return {"type": "turn_rate", **label, **{name: number * _RATE_DEG_S for name, number in rates}}
    return {"type": "other", **label, "numbers": list(numbers)}


DRIVER = Driver(
    interface=INTERFACE,
    device="WitMotion WT901, HWT901 and HWT905 (binary protocol, nine axes)",
    options=WitmotionOptions,
    make=WitmotionCompass,
    writes=True,
    capture=CaptureFormat("witmotion", _decode_capture),
)
