"""The K-T model at other speeds, by equation 7 of the paper; the rows are those of its Table 2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_py.common.angles import radians
from firmware_py.model.kt import KtModel, steady_yaw_rate
from hil.ship.manoeuvring import steady_turn
from hil.ship.regressions import HullForm, sway_model

RUDDERS_DEG = (10.0, 20.0, 30.0, 35.0)
RADIUS_RUDDER_DEG = 30.0


@dataclass(frozen=True, slots=True)
class Dimensionless:
    """K', T' and alpha', which do not depend on speed."""

    turning_ability: float
    turning_lag: float
    norrbin: float


@dataclass(frozen=True, slots=True)
class SpeedRow:
    """The model at one speed: K [1/s], T [s], alpha [s^2], and steady yaw rates [deg/s] at RUDDERS_DEG.

    radius_m is U / r at RADIUS_RUDDER_DEG of rudder, as in the paper; radius_with_sway_m and drift_deg include sway by
    the hull's regressions.
    """

    speed_m_s: float
    turning_ability_1_s: float
    turning_lag_s: float
    norrbin_s2: float
    steady_rates_deg_s: tuple[float, ...]
    radius_m: float
    radius_with_sway_m: float
    drift_deg: float


def dimensionless(model: KtModel, length_m: float) -> Dimensionless:
    """Return K' = K L / U, T' = T U / L, alpha' = alpha (U / L)^2."""
    lengths_per_s = model.speed_m_s / length_m
    return Dimensionless(
        model.turning_ability_1_s / lengths_per_s,
        model.turning_lag_s * lengths_per_s,
        model.norrbin_s2 * lengths_per_s**2,
    )


def table(model: KtModel, hull: HullForm, speeds_m_s: Sequence[float]) -> tuple[SpeedRow, ...]:
    """Return a row for each speed, in the same order."""
    sway = sway_model(hull)
    rows = []
    for speed_m_s in speeds_m_s:
        scaled = model.at_speed(speed_m_s)
        rates_rad_s = (
            steady_yaw_rate(radians(rudder), scaled.turning_ability_1_s, scaled.norrbin_s2) for rudder in RUDDERS_DEG
        )
        centred = scaled._replace(rudder_offset_rad=0.0)
        turn_without_sway = steady_turn(centred, radians(RADIUS_RUDDER_DEG))
        turn_with_sway = steady_turn(centred, radians(RADIUS_RUDDER_DEG), sway)
        rows.append(
            SpeedRow(
                speed_m_s,
                scaled.turning_ability_1_s,
                scaled.turning_lag_s,
                scaled.norrbin_s2,
                tuple(math.degrees(rate) for rate in rates_rad_s),
                turn_without_sway.radius_m,
                turn_with_sway.radius_m,
                abs(math.degrees(turn_with_sway.drift_rad)),
            )
        )
    return tuple(rows)
