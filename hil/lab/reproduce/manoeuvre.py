"""Simulated manoeuvres in the tank, recorded like an onboard log: compass, encoder, ten rows per second."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import clamp, radians
from firmware_py.model.kt import KtModel
from hil.ship.hull import GRID_S, STEPS_PER_SECOND, Hull
from hil.ship.noise import Stream, generator
from hil.ship.scenarios import Scenario
from hil.ship.servo import DEFAULT_SLEW_RAD_S

Floats = NDArray[np.float64]
Steer = Callable[[float, float], float]  # time [s], measured heading [rad] -> rudder [rad]

COLUMNS = "time_s,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s"
ROWS_PER_SECOND = 10
STEPS_PER_ROW = STEPS_PER_SECOND // ROWS_PER_SECOND
COMPASS_NOISE_RAD = radians(0.3)
COMPASS_RESOLUTION_RAD = radians(0.1)
ENCODER_RAD = 2.0 * math.pi / 4096.0


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """A recording: times [s], measured rudder and heading [rad, unwrapped], true heading of the hull."""

    time_s: Floats
    rudder_rad: Floats
    heading_rad: Floats
    heading_low_rad: Floats
    speed_m_s: float

    def write(self, path: Path) -> None:
        """Write the manoeuvre CSV; the yaw rate is empty, since the paper's boat has no gyroscope."""
        with path.open("w", encoding="ascii", newline="\n") as file:
            file.write(COLUMNS + "\n")
            for row in zip(self.time_s, self.rudder_rad, self.heading_rad, strict=True):
                file.write(f"{row[0]:.1f},{row[1]:.6f},{row[2]:.6f},,{self.speed_m_s:g}\n")


def zigzag(rudder_rad: float, turn_rad: float) -> Steer:
    """Return a rudder law that changes the side of the rudder each time the heading reaches this angle."""
    side = 1.0

    def steer(_time_s: float, heading_rad: float) -> float:
        nonlocal side
        if heading_rad * side >= turn_rad:
            side = -side
        return side * rudder_rad

    return steer


def circles(rudders_rad: tuple[float, ...], each_s: float) -> Steer:
    """Return a rudder law that holds one rudder angle after the other, the last one to the end."""

    def steer(time_s: float, _heading_rad: float) -> float:
        return rudders_rad[min(int(time_s / each_s), len(rudders_rad) - 1)]

    return steer


def sail(model: KtModel, sea: Scenario, steer: Steer, seconds: float, seed: int) -> Manoeuvre:
    """Simulate a manoeuvre that starts with heading north and without yaw rate."""
    hull = Hull(sea, model, seed)
    noise_rad = COMPASS_NOISE_RAD * generator(seed, Stream.COMPASS).standard_normal(round(seconds * ROWS_PER_SECOND))
    rows = np.zeros((noise_rad.size, 4))
    angle_rad = 0.0
    reach_rad = DEFAULT_SLEW_RAD_S * GRID_S
    for row, noise in enumerate(noise_rad.tolist()):
        measured_rad = _rounded(hull.heading_rad(0.0) + noise, COMPASS_RESOLUTION_RAD)
        rows[row] = (
            row / ROWS_PER_SECOND,
            _rounded(angle_rad, ENCODER_RAD),
            measured_rad,
            hull.heading_low_rad(0.0),
        )
        # The servo stops at a whole count, so the encoder has no mean error.
        target_rad = _rounded(steer(row / ROWS_PER_SECOND, measured_rad), ENCODER_RAD)
        for _ in range(STEPS_PER_ROW):
            angle_rad += clamp(target_rad - angle_rad, -reach_rad, reach_rad)
            hull.step(angle_rad)
    time_s, rudder_rad, heading_rad, low_rad = rows.T.copy()
    return Manoeuvre(time_s, rudder_rad, heading_rad, low_rad, sea.speed_m_s)


def _rounded(angle_rad: float, resolution_rad: float) -> float:
    return math.floor(angle_rad / resolution_rad + 0.5) * resolution_rad
