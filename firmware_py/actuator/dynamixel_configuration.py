"""Configuration of a Dynamixel: the registers to read or to correct next.

An image of the registers is compared with their required values. Start-up, power loss and a tripped watchdog differ
only in the image, so they need no separate procedures.
"""

from __future__ import annotations

import math
from collections import Counter
from enum import Enum, auto

import msgspec

from firmware_py.actuator import dynamixel_frames as frames
from firmware_py.actuator import dynamixel_registers as table

WATCHDOG_UNITS = 100  # of 20 ms
WATCHDOG_MARGIN_S = 0.9 * 0.02 * WATCHDOG_UNITS  # after this time without an instruction it may have tripped
MAX_ATTEMPTS = 3
RETRY_S, OPTIONAL_RETRY_S = 1.0, 30.0  # pause after MAX_ATTEMPTS


class Kind(Enum):
    """The purpose of a request."""

    PING = auto()
    READ = auto()
    CORRECT = auto()
    GOAL = auto()
    REBOOT = auto()


class Request(msgspec.Struct, frozen=True):
    """An instruction and its expected reply."""

    kind: Kind
    frame: bytes
    name: str
    parameters: int = 0  # number of parameter bytes in the reply
    block: table.Block | None = None  # the block that is read or changed
    counts: int = 0  # the goal that is sent with it


def read_request(device_id: int, block: table.Block) -> Request:
    """Return the request that reads a block."""
    frame = frames.read(device_id, block.address, block.length)
    return Request(Kind.READ, frame, block.name, block.length, block)


class RestartCounter:
    """Counts power losses of the servo: its torque is off without an error or a command.

    An interrupted bus cable does not switch the torque off.
    """

    def __init__(self) -> None:
        """Start at 0."""
        self.count = 0
        self._had_torque = False

    def note_sent(self, request: Request) -> None:
        """Note requests that switch the torque off."""
        if request.kind is Kind.REBOOT or (request.kind is Kind.CORRECT and request.name == table.TORQUE_ENABLE.name):
            self._had_torque = False

    def process_result(self, request: Request, data: bytes) -> None:
        """Process the reply to a read."""
        if request.kind is Kind.READ and request.block is table.STATE:
            torque, error = table.TORQUE_ENABLE.decode(data), table.HARDWARE_ERROR.decode(data)
            self.count += self._had_torque and not torque and not error
            self._had_torque = bool(torque)


