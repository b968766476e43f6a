"""Keeps the registers of a Dynamixel as the rudder needs them: what to read or correct next.

An image of the registers is compared with what they shall be. Start-up, a power loss and
a tripped watchdog differ only in what the image says, so there is no procedure for each.
"""

from __future__ import annotations

import math
from collections import Counter
from enum import Enum, auto

import msgspec

from firmware_py.actuator import dynamixel_frames as frames
from firmware_py.actuator import dynamixel_registers as table

WATCHDOG_UNITS = 100  # of 20 ms
MAY_HAVE_TRIPPED_S = 0.9 * 0.02 * WATCHDOG_UNITS  # without an instruction
ATTEMPTS = 3
REST_S, OPTIONAL_REST_S = 1.0, 30.0  # before one more attempt


class Kind(Enum):
    """What a request is for."""

    PING = auto()
    READ = auto()
    CORRECT = auto()
    GOAL = auto()
    REBOOT = auto()


class Request(msgspec.Struct, frozen=True):
    """An instruction, and what is expected of its answer."""

    kind: Kind
    frame: bytes
    name: str
    parameters: int = 0  # number of bytes of the answer
    block: table.Block | None = None  # read, or changed
    counts: int = 0  # of the goal that is sent with it


def read_request(device_id: int, block: table.Block) -> Request:
    """Return the request that reads a block."""
    frame = frames.read(device_id, block.address, block.length)
    return Request(Kind.READ, frame, block.name, block.length, block)


class RestartCounter:
    """Counts how often the servo has lost its power: its torque is gone, without an error and unasked.

    A cable out and in takes no torque away.
    """

    def __init__(self) -> None:
        """Start with none."""
        self.count = 0
        self._had_torque = False

    def note_sent(self, request: Request) -> None:
        """Note what takes the torque away on purpose."""
        if request.kind is Kind.REBOOT or (request.kind is Kind.CORRECT and request.name == table.TORQUE_ENABLE.name):
            self._had_torque = False

    def take_result(self, request: Request, data: bytes) -> None:
        """Take the answer to a read."""
        if request.kind is Kind.READ and request.block is table.STATE:
            torque, error = table.TORQUE_ENABLE.decoded(data), table.HARDWARE_ERROR.decoded(data)
            self.count += self._had_torque and not torque and not error
            self._had_torque = bool(torque)


