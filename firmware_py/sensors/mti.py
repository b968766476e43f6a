"""Drives an Xsens (Movella) MTi attitude and heading reference over its binary protocol Xbus."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceHealth, DeviceRole, HeadingSample, NorthReference
from firmware_py.sensors import mti_protocol as xbus
from firmware_py.sensors.binary_framing import Packet
from firmware_py.sensors.device_monitor import NO_HEADING_YET, SILENT_AFTER_S, DeviceMonitor
from firmware_py.sensors.message_error import CHECKSUM, MessageError
from firmware_py.sensors.mti_protocol import EACH_MESSAGE, DataId, Frame, Message
from firmware_py.sensors.mti_reading import Reading, read_data

ANSWER_S = 0.5  # for a command's acknowledgement, then the set-up begins anew
PATIENCE_S = 1.0  # without an orientation, or after a refusal, for this long the device is set up again
WAKE_UP_S = 0.05  # between the answer to a wake-up and the first command
SAMPLES_KEPT = 512

_EULER_ANGLES_NED = DataId.EULER_ANGLES | Frame.NED


@dataclass(frozen=True, slots=True)
class MtiOptions:
    """What the vehicle file may say of an MTi; ValueError for what the protocol cannot state."""

    # The protocol has whole numbers, the smallest models give 100 a second.
    rate_hz: int = option("headings a second, a whole number", default=10, minimum=1, maximum=100)

    def __post_init__(self) -> None:
        """Check the range."""
        check(self)


class _Step(IntEnum):
    """What is asked of the device next; each waits for its acknowledgement."""

    GO_TO_CONFIG = 0
    ASK_OUTPUT = 1
    SET_OUTPUT = 2  # left out when the device has it already: the list goes to a memory that wears
    GO_TO_MEASUREMENT = 3
    MEASURING = 4


_ACKNOWLEDGEMENTS = {
    _Step.GO_TO_CONFIG: Message.GO_TO_CONFIG_ACK,
    _Step.ASK_OUTPUT: Message.OUTPUT_CONFIGURATION_ACK,
    _Step.SET_OUTPUT: Message.OUTPUT_CONFIGURATION_ACK,
    _Step.GO_TO_MEASUREMENT: Message.GO_TO_MEASUREMENT_ACK,
}


def wanted_output(rate_hz: int) -> dict[int, int]:
    """The output configuration of a compass: {data identifier: rate in Hz}."""
    return {
        int(DataId.STATUS_WORD): EACH_MESSAGE,
        _EULER_ANGLES_NED: rate_hz,
        int(DataId.RATE_OF_TURN): rate_hz,
        int(DataId.TEMPERATURE): 1,
    }


class MtiCompass:
    """Sets the device up, gives the headings it stands by, and sets it up again when they stop.

    The device is asked for Euler angles in the frame NED, where yaw is the heading,
    clockwise from north. North is magnetic north, where the manual says no more than
    "local magnetic north"; whether a model with a satellite receiver corrects for the
    declination itself it leaves open, so compare one with a known bearing, and if it
    does, set CMP_DECL_AUTO = 0 and CMP_DECL_DEG = 0. A message whose status says that
    the orientation is not valid gives no heading.

    Commands are sent one at a time, each after the acknowledgement of the one before; a
    device that does not answer hears one every half second, one that refuses is asked
    again after a second. A device that says that it has woken up is set up at once.
    """

    def __init__(self, line: ByteLine, options: MtiOptions) -> None:
        """Set the device up with the first `receive`."""
        self._line = line
        self._wanted = wanted_output(options.rate_hz)
        self._patience_s = max(PATIENCE_S, 3.0 / options.rate_hz)
        self._monitor = DeviceMonitor(line, DeviceRole.COMPASS, max(SILENT_AFTER_S, 3.0 / options.rate_hz))
        self._framer = xbus.framer()
        self._samples: deque[HeadingSample] = deque(maxlen=SAMPLES_KEPT)
        self._commands = {
            _Step.GO_TO_CONFIG: xbus.encode(Message.GO_TO_CONFIG),
            _Step.ASK_OUTPUT: xbus.encode(Message.OUTPUT_CONFIGURATION),
            _Step.SET_OUTPUT: xbus.encode(
                Message.OUTPUT_CONFIGURATION, xbus.output_configuration(self._wanted.items())
            ),
            _Step.GO_TO_MEASUREMENT: xbus.encode(Message.GO_TO_MEASUREMENT),
        }
        self._agreed = self._wanted  # what the device made of it, when its rates are others
        self._step = _Step.GO_TO_CONFIG
        self._asked = False  # whether the command of this step is on its way
        self._due_s = 0.0  # when the next command is sent, or patience ends
        self._fault = ""

    def fileno(self) -> int:
        """The descriptor of the line, or -1."""
        return self._line.fileno()

    def receive(self, now_s: float) -> None:
        """Read what has arrived, stamped now_s, and send at most one command and one answer."""
        if self._monitor.notice_reopening():
            self._framer = xbus.framer()
            self._fault = ""
            self._begin(now_s)
        data = self._line.read()
        if data:
            self._monitor.note_bytes(now_s)
            for packet in self._framer.feed(data):
                self._handle_packet(packet, now_s)
        self._set_up(now_s)

    def poll(self) -> Sequence[HeadingSample]:
        """The samples since the last poll, oldest first."""
        samples = tuple(self._samples)
        self._samples.clear()
        return samples

    def health(self, now_s: float) -> DeviceHealth:
        """The state; FAULTY while the device's status word reports something against itself."""
        return self._monitor.health(now_s, self._fault)

    def _begin(self, due_s: float) -> None:
        self._step = _Step.GO_TO_CONFIG
        self._asked = False
        self._due_s = due_s

    def _take_step(self, step: _Step, now_s: float) -> None:
        """Take the next step: at once, or when patience with the data ends."""
        self._step = step
        self._asked = False
        self._due_s = now_s + self._patience_s if step is _Step.MEASURING else now_s

    def _set_up(self, now_s: float) -> None:
        """Send the next command when it is due; begin anew when an answer or the data stay out."""
        if now_s < self._due_s or not self._line.connected:
            return
        if self._asked or self._step is _Step.MEASURING:
            self._begin(now_s)
        self._asked = self._line.write(self._commands[self._step])
        self._due_s = now_s + ANSWER_S

    def _handle_packet(self, packet: Packet, now_s: float) -> None:
        if packet.fault:
            # A run without the look of a packet is noise on the line, or another protocol.
            if packet.fault == CHECKSUM:
                self._monitor.reject(now_s, CHECKSUM)
            return
        message, data = xbus.message_id(packet.data), xbus.payload(packet.data)
        self._monitor.pass_over(NO_HEADING_YET)
        try:
            if message == Message.MT_DATA2:
                self._handle_reading(read_data(data), now_s)
            elif message == Message.WAKE_UP:
                self._line.write(xbus.encode(Message.WAKE_UP_ACK))
                self._begin(now_s + WAKE_UP_S)
            elif message == Message.ERROR:
                self._handle_error(xbus.error_text(data), now_s)
            elif self._asked and message == _ACKNOWLEDGEMENTS[self._step]:
                self._handle_acknowledgement(data, now_s)
        except MessageError as error:
            self._monitor.reject(now_s, str(error))

    def _handle_error(self, text: str, now_s: float) -> None:
        self._monitor.reject(now_s, text)
        if self._step is not _Step.MEASURING:
            self._begin(now_s + PATIENCE_S)

    def _handle_acknowledgement(self, data: bytes, now_s: float) -> None:
        if self._step is _Step.GO_TO_CONFIG:
            self._take_step(_Step.ASK_OUTPUT, now_s)
        elif self._step is _Step.ASK_OUTPUT:
            has_it = xbus.parse_output_configuration(data) in (self._wanted, self._agreed)
            self._take_step(_Step.GO_TO_MEASUREMENT if has_it else _Step.SET_OUTPUT, now_s)
        elif self._step is _Step.SET_OUTPUT:
            self._handle_configuration(xbus.parse_output_configuration(data), now_s)
        else:
            self._take_step(_Step.MEASURING, now_s)

    def _handle_configuration(self, configuration: dict[int, int], now_s: float) -> None:
        """Judge the list that the device has made of the wanted one: other rates will do, other data will not."""
        if {_EULER_ANGLES_NED, int(DataId.STATUS_WORD)} <= configuration.keys():
            self._agreed = configuration
            self._take_step(_Step.GO_TO_MEASUREMENT, now_s)
        else:
            self._monitor.note("gives no Euler angles and status: no AHRS model?")
            self._begin(now_s + PATIENCE_S)

    def _handle_reading(self, reading: Reading, now_s: float) -> None:
        if reading.frame is None:
            return  # a message need not have all data
        if reading.frame is not Frame.NED:
            self._monitor.note(f"Euler angles in {reading.frame.name}, not in NED")
            return
        # A device whose filter still settles is measuring: to set it up again would keep it from ever settling.
        self._monitor.accept(now_s)
        self._monitor.note("" if reading.status is not None else "data without status")
        self._fault = reading.fault
        if self._step is _Step.MEASURING:
            self._due_s = now_s + self._patience_s
        if reading.believable and reading.heading_magnetic_deg is not None:
            self._samples.append(_sample(reading, reading.heading_magnetic_deg, now_s))


def _sample(reading: Reading, heading_magnetic_deg: float, now_s: float) -> HeadingSample:
    return HeadingSample(
        t_s=now_s,
        heading_rad=wrap_two_pi(radians(heading_magnetic_deg)),
        reference=NorthReference.MAGNETIC,
        yaw_rate_rad_s=None if reading.yaw_rate_deg_s is None else radians(reading.yaw_rate_deg_s),
        roll_rad=None if reading.roll_deg is None else radians(reading.roll_deg),
        pitch_rad=None if reading.pitch_deg is None else radians(reading.pitch_deg),
        temperature_c=reading.temperature_c,
    )
