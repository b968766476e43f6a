"""Driver of an Xsens (Movella) MTi attitude and heading reference with the binary protocol Xbus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceHealth, HeadingSample, NorthReference
from firmware_py.sensors import mti_protocol as xbus
from firmware_py.sensors.device_monitor import NO_HEADING_YET, SILENT_AFTER_S
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.mti_protocol import EACH_MESSAGE, DataId, Frame, Message
from firmware_py.sensors.mti_reading import CAPTURE_FORMAT, Reading, read_data
from firmware_py.sensors.packet_receiver import PacketReceiver

REPLY_TIMEOUT_S = 0.5  # without an acknowledgement for this time, the set-up starts again
DATA_TIMEOUT_S = 1.0  # without an orientation, or after a rejected command, the set-up starts again after this time
WAKE_UP_S = 0.05  # pause between the reply to a wake-up message and the first command

_EULER_ANGLES_NED = DataId.EULER_ANGLES | Frame.NED


@dataclass(frozen=True, slots=True)
class MtiOptions:
    """Options of the vehicle file for an MTi; raises ValueError."""

    # The protocol has integer rates; the smallest models send at most 100 Hz.
    rate_hz: int = option("headings per second, an integer", default=10, minimum=1, maximum=100)

    def __post_init__(self) -> None:
        """Check the range."""
        check(self)


class _Step(IntEnum):
    """A step of the set-up, which ends with its acknowledgement."""

    GO_TO_CONFIG = 0
    ASK_OUTPUT = 1
    SET_OUTPUT = 2  # skipped if already set: the device stores the list in flash memory, which wears
    GO_TO_MEASUREMENT = 3
    MEASURING = 4


_ACKNOWLEDGEMENTS = {
    _Step.GO_TO_CONFIG: Message.GO_TO_CONFIG_ACK,
    _Step.ASK_OUTPUT: Message.OUTPUT_CONFIGURATION_ACK,
    _Step.SET_OUTPUT: Message.OUTPUT_CONFIGURATION_ACK,
    _Step.GO_TO_MEASUREMENT: Message.GO_TO_MEASUREMENT_ACK,
}


def required_output(rate_hz: int) -> dict[int, int]:
    """Return the output configuration of a compass: {data identifier: rate in Hz}."""
    return {
        int(DataId.STATUS_WORD): EACH_MESSAGE,
        _EULER_ANGLES_NED: rate_hz,
        int(DataId.RATE_OF_TURN): rate_hz,
        int(DataId.TEMPERATURE): 1,
    }


class MtiCompass:
    """Configures the device, returns its valid headings, and configures it again if they stop.

    The driver requests Euler angles in the frame NED, where yaw is the heading, clockwise from north. The manual says
    "local magnetic north". It does not state whether a model with a satellite receiver corrects for the declination:
    compare such a model with a known bearing; if it does, set CMP_DECL_AUTO = 0 and CMP_DECL_DEG = 0. A message whose
    status marks the orientation as invalid gives no heading.

    Commands are sent one at a time, each after the acknowledgement of the previous one. The set-up starts again
    REPLY_TIMEOUT_S after a command without an acknowledgement, DATA_TIMEOUT_S after an error reply, and WAKE_UP_S after
    a wake-up message.
    """

    def __init__(self, line: ByteLine, options: MtiOptions) -> None:
        """Store line and options; the first `receive` starts the set-up."""
        self._line = line
        self._required = required_output(options.rate_hz)
        self._data_timeout_s = max(DATA_TIMEOUT_S, 3.0 / options.rate_hz)
        self._receiver = PacketReceiver(line, xbus.create_framer, max(SILENT_AFTER_S, 3.0 / options.rate_hz))
        self._monitor, self._samples = self._receiver.monitor, self._receiver.samples
        self._commands = {
            _Step.GO_TO_CONFIG: xbus.encode(Message.GO_TO_CONFIG),
            _Step.ASK_OUTPUT: xbus.encode(Message.OUTPUT_CONFIGURATION),
            _Step.SET_OUTPUT: xbus.encode(
                Message.OUTPUT_CONFIGURATION, xbus.encode_output_configuration(self._required.items())
            ),
            _Step.GO_TO_MEASUREMENT: xbus.encode(Message.GO_TO_MEASUREMENT),
        }
        self._accepted_output = self._required  # the configuration accepted by the device; its rates may differ
        self._fault = ""
        self._restart_set_up(0.0)

    def fileno(self) -> int:
        """Return the descriptor of the line, or -1."""
        return self._line.fileno()

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s; send at most one command and one reply."""
        if self._receiver.notice_reopening():
            self._restart_set_up(now_s)
        for packet in self._receiver.read(now_s):
            if not packet.fault:
                self._handle_packet(packet.data, now_s)
        self._continue_set_up(now_s)

    def poll(self) -> Sequence[HeadingSample]:
        """Return the samples since the last poll, oldest first."""
        return self._receiver.poll()

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state; FAULTY while the status word of the device reports a fault."""
        return self._monitor.health(now_s, self._fault)

    def _restart_set_up(self, due_s: float) -> None:
        self._step = _Step.GO_TO_CONFIG
        self._is_command_sent = False  # of the present step
        self._due_s = due_s  # time of the next command or of the timeout

    def _enter_step(self, step: _Step, now_s: float) -> None:
        """Go to a step: its command is due at once, or in MEASURING after the data timeout."""
        self._step = step
        self._is_command_sent = False
        self._due_s = now_s + self._data_timeout_s if step is _Step.MEASURING else now_s

    def _continue_set_up(self, now_s: float) -> None:
        """Send the next command when it is due; after a timeout start again."""
        if now_s < self._due_s or not self._line.connected:
            return
        if self._is_command_sent or self._step is _Step.MEASURING:
            self._restart_set_up(now_s)
        self._is_command_sent = self._line.write(self._commands[self._step])
        self._due_s = now_s + REPLY_TIMEOUT_S

    def _handle_packet(self, packet: bytes, now_s: float) -> None:
        message, data = xbus.message_id(packet), xbus.payload(packet)
        self._monitor.note_unused(NO_HEADING_YET)
        try:
            if message == Message.MT_DATA2:
                self._handle_reading(read_data(data), now_s)
            elif message == Message.WAKE_UP:
                self._line.write(xbus.encode(Message.WAKE_UP_ACK))
                self._restart_set_up(now_s + WAKE_UP_S)
            elif message == Message.ERROR:
                self._handle_error(xbus.error_text(data), now_s)
            elif self._is_command_sent and message == _ACKNOWLEDGEMENTS[self._step]:
                self._handle_acknowledgement(data, now_s)
        except MessageError as error:
            self._monitor.reject(now_s, str(error))

    def _handle_error(self, text: str, now_s: float) -> None:
        self._monitor.reject(now_s, text)
        if self._step is not _Step.MEASURING:
            self._restart_set_up(now_s + DATA_TIMEOUT_S)

    def _handle_acknowledgement(self, data: bytes, now_s: float) -> None:
        if self._step is _Step.GO_TO_CONFIG:
            self._enter_step(_Step.ASK_OUTPUT, now_s)
        elif self._step is _Step.ASK_OUTPUT:
            is_configured = xbus.parse_output_configuration(data) in (self._required, self._accepted_output)
            self._enter_step(_Step.GO_TO_MEASUREMENT if is_configured else _Step.SET_OUTPUT, now_s)
        elif self._step is _Step.SET_OUTPUT:
            self._handle_configuration(xbus.parse_output_configuration(data), now_s)
        else:
            self._enter_step(_Step.MEASURING, now_s)

    def _handle_configuration(self, configuration: dict[int, int], now_s: float) -> None:
        """Check the configuration that the device has set: other rates are accepted, other data are not."""
        if {_EULER_ANGLES_NED, int(DataId.STATUS_WORD)} <= configuration.keys():
            self._accepted_output = configuration
            self._enter_step(_Step.GO_TO_MEASUREMENT, now_s)
        else:
            self._monitor.note("gives no Euler angles and status: no AHRS model?")
            self._restart_set_up(now_s + DATA_TIMEOUT_S)

    def _handle_reading(self, reading: Reading, now_s: float) -> None:
        if reading.frame is None:
            return  # a message may contain only a part of the data
        if reading.frame is not Frame.NED:
            self._monitor.note(f"Euler angles in {reading.frame.name}, not in NED")
            return
        # A device whose filter has not converged is measuring. A new set-up would restart its filter.
        self._monitor.accept(now_s)
        self._monitor.note("" if reading.status is not None else "data without status")
        self._fault = reading.fault
        if self._step is _Step.MEASURING:
            self._due_s = now_s + self._data_timeout_s
        if reading.is_valid and reading.heading_magnetic_deg is not None:
            self._samples.append(_make_sample(reading, reading.heading_magnetic_deg, now_s))


def _make_sample(reading: Reading, heading_magnetic_deg: float, now_s: float) -> HeadingSample:
    return HeadingSample(
        t_s=now_s,
        heading_rad=wrap_two_pi(radians(heading_magnetic_deg)),
        reference=NorthReference.MAGNETIC,
        yaw_rate_rad_s=None if reading.yaw_rate_deg_s is None else radians(reading.yaw_rate_deg_s),
        roll_rad=None if reading.roll_deg is None else radians(reading.roll_deg),
        pitch_rad=None if reading.pitch_deg is None else radians(reading.pitch_deg),
        temperature_c=reading.temperature_c,
    )


DRIVER = Driver(
    interface=INTERFACE,
    device="Xsens (Movella) MTi",
    options=MtiOptions,
    make=MtiCompass,
    writes=True,
    capture=CAPTURE_FORMAT,
)
