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
GOALS_DEG = (0.0, 40.0, -20.0, 20.0, -40.0)  # in this order, repeatedly
WAVE_PERIODS = 2.0  # averaging time of yaw rates, which removes most of the wave yaw
GOAL_S = 75.0  # time for the largest turn, 60 deg at 1.45 deg/s, and half a minute of course keeping


@dataclass(frozen=True, slots=True)
class HeadingTest:
    """The model from the first part of the run, and the second part, with which the model is compared.

    start_rad: first heading of the second part. rate_span_s: averaging time of yaw rates.
    """

    identification: Identification
    validation_truth: Truth
    start_rad: float
    rate_span_s: float

    @property
    def prediction(self) -> Prediction:
        """Return the prediction of the second part from its rudder alone."""
        (prediction,) = self.identification.validate[0].predictions
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
        return self._rate_deg_s(
            np.interp(self.time_s, self.validation_truth.time_s, self.validation_truth.heading_low_rad)
        )

    @property
    def _compass_rad(self) -> Floats:
        return self.prediction.stretch.measured(use_headings=True)

    def _rate_deg_s(self, heading_rad: Floats) -> Floats:
        rate_rad_s = mean_rate(self.time_s, heading_rad, self.rate_span_s)
        return rate_rad_s * DEGREES_PER_RADIAN


def mean_rate(time_s: Floats, heading_rad: Floats, span_s: float) -> Floats:
    """Return the mean yaw rate [rad/s] over `span_s` around each time; the span is shorter at both ends."""
    start_s = np.maximum(time_s - 0.5 * span_s, time_s[0])
    end_s = np.minimum(time_s + 0.5 * span_s, time_s[-1])
    change_rad = np.interp(end_s, time_s, heading_rad) - np.interp(start_s, time_s, heading_rad)
    return np.asarray(change_rad / (end_s - start_s), dtype=np.float64)


def run_heading_test(train_s: float, validation_s: float, out: Path, seed: int) -> HeadingTest:
    """Steer headings with the paper's gains in the tank, and identify the model from the first part of the log."""
    tank, seconds = scenarios.find_scenario(TANK), train_s + validation_s
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
    is_validation = truth.time_s >= train_s
    validation_truth = Truth(*(getattr(truth, name)[is_validation] for name in Truth.__dataclass_fields__))
    headings_rad = np.zeros(1) if second.heading_rad is None else second.heading_rad  # never None for a log
    start_rad = wrap_pi(float(headings_rad[0]))
    return HeadingTest(identify([first], [second]), validation_truth, start_rad, WAVE_PERIODS * tank.wave_period_s)


def goals(seconds: float) -> tuple[Goal, ...]:
    """Return the goals of a test that lasts `seconds`."""
    count = max(1, int(seconds / GOAL_S))
    return tuple(Goal(number * GOAL_S, GOALS_DEG[number % len(GOALS_DEG)]) for number in range(count))
