"""Judges the units of angles together: jumps, turns and speed show a table in degrees."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from firmware_py.common.angles import radians
from hil.errors import UsageError
from hil.lab.identify.recording import Floats

FULL_DEG = (300.0, 360.5)  # a jump of a heading that goes round in degrees
TURN_RAD = 2.0 * math.pi * 1.01
LARGEST_RUDDER_RAD = 1.6
LEAST_RADIUS_M = 0.5  # nothing with a rudder turns shorter
USUAL_RADIUS_M, USUAL_RATE_RAD_S = 1.0, 0.3  # hardly anything with a rudder in degrees turns shorter or faster
AGREEMENT = 5.0  # times, that a yaw rate may be off what the heading does and still be in its unit
REMEDY = "name the columns by their units, rudder_deg, heading_deg, yaw_rate_deg_s, or convert them"


@dataclass(frozen=True, slots=True)
class Angles:
    """Heading, yaw rate and rudder in radians, and what was said of them."""

    heading_rad: Floats | None
    yaw_rate_rad_s: Floats | None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def judged(
    where: str,
    time_s: Floats,
    heading: Floats | None,
    rate: Floats | None,
    speed: Floats | None,
    *,
    degrees: bool,
    named: bool,
) -> Angles:
    """Take a heading that goes round at 360 for degrees, and its yaw rate with it; refuse what no ship does.

    heading, rate: as if in radians. degrees: the rudder is in degrees, so the others are likely to be, too. named: the
    columns' names state their units, which are believed: a doubt is a warning.
    """
    if heading is not None and goes_round_at_360(heading):
        notes = [f"{where}: the heading jumps by 360: it is in degrees, and was converted"]
        turned = np.unwrap(heading * radians(1.0))
        if rate is not None and not _agrees(time_s, turned, rate):
            rate = rate * radians(1.0)
            notes.append(f"{where}: the yaw rate is in degrees, too, and was converted")
        return Angles(heading * radians(1.0), rate, tuple(notes))
    fast_rad_s = _fast(time_s, heading, rate)
    speed_m_s = None if speed is None else float(np.median(np.abs(speed)))
    if speed_m_s is not None and speed_m_s > 0.0 and fast_rad_s * LEAST_RADIUS_M > speed_m_s:
        doubt = (
            f"at {speed_m_s:.2g} m/s the boat would turn within {speed_m_s / fast_rad_s:.2g} m "
            f"({math.degrees(fast_rad_s):.0f} deg/s)"
        )
        if not named or degrees:
            raise UsageError(f"{where}: {doubt}: are heading and yaw rate in degrees? {REMEDY}")
        return Angles(heading, rate, warnings=(f"{doubt}; radians as named are believed: right for a model boat",))
    if degrees and _doubtful(heading, fast_rad_s, speed_m_s):
        raise UsageError(
            f"{where}: with a rudder in degrees, heading and yaw rate are likely to be in degrees, too "
            f"(or the boat turns at {math.degrees(fast_rad_s):.0f} deg/s); {REMEDY}"
        )
    return Angles(heading, rate)


def unnamed_in_degrees(rudder: Floats | None, heading: Floats | None) -> bool:
    """Whether angles whose names say no unit are degrees: by a rudder beyond 1.6 or a heading beyond a turn."""
    if rudder is not None and float(np.max(np.abs(rudder))) > LARGEST_RUDDER_RAD:
        return True
    return heading is not None and float(np.max(np.abs(heading))) > TURN_RAD


def rate_unit(time_s: Floats, heading_rad: Floats, rate: Floats) -> float:
    """Return the size of a yaw rate's unit, rad/s, deg/s or deg/min, by what the heading does."""
    sizes = _sizes(time_s, np.unwrap(heading_rad), rate)
    wanted = math.log(max(sizes[0], 1e-12) / max(sizes[1], 1e-12))
    return min((1.0, radians(1.0), radians(1.0) / 60.0), key=lambda unit: abs(math.log(unit) - wanted))


def _doubtful(heading: Floats | None, fast_rad_s: float, speed_m_s: float | None) -> bool:
    if speed_m_s is not None and speed_m_s > 0.0:
        return fast_rad_s * USUAL_RADIUS_M > speed_m_s
    beyond = heading is not None and float(np.max(np.abs(heading))) > TURN_RAD
    return beyond or fast_rad_s > USUAL_RATE_RAD_S


def goes_round_at_360(heading: Floats) -> bool:
    """Whether headings jump by 360, as those in degrees do at north."""
    jumps = np.abs(np.diff(heading))
    inside = float(np.min(heading)) >= -FULL_DEG[1] and float(np.max(heading)) <= FULL_DEG[1]
    return inside and bool(np.any((jumps > FULL_DEG[0]) & (jumps < FULL_DEG[1])))


def _agrees(time_s: Floats, heading: Floats, rate: Floats) -> bool:
    """Whether a yaw rate is of the size that the heading turns at."""
    sizes = _sizes(time_s, heading, rate)
    return sizes[1] < AGREEMENT * max(sizes[0], 1e-12)


def _sizes(time_s: Floats, heading: Floats, rate: Floats) -> tuple[float, float]:
    """Return how much the heading's slope and the yaw rate vary, in means that noise hardly shows in."""
    turns = np.diff(heading) / np.diff(time_s)
    every = max(1, turns.size // 200)
    rows = turns.size // every * every
    means = [values[:rows].reshape(-1, every).mean(axis=1) for values in (turns, rate[:-1])]
    return float(np.std(means[0])), float(np.std(means[1]))


def _fast(time_s: Floats, heading: Floats | None, rate: Floats | None) -> float:
    """Return the yaw rate that is hardly ever exceeded, of means so that noise does not count."""
    if rate is None and heading is not None:
        rate = np.gradient(np.unwrap(heading), time_s)
    if rate is None:
        return 0.0
    every = max(1, rate.size // 500)
    rows = rate.size // every * every
    return float(np.quantile(np.abs(rate[:rows].reshape(-1, every).mean(axis=1)), 0.95))
