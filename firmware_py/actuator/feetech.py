"""Driver of a Feetech STS or SMS bus servo as the rudder actuator.

Each tick writes the goal, and then reads torque switch, goal, lock, position, voltage, temperature, status and current
at once: 60 bytes, 0.6 ms at 1 Mbaud and 5.2 ms at 115200 baud.

* Nothing is written before the first command.
* Only RAM is written. With the lock set, the servo applies a write to the EEPROM area without storing it. The driver
  sets the lock and then corrects operating mode and response level, after each start and each power loss of the servo.
  Limits, gains and protections are those that the servo has stored.
* The autopilot limits the rate of the rudder, so the speed stays that of power-up and the acceleration is the largest,
  2,210 deg/s^2. Its register is 0 after power-up: so the driver notices a power loss, also of a released servo.
* One write switches the torque on and sets the goal, so the shaft does not move to an older goal.
* The servo has no bus watchdog: if the autopilot fails, the shaft moves to the last goal and holds it.
* During silence the driver reads the settings, and every other time sends the goal: a servo whose replies are lost may
  still receive.
* If the servo cuts the torque with an error, the driver switches it on again after RETRY_DELAY_S, then at most every
  RETRY_EVERY_S, never with an encoder error, and after overheating only when that error has ended. The memory tables
  do not state what ends a protection.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import msgspec

from firmware_py.actuator import feetech_protocol as protocol
from firmware_py.actuator.half_duplex import ReadingWindow, reply_timeout_s
from firmware_py.actuator.servo_driver import ReplyResult, ServoDriver
from firmware_py.common.angles import clamp
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceState, RudderFeedback

MAX_EXCHANGE_BYTES = 111  # a read of 8, a reply of 52, and the return delay of 0.51 ms at 1 Mbaud
POSITION_MODE, ON, LOCKED, BIG_ENDIAN, MAX_ACCELERATION = 0, 1, 1, 1, 254
REPLY_TO_ALL = 1  # response level: writes are acknowledged
AT_LIMIT_COUNTS = 12  # 1 degree
RETRY_DELAY_S, RETRY_EVERY_S = 3.0, 30.0
MAX_ATTEMPTS, PAUSE_S = 3, 2.0  # of a correction; then one attempt after each pause
MAX_REJECTED_GOALS = 3  # consecutive


@dataclass(frozen=True, slots=True)
class FeetechOptions:
    """Options of the vehicle file for a Feetech servo; raises ValueError."""

    id: int = option("id of the servo on its bus", default=1, minimum=0, maximum=253)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)


class Request(msgspec.Struct, frozen=True, eq=False):
    """An instruction: `block` are the addresses to read, `goal` is the goal to write, or to expect in the reply.

    The goal is in counts. `setting` is the name of the setting that it corrects.
    """

    frame: bytes
    block: range | None = None
    goal: int | None = None
    setting: str = ""


class FeetechServo:
    """A servo_driver.Servo; shaft angle 0 is count 2048, positive is increasing counts."""

    def __init__(self, options: FeetechOptions) -> None:
        """Start without a command."""
        self.device_id = options.id
        self.label = f"servo id {options.id}"
        self.parser = protocol.ReplyParser(options.id)
        self._window = ReadingWindow()
        self._shaft_rad: float | None = None
        self._torque_command: bool | None = None  # None: no command yet, nothing is written
        self._is_goal_due = self._is_reading_due = False
        self._last_reading_s = self._last_correction_s = -math.inf
        self._has_steered = self._was_write_last = False  # since the line was opened; with the last request
        self._has_driver_acceleration = False  # when it was last read: no power loss since the driver set it
        self._had_torque = self._was_cut = False  # as last read, unless switched by the driver; cut by the servo
        self._retry_s: float | None = None  # when the torque may be switched on after an error; None: at the next error
        self._restarts = 0
        self._goal_counts = protocol.CENTRE_COUNTS  # last sent
        self._state_index = 0  # of the block that is read next
        self._newest_read: Request | None = None
        self._forget()

    def _forget(self) -> None:
        """Discard all knowledge of the servo."""
        self._settings: bytes | None = None
        self._state: protocol.State | None = None
        self._are_settings_due = self._is_state_due = True
        self._is_ready = False
        self._attempts: Counter[str] = Counter()
        self._attempt_s: dict[str, float] = {}
        self._accepted_goal: int | None = None  # last acknowledged; None: not known
        self._rejected_goals = 0

    def restart(self) -> None:
        """Read the servo again on a reopened line."""
        self._has_steered = False
        self._forget()

    def note_silence(self) -> None:
        """Read the servo again."""
        self._forget()

    def command(self, shaft_rad: float | None, now_s: float, *, torque_on: bool) -> None:
        """Store the goal and the torque command."""
        self._is_state_due |= torque_on and not self._torque_command  # it may have lost power while it was released
        self._shaft_rad = shaft_rad
        self._torque_command = torque_on
        self._window.note_command(now_s)
        self._is_goal_due = self._is_reading_due = True

    def condition(self, *, has_replied: bool) -> tuple[DeviceState, str]:  # noqa: ARG002 - STARTING until it is ready
        """Return the state: errors of the servo, rejected goals, failed corrections."""
        state, settings = self._state, self._settings
        if state is not None and state.status:
            cut = "" if state.torque == ON else ", torque cut"
            return DeviceState.FAULTY, f"servo error: {protocol.status_text(state.status)}{cut}"
        if self._rejected_goals >= MAX_REJECTED_GOALS:
            return DeviceState.FAULTY, "servo rejects goal position"
        if settings is not None and settings[protocol.BYTE_ORDER] == BIG_ENDIAN:
            return DeviceState.FAULTY, "SCS servo (big-endian) not supported"
        failed = [name for name, count in self._attempts.items() if count >= MAX_ATTEMPTS]
        is_other_mode = settings is not None and settings[protocol.OPERATING_MODE] != POSITION_MODE
        if "torque" in failed or (failed and is_other_mode):
            return DeviceState.FAULTY, f"servo does not accept {failed[0]}"
        return DeviceState.RUNNING if self._is_ready else DeviceState.STARTING, self._note_text(settings, failed)

    def _note_text(self, settings: bytes | None, failed: list[str]) -> str:
        if failed:
            return f"servo does not accept {failed[0]}"
        low, high = protocol.angle_limits(settings)
        if self._has_steered and not low + AT_LIMIT_COUNTS <= self._goal_counts <= high - AT_LIMIT_COUNTS:
            return "goal at an angle limit of the servo"
        if settings is None:
            return ""
        model = int.from_bytes(settings[protocol.MODEL : protocol.MODEL + 2], "little")
        return f"model {model}, firmware {settings[protocol.FIRMWARE]}.{settings[protocol.FIRMWARE + 1]}"

    # ------------------------------------------------------------------ replies

    def matches(self, reply: protocol.Reply, request: Request) -> bool:
        """Return whether the reply has the length of the block that is read; that to a write is empty."""
        return len(reply.data) == (0 if request.block is None else len(request.block))

    def process_reply(self, request: Request, reply: protocol.Reply, sent_s: float, *, is_certain: bool) -> ReplyResult:
        """Process the acknowledgement of a write, the settings or a state."""
        if request is self._newest_read:
            self._state_index = 0
        if request.block is None:
            if request.goal is not None and is_certain:
                self._accepted_goal = request.goal
            return ReplyResult()
        is_current = sent_s >= self._last_correction_s  # otherwise it shows the registers before a correction
        if request.block is protocol.SETTINGS:
            if is_current:
                self._settings, self._are_settings_due = reply.data, False
            return ReplyResult()
        state = protocol.decode_state(reply.data)
        is_rejected = False
        if is_certain and request.goal is not None and state.torque == ON:
            is_rejected = state.goal != request.goal
            self._rejected_goals = self._rejected_goals + 1 if is_rejected else 0
        if is_current:
            self._store_state(state)
        is_position = self._settings is not None and self._settings[protocol.OPERATING_MODE] == POSITION_MODE
        feedback = RudderFeedback(
            t_s=sent_s,
            shaft_rad=state.shaft_rad if is_position else None,  # in step mode it is a difference
            temperature_c=state.temperature_c,
            voltage_v=state.voltage_v,
            current_a=state.current_a,
            hardware_error=state.status,
            torque_on=state.torque == ON,
            restarts=self._restarts,
        )
        return ReplyResult(is_accepted=not is_rejected, invalid_values=state.invalid_values, feedback=feedback)

    def _store_state(self, state: protocol.State) -> None:
        """Store a state, and notice that the servo has lost power or has cut the torque."""
        has_driver_acceleration = state.acceleration == MAX_ACCELERATION
        is_restarted = self._has_driver_acceleration and not has_driver_acceleration
        self._restarts += is_restarted
        # After a restart the settings are read again.
        self._are_settings_due |= has_driver_acceleration is not self._has_driver_acceleration
        is_cut = self._had_torque and state.torque != ON and state.status != 0 and not is_restarted
        self._has_driver_acceleration, self._had_torque = has_driver_acceleration, state.torque == ON
        self._was_cut = (self._was_cut or is_cut) and not self._had_torque
        self._state, self._is_state_due = state, False

    # ------------------------------------------------------------------ requests

    def note_lost(self, request: Request) -> None:
        """Read the next state with another length."""
        if request.block is not None and request.block is not protocol.SETTINGS:
            self._state_index = (self._state_index + 1) % len(protocol.STATES)

    def note_sent(self, request: Request, now_s: float) -> None:
        """Note that a request was sent; the rest of an earlier reply cannot be in the reply to it."""
        self.parser.clear()
        self._was_write_last = request.block is None
        if request.block is not None:
            self._newest_read = request
            if request.block is not protocol.SETTINGS:
                self._is_reading_due = False
                self._last_reading_s = now_s
        elif request.goal is not None:
            self._is_goal_due = False
            self._has_steered = True
            self._goal_counts, self._accepted_goal = request.goal, None
        if request.setting:
            self._attempts[request.setting] += 1
            self._attempt_s[request.setting] = self._last_correction_s = now_s
            self._is_state_due = True
            self._are_settings_due |= request.setting in {"operating mode", "response level"}
            self._had_torque &= request.setting != "torque"

    def needs_prompt_io(self) -> bool:
        """Return whether the goal or a reading is due."""
        is_goal_due = self._is_goal_due and self._torque_command is True
        return is_goal_due or self._is_reading_due or self._are_settings_due or self._is_state_due

    def next_request(self, now_s: float) -> Request | None:
        """Return the most urgent request: settings, state, correction, goal, reading."""
        is_goal_due = self._is_goal_due and self._torque_command is True and self._shaft_rad is not None
        if self._are_settings_due:
            if self._settings is None and is_goal_due and self._has_steered and not self._was_write_last:
                return self._write_goal()
            return self._read(protocol.SETTINGS)
        settings, state = self._settings, self._state
        if self._is_state_due or settings is None or state is None:
            return self._read(protocol.STATES[self._state_index])
        if self._torque_command is not None and settings[protocol.BYTE_ORDER] != BIG_ENDIAN:
            if (correction := self._correct(settings, state, now_s)) is not None:
                return correction
            self._is_ready = True
            if is_goal_due and state.torque == ON and settings[protocol.OPERATING_MODE] == POSITION_MODE:
                return self._write_goal()
        self._is_ready = self._is_ready or self._torque_command is None
        is_overdue = self._window.is_overdue(now_s - self._last_reading_s)
        if is_overdue or (self._is_reading_due and self._window.is_early(now_s)):
            return self._read(protocol.STATES[self._state_index])
        return None

    def _correct(self, settings: bytes, state: protocol.State, now_s: float) -> Request | None:
        """Return the next write that corrects a setting or the torque; the mode is changed with the torque off."""
        rows = (
            ("acceleration", protocol.ACCELERATION, state.acceleration, MAX_ACCELERATION),
            ("lock", protocol.LOCK, state.lock, LOCKED),
            ("operating mode", protocol.OPERATING_MODE, settings[protocol.OPERATING_MODE], POSITION_MODE),
            ("response level", protocol.RESPONSE_LEVEL, settings[protocol.RESPONSE_LEVEL], REPLY_TO_ALL),
        )
        is_goal_usable = self._shaft_rad is not None and settings[protocol.OPERATING_MODE] == POSITION_MODE
        is_on_required = self._torque_command is True and is_goal_usable
        for name, address, present, required in rows:
            if address == protocol.OPERATING_MODE and present != required and state.torque:
                break  # the torque first
            if address in protocol.SETTINGS and state.lock != LOCKED:
                continue  # the servo would store it
            if self._is_attempt_due(name, now_s, is_correct=present == required):
                return self._write(address, required, setting=name)
        is_correct = state.torque == is_on_required
        if is_on_required and state.status and (self._was_cut or is_correct):
            return self._switch_torque(on=True) if self._is_retry_due(state.status, now_s) else None
        if self._retry_s is not None and now_s >= self._retry_s:
            self._retry_s = None
        if self._is_attempt_due("torque", now_s, is_correct=is_correct):
            return self._switch_torque(on=is_on_required)
        return None

    def _is_attempt_due(self, setting: str, now_s: float, *, is_correct: bool) -> bool:
        if is_correct:
            self._attempts.pop(setting, None)
            return False
        return self._attempts[setting] < MAX_ATTEMPTS or now_s - self._attempt_s[setting] >= PAUSE_S

    def _is_retry_due(self, status: int, now_s: float) -> bool:
        """Return whether to switch the torque on after an error of the servo."""
        if self._retry_s is None:
            self._retry_s = now_s + RETRY_DELAY_S
        if now_s < self._retry_s or status & (protocol.ENCODER_ERROR | protocol.OVERHEATING_ERROR):
            return False
        self._retry_s = now_s + RETRY_EVERY_S
        return True

    def _read(self, block: range) -> Request:
        frame = protocol.instruction(self.device_id, protocol.READ, block.start, len(block))
        return Request(frame, block, None if block is protocol.SETTINGS else self._accepted_goal)

    def _write(self, address: int, *values: int, goal: int | None = None, setting: str = "") -> Request:
        frame = protocol.instruction(self.device_id, protocol.WRITE, address, *values)
        return Request(frame, goal=goal, setting=setting)

    def _write_goal(self) -> Request:
        counts = self._next_goal()
        return self._write(protocol.GOAL, *counts.to_bytes(2, "little"), goal=counts)

    def _switch_torque(self, *, on: bool) -> Request:
        if not on:
            return self._write(protocol.TORQUE, 0, setting="torque")
        counts = self._next_goal()
        switch = (ON, MAX_ACCELERATION, *counts.to_bytes(2, "little"))
        return self._write(protocol.TORQUE, *switch, goal=counts, setting="torque")

    def _next_goal(self) -> int:
        """Return the goal in counts, within the limits of the servo; only called with a goal."""
        counts = protocol.CENTRE_COUNTS + (self._shaft_rad or 0.0) / protocol.RADIANS_PER_COUNT
        return round(clamp(counts, *protocol.angle_limits(self._settings)))


def feetech_rudder(line: ByteLine, options: FeetechOptions) -> ServoDriver[Request, protocol.Reply]:
    """Return the driver of a Feetech servo on a line."""
    timeout_s = reply_timeout_s(line.baud, MAX_EXCHANGE_BYTES)
    return ServoDriver(line, FeetechServo(options), reply_timeout_s=timeout_s)


DRIVER = Driver(
    interface=INTERFACE,
    device="Feetech STS and SMS bus servos",
    options=FeetechOptions,
    make=feetech_rudder,
    writes=True,
)
