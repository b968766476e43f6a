"""A Pololu Maestro servo controller with one hobby servo.

Source: Pololu Maestro Servo Controller User's Guide (0J40), sections 4.b, 4.e and 5.a to 5.e. Commands are read byte by
byte, in compact and in Pololu protocol. The acceleration limit is stored, but has no effect.
"""

from __future__ import annotations

import math

from hil.devices.emulator import INTERFACE, Device, DeviceContext, EmulatedDevice
from hil.devices.hobby_servo import HobbyServo
from hil.devices.timing import Transmitter

CHANNELS = 24
PERIOD_S = 0.020  # of the pulses, and of the steps of the speed limit
REPLY_DELAY_S = 0.0002
BOOT_S = 0.3
CRC_ERROR, PROTOCOL_ERROR = 1 << 3, 1 << 4
_POLOLU_PROTOCOL = 0xAA
_SET_TARGET, _SET_SPEED, _SET_ACCELERATION = 0x84, 0x87, 0x89
_GET_POSITION, _GET_MOVING_STATE, _GET_ERRORS, _GO_HOME = 0x90, 0x93, 0xA1, 0xA2
_DATA_BYTES = {
    **dict.fromkeys((_SET_TARGET, _SET_SPEED, _SET_ACCELERATION), 3),
    _GET_POSITION: 1,
    **dict.fromkeys((_GET_MOVING_STATE, _GET_ERRORS, _GO_HOME), 0),
}


