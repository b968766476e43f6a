"""A WitMotion attitude sensor, which sends the packets that are enabled in its registers.

Source: WIT Standard Communication Protocol, data sheet of the HWT905. Choices where these state no behaviour: a read
gets a reply although the registers are locked, unless `locks_reads` is set; a write while they are locked is ignored;
without its magnetometer, the sensor starts with yaw 0, which then drifts.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from hil.devices.emulator import INTERFACE, Attitude, Device, DeviceContext, EmulatedDevice
from hil.devices.mounting import Vector, euler_deg, sensor_in_ned, to_right_ahead_up, to_sensor
from hil.devices.timing import Pace, ReceiveBuffer, Transmitter

_REPLY_DELAY_S = 0.005
_UNLOCKED_S = 10.0
_SAVE, _CONTENT, _RATE, _SIX_AXES, _READ, _KEY = 0x00, 0x02, 0x03, 0x24, 0x27, 0x69  # registers
_UNLOCK_VALUE = 0xB588  # of the key register
_REGISTERS_PACKET, _FIRST_PACKET = 0x5F, 0x50  # the packet of bit n of the content register is 0x50 + n
_FACTORY = {_CONTENT: 0x1E, _RATE: 6, _SIX_AXES: 0}  # acceleration, rate, angle, field at 10 Hz, nine axes
# By value of the rate register.
_RATES_HZ = {1: 0.2, 2: 0.5, 3: 1.0, 4: 2.0, 5: 5.0, 6: 10.0, 7: 20.0, 8: 50.0, 9: 100.0, 11: 200.0}
_FIELD_NED_MG = (200.0, 0.0, 430.0)  # a mid-latitude field
_VERSION = 0x46


class WitmotionEmulator:
    """A sensor with its label up and its y axis ahead, or mounted otherwise.

    `declination_deg` is that of the location. `temperature_c`, `pitch_deg`, `roll_deg` (of the boat) and
    `magnetometer_works` may be set at any time. `saves` counts writes to the flash memory. `registers` replace
    factory settings.
    """

    def __init__(
        self,
        attitude: Attitude,
        rng: np.random.Generator,
        *,
        mounting: str = "none",
        registers: dict[int, int] | None = None,
        locks_reads: bool = False,
        noise_deg: float = 0.3,
        tilt_noise_deg: float = 0.2,
        turn_noise_deg_s: float = 0.1,
        drift_deg_s: float = 0.02,
        declination_deg: float = 0.0,
        frequency_error_ppm: float = 0.0,
        boot_s: float = 0.3,
        baud: int = 9600,
    ) -> None:
        """Start powered with the stored settings."""
        self.temperature_c = 20.0
        self.pitch_deg = 0.0
        self.roll_deg = 0.0
        self.magnetometer_works = True
        self.saves = 0
        self._attitude = attitude
        self._rng = rng
        self._mounting = mounting
        self._locks_reads = locks_reads
        self._noise_deg = noise_deg
        self._tilt_noise_deg = tilt_noise_deg
        self._turn_noise_deg_s = turn_noise_deg_s
        self._drift_deg_s = drift_deg_s
        self._declination_deg = declination_deg
        self._error_ppm = frequency_error_ppm
        self._boot_s = boot_s
        self.transmitter = Transmitter(baud)
        self._received = ReceiveBuffer(max_bytes=64)
        self._stored = _FACTORY | (registers or {})
        self._pace: Pace | None = None
        self._switch_on(0.0)

    def receive(self, now_s: float, data: bytes) -> None:
        """Process commands."""
        if now_s < self._ready_s or not data:
            return
        self._received.append(now_s, data)
        buffer = self._received.data
        while len(buffer) >= 5:
            if buffer[:2] != b"\xff\xaa":
                del buffer[0]
                continue
            register, value = buffer[2], buffer[3] + 256 * buffer[4]
            del buffer[:5]
            self._execute(now_s, register, value)

    def next_output_s(self) -> float:
        """Return when the next packets are sampled or complete."""
        return min(math.inf if self._pace is None else self._pace.next_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete packets."""
        if self._pace is not None:
            for sample_s in self._pace.take(now_s):
                self.transmitter.send(sample_s, self._packets(sample_s))
        return self.transmitter.take(now_s)

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:
        """Interrupt the power for off_s (infinity: until the next call); settings that are not saved are lost."""
        self.transmitter.clear()
        self._received.clear()
        self._switch_on(now_s + off_s + self._boot_s)

    def _switch_on(self, ready_s: float) -> None:
        self._ready_s = ready_s
        self._registers = dict(self._stored)
        self._locked_s = -math.inf  # time from which the registers are locked
        self._yaw_origin_deg: float | None = None
        self._set_pace(ready_s)

    def _set_pace(self, now_s: float) -> None:
        rate_hz = _RATES_HZ.get(self._registers[_RATE])
        self._pace = None
        if rate_hz is not None and math.isfinite(now_s):
            self._pace = Pace(1.0 / rate_hz, start_s=now_s + 1.0 / rate_hz, error_ppm=self._error_ppm)

    def _execute(self, now_s: float, register: int, value: int) -> None:
        is_unlocked = now_s < self._locked_s
        if register == _KEY:
            self._locked_s = now_s + _UNLOCKED_S if value == _UNLOCK_VALUE else -math.inf
        elif register == _READ and (is_unlocked or not self._locks_reads):
            numbers = [self._registers.get(value + index, 0) for index in range(4)]
            self.transmitter.send(now_s + _REPLY_DELAY_S, _packet(_REGISTERS_PACKET, struct.pack("<4H", *numbers)))
        elif register == _SAVE and is_unlocked and value == 0:
            self._stored = dict(self._registers)
            self.saves += 1
        elif register in self._registers and is_unlocked:
            self._registers[register] = value
            self._set_pace(now_s)

    def _packets(self, now_s: float) -> bytes:
        heading_rad = self._attitude.heading_rad() - math.radians(self._declination_deg)
        orientation = sensor_in_ned(
            self._mounting, heading_rad, math.radians(self.pitch_deg), math.radians(self.roll_deg)
        )
        down_g = to_sensor(orientation, (0.0, 0.0, 1.0))
        acceleration = [-part / 16.0 * 32768.0 for part in _right_ahead_up(down_g)]  # at rest 1 g upward
        turn_deg_s = math.degrees(self._attitude.yaw_rate_rad_s())
        rates_deg_s = [
            part + self._rng.normal(0.0, self._turn_noise_deg_s)
            for part in _right_ahead_up(to_sensor(orientation, (0.0, 0.0, turn_deg_s)))
        ]
        field = _right_ahead_up(to_sensor(orientation, _FIELD_NED_MG)) if self.magnetometer_works else (0.0, 0.0, 0.0)
        temperature = round(self.temperature_c * 100.0)
        # By bit of the content register: acceleration (full scale 16 g), rate (2000 deg/s), angle (180 deg), field.
        contents = {
            1: (*acceleration, temperature),
            2: (*(rate / 2000.0 * 32768.0 for rate in rates_deg_s), temperature),
            3: (
                *(angle / 180.0 * 32768.0 for angle in self._angles_deg(now_s, to_right_ahead_up(orientation))),
                _VERSION,
            ),
            4: (*field, temperature),
        }
        return b"".join(
            _packet(_FIRST_PACKET + bit, struct.pack("<4h", *(_limit(number) for number in numbers)))
            for bit, numbers in contents.items()
            if self._registers[_CONTENT] >> bit & 1
        )

    def _angles_deg(self, now_s: float, orientation: tuple[float, float, float, float]) -> Vector:
        roll_deg, pitch_deg, yaw_deg = euler_deg(orientation)
        if self._registers[_SIX_AXES]:
            if self._yaw_origin_deg is None:
                self._yaw_origin_deg = yaw_deg
            yaw_deg += self._drift_deg_s * (now_s - self._ready_s) - self._yaw_origin_deg
        return (
            math.remainder(roll_deg + self._rng.normal(0.0, self._tilt_noise_deg), 360.0),
            max(-90.0, min(90.0, pitch_deg + self._rng.normal(0.0, self._tilt_noise_deg))),
            math.remainder(yaw_deg + self._rng.normal(0.0, self._noise_deg), 360.0),
        )


def _right_ahead_up(vector: Vector) -> Vector:
    """Return a vector in forward, starboard and down of the sensor in its axes x, y, z."""
    return vector[1], vector[0], -vector[2]


def _limit(number: float) -> int:
    return max(-32768, min(32767, round(number)))


def _packet(kind: int, content: bytes) -> bytes:
    body = bytes((0x55, kind)) + content
    return body + bytes((sum(body) % 256,))


def _make(context: DeviceContext) -> Device:
    return WitmotionEmulator(
        context.world,
        context.rng,
        mounting=context.options.mounting,
        declination_deg=context.declination_deg,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="witmotion", baud=9600, make=_make)