class Upkeep:
    """The image of one servo and the next request that brings it nearer to what it shall be.

    EEPROM is written only where it differs, only with the torque off and only before the
    rudder is in use. A correction is always read back. What fails three times rests
    before the next attempt; the rudder is used meanwhile if it can do without.
    """

    def __init__(self, device_id: int) -> None:
        """Take the id of the servo."""
        self._id = device_id
        settings = (*table.SETTINGS_WANTED, table.Setting(table.BUS_WATCHDOG, WATCHDOG_UNITS))
        blocks = (table.SETTINGS, table.LIMITS, table.STATE, table.WATCHDOG)
        self._settings = settings
        self._torque = {on: table.Setting(table.TORQUE_ENABLE, int(on), essential=True) for on in (False, True)}
        self._reads = tuple(read_request(device_id, block) for block in blocks)
        self._optional_blocks = (table.WATCHDOG,)
        self._essential = {table.TORQUE_ENABLE.name, *(row.register.name for row in settings if row.essential)}
        self._essential |= {block.name for block in blocks if block not in self._optional_blocks}
        self._attempts: Counter[str] = Counter()
        self._rests_until_s: dict[str, float] = {}
        self._sent_s = -math.inf  # the last instruction of any kind
        self.settled_for: bool | None = None  # the torque with which there is nothing to read or to correct
        self.torque_on: bool | None = None  # as last read; None: not known
        self.hardware_error = 0  # the bits as last read
        self.image: dict[table.Block, bytes] = {}
        self.complete = False  # as next_request() last saw it: the rudder can be used
        self.stuck = False  # something essential has failed and rests
        self.trouble = ""  # the last refusal or failure

    def reset(self) -> None:
        """Know nothing of the servo any more."""
        self.forget(*self.image)
        self._attempts.clear()
        self._rests_until_s.clear()
        self.trouble = ""
        self.complete = self.stuck = False

    def forget(self, *blocks: table.Block) -> None:
        """Have blocks read again."""
        self.settled_for = None
        for block in blocks:
            self.image.pop(block, None)
        if table.STATE in blocks:
            self.torque_on, self.hardware_error = None, 0

    # ------------------------------------------------------------------ what is next

    def next_request(self, now_s: float, *, torque_wanted: bool | None, in_use: bool) -> Request | None:
        """Return the next request, set `complete` and `stuck`; nothing is written while torque_wanted is None."""
        if now_s - self._sent_s >= MAY_HAVE_TRIPPED_S:  # the autopilot stood still, or the line took nothing
            self.forget(table.WATCHDOG)
        if torque_wanted is not None and torque_wanted is self.settled_for:
            return None
        self.complete = self.stuck = False
        for request in self._reads:
            if request.block in self.image:
                continue
            if not self._resting(request.name, now_s):
                return request
            if request.block not in self._optional_blocks:
                self.stuck = True
                return None
        if torque_wanted is not None:
            for setting in self._wanted(torque_wanted=torque_wanted, in_use=in_use):
                present = setting.register.value(self.image)
                if present is None or self._right(setting, present):
                    continue
                if not self._resting(setting.register.name, now_s):
                    return self._correction(setting, present)
                if setting.essential:
                    self.stuck = True
                    return None
            self.settled_for = torque_wanted
            if not self._rests_until_s:
                self.trouble = ""
        self.complete = True
        return None

    def _wanted(self, *, torque_wanted: bool, in_use: bool) -> tuple[table.Setting, ...]:
        # The torque-off that EEPROM needs is no option with the rudder in use; there it cannot have changed either.
        settings = tuple(row for row in self._settings if not (in_use and row.register.eeprom))
        if torque_wanted and self.hardware_error:  # after a shutdown only a reboot gives the torque back
            return settings
        return (*settings, self._torque[torque_wanted])

    def _right(self, setting: table.Setting, present: int) -> bool:
        if setting.corrected(present) != present:
            return False
        self._attempts.pop(setting.register.name, None)
        self._rests_until_s.pop(setting.register.name, None)
        return True

    def _resting(self, name: str, now_s: float) -> bool:
        until_s = self._rests_until_s.get(name)
        if until_s is None:
            return False
        if now_s < until_s:
            return True
        del self._rests_until_s[name]
        self._attempts[name] = ATTEMPTS - 1
        return False

    def _correction(self, setting: table.Setting, present: int) -> Request:
        register, value = setting.register, setting.corrected(present)
        if register.eeprom and self.torque_on:
            register, value = table.TORQUE_ENABLE, 0
        elif register is table.BUS_WATCHDOG and present == table.WATCHDOG_TRIPPED:
            value = 0  # only 0 clears a trip; the next correction sets it again
        frame = frames.write(self._id, register.address, register.encoded(value))
        return Request(Kind.CORRECT, frame, register.name, 0, register.block)

    # ------------------------------------------------------------------ what became of it

    def note_sent(self, request: Request, now_s: float) -> None:
        """Note that the watchdog is fed, and count an attempt at a correction."""
        self._sent_s = now_s
        if request.kind is Kind.CORRECT:
            self._count(request, now_s)

    def take_result(self, request: Request, data: bytes) -> None:
        """Take the answer to a read, or have a correction read back."""
        if request.block is None:
            return
        self.forget(request.block)
        if request.kind is Kind.READ:
            self.image[request.block] = data
            if request.block is table.STATE:
                self.torque_on = table.TORQUE_ENABLE.decoded(data) == 1
                self.hardware_error = table.HARDWARE_ERROR.decoded(data)

    def take_refusal(self, request: Request, code: int, now_s: float) -> None:
        """Note a refusal; what was believed of the block may be wrong."""
        self.trouble = f"servo refuses {request.name}: {frames.ERROR_TEXT.get(code, f'error {code}')}"
        if request.kind is Kind.READ:
            self._count(request, now_s)
        elif request.block is not None:
            self.forget(request.block)

    def note_lost(self, request: Request) -> None:
        """Look before writing again: a correction without an answer may have been obeyed."""
        if request.kind is Kind.CORRECT and request.block is not None:
            self.forget(request.block)

    def _count(self, request: Request, now_s: float) -> None:
        name = request.name
        self._attempts[name] += 1
        if self._attempts[name] >= ATTEMPTS:
            self._rests_until_s[name] = now_s + (REST_S if name in self._essential else OPTIONAL_REST_S)
            self.trouble = self.trouble or f"servo does not keep {name}"
