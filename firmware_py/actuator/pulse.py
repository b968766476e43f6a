"""Pulse width of a hobby servo: options and conversion that the drivers of servo controllers and PWM outputs share.

A hobby servo turns to the angle that the width of a pulse states, repeated every 20 ms, and holds it. Makers state
1500 us for the centre and 1000 to 2000 us for the range, which is 90 to 120 degrees; both vary between servos, so each
installation is calibrated by its options: either a slope (`us_per_rad`), or the pulses at two angles (`minus_us` and
`plus_us` at `end_deg` to either side), with one slope on each side of the centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec

from firmware_py.common.angles import clamp, radians
from firmware_py.common.options import check, option

MIN_PULSE_US, MAX_PULSE_US = 400.0, 2600.0  # that any servo accepts
DEFAULT_US_PER_RAD = 636.6  # 500 us for 45 degrees


@dataclass(frozen=True, slots=True)
class PulseOptions:
    """Options of the vehicle file for a servo that is driven by pulses; raises ValueError."""

    centre_us: float = option(
        "pulse width at shaft angle 0 [us]", default=1500.0, minimum=MIN_PULSE_US, maximum=MAX_PULSE_US
    )
    us_per_rad: float = option(
        "change of the pulse width per radian of the shaft [us]",
        default=DEFAULT_US_PER_RAD,
        minimum=50.0,
        maximum=5000.0,
    )
    minus_us: float | None = option(
        "measured pulse width at -end_deg [us], with its counterpart instead of us_per_rad",
        default=None,
        minimum=MIN_PULSE_US,
        maximum=MAX_PULSE_US,
    )
    plus_us: float | None = option(
        "measured pulse width at +end_deg [us], with its counterpart instead of us_per_rad",
        default=None,
        minimum=MIN_PULSE_US,
        maximum=MAX_PULSE_US,
    )
    end_deg: float = option("shaft angle of minus_us and plus_us", default=45.0, minimum=5.0, maximum=120.0)
    reversed: bool = option("whether longer pulses turn to smaller angles; RUD_REVERSE does the same", default=False)
    min_us: float = option("shortest pulse width sent [us]", default=1000.0, minimum=MIN_PULSE_US, maximum=MAX_PULSE_US)
    max_us: float = option("longest pulse width sent [us]", default=2000.0, minimum=MIN_PULSE_US, maximum=MAX_PULSE_US)

    def __post_init__(self) -> None:
        """Check the ranges, and that the pulses do not contradict each other."""
        check(self)
        problems = []
        minus_us, plus_us, centre_us = self.minus_us, self.plus_us, self.centre_us
        if not self.min_us <= centre_us <= self.max_us:
            problems.append(f"centre_us: {centre_us:g} is outside min_us {self.min_us:g} to max_us {self.max_us:g}")
        if (minus_us is None) is not (plus_us is None):
            problems.append("minus_us: give minus_us and plus_us, or neither")
        elif minus_us is not None and plus_us is not None and not (minus_us - centre_us) * (plus_us - centre_us) < 0.0:
            problems.append(
                f"minus_us: centre_us {centre_us:g} is not between minus_us {minus_us:g} and plus_us {plus_us:g}"
            )
        if problems:
            raise ValueError("\n".join(problems))


class PulseScale(msgspec.Struct, frozen=True):
    """Conversion of shaft angles to pulse widths; the slopes are those of negative and of positive angles."""

    centre_us: float
    minus_us_per_rad: float
    plus_us_per_rad: float
    min_us: float
    max_us: float

    @classmethod
    def of(cls, options: PulseOptions) -> PulseScale:
        """Read the scale from the options."""
        minus_slope = plus_slope = options.us_per_rad
        if options.minus_us is not None and options.plus_us is not None:
            end_rad = radians(options.end_deg)
            minus_slope = (options.centre_us - options.minus_us) / end_rad
            plus_slope = (options.plus_us - options.centre_us) / end_rad
        sign = -1.0 if options.reversed else 1.0
        if options.reversed:
            minus_slope, plus_slope = plus_slope, minus_slope
        return cls(options.centre_us, sign * minus_slope, sign * plus_slope, options.min_us, options.max_us)

    def pulse_us(self, shaft_rad: float) -> float:
        """Return the pulse width for a shaft angle, within the limits; an angle that is not finite counts as 0."""
        if not math.isfinite(shaft_rad):
            return self.centre_us
        slope = self.plus_us_per_rad if shaft_rad >= 0.0 else self.minus_us_per_rad
        return clamp(self.centre_us + slope * shaft_rad, self.min_us, self.max_us)

    def is_limited(self, shaft_rad: float) -> bool:
        """Return whether the limits shorten or lengthen the pulse for a shaft angle by more than 1 us."""
        slope = self.plus_us_per_rad if shaft_rad >= 0.0 else self.minus_us_per_rad
        return abs(self.centre_us + slope * shaft_rad - self.pulse_us(shaft_rad)) > 1.0
