"""A digital compass of RION or BWSENSING, which replies to requests or sends periodically.

Source: HCM370B user manual, HCM605B data sheet (frames with a status), BMR3000 technical manual (output rates). Choices
where these state no behaviour: a frame with a wrong checksum or another address is ignored; the output mode is lost
with the power unless it is saved; a reply follows after 10 ms.
"""

from __future__ import annotations

import math

import numpy as np

from hil.devices.emulator import INTERFACE, Attitude, Device, DeviceContext, EmulatedDevice
from hil.devices.mounting import euler_deg, sensor_in_ned
from hil.devices.timing import Pace, ReceiveBuffer, Transmitter

_REPLY_DELAY_S = 0.010
_ANY_ADDRESS = 0xFF
_RATES_HZ = {
    1: 5.0,
    2: 10.0,
    3: 20.0,
    4: 25.0,
    5: 50.0,
}  # by the output mode; in mode 0 the compass only replies to requests
_GET_ANGLES, _GET_DECLINATION, _SAVE, _SET_OUTPUT_MODE = 0x04, 0x07, 0x0A, 0x0C


class RionEmulator:
    """A compass with its label up and its mark ahead, or mounted otherwise.

    `with_status` sends the long frame. `declination_deg` is that of the location; `set_declination_deg` is the one that
    was set in the compass, which it adds. `pitch_deg` and `roll_deg` (of the boat), `distorted` and `clipped` may be
    set at any time.
    """

    def __init__(
        self,
        attitude: Attitude,
        rng: np.random.Generator,
        *,
        identifier: int = 0x68,
        address: int = 0,
        mounting: str = "none",
        with_status: bool = False,
        output_mode: int = 0,
        noise_deg: float = 0.3,
        tilt_noise_deg: float = 0.2,
        declination_deg: float = 0.0,
        set_declination_deg: float = 0.0,
        frequency_error_ppm: float = 0.0,
        boot_s: float = 0.3,
        baud: int = 9600,
    ) -> None:
        """Start powered in the output mode, which is saved."""
        self.pitch_deg = 0.0
        self.roll_deg = 0.0
        self.distorted = False
        self.clipped = False
        self._attitude = attitude
        self._rng = rng
        self._identifier = identifier
        self._address = address
        self._mounting = mounting
        self._with_status = with_status
        self._noise_deg = noise_deg
        self._tilt_noise_deg = tilt_noise_deg
        self._declination_deg = declination_deg
        self._set_declination_deg = set_declination_deg
        self._error_ppm = frequency_error_ppm
        self._boot_s = boot_s
        self._saved_mode = output_mode
        self._ready_s = 0.0
        self.transmitter = Transmitter(baud)
        self._received = ReceiveBuffer(max_bytes=64)
        self._pace: Pace | None = None
        self._set_mode(output_mode, 0.0)

    def receive(self, now_s: float, data: bytes) -> None:
        """Execute the commands and reply."""
        if now_s < self._ready_s or not data:
            return
        self._received.append(now_s, data)
        buffer = self._received.data
        while len(buffer) >= 5:
            size = buffer[1] + 1
            if buffer[0] != self._identifier or not 5 <= size <= 16:
                del buffer[0]
                continue
            if len(buffer) < size:
                return
            frame = bytes(buffer[:size])
            if sum(frame[1:-1]) % 256 != frame[-1]:
                del buffer[0]
                continue
            del buffer[:size]
            if frame[2] in (self._address, _ANY_ADDRESS):
                self._execute(now_s, frame[3], frame[4:-1])

    def next_output_s(self) -> float:
        """Return when the next frame is sampled or complete."""
        return min(math.inf if self._pace is None else self._pace.next_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete frames."""
        if self._pace is not None:
            for sample_s in self._pace.take(now_s):
                self.transmitter.send(sample_s, self._angles())
        return self.transmitter.take(now_s)

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:
        """Interrupt the power for off_s (infinity: until the next call); an unsaved output mode is lost."""
        self.transmitter.clear()
        self._received.clear()
        self._ready_s = now_s + off_s + self._boot_s
        self._set_mode(self._saved_mode, self._ready_s)

    def _execute(self, now_s: float, command: int, data: bytes) -> None:
        if command == _GET_ANGLES:
            reply = self._angles()
        elif command == _GET_DECLINATION:
            sign = "1" if self._set_declination_deg < 0.0 else "0"
            tenths = f"{sign}{round(abs(self._set_declination_deg) * 10.0):03d}"
            reply = self._frame(command, bytes.fromhex(tenths))
        elif command == _SET_OUTPUT_MODE and len(data) == 1 and (data[0] == 0 or data[0] in _RATES_HZ):
            self._mode = data[0]
            self._set_mode(data[0], now_s)
            reply = self._frame(command, b"\x00")
        elif command == _SAVE:
            self._saved_mode = self._mode
            reply = self._frame(command, b"\x00")
        else:
            reply = self._frame(command, b"\xff")
        self.transmitter.send(now_s + _REPLY_DELAY_S, reply)

    def _set_mode(self, mode: int, now_s: float) -> None:
        self._mode = mode
        self._pace = None
        if mode and math.isfinite(now_s):
            period_s = 1.0 / _RATES_HZ[mode]
            self._pace = Pace(period_s, start_s=now_s + period_s, error_ppm=self._error_ppm)

    def _angles(self) -> bytes:
        heading_rad = self._attitude.heading_rad() - math.radians(self._declination_deg)
        orientation = sensor_in_ned(
            self._mounting, heading_rad, math.radians(self.pitch_deg), math.radians(self.roll_deg)
        )
        roll_deg, pitch_deg, yaw_deg = euler_deg(orientation)
        pitch_deg = max(-90.0, min(90.0, pitch_deg + self._rng.normal(0.0, self._tilt_noise_deg)))
        roll_deg = math.remainder(roll_deg + self._rng.normal(0.0, self._tilt_noise_deg), 360.0)
        yaw_deg += self._rng.normal(0.0, self._noise_deg) + self._set_declination_deg
        angles = "".join(map(_decimal, (pitch_deg, roll_deg, yaw_deg % 360.0)))
        status = bytes((self.distorted | self.clipped << 3,)) if self._with_status else b""
        return self._frame(_GET_ANGLES, bytes.fromhex(angles) + status)

    def _frame(self, command: int, data: bytes) -> bytes:
        """Return the reply to a command, whose code is that of the command plus 0x80."""
        summed_bytes = bytes((4 + len(data), self._address, command + 0x80)) + data
        return bytes((self._identifier,)) + summed_bytes + bytes((sum(summed_bytes) % 256,))


def _decimal(angle_deg: float) -> str:
    """Return an angle in 0.01 degrees as a sign (1: negative) and five decimal digits."""
    digits = f"{abs(angle_deg):06.2f}".replace(".", "")
    return ("1" if angle_deg < 0.0 else "0") + digits


def _make(context: DeviceContext) -> Device:
    return RionEmulator(
        context.world,
        context.rng,
        identifier=0x77 if context.options.identifier == "77" else 0x68,
        address=context.options.address,
        mounting=context.options.mounting,
        declination_deg=context.declination_deg,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="rion", baud=9600, make=_make)
