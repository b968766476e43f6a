"""A Robotis Dynamixel X servo as the rudder.

One half-duplex exchange at a time. The goal goes out first in a tick, by an instruction that is not
answered, and behind it what asks for goal and telemetry: one write, and one answer that says
whether the goal was taken. A tick costs 75 bytes, and 127 twice a second, when the question is for
the state besides: at 57600 baud 13.0 and 22.0 ms, at 1 Mbaud 0.8 and 1.3 ms. Nothing waits for that
answer but the next tick. Where half a period is too short for so much, or a servo does not answer
for all that, the state is asked for by itself, once the answer is there. An answer that is not
there by then is given up, and the next goal is asked for by a read of another length: so one that
an adapter has held back is told from the one awaited, and judged by the goal that it belongs to.

    SEARCH ---any answer---> CONFIGURE ---all known and right---> RUN
      ^                        |  ^                                 |
      |                        |  '--the servo shows a restart------|
      '-------silence----------'------------silence or reboot-------'

* Nothing is written before the first command: `receive` alone only reads.
* CONFIGURE reads the registers and corrects those that differ (dynamixel_upkeep).
* Bus watchdog: after 2 s without any instruction the servo stops and holds the angle it
  has, so a rudder in motion does not go on when the autopilot dies. Ticks down to 1 Hz
  feed it. After a trip no goal is taken. It is recognised and cleared: before the next goal when
  nothing has been sent for so long, else by a goal that is not taken, or by the next reading.
* A servo that has lost its power in between shows it by silence, and is configured again, or
  by torque or watchdog back at their power-up values, which are corrected like any other.
* In silence the driver pings, and every other tick still sends the goal: a servo whose
  answers are lost may hear, and one back from a power loss has its torque off and does
  not move before it is configured.
* A hardware error that has cut the torque is only undone by a reboot. The driver reboots
  3 s after it sees one, then at most every 30 s, only while the rudder is wanted, never
  for an encoder error, and after overheating only once cooled to 60 deg C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto

from firmware_py.actuator import dynamixel_frames as frames
from firmware_py.actuator import dynamixel_registers as table
from firmware_py.actuator.dynamixel_readings import Readings
from firmware_py.actuator.dynamixel_upkeep import Kind, Request, RestartCounter, Upkeep, read_request
from firmware_py.actuator.half_duplex import reply_timeout_s
from firmware_py.actuator.servo_driver import Answer, ServoDriver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceState, RudderFeedback

REBOOT_DELAY_S, REBOOT_EVERY_S = 3.0, 30.0
COOL_ENOUGH_C = 60.0
GOALS_REFUSED = 3  # in a row: one or two are a tripped watchdog
LARGEST_REPLY_LENGTH = 100  # state, goal and telemetry have 87, and their stuffing
LONGEST_EXCHANGE_BYTES = (
    146  # a goal of 19, a question of 14, a reply of 94, and the delay that the servo may answer with
)


@dataclass(frozen=True, slots=True)
class DynamixelOptions:
    """What the vehicle file may say of a Dynamixel; ValueError for what cannot be."""

    id: int = option("number of the servo on its bus", default=1, minimum=0, maximum=frames.LARGEST_ID)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)


class Phase(Enum):
    """What the driver is doing."""

    SEARCH = auto()
    CONFIGURE = auto()
    RUN = auto()


class DynamixelServo:
    """A servo_driver.Servo; shaft angle 0 is count 2048, positive is increasing counts."""

    def __init__(self, options: DynamixelOptions, longest_s: float) -> None:
        """Begin without a command, so that nothing is written; longest_s is what the longest exchange takes."""
        self.device_id = options.id
        self.parser = frames.StatusParser(LARGEST_REPLY_LENGTH)
        self._upkeep = Upkeep(options.id)
        self._ping = Request(Kind.PING, frames.ping(options.id), "ping", 3)
        self._reboot = Request(Kind.REBOOT, frames.reboot(options.id), "reboot")
        self._looks = tuple(read_request(options.id, block) for block in table.LOOKS)
        self._look = 0  # which comes with the next goal
        self._asked: Request | None = None  # the newest that came with a goal
        self._whole = read_request(options.id, table.WHOLE)
        self._readings = Readings(options.id, longest_s)
        self._restarts = RestartCounter()
        self._model = ""

        self._shaft_rad: float | None = None
        self._torque_wanted: bool | None = None  # None: no command yet, so nothing is written
        self._goal_due = False

        self._phase = Phase.SEARCH
        self._steered = False  # since the line was opened
        self._goal_was_last = False
        self._goals_refused = 0
        self._at_limit = False  # the goal, perhaps moved there
        self._changed_s = -math.inf  # when something else than the goal was last written
        self._temperature_c: float | None = None
        self._reboot_at_s: float | None = None

    def restart(self) -> None:
        """Search for the servo anew: the line is a new one."""
        self._steered = False
        self._search()

    def note_silence(self) -> None:
        """Search for the servo anew, once."""
        if self._phase is not Phase.SEARCH:
            self._search()

    def _search(self) -> None:
        self._phase = Phase.SEARCH
        self._upkeep.reset()

    def command(self, shaft_rad: float | None, now_s: float, *, torque_on: bool) -> None:
        """Take the goal and whether the motor shall hold it."""
        self._shaft_rad = shaft_rad
        if self._torque_wanted is None and self._phase is Phase.RUN:  # so far only read, nothing corrected
            self._phase = Phase.CONFIGURE
        self._torque_wanted = torque_on
        self._readings.note_command(now_s)
        self._goal_due = True

    def condition(self, *, answered: bool) -> tuple[DeviceState, str]:  # noqa: ARG002 - the phase says it
        """The state: what the servo reports against itself, what it refuses, what it does not keep."""
        if errors := self._upkeep.hardware_error:
            cut = "" if self._upkeep.torque_on else ", torque cut"
            return DeviceState.FAULTY, f"servo error: {table.hardware_error_text(errors)}{cut}"
        if self._goals_refused >= GOALS_REFUSED:
            return DeviceState.FAULTY, "servo refuses goal position"
        if self._upkeep.stuck:
            return DeviceState.FAULTY, self._upkeep.trouble
        return DeviceState.RUNNING if self._phase is Phase.RUN else DeviceState.STARTING, (
            self._upkeep.trouble or (table.AT_LIMIT if self._at_limit else self._model)
        )

    # ------------------------------------------------------------------ what arrives

    def answers(self, reply: frames.StatusPacket, request: Request) -> bool:
        """Return whether the packet is this servo's and as long as the answer to the request."""
        return reply.device_id == self.device_id and len(reply.parameters) == (0 if reply.code else request.parameters)

    def take_answer(self, request: Request, reply: frames.StatusPacket, asked_s: float, *, sure: bool) -> Answer:
        """Take a refusal, a reading, or the word that a goal or a correction is done.

        A refusal fits whatever was asked, so it only counts as one of what it is sure to answer.
        """
        if self._phase is Phase.SEARCH:
            self._phase = Phase.CONFIGURE
        if reply.alert and not self._upkeep.hardware_error:
            self._readings.read_state_next()
        if request is self._asked:
            self._look = 0
        if reply.code:
            if sure and request.block is table.WHOLE:
                self._readings.note_whole_refused()
            elif sure and request.kind is Kind.GOAL:
                self._note_goal_refused()
            elif sure:
                self._upkeep.take_refusal(request, reply.code, asked_s)
            return Answer(obeyed=False)
        if request.kind is Kind.GOAL:
            answer = self._take_goal(request.counts if sure else None, reply.parameters, asked_s)
            if request.block is table.WHOLE:
                for reading, data in self._readings.slow_parts(reply.parameters):
                    self._take_result(reading, data, asked_s)
            return answer
        return self._take_result(request, reply.parameters, asked_s)

    def _take_goal(self, sent_counts: int | None, data: bytes, asked_s: float) -> Answer:
        """Take the goal that the servo has, beside the one that it was sent (None: not known), and the telemetry."""
        refused = sent_counts is not None and table.goal_of(data) != sent_counts
        if refused:
            self._note_goal_refused()
        elif sent_counts is not None:
            self._goals_refused = 0
        return self._take_telemetry(table.telemetry_of(data), asked_s, obeyed=not refused)

    def _note_goal_refused(self) -> None:
        self._goals_refused += 1
        # The limits have changed, the watchdog has tripped or the torque is gone.
        self._upkeep.forget(table.LIMITS, table.WATCHDOG, table.STATE)

    def _take_result(self, request: Request, data: bytes, asked_s: float) -> Answer:
        if request.kind is Kind.PING:
            self._model = f"model {data[0] | data[1] << 8}, firmware {data[2]}"
        elif request.block is table.TELEMETRY:
            return self._take_telemetry(data, asked_s)
        elif request.kind is not Kind.READ or asked_s >= self._changed_s:  # else it is of before
            self._restarts.take_result(request, data)
            self._upkeep.take_result(request, data)
        return Answer()

    def _take_telemetry(self, data: bytes, asked_s: float, *, obeyed: bool = True) -> Answer:
        values = table.decode_telemetry(data)
        self._temperature_c = values.temperature_c
        feedback = RudderFeedback(
            t_s=asked_s,
            shaft_rad=values.shaft_rad,
            temperature_c=values.temperature_c,
            voltage_v=values.voltage_v,
            current_a=values.current_a,
            hardware_error=self._upkeep.hardware_error,
            torque_on=self._upkeep.torque_on,
            restarts=self._restarts.count,
        )
        return Answer(obeyed=obeyed, impossible=values.impossible, feedback=feedback)

    # ------------------------------------------------------------------ what is sent

    def note_lost(self, request: Request) -> None:
        """Have a correction looked at before it is repeated, and the next goal asked for by another length."""
        self._upkeep.note_lost(request)
        if request.kind is Kind.GOAL:
            self._look = (self._look + 1) % len(self._looks)
        if request.block is table.WHOLE:
            self._readings.note_whole_lost()

    def note_sent(self, request: Request, now_s: float) -> None:
        """Note that a request is on its way."""
        self._upkeep.note_sent(request, now_s)
        self._readings.note_sent(request, now_s)
        self._goal_was_last = request.kind is Kind.GOAL
        self._restarts.note_sent(request)
        if self._goal_was_last:
            self._goal_due = False
            self._asked = request
        elif request.kind is not Kind.READ:
            self._changed_s = now_s
        if request.kind is Kind.REBOOT:
            self._reboot_at_s = now_s + REBOOT_EVERY_S
            self._search()

    def needs_prompt_io(self) -> bool:
        """Return whether anything but the telemetry is to be read or written before the next command."""
        upkeep = self._upkeep
        if self._phase is not Phase.RUN or upkeep.settled_for is not self._torque_wanted or upkeep.hardware_error:
            return True
        return (self._goal_due and self._torque_wanted is True) or self._readings.more_due()

    def next_request(self, now_s: float) -> Request | None:
        """Return what is most urgent: to find the servo, to correct it, the goal, a reading."""
        goal_rad = self._shaft_rad if self._goal_due and self._torque_wanted else None
        if self._phase is Phase.SEARCH:
            blind = self._steered and not self._goal_was_last
            return self._goal(goal_rad) if blind and goal_rad is not None else self._ping
        repair = self._upkeep.next_request(now_s, torque_wanted=self._torque_wanted, in_use=self._phase is Phase.RUN)
        if repair is not None:
            return repair
        if self._phase is Phase.CONFIGURE:
            if not self._upkeep.complete:
                return self._readings.next_request(now_s)
            self._phase = Phase.RUN
        if goal_rad is not None and self._upkeep.torque_on:
            self._steered = True
            return self._goal(goal_rad)
        return self._reboot if self._reboot_due(now_s) else self._readings.next_request(now_s)

    def _goal(self, shaft_rad: float) -> Request:
        goal, look = table.GOAL_POSITION, self._looks[self._look]
        # A servo that is silent cannot show whether it answers for so many registers.
        if self._look == 0 and self._phase is Phase.RUN and self._readings.whole_due():
            look = self._whole
        counts = table.goal_counts(shaft_rad, self._upkeep.image)
        self._at_limit = table.at_limit(counts, self._upkeep.image)
        frame = frames.sync_write(self.device_id, goal.address, goal.encoded(counts)) + look.frame
        return Request(Kind.GOAL, frame, goal.name, look.parameters, look.block, counts)

    def _reboot_due(self, now_s: float) -> bool:
        errors = self._upkeep.hardware_error
        if not errors or self._upkeep.torque_on:
            if self._reboot_at_s is not None and now_s >= self._reboot_at_s:
                self._reboot_at_s = None
            return False
        if self._reboot_at_s is None:
            self._reboot_at_s = now_s + REBOOT_DELAY_S
        if not self._torque_wanted or now_s < self._reboot_at_s or errors & table.ENCODER_ERROR:
            return False
        hot = self._temperature_c is None or self._temperature_c > COOL_ENOUGH_C
        return not (errors & table.OVERHEATING_ERROR and hot)


def dynamixel_rudder(line: ByteLine, options: DynamixelOptions) -> ServoDriver[Request, frames.StatusPacket]:
    """Make the driver of a Dynamixel servo on a line."""
    timeout_s = reply_timeout_s(line.baud, LONGEST_EXCHANGE_BYTES)
    return ServoDriver(line, DynamixelServo(options, timeout_s), reply_timeout_s=timeout_s)
