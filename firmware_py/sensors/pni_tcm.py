"""Driver of a PNI TCM, Prime or TRAX compass module with its binary protocol."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import (
    Calibration,
    CalibrationState,
    DeviceHealth,
    HeadingSample,
    NorthReference,
)
from firmware_py.sensors import pni_protocol as pni
from firmware_py.sensors.device_monitor import NO_HEADING_YET, SILENT_AFTER_S
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.packet_receiver import PacketReceiver
from firmware_py.sensors.pni_calibration import PniCalibration
from firmware_py.sensors.pni_protocol import Component, Frame
from firmware_py.sensors.pni_reading import CAPTURE_FORMAT, Reading, read_data

COMMAND_INTERVAL_S = 0.05  # the module confirms within milliseconds and has no error reply
DATA_TIMEOUT_S = 1.0  # after this time without a heading, the module is configured again

_COMPONENTS = (Component.HEADING, Component.PITCH, Component.ROLL, Component.DISTORTION, Component.TEMPERATURE)
_TRUE_NORTH_ID, _BIG_ENDIAN_ID, _MILS_ID = 2, 6, 15  # configuration ids

_CONFIRMATIONS = (Frame.SET_CONFIG_DONE, Frame.SET_ACQUISITION_DONE)


@dataclass(frozen=True, slots=True)
class PniOptions:
    """Options of the vehicle file for a PNI compass; raises ValueError."""

    rate_hz: float = option(
        "headings per second; at most the maximum rate of the module",
        default=10.0,
        minimum=0.5,
        maximum=100.0,
    )

    def __post_init__(self) -> None:
        """Check the range."""
        check(self)


def configuration_frames(rate_hz: float, push_mode: int) -> tuple[bytes, ...]:
    """Return the commands that make a module in any state push its magnetic heading in degrees at a rate.

    `push_mode` is the acquisition mode for push: 0 in the manuals of the TCM and Prime ("polling mode" false), 1 in
    later ones.
    """
    return (
        pni.encode(Frame.STOP_CONTINUOUS),
        pni.encode(Frame.SET_CONFIG, bytes((_BIG_ENDIAN_ID, 1))),
        pni.encode(Frame.SET_CONFIG, bytes((_TRUE_NORTH_ID, 0))),
        pni.encode(Frame.SET_CONFIG, bytes((_MILS_ID, 0))),  # some headings in mils are in the range of degrees
        pni.encode(Frame.SET_DATA_COMPONENTS, bytes((len(_COMPONENTS), *_COMPONENTS))),
        # Mode; no flush of the filters; acquisition time 0; the interval between frames.
        pni.encode(Frame.SET_ACQUISITION, struct.pack(">BBff", push_mode, 0, 0.0, 1.0 / rate_hz)),
        pni.encode(Frame.START_CONTINUOUS),
    )


class PniCompass:
    """Configures the module, returns its magnetic headings, and configures it again if they stop.

    The configuration is not saved, which spares the flash memory, so after a power loss the module is silent. After 1 s
    without a heading the driver sends the commands again, one every 50 ms or after the confirmation of the previous
    one, and waits for 1 s; this repeats without limit. Until the first heading, the two push modes are used in turn. A
    module that reports power-up is configured at once.
    """

    def __init__(self, line: ByteLine, options: PniOptions) -> None:
        """Store line and options; the first `receive` starts the set-up."""
        rate_hz = options.rate_hz
        self._line = line
        self._configurations = (configuration_frames(rate_hz, 0), configuration_frames(rate_hz, 1))
        self._frames = self._configurations[0]
        self._data_timeout_s = max(DATA_TIMEOUT_S, 3.0 / rate_hz)
        self._receiver = PacketReceiver(line, pni.create_framer, max(SILENT_AFTER_S, 3.0 / rate_hz))
        self._monitor, self._samples = self._receiver.monitor, self._receiver.samples
        self._has_headings = False  # whether there were headings after a set-up since the port was opened
        self._is_field_distorted = False
        self._calibration: PniCalibration | None = None
        self._last_calibration = Calibration()
        self._restart_set_up(0.0)

    def fileno(self) -> int:
        """Return the descriptor of the line, or -1."""
        return self._line.fileno()

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s, and send at most one command."""
        if self._receiver.notice_reopening():
            self._has_headings = False
            self.cancel()
            self._restart_set_up(now_s)
        for packet in self._receiver.read(now_s):
            if not packet.fault:
                self._handle_packet(packet.data, now_s)
        if self._calibration is None:
            self._continue_set_up(now_s)
        else:
            self._continue_calibration(self._calibration, now_s)

    def poll(self) -> Sequence[HeadingSample]:
        """Return the samples since the last poll, oldest first."""
        return self._receiver.poll()

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state; FAULTY while the module reports a distorted magnetic field."""
        return self._monitor.health(now_s, "magnetic field distorted" if self._is_field_distorted else "")

    def calibrate(self, now_s: float) -> bool:
        """Start the 2D user calibration; False if it is running or the port is closed."""
        if self._calibration is not None or not self._line.connected:
            return False
        self._calibration = PniCalibration(now_s)
        self._last_calibration = self._calibration.report
        return True

    def calibration(self) -> Calibration:
        """Return the progress, or the result of the last calibration."""
        return self._last_calibration

    def cancel(self) -> None:
        """Cancel a running calibration; it has no result."""
        if self._calibration is not None:
            self._line.write(pni.encode(Frame.STOP_CAL))
            self._calibration = None
            self._last_calibration = Calibration()
            self._step = 0  # the next call configures the module again

    def _continue_calibration(self, calibration: PniCalibration, now_s: float) -> None:
        frame = calibration.next_frame(now_s)
        if frame is not None and self._line.write(frame):
            calibration.note_sent(now_s)
        self._last_calibration = calibration.report
        if calibration.report.state is not CalibrationState.RUNNING:
            self._calibration = None
            self._restart_set_up(now_s)

    def _restart_set_up(self, now_s: float) -> None:
        self._step = 0  # index of the next frame; after the last one the driver waits for data
        self._due_s = now_s  # time of the next frame or of the timeout

    def _continue_set_up(self, now_s: float) -> None:
        """Send the next command when it is due; after the last, wait for headings."""
        if now_s < self._due_s or not self._line.connected:
            return
        if self._step == len(self._frames):
            if not self._has_headings:
                self._frames = self._configurations[self._frames is self._configurations[0]]
            self._restart_set_up(now_s)
        if self._line.write(self._frames[self._step]):
            self._step += 1
        self._due_s = now_s + (self._data_timeout_s if self._step == len(self._frames) else COMMAND_INTERVAL_S)

    def _handle_packet(self, packet: bytes, now_s: float) -> None:
        frame_id = pni.frame_id(packet)
        self._monitor.note_unused(NO_HEADING_YET)
        if frame_id == Frame.DATA:
            self._handle_data(pni.payload(packet), now_s)
        elif frame_id == Frame.POWER_UP_DONE:
            if self._calibration is not None:
                self._calibration = None
                self._last_calibration = Calibration(
                    CalibrationState.FAILED, 0, "Compass calibration failed: the compass lost power"
                )
            self._restart_set_up(now_s)
        elif self._calibration is not None:
            self._calibration.handle_frame(frame_id, pni.payload(packet), now_s)
        elif frame_id in _CONFIRMATIONS and self._step < len(self._frames):
            self._due_s = now_s

    def _handle_data(self, payload: bytes, now_s: float) -> None:
        try:
            reading = read_data(payload)
        except MessageError as error:
            self._monitor.reject(now_s, str(error))
            return
        self._is_field_distorted = bool(reading.distortion)
        if reading.heading_magnetic_deg is None:
            self._monitor.note("data without heading")
            return
        self._monitor.accept(now_s)
        self._monitor.note("")
        if self._step == len(self._frames):
            self._has_headings = True
            self._due_s = now_s + self._data_timeout_s
        self._samples.append(_make_sample(reading, reading.heading_magnetic_deg, now_s))


def _make_sample(reading: Reading, heading_magnetic_deg: float, now_s: float) -> HeadingSample:
    return HeadingSample(
        t_s=now_s,
        heading_rad=wrap_two_pi(radians(heading_magnetic_deg)),
        reference=NorthReference.MAGNETIC,
        roll_rad=None if reading.roll_deg is None else radians(reading.roll_deg),
        pitch_rad=None if reading.pitch_deg is None else radians(reading.pitch_deg),
        temperature_c=reading.temperature_c,
    )


DRIVER = Driver(
    interface=INTERFACE,
    device="PNI TCM, Prime and TRAX",
    options=PniOptions,
    make=PniCompass,
    writes=True,
    calibrator=lambda compass: compass,
    capture=CAPTURE_FORMAT,
)
