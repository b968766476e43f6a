"""Driver of a BNO080, BNO085 or BNO086 (CEVA, Hillcrest) in its mode UART-RVC: a gyroscope without north reference.

Source: BNO080 data sheet 1000-3927 (October 2017), sections 1.1.4 and 1.3.5. After power-on the device sends 100 frames
a second, without commands:

    AA AA | index | yaw, pitch, roll [0.01 deg] | accelerations x, y, z [mg] | 3 reserved bytes | sum

The numbers are signed 16-bit integers, little endian. The sum of the 16 bytes before it is only 8 bits long, so the
ranges are checked as well. Later firmware uses two of the reserved bytes, so they may have any value.

* Yaw is "the rotation around the Z axis since reset": it starts at 0 and drifts. No document describes a correction by
  the magnetometer in this mode, and users report none (sparkfun/SparkFun_BNO080_Arduino_Library, issue 77). On a boat
  the same sensor drifted by up to 30 degrees a minute after an hour (jps2000/BNO080, issue 8). So the yaw is used as a
  yaw rate only, never as a heading.
* The data sheet does not state the direction of yaw. Projects for vehicles use it as clockwise (autorope/donkeycar,
  issue 1246; AgOpenGPS, which negates the yaw of the same device in its other modes). The estimator compares it with
  the compass (estimate/gyro.py) and reports a wrong direction; the option `clockwise` reverses it.
* Roll and pitch are not used: the example of the data sheet contradicts its text. Its "roll" of 20.85 degrees belongs
  to an acceleration along x, which is a rotation around y.

There is no option `mounting`: yaw is the direction of an axis of the device projected on the horizontal plane. Its rate
is that of the boat if the device lies flat, with the label up or down and in any direction. It must not stand on edge.
"""

from __future__ import annotations

import re
import struct
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec

from firmware_py.common.angles import radians, wrap_pi, wrap_two_pi
from firmware_py.common.driver import INTERFACE, CaptureFormat, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceHealth, HeadingSample, NorthReference
from firmware_py.sensors.binary_framing import PacketCheck, PacketFramer
from firmware_py.sensors.decode import Result, decode_packets, round_values
from firmware_py.sensors.message_error import MessageError, check_range
from firmware_py.sensors.packet_receiver import PacketReceiver

GYRO_ONLY: Final = "gyro only, no north: used as yaw rate"
FRAME_RATE_HZ: Final = 100
FRAME_BYTES: Final = 19
RATE_PERIODS: Final = 5  # of frames, per yaw rate; its resolution is 0.01 deg in 50 ms, or 0.2 deg/s
MAX_LOST_FRAMES: Final = 10
MAX_GAP_S: Final = 0.25  # without frames on the line; a device that restarts is silent for longer
MAX_YAW_RATE_DEG_S: Final = 150.0  # a breaking wave turns a boat at 90 deg/s; a restart changes the yaw at once
MAX_PITCH_DEG: Final = 80.0  # near 90 degrees, yaw and roll turn about the same axis

_HEADER = re.compile(rb"\xaa\xaa")
_CONTENT = struct.Struct("<Bhhhhhh")


@dataclass(frozen=True, slots=True)
class Bno08xRvcOptions:
    """Options of the vehicle file for a BNO08x in UART-RVC mode; raises ValueError."""

    rate_hz: float = option(
        "yaw rates per second, at most one in a tick; the device sends 100 frames", default=10.0, minimum=1, maximum=100
    )
    clockwise: bool = option("whether its yaw increases in a turn to starboard", default=True)

    def __post_init__(self) -> None:
        """Check the range."""
        check(self)


class Reading(msgspec.Struct, frozen=True):
    """The values of a frame, with the names and directions of the data sheet; `index` counts frames modulo 256."""

    index: int
    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    acceleration_mg: tuple[int, int, int]


def create_framer() -> PacketFramer:
    """Return a framer for this protocol."""
    return PacketFramer(_HEADER, 2, lambda _header: FRAME_BYTES, PacketCheck(_has_valid_sum))


def _has_valid_sum(frame: bytes) -> bool:
    return sum(frame[2:-1]) & 0xFF == frame[-1]


def read_frame(frame: bytes) -> Reading:
    """Return the values of a complete frame, or raise MessageError."""
    index, yaw, pitch, roll, *acceleration_mg = _CONTENT.unpack_from(frame, 2)
    check_range(0.01 * yaw, -180.0, 180.0, "yaw")
    check_range(0.01 * pitch, -90.0, 90.0, "pitch")
    check_range(0.01 * roll, -180.0, 180.0, "roll")
    x_mg, y_mg, z_mg = acceleration_mg
    return Reading(index, 0.01 * yaw, 0.01 * pitch, 0.01 * roll, (x_mg, y_mg, z_mg))


