"""Drives a PNI TCM, Prime or TRAX compass module over its binary protocol."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import (
    Calibration,
    CalibrationState,
    DeviceHealth,
    DeviceRole,
    HeadingSample,
    NorthReference,
)
from firmware_py.sensors import pni_protocol as pni
from firmware_py.sensors.binary_framing import Packet
from firmware_py.sensors.device_monitor import NO_HEADING_YET, SILENT_AFTER_S, DeviceMonitor
from firmware_py.sensors.message_error import CHECKSUM, MessageError
from firmware_py.sensors.pni_calibration import PniCalibration
from firmware_py.sensors.pni_protocol import Component, Frame
from firmware_py.sensors.pni_reading import Reading, read_data

STEP_S = 0.05  # between two commands; the module confirms within milliseconds and has no error reply
PATIENCE_S = 1.0  # without a heading for this long the module is set up again
SAMPLES_KEPT = 512

_COMPONENTS = (Component.HEADING, Component.PITCH, Component.ROLL, Component.DISTORTION, Component.TEMPERATURE)
_TRUE_NORTH, _BIG_ENDIAN, _MILS = 2, 6, 15  # configuration ids; nothing is saved, so the flash does not wear

_CONFIRMATIONS = (Frame.SET_CONFIG_DONE, Frame.SET_ACQUISITION_DONE)


@dataclass(frozen=True, slots=True)
class PniOptions:
    """What the vehicle file may say of a PNI compass; ValueError for what cannot be."""

    rate_hz: float = option(
        "headings a second; a module gives its own fastest when that is slower",
        default=10.0,
        minimum=0.5,
        maximum=100.0,
    )

    def __post_init__(self) -> None:
        """Check the range."""
        check(self)


def set_up_frames(rate_hz: float, push_mode: int) -> tuple[bytes, ...]:
    """The commands that make a module of any history push its magnetic heading in degrees at a rate.

    `push_mode` is the acquisition mode that means push: 0 in the manuals of the TCM and
    Prime ("polling mode" false), 1 in later ones.
    """
    return (
        pni.encode(Frame.STOP_CONTINUOUS),
        pni.encode(Frame.SET_CONFIG, bytes((_BIG_ENDIAN, 1))),
        pni.encode(Frame.SET_CONFIG, bytes((_TRUE_NORTH, 0))),
        pni.encode(Frame.SET_CONFIG, bytes((_MILS, 0))),  # of which 6400 are a turn: a few of them look like degrees
        pni.encode(Frame.SET_DATA_COMPONENTS, bytes((len(_COMPONENTS), *_COMPONENTS))),
        # Mode; no flush of the filters; acquisition time 0; the interval between frames.
        pni.encode(Frame.SET_ACQUISITION, struct.pack(">BBff", push_mode, 0, 0.0, 1.0 / rate_hz)),
        pni.encode(Frame.START_CONTINUOUS),
    )


class PniCompass:
    """Sets the module up, gives its magnetic headings, and sets it up again when they stop.

    After a power loss the module is silent, because nothing is saved in it: after 1 s
    without a heading the commands are sent again, one each 50 ms or on the confirmation of
    the one before, then 1 s is waited, for ever. Until the first heading, every other round
    tries the other push mode. A module that says it has powered up is set up at once.
    """

    def __init__(self, line: ByteLine, options: PniOptions) -> None:
        """Set the module up with the first `receive`."""
        rate_hz = options.rate_hz
        self._line = line
        self._rounds = (set_up_frames(rate_hz, 0), set_up_frames(rate_hz, 1))
        self._frames = self._rounds[0]
        self._patience_s = max(PATIENCE_S, 3.0 / rate_hz)
        self._monitor = DeviceMonitor(line, DeviceRole.COMPASS, max(SILENT_AFTER_S, 3.0 / rate_hz))
        self._framer = pni.framer()
        self._samples: deque[HeadingSample] = deque(maxlen=SAMPLES_KEPT)
        self._step = 0  # the next of the frames; past the last one data is waited for
        self._due_s = 0.0  # when the next frame is sent, or patience ends
        self._answered = False  # whether a set-up has brought headings since the port was opened
        self._distorted = False
        self._calibration: PniCalibration | None = None
        self._last_calibration = Calibration()

    def fileno(self) -> int:
        """The descriptor of the line, or -1."""
        return self._line.fileno()

    def receive(self, now_s: float) -> None:
        """Read what has arrived, stamped now_s, and send at most one command."""
        if self._monitor.notice_reopening():
            self._framer = pni.framer()
            self._distorted = self._answered = False
            self._calibration = None
            self._begin(now_s)
        data = self._line.read()
        if data:
            self._monitor.note_bytes(now_s)
            for packet in self._framer.feed(data):
                self._handle_packet(packet, now_s)
        if self._calibration is None:
            self._set_up(now_s)
        else:
            self._continue_calibration(self._calibration, now_s)

    def poll(self) -> Sequence[HeadingSample]:
        """The samples since the last poll, oldest first."""
        samples = tuple(self._samples)
        self._samples.clear()
        return samples

    def health(self, now_s: float) -> DeviceHealth:
        """The state; FAULTY while the module says that the magnetic field is distorted."""
        return self._monitor.health(now_s, "magnetic field distorted" if self._distorted else "")

    def calibrate(self, now_s: float) -> bool:
        """Begin the 2D user calibration; False when it is under way or the port is away."""
        if self._calibration is not None or not self._line.connected:
            return False
        self._calibration = PniCalibration(now_s)
        self._last_calibration = self._calibration.report
        return True

    def calibration(self) -> Calibration:
        """How far it is, or how the last one ended."""
        return self._last_calibration

    def cancel(self) -> None:
        """End it without a result."""
        if self._calibration is not None:
            self._line.write(pni.encode(Frame.STOP_CAL))
            self._calibration = None
            self._last_calibration = Calibration()
            self._step = 0  # set up anew with the next call

    def _continue_calibration(self, calibration: PniCalibration, now_s: float) -> None:
        frame = calibration.next_frame(now_s)
        if frame is not None and self._line.write(frame):
            calibration.note_sent(now_s)
        self._last_calibration = calibration.report
        if calibration.report.state is not CalibrationState.RUNNING:
            self._calibration = None
            self._begin(now_s)

    def _begin(self, now_s: float) -> None:
        self._step = 0
        self._due_s = now_s

    def _set_up(self, now_s: float) -> None:
        """Send the next command when it is due; after the last, wait for headings."""
        if now_s < self._due_s or not self._line.connected:
            return
        if self._step == len(self._frames):
            if not self._answered:
                self._frames = self._rounds[self._frames is self._rounds[0]]
            self._begin(now_s)
        if self._line.write(self._frames[self._step]):
            self._step += 1
        self._due_s = now_s + (self._patience_s if self._step == len(self._frames) else STEP_S)

    def _handle_packet(self, packet: Packet, now_s: float) -> None:
        if packet.fault:
            # A run without the look of a packet is noise on the line, or another protocol.
            if packet.fault == CHECKSUM:
                self._monitor.reject(now_s, CHECKSUM)
            return
        frame_id = pni.frame_id(packet.data)
        self._monitor.pass_over(NO_HEADING_YET)
        if frame_id == Frame.DATA:
            self._handle_data(pni.payload(packet.data), now_s)
        elif frame_id == Frame.POWER_UP_DONE:
            if self._calibration is not None:
                self._calibration = None
                self._last_calibration = Calibration(
                    CalibrationState.FAILED, 0, "Compass calibration: it lost its power"
                )
            self._begin(now_s)
        elif self._calibration is not None:
            self._calibration.take(frame_id, pni.payload(packet.data), now_s)
        elif frame_id in _CONFIRMATIONS and self._step < len(self._frames):
            self._due_s = now_s

    def _handle_data(self, payload: bytes, now_s: float) -> None:
        try:
            reading = read_data(payload)
        except MessageError as error:
            self._monitor.reject(now_s, str(error))
            return
        self._distorted = bool(reading.distortion)
        if reading.heading_magnetic_deg is None:
            self._monitor.note("data without heading")
            return
        self._monitor.accept(now_s)
        self._monitor.note("")
        if self._step == len(self._frames):
            self._answered = True
            self._due_s = now_s + self._patience_s
        self._samples.append(_sample(reading, reading.heading_magnetic_deg, now_s))


def _sample(reading: Reading, heading_magnetic_deg: float, now_s: float) -> HeadingSample:
    return HeadingSample(
        t_s=now_s,
        heading_rad=wrap_two_pi(radians(heading_magnetic_deg)),
        reference=NorthReference.MAGNETIC,
        roll_rad=None if reading.roll_deg is None else radians(reading.roll_deg),
        pitch_rad=None if reading.pitch_deg is None else radians(reading.pitch_deg),
        temperature_c=reading.temperature_c,
    )
