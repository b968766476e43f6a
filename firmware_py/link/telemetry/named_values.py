"""What the estimator has learned of boat and sea, as named values; None while it is not known."""

from __future__ import annotations

from collections.abc import Callable

from firmware_py.common.angles import degrees
from firmware_py.common.records import Estimate, Water
from firmware_py.link.telemetry.context_fields import TelemetryContext

Value = Callable[[TelemetryContext], float | None]


def _estimate_value(read: Callable[[Estimate], float]) -> Value:
    def value(context: TelemetryContext) -> float | None:
        return None if context.snapshot.estimate is None else read(context.snapshot.estimate)

    return value


def _water_value(read: Callable[[Water], float | None]) -> Value:
    def value(context: TelemetryContext) -> float | None:
        return None if context.snapshot.water is None else read(context.snapshot.water)

    return value


# Of the heading without waves: its standard deviation, what the last one measured differed from the expected one, and
# the average normalised innovation squared, 1 for an honest filter.
heading_sd_deg = _estimate_value(lambda estimate: degrees(estimate.heading_sd_rad))
innovation_deg = _estimate_value(lambda estimate: degrees(estimate.innovation_rad))
innovation_square = _estimate_value(lambda estimate: estimate.innovation_square)
# Compass A 0, compass B 1, course over ground 2, nothing 3.
heading_source = _estimate_value(lambda estimate: float(estimate.source))
# The rudder angle at which she runs straight, and by what she turns better than her model says.
trim_deg = _estimate_value(lambda estimate: degrees(estimate.bias_rad))
turning_factor = _estimate_value(lambda estimate: estimate.turning_factor)
# Of the yaw of the waves.
wave_sd_deg = _estimate_value(lambda estimate: degrees(estimate.wave_sd_rad))
wave_period_s = _estimate_value(lambda estimate: estimate.wave_period_s)
# Speed through the water, and the current; its deviation in the worse known direction.
water_speed_m_s = _water_value(lambda water: water.speed_m_s)
current_north_m_s = _water_value(lambda water: water.current_north_m_s)
current_east_m_s = _water_value(lambda water: water.current_east_m_s)
current_sd_m_s = _water_value(lambda water: water.current_sd_m_s)