class Bno08xRvc:
    """Measures the yaw rate from the yaw of successive frames; the index of the frames shows lost ones.

    A sample has the reference RELATIVE: its heading is the angle turned since the start. It is made from the newest
    frame, so it is at most one frame period old. After a gap, a restart of the device, an impossible turn or a nearly
    vertical position the measurement starts again with the next frame, without a change of that angle.
    """

    def __init__(self, line: ByteLine, options: Bno08xRvcOptions) -> None:
        """Store line and options."""
        self._line = line
        self._frames_per_sample = round(FRAME_RATE_HZ / options.rate_hz)
        self._sign = 1.0 if options.clockwise else -1.0
        self._receiver = PacketReceiver(line, create_framer)
        self._monitor = self._receiver.monitor
        self._previous: tuple[Reading, float] | None = None  # the previous values and their arrival time
        self._received_s = 0.0  # time of the previous `receive`, with or without bytes
        self._number = 0  # of the last frame, counted with the lost ones
        self._turned_rad = 0.0  # since the start, clockwise positive
        self._history: deque[tuple[int, float]] = deque(maxlen=RATE_PERIODS + 1)  # frame number, angle turned
        self._due_number = 0  # of the frame from which the next sample is due

    def fileno(self) -> int:
        """Return the descriptor of the line, or -1."""
        return self._line.fileno()

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s."""
        if self._receiver.notice_reopening():
            self._previous = None
        for packet in self._receiver.read(now_s):
            if not packet.fault:
                self._handle_frame(packet.data, now_s)
        self._received_s = now_s
        self._append_sample(now_s)

    def poll(self) -> Sequence[HeadingSample]:
        """Return the samples since the last poll, oldest first."""
        return self._receiver.poll()

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state; its text says that the device has no north."""
        return self._monitor.health(now_s)

    def _handle_frame(self, frame: bytes, now_s: float) -> None:
        try:
            reading = read_frame(frame)
        except MessageError as error:
            self._monitor.reject(now_s, str(error))
            return
        self._monitor.accept(now_s)
        is_vertical = abs(reading.pitch_deg) > MAX_PITCH_DEG
        self._monitor.note("nearly vertical: no yaw rate" if is_vertical else GYRO_ONLY)
        if is_vertical:
            self._previous = None
        elif not self._continue_turn(reading, now_s):
            self._history.clear()
            self._history.append((self._number, self._turned_rad))
        if not is_vertical:
            self._previous = (reading, now_s)

    def _continue_turn(self, reading: Reading, now_s: float) -> bool:
        """Add the turn since the previous frame; return False if this frame does not continue the measurement."""
        if self._previous is None:
            return False
        previous, previous_s = self._previous
        periods = (reading.index - previous.index) & 0xFF
        turned_rad = wrap_pi(radians(reading.yaw_deg - previous.yaw_deg))
        max_turn_rad = radians(MAX_YAW_RATE_DEG_S * periods / FRAME_RATE_HZ)
        # Frames that wait until the line is read are no gap.
        is_next = 1 <= periods <= 1 + MAX_LOST_FRAMES and self._received_s - previous_s <= MAX_GAP_S
        if not (is_next and abs(turned_rad) <= max_turn_rad):
            self._monitor.reject(now_s, "restarted, or frames lost: yaw rate starts again")
            return False
        if periods > 1:
            self._monitor.reject(now_s, f"lost frames: {periods - 1}", periods - 1)
        self._number += periods
        self._turned_rad += self._sign * turned_rad
        self._history.append((self._number, self._turned_rad))
        return True

    def _append_sample(self, now_s: float) -> None:
        """Append a sample if it is due and the history is complete."""
        first_number, first_rad = self._history[0] if self._history else (self._number, 0.0)
        periods = self._number - first_number
        interval = self._frames_per_sample
        tolerance = interval // 5  # the number of frames that arrive in a tick varies; a sample may be early by this
        if periods < RATE_PERIODS or self._number < self._due_number - tolerance:
            return
        self._due_number = max(self._due_number + interval, self._number + interval - tolerance)
        self._receiver.samples.append(
            HeadingSample(
                t_s=now_s,
                heading_rad=wrap_two_pi(self._turned_rad),
                reference=NorthReference.RELATIVE,
                yaw_rate_rad_s=(self._turned_rad - first_rad) * FRAME_RATE_HZ / periods,
            )
        )


def _decode_capture(data: bytes) -> Iterator[Result]:
    return decode_packets(data, create_framer(), _decode_frame)


def _decode_frame(frame: bytes) -> Result:
    values = msgspec.structs.asdict(read_frame(frame))
    x_mg, y_mg, z_mg = values.pop("acceleration_mg")
    values |= {"acceleration_x_mg": x_mg, "acceleration_y_mg": y_mg, "acceleration_z_mg": z_mg}
    return {"type": "attitude", "reference": "relative", **round_values("attitude", values)}


DRIVER = Driver(
    interface=INTERFACE,
    device="BNO080, BNO085, BNO086 in UART-RVC mode: gyroscope without north",
    options=Bno08xRvcOptions,
    make=Bno08xRvc,
    has_north=False,
    capture=CaptureFormat("bno08x_rvc", _decode_capture),
)
