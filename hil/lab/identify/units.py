"""Check the units of angles: jumps, turns and speed reveal a table in degrees."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from firmware_py.common.angles import radians
from hil.errors import UsageError
from hil.lab.identify.recording import Floats

NORTH_JUMP_DEG = (300.0, 360.5)  # range of a jump of a heading in degrees at north
MAX_HEADING_RAD = 2.0 * math.pi * 1.01
MAX_RUDDER_RAD = 1.6
MIN_RADIUS_M = 0.5  # no boat with a rudder has a smaller turning radius
MIN_USUAL_RADIUS_M, MAX_USUAL_RATE_RAD_S = 1.0, 0.3  # few boats turn tighter or faster
MAX_RATE_RATIO = 5.0  # largest ratio of yaw rate and heading turns in the same unit
REMEDY = "name the columns by their units, rudder_deg, heading_deg, yaw_rate_deg_s, or convert them"


@dataclass(frozen=True, slots=True)
class Angles:
    """Heading and yaw rate in radians, with notes and warnings."""

    heading_rad: Floats | None
    yaw_rate_rad_s: Floats | None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def convert_angles(
    where: str,
    time_s: Floats,
    heading: Floats | None,
    rate: Floats | None,
    speed: Floats | None,
    *,
    is_rudder_in_degrees: bool,
    are_units_named: bool,
) -> Angles:
    """Convert a heading that jumps by 360, and its yaw rate, from degrees; raise UsageError for impossible motions.

    heading, rate: treated as radians. is_rudder_in_degrees: then heading and yaw rate are probably in degrees, too.
    are_units_named: the column names contain the units, so that a doubt is only a warning.
    """
    if heading is not None and jumps_at_360(heading):
        notes = [f"{where}: the heading jumps by 360: converted from degrees"]
        heading_rad = np.unwrap(heading * radians(1.0))
        if rate is not None and not _rates_agree(time_s, heading_rad, rate):
            rate = rate * radians(1.0)
            notes.append(f"{where}: the yaw rate was converted from degrees, too")
        return Angles(heading * radians(1.0), rate, tuple(notes))
    quantile_rad_s = _rate_quantile(time_s, heading, rate)
    speed_m_s = None if speed is None else float(np.median(np.abs(speed)))
    if speed_m_s is not None and speed_m_s > 0.0 and quantile_rad_s * MIN_RADIUS_M > speed_m_s:
        doubt = (
            f"at {speed_m_s:.2g} m/s the boat would turn within {speed_m_s / quantile_rad_s:.2g} m "
            f"({math.degrees(quantile_rad_s):.0f} deg/s)"
        )
        if not are_units_named or is_rudder_in_degrees:
            raise UsageError(f"{where}: {doubt}: are heading and yaw rate in degrees? {REMEDY}")
        return Angles(heading, rate, warnings=(f"{doubt}; radians used as named, which is possible for a model boat",))
    if is_rudder_in_degrees and _has_degree_motion(heading, quantile_rad_s, speed_m_s):
        raise UsageError(
            f"{where}: with a rudder in degrees, heading and yaw rate are likely to be in degrees, too "
            f"(or the boat turns at {math.degrees(quantile_rad_s):.0f} deg/s); {REMEDY}"
        )
    return Angles(heading, rate)


def are_degrees(rudder: Floats | None, heading: Floats | None) -> bool:
    """Return whether angles without unit are in degrees: a rudder exceeds 1.6, or a heading 2 pi."""
    if rudder is not None and float(np.max(np.abs(rudder))) > MAX_RUDDER_RAD:
        return True
    return heading is not None and float(np.max(np.abs(heading))) > MAX_HEADING_RAD


def rate_unit(time_s: Floats, heading_rad: Floats, rate: Floats) -> float:
    """Return the size of the yaw rate's unit (rad/s, deg/s or deg/min) that fits the heading."""
    sds = _rate_sds(time_s, np.unwrap(heading_rad), rate)
    log_ratio = math.log(max(sds[0], 1e-12) / max(sds[1], 1e-12))
    return min((1.0, radians(1.0), radians(1.0) / 60.0), key=lambda unit: abs(math.log(unit) - log_ratio))


def _has_degree_motion(heading: Floats | None, quantile_rad_s: float, speed_m_s: float | None) -> bool:
    if speed_m_s is not None and speed_m_s > 0.0:
        return quantile_rad_s * MIN_USUAL_RADIUS_M > speed_m_s
    exceeds_turn = heading is not None and float(np.max(np.abs(heading))) > MAX_HEADING_RAD
    return exceeds_turn or quantile_rad_s > MAX_USUAL_RATE_RAD_S


def jumps_at_360(heading: Floats) -> bool:
    """Return whether headings jump by 360, as those in degrees at north."""
    jumps = np.abs(np.diff(heading))
    is_in_range = float(np.min(heading)) >= -NORTH_JUMP_DEG[1] and float(np.max(heading)) <= NORTH_JUMP_DEG[1]
    return is_in_range and bool(np.any((jumps > NORTH_JUMP_DEG[0]) & (jumps < NORTH_JUMP_DEG[1])))


def _rates_agree(time_s: Floats, heading: Floats, rate: Floats) -> bool:
    """Return whether the size of a yaw rate fits the heading."""
    sds = _rate_sds(time_s, heading, rate)
    return sds[1] < MAX_RATE_RATIO * max(sds[0], 1e-12)


def _rate_sds(time_s: Floats, heading: Floats, rate: Floats) -> tuple[float, float]:
    """Return the standard deviations of the rate of the heading and of the yaw rate, averaged to reduce noise."""
    turns = np.diff(heading) / np.diff(time_s)
    every = max(1, turns.size // 200)
    rows = turns.size // every * every
    means = [values[:rows].reshape(-1, every).mean(axis=1) for values in (turns, rate[:-1])]
    return float(np.std(means[0])), float(np.std(means[1]))


def _rate_quantile(time_s: Floats, heading: Floats | None, rate: Floats | None) -> float:
    """Return the 95 % quantile of the yaw rate, averaged to reduce noise."""
    if rate is None and heading is not None:
        rate = np.gradient(np.unwrap(heading), time_s)
    if rate is None:
        return 0.0
    every = max(1, rate.size // 500)
    rows = rate.size // every * every
    return float(np.quantile(np.abs(rate[:rows].reshape(-1, every).mean(axis=1)), 0.95))
