"""Predictions of the model from the rudder alone, and their errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hil.lab.identify.filter import DELAY, LAG, LN_T, model_of, simulate
from hil.lab.identify.fit import Fit
from hil.lab.identify.recording import MIN_ROWS, Floats
from hil.lab.identify.stretches import Columns, Data, Stretch

START_LAGS = 3.0  # turning lags at the start of a stretch that determine its first heading and yaw rate
START_STEP_RAD_S = 1e-5
START_ITERATIONS = 4


@dataclass(frozen=True, slots=True)
class Prediction:
    """One stretch, measured and predicted."""

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
    heading_within_rad: float | None  # 95 % of the errors
    explained: float  # share (R2) of the turns within each T
    predictions: tuple[Prediction, ...] = ()
    warnings: tuple[str, ...] = ()


def errors_of(file: str, fit: Fit, data: Data) -> Errors:
    """Predict every stretch from its rudder; only its first heading and yaw rate are fitted to its start."""
    predictions = tuple(_predicted(fit, data, stretch) for stretch in data.stretches)
    headings = [one.stretch.heading_rad - one.heading_rad for one in predictions if one.stretch.heading_rad is not None]
    rates = [
        one.stretch.yaw_rate_rad_s - one.yaw_rate_rad_s for one in predictions if one.stretch.yaw_rate_rad_s is not None
    ]
    heading, rate = (np.concatenate(parts) if parts else None for parts in (headings, rates))
    return Errors(
        file,
        None if rate is None else _rms(rate),
        None if heading is None else _rms(heading),
        None if heading is None else float(np.mean(heading)),
        None if heading is None else float(np.quantile(np.abs(heading), 0.95)),
        _explained(predictions, math.exp(fit.values[LN_T])),
        predictions,
        data.warnings,
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _predicted(fit: Fit, data: Data, stretch: Stretch) -> Prediction:
    columns = Columns(Data((stretch,), data.speed_m_s))
    until_s = stretch.time_s[0] + START_LAGS * math.exp(fit.values[LN_T])
    rows = slice(0, max(int(np.searchsorted(stretch.time_s, until_s)), MIN_ROWS))
    rate = 0.0 if stretch.yaw_rate_rad_s is None else float(np.median(stretch.yaw_rate_rad_s[:MIN_ROWS]))
    channel = 0 if stretch.yaw_rate_rad_s is None else 1
    measured = stretch.measured(headings=channel == 0)
    for _ in range(START_ITERATIONS):
        found = _simulated(fit.values, fit.sign, columns, rate)[channel, rows]
        moved = _simulated(fit.values, fit.sign, columns, rate + START_STEP_RAD_S)[channel, rows] - found
        constant = np.full(found.size, 1.0 - channel)
        step, *_ = np.linalg.lstsq(np.column_stack((moved, constant)), measured[rows] - found, rcond=1e-9)
        rate += START_STEP_RAD_S * float(step[0])
    heading, yaw_rate = _simulated(fit.values, fit.sign, columns, rate)
    first = 0.0 if stretch.heading_rad is None else float(np.mean(stretch.heading_rad[rows] - heading[rows]))
    return Prediction(stretch, heading + first, yaw_rate)


def _simulated(values: Floats, sign: float, columns: Columns, rate_rad_s: float) -> Floats:
    out = np.empty((2, columns.step_s.size))
    rudder = columns.rudder_rad(float(values[DELAY]), float(values[LAG]))
    simulate(
        model_of(values, sign), np.array([rate_rad_s]), columns.step_s, columns.first, rudder, columns.speed_ratio, out
    )
    return out


def _explained(predictions: tuple[Prediction, ...], lag_s: float) -> float:
    """Return the explained share (R2) of the turns within each T, or within each row if that is longer."""
    pairs = []
    for one in predictions:
        heading, rate = one.stretch.heading_rad, one.stretch.yaw_rate_rad_s
        every = max(1, round(lag_s / float(np.median(np.diff(one.stretch.time_s)))))
        every = min(every, max(1, one.heading_rad.size // 4))
        if heading is not None:
            pairs.append((np.diff(heading[::every]), np.diff(one.heading_rad[::every])))
        elif rate is not None:
            pairs.append((rate, one.yaw_rate_rad_s))
    measured, modelled = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    power = float(np.var(measured))
    return 1.0 - float(np.var(measured - modelled)) / power if power > 0.0 else 0.0
