"""A record boiled down to a few thousand averages, for the search that only has to find the right valley."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from hil.lab.identify.predict import Scales
from hil.lab.identify.recording import Floats
from hil.lab.identify.stretch import Data, Stretch, excerpt, thinned

ROWS = 2000
COARSER = 4  # times, from one digest to the next
WINDOW_ROWS = 50


@dataclass(frozen=True, slots=True)
class Digest:
    """The averages of all stretches end to end, as objective.output_error takes them.

    `scales` are of the data; the powers are what the misfit is measured against.
    """

    scales: Scales
    flags: Any
    step_s: Floats
    rudder_rad: Floats
    speed_ratio: Floats
    heading_rad: Floats
    yaw_rate_rad_s: Floats
    heading_power: float
    rate_power: float
    duration_s: float
    interval_s: float

    def parts(self) -> list[slice]:
        """Return the rows of each stretch."""
        return [
            slice(low, high) for low, high in pairwise([*np.flatnonzero(self.flags == 2).tolist(), self.flags.size])
        ]

    def arguments(self, sign: float) -> tuple[Any, ...]:
        """Return what output_error takes besides points and values."""
        scales = np.array(
            [
                sign,
                self.scales.yaw_rate_rad_s,
                self.scales.rudder_rad,
                self.scales.rudder_middle_rad,
                self.heading_power,
                self.rate_power,
            ]
        )
        return (
            scales,
            self.flags,
            self.step_s,
            self.rudder_rad,
            self.speed_ratio,
            self.heading_rad,
            self.yaw_rate_rad_s,
        )


def digests(data: Data) -> tuple[Digest, ...]:
    """Return digests from the finest to the coarsest, which holds all of the data.

    Averages over more than the turning lag show nothing of it, and what is left may have the wrong sign. As long
    as the lag is not known, excerpts of finer averages are digested, too.
    """
    coarsest = max(1, data.rows // ROWS)
    steps = [1]
    while COARSER * steps[-1] < coarsest:
        steps.append(COARSER * steps[-1])
    return tuple(digest(data, every) for every in dict.fromkeys((*steps, coarsest)))


def digest(data: Data, every: int) -> Digest:
    """Average every so many samples of every stretch, and take an excerpt of ROWS where more are left."""
    data = excerpt(thinned(data, every), 2 * ROWS)
    parts = [_columns(stretch) for stretch in data.stretches]
    names = ("flags", "step_s", "rudder", "ratio", "heading", "rate", "turning")
    whole = {name: np.concatenate([part[name] for part in parts]) for name in names}
    rudder, turning = whole["rudder"], np.abs(whole["turning"])
    middle = 0.5 * float(np.max(rudder) + np.min(rudder))
    scales = Scales(
        max(float(np.quantile(turning, 0.95)), 1e-9),
        max(0.5 * float(np.max(rudder) - np.min(rudder)), 1e-12),
        middle,
        max(float(np.max(turning)), 1e-9),
    )
    first = data.stretches[0]
    rate = whole["rate"]
    return Digest(
        scales,
        whole["flags"].astype(np.int64),
        whole["step_s"],
        rudder,
        whole["ratio"],
        whole["heading"],
        rate,
        _window_power(whole["heading"], whole["flags"]) if first.heading_rad is not None else 0.0,
        float(rate @ rate) if first.yaw_rate_rad_s is not None else 0.0,
        max(float(part.time_s[-1] - part.time_s[0]) for part in data.stretches),
        data.usual_step_s,
    )


def _columns(stretch: Stretch) -> dict[str, Floats]:
    rows = stretch.time_s.size
    empty = np.zeros(rows)
    heading = empty if stretch.heading_rad is None else stretch.heading_rad
    turning = np.gradient(heading, stretch.time_s) if stretch.yaw_rate_rad_s is None else stretch.yaw_rate_rad_s
    flags = np.zeros(rows)
    flags[::WINDOW_ROWS] = 1.0
    flags[0] = 2.0
    anchor = heading[np.maximum.accumulate(np.where(flags > 0.0, np.arange(rows), 0))]
    return {
        "flags": flags,
        "step_s": np.concatenate(([0.0], stretch.step_s)),
        "rudder": stretch.rudder_rad,
        "ratio": stretch.speed_ratio,
        "heading": heading - anchor,
        "rate": empty if stretch.yaw_rate_rad_s is None else turning,
        "turning": turning,
    }


def _window_power(heading: Floats, flags: Floats) -> float:
    windows = np.split(heading, np.flatnonzero(flags > 0.0)[1:])
    return float(sum(np.sum((window - window.mean()) ** 2) for window in windows))
