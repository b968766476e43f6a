"""Compass swing under way: pass the inputs of ticks, live or from a log, to the deviation filter."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from itertools import groupby
from typing import Final

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import CalibrationState, Inputs
from firmware_py.common.reports import SwingReport
from firmware_py.estimate import declination, deviation_filter, position, variation
from firmware_py.estimate.declination import Declination
from firmware_py.estimate.deviation import Deviation
from firmware_py.estimate.deviation_filter import DeviationEstimate, DeviationInput, DeviationSettings, DeviationState
from firmware_py.estimate.position import PositionSettings, PositionState

SMOOTHING_S: Final = 15.0  # time constant of the compass heading, to detect turns
MAX_STEP_S: Final = 2.0  # of the smoothing, after a gap
MAX_MINUTES: Final = 1440  # newest minutes that the residual contains
SEGMENT_S: Final = 7200.0  # time in which the residual assumes constant current and speed
MIN_MINUTES: Final = 10  # of a segment in the residual


def residual_rad(minutes: Iterable[tuple[float, ...]], deviation: Deviation) -> float:
    """Return the rms angle between the course over ground and that by the compass with this deviation.

    Each row of `minutes` is a DeviationState.last_minute. Current and speed are fitted to each SEGMENT_S. The result is
    NaN with fewer than MIN_MINUTES in each.
    """
    square_sum, count = 0.0, 0.0
    for _, group in groupby(minutes, key=lambda minute: minute[0] // SEGMENT_S):
        segment = np.array(list(group))
        if len(segment) < MIN_MINUTES:
            continue
        course_rad = segment[:, 1] + deviation[0] + segment[:, 2:6] @ np.array(deviation[1:])
        cosine, sine, ones, zeros = (
            np.cos(course_rad),
            np.sin(course_rad),
            np.ones(len(segment)),
            np.zeros(len(segment)),
        )
        design = np.concatenate([np.stack([cosine, ones, zeros], 1), np.stack([sine, zeros, ones], 1)])
        (speed_m_s, north_m_s, east_m_s), *_ = np.linalg.lstsq(design, segment[:, 6:8].T.reshape(-1), rcond=None)
        across_m_s = cosine * (segment[:, 7] - east_m_s) - sine * (segment[:, 6] - north_m_s)
        square_sum += float(np.sum((across_m_s / max(float(speed_m_s), deviation_filter.MIN_SPEED_M_S)) ** 2))
        count += len(segment)
    return math.sqrt(square_sum / count) if count else math.nan


class DeviationEstimator:
    """Deviation filter with the ticks of a voyage as its input."""

    def __init__(self, parameters: ParameterSet) -> None:
        """Store the parameters; there are no observations yet."""
        self.parameters = parameters
        self.state = DeviationState()
        self._settings = DeviationSettings.of(parameters)
        self._position = PositionState()
        self._declination = Declination()
        self._mean_vector = (0.0, 0.0)
        self._heading_s: float | None = None
        self._skipped_s = 0.0  # added to the clock, which starts again with each run
        self._last_s: float | None = None
        self._minutes: deque[tuple[float, ...]] = deque(maxlen=MAX_MINUTES)

    def set_parameters(self, parameters: ParameterSet) -> None:
        """Use these parameters from the next tick on."""
        if parameters is not self.parameters:
            self.parameters = parameters
            self._settings = DeviationSettings.of(parameters)

    def take(self, inputs: Inputs) -> None:
        """Process the inputs of a tick; a time before that of the last tick begins another run."""
        now_s = inputs.tick.t_s
        if self._last_s is not None and now_s < self._last_s:
            self._skipped_s += self._last_s - now_s
            self._position, self._heading_s = PositionState(), None
            self.state = deviation_filter.without_minute(self.state)
        self._last_s = now_s
        new_fix = self._position.fix
        for sample in inputs.positions:
            self._position, _ = position.update(self._position, sample, PositionSettings.of(self.parameters).jump_s)
        new_fix = None if self._position.fix is new_fix else self._position.fix
        if new_fix is not None:
            place = position.place_of(new_fix)
            self._declination = declination.update(
                self._declination, place.latitude_rad, place.longitude_rad, new_fix.utc_s
            )
        for heading in inputs.headings:
            if heading.source == 0 and math.isfinite(heading.heading_rad):
                self._smooth_heading(heading.heading_rad, heading.t_s)
        model_rad = self._declination.declination_rad if self.parameters["CMP_DECL_AUTO"] == 1 else None
        declination_rad = radians(self.parameters["CMP_DECL_DEG"]) if model_rad is None else model_rad
        inputs_of_tick = DeviationInput(
            headings=[variation.apply(heading, declination_rad or None) for heading in inputs.headings],
            declination_rad=declination_rad,
            fix=new_fix,
            heading_rad=math.atan2(self._mean_vector[1], self._mean_vector[0]),
            water=(0.0, 0.0, self.parameters["CRUISE_SPEED"]),
        )
        previous = self.state
        self.state = deviation_filter.update(self._settings, previous, inputs_of_tick, now_s + self._skipped_s)
        if not self.state.x:
            self._minutes.clear()
        elif self.state.last_minute is not previous.last_minute:
            self._minutes.append(self.state.last_minute)

    def result(self) -> DeviationEstimate | None:
        """Return the estimated deviation; None before the first minute."""
        return deviation_filter.result(self._settings, self.state)

    def report(self) -> SwingReport:
        """Return the progress and, once a deviation can be proposed, the residual error with it."""
        estimate, sectors = self.result(), self.state.sectors
        if estimate is None:
            return SwingReport(CalibrationState.RUNNING)
        sectors_sailed = sum(minutes > 0 for minutes in sectors)
        progress = min(sectors_sailed / deviation_filter.MIN_SECTORS, deviation_filter.MAX_SD_RAD / estimate.sd_rad)
        curves = (self._settings.deviation, estimate.coefficients_rad) if estimate.ready else ()
        residuals_rad = [
            value if math.isfinite(value := residual_rad(self._minutes, curve)) else None for curve in curves
        ]
        return SwingReport(
            CalibrationState.DONE if estimate.ready else CalibrationState.RUNNING,
            100 if estimate.ready else min(99, int(100.0 * progress)),
            sum(sectors),
            sum(1 << index for index, minutes in enumerate(sectors) if minutes),
            self._settings.deviation,
            estimate.coefficients_rad,
            estimate.sd_rad,
            estimate.off_rad,
            *residuals_rad,
        )

    def _smooth_heading(self, heading_rad: float, t_s: float) -> None:
        gain = 1.0
        if self._heading_s is not None:
            gain = -math.expm1(-min(max(t_s - self._heading_s, 0.0), MAX_STEP_S) / SMOOTHING_S)
        north, east = self._mean_vector
        self._mean_vector = (
            north + gain * (math.cos(heading_rad) - north),
            east + gain * (math.sin(heading_rad) - east),
        )
        self._heading_s = t_s
