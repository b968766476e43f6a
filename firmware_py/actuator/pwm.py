"""Driver of a hobby servo on a PWM output of the computer (Linux pwmchip).

The line (system/pwm_line.py) sets the pulse width that is written to it: `1500000` and a line feed, in nanoseconds, and
0 for no pulse. A hobby servo sends nothing, so only a line that does not accept a pulse is a fault. The angle is not
measured: the feedback of each accepted pulse has none. Without torque the pulse ends; most servos are then free, some
digital ones hold their last angle. At the end of the program the pulse of the centre continues, because the kernel
repeats it: the servo holds the rudder amidships until the computer is switched off.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from firmware_py.actuator.pulse import PulseOptions, PulseScale
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine, Rudder
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, RudderCommand, RudderFeedback

MAX_FEEDBACK = 8
NO_PULSE = b"0\n"


class PwmServo:
    """An interfaces.Rudder that writes one pulse width per command."""

    def __init__(self, line: ByteLine, options: PulseOptions) -> None:
        """Store the line and the scale."""
        self._line = line
        self._scale = PulseScale.of(options)
        self._shaft_rad: float | None = None
        self._feedback: deque[RudderFeedback] = deque(maxlen=MAX_FEEDBACK)
        self._accepted = 0
        self._rejected = 0
        self._is_failing = False
        self._has_pulse = False

    def fileno(self) -> int:
        """Return -1: a servo sends nothing."""
        return self._line.fileno()

    def needs_prompt_io(self) -> bool:
        """Return False."""
        return False

    def receive(self, now_s: float) -> None:
        """Do nothing: a servo sends nothing."""

    def command(self, command: RudderCommand, now_s: float) -> None:
        """Write the pulse width; an angle that is not finite is rejected, and the last one is repeated."""
        if math.isfinite(command.shaft_rad):
            self._shaft_rad = command.shaft_rad
        else:
            self._rejected += 1
        self._has_pulse = command.torque_on and self._shaft_rad is not None
        data = NO_PULSE
        if command.torque_on and self._shaft_rad is not None:
            data = b"%d\n" % round(1e3 * self._scale.pulse_us(self._shaft_rad))
        is_written = self._line.write(data)
        self._is_failing = self._line.connected and not is_written
        if is_written:
            self._accepted += 1
            self._feedback.append(RudderFeedback(now_s, torque_on=self._has_pulse))

    def poll(self) -> Sequence[RudderFeedback]:
        """Return the feedback since the last poll, oldest first, at most MAX_FEEDBACK; it has no angle."""
        feedback = tuple(self._feedback)
        self._feedback.clear()
        return feedback

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state of the output and its counters at now_s; whether a servo is connected is not known."""
        state, text = self._condition()
        return DeviceHealth(now_s, DeviceRole.RUDDER, state, self._accepted, self._rejected, text)

    def _condition(self) -> tuple[DeviceState, str]:
        if not self._line.connected:
            return DeviceState.ABSENT, f"port {self._line.name} not connected"
        if self._is_failing:
            return DeviceState.SILENT, "the kernel does not accept the pulse width"
        if self._accepted == 0:
            return DeviceState.STARTING, "no pulse yet"
        if not self._has_pulse:
            return DeviceState.RUNNING, "no pulse; the servo is free"
        if self._shaft_rad is not None and self._scale.is_limited(self._shaft_rad):
            return DeviceState.RUNNING, "pulse limited by min_us or max_us"
        return DeviceState.RUNNING, ""


DRIVER: Driver[Rudder] = Driver(
    interface=INTERFACE,
    device="hobby servo on a PWM output of the computer (Linux pwmchip); angle not measured",
    options=PulseOptions,
    make=PwmServo,
    writes=True,
    port="pwm:",
)
