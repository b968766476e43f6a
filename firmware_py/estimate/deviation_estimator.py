"""Compass swing under way: feed the inputs of ticks, live or from a log, to the deviation filter; residual error."""

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

SMOOTHING_S: Final = 15.0  # of the compass heading, to detect turns
MAX_STEP_S: Final = 2.0
MAX_MINUTES: Final = 1440
SEGMENT_S: Final = 7200.0  # in which current and speed count as constant for the residual
MIN_MINUTES: Final = 10


def residual_rad(minutes: Iterable[tuple[float, ...]], deviation: Deviation) -> float:
    """Return the rms angle between the course over ground and the course by the compass with this deviation.

    `minutes` are those of DeviationState.last_minute. Current and speed are fitted to each SEGMENT_S. NaN: too few
    minutes.
    """
    square, count = 0.0, 0.0
    for _, group in groupby(minutes, key=lambda minute: minute[0] // SEGMENT_S):
        segment = np.array(list(group))
        if len(segment) < MIN_MINUTES:
            continue
        way_rad = segment[:, 1] + deviation[0] + segment[:, 2:6] @ np.array(deviation[1:])
        cosine, sine, ones, zeros = np.cos(way_rad), np.sin(way_rad), np.ones(len(segment)), np.zeros(len(segment))
        design = np.concatenate([np.stack([cosine, ones, zeros], 1), np.stack([sine, zeros, ones], 1)])
        (speed_m_s, north_m_s, east_m_s), *_ = np.linalg.lstsq(design, segment[:, 6:8].T.reshape(-1), rcond=None)
        across_m_s = cosine * (segment[:, 7] - east_m_s) - sine * (segment[:, 6] - north_m_s)
        square += float(np.sum((across_m_s / max(float(speed_m_s), deviation_filter.MIN_SPEED_M_S)) ** 2))
        count += len(segment)
    return math.sqrt(square / count) if count else math.nan


class DeviationEstimator:
    """Feeds the ticks of a voyage to the deviation filter."""

    def __init__(self, parameters: ParameterSet) -> None:
        """Begin without observations."""
        self.parameters = parameters
        self.state = DeviationState()
        self._settings = DeviationSettings.of(parameters)
        self._place = PositionState()
        self._declination = Declination()
        self._smooth = (0.0, 0.0)
        self._heading_s: float | None = None
        self._skipped_s = 0.0  # clocks of several runs, one behind the other
        self._last_s: float | None = None
        self._minutes: deque[tuple[float, ...]] = deque(maxlen=MAX_MINUTES)

    def set_parameters(self, parameters: ParameterSet) -> None:
        """Use other parameters from now on."""
        if parameters is not self.parameters and parameters != self.parameters:
            self.parameters = parameters
            self._settings = DeviationSettings.of(parameters)

    def take(self, inputs: Inputs) -> None:
        """Process the inputs of a tick; a time before that of the last tick begins another run."""
        now_s = inputs.tick.t_s
        if self._last_s is not None and now_s < self._last_s:
            self._skipped_s += self._last_s - now_s
            self._place, self._heading_s = PositionState(), None
            self.state = deviation_filter.without_minute(self.state)
        self._last_s = now_s
        fix = self._place.fix
        for sample in inputs.positions:
            self._place, _ = position.update(self._place, sample, PositionSettings.of(self.parameters).jump_s)
        fix = None if self._place.fix is fix else self._place.fix
        if fix is not None and fix.latitude_rad is not None and fix.longitude_rad is not None:
            self._declination = declination.update(self._declination, fix.latitude_rad, fix.longitude_rad, fix.utc_s)
        for heading in inputs.headings:
            if heading.source == 0 and math.isfinite(heading.heading_rad):
                self._smooth_in(heading.heading_rad, heading.t_s)
        by_model = self._declination.declination_rad if self.parameters["CMP_DECL_AUTO"] == 1 else None
        declination_rad = radians(self.parameters["CMP_DECL_DEG"]) if by_model is None else by_model
        inputs_of_tick = DeviationInput(
            headings=[variation.apply(heading, declination_rad or None) for heading in inputs.headings],
            declination_rad=declination_rad,
            fix=fix,
            heading_rad=math.atan2(self._smooth[1], self._smooth[0]),
            water=(0.0, 0.0, self.parameters["CRUISE_SPEED"]),
        )
        before = self.state
        self.state = deviation_filter.update(self._settings, before, inputs_of_tick, now_s + self._skipped_s)
        if not self.state.x:
            self._minutes.clear()
        elif self.state.last_minute is not before.last_minute:
            self._minutes.append(self.state.last_minute)

    def result(self) -> DeviationEstimate | None:
        """Return the estimated deviation; None before the first minute."""
        return deviation_filter.result(self._settings, self.state)

    def report(self) -> SwingReport:
        """Return the progress and, once a deviation can be proposed, the residual error with it."""
        found, sectors = self.result(), self.state.sectors
        if found is None:
            return SwingReport(CalibrationState.RUNNING)
        sailed = sum(minutes > 0 for minutes in sectors)
        share = min(sailed / deviation_filter.MIN_SECTORS, deviation_filter.MAX_SD_RAD / found.sd_rad)
        curves = (self._settings.deviation, found.coefficients_rad) if found.ready else ()
        left_rad = [value if math.isfinite(value := residual_rad(self._minutes, curve)) else None for curve in curves]
        return SwingReport(
            CalibrationState.DONE if found.ready else CalibrationState.RUNNING,
            100 if found.ready else min(99, int(100.0 * share)),
            sum(sectors),
            sum(1 << place for place, minutes in enumerate(sectors) if minutes),
            self._settings.deviation,
            found.coefficients_rad,
            found.sd_rad,
            found.off_rad,
            *left_rad,
        )

    def _smooth_in(self, heading_rad: float, t_s: float) -> None:
        step_s = MAX_STEP_S if self._heading_s is None else min(max(t_s - self._heading_s, 0.0), MAX_STEP_S)
        part = 1.0 if self._heading_s is None else -math.expm1(-step_s / SMOOTHING_S)
        north, east = self._smooth
        self._smooth = (north + part * (math.cos(heading_rad) - north), east + part * (math.sin(heading_rad) - east))
        self._heading_s = t_s
