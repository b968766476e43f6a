"""How well a fitted model predicts: on what it was fitted to, and on recordings that it has not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from hil.lab.identify.fit import NO_LAGS, Fit, first_guess
from hil.lab.identify.predict import Start, inner_steps, sensitivities
from hil.lab.identify.recording import LEAST_ROWS, Floats, Recording
from hil.lab.identify.refine import Problem, State, Weights, refine
from hil.lab.identify.stretch import Data, Stretch, Timing, prepare, timed

HEAD_SHARE, HEAD_LAGS = 0.1, 3.0

Errors = dict[str, list[Floats]]  # "heading", "yaw_rate" -> one array a stretch


@dataclass(frozen=True, slots=True)
class Prediction:
    """One stretch, measured and predicted; a channel that was not measured is predicted all the same.

    heading_se_rad: what the errors of K, T, alpha and delta0 do to the heading.
    """

    stretch: Stretch
    heading_rad: Floats
    yaw_rate_rad_s: Floats
    heading_se_rad: Floats


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Root mean square and mean errors (measured less predicted); None for a channel that was not measured."""

    file: str
    yaw_rate_rmse_rad_s: float | None
    heading_rmse_rad: float | None
    heading_mean_rad: float | None
    heading_within_rad: float | None  # 95 % of the errors
    predictions: tuple[Prediction, ...] = ()
    warnings: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, file: str, errors: Errors, predictions: tuple[Prediction, ...] = (), warnings: tuple[str, ...] = ()
    ) -> Self:
        """Sum up errors."""
        whole = {name: np.concatenate(pieces) for name, pieces in errors.items() if pieces}
        heading, rate = whole.get("heading"), whole.get("yaw_rate")
        return cls(
            file,
            None if rate is None else float(np.sqrt(np.mean(rate**2))),
            None if heading is None else float(np.sqrt(np.mean(heading**2))),
            None if heading is None else float(np.mean(heading)),
            None if heading is None else float(np.quantile(np.abs(heading), 0.95)),
            predictions,
            warnings,
        )


def errors_of(fit: Fit) -> Errors:
    """Return what a fit leaves of its own data; a heading that counted for little is centred."""
    return _errors(fit.problem, fit.state, centred=True)


def held_out(
    fit: Fit, recording: Recording, speed_m_s: float | None, *, scaled: bool, timing: Timing = Timing.RAMP
) -> HeldOut:
    """Predict a recording from its rudder alone; only where the boat starts is taken from its beginning.

    The beginning is the first tenth, or three turning lags if they are longer.
    """
    data = timed(prepare((recording,), speed_m_s), timing)
    if not scaled:
        ones = tuple(replace(stretch, speed_ratio=np.ones(stretch.time_s.size)) for stretch in data.stretches)
        data = replace(data, stretches=ones)
    weights = _weights(fit)
    problem = replace(fit.problem, data=data, free=(), weights=weights)
    starts: list[Start] = []
    for stretch in data.stretches:
        part = replace(data, stretches=(_head(stretch, float(fit.physical[1])),))
        begin = State(fit.state.point, (first_guess(part.stretches[0]),))
        starts.extend(refine(replace(problem, data=part), begin).state.starts)
    state = State(fit.state.point, tuple(starts))
    errors = _errors(problem, state, centred=False)
    return HeldOut.of(recording.name, errors, predictions(fit, problem, state), data.warnings)


def predictions(fit: Fit, problem: Problem, state: State) -> tuple[Prediction, ...]:
    """Return measured and predicted motion of every stretch of a problem, the fit's own or another."""
    parts = zip(problem.data.stretches, state.starts, strict=True)
    return tuple(
        Prediction(stretch, *problem.motion(stretch, state, start), _unsure(fit, stretch, start))
        for stretch, start in parts
    )


def _unsure(fit: Fit, stretch: Stretch, start: Start) -> Floats:
    """Return the standard error of the heading that comes of those of the model."""
    problem, point = fit.problem, fit.state.point
    steps = inner_steps(stretch, point.candidate(problem.scales), problem.largest_rate_rad_s)
    slopes = sensitivities(stretch, point, problem.scales, start, problem.free, steps)[2][:, : len(problem.free)]
    return np.asarray(np.sqrt(np.maximum(np.einsum("ri,ij,rj->r", slopes, fit.covariance, slopes, optimize=True), 0.0)))


def _errors(problem: Problem, state: State, *, centred: bool) -> Errors:
    errors: Errors = {"heading": [], "yaw_rate": []}
    for stretch, start in zip(problem.data.stretches, state.starts, strict=True):
        heading_rad, yaw_rate_rad_s = problem.motion(stretch, state, start)
        if stretch.heading_rad is not None:
            error = stretch.heading_rad - heading_rad
            errors["heading"].append(error - error.mean() if centred else error)
        if stretch.yaw_rate_rad_s is not None:
            errors["yaw_rate"].append(stretch.yaw_rate_rad_s - yaw_rate_rad_s)
    return {name: pieces for name, pieces in errors.items() if pieces}


def _weights(fit: Fit) -> Weights:
    """Weigh the channels by the noise that the fit left, whatever it was fitted to."""
    spread = dict(zip(_channels(fit.problem.data), fit.accuracy.noise.spread.tolist(), strict=True))
    weight = {name: 1.0 / max(spread.get(name, 1.0), 1e-12) ** 2 for name in ("heading", "yaw_rate")}
    return Weights(weight["heading"], weight["yaw_rate"], NO_LAGS, weight["yaw_rate"])


def _channels(data: Data) -> list[str]:
    first = data.stretches[0]
    pairs = (("heading", first.heading_rad), ("yaw_rate", first.yaw_rate_rad_s))
    return [name for name, column in pairs if column is not None]


def _head(stretch: Stretch, lag_s: float) -> Stretch:
    time_s = stretch.time_s
    until_s = time_s[0] + max(HEAD_LAGS * lag_s, HEAD_SHARE * (time_s[-1] - time_s[0]))
    rows = min(max(int(np.searchsorted(time_s, until_s)), LEAST_ROWS), time_s.size)
    return stretch.part(slice(0, rows))
