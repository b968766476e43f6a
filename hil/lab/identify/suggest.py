"""Which manoeuvre would settle what the log leaves open, and how long it would take: by calculation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from firmware_py.common.angles import degrees, radians
from hil.lab.identify.accuracy import Information
from hil.lab.identify.fit import CUBIC, Fit
from hil.lab.identify.noise import score_covariances
from hil.lab.identify.predict import Point, Start
from hil.lab.identify.recording import Floats
from hil.lab.identify.refine import State
from hil.lab.identify.stretch import Stretch
from hil.lab.identify.verdict import CERTAIN, IDENTIFIABLE, LOOSE, Judgement

CIRCLE_RAD = radians(30.0)
SLEW_RAD_S = radians(30.0)
LENGTHS_S = (300.0, 600.0, 1200.0, 2400.0, 4800.0, 9600.0, 19200.0)
MOST_ROWS = 20_000
GUESSED_CUBIC = 0.01  # alpha r^2 at full rudder when nothing is known: the paper's boat


@dataclass(frozen=True, slots=True)
class Suggestion:
    """What to sail, in words; seconds is None when nothing that was tried is long enough."""

    text: str
    seconds: float | None


def suggest(fit: Fit, judgement: Judgement, *, angular: bool = True) -> Suggestion | None:
    """Return the shortest of a few manoeuvres that would settle K, T and alpha, None when all are settled.

    angular: whether the rudder column is an angle, and not a command of another unit.
    """
    estimates = judgement.estimates
    open_ = [name for name in ("K", "T", "alpha") if estimates[name].verdict != IDENTIFIABLE]
    if not open_:
        return None
    if not judgement.usable:
        return Suggestion(
            "sail a zigzag: 20 deg of rudder to each side by turns, each side until she has turned 20 deg, for 10 "
            "minutes; if that tells nothing either, check that the rudder column is what moves her",
            None,
        )
    rudder = np.concatenate([stretch.rudder_rad for stretch in fit.problem.data.stretches])
    largest = float(np.max(np.abs(rudder)))
    angle = max(largest, CIRCLE_RAD) if angular else largest
    shown = f"rudder {degrees(angle):.0f} deg" if angular else f"command {angle:.3g}"
    if fit.outlasts_log:
        return Suggestion(
            f"T is longer than the log: sail circles, {shown} to starboard, then to port, then a third of it to each "
            "side, each until she turns no faster",
            None,
        )
    names = {"K": (0, LOOSE), "T": (1, LOOSE), "alpha": (2, 1.0 / CERTAIN)}
    wanted = [names[name] for name in open_]
    for seconds in LENGTHS_S:
        for title, manoeuvre in (("a zigzag", _zigzag), ("circles", _circles)):
            if title == "a zigzag" and "alpha" in open_:
                continue
            spread = _expected(fit, manoeuvre(fit, seconds, angle))
            if all(spread[place] <= limit for place, limit in wanted):
                return Suggestion(_text(title, fit, open_, seconds, shown), seconds)
    return Suggestion(
        f"{' and '.join(open_)}: even {LENGTHS_S[-1] / 3600.0:.1f} h of circles would not do with this noise; "
        "steer larger rudder angles, or measure the yaw rate with less noise",
        None,
    )


def _text(title: str, fit: Fit, open_: list[str], seconds: float, shown: str) -> str:
    lag_s = float(fit.physical[1])
    what = f"to settle {' and '.join(open_)}, sail {seconds / 60.0:.0f} min of {title}: "
    if title == "circles":
        return (
            f"{what}{shown} to starboard, then to port, then a third of it to each side, "
            f"each for {_leg(fit, seconds):.0f} s, over and over"
        )
    return f"{what}{shown} to each side by turns, {2.5 * lag_s:.0f} s each"


def _leg(fit: Fit, seconds: float) -> float:
    return float(min(max(8.0 * float(fit.physical[1]), 20.0), seconds / 4.0))


def _zigzag(fit: Fit, seconds: float, angle: float) -> tuple[Floats, Floats]:
    time_s = _times(fit, seconds)
    leg_s = max(2.5 * float(fit.physical[1]), 2.0 * float(time_s[1]))
    return time_s, _slewed(time_s, angle * np.where((time_s // leg_s) % 2 == 0, 1.0, -1.0), angle)


def _circles(fit: Fit, seconds: float, angle: float) -> tuple[Floats, Floats]:
    time_s = _times(fit, seconds)
    legs = angle * np.array([1.0, -1.0, 1.0 / 3.0, -1.0 / 3.0])
    return time_s, _slewed(time_s, legs[((time_s // _leg(fit, seconds)) % 4).astype(int)], angle)


def _times(fit: Fit, seconds: float) -> Floats:
    usual_s = fit.problem.data.usual_step_s
    rows = int(min(max(seconds / usual_s, 10.0), MOST_ROWS))
    return np.linspace(0.0, seconds, rows)


def _slewed(time_s: Floats, target: Floats, angle: float) -> Floats:
    """Turn steps into the ramps of a servo: the mean of the target over the time that a full swing takes."""
    step_s = float(time_s[1] - time_s[0])
    width = max(1, int(2.0 * min(angle, 1.0) / SLEW_RAD_S / step_s))
    return np.convolve(np.pad(target, (width - 1, 0), mode="edge"), np.ones(width) / width, mode="valid")


def _expected(fit: Fit, manoeuvre: tuple[Floats, Floats]) -> Floats:
    """Return the relative standard errors of K, T and alpha that the manoeuvre would give with this log's noise."""
    time_s, rudder = manoeuvre
    one = fit.problem.data.stretches[0]
    empty = np.zeros(time_s.size)
    stretch = Stretch.of(
        "suggested",
        time_s,
        rudder,
        None if one.heading_rad is None else empty,
        None if one.yaw_rate_rad_s is None else empty,
        np.ones(time_s.size),
    )
    problem = replace(fit.problem, data=replace(fit.problem.data, stretches=(stretch,)), free=CUBIC)
    values = fit.state.point.values.copy()
    gain = math.exp(values[0])
    fastest = max(gain * float(np.max(np.abs(rudder))), 1e-12)
    least = GUESSED_CUBIC * (problem.scales.yaw_rate_rad_s / fastest) ** 2
    values[2] = max(values[2], least)
    state = State(Point(values, fit.state.point.sign), (Start(0.0, 0.0),))
    linear = problem.linear(stretch, state, state.starts[0])
    rows = time_s.size
    usual_s = fit.problem.data.usual_step_s
    # Where the manoeuvre is thinned out each of its rows stands for several of the log.
    share = float(time_s[1] - time_s[0]) / usual_s
    own = share * np.array([by.T @ by for by in linear.slopes])
    mixed = share * score_covariances(fit.accuracy.noise, linear.slopes)
    known = Information(own, mixed, len(CUBIC), fit.accuracy.noise, rows)
    spread = np.sqrt(np.maximum(np.diag(known.covariance(fit.problem.channel_weights())), 0.0))
    return np.array([spread[0], spread[1], spread[2] / values[2]])
