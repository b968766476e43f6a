"""Driver of digital compasses of RION and BWSENSING with their common serial protocol.

Sources: RION HCM370B and HCM705B user manuals and the data sheet of the HCM605B (frame of 14 bytes with a status);
BWSENSING BMR3000 technical manual. A frame is identifier (hexadecimal 68 RION, 77 BWSENSING), length from itself to the
checksum, address, command (in a reply plus 0x80), data, and the sum of the bytes after the identifier modulo 256. An
angle has three bytes: a nibble with the sign (0 or 1) and five decimal digits in hundredths of a degree.

The manuals name pitch, roll and a heading from 0 to 360 degrees, but do not state the direction of positive pitch and
roll, nor the sequence of the angles. The driver assumes bow up, starboard side down, and heading, pitch, roll.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum

import msgspec

from firmware_py.common.angles import radians
from firmware_py.common.driver import INTERFACE, CaptureFormat, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceHealth, HeadingSample, NorthReference
from firmware_py.sensors.binary_framing import PacketCheck, PacketFramer
from firmware_py.sensors.decode import Result, decode_packets, round_values
from firmware_py.sensors.device_monitor import NO_HEADING_YET, SILENT_AFTER_S
from firmware_py.sensors.message_error import MALFORMED, MessageError, check_range
from firmware_py.sensors.mounting import VERTICAL, Mounting, mounting_option, rotation
from firmware_py.sensors.packet_receiver import PacketReceiver

LISTEN_S = 0.5  # before the first request; automatic output has at least 5 Hz
REPLY_TIMEOUT_S = 0.3
DATA_TIMEOUT_S = 1.5  # a device that sends by itself is polled again after this time without angles
MAX_DECLINATION_REQUESTS = 3  # a device without a reply to them is assumed to have none
MAX_MISSING_REPLIES = 6  # consecutive; then the driver listens and tries both identifiers again
# Number of angles without a request, each at most this time after the previous one, that show automatic output.
_MIN_UNREQUESTED, _UNREQUESTED_MEMORY_S = 3, 2.5

_IDENTIFIERS = {"auto": (0x68, 0x77), "68": (0x68,), "77": (0x77,)}
# Angles without and with status, declination, results of settings; all from any address.
_HEADER = re.compile(rb"[\x68\x77](?:[\x0d\x0e][\x00-\xff]\x84|\x06[\x00-\xff]\x87|\x05[\x00-\xff][\x85-\xd0])")
_REPLY = 0x80  # bit of the command in a reply
_LENGTH_WITH_STATUS = 0x0E
# Bits of the status.
_FIELD_DISTORTED, _GYROSCOPE_CLIPPED = 1 << 0, 1 << 3


class _Command(IntEnum):
    READ_ANGLES = 0x04
    READ_DECLINATION = 0x07


@dataclass(frozen=True, slots=True)
class RionOptions:
    """Options of the vehicle file for a RION or BWSENSING compass; raises ValueError."""

    identifier: str = option(
        "first byte of a frame: 68 for RION, 77 for BWSENSING, auto for that of the compass",
        default="auto",
        choices=tuple(_IDENTIFIERS),
    )
    address: int = option("address of the compass", default=0, minimum=0, maximum=239)
    rate_hz: float = option(
        "headings per second that are requested; a compass that sends by itself is only read",
        default=10.0,
        minimum=0.5,
        maximum=20.0,
    )
    mounting: str = mounting_option()

    def __post_init__(self) -> None:
        """Check the values."""
        check(self)


class Reading(msgspec.Struct, frozen=True):
    """The angles of a frame; `status` is None in the frames of most models."""

    heading_deg: float
    pitch_deg: float
    roll_deg: float
    status: int | None

    @property
    def fault(self) -> str:
        """The fault that the compass reports, empty for none."""
        if self.status is None:
            return ""
        if self.status & _GYROSCOPE_CLIPPED:
            return "gyroscope out of range"
        return "magnetic field distorted" if self.status & _FIELD_DISTORTED else ""

    @property
    def is_valid(self) -> bool:
        """Whether the angles may be used: the data sheet calls them unavailable if the gyroscope is out of range."""
        return self.status is None or not self.status & _GYROSCOPE_CLIPPED


def encode(identifier: int, address: int, command: int) -> bytes:
    """Return a command without data."""
    body = bytes((4, address, command))
    return bytes((identifier, *body, sum(body) & 0xFF))


def create_framer() -> PacketFramer:
    """Return a framer for this protocol."""
    return PacketFramer(_HEADER, 4, lambda header: header[1] + 1, PacketCheck(_is_checksum_valid))


def _is_checksum_valid(packet: bytes) -> bool:
    return sum(packet[1:-1]) & 0xFF == packet[-1]


def read_angles(packet: bytes) -> Reading:
    """Return the angles of a frame, or raise MessageError."""
    pitch_deg = check_range(_read_decimal(packet[4:7], "pitch") / 100.0, -90.0, 90.0, "pitch")
    roll_deg = check_range(_read_decimal(packet[7:10], "roll") / 100.0, -180.0, 180.0, "roll")
    heading_deg = check_range(_read_decimal(packet[10:13], "heading") / 100.0, 0.0, 360.0, "heading")
    return Reading(heading_deg, pitch_deg, roll_deg, packet[13] if packet[1] == _LENGTH_WITH_STATUS else None)


def read_declination_deg(packet: bytes) -> float:
    """Return the declination that is set in the compass, east positive, or raise MessageError."""
    return check_range(_read_decimal(packet[4:6], "declination") / 10.0, -90.0, 90.0, "declination")


def _read_decimal(data: bytes, name: str) -> int:
    """Return a number in binary-coded decimal, whose first digit is the sign."""
    digits = data.hex()
    if not digits.isdecimal() or digits[0] > "1":
        raise MessageError(MALFORMED, f"{name} is not a decimal number")
    return -int(digits[1:]) if digits[0] == "1" else int(digits)


class RionCompass:
    """Requests the angles, or reads them if the device sends by itself; it changes no setting of the device.

    The first angles show the identifier and that the device is there. Its declination is then read once, before the
    first heading: if it is not zero, the device adds it, so its headings are true.
    """

    def __init__(self, line: ByteLine, options: RionOptions) -> None:
        """Store line and options; the first `receive` sends a request."""
        self._line = line
        self._options = options
        self._period_s = 1.0 / options.rate_hz
        self._mounting = Mounting(options.mounting)
        self._receiver = PacketReceiver(line, create_framer, max(SILENT_AFTER_S, 3.0 / options.rate_hz))
        self._restart(0.0)

    def fileno(self) -> int:
        """Return the descriptor of the line, or -1."""
        return self._line.fileno()

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s; send at most one request."""
        if self._receiver.notice_reopening():
            self._restart(now_s)
        for packet in self._receiver.read(now_s):
            if not packet.fault:
                self._handle_packet(packet.data, now_s)
        self._continue_requests(now_s)

    def poll(self) -> Sequence[HeadingSample]:
        """Return the samples since the last poll, oldest first."""
        return self._receiver.poll()

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state; FAULTY while the compass reports a fault."""
        return self._receiver.monitor.health(now_s, self._fault)

    def _restart(self, now_s: float) -> None:
        self._fault = ""
        self._identifier: int | None = None  # of the device
        self._declination_deg: float | None = None  # that the device adds
        self._declination_requests = 0
        self._request: _Command | None = None  # without a reply so far
        self._missing_replies = 0
        self._is_listening = True  # until the first request; angles then show automatic output
        self._unrequested = 0  # number of successive angles without a request
        self._unrequested_s = now_s  # time of the last one
        self._due_s = now_s + LISTEN_S  # time of the next request

    def _continue_requests(self, now_s: float) -> None:
        """Send the next request when it is due."""
        if now_s < self._due_s or not self._line.connected:
            return
        if self._request is not None:
            self._missing_replies += 1
            if self._missing_replies == MAX_MISSING_REPLIES:
                self._restart(now_s)
                return
        command = _Command.READ_ANGLES
        if self._identifier is not None and self._needs_declination():
            command = _Command.READ_DECLINATION
            self._declination_requests += 1
        elif self._unrequested >= _MIN_UNREQUESTED:
            if now_s - self._unrequested_s < DATA_TIMEOUT_S:
                self._expect_output()
                return
            self._unrequested = 0  # the automatic output has ended
        identifiers = _IDENTIFIERS[self._options.identifier]
        identifier = self._identifier or identifiers[self._missing_replies % len(identifiers)]
        if self._line.write(encode(identifier, self._options.address, command)):
            self._request = command
            self._sent_s = now_s
            self._is_listening = False
        self._due_s = now_s + REPLY_TIMEOUT_S

    def _needs_declination(self) -> bool:
        return self._declination_deg is None and self._declination_requests < MAX_DECLINATION_REQUESTS

    def _handle_packet(self, packet: bytes, now_s: float) -> None:
        monitor = self._receiver.monitor
        monitor.note_unused(NO_HEADING_YET)
        if packet[0] not in _IDENTIFIERS[self._options.identifier] or packet[2] != self._options.address:
            monitor.note_unused(f"compass {packet[0]:02X} with address {packet[2]}: not that of the vehicle file")
            return
        try:
            if packet[3] == _Command.READ_ANGLES | _REPLY:
                self._handle_reading(read_angles(packet), packet[0], now_s)
            elif packet[3] == _Command.READ_DECLINATION | _REPLY:
                self._declination_deg = read_declination_deg(packet)
                if self._request is _Command.READ_DECLINATION:
                    self._note_reply(now_s, now_s)
        except MessageError as error:
            monitor.reject(now_s, str(error))

    def _note_reply(self, now_s: float, due_s: float) -> None:
        """End the pending request; the next one is due at due_s, or at now_s if that is later."""
        self._request = None
        self._missing_replies = 0
        self._due_s = max(now_s, due_s)

    def _handle_reading(self, reading: Reading, identifier: int, now_s: float) -> None:
        self._identifier = identifier
        self._schedule_request(now_s)
        if self._needs_declination():
            return
        self._receiver.monitor.accept(now_s)
        ned_from_sensor = rotation(radians(reading.roll_deg), radians(reading.pitch_deg), radians(reading.heading_deg))
        boat = self._mounting.boat_attitude(ned_from_sensor)
        self._fault = reading.fault or ("" if boat is not None else VERTICAL)
        if boat is None or not reading.is_valid:
            return
        declination_deg = self._declination_deg or 0.0
        self._receiver.samples.append(
            HeadingSample(
                t_s=now_s,
                heading_rad=boat.heading_rad,
                reference=NorthReference.TRUE if declination_deg else NorthReference.MAGNETIC,
                variation_rad=radians(declination_deg) if declination_deg else None,
                roll_rad=boat.roll_rad,
                pitch_rad=boat.pitch_rad,
            )
        )

    def _schedule_request(self, now_s: float) -> None:
        """Set the time of the next request after an angle that was requested, or that the device sent by itself."""
        if self._request is _Command.READ_ANGLES:
            self._note_reply(now_s, now_s if self._needs_declination() else self._sent_s + self._period_s)
            return
        is_recent = now_s - self._unrequested_s <= _UNREQUESTED_MEMORY_S
        previous = self._unrequested if is_recent else 0
        self._unrequested = _MIN_UNREQUESTED if self._is_listening else previous + 1
        self._unrequested_s = now_s
        if self._unrequested >= _MIN_UNREQUESTED and not self._needs_declination():
            self._expect_output()

    def _expect_output(self) -> None:
        """Send no request while the automatic output continues."""
        self._note_reply(self._unrequested_s, self._unrequested_s + DATA_TIMEOUT_S)


def _decode_capture(data: bytes) -> Iterator[Result]:
    return decode_packets(data, create_framer(), _decode_packet)


def _decode_packet(packet: bytes) -> Result:
    frame = {"identifier": f"{packet[0]:02X}", "address": packet[2], "command": f"{packet[3]:02X}"}
    if packet[3] == _Command.READ_DECLINATION | _REPLY:
        return {"type": "other", **frame, "declination_deg": read_declination_deg(packet)}
    if packet[3] != _Command.READ_ANGLES | _REPLY:
        return {"type": "other", **frame, "result": packet[4]}
    reading = read_angles(packet)
    values = {"heading_magnetic_deg": reading.heading_deg, "pitch_deg": reading.pitch_deg, "roll_deg": reading.roll_deg}
    status = {} if reading.status is None else {"status": f"{reading.status:02X}"}
    return {"type": "heading", **frame, **round_values("heading", values), **status}


DRIVER = Driver(
    interface=INTERFACE,
    device="RION and BWSENSING digital compasses (HCM, DCM, DDM, BMR3000)",
    options=RionOptions,
    make=RionCompass,
    writes=True,
    capture=CaptureFormat("rion", _decode_capture),
)
