"""A Feetech STS3215 on a half-duplex line: frames, memory table, lock, protections.

Sources: Feetech, "Servo SCS communication protocol" and the memory tables of the STS and SMS series. The supply is that
of the 12 V model. Comments mark choices where these documents state no behaviour; the currents while it moves and holds
are assumed.
"""

from __future__ import annotations

import math

import numpy as np

from hil.devices.emulator import INTERFACE, Device, DeviceContext, EmulatedDevice, Shaft
from hil.devices.timing import ReceiveBuffer, Transmitter

BAUD = 1_000_000
_BAUD_RATES = (1_000_000, 500_000, 250_000, 128_000, 115_200, 76_800, 57_600, 38_400)
_BROADCAST = 254
_PING, _READ, _WRITE, _REG_WRITE, _ACTION, _RESTART, _SYNC_READ, _SYNC_WRITE = 1, 2, 3, 4, 5, 8, 0x82, 0x83
_MAX_FRAME_BYTES, _MAX_READ = 259, 250
_REPLY_DELAY_S = 20e-6  # of STS servos; they ignore register 7
_COUNTS_PER_RADIAN, _CENTRE = 4096 / math.tau, 2048
_HOLDING_A, _MOVING_A, _STALL_A = 0.02, 0.18, 2.7
_CURRENT_UNIT_A = 0.0065
_CURRENT_NOISE_A, _VOLTAGE_NOISE_V = 0.006, 0.02
_IN_POSITION_COUNTS = 10  # a smaller distance is not a stall
_VOLTAGE, _OVERHEATING, _OVERLOAD = 0x01, 0x04, 0x20
_TABLE_BYTES, _FIRST_RAM, _FIRST_READ_ONLY = 87, 40, 56
# Addresses of the memory table.
_ID, _BAUD_RATE, _RETURN_LEVEL, _MIN_POSITION, _MAX_POSITION = 5, 6, 8, 9, 11
_MAX_TEMPERATURE, _MAX_VOLTAGE, _MIN_VOLTAGE, _MAX_TORQUE, _PROTECTIONS = 13, 14, 15, 16, 19
_POSITION_OFFSET, _OPERATING_MODE, _OVERLOAD_CURRENT, _OVERLOAD_TIME = 31, 33, 34, 35
_TORQUE_SWITCH, _GOAL_POSITION, _GOAL_SPEED, _TORQUE_LIMIT, _LOCK = 40, 42, 46, 48, 55
_PRESENT_POSITION, _PRESENT_VOLTAGE, _PRESENT_TEMPERATURE, _IS_REGISTERED, _STATUS = 56, 62, 63, 64, 65
_MOVING, _PRESENT_GOAL, _PRESENT_CURRENT = 66, 67, 69
_POSITION_MODE = 0
_CALIBRATE = 128  # written to the torque switch, makes the present position 2048
# Initial values of the memory table: address, value, number of bytes. Addresses without a constant: 0 and 1 firmware,
# 3 model, 20 LED alarm, 26 and 27 dead zone, 28 protection current, 30 resolution, 36 overload torque, 38 overcurrent
# time, from 80 factory settings.
_EEPROM = (
    *((0, 3, 1), (1, 10, 1), (3, 777, 2), (8, 1, 1), (9, 0, 2), (11, 4095, 2), (13, 70, 1), (14, 140, 1), (15, 40, 1)),
    *((16, 1000, 2), (19, 0x2C, 1), (20, 0x2F, 1), (26, 1, 1), (27, 1, 1), (28, 500, 2), (30, 1, 1), (34, 20, 1)),
    *((35, 200, 1), (36, 80, 1), (38, 200, 1), (80, 1, 1), (84, 75, 1)),
)