class Configurator:
    """The image of the registers of one servo and the next request to correct them.

    EEPROM is written only if it differs, with the torque off and before the rudder is in use. Every correction is
    read back. After MAX_ATTEMPTS failures there is a pause before the next attempt; the rudder is used meanwhile unless
    the register is essential.
    """

    def __init__(self, device_id: int) -> None:
        """Store the id of the servo."""
        self._id = device_id
        settings = (*table.REQUIRED_SETTINGS, table.Setting(table.BUS_WATCHDOG, WATCHDOG_UNITS))
        blocks = (table.SETTINGS, table.LIMITS, table.STATE, table.WATCHDOG)
        self._settings = settings
        self._torque = {on: table.Setting(table.TORQUE_ENABLE, int(on), is_essential=True) for on in (False, True)}
        self._reads = tuple(read_request(device_id, block) for block in blocks)
        self._optional_blocks = (table.WATCHDOG,)
        self._essential_names = {table.TORQUE_ENABLE.name, *(row.register.name for row in settings if row.is_essential)}
        self._essential_names |= {block.name for block in blocks if block not in self._optional_blocks}
        self._attempts: Counter[str] = Counter()
        self._paused_until_s: dict[str, float] = {}
        self._last_sent_s = -math.inf  # time of the last instruction of any kind
        self.verified_command: bool | None = None  # the torque command for which all registers are correct
        self.torque_on: bool | None = None  # as last read; None: not known
        self.hardware_error = 0  # the bits as last read
        self.image: dict[table.Block, bytes] = {}
        self.reset()

    def reset(self) -> None:
        """Discard all knowledge of the servo."""
        self.forget(*self.image)
        self._attempts.clear()
        self._paused_until_s.clear()
        self.problem = ""  # text of the last error or failure
        self.is_complete = False  # result of the last next_request(): the rudder can be used
        self.has_failed = False  # an essential read or correction has failed and is paused

    def forget(self, *blocks: table.Block) -> None:
        """Discard blocks, so that they are read again."""
        self.verified_command = None
        for block in blocks:
            self.image.pop(block, None)
        if table.STATE in blocks:
            self.torque_on, self.hardware_error = None, 0

    # ------------------------------------------------------------------ requests

    def next_request(self, now_s: float, *, torque_command: bool | None, is_in_use: bool) -> Request | None:
        """Return the next request, and set `is_complete` and `has_failed`; no writes without torque_command."""
        if now_s - self._last_sent_s >= WATCHDOG_MARGIN_S:  # the autopilot was suspended, or the line was blocked
            self.forget(table.WATCHDOG)
        if torque_command is not None and torque_command is self.verified_command:
            return None
        self.is_complete = self.has_failed = False
        for request in self._reads:
            if request.block in self.image:
                continue
            if not self._is_paused(request.name, now_s):
                return request
            if request.block not in self._optional_blocks:
                self.has_failed = True
                return None
        if torque_command is not None:
            for setting in self._required_settings(torque_command=torque_command, is_in_use=is_in_use):
                present = setting.register.value(self.image)
                if present is None or self._is_correct(setting, present):
                    continue
                if not self._is_paused(setting.register.name, now_s):
                    return self._create_correction(setting, present)
                if setting.is_essential:
                    self.has_failed = True
                    return None
            self.verified_command = torque_command
            if not self._paused_until_s:
                self.problem = ""
        self.is_complete = True
        return None

    def _required_settings(self, *, torque_command: bool, is_in_use: bool) -> tuple[table.Setting, ...]:
        # EEPROM needs the torque off, which is not possible with the rudder in use; it cannot have changed either.
        settings = tuple(row for row in self._settings if not (is_in_use and row.register.is_eeprom))
        if torque_command and self.hardware_error:  # only a reboot switches the torque on again
            return settings
        return (*settings, self._torque[torque_command])

    def _is_correct(self, setting: table.Setting, present: int) -> bool:
        if setting.corrected_value(present) != present:
            return False
        self._attempts.pop(setting.register.name, None)
        self._paused_until_s.pop(setting.register.name, None)
        return True

    def _is_paused(self, name: str, now_s: float) -> bool:
        until_s = self._paused_until_s.get(name)
        if until_s is None:
            return False
        if now_s < until_s:
            return True
        del self._paused_until_s[name]
        self._attempts[name] = MAX_ATTEMPTS - 1
        return False

    def _create_correction(self, setting: table.Setting, present: int) -> Request:
        register, value = setting.register, setting.corrected_value(present)
        if register.is_eeprom and self.torque_on:
            register, value = table.TORQUE_ENABLE, 0
        elif register is table.BUS_WATCHDOG and present == table.WATCHDOG_TRIPPED:
            value = 0  # only 0 clears a trip; the next correction sets the time again
        frame = frames.write(self._id, register.address, register.encode(value))
        return Request(Kind.CORRECT, frame, register.name, 0, register.block)

    # ------------------------------------------------------------------ results

    def note_sent(self, request: Request, now_s: float) -> None:
        """Record the time for the watchdog, and count an attempt of a correction."""
        self._last_sent_s = now_s
        if request.kind is Kind.CORRECT:
            self._count_attempt(request, now_s)

    def process_result(self, request: Request, data: bytes) -> None:
        """Process the reply to a read; after a correction, read the block back."""
        if request.block is None:
            return
        self.forget(request.block)
        if request.kind is Kind.READ:
            self.image[request.block] = data
            if request.block is table.STATE:
                self.torque_on = table.TORQUE_ENABLE.decode(data) == 1
                self.hardware_error = table.HARDWARE_ERROR.decode(data)

    def process_error(self, request: Request, code: int, now_s: float) -> None:
        """Process an error reply: the image of the block may be wrong."""
        self.problem = f"servo rejects {request.name}: {frames.ERROR_TEXT.get(code, f'error {code}')}"
        if request.kind is Kind.READ:
            self._count_attempt(request, now_s)
        elif request.block is not None:
            self.forget(request.block)

    def note_lost(self, request: Request) -> None:
        """Read the block again: a correction without a reply may have been executed."""
        if request.kind is Kind.CORRECT and request.block is not None:
            self.forget(request.block)

    def _count_attempt(self, request: Request, now_s: float) -> None:
        name = request.name
        self._attempts[name] += 1
        if self._attempts[name] >= MAX_ATTEMPTS:
            self._paused_until_s[name] = now_s + (RETRY_S if name in self._essential_names else OPTIONAL_RETRY_S)
            self.problem = self.problem or f"servo does not store {name}"