class MaestroEmulator:
    """A Maestro whose channel `channel` drives a hobby servo; its other channels have no servo.

    `limits_us` are the pulse widths that the settings of the channels allow. With `detects_baud` commands are ignored
    until an 0xAA is received. `errors` is the error register. The home position of all channels is "Off".
    """

    def __init__(
        self,
        servo: HobbyServo,
        *,
        channel: int = 0,
        device: int = 12,
        crc: bool = False,
        limits_us: tuple[float, float] = (496.0, 2496.0),
        detects_baud: bool = False,
        baud: int = 115_200,
    ) -> None:
        """Start powered and booted; raise ValueError for an invalid channel."""
        if not 0 <= channel < CHANNELS:
            raise ValueError(f"channel {channel}: a Maestro has 0 to {CHANNELS - 1}")
        self.errors = 0
        self.transmitter = Transmitter(baud)
        self._servo = servo
        self._channel = channel
        self._device = device
        self._has_crc = crc
        self._limits = tuple(round(4.0 * limit_us) for limit_us in limits_us)  # in quarter microseconds
        self._detects_baud = detects_baud
        self._ready_s = -math.inf
        self._reset()

    def _reset(self) -> None:
        """Forget everything, as without power."""
        self.errors = 0
        self._packet: list[int] = []
        self._is_ignoring = self._detects_baud
        self._targets, self._positions = [0] * CHANNELS, [0] * CHANNELS  # in quarter microseconds
        self._speeds, self._accelerations = [0] * CHANNELS, [0] * CHANNELS
        self._step_s = math.inf  # time of the next step of a movement
        self.transmitter.clear()
        self._servo.set_pulse(None)

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:
        """Interrupt the power for off_s (infinity: until the next call); the servo is free until it has a target."""
        self._reset()
        self._ready_s = now_s + off_s + BOOT_S

    def receive(self, now_s: float, data: bytes) -> None:
        """Process commands."""
        self._move(now_s)
        if now_s < self._ready_s:
            return
        for byte in data:
            self._take(byte, now_s)

    def next_output_s(self) -> float:
        """Return when the next reply is complete or the position changes by the speed limit."""
        return min(self.transmitter.next_s(), self._step_s)

    def take_output(self, now_s: float) -> bytes:
        """Return the complete replies."""
        self._move(now_s)
        return self.transmitter.take(now_s)

    def _take(self, byte: int, now_s: float) -> None:
        if self._is_ignoring:
            if byte != _POLOLU_PROTOCOL:
                return
            self._is_ignoring = False
        if byte & 0x80:
            if self._packet:
                self._raise_error(PROTOCOL_ERROR)
            self._packet = [byte]
        elif self._packet:
            self._packet.append(byte)
        else:
            self._raise_error(PROTOCOL_ERROR)
            return
        self._execute_complete(now_s)

    def _execute_complete(self, now_s: float) -> None:
        """Execute the packet if it is complete."""
        packet = self._packet
        is_addressed = packet[0] == _POLOLU_PROTOCOL
        if is_addressed and len(packet) < 3:
            return
        command = packet[2] | 0x80 if is_addressed else packet[0]
        if command not in _DATA_BYTES:
            self._packet = []
            self._raise_error(PROTOCOL_ERROR)
            return
        first = 3 if is_addressed else 1
        if len(packet) < first + _DATA_BYTES[command] + self._has_crc:
            return
        self._packet = []
        if self._has_crc and divide(packet[:-1]) != packet[-1]:
            self._raise_error(CRC_ERROR)
        elif not is_addressed or packet[1] == self._device:
            self._execute(command, packet[first : first + _DATA_BYTES[command]], now_s)

    def _execute(self, command: int, data: list[int], now_s: float) -> None:
        if data and data[0] >= CHANNELS:
            self._raise_error(PROTOCOL_ERROR)
            return
        number = data[1] + 128 * data[2] if len(data) == 3 else 0
        if command == _SET_TARGET:
            low, high = self._limits
            self._targets[data[0]] = min(max(number, low), high) if number else 0
            self._start(data[0], now_s)
        elif command == _SET_SPEED:
            self._speeds[data[0]] = number
        elif command == _SET_ACCELERATION:
            self._accelerations[data[0]] = number
        elif command == _GET_POSITION:
            self._reply(now_s, self._positions[data[0]])
        elif command == _GET_MOVING_STATE:
            self._reply(now_s, int(self._positions != self._targets), size=1)
        elif command == _GET_ERRORS:
            self._reply(now_s, self.errors)
            self.errors = 0
        else:
            self._go_home()

    def _reply(self, now_s: float, number: int, size: int = 2) -> None:
        self.transmitter.send(now_s + REPLY_DELAY_S, number.to_bytes(size, "little"))

    def _raise_error(self, bit: int) -> None:
        self.errors |= bit
        self._go_home()

    def _go_home(self) -> None:
        self._targets, self._positions = [0] * CHANNELS, [0] * CHANNELS
        self._servo.set_pulse(None)

    def _start(self, channel: int, now_s: float) -> None:
        """Begin the movement of a channel; without a limit or a present position it is at its target at once."""
        target, position = self._targets[channel], self._positions[channel]
        if not self._speeds[channel] or not target or not position:
            self._positions[channel] = target
        elif math.isinf(self._step_s):
            self._step_s = now_s + PERIOD_S
        self._drive()

    def _move(self, now_s: float) -> None:
        """Advance the positions by the speed limits, which count in 0.25 us per 10 ms."""
        while self._step_s <= now_s:
            for channel, speed in enumerate(self._speeds):
                distance = self._targets[channel] - self._positions[channel]
                step = 2 * speed if speed else abs(distance)
                self._positions[channel] += max(-step, min(step, distance))
            self._step_s = self._step_s + PERIOD_S if self._positions != self._targets else math.inf
            self._drive()

    def _drive(self) -> None:
        position = self._positions[self._channel]
        self._servo.set_pulse(position / 4.0 if position else None)


def divide(message: list[int]) -> int:
    """Return the CRC-7 by the long division of section 5.d: bits least significant first, divisor 10001001."""
    bits = [byte >> bit & 1 for byte in message for bit in range(8)] + [0] * 7
    divisor = (1, 0, 0, 0, 1, 0, 0, 1)
    for start in range(8 * len(message)):
        if bits[start]:
            for offset, bit in enumerate(divisor):
                bits[start + offset] ^= bit
    return sum(bit << position for position, bit in enumerate(bits[-7:]))


def _make(context: DeviceContext) -> Device:
    options = context.options
    return MaestroEmulator(
        HobbyServo.calibrated(context.world.shaft, options),
        channel=options.channel,
        device=options.device,
        crc=options.crc,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="maestro", baud=115200, make=_make)
