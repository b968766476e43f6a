"""Turns the hulls of all lanes from a grid step to the next: twin of hil/ship/kt_plant.py and delay.py."""

from __future__ import annotations

import math
from typing import Any

from firmware_py.model.kt import rk4_step
from hil.lab.compiled import compiled
from hil.lab.lane_rows import rows
from hil.lab.lanes import COUNT, any_of, bits_of, where
from hil.lab.twin.kalman import Floats
from hil.lab.twin.ship import (
    GRID_S,
    NOW_ALPHA,
    NOW_K,
    NOW_T,
    PLACE,
    PSI,
    RUDDER,
    SWAPPED,
    YAW_RATE,
    Series,
    Ship,
    drift_on,
)

Lanes = Any


@compiled
def in_water(hulls: Floats, on: Lanes, ship: Ship, waiting: Floats, step: Lanes, shaft_rad: Lanes) -> Lanes:
    """Return the angle of the rudders that turn the hulls, of shafts at shaft_rad."""
    rudder_rad = where(step * GRID_S >= ship.blade_lost_s, 0.0, shaft_rad)
    delayed = on & (ship.delay_steps > 0.0)
    if not any_of(delayed):
        return rudder_rad
    hull = rows(hulls, delayed)
    hull[SWAPPED] = rudder_rad
    hull[PLACE] = step - math.floor(step / ship.delay_steps) * ship.delay_steps
    for k in range(COUNT):
        if bits_of(delayed) >> k & 1 > 0:
            place = int(hulls[PLACE, k])
            hulls[SWAPPED, k], waiting[k, place] = waiting[k, place], hulls[SWAPPED, k]
    return where(delayed, hull[SWAPPED], rudder_rad)


@compiled
def turn_hulls(hulls: Floats, on: Lanes, ship: Ship, series: Series, step: Lanes, rudder_rad: Lanes) -> None:
    """Turn the hulls of the lanes that are on by a grid step, which ends with the rudder in the water at rudder_rad."""
    hull = rows(hulls, on)
    psi, r, driven_rad = hull[PSI], hull[YAW_RATE], 0.5 * (hull[RUDDER] + rudder_rad)
    offset_rad = ship.bias_rad + series[ship.offset_at + step]
    before_rad, inner, number = psi, where(on, ship.inner_steps, 0.0), 0.0
    while any_of(inner > number):
        turned, rate = rk4_step(psi, r, driven_rad, ship.inner_s, hull[NOW_K], hull[NOW_T], hull[NOW_ALPHA], offset_rad)
        psi, r = where(inner > number, turned, psi), where(inner > number, rate, r)
        number += 1.0
    hull[RUDDER], hull[PSI], hull[YAW_RATE] = rudder_rad, psi, r
    if any_of(ship.has_more):
        drift_on(hulls, on, ship, series, before_rad, step)
