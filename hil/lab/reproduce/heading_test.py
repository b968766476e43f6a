"""The heading control test in the tank: a closed-loop run of the autopilot, and the model identified from its log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import DEGREES_PER_RADIAN, wrap_pi
from hil.lab.identify import onboard_log
from hil.lab.identify.identify import Identification, identify
from hil.lab.identify.predict import Prediction
from hil.lab.identify.recording import Source
from hil.lab.tune import paper
from hil.lab.tune.trials import FIXED_GAINS
from hil.ship import scenarios
from hil.sim.goals import Goal
from hil.sim.logbook import RunOptions
from hil.sim.runner import run
from hil.sim.truth import Truth

Floats = NDArray[np.float64]

TANK = "tank"
PAPER_SETTINGS = {"CTL_K1": paper.PAPER_K1, "CTL_K2": paper.PAPER_K2}
GOALS_DEG = (0.0, 40.0, -20.0, 20.0, -40.0)  # repeated
WAVE_PERIODS = 2.0  # averaging time of yaw rates, which removes most of the wave yaw
GOAL_S = 75.0  # long enough for the largest step, 60 deg at 1.45 deg/s, and half a minute of course keeping


@dataclass(frozen=True, slots=True)
class HeadingTest:
    """The model of the first part of the run, and the second part, which the model is compared with.

    start_rad: first heading of the second part. rate_span_s: averaging time of yaw rates.
    """

    found: Identification
    held_out: Truth
    start_rad: float
    rate_span_s: float

    @property
    def prediction(self) -> Prediction:
        """Return the second part, measured and predicted from its rudder alone."""
        (prediction,) = self.found.validate[0].predictions
        return prediction

    @property
    def time_s(self) -> Floats:
        """Return the times of the measured and predicted headings and yaw rates."""
        return self.prediction.stretch.time_s

    @property
    def measured_deg(self) -> Floats:
        """Return the compass heading."""
        return (self._compass_rad + self.start_rad) * DEGREES_PER_RADIAN

    @property
    def predicted_deg(self) -> Floats:
        """Return the predicted heading."""
        return (self.prediction.heading_rad + self.start_rad) * DEGREES_PER_RADIAN

    @property
    def heading_error_deg(self) -> Floats:
        """Return predicted minus measured heading."""
        return self.predicted_deg - self.measured_deg

    @property
    def measured_rate_deg_s(self) -> Floats:
        """Return the yaw rate of the compass, since there is no gyroscope in the test."""
        return self._rate_deg_s(self._compass_rad)

    @property
    def predicted_rate_deg_s(self) -> Floats:
        """Return the yaw rate of the predicted heading."""
        return self._rate_deg_s(self.prediction.heading_rad)

    @property
    def hull_rate_deg_s(self) -> Floats:
        """Return the yaw rate of the hull without wave-frequency yaw, which no device measures."""
        return self._rate_deg_s(np.interp(self.time_s, self.held_out.time_s, self.held_out.heading_low_rad))

    @property
    def _compass_rad(self) -> Floats:
        return self.prediction.stretch.measured(headings=True)

    def _rate_deg_s(self, heading_rad: Floats) -> Floats:
        rate_rad_s = mean_rate(self.time_s, heading_rad, self.rate_span_s)
        return rate_rad_s * DEGREES_PER_RADIAN


def mean_rate(time_s: Floats, heading_rad: Floats, over_s: float) -> Floats:
    """Return the mean yaw rate [rad/s] over a span around each time, shorter at both ends."""
    before_s = np.maximum(time_s - 0.5 * over_s, time_s[0])
    after_s = np.minimum(time_s + 0.5 * over_s, time_s[-1])
    turned_rad = np.interp(after_s, time_s, heading_rad) - np.interp(before_s, time_s, heading_rad)
    return np.asarray(turned_rad / (after_s - before_s), dtype=np.float64)


def run_heading_test(train_s: float, held_out_s: float, out: Path, seed: int) -> HeadingTest:
    """Steer headings with the paper's gains in the tank, and identify the model from the first part of the log."""
    tank, seconds = scenarios.find_scenario(TANK), train_s + held_out_s
    options = RunOptions(
        scenario=tank,
        seconds=seconds,
        out=out,
        seed=seed,
        goals=goals(seconds),
        settings={**FIXED_GAINS, **PAPER_SETTINGS},
    )
    truth = run(options).truth.table()
    log = next(out.glob("state/logs/*.BIN"))
    recording = onboard_log.read(log)
    first, second = (recording.part(part) for part in (Source(log, None, train_s), Source(log, train_s, None)))
    kept = truth.time_s >= train_s
    held_out = Truth(*(getattr(truth, name)[kept] for name in Truth.__dataclass_fields__))
    headings_rad = np.zeros(1) if second.heading_rad is None else second.heading_rad  # a log has headings
    start_rad = wrap_pi(float(headings_rad[0]))
    return HeadingTest(identify([first], [second]), held_out, start_rad, WAVE_PERIODS * tank.wave_period_s)


def goals(seconds: float) -> tuple[Goal, ...]:
    """Return the goals of a test of this duration."""
    count = max(1, int(seconds / GOAL_S))
    return tuple(Goal(number * GOAL_S, GOALS_DEG[number % len(GOALS_DEG)]) for number in range(count))
