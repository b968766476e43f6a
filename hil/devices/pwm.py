"""A hobby servo on a PWM output of the float computer."""

from __future__ import annotations

import math

from hil.devices.emulator import INTERFACE, Device, DeviceContext, EmulatedDevice
from hil.devices.hobby_servo import HobbyServo
from hil.devices.timing import ReceiveBuffer, Transmitter

MAX_LINE_BYTES = 32


class PwmEmulator:
    """A servo that receives the pulse widths written to `duty_cycle`, in nanoseconds, one a line."""

    def __init__(self, servo: HobbyServo) -> None:
        """Start without pulses."""
        self.servo = servo
        self.transmitter = Transmitter(115_200)  # never sends
        self._buffer = ReceiveBuffer(max_bytes=MAX_LINE_BYTES, pause_s=math.inf)

    def receive(self, now_s: float, data: bytes) -> None:
        """Use the pulse widths; text that is not a number has no effect, as in the kernel."""
        for piece in data.splitlines(keepends=True):
            self._buffer.append(now_s, piece)
            if piece.endswith(b"\n"):
                text = bytes(self._buffer.data).strip()
                self._buffer.clear()
                if text.isdigit():
                    self.servo.set_pulse(int(text) / 1e3 or None)

    def next_output_s(self) -> float:
        """Return infinity: a servo sends nothing."""
        return math.inf

    def take_output(self, now_s: float) -> bytes:  # noqa: ARG002 - part of Emulator
        """Return nothing."""
        return b""

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:  # noqa: ARG002 - the pulses continue
        """Release the servo; the next pulse width, which the autopilot writes every tick, moves it again."""
        self.servo.set_pulse(None)


def _make(context: DeviceContext) -> Device:
    return PwmEmulator(HobbyServo.calibrated(context.world.shaft, context.options))


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="pwm", baud=38400, make=_make)
