"""A BNO08x in its mode UART-RVC: 100 frames a second with a yaw that starts at 0 and drifts; it ignores input.

Source: BNO080 data sheet 1000-3927 (October 2017), section 1.3.5.2. Choices where it states no behaviour: yaw is
clockwise; the last frame before a power cut is complete. The frames are written byte by byte, independent of the
driver's codec.
"""

from __future__ import annotations

import math

import numpy as np

from hil.devices.emulator import INTERFACE, Attitude, Device, DeviceContext, EmulatedDevice
from hil.devices.timing import Pace, Transmitter

FRAMES_PER_S = 100
_ONE_G_MG = 1000.0


class Bno08xRvcEmulator:
    """A BNO08x with its x axis ahead.

    The drift of the yaw is the sum of a constant rate, `drift_deg_min`, and a random walk of `walk_deg_sqrt_s`, the
    integral of the noise of the gyroscope. `drift_deg_min`, `pitch_deg` and `roll_deg` may be set at any time.
    """

    def __init__(
        self,
        attitude: Attitude,
        rng: np.random.Generator,
        *,
        drift_deg_min: float = 0.5,
        walk_deg_sqrt_s: float = 0.014,
        tilt_noise_deg: float = 0.2,
        clockwise: bool = True,
        phase_s: float = 0.0,
        frequency_error_ppm: float = 0.0,
        boot_s: float = 0.3,
        baud: int = 115200,
    ) -> None:
        """Start with the power on; the first frame is sampled at phase_s."""
        self.drift_deg_min = drift_deg_min
        self.pitch_deg = 0.0
        self.roll_deg = 0.0
        self._attitude = attitude
        self._rng = rng
        self._walk_deg = walk_deg_sqrt_s / math.sqrt(FRAMES_PER_S)
        self._tilt_noise_deg = tilt_noise_deg
        self._direction = 1.0 if clockwise else -1.0
        self._error_ppm = frequency_error_ppm
        self._boot_s = boot_s
        self.transmitter = Transmitter(baud)
        self._start(phase_s)

    def receive(self, now_s: float, data: bytes) -> None:
        """Ignore input: there are no commands in this mode."""

    def next_output_s(self) -> float:
        """Return when the next frame is sampled or complete."""
        return min(self._pace.next_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete frames."""
        for sample_s in self._pace.take(now_s):
            self.transmitter.send(sample_s, self._next_frame())
        return self.transmitter.take(now_s)

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:
        """Interrupt the power for off_s; yaw and index begin at 0 again."""
        self.transmitter.clear()
        self._start(now_s + off_s + self._boot_s)

    def _start(self, start_s: float) -> None:
        """Start sending at start_s; the first frame defines yaw 0."""
        self._pace = Pace(1.0 / FRAMES_PER_S, start_s=start_s, error_ppm=self._error_ppm)
        self._initial_deg: float | None = None
        self._drift_deg = 0.0
        self._index = 0

    def _next_frame(self) -> bytes:
        heading_deg = math.degrees(self._attitude.heading_rad())
        if self._initial_deg is None:
            self._initial_deg = heading_deg
        self._drift_deg += self.drift_deg_min / (60.0 * FRAMES_PER_S) + self._rng.normal(0.0, self._walk_deg)
        yaw_deg = self._direction * (heading_deg - self._initial_deg + self._drift_deg)
        pitch_deg = self.pitch_deg + self._rng.normal(0.0, self._tilt_noise_deg)
        roll_deg = self.roll_deg + self._rng.normal(0.0, self._tilt_noise_deg)
        frame = pack_frame(self._index, yaw_deg, pitch_deg, roll_deg, gravity_mg(pitch_deg, roll_deg))
        self._index = (self._index + 1) % 256
        return frame


def gravity_mg(pitch_deg: float, roll_deg: float) -> tuple[int, int, int]:
    """Return the accelerations at rest, with the axes of the example in the data sheet."""
    pitch_rad, roll_rad = math.radians(pitch_deg), math.radians(roll_deg)
    return (
        round(-_ONE_G_MG * math.sin(roll_rad)),
        round(_ONE_G_MG * math.sin(pitch_rad) * math.cos(roll_rad)),
        round(_ONE_G_MG * math.cos(pitch_rad) * math.cos(roll_rad)),
    )


def pack_frame(
    index: int, yaw_deg: float, pitch_deg: float, roll_deg: float, acceleration_mg: tuple[int, int, int]
) -> bytes:
    """Return a frame; the yaw is wrapped to 180 degrees to either side."""
    yaw = (round(100.0 * yaw_deg) + 18_000) % 36_000 - 18_000
    numbers = (yaw, round(100.0 * pitch_deg), round(100.0 * roll_deg), *acceleration_mg)
    content = bytearray([index])
    for number in numbers:
        content.append(number % 256)
        content.append(number // 256 % 256)
    content += bytes(3)
    return b"\xaa\xaa" + bytes(content) + bytes([sum(content) % 256])


def _make(context: DeviceContext) -> Device:
    return Bno08xRvcEmulator(
        context.world,
        context.rng,
        clockwise=context.options.clockwise,
        phase_s=context.phase_s,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="bno08x_rvc", baud=115200, make=_make)
