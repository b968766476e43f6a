"""Driver of a Robotis Dynamixel X servo as the rudder.

One half-duplex exchange at a time: the goal goes out first in a tick, the telemetry is
asked for when its status has come. A tick costs 27 bytes for the goal, 46 for the
telemetry and now and then 32 for the state: at 57600 baud 12.7 and at most 18.2 ms, at
1 Mbaud 0.7 and 1.1 ms.

    SEARCH ---any answer---> CONFIGURE ---all known and right---> RUN
      ^                        |  ^                                 |
      |                        |  '--the servo shows a restart------|
      '-------silence----------'------------silence or reboot-------'

* Nothing is written before the first command: `receive` alone only reads.
* CONFIGURE reads the registers and corrects those that differ (dynamixel_upkeep).
* Bus watchdog: after 2 s without any instruction the servo stops and holds the angle it
  has, so a rudder in motion does not go on when the autopilot dies. Ticks down to 1 Hz
  feed it. After a trip goals answer range error; it is then recognised and cleared.
* A servo that has lost its power in between shows it by silence, or by torque or watchdog
  back at their power-up values, and is configured again.
* In silence the driver pings, and every other tick still sends the goal: a servo whose
  answers are lost may hear, and one back from a power loss has its torque off and does
  not move before it is configured.
* A hardware error that has cut the torque is only undone by a reboot. The driver reboots
  3 s after it sees one, then at most every 30 s, only while the rudder is wanted, never
  for an encoder error, and after overheating only once cooled to 60 deg C.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from enum import Enum, auto

from firmware_py.actuator import dynamixel_frames as frames
from firmware_py.actuator import dynamixel_registers as table
from firmware_py.actuator.dynamixel_readings import Readings
from firmware_py.actuator.dynamixel_upkeep import Kind, Request, Restarts, Upkeep
from firmware_py.actuator.half_duplex import HalfDuplex
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, RudderCommand, RudderFeedback

REBOOT_DELAY_S, REBOOT_EVERY_S = 3.0, 30.0
COOL_ENOUGH_C = 60.0
GOALS_REFUSED = 3  # in a row: one or two are a tripped watchdog
FEEDBACK_KEPT = 8
LARGEST_REPLY_LENGTH = 64  # the telemetry has 25, and its stuffing


class Phase(Enum):
    """What the driver is doing."""

    SEARCH = auto()
    CONFIGURE = auto()
    RUN = auto()


class DynamixelRudder:
    """A ports.Rudder; shaft angle 0 is count 2048, positive is increasing counts."""

    def __init__(
        self, line: ByteLine, *, device_id: int = 1, slew_rad_s: float | None = None, reply_timeout_s: float = 0.035
    ) -> None:
        """Take the line and the servo on it.

        Args:
            line: the bus.
            device_id: 0 to 252.
            slew_rad_s: fastest turning of the shaft, kept by the servo itself; None leaves it as it is.
            reply_timeout_s: the default covers 57600 baud and the 16 ms latency timer of a USB adapter.

        Raises:
            ValueError: a value is out of range.
        """
        if not 0 <= device_id <= frames.LARGEST_ID:
            raise ValueError(f"Dynamixel id {device_id}: allowed are 0 to {frames.LARGEST_ID}")
        if not 0.0 < reply_timeout_s <= 1.0:
            raise ValueError(f"Dynamixel reply timeout {reply_timeout_s:g} s: allowed are 0 to 1 s")
        if slew_rad_s is not None and not 0.0 < slew_rad_s < math.inf:
            raise ValueError(f"Dynamixel slew rate {slew_rad_s:g} rad/s: allowed is any above 0")
        self._line = line
        self._id = device_id
        self._bus: HalfDuplex[Request] = HalfDuplex(line, reply_timeout_s)
        self._parser = frames.StatusParser(LARGEST_REPLY_LENGTH)
        self._upkeep = Upkeep(device_id, slew_rad_s)
        self._ping = Request(Kind.PING, frames.ping(device_id), "ping", 3)
        self._reboot = Request(Kind.REBOOT, frames.reboot(device_id), "reboot")
        self._readings = Readings(device_id)
        self._feedback: deque[RudderFeedback] = deque(maxlen=FEEDBACK_KEPT)
        self._accepted = 0
        self._rejected = 0
        self._model = ""

        self._shaft_rad: float | None = None
        self._torque_wanted: bool | None = None  # None: no command yet, so nothing is written
        self._goal_due = False

        self._phase = Phase.SEARCH
        self._heard = False  # since the line was opened
        self._steered = False  # since the line was opened
        self._goal_was_last = False
        self._goals_refused = 0
        self._temperature_c: float | None = None
        self._reboot_at_s: float | None = None
        self._restarts = Restarts()

    def fileno(self) -> int:
        """The descriptor whose bytes `receive` wants, or -1."""
        return self._line.fileno()

    def command(self, command: RudderCommand, now_s: float) -> None:
        """Send the goal, at once when the bus is free; a goal that is not finite is refused and the last one kept."""
        if math.isfinite(command.shaft_rad):
            self._shaft_rad = command.shaft_rad
        else:
            self._rejected += 1
        if self._torque_wanted is None and self._phase is Phase.RUN:  # so far only read, nothing corrected
            self._phase = Phase.CONFIGURE
        self._torque_wanted = command.torque_on
        self._readings.commanded(now_s)
        self._goal_due = True
        if self._bus.outstanding is not None:  # its answer may be there, not yet read
            self._take_bytes(now_s)
        self._advance(now_s)

    def receive(self, now_s: float) -> None:
        """Take what has arrived and send the next instruction, at most one a call."""
        self._take_bytes(now_s)
        self._advance(now_s)

    def poll(self) -> Sequence[RudderFeedback]:
        """The feedback since the last poll, oldest first, at most FEEDBACK_KEPT."""
        taken = tuple(self._feedback)
        self._feedback.clear()
        return taken

    def health(self, now_s: float) -> DeviceHealth:
        """The state of the servo and its counters at now_s."""
        state, text = self._judged(now_s)
        rejected = self._rejected + self._parser.rejected
        return DeviceHealth(now_s, DeviceRole.RUDDER, state, self._accepted, rejected, text)

    def _judged(self, now_s: float) -> tuple[DeviceState, str]:
        if not self._line.connected:
            return DeviceState.ABSENT, f"{self._line.name} is away"
        if self._bus.silent(now_s):
            return DeviceState.SILENT if self._heard else DeviceState.STARTING, f"no answer from servo id {self._id}"
        if errors := self._upkeep.hardware_error():
            cut = "" if self._upkeep.torque_on() else ", torque cut"
            return DeviceState.FAULTY, f"servo error: {table.hardware_error_text(errors)}{cut}"
        if self._goals_refused >= GOALS_REFUSED:
            return DeviceState.FAULTY, "servo refuses goal position"
        if self._upkeep.stuck:
            return DeviceState.FAULTY, self._upkeep.trouble
        return DeviceState.RUNNING if self._phase is Phase.RUN else DeviceState.STARTING, (
            self._upkeep.trouble or self._model
        )

    # ------------------------------------------------------------------ what arrives

    def _take_bytes(self, now_s: float) -> None:
        self._notice_reopening()
        for packet in self._parser.feed(self._line.read()):
            self._take(packet, now_s)

    def _notice_reopening(self) -> None:
        if self._bus.reopened():
            self._parser.clear()
            self._heard = self._steered = False
            self._search()

    def _take(self, packet: frames.StatusPacket, now_s: float) -> None:
        request = self._bus.outstanding
        if (
            request is None
            or packet.device_id != self._id
            or len(packet.parameters) != (0 if packet.code else request.parameters)
        ):
            self._rejected += 1  # late, or another device's
            return
        self._bus.answered()
        self._heard = True
        if self._phase is Phase.SEARCH:
            self._phase = Phase.CONFIGURE
        if packet.alert and not self._upkeep.hardware_error():
            self._readings.state_first()
        if packet.code:
            self._rejected += 1
            self._refused(request, packet.code, now_s)
        else:
            self._accepted += 1
            self._obeyed(request, packet.parameters, now_s)

    def _refused(self, request: Request, code: int, now_s: float) -> None:
        if request.kind is Kind.GOAL:
            self._goals_refused += 1
            # The limits have changed, the watchdog has tripped (which resets the profile) or the torque is gone.
            self._upkeep.forget(table.LIMITS, table.WATCHDOG, table.PROFILE, table.STATE)
        else:
            self._upkeep.refused(request, code, now_s)

    def _obeyed(self, request: Request, data: bytes, now_s: float) -> None:
        if request.kind is Kind.PING:
            self._model = f"model {data[0] | data[1] << 8}, firmware {data[2]}"
        elif request.kind is Kind.GOAL:
            self._goals_refused = 0
        elif request.block is table.TELEMETRY:
            self._publish(data, now_s)
        else:
            self._restarts.read(request, data)
            restarted = self._phase is Phase.RUN and self._upkeep.shows_restart(request, data)
            self._upkeep.obeyed(request, data)
            if restarted:
                self._upkeep.reset()
                self._phase = Phase.CONFIGURE

    def _publish(self, data: bytes, now_s: float) -> None:
        values = table.decode_telemetry(data)
        self._rejected += values.impossible
        self._temperature_c = values.temperature_c
        torque = table.TORQUE_ENABLE.value(self._upkeep.image)
        self._feedback.append(
            RudderFeedback(
                t_s=now_s,
                shaft_rad=values.shaft_rad,
                temperature_c=values.temperature_c,
                voltage_v=values.voltage_v,
                current_a=values.current_a,
                hardware_error=self._upkeep.hardware_error(),
                torque_on=None if torque is None else bool(torque),
                restarts=self._restarts.count,
            )
        )

    # ------------------------------------------------------------------ what is sent

    def _search(self) -> None:
        self._phase = Phase.SEARCH
        self._upkeep.reset()

    def _advance(self, now_s: float) -> None:
        self._notice_reopening()
        if not self._line.connected:
            return
        lost = self._bus.expired(now_s)
        if lost is not None:
            self._upkeep.lost(lost)
        if self._phase is not Phase.SEARCH and self._bus.silent(now_s):
            self._search()
        if self._bus.outstanding is None:
            request = self._next(now_s)
            if request is not None and self._bus.ask(request.frame, request, now_s):
                self._sent(request, now_s)

    def _sent(self, request: Request, now_s: float) -> None:
        self._upkeep.sent(request, now_s)
        self._readings.sent(request, now_s)
        self._goal_was_last = request.kind is Kind.GOAL
        self._restarts.sent(request)
        if self._goal_was_last:
            self._goal_due = False
        elif request.kind is Kind.REBOOT:
            self._reboot_at_s = now_s + REBOOT_EVERY_S
            self._search()

    def _next(self, now_s: float) -> Request | None:
        goal_rad = self._shaft_rad if self._goal_due and self._torque_wanted else None
        if self._phase is Phase.SEARCH:
            blind = self._steered and not self._goal_was_last
            return self._goal(goal_rad) if blind and goal_rad is not None else self._ping
        repair = self._upkeep.next(now_s, torque_wanted=self._torque_wanted, in_use=self._phase is Phase.RUN)
        if repair is not None:
            return repair
        if self._phase is Phase.CONFIGURE:
            if not self._upkeep.complete:
                return self._readings.due(now_s)
            self._phase = Phase.RUN
        if goal_rad is not None and self._upkeep.torque_on():
            self._steered = True
            return self._goal(goal_rad)
        return self._reboot if self._reboot_due(now_s) else self._readings.due(now_s)

    def _goal(self, shaft_rad: float) -> Request:
        counts = table.goal_counts(shaft_rad, self._upkeep.image)
        frame = frames.write(self._id, table.GOAL_POSITION_ADDRESS, counts.to_bytes(4, "little"))
        return Request(Kind.GOAL, frame, "goal position")

    def _reboot_due(self, now_s: float) -> bool:
        errors = self._upkeep.hardware_error()
        if not errors or self._upkeep.torque_on():
            if self._reboot_at_s is not None and now_s >= self._reboot_at_s:
                self._reboot_at_s = None
            return False
        if self._reboot_at_s is None:
            self._reboot_at_s = now_s + REBOOT_DELAY_S
        if not self._torque_wanted or now_s < self._reboot_at_s or errors & table.ENCODER_ERROR:
            return False
        hot = self._temperature_c is None or self._temperature_c > COOL_ENOUGH_C
        return not (errors & table.OVERHEATING_ERROR and hot)
