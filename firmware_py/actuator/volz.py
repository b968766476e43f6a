"""Driver of a Volz DA servo as the rudder.

The servo keeps no settings that the driver needs and has no torque switch, no error
report and no start-up: every tick sets the position, whose reply is the measured angle,
and then asks in turn for one of voltage, current and temperature. An exchange is 12 bytes,
1.04 ms at 115200 baud, and the servo takes up to 1.56 ms for it; the next request waits
for the reply or for the timeout.

* Silence is the only fault that can be seen. The driver goes on sending the position, so
  the servo follows again with the first frame it hears after a power loss.
* The motor cannot be released: with `torque_on` False no position is sent, the servo holds
  the last one by itself, and only voltage, current and temperature are read. The angle is
  then not known, and `RudderFeedback.torque_on` is None.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from firmware_py.actuator import volz_frames as frames
from firmware_py.actuator.half_duplex import HalfDuplex, Pace
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, RudderCommand, RudderFeedback

FEEDBACK_KEPT = 8
LARGEST_ID = 0x1E


class VolzRudder:
    """A ports.Rudder; shaft angle 0 is 0x0800, positive is increasing counts."""

    def __init__(self, line: ByteLine, *, device_id: int = 1, reply_timeout_s: float = 0.018) -> None:
        """Take the line and the servo on it.

        Args:
            line: the bus.
            device_id: 1 to 30.
            reply_timeout_s: the default covers the 1.56 ms of an exchange and the 16 ms latency timer of a USB adapter.

        Raises:
            ValueError: a value is out of range.
        """
        if not 1 <= device_id <= LARGEST_ID:
            raise ValueError(f"Volz id {device_id}: allowed are 1 to {LARGEST_ID}")
        if not 0.0 < reply_timeout_s <= 1.0:
            raise ValueError(f"Volz reply timeout {reply_timeout_s:g} s: allowed are 0 to 1 s")
        self._line = line
        self._id = device_id
        self._bus: HalfDuplex[int] = HalfDuplex(line, reply_timeout_s)
        self._parser = frames.ReplyParser(device_id)
        self._pace = Pace()
        self._readings = deque(
            (code, frames.request(code, device_id))
            for code in (frames.READ_VOLTAGE, frames.READ_CURRENT, frames.READ_TEMPERATURE)
        )
        self._feedback: deque[RudderFeedback] = deque(maxlen=FEEDBACK_KEPT)
        self._accepted = 0
        self._rejected = 0
        self._heard = False  # since the line was opened

        self._shaft_rad: float | None = None
        self._torque_wanted = False
        self._position_due = False
        self._reading_due = False
        self._reading_s = -math.inf

        self._voltage_v: float | None = None
        self._current_a: float | None = None
        self._temperature_c: float | None = None

    def fileno(self) -> int:
        """The descriptor whose bytes `receive` wants, or -1."""
        return self._line.fileno()

    def command(self, command: RudderCommand, now_s: float) -> None:
        """Send the position, at once when the bus is free; one that is not finite is refused and the last one kept."""
        if math.isfinite(command.shaft_rad):
            self._shaft_rad = command.shaft_rad
        else:
            self._rejected += 1
        self._torque_wanted = command.torque_on
        self._pace.commanded(now_s)
        self._position_due = self._reading_due = True
        if self._bus.outstanding is not None:  # its reply may be there, not yet read
            self._take_bytes(now_s)
        self._advance(now_s)

    def receive(self, now_s: float) -> None:
        """Take what has arrived and send the next request, at most one a call."""
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
        if not self._heard:
            return DeviceState.STARTING, f"no answer from servo id {self._id}"
        if self._bus.silent(now_s):
            return DeviceState.SILENT, f"no answer from servo id {self._id}"
        return DeviceState.RUNNING, "" if self._torque_wanted else "not steered; this servo cannot release its motor"

    # ------------------------------------------------------------------ what arrives

    def _notice_reopening(self) -> None:
        if self._bus.reopened():
            self._parser.clear()
            self._heard = False
            self._forget_readings()

    def _forget_readings(self) -> None:
        self._voltage_v = self._current_a = self._temperature_c = None

    def _take_bytes(self, now_s: float) -> None:
        self._notice_reopening()
        for reply in self._parser.feed(self._line.read()):
            asked = self._bus.outstanding
            if asked is None or reply.code != frames.REPLY_OF[asked]:
                self._rejected += 1  # late
                continue
            self._bus.answered()
            self._heard = True
            self._accepted += 1
            self._take(reply, now_s)

    def _take(self, reply: frames.Reply, now_s: float) -> None:
        shaft_rad = None
        if reply.code == frames.POSITION_REPLY:
            value = shaft_rad = reply.shaft_rad()
        elif reply.code == frames.VOLTAGE_REPLY:
            value = self._voltage_v = reply.voltage_v()
        elif reply.code == frames.CURRENT_REPLY:
            value = self._current_a = reply.current_a()
        else:
            value = self._temperature_c = reply.temperature_c()
        self._rejected += value is None
        if reply.code == frames.POSITION_REPLY or not self._torque_wanted:
            self._publish(shaft_rad, now_s)

    def _publish(self, shaft_rad: float | None, now_s: float) -> None:
        self._feedback.append(
            RudderFeedback(
                t_s=now_s,
                shaft_rad=shaft_rad,
                temperature_c=self._temperature_c,
                voltage_v=self._voltage_v,
                current_a=self._current_a,
                torque_on=True if self._torque_wanted else None,
            )
        )

    # ------------------------------------------------------------------ what is sent

    def _advance(self, now_s: float) -> None:
        self._notice_reopening()
        if not self._line.connected:
            return
        self._bus.expired(now_s)
        if self._bus.silent(now_s):
            self._forget_readings()
        if self._bus.outstanding is not None:
            return
        if self._position_due and self._torque_wanted and self._shaft_rad is not None:
            frame = frames.set_position(self._id, self._shaft_rad)
            self._position_due = not self._bus.ask(frame, frames.SET_POSITION, now_s)
        elif (self._reading_due and self._pace.early(now_s)) or self._pace.overdue(now_s - self._reading_s):
            code, frame = self._readings[0]
            if self._bus.ask(frame, code, now_s):
                self._readings.rotate(-1)
                self._reading_due = False
                self._reading_s = now_s
