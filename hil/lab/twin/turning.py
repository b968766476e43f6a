"""Turns the hulls of all lanes from a grid step to the next: twin of hil/ship/kt_plant.py, for boats side by side."""

from __future__ import annotations

from firmware_py.model.kt import rk4_step
from hil.lab.compiled import compiled
from hil.lab.lanes import lanes_of, put_lanes, where
from hil.lab.twin.kalman import Floats
from hil.lab.twin.ship import (
    GRID_S,
    NOW_ALPHA,
    NOW_K,
    NOW_T,
    PSI,
    RUDDER,
    YAW_RATE,
    Series,
    Ship,
    drift_on,
)  # fmt: skip

# What turns the hulls in a step, of all lanes: heading, yaw rate, the rudder that drives, the inner steps, K, T, alpha
# the offset of the rudder, and who takes part.
AFTER_PSI, AFTER_RATE, DRIVEN, INNER, INNER_S, BY_K, BY_T, BY_ALPHA, BY_OFFSET, ON = range(10)
TURNS = 10


@compiled
def be_beside(hull: Floats, ship: Ship, turns: Floats, lane: int) -> None:
    """Fill how a hull stands and how it answers, beside the others."""
    turns[AFTER_PSI, lane], turns[AFTER_RATE, lane] = hull[PSI], hull[YAW_RATE]
    turns[INNER, lane], turns[INNER_S, lane] = ship.inner_steps, ship.inner_s
    turns[BY_K, lane], turns[BY_T, lane], turns[BY_ALPHA, lane] = hull[NOW_K], hull[NOW_T], hull[NOW_ALPHA]


@compiled
def drive(hull: Floats, ship: Ship, series: Series, turns: Floats, lane: int, step: int, rudder_rad: float) -> None:
    """Fill what drives a hull from a grid step to the next, which ends with the rudder in the water at rudder_rad."""
    turns[DRIVEN, lane] = 0.5 * (hull[RUDDER] + rudder_rad)
    turns[BY_OFFSET, lane] = ship.bias_rad + series[ship.offset_at + step]
    turns[ON, lane] = 1.0
    hull[RUDDER] = rudder_rad


@compiled
def in_water(ship: Ship, waiting: Floats, lane: int, step: int, rudder_rad: float) -> float:
    """Return the angle of the rudder that turns the hull, of a shaft at rudder_rad."""
    if step * GRID_S >= ship.blade_lost_s:
        rudder_rad = 0.0
    if ship.delay_steps > 0:
        place = step % ship.delay_steps
        rudder_rad, waiting[lane, place] = waiting[lane, place], rudder_rad
    return rudder_rad


@compiled
def turn_hulls(turns: Floats, most: int) -> None:
    """Turn the hulls of the lanes that are on by a grid step, in at most so many inner steps."""
    psi, r = lanes_of(turns, AFTER_PSI), lanes_of(turns, AFTER_RATE)
    inner = where(lanes_of(turns, ON), lanes_of(turns, INNER), 0.0)
    driven_rad, inner_s, offset_rad = lanes_of(turns, DRIVEN), lanes_of(turns, INNER_S), lanes_of(turns, BY_OFFSET)
    ability, lag_s, norrbin = lanes_of(turns, BY_K), lanes_of(turns, BY_T), lanes_of(turns, BY_ALPHA)
    for number in range(most):
        turned, rate = rk4_step(psi, r, driven_rad, inner_s, ability, lag_s, norrbin, offset_rad)
        psi, r = where(inner - float(number), turned, psi), where(inner - float(number), rate, r)
    put_lanes(turns, AFTER_PSI, psi)
    put_lanes(turns, AFTER_RATE, r)


@compiled
def end_step(hull: Floats, ship: Ship, series: Series, turns: Floats, lane: int, step: int) -> None:
    """Be where a hull has turned to."""
    before_rad, psi, r = hull[PSI], turns[AFTER_PSI, lane], turns[AFTER_RATE, lane]
    hull[PSI], hull[YAW_RATE] = psi, r
    if ship.has_more:
        drift_on(hull, ship, series, before_rad, step)
        be_beside(hull, ship, turns, lane)
