"""An Xsens MTi AHRS, which after power-up measures with the stored output configuration.

Sources: MT Low Level Communication Protocol Documentation MT0101P, MTi User Manual MT0605P, mtidocs.movella.com
"States". Choices where these state no behaviour: a message with a bad checksum is ignored; a command for another state
is ignored, the reply to an unknown one is Error 4 (invalid message); a rate above the maximum is reduced to it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from enum import Enum, auto

import numpy as np

from hil.devices.emulator import INTERFACE, Attitude, Device, DeviceContext, EmulatedDevice
from hil.devices.mti_frames import (
    LOCAL_FRAMES,
    Matrix,
    MessageReader,
    Mid,
    Xdi,
    euler_deg,
    pack_message,
    pack_values,
    sensor_in_enu,
)
from hil.devices.timing import Pace, Transmitter

_REPLY_DELAY_S = 0.002
_WAKE_UP_WINDOW_S = 0.5
_MAX_RATE_HZ = 100  # MTi 1-series
_DEVICE_ID = 0x0360_1234
_WITH_EACH_MESSAGE = 0xFFFF
_IN_EVERY_MESSAGE = (Xdi.PACKET_COUNTER, Xdi.SAMPLE_TIME_FINE, Xdi.STATUS)
# Factory configuration: ENU, with the usual outputs.
_FACTORY_OUTPUT = ((Xdi.PACKET_COUNTER, 0xFFFF), (Xdi.SAMPLE_TIME_FINE, 0xFFFF), (Xdi.EULER, 100), (Xdi.STATUS, 0xFFFF))
_INVALID_MESSAGE, _INVALID_PARAMETER = 4, 33
_SELF_TEST, _FILTER_VALID = 0x01, 0x02


class _State(Enum):
    OFF = auto()
    WAKING = auto()
    CONFIG = auto()
    MEASUREMENT = auto()


class MtiEmulator:
    """An MTi with its label up and its x axis ahead, which measures magnetic north.

    `declination_deg` is that of the location. `temperature_c`, `pitch_deg`, `roll_deg` (of the boat),
    `self_test_passed`, `filter_valid` and `clipped` (bits of the status word) may be set at any time. `stored` counts
    writes of the output configuration to the non-volatile memory. An orientation is valid `settle_s` after a
    measurement begins.
    """

    def __init__(
        self,
        attitude: Attitude,
        rng: np.random.Generator,
        *,
        noise_deg: float = 0.3,
        tilt_noise_deg: float = 0.2,
        turn_noise_rad_s: float = 0.002,
        declination_deg: float = 0.0,
        frequency_error_ppm: float = 0.0,
        boot_s: float = 0.3,
        settle_s: float = 0.2,
        baud: int = 115200,
    ) -> None:
        """Start powered and measuring, with the factory configuration."""
        self.temperature_c = 20.0
        self.pitch_deg = 0.0
        self.roll_deg = 0.0
        self.self_test_passed = True
        self.filter_valid = True
        self.clipped = 0
        self.stored = 0
        self._attitude = attitude
        self._rng = rng
        self._noise_deg = noise_deg
        self._tilt_noise_deg = tilt_noise_deg
        self._turn_noise_rad_s = turn_noise_rad_s
        self._declination_deg = declination_deg
        self._error_ppm = frequency_error_ppm
        self._boot_s = boot_s
        self._settle_s = settle_s
        self.transmitter = Transmitter(baud)
        self._reader = MessageReader()
        self._output: tuple[tuple[int, int], ...] = _FACTORY_OUTPUT
        self._state = _State.OFF
        self._change_s = math.inf  # time of the next automatic change of the state
        self._pace: Pace | None = None
        self._measuring_since_s = 0.0
        self._count = 0
        self._commands: dict[int, Callable[[float, bytes], None]] = {
            Mid.REQ_DID: self._req_did,
            Mid.GOTO_CONFIG: self._goto_config,
            Mid.GOTO_MEASUREMENT: self._goto_measurement,
            Mid.OUTPUT_CONFIG: self._output_config,
            Mid.WAKEUP_ACK: self._wake_up_ack,
        }
        self._start_measurement(0.0)

    def receive(self, now_s: float, data: bytes) -> None:
        """Process commands."""
        self._update_state(now_s)
        if self._state is _State.OFF or not data:
            return
        for mid, content in self._reader.feed(now_s, data):
            command = self._commands.get(mid)
            if command is not None:
                command(now_s, content)
            elif self._state is _State.CONFIG:
                self._reply_error(now_s, _INVALID_MESSAGE)

    def next_output_s(self) -> float:
        """Return when the next message is sampled or complete, or the state changes."""
        sample_s = math.inf if self._pace is None else self._pace.next_s
        return min(sample_s, self._change_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete messages."""
        self._update_state(now_s)
        if self._pace is not None:
            for sample_s in self._pace.take(now_s):
                self.transmitter.send(sample_s, self._data_message(sample_s))
        return self.transmitter.take(now_s)

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:
        """Interrupt the power for off_s (infinity: until the next call); the output configuration is kept."""
        self.transmitter.clear()
        self._reader.clear()
        self._pace = None
        self._state = _State.OFF
        self._change_s = now_s + off_s + self._boot_s

    # ------------------------------------------------------------------ states

    def _update_state(self, now_s: float) -> None:
        """Wake up after power-on; measure if no host acknowledges in time."""
        while self._change_s <= now_s:
            change_s, self._change_s = self._change_s, math.inf
            if self._state is _State.OFF:
                self._state = _State.WAKING
                self.transmitter.send(change_s, pack_message(Mid.WAKEUP))
                self._change_s = change_s + _WAKE_UP_WINDOW_S
            else:
                # Only the length of this message, 118 bytes, is emulated.
                self.transmitter.send(change_s, pack_message(Mid.CONFIGURATION, bytes(118)))
                self._start_measurement(change_s)

    def _start_measurement(self, now_s: float) -> None:
        self._state = _State.MEASUREMENT
        self._change_s = math.inf
        self._measuring_since_s = now_s
        self._count = 0
        rates = [rate for _, rate in self._output if rate != _WITH_EACH_MESSAGE]
        if rates:
            period_s = 1.0 / max(rates)
            self._pace = Pace(period_s, start_s=now_s + period_s, error_ppm=self._error_ppm)

    # ------------------------------------------------------------------ commands

    def _wake_up_ack(self, _now_s: float, _content: bytes) -> None:
        if self._state is _State.WAKING:
            self._state = _State.CONFIG
            self._change_s = math.inf

    def _goto_config(self, now_s: float, _content: bytes) -> None:
        if self._state in (_State.CONFIG, _State.MEASUREMENT):
            self._state = _State.CONFIG
            self._pace = None
            self._reply(now_s, Mid.GOTO_CONFIG)

    def _goto_measurement(self, now_s: float, _content: bytes) -> None:
        if self._state in (_State.CONFIG, _State.MEASUREMENT):
            self._reply(now_s, Mid.GOTO_MEASUREMENT)
            if self._state is _State.CONFIG:
                self._start_measurement(now_s)

    def _req_did(self, now_s: float, _content: bytes) -> None:
        if self._state is _State.CONFIG:
            self._reply(now_s, Mid.REQ_DID, _DEVICE_ID.to_bytes(4, "big"))

    def _output_config(self, now_s: float, content: bytes) -> None:
        if self._state is not _State.CONFIG:
            return
        if content:
            outputs = self._supported(content)
            if outputs is None:
                self._reply_error(now_s, _INVALID_PARAMETER)
                return
            self._output = outputs
            self.stored += 1
        self._reply(now_s, Mid.OUTPUT_CONFIG, b"".join(struct.pack(">HH", *row) for row in self._output))

    def _supported(self, content: bytes) -> tuple[tuple[int, int], ...] | None:
        """Return the requested outputs with the rates of this device; None if one of them is not supported."""
        if len(content) % 4:
            return None
        outputs = []
        for identifier, rate in struct.iter_unpack(">HH", content):
            kind = identifier & 0xFFF0
            if kind not in tuple(Xdi) or (kind == Xdi.EULER and identifier & 0xC not in LOCAL_FRAMES):
                return None
            max_rate_hz = 1 if kind == Xdi.TEMPERATURE else _MAX_RATE_HZ
            rate_hz = max_rate_hz if rate in (0, _WITH_EACH_MESSAGE) else rate
            outputs.append((identifier, _WITH_EACH_MESSAGE if kind in _IN_EVERY_MESSAGE else min(rate_hz, max_rate_hz)))
        return tuple(outputs)

    def _reply_error(self, now_s: float, code: int) -> None:
        self.transmitter.send(now_s + _REPLY_DELAY_S, pack_message(Mid.ERROR, bytes([code])))

    def _reply(self, now_s: float, command: Mid, content: bytes = b"") -> None:
        self.transmitter.send(now_s + _REPLY_DELAY_S, pack_message(command + 1, content))

    # ------------------------------------------------------------------ data

    def _data_message(self, now_s: float) -> bytes:
        """Return one MTData2; a slower output, such as the temperature, is only in every n-th message."""
        max_rate_hz = max(rate for _, rate in self._output if rate != _WITH_EACH_MESSAGE)
        data = b""
        for identifier, rate in self._output:
            if rate != _WITH_EACH_MESSAGE and self._count % max(1, round(max_rate_hz / rate)):
                continue
            value = self._encode_output(now_s, identifier)
            data += struct.pack(">HB", identifier, len(value)) + value
        self._count += 1
        return pack_message(Mid.MTDATA2, data)

    def _encode_output(self, now_s: float, identifier: int) -> bytes:
        # The low bits are the format: coordinate frame and precision.
        kind, frame, precision = identifier & 0xFFF0, identifier & 0xC, identifier & 0x3
        if kind == Xdi.PACKET_COUNTER:
            return (self._count & 0xFFFF).to_bytes(2, "big")
        if kind == Xdi.SAMPLE_TIME_FINE:
            return (int(now_s * 1e4) & 0xFFFF_FFFF).to_bytes(4, "big")
        if kind == Xdi.STATUS:
            return self._status(now_s).to_bytes(4, "big")
        if kind == Xdi.TEMPERATURE:
            return pack_values([self.temperature_c + self._noise(0.05)], precision)
        if kind == Xdi.RATE_OF_TURN:
            return pack_values(
                [rate + self._noise(self._turn_noise_rad_s) for rate in self._gyroscope_rates()], precision
            )
        angles = euler_deg(LOCAL_FRAMES[frame], self._sensor_matrix(noisy=True))
        return pack_values(angles, precision)

    def _status(self, now_s: float) -> int:
        is_settled = now_s - self._measuring_since_s >= self._settle_s
        status = self.clipped
        status |= _SELF_TEST if self.self_test_passed else 0
        return status | (_FILTER_VALID if self.filter_valid and is_settled else 0)

    def _sensor_matrix(self, *, noisy: bool) -> Matrix:
        heading_deg = math.degrees(self._attitude.heading_rad()) - self._declination_deg
        pitch_deg, roll_deg = self.pitch_deg, self.roll_deg
        if noisy:
            heading_deg += self._noise(self._noise_deg)
            pitch_deg += self._noise(self._tilt_noise_deg)
            roll_deg += self._noise(self._tilt_noise_deg)
        return sensor_in_enu(math.radians(heading_deg), math.radians(pitch_deg), math.radians(roll_deg))

    def _gyroscope_rates(self) -> tuple[float, ...]:
        """Return the three gyroscope rates; a turn to starboard is positive about the downward axis."""
        up_in_sensor = self._sensor_matrix(noisy=False)[2]
        return tuple(-self._attitude.yaw_rate_rad_s() * component for component in up_in_sensor)

    def _noise(self, deviation: float) -> float:
        return self._rng.normal(0.0, deviation)


def _make(context: DeviceContext) -> Device:
    return MtiEmulator(
        context.world,
        context.rng,
        declination_deg=context.declination_deg,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="mti", baud=115200, make=_make)
