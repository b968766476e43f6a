"""Ship and devices between two ticks of the autopilot: what happens, in its order of time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hil.lab.compiled import compiled
from hil.lab.twin import devices as sensing
from hil.lab.twin import ship as ships
from hil.lab.twin.devices import FIX_COLUMNS, SAID_RAD, THERE_S, Devices
from hil.lab.twin.ship import GRID_S, HULL_STATES, PSI, STEPS_PER_SECOND, Floats, Series, Ship

STEPS_PER_ROW = 5
QUEUE = 16

# The state of ship and devices: hull, shaft, the sentences on their way to the autopilot and how many there are; the
# next grid step, compass sample, fix and sample of the receiver's own filter; the row written last; whether the first
# fix has been given to the autopilot.
PLANT = np.dtype(
    [
        ("hull", np.float64, (HULL_STATES,)),
        ("shaft", np.float64, (3,)),
        ("headings", np.float64, (QUEUE, 2)),
        ("fixes", np.float64, (QUEUE, FIX_COLUMNS)),
        *((name, np.int64) for name in ("heading_count", "fix_count", "step", "sample", "epoch", "filtered", "row")),
        ("first_given", np.bool_),
        *((name, np.float64) for name in ("shaft_rad", "feedback_rad", "north_m_s", "east_m_s", "first_fix_s")),
    ]
)
Plant = Any  # a record of PLANT


class Sea(NamedTuple):
    """Everything of a run that does not depend on the autopilot."""

    ship: Ship
    series: Series
    devices: Devices


class Waters(NamedTuple):
    """Plant of a run: records of ship and devices, the series, and the rudder angles that the delay holds back."""

    ship: Any
    series: Series
    devices: Any
    waiting: Floats


class Record(NamedTuple):
    """Results of a run: heading and rudder ten times a second as in truth.csv, and a row for each tick if any."""

    heading_rad: Floats
    rudder_rad: Floats
    ticks: Floats


@compiled
def begin(at: Plant, ship: Ship) -> None:
    """Start with the rudder amidships."""
    ships.begin_hull(at.hull, ship)
    at.first_fix_s = np.nan


@compiled
def advance(at: Plant, waters: Waters, record: Record, next_s: float) -> None:
    """Advance to the next step of the grid, which is at next_s, and write its row."""
    step, ship = at.step, waters.ship
    at.shaft_rad = sensing.shaft_angle(at.shaft, next_s)
    rudder_rad = ships.rudder_in_water(ship, waters.waiting, step, at.shaft_rad)
    ships.turn_hull(at.hull, ship, waters.series, step, rudder_rad)
    at.step = step + 1
    row = at.step // STEPS_PER_ROW
    if row * STEPS_PER_ROW == at.step and row < record.heading_rad.size:
        at.row = row
        record.heading_rad[row], record.rudder_rad[row] = at.hull[PSI], at.shaft_rad


@compiled
def offset(at: Plant, now_s: float) -> float:
    """Return how far a time is into the present grid step."""
    return float(min(max(now_s - at.step / STEPS_PER_SECOND, 0.0), GRID_S))


@compiled
def sense_velocity(at: Plant, waters: Waters, now_s: float) -> None:
    """Feed the receiver's own filter."""
    ship, devices = waters.ship, waters.devices
    north_m_s, east_m_s = sensing.sensed_velocity(at.hull, ship, waters.series, at.step, offset(at, now_s))
    if devices.filter_s > 0.0 and at.filtered > 0:
        share = -math.expm1(-sensing.FILTER_SAMPLE_S / devices.filter_s)
        north_m_s = at.north_m_s + share * (north_m_s - at.north_m_s)
        east_m_s = at.east_m_s + share * (east_m_s - at.east_m_s)
    at.north_m_s, at.east_m_s = north_m_s, east_m_s


@compiled
def receive(at: Plant, waters: Waters, now_s: float) -> None:
    """Let the receiver do what is due now: sample its filter, or send a fix."""
    devices = waters.devices
    if devices.filter_s > 0.0 and now_s == devices.fix_phase_s + at.filtered * sensing.FILTER_SAMPLE_S:
        sense_velocity(at, waters, now_s)
        at.filtered += 1
        return
    if not devices.filter_s > 0.0:
        sense_velocity(at, waters, now_s)
    fix = at.fixes[at.fix_count]
    place_m = ships.position(at.hull, waters.ship, waters.series, at.step, offset(at, now_s))
    sensing.tell_fix(fix, devices, waters.series, at.epoch, place_m, (at.north_m_s, at.east_m_s))
    if at.epoch == 0:
        at.first_fix_s = fix[THERE_S]
    at.epoch += 1
    at.fix_count += 1


@compiled
def next_fix(at: Plant, devices: Devices) -> float:
    """Return when the receiver has something to do next."""
    fix_s = devices.fix_phase_s + at.epoch * devices.fix_period_s
    if devices.filter_s > 0.0:
        fix_s = min(fix_s, devices.fix_phase_s + at.filtered * sensing.FILTER_SAMPLE_S)
    return float(fix_s)


@compiled
def show_heading(at: Plant, waters: Waters, now_s: float) -> None:
    """Let the compass sample and send a heading."""
    ship, devices, series = waters.ship, waters.devices, waters.series
    shown_rad = ships.shown_heading(at.hull, ship, series, at.step, offset(at, now_s))
    there_s, said_rad = sensing.heard(devices, series, at.sample, now_s, shown_rad)
    heading = at.headings[at.heading_count]
    heading[THERE_S], heading[SAID_RAD] = there_s, said_rad
    at.sample += 1
    at.heading_count += 1


@compiled
def until_tick(at: Plant, waters: Waters, record: Record, deadline_s: float) -> None:
    """Advance by steps of the grid until a tick is due; first comes what the devices do before the next step."""
    devices = waters.devices
    while True:
        next_s = (at.step + 1) / STEPS_PER_SECOND
        compass_s = devices.compass_phase_s + at.sample * devices.compass_period_s
        if compass_s < next_s and compass_s <= deadline_s:
            show_heading(at, waters, compass_s)
        fix_s = next_fix(at, devices)
        while fix_s < next_s and fix_s <= deadline_s:
            receive(at, waters, fix_s)
            fix_s = next_fix(at, devices)
        if next_s > deadline_s:
            return
        advance(at, waters, record, next_s)


@compiled
def send_rudder(at: Plant, now_s: float, rudder_rad: float) -> None:
    """Send the shaft to a rudder command; the servo is asked for its angle with it."""
    sensing.send_shaft(at.shaft, now_s, rudder_rad)
    at.feedback_rad = sensing.counted_angle(at.shaft, now_s)
