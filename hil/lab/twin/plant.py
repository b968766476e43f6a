"""Simulate ship and devices between two ticks of the autopilot, in the order of events."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hil.lab.compiled import compiled
from hil.lab.twin import devices as sensing
from hil.lab.twin import ship as ships
from hil.lab.twin.devices import ARRIVAL_S, FIX_COLUMNS, MESSAGE_RAD, Devices
from hil.lab.twin.ship import GRID_S, HULL_STATES, PSI, STEPS_PER_SECOND, Floats, Series, Ship

STEPS_PER_ROW = 5
QUEUE_SIZE = 16

# The state of ship and devices: hull, shaft, queues of messages and their lengths; the next grid step, compass sample,
# fix and sample of the receiver's filter; the last row written; whether the first fix has been received. shaft_rad is
# the angle at the last grid step, feedback_rad that of the last reply of the servo; north_m_s and east_m_s are the
# output of the receiver's filter; first_fix_s is the arrival of the first fix.
PLANT = np.dtype(
    [
        ("hull", np.float64, (HULL_STATES,)),
        ("shaft", np.float64, (3,)),
        ("headings", np.float64, (QUEUE_SIZE, 2)),
        ("fixes", np.float64, (QUEUE_SIZE, FIX_COLUMNS)),
        *((name, np.int64) for name in ("heading_count", "fix_count", "step", "sample", "epoch", "filtered", "row")),
        ("has_fixes", np.bool_),
        *((name, np.float64) for name in ("shaft_rad", "feedback_rad", "north_m_s", "east_m_s", "first_fix_s")),
    ]
)
Plant = Any  # a record of PLANT


class Sea(NamedTuple):
    """All inputs of a run that do not depend on the autopilot."""

    ship: Ship
    series: Series
    devices: Devices


class Waters(NamedTuple):
    """The sea as records for compiled code, and the queue of delayed rudder angles."""

    ship: Any
    series: Series
    devices: Any
    delayed_rad: Floats


class Record(NamedTuple):
    """Results of a run: heading and rudder ten times per second as in truth.csv, and a row for each tick."""

    heading_rad: Floats
    rudder_rad: Floats
    ticks: Floats


@compiled
def begin(plant_state: Plant, ship: Ship) -> None:
    """Initialise the hull, with the rudder centred."""
    ships.begin_hull(plant_state.hull, ship)
    plant_state.first_fix_s = np.nan


@compiled
def advance(plant_state: Plant, waters: Waters, record: Record, next_s: float) -> None:
    """Advance to the next grid step, at time next_s, and write its row."""
    step, ship = plant_state.step, waters.ship
    plant_state.shaft_rad = sensing.shaft_angle(plant_state.shaft, next_s)
    rudder_rad = ships.rudder_in_water(ship, waters.delayed_rad, step, plant_state.shaft_rad)
    ships.step_hull(plant_state.hull, ship, waters.series, step, rudder_rad)
    plant_state.step = step + 1
    row = plant_state.step // STEPS_PER_ROW
    if row * STEPS_PER_ROW == plant_state.step and row < record.heading_rad.size:
        plant_state.row = row
        record.heading_rad[row], record.rudder_rad[row] = plant_state.hull[PSI], plant_state.shaft_rad


@compiled
def offset(plant_state: Plant, now_s: float) -> float:
    """Return the time since the start of the present grid step, limited to its length."""
    return float(min(max(now_s - plant_state.step / STEPS_PER_SECOND, 0.0), GRID_S))


@compiled
def sense_velocity(plant_state: Plant, waters: Waters, now_s: float) -> None:
    """Update the velocity filter of the receiver."""
    ship, devices = waters.ship, waters.devices
    north_m_s, east_m_s = sensing.sensed_velocity(
        plant_state.hull, ship, waters.series, plant_state.step, offset(plant_state, now_s)
    )
    if devices.filter_s > 0.0 and plant_state.filtered > 0:
        weight = -math.expm1(-sensing.FILTER_SAMPLE_S / devices.filter_s)
        north_m_s = plant_state.north_m_s + weight * (north_m_s - plant_state.north_m_s)
        east_m_s = plant_state.east_m_s + weight * (east_m_s - plant_state.east_m_s)
    plant_state.north_m_s, plant_state.east_m_s = north_m_s, east_m_s


@compiled
def receive(plant_state: Plant, waters: Waters, now_s: float) -> None:
    """Process an event of the receiver: sample its velocity filter, or send a fix."""
    devices = waters.devices
    if devices.filter_s > 0.0 and now_s == devices.fix_phase_s + plant_state.filtered * sensing.FILTER_SAMPLE_S:
        sense_velocity(plant_state, waters, now_s)
        plant_state.filtered += 1
        return
    if not devices.filter_s > 0.0:
        sense_velocity(plant_state, waters, now_s)
    fix = plant_state.fixes[plant_state.fix_count]
    position_m = ships.position(
        plant_state.hull, waters.ship, waters.series, plant_state.step, offset(plant_state, now_s)
    )
    sensing.fill_fix(
        fix, devices, waters.series, plant_state.epoch, position_m, (plant_state.north_m_s, plant_state.east_m_s)
    )
    if plant_state.epoch == 0:
        plant_state.first_fix_s = fix[ARRIVAL_S]
    plant_state.epoch += 1
    plant_state.fix_count += 1


@compiled
def next_fix(plant_state: Plant, devices: Devices) -> float:
    """Return the time of the next event of the receiver."""
    fix_s = devices.fix_phase_s + plant_state.epoch * devices.fix_period_s
    if devices.filter_s > 0.0:
        fix_s = min(fix_s, devices.fix_phase_s + plant_state.filtered * sensing.FILTER_SAMPLE_S)
    return float(fix_s)


@compiled
def send_heading(plant_state: Plant, waters: Waters, now_s: float) -> None:
    """Sample the compass and send a heading."""
    ship, devices, series = waters.ship, waters.devices, waters.series
    heading_rad = ships.compass_heading(plant_state.hull, ship, series, plant_state.step, offset(plant_state, now_s))
    arrival_s, message_rad = sensing.compass_message(devices, series, plant_state.sample, now_s, heading_rad)
    heading = plant_state.headings[plant_state.heading_count]
    heading[ARRIVAL_S], heading[MESSAGE_RAD] = arrival_s, message_rad
    plant_state.sample += 1
    plant_state.heading_count += 1


@compiled
def advance_to_tick(plant_state: Plant, waters: Waters, record: Record, deadline_s: float) -> None:
    """Advance in grid steps until the deadline of a tick; device events before a step are processed first."""
    devices = waters.devices
    while True:
        next_s = (plant_state.step + 1) / STEPS_PER_SECOND
        compass_s = devices.compass_phase_s + plant_state.sample * devices.compass_period_s
        if compass_s < next_s and compass_s <= deadline_s:
            send_heading(plant_state, waters, compass_s)
        fix_s = next_fix(plant_state, devices)
        while fix_s < next_s and fix_s <= deadline_s:
            receive(plant_state, waters, fix_s)
            fix_s = next_fix(plant_state, devices)
        if next_s > deadline_s:
            return
        advance(plant_state, waters, record, next_s)


@compiled
def send_rudder(plant_state: Plant, now_s: float, rudder_rad: float) -> None:
    """Send a rudder command to the servo and read its angle."""
    sensing.send_shaft(plant_state.shaft, now_s, rudder_rad)
    plant_state.feedback_rad = sensing.counted_angle(plant_state.shaft, now_s)
