"""A Volz DA servo on RS-485: commands and replies of six bytes, without error codes.

Source: the Volz DA 26 RS-485 protocol specification. The two argument bytes of the current, voltage and temperature
replies are two channels (first supply or motor, second supply or circuit board).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from firmware_py.common.angles import RADIANS_PER_DEGREE, clamp, degrees
from hil.devices.crc import crc16_8005
from hil.devices.emulator import INTERFACE, Device, DeviceContext, EmulatedDevice, Shaft
from hil.devices.timing import ReceiveBuffer, Transmitter

BAUD = 115_200
_FRAME_BYTES = 6
_CRC_START = 0xFFFF
_SET_POSITION, _POSITION_IS = 0xDC, 0x2C
_GET_CURRENT, _CURRENT_IS = 0xB0, 0x30
_GET_VOLTAGE, _VOLTAGE_IS = 0xB1, 0x31
_GET_TEMPERATURE, _TEMPERATURE_IS = 0xC0, 0x10
_CENTRE_COUNTS, _MIN_COUNTS, _MAX_COUNTS = 0x0800, 0x0080, 0x0F80
_COUNTS_PER_DEGREE = (_MAX_COUNTS - _CENTRE_COUNTS) / 100.0
_CURRENT_UNIT_A, _VOLTAGE_UNIT_V, _TEMPERATURE_OFFSET_C = 0.02, 0.2, 50.0
_HOLDING_A, _MOVING_A = 0.1, 0.8
_CURRENT_NOISE_A, _VOLTAGE_NOISE_V = 0.02, 0.05
_AT_TARGET_RAD = 0.2 * RADIANS_PER_DEGREE
_REPLY_DELAY_S = 0.00052  # with two frames of 0.52 ms this is the 1.56 ms of an exchange


class VolzEmulator:
    """A DA servo that turns a shaft; its motor is engaged while it is powered.

    `limits_deg` are its programmed electrical end points, within +-100 deg.
    `voltage_v`, `temperature_c` and `load_a` may be set at any time.
    """

    def __init__(
        self,
        shaft: Shaft,
        rng: np.random.Generator,
        *,
        device_id: int = 1,
        limits_deg: tuple[float, float] = (-100.0, 100.0),
        boot_s: float = 0.3,
        baud: int = BAUD,
    ) -> None:
        """Start powered; raise ValueError for an invalid id or invalid limits."""
        low_deg, high_deg = limits_deg
        if not (0 <= device_id <= 0xFF and -100.0 <= low_deg < high_deg <= 100.0):
            raise ValueError(f"id {device_id}, limits {limits_deg} deg: out of range")
        self.voltage_v = 24.0
        self.temperature_c = 25.0
        self.load_a = 0.0  # additional current, as from a shaft with friction
        self.energy_j = 0.0  # used so far; the power is assumed constant between two commands
        self._energy_s: float | None = None
        self._power_w = 0.0
        self._shaft = shaft
        self._rng = rng
        self._device_id = device_id
        self._limits_deg = limits_deg
        self._boot_s = boot_s
        self._target_rad = shaft.angle_rad()
        self._buffer = ReceiveBuffer(max_bytes=16 * _FRAME_BYTES)
        self.transmitter = Transmitter(baud)
        self._ready_s = -math.inf
        self._is_booting = True
        self._commands: dict[int, tuple[int, Callable[[int], int]]] = {
            _SET_POSITION: (_POSITION_IS, self._set_position),
            _GET_CURRENT: (_CURRENT_IS, lambda _: _pack_bytes(self._measure_current_a() / _CURRENT_UNIT_A, 0.0)),
            _GET_VOLTAGE: (_VOLTAGE_IS, lambda _: _pack_bytes(self._measure_voltage_v() / _VOLTAGE_UNIT_V, 0.0)),
            _GET_TEMPERATURE: (
                _TEMPERATURE_IS,
                lambda _: _pack_bytes(*[self.temperature_c + _TEMPERATURE_OFFSET_C] * 2),
            ),
        }
        self._boot_when_ready(0.0)

    def receive(self, now_s: float, data: bytes) -> None:
        """Process commands; there is no reply to a bad CRC, another id or an unknown command."""
        self._boot_when_ready(now_s)
        if self._is_booting or not data:
            return
        self._buffer.append(now_s, data)
        buffer = self._buffer.data
        while len(buffer) >= _FRAME_BYTES:
            body = bytes(buffer[:4])
            if crc16_8005(body, _CRC_START) == int.from_bytes(buffer[4:_FRAME_BYTES], "big"):
                del buffer[:_FRAME_BYTES]
                self._execute(now_s, body)
            else:
                del buffer[:1]

    def next_output_s(self) -> float:
        """Return when the next reply is complete or the servo has booted."""
        boot_s = self._ready_s if self._is_booting else math.inf
        return min(self.transmitter.next_s(), boot_s)

    def take_output(self, now_s: float) -> bytes:
        """Return the complete replies."""
        self._boot_when_ready(now_s)
        return self.transmitter.take(now_s)

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:
        """Interrupt the power for off_s (infinity: until the next call); the shaft is free until then."""
        self.transmitter.clear()
        self._buffer.clear()
        self._shaft.set_torque(on=False)
        self._ready_s = now_s + off_s + self._boot_s
        self._is_booting = True

    def _boot_when_ready(self, now_s: float) -> None:
        """Engage at the present angle once the servo has booted."""
        if self._is_booting and now_s >= self._ready_s:
            self._is_booting = False
            self._target_rad = self._shaft.angle_rad()
            self._shaft.set_target(self._target_rad)
            self._shaft.set_torque(on=True)

    def _execute(self, now_s: float, body: bytes) -> None:
        command, device_id = body[0], body[1]
        if device_id != self._device_id or command not in self._commands:
            return
        self.energy_j += 0.0 if self._energy_s is None else self._power_w * (now_s - self._energy_s)
        self._energy_s, self._power_w = now_s, self._motor_current_a() * self.voltage_v
        reply_code, run_command = self._commands[command]
        frame = bytes([reply_code, device_id]) + run_command(int.from_bytes(body[2:], "big")).to_bytes(2, "big")
        self.transmitter.send(now_s + _REPLY_DELAY_S, frame + crc16_8005(frame, _CRC_START).to_bytes(2, "big"))

    def _set_position(self, argument: int) -> int:
        """Move to a position within protocol and electrical limits; return the present position."""
        target_deg = (clamp(argument, _MIN_COUNTS, _MAX_COUNTS) - _CENTRE_COUNTS) / _COUNTS_PER_DEGREE
        self._target_rad = clamp(target_deg, *self._limits_deg) * RADIANS_PER_DEGREE
        self._shaft.set_target(self._target_rad)
        counts = round(degrees(self._shaft.angle_rad()) * _COUNTS_PER_DEGREE) + _CENTRE_COUNTS
        return int(clamp(counts, 0, 0x0FFF))

    def _motor_current_a(self) -> float:
        is_at_target = abs(self._shaft.angle_rad() - self._target_rad) < _AT_TARGET_RAD
        return self.load_a + (_HOLDING_A if is_at_target else _MOVING_A)

    def _measure_current_a(self) -> float:
        return self._motor_current_a() + self._rng.normal(0.0, _CURRENT_NOISE_A)

    def _measure_voltage_v(self) -> float:
        return self.voltage_v + self._rng.normal(0.0, _VOLTAGE_NOISE_V)


def _pack_bytes(first: float, second: float) -> int:
    """Return two values as the two argument bytes."""
    high, low = (int(clamp(round(value), 0, 0xFF)) for value in (first, second))
    return high << 8 | low


def _make(context: DeviceContext) -> Device:
    return VolzEmulator(context.world.shaft, context.rng, device_id=context.options.id, baud=context.baud)


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="volz", baud=115200, make=_make)
