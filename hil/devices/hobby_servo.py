"""A hobby servo: it turns its shaft to the angle that the pulse width states, and reports nothing."""

from __future__ import annotations

import math
from typing import Any

from hil.devices.emulator import Shaft

MIN_PULSE_US, MAX_PULSE_US = 500.0, 2500.0  # other pulses are ignored
DEADBAND_US = 5.0  # of an ordinary analogue servo


class HobbyServo:
    """The electronics of a servo: the scale of its pulses, and a deadband in which the motor does not start.

    The slew is that of the shaft. Without pulses the motor is released.
    """

    def __init__(
        self,
        shaft: Shaft,
        *,
        centre_us: float = 1500.0,
        minus_us_per_rad: float = 636.6,
        plus_us_per_rad: float = 636.6,
        deadband_us: float = DEADBAND_US,
    ) -> None:
        """Start without pulses; the slopes are those of negative and positive angles."""
        self.width_us: float | None = None  # of the present pulses; None without pulses
        self._shaft = shaft
        self._centre_us = centre_us
        self._slopes = minus_us_per_rad, plus_us_per_rad
        self._deadband_us = deadband_us
        self._reached_us: float | None = None  # pulse width of the last movement
        shaft.set_torque(on=False)

    @classmethod
    def calibrated(cls, shaft: Shaft, options: Any) -> HobbyServo:
        """Return the servo for which the options of the vehicle file are the right calibration."""
        minus = plus = options.us_per_rad
        if options.minus_us is not None and options.plus_us is not None:
            end_rad = math.radians(options.end_deg)
            minus = (options.centre_us - options.minus_us) / end_rad
            plus = (options.plus_us - options.centre_us) / end_rad
        if options.reversed:
            minus, plus = -plus, -minus
        return cls(shaft, centre_us=options.centre_us, minus_us_per_rad=minus, plus_us_per_rad=plus)

    def set_pulse(self, width_us: float | None) -> None:
        """Set the width of the pulses from now on; None: no pulses."""
        if width_us is not None and not MIN_PULSE_US <= width_us <= MAX_PULSE_US:
            width_us = None
        self.width_us = width_us
        if width_us is None:
            self._reached_us = None
            self._shaft.set_torque(on=False)
            return
        if self._reached_us is not None and abs(width_us - self._reached_us) < self._deadband_us:
            return
        self._reached_us = width_us
        self._shaft.set_target(self._angle_rad(width_us))
        self._shaft.set_torque(on=True)

    def _angle_rad(self, width_us: float) -> float:
        """Return the angle of a pulse width: the one of the two sides on which the angle has the right sign."""
        minus, plus = self._slopes
        offset_us = width_us - self._centre_us
        return offset_us / plus if offset_us / plus >= 0.0 else offset_us / minus