class FeetechEmulator:
    """An STS3215 that turns a shaft; `table` is its memory, of which the EEPROM area is also in `stored`.

    With `collisions`, an instruction that arrives during a reply destroys both, as on RS-485. `voltage_v`,
    `temperature_c` and `load_a` may be set at any time; beyond the limits of the table they raise the error of a real
    servo.
    """

    def __init__(
        self,
        shaft: Shaft,
        rng: np.random.Generator,
        *,
        device_id: int = 1,
        baud: int = BAUD,
        collisions: bool = False,
        boot_s: float = 0.4,
    ) -> None:
        """Start powered with torque off; raise ValueError for an invalid id or baud rate."""
        if not (0 <= device_id <= 253 and baud in _BAUD_RATES):
            raise ValueError(f"id {device_id} or {baud} baud is out of range")
        self.voltage_v, self.temperature_c, self.load_a = 12.0, 25.0, 0.0
        self.energy_j = 0.0  # used so far; each measured current counts for the time since the previous one
        self.collision_count = 0
        self._energy_s: float | None = None
        self._shaft, self._rng = shaft, rng
        self._collisions, self._boot_s = collisions, boot_s
        self.stored = bytearray(_TABLE_BYTES)
        for address, value, size in (*_EEPROM, (_ID, device_id, 1), (_BAUD_RATE, _BAUD_RATES.index(baud), 1)):
            self.stored[address : address + size] = value.to_bytes(size, "little")
        self.table = bytearray(self.stored)
        self._buffer = ReceiveBuffer(max_bytes=2 * _MAX_FRAME_BYTES)
        self.transmitter = Transmitter(baud)
        self._ready_s = -math.inf
        self._restart()

    # ------------------------------------------------------------------ line

    def receive(self, now_s: float, data: bytes) -> None:
        """Process instructions; there is no reply to a bad sum, another id or an unknown instruction."""
        self._observe(now_s)
        if now_s < self._ready_s or not data:
            return
        begin_s = now_s - len(data) * 10 / self.transmitter.baud
        if self._collisions and self.transmitter.occupies(begin_s, now_s):
            self.transmitter.clear()
            self._buffer.clear()
            self.collision_count += 1
            return
        self._buffer.append(now_s, data)
        buffer = self._buffer.data
        while len(buffer) >= 4 and now_s >= self._ready_s:
            size = buffer[3] + 4
            if buffer[:2] != b"\xff\xff" or buffer[2] == 0xFF or buffer[3] < 2:
                del buffer[0]
            elif len(buffer) < size:
                break
            elif sum(buffer[2 : size - 1]) % 256 + buffer[size - 1] != 255:
                del buffer[0]
            else:
                device_id, code, parameters = buffer[2], buffer[4], bytes(buffer[5 : size - 1])
                del buffer[:size]
                if device_id in (self.table[_ID], _BROADCAST):
                    self._execute(now_s, device_id, code, parameters)

    def next_output_s(self) -> float:
        """Return when the next reply is complete."""
        return self.transmitter.next_s()

    def take_output(self, now_s: float) -> bytes:
        """Update the protections and return the complete replies."""
        self._observe(now_s)
        return self.transmitter.take(now_s)

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:
        """Interrupt the power for off_s (infinity: until the next call); only the stored values are kept."""
        self.transmitter.clear()
        self._buffer.clear()
        self._restart()
        self._ready_s = now_s + off_s + self._boot_s

    def _restart(self) -> None:
        self._shaft.set_torque(on=False)
        self.table[:] = self.stored
        # Choice: the table has 0, with which the torque switch would move the shaft.
        self._put(_GOAL_POSITION, self._position_counts(), 2)
        self._put(_GOAL_SPEED, 3400, 2)
        self.table[_TORQUE_LIMIT : _TORQUE_LIMIT + 2] = self.table[_MAX_TORQUE : _MAX_TORQUE + 2]
        self.table[_LOCK] = 1
        self._registered = b""
        self._is_overloaded = False
        self._stalled_s: float | None = None
        self._observed_s, self._observed_rad = -math.inf, self._shaft.angle_rad()
        self._is_moving = False

    # ------------------------------------------------------------------ instructions

    def _execute(self, now_s: float, device_id: int, code: int, parameters: bytes) -> None:
        own_id, level = self.table[_ID], self.table[_RETURN_LEVEL]  # a new id applies after the reply
        is_single = device_id != _BROADCAST
        if code == _PING and not parameters:
            self._reply(now_s, own_id)
        elif code == _READ and is_single and len(parameters) == 2 and parameters[1] <= _MAX_READ:
            self._read(now_s, own_id, *parameters)
        elif code == _SYNC_READ and not is_single and own_id in parameters[2:] and parameters[1] <= _MAX_READ:
            self._read(now_s, own_id, *parameters[:2])  # without other servos there are no other replies to wait for
        elif code == _SYNC_WRITE and not is_single and len(parameters) > 2:
            self._sync_write(now_s, own_id, parameters)
        elif code in (_WRITE, _REG_WRITE, _ACTION) and (code == _ACTION or len(parameters) >= 2):
            if code == _WRITE:
                self._write(now_s, parameters[0], parameters[1:])
            else:
                self._register(now_s, parameters)
            if is_single and level:
                self._reply(now_s, own_id)
        elif code == _RESTART and not parameters:
            self._restart()
            self._ready_s = now_s + self._boot_s

    def _reply(self, now_s: float, own_id: int, data: bytes = b"") -> None:
        frame = [0xFF, 0xFF, own_id, len(data) + 2, self.table[_STATUS], *data]
        self.transmitter.send(now_s + _REPLY_DELAY_S, bytes([*frame, 255 - sum(frame[2:]) % 256]))
        self.transmitter.baud = _BAUD_RATES[min(self.table[_BAUD_RATE], 7)]  # a new baud rate applies after the reply

    def _read(self, now_s: float, own_id: int, address: int, count: int) -> None:
        self._measure(now_s)
        data = bytes(self.table[address : address + count])
        self._reply(now_s, own_id, data.ljust(count, b"\x00"))  # choice: beyond the table it reads zeros

    def _sync_write(self, now_s: float, own_id: int, parameters: bytes) -> None:
        address, count = parameters[:2]
        for start in range(2, len(parameters) - count, count + 1):
            if parameters[start] == own_id:
                self._write(now_s, address, parameters[start + 1 : start + 1 + count])

    def _register(self, now_s: float, parameters: bytes) -> None:
        """Register a write for the next ACTION; without parameters, execute the registered one."""
        if not parameters and self._registered:
            self._write(now_s, self._registered[0], self._registered[1:])
        self._registered = parameters
        self.table[_IS_REGISTERED] = int(bool(parameters))

    def _write(self, now_s: float, address: int, data: bytes) -> None:
        """Write the registers that are not read-only, in the order of their addresses."""
        torque = self.table[_TORQUE_SWITCH]
        for place, value in enumerate(data, address):
            if not _ID <= place < _FIRST_READ_ONLY:
                continue
            if place == _TORQUE_SWITCH and value == _CALIBRATE:
                offset = self._raw_counts() - _CENTRE
                code = abs(offset) | (0x800 if offset < 0 else 0)
                for area in (self.stored, self.table):
                    area[_POSITION_OFFSET : _POSITION_OFFSET + 2] = code.to_bytes(2, "little")
                continue
            self.table[place] = value
            if place < _FIRST_RAM and self.table[_LOCK] == 0:
                self.stored[place] = value
        if self.table[_TORQUE_SWITCH] != torque or address <= _TORQUE_SWITCH < address + len(data):
            self._is_overloaded = False  # choice: a write to the torque switch ends the overload protection
            self._shaft.set_torque(on=self.table[_TORQUE_SWITCH] == 1)
            self._stalled_s = None
        self._observe(now_s)
        self._move()

    # ------------------------------------------------------------------ motor

    def _put(self, address: int, value: int, size: int) -> None:
        """Store a value; bit 15 is the sign of a word."""
        magnitude = abs(value) | (0x8000 if value < 0 else 0)
        self.table[address : address + size] = magnitude.to_bytes(size, "little")

    def _get(self, address: int) -> int:
        """Return a word whose bit 15 is the sign of its magnitude."""
        word = self.table[address] + 256 * self.table[address + 1]
        return 0x8000 - word if word >= 0x8000 else word

    def _raw_counts(self) -> int:
        return round(self._shaft.angle_rad() * _COUNTS_PER_RADIAN) + _CENTRE

    def _position_counts(self) -> int:
        return (self._raw_counts() - self._offset()) % 4096

    def _offset(self) -> int:
        """Return the position offset, whose sign is bit 11."""
        code = self._get(_POSITION_OFFSET)
        return 0x800 - code if code & 0x800 else code

    def _goal_counts(self) -> int:
        low, high = self._get(_MIN_POSITION), self._get(_MAX_POSITION)
        return min(max(self._get(_GOAL_POSITION), low), high) if low < high else self._get(_GOAL_POSITION)

    def _distance_counts(self) -> int:
        return self._goal_counts() - self._position_counts()

    def _is_driving(self) -> bool:
        return self.table[_TORQUE_SWITCH] == 1 and self.table[_OPERATING_MODE] == _POSITION_MODE

    def _move(self) -> None:
        """Move to the goal, unless a protection has unloaded the motor."""
        if self._is_driving() and not self._is_overloaded:
            counts = math.remainder(self._goal_counts() + self._offset() - _CENTRE, 4096)
            self._shaft.set_target(counts / _COUNTS_PER_RADIAN)
        else:
            self._shaft.set_target(self._shaft.angle_rad())

    def _observe(self, now_s: float) -> None:
        """Update the motion since the last call and the status."""
        if now_s < self._ready_s:
            return
        if now_s - self._observed_s >= 1e-3:
            angle_rad = self._shaft.angle_rad()
            self._is_moving = abs(angle_rad - self._observed_rad) > 1e-7
            is_stalled = (
                self._is_driving() and not self._is_moving and abs(self._distance_counts()) > _IN_POSITION_COUNTS
            )
            self._stalled_s = (now_s if self._stalled_s is None else self._stalled_s) if is_stalled else None
            self._observed_s, self._observed_rad = now_s, angle_rad
        is_overload = self._stalled_s is not None and now_s - self._stalled_s >= self.table[_OVERLOAD_TIME] * 0.01
        if is_overload and self.table[_PROTECTIONS] & _OVERLOAD:
            self._is_overloaded = True
            self._move()
        is_voltage_wrong = not self.table[_MIN_VOLTAGE] <= self.voltage_v * 10.0 <= self.table[_MAX_VOLTAGE]
        is_hot = self.temperature_c > self.table[_MAX_TEMPERATURE]
        self.table[_STATUS] = is_voltage_wrong * _VOLTAGE | is_hot * _OVERHEATING | self._is_overloaded * _OVERLOAD
        if self.table[_STATUS] & self.table[_PROTECTIONS] & ~_OVERLOAD and self.table[_TORQUE_SWITCH]:
            self.table[_TORQUE_SWITCH] = 0  # choice: unloading switches the torque off
            self._shaft.set_torque(on=False)

    def _measure(self, now_s: float) -> None:
        """Set the feedback registers."""
        motor_a = self._current_a()
        self.energy_j += 0.0 if self._energy_s is None else motor_a * self.voltage_v * (now_s - self._energy_s)
        self._energy_s = now_s
        current = round((motor_a + _CURRENT_NOISE_A * self._rng.standard_normal()) / _CURRENT_UNIT_A)
        voltage = round((self.voltage_v + _VOLTAGE_NOISE_V * self._rng.standard_normal()) * 10.0)
        self._put(_PRESENT_POSITION, self._position_counts(), 2)
        self.table[_PRESENT_VOLTAGE] = min(max(voltage, 0), 255)
        self.table[_PRESENT_TEMPERATURE] = round(self.temperature_c) % 256
        self.table[_MOVING] = int(self._is_driving() and self._distance_counts() != 0)
        self._put(_PRESENT_GOAL, self._goal_counts(), 2)
        self._put(_PRESENT_CURRENT, current, 2)

    def _current_a(self) -> float:
        if self.table[_TORQUE_SWITCH] != 1:
            return 0.0
        if self._stalled_s is not None:
            return _STALL_A * (self.table[_OVERLOAD_CURRENT] / 100.0 if self._is_overloaded else 1.0)
        return self.load_a + (_MOVING_A if self._is_moving else _HOLDING_A)


def _make(context: DeviceContext) -> Device:
    return FeetechEmulator(context.world.shaft, context.rng, device_id=context.options.id, baud=context.baud)


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="feetech", baud=BAUD, make=_make)
