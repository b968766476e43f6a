"""Driver of a Robotis Dynamixel X servo as the rudder actuator.

One half-duplex exchange at a time. Each tick starts with one write: the goal in an instruction without a reply, and a
read of goal and telemetry. The reply shows whether the servo has accepted the goal. A tick has 75 bytes, and 127 twice
a second, when the read includes the state: 13.0 and 22.0 ms at 57600 baud, 0.8 and 1.3 ms at 1 Mbaud. If half a period
is too short for this combined read, or the servo does not reply to it, the state is read separately after the reply.
A reply that has not arrived by the next tick is given up, and the next goal is read with another length. Thus a reply
that an adapter has delayed is distinguished from the expected one and compared with its own goal.

    SEARCH -----any reply----> CONFIGURE ---all registers correct---> RUN
      ^                        |  ^                                    |
      |                        |  '---the servo has restarted----------|
      '-------silence----------'------------silence or reboot----------'

* Nothing is written before the first command: until then `receive` only reads.
* CONFIGURE reads the registers and corrects those that differ (dynamixel_configuration).
* Bus watchdog: after 2 s without any instruction the servo stops and holds its angle, so a moving rudder stops if the
  autopilot fails. Ticks at 1 Hz or more reset it. After a trip the servo accepts no goal. The driver detects the trip
  after a pause of that length, by a goal that is not accepted, or by the next read, and clears it.
* After a power loss the servo is silent and is configured again, or torque or watchdog have their power-up values,
  which are corrected like others.
* During silence the driver sends pings, and every other tick the goal: a servo whose replies are lost may still
  receive. After a power loss its torque is off, so it does not move before it is configured.
* Only a reboot clears a hardware error that has switched the torque off. The driver reboots the servo after
  REBOOT_DELAY_S, then at most every REBOOT_EVERY_S, only while torque is commanded, never for an encoder error, and
  after overheating only below MAX_REBOOT_TEMPERATURE_C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto

from firmware_py.actuator import dynamixel_frames as frames
from firmware_py.actuator import dynamixel_registers as table
from firmware_py.actuator.dynamixel_configuration import Configurator, Kind, Request, RestartCounter, read_request
from firmware_py.actuator.dynamixel_readings import Readings
from firmware_py.actuator.half_duplex import reply_timeout_s
from firmware_py.actuator.servo_driver import ReplyResult, ServoDriver
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceState, RudderFeedback

REBOOT_DELAY_S, REBOOT_EVERY_S = 3.0, 30.0
MAX_REBOOT_TEMPERATURE_C = 60.0
MAX_REJECTED_GOALS = 3  # consecutive; one or two can be a tripped watchdog
MAX_REPLY_LENGTH = 100  # of the length field: 83 bytes of state, goal and telemetry, 4 others, and stuffing
MAX_EXCHANGE_BYTES = 146  # a goal of 19, a read of 14, a reply of 94, and 19 for the return delay of the servo


@dataclass(frozen=True, slots=True)
class DynamixelOptions:
    """Options of the vehicle file for a Dynamixel; raises ValueError."""

    id: int = option("id of the servo on its bus", default=1, minimum=0, maximum=frames.MAX_ID)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)


class Phase(Enum):
    """The phase of the driver."""

    SEARCH = auto()
    CONFIGURE = auto()
    RUN = auto()


class DynamixelServo:
    """A servo_driver.Servo; shaft angle 0 is count 2048, positive is increasing counts."""

    def __init__(self, options: DynamixelOptions, max_exchange_s: float) -> None:
        """Start without a command; max_exchange_s is the duration of the longest exchange."""
        self.device_id = options.id
        self.label = f"servo id {options.id}"
        self.parser = frames.StatusParser(MAX_REPLY_LENGTH)
        self._configurator = Configurator(options.id)
        self._ping = Request(Kind.PING, frames.ping(options.id), "ping", 3)  # model number, firmware version
        self._reboot = Request(Kind.REBOOT, frames.reboot(options.id), "reboot")
        self._goal_reads = tuple(read_request(options.id, block) for block in table.GOAL_READS)
        self._goal_read_index = 0  # of the read that is sent with the next goal
        self._goal_request: Request | None = None  # the newest request that contains a goal
        self._combined = read_request(options.id, table.COMBINED)
        self._readings = Readings(options.id, max_exchange_s)
        self._restarts = RestartCounter()
        self._model_text = ""

        self._shaft_rad: float | None = None
        self._torque_command: bool | None = None  # None: no command yet, nothing is written
        self._is_goal_due = False

        self._phase = Phase.SEARCH
        self._has_steered = False  # whether a goal was sent since the line was opened
        self._was_goal_last = False
        self._rejected_goals = 0
        self._is_at_limit = False  # whether the goal is at a position limit of the servo
        self._last_change_s = -math.inf  # time of the last write other than a goal
        self._temperature_c: float | None = None
        self._next_reboot_s: float | None = None  # earliest time; None: no recent error that has cut the torque

    def restart(self) -> None:
        """Search for the servo on a reopened line."""
        self._has_steered = False
        self._start_search()

    def note_silence(self) -> None:
        """Search for the servo again."""
        self._start_search()

    def _start_search(self) -> None:
        self._phase = Phase.SEARCH
        self._configurator.reset()

    def command(self, shaft_rad: float | None, now_s: float, *, torque_on: bool) -> None:
        """Store the goal and the torque command."""
        self._shaft_rad = shaft_rad
        if self._torque_command is None and self._phase is Phase.RUN:  # the registers were read, but not corrected
            self._phase = Phase.CONFIGURE
        self._torque_command = torque_on
        self._readings.note_command(now_s)
        self._is_goal_due = True

    def condition(self, *, has_replied: bool) -> tuple[DeviceState, str]:  # noqa: ARG002 - the phase includes it
        """Return the state: hardware errors, rejected commands, failed corrections."""
        if errors := self._configurator.hardware_error:
            cut = "" if self._configurator.torque_on else ", torque cut"
            return DeviceState.FAULTY, f"servo error: {table.hardware_error_text(errors)}{cut}"
        if self._rejected_goals >= MAX_REJECTED_GOALS:
            return DeviceState.FAULTY, "servo rejects goal position"
        if self._configurator.has_failed:
            return DeviceState.FAULTY, self._configurator.problem
        return DeviceState.RUNNING if self._phase is Phase.RUN else DeviceState.STARTING, (
            self._configurator.problem or (table.AT_LIMIT_TEXT if self._is_at_limit else self._model_text)
        )

    # ------------------------------------------------------------------ replies

    def matches(self, reply: frames.StatusPacket, request: Request) -> bool:
        """Return whether the packet is from this servo and has the length of a reply to the request."""
        return reply.device_id == self.device_id and len(reply.parameters) == (0 if reply.code else request.parameters)

    def process_reply(
        self, request: Request, reply: frames.StatusPacket, sent_s: float, *, is_certain: bool
    ) -> ReplyResult:
        """Process an error, a reading, or the acknowledgement of a goal or a correction.

        An error reply matches any request, so it is used only if the request is certain.
        """
        if self._phase is Phase.SEARCH:
            self._phase = Phase.CONFIGURE
        if reply.alert and not self._configurator.hardware_error:
            self._readings.request_state()
        if request is self._goal_request:
            self._goal_read_index = 0
        if reply.code:
            if is_certain and request.block is table.COMBINED:
                self._readings.note_combined_rejected()
            elif is_certain and request.kind is Kind.GOAL:
                self._note_rejected_goal()
            elif is_certain:
                self._configurator.process_error(request, reply.code, sent_s)
            return ReplyResult(is_accepted=False)
        if request.kind is Kind.GOAL:
            result = self._process_goal(request.counts if is_certain else None, reply.parameters, sent_s)
            if request.block is table.COMBINED:
                for reading, data in self._readings.split_combined(reply.parameters):
                    self._process_result(reading, data, sent_s)
            return result
        return self._process_result(request, reply.parameters, sent_s)

    def _process_goal(self, sent_counts: int | None, data: bytes, sent_s: float) -> ReplyResult:
        """Compare the goal of the servo with the one sent (None: not known), and process the telemetry."""
        is_rejected = sent_counts is not None and table.extract_goal(data) != sent_counts
        if is_rejected:
            self._note_rejected_goal()
        elif sent_counts is not None:
            self._rejected_goals = 0
        return self._process_telemetry(table.extract_telemetry(data), sent_s, is_accepted=not is_rejected)

    def _note_rejected_goal(self) -> None:
        self._rejected_goals += 1
        # The limits have changed, the watchdog has tripped or the torque is off.
        self._configurator.forget(table.LIMITS, table.WATCHDOG, table.STATE)

    def _process_result(self, request: Request, data: bytes, sent_s: float) -> ReplyResult:
        if request.kind is Kind.PING:
            self._model_text = f"model {data[0] | data[1] << 8}, firmware {data[2]}"
        elif request.block is table.TELEMETRY:
            return self._process_telemetry(data, sent_s)
        elif request.kind is not Kind.READ or sent_s >= self._last_change_s:  # otherwise it is outdated
            self._restarts.process_result(request, data)
            self._configurator.process_result(request, data)
        return ReplyResult()

    def _process_telemetry(self, data: bytes, sent_s: float, *, is_accepted: bool = True) -> ReplyResult:
        values = table.decode_telemetry(data)
        self._temperature_c = values.temperature_c
        feedback = RudderFeedback(
            t_s=sent_s,
            shaft_rad=values.shaft_rad,
            temperature_c=values.temperature_c,
            voltage_v=values.voltage_v,
            current_a=values.current_a,
            hardware_error=self._configurator.hardware_error,
            torque_on=self._configurator.torque_on,
            restarts=self._restarts.count,
        )
        return ReplyResult(is_accepted=is_accepted, invalid_values=values.invalid_values, feedback=feedback)

    # ------------------------------------------------------------------ requests

    def note_lost(self, request: Request) -> None:
        """Read a register again before its correction is repeated; read the next goal with another length."""
        self._configurator.note_lost(request)
        if request.kind is Kind.GOAL:
            self._goal_read_index = (self._goal_read_index + 1) % len(self._goal_reads)
        if request.block is table.COMBINED:
            self._readings.note_combined_lost()

    def note_sent(self, request: Request, now_s: float) -> None:
        """Note that a request was sent."""
        self._configurator.note_sent(request, now_s)
        self._readings.note_sent(request, now_s)
        self._was_goal_last = request.kind is Kind.GOAL
        self._restarts.note_sent(request)
        if self._was_goal_last:
            self._is_goal_due = False
            self._goal_request = request
        elif request.kind is not Kind.READ:
            self._last_change_s = now_s
        if request.kind is Kind.REBOOT:
            self._next_reboot_s = now_s + REBOOT_EVERY_S
            self._start_search()

    def needs_prompt_io(self) -> bool:
        """Return whether anything else is to be read or written before the next command."""
        configurator = self._configurator
        if (
            self._phase is not Phase.RUN
            or configurator.verified_command is not self._torque_command
            or configurator.hardware_error
        ):
            return True
        return (self._is_goal_due and self._torque_command is True) or self._readings.has_more_due()

    def next_request(self, now_s: float) -> Request | None:
        """Return the most urgent request: search, correction, goal, reading."""
        goal_rad = self._shaft_rad if self._is_goal_due and self._torque_command else None
        if self._phase is Phase.SEARCH:
            is_goal_next = self._has_steered and not self._was_goal_last
            return self._create_goal_request(goal_rad) if is_goal_next and goal_rad is not None else self._ping
        correction = self._configurator.next_request(
            now_s, torque_command=self._torque_command, is_in_use=self._phase is Phase.RUN
        )
        if correction is not None:
            return correction
        if self._phase is Phase.CONFIGURE:
            if not self._configurator.is_complete:
                return self._readings.next_request(now_s)
            self._phase = Phase.RUN
        if goal_rad is not None and self._configurator.torque_on:
            self._has_steered = True
            return self._create_goal_request(goal_rad)
        return self._reboot if self._is_reboot_due(now_s) else self._readings.next_request(now_s)

    def _create_goal_request(self, shaft_rad: float) -> Request:
        goal, read = table.GOAL_POSITION, self._goal_reads[self._goal_read_index]
        # A silent servo cannot show whether it supports the combined read.
        if self._goal_read_index == 0 and self._phase is Phase.RUN and self._readings.is_combined_due():
            read = self._combined
        counts = table.goal_counts(shaft_rad, self._configurator.image)
        self._is_at_limit = table.is_at_limit(counts, self._configurator.image)
        frame = frames.sync_write(self.device_id, goal.address, goal.encode(counts)) + read.frame
        return Request(Kind.GOAL, frame, goal.name, read.parameters, read.block, counts)

    def _is_reboot_due(self, now_s: float) -> bool:
        errors = self._configurator.hardware_error
        if not errors or self._configurator.torque_on:
            if self._next_reboot_s is not None and now_s >= self._next_reboot_s:
                self._next_reboot_s = None
            return False
        if self._next_reboot_s is None:
            self._next_reboot_s = now_s + REBOOT_DELAY_S
        if not self._torque_command or now_s < self._next_reboot_s or errors & table.ENCODER_ERROR:
            return False
        is_hot = self._temperature_c is None or self._temperature_c > MAX_REBOOT_TEMPERATURE_C
        return not (errors & table.OVERHEATING_ERROR and is_hot)


def dynamixel_rudder(line: ByteLine, options: DynamixelOptions) -> ServoDriver[Request, frames.StatusPacket]:
    """Return the driver of a Dynamixel servo on a line."""
    timeout_s = reply_timeout_s(line.baud, MAX_EXCHANGE_BYTES)
    return ServoDriver(line, DynamixelServo(options, timeout_s), reply_timeout_s=timeout_s)


DRIVER = Driver(
    interface=INTERFACE,
    device="Robotis Dynamixel X, protocol 2.0",
    options=DynamixelOptions,
    make=dynamixel_rudder,
    writes=True,
)
