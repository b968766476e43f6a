"""Predict the motion from the rudder alone, and compute the errors of the prediction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hil.lab.identify.filter import DELAY, LAG, LN_T, model_of, simulate
from hil.lab.identify.fit import Fit
from hil.lab.identify.recording import MIN_ROWS, Floats
from hil.lab.identify.stretches import Columns, Data, Stretch

START_LAGS = 3.0  # duration, in turning lags, over which the first heading and yaw rate of a stretch are fitted
START_STEP_RAD_S = 1e-5
START_ITERATIONS = 4


@dataclass(frozen=True, slots=True)
class Prediction:
    """A stretch with the predicted heading and yaw rate."""

    stretch: Stretch
    heading_rad: Floats
    yaw_rate_rad_s: Floats


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors (measured minus predicted) over the stretches of a file; None for a channel that was not measured."""

    file: str
    yaw_rate_rmse_rad_s: float | None
    heading_rmse_rad: float | None
    heading_mean_rad: float | None
    heading_95_rad: float | None  # 95 % quantile of the magnitude of the errors
    explained: float  # share (R2) of the turns within each T
    predictions: tuple[Prediction, ...] = ()
    warnings: tuple[str, ...] = ()


def errors_of(file: str, fit: Fit, data: Data) -> Errors:
    """Predict every stretch from its rudder and compute the errors; the initial state is fitted to the start."""
    predictions = tuple(_predict(fit, data, stretch) for stretch in data.stretches)
    headings = [
        prediction.stretch.heading_rad - prediction.heading_rad
        for prediction in predictions
        if prediction.stretch.heading_rad is not None
    ]
    rates = [
        prediction.stretch.yaw_rate_rad_s - prediction.yaw_rate_rad_s
        for prediction in predictions
        if prediction.stretch.yaw_rate_rad_s is not None
    ]
    heading, rate = (np.concatenate(series) if series else None for series in (headings, rates))
    return Errors(
        file,
        None if rate is None else _rms(rate),
        None if heading is None else _rms(heading),
        None if heading is None else float(np.mean(heading)),
        None if heading is None else float(np.quantile(np.abs(heading), 0.95)),
        _explained_fraction(predictions, math.exp(fit.values[LN_T])),
        predictions,
        data.warnings,
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _predict(fit: Fit, data: Data, stretch: Stretch) -> Prediction:
    columns = Columns(Data((stretch,), data.speed_m_s))
    until_s = stretch.time_s[0] + START_LAGS * math.exp(fit.values[LN_T])
    rows = slice(0, max(int(np.searchsorted(stretch.time_s, until_s)), MIN_ROWS))
    rate = 0.0 if stretch.yaw_rate_rad_s is None else float(np.median(stretch.yaw_rate_rad_s[:MIN_ROWS]))
    channel = 0 if stretch.yaw_rate_rad_s is None else 1
    measured = stretch.measured(use_headings=channel == 0)
    for _ in range(START_ITERATIONS):
        predicted = _simulate(fit.values, fit.sign, columns, rate)[channel, rows]
        rate_slope = _simulate(fit.values, fit.sign, columns, rate + START_STEP_RAD_S)[channel, rows] - predicted
        constant = np.full(predicted.size, 1.0 - channel)
        step, *_ = np.linalg.lstsq(np.column_stack((rate_slope, constant)), measured[rows] - predicted, rcond=1e-9)
        rate += START_STEP_RAD_S * float(step[0])
    heading, yaw_rate = _simulate(fit.values, fit.sign, columns, rate)
    offset_rad = 0.0 if stretch.heading_rad is None else float(np.mean(stretch.heading_rad[rows] - heading[rows]))
    return Prediction(stretch, heading + offset_rad, yaw_rate)


def _simulate(values: Floats, sign: float, columns: Columns, rate_rad_s: float) -> Floats:
    out = np.empty((2, columns.step_s.size))
    rudder = columns.rudder_rad(float(values[DELAY]), float(values[LAG]))
    simulate(
        model_of(values, sign),
        np.array([rate_rad_s]),
        columns.step_s,
        columns.is_first,
        rudder,
        columns.speed_ratio,
        out,
    )
    return out


def _explained_fraction(predictions: tuple[Prediction, ...], lag_s: float) -> float:
    """Return the explained fraction (R2) of the heading changes within each T, or each row if that is longer."""
    pairs = []
    for prediction in predictions:
        heading, rate = prediction.stretch.heading_rad, prediction.stretch.yaw_rate_rad_s
        every = max(1, round(lag_s / float(np.median(np.diff(prediction.stretch.time_s)))))
        every = min(every, max(1, prediction.heading_rad.size // 4))
        if heading is not None:
            pairs.append((np.diff(heading[::every]), np.diff(prediction.heading_rad[::every])))
        elif rate is not None:
            pairs.append((rate, prediction.yaw_rate_rad_s))
    measured, predicted = (np.concatenate(series) for series in zip(*pairs, strict=True))
    variance = float(np.var(measured))
    return 1.0 - float(np.var(measured - predicted)) / variance if variance > 0.0 else 0.0
