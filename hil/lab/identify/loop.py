"""How much of the motion the rudder explains, and whether it answers the rest: an autopilot or a helmsman at work.

A rudder that answers what waves and wind do to her is no longer independent of them: held on course she seems to
turn for nothing that the rudder does, and K comes out too small, or any size, with small standard errors. It shows
in the future: what the model leaves unexplained now tells what the rudder will do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from hil.lab.identify.fit import Fit
from hil.lab.identify.left_out import LeftOut
from hil.lab.identify.noise import fit_noise
from hil.lab.identify.recording import Floats
from hil.lab.identify.stretch import Stretch

STEPS = (1, 3, 10, 30)  # samples, over which the motion is averaged to look for an answer
REACH = 10  # steps into the future and into the past
LEAST_STEPS = 6 * REACH
LEAST_TURNS = 100  # in how many parts of the log to look at how far she turned
CHANCE = 1e-4
MATTERS = 0.01  # of what is unexplained


@dataclass(frozen=True, slots=True)
class Loop:
    """`explained` is the share (R2, at most 1) of how far she turns within each turning lag.

    `answered` is what of the rest the rudder goes on to answer, 0 where none shows.
    """

    explained: float
    answered: float


def loop_of(fit: Fit, left_out: LeftOut | None = None) -> Loop:
    """Look at what a fit leaves unexplained, or one that has what the equation leaves out."""
    data, state = fit.problem.data, fit.state if left_out is None else left_out.state
    parts = []
    for stretch, start in zip(data.stretches, state.starts, strict=True):
        if left_out is None:
            parts.append((stretch, *fit.problem.motion(stretch, state, start)))
        else:
            parts.append((stretch, *left_out.motion(fit.problem, stretch, start)))
    lag_s = min(float(fit.physical[1]), data.duration_s / LEAST_TURNS)
    every = max(1, round(lag_s / data.usual_step_s))
    answers = [_answered([_beside(*part, step) for part in parts]) for step in STEPS]
    return Loop(_explained([_turns(*part, every) for part in parts]), max(answers))


def _turns(stretch: Stretch, heading: Floats, rate: Floats, every: int) -> tuple[Floats, Floats]:
    """Return by how much she turned in every so many samples, measured and by the model."""
    if stretch.heading_rad is None:
        return _means(stretch.measured()[1], every), _means(rate, every)
    every = max(1, min(every, stretch.time_s.size // 4))
    return np.diff(stretch.heading_rad[::every]), np.diff(heading[::every])


def _explained(pairs: list[tuple[Floats, Floats]]) -> float:
    measured, modelled = (np.concatenate(columns) for columns in zip(*pairs, strict=True))
    power = float(np.var(measured))
    return 1.0 - float(np.var(measured - modelled)) / power if power > 0.0 else 0.0


def _beside(stretch: Stretch, heading: Floats, rate: Floats, step: int) -> tuple[Floats, Floats]:
    """Return what is unexplained of the yaw rate, and the rudder, in means of so many samples."""
    rudder = _means(stretch.rudder_at_samples(), step)
    if stretch.yaw_rate_rad_s is not None:
        return _means(stretch.yaw_rate_rad_s - rate, step), rudder
    return np.diff(_means(stretch.measured()[0] - heading, step), prepend=0.0), rudder


def _means(values: Floats, every: int) -> Floats:
    rows = values.size // every
    return np.asarray(values[: rows * every].reshape(rows, every).mean(axis=1))


def _answered(pairs: list[tuple[Floats, Floats]]) -> float:
    """Return the share of the errors' novelties that the rudder's future tells beside its past, 0 by chance alone."""
    pairs = [pair for pair in pairs if pair[0].size > LEAST_STEPS]
    if not pairs:
        return 0.0
    noise = fit_noise([errors[:, None] for errors, _ in pairs])
    told, past, future = [], [], []
    for errors, rudder in pairs:
        white = np.convolve(errors, np.concatenate(([1.0], noise.lags[:, 0, 0])))[: errors.size]
        rows = np.arange(max(REACH, noise.order), errors.size - REACH)
        told.append(white[rows])
        past.append(np.column_stack([rudder[rows - lag] for lag in range(REACH + 1)] + [np.ones(rows.size)]))
        future.append(np.column_stack([rudder[rows + lag] for lag in range(1, REACH + 1)]))
    errors, before = np.concatenate(told), np.concatenate(past)
    left = _left(errors, before)
    less = _left(errors, np.hstack((before, np.concatenate(future))))
    freedom = errors.size - 2 * REACH - 2
    if freedom < LEAST_STEPS // 2 or not left > 0.0:
        return 0.0
    share = 1.0 - less / left
    ratio = share / REACH / max((1.0 - share) / freedom, 1e-300)
    by_chance = float(f_distribution.sf(ratio, REACH, freedom))
    return share if by_chance < CHANCE / len(STEPS) and share > MATTERS else 0.0


def _left(told: Floats, columns: Floats) -> float:
    solved = np.linalg.lstsq(columns, told, rcond=1e-9)[0]
    return float(np.sum((told - columns @ solved) ** 2))
