"""A Robotis Dynamixel XW540-T260 on a half-duplex line: packets, control table, protections.

Position modes (3, 4, 5) move the shaft; the others accept their goals without motion. Profile velocity and acceleration
have no effect: the shaft determines the slew. Comments mark choices where the e-Manual states no behaviour.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from hil.devices.dynamixel_frame import ALERT_BIT, BROADCAST_ID, Fault, Instruction, Packet, PacketReader, status_packet
from hil.devices.dynamixel_motor import MotorMonitor
from hil.devices.dynamixel_table import BAUD_RATES, WATCHDOG_TRIPPED, Address, ControlTable, Register
from hil.devices.emulator import INTERFACE, Device, DeviceContext, EmulatedDevice, Shaft
from hil.devices.timing import Transmitter, transfer_s

_DELAY_UNIT_S = 2e-6
_WATCHDOG_UNIT_S = 0.020
_GOAL_ADDRESSES = (Address.GOAL_PWM, Address.GOAL_CURRENT, Address.GOAL_VELOCITY, Address.GOAL_POSITION)

# Result of an instruction: error number and parameters of the reply, or None for no reply.
_Result = tuple[Fault, bytes] | None


class DynamixelEmulator:
    """An XW540-T260 that turns a shaft.

    With `collisions`, an instruction that arrives during a reply destroys both, as on RS-485. `motor.voltage_v`,
    `motor.temperature_c` and `motor.load_a` may be set at any time; beyond the limits of the control table they raise
    the hardware error of a real servo. A motor that stalls for `overload_s` shuts down.
    """

    def __init__(
        self,
        shaft: Shaft,
        rng: np.random.Generator,
        *,
        device_id: int = 1,
        baud: int = 57_600,
        return_delay: int = 250,
        collisions: bool = False,
        overload_s: float = 3.0,
        boot_s: float = 0.5,
    ) -> None:
        """Start powered with torque off; raise ValueError for an invalid id, baud rate or delay (in units of 2 us)."""
        if not (0 <= device_id <= 252 and baud in BAUD_RATES and 0 <= return_delay <= 254):
            raise ValueError(f"id {device_id}, {baud} baud or return delay {return_delay} is out of range")
        self.collision_count = 0
        self._collisions = collisions
        self._boot_s = boot_s
        self._table = ControlTable()
        self._table[Address.ID] = device_id
        self._table[Address.BAUD_RATE] = BAUD_RATES.index(baud)
        self._table[Address.RETURN_DELAY] = return_delay
        self.motor = MotorMonitor(shaft, rng, self._table, overload_s=overload_s)
        self._reader = PacketReader()
        self.transmitter = Transmitter(baud)
        self._registered: list[tuple[Register, int]] = []
        self._ready_s = -math.inf
        self._instruction_s = -math.inf
        self._executors: dict[int, Callable[[float, Packet], _Result]] = {
            Instruction.PING: self._ping,
            Instruction.READ: self._read,
            Instruction.WRITE: self._write,
            Instruction.REG_WRITE: self._reg_write,
            Instruction.ACTION: self._action,
            Instruction.REBOOT: self._reboot,
            Instruction.SYNC_READ: self._sync_read,
            Instruction.SYNC_WRITE: self._sync_write,
        }
        self._restart_ram()

    def receive(self, now_s: float, data: bytes) -> None:
        """Process instruction packets."""
        self._protect(now_s)
        if now_s < self._ready_s or not data:
            return
        begin_s = now_s - transfer_s(len(data), self.transmitter.baud)
        if self._collisions and self.transmitter.occupies(begin_s, now_s):
            self.transmitter.clear()
            self._reader.clear()
            self.collision_count += 1
            return
        for packet in self._reader.feed(now_s, data):
            if now_s >= self._ready_s:
                self._handle(now_s, packet)

    def next_output_s(self) -> float:
        """Return when the next reply is complete or the bus watchdog trips."""
        return min(self.transmitter.next_s(), self._watchdog_s())

    def take_output(self, now_s: float) -> bytes:
        """Update the protections and return the complete replies."""
        self._protect(now_s)
        return self.transmitter.take(now_s)

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:
        """Interrupt the power for off_s (infinity: until the next call); the EEPROM area is kept."""
        self.transmitter.clear()
        self._reader.clear()
        self._restart_ram()
        self._ready_s = now_s + off_s + self._boot_s

    @property
    def energy_j(self) -> float:
        """The energy that the motor has used so far."""
        return self.motor.energy_j

    def inject_error(self, bits: int) -> None:
        """Set bits of the hardware error status, like a fault inside the servo."""
        self.motor.raise_error(bits)

    # ------------------------------------------------------------------ packets

    def _handle(self, now_s: float, packet: Packet) -> None:
        sender_id = self._table[Address.ID]  # a new id applies after the reply to the write that changed it
        is_own = packet.device_id == sender_id
        is_broadcast = packet.device_id == BROADCAST_ID
        if packet.instruction == Instruction.STATUS:
            return
        if not packet.is_intact:
            if is_own:
                self._reply(now_s, sender_id, Fault.CRC)
            return
        self._instruction_s = now_s
        if not (is_own or is_broadcast):
            return
        execute = self._executors.get(packet.instruction)
        result = (Fault.INSTRUCTION, b"") if execute is None else execute(now_s, packet)
        level = self._table[Address.STATUS_RETURN_LEVEL]
        min_level = _MIN_RETURN_LEVELS.get(packet.instruction, 2)
        if result is not None and level >= min_level and (is_own or packet.instruction in _BROADCASTS_WITH_REPLY):
            self._reply(now_s, sender_id, *result)
        if packet.instruction == Instruction.REBOOT:
            self._restart_ram()
            self._ready_s = max(now_s, self.transmitter.last_s()) + self._boot_s

    def _reply(self, now_s: float, sender_id: int, fault: Fault, parameters: bytes = b"") -> None:
        error = fault | (ALERT_BIT if self._table[Address.HARDWARE_ERROR] else 0)
        delay_s = self._table[Address.RETURN_DELAY] * _DELAY_UNIT_S
        self.transmitter.send(now_s + delay_s, status_packet(sender_id, error, parameters))
        # A new baud rate applies from the next packet on.
        self.transmitter.baud = BAUD_RATES[self._table[Address.BAUD_RATE]]

    def _ping(self, _now_s: float, _packet: Packet) -> _Result:
        return Fault.NONE, self._read_table(Address.MODEL, 2) + self._read_table(Address.FIRMWARE, 1)

    def _read(self, now_s: float, packet: Packet) -> _Result:
        if len(packet.parameters) != 4:
            return Fault.LENGTH, b""
        self.motor.measure(now_s)
        address, count = _first_words(packet.parameters)
        data = self._table.read(address, count)
        return (Fault.ACCESS, b"") if data is None else (Fault.NONE, data)

    def _write(self, now_s: float, packet: Packet) -> _Result:
        return self._write_registers(now_s, packet.parameters[:2], packet.parameters[2:]), b""

    def _reg_write(self, _now_s: float, packet: Packet) -> _Result:
        writes = self._check_write(packet.parameters[:2], packet.parameters[2:])
        if isinstance(writes, Fault):
            return writes, b""
        self._registered = writes
        self._table[Address.REGISTERED] = 1
        return Fault.NONE, b""

    def _action(self, now_s: float, _packet: Packet) -> _Result:
        if not self._registered:
            return Fault.INSTRUCTION, b""
        writes, self._registered = self._registered, []
        self._table[Address.REGISTERED] = 0
        # The registers may have changed since the write was registered, so it is checked again.
        fault = next((fault for row, value in writes if (fault := self._fault_of_write(row, value))), Fault.NONE)
        if not fault:
            self._apply(now_s, writes)
        return fault, b""

    def _reboot(self, _now_s: float, _packet: Packet) -> _Result:
        return Fault.NONE, b""

    def _sync_read(self, now_s: float, packet: Packet) -> _Result:
        """Reply if addressed; without other servos on the line there are no other replies to wait for."""
        if packet.device_id != BROADCAST_ID or self._table[Address.ID] not in packet.parameters[4:]:
            return None
        return self._read(now_s, Packet(packet.device_id, Instruction.READ, packet.parameters[:4]))

    def _sync_write(self, now_s: float, packet: Packet) -> _Result:
        if packet.device_id != BROADCAST_ID or len(packet.parameters) < 4:
            return None
        _, count = _first_words(packet.parameters)
        blocks = packet.parameters[4:]
        for start in range(0, len(blocks) - count, count + 1):
            if blocks[start] == self._table[Address.ID]:
                self._write_registers(now_s, packet.parameters[:2], blocks[start + 1 : start + 1 + count])
        return None

    # ------------------------------------------------------------------ registers

    def _read_table(self, address: int, count: int) -> bytes:
        return self._table.read(address, count) or b""

    def _write_registers(self, now_s: float, address: bytes, data: bytes) -> Fault:
        writes = self._check_write(address, data)
        if isinstance(writes, Fault):
            return writes
        self._apply(now_s, writes)
        return Fault.NONE

    def _check_write(self, address: bytes, data: bytes) -> list[tuple[Register, int]] | Fault:
        """Split a write into registers; return the first fault if one of them is invalid."""
        if len(address) < 2:
            return Fault.LENGTH
        writes = self._table.parse(int.from_bytes(address, "little"), data)
        if isinstance(writes, Fault):
            return writes
        return next((fault for row, value in writes if (fault := self._fault_of_write(row, value))), writes)

    def _fault_of_write(self, row: Register, value: int) -> Fault:
        is_tripped = self._table[Address.BUS_WATCHDOG] == WATCHDOG_TRIPPED
        if is_tripped and (row.address in _GOAL_ADDRESSES or (row.address == Address.BUS_WATCHDOG and value != 0)):
            return Fault.RANGE
        if row.address == Address.TORQUE and value == 1 and self.motor.is_shut_down():
            return Fault.RESULT_FAIL  # the e-Manual states only that REBOOT restores the torque
        return self._table.fault_of_write(row, value)

    def _apply(self, now_s: float, writes: list[tuple[Register, int]]) -> None:
        for row, value in writes:
            previous = self._table[row.address]
            self._table[row.address] = value
            if row.address == Address.TORQUE and value != previous:
                self.motor.set_torque(now_s, on=bool(value))
            elif row.address == Address.GOAL_POSITION:
                self.motor.move_to_goal()

    def _restart_ram(self) -> None:
        self._table.reset_ram()
        self._registered = []
        self.motor.restart()

    # ------------------------------------------------------------------ protections

    def _watchdog_s(self) -> float:
        """Return when the bus watchdog trips if no instruction arrives."""
        units = self._table.values[Address.BUS_WATCHDOG]
        if not units or units == WATCHDOG_TRIPPED or not self._table.values[Address.TORQUE]:
            return math.inf
        return self._instruction_s + units * _WATCHDOG_UNIT_S

    def _protect(self, now_s: float) -> None:
        if now_s < self._ready_s:
            return
        if now_s >= self._watchdog_s():
            self._table[Address.BUS_WATCHDOG] = WATCHDOG_TRIPPED
            self._table[Address.PROFILE_ACCELERATION] = 0
            self._table[Address.PROFILE_VELOCITY] = 0
            self.motor.stop()
        self.motor.observe(now_s)


# Smallest status return level at which an instruction gets a reply; 2 for all others.
_MIN_RETURN_LEVELS: dict[int, int] = {Instruction.PING: 0, Instruction.READ: 1, Instruction.SYNC_READ: 1}
_BROADCASTS_WITH_REPLY = (Instruction.PING, Instruction.SYNC_READ)


def _first_words(parameters: bytes) -> tuple[int, int]:
    """Return the first two little-endian words."""
    return int.from_bytes(parameters[:2], "little"), int.from_bytes(parameters[2:4], "little")


def _make(context: DeviceContext) -> Device:
    return DynamixelEmulator(context.world.shaft, context.rng, device_id=context.options.id, baud=context.baud)


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="dynamixel", baud=57600, make=_make)
