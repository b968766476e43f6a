"""Ship and devices between two ticks: what happens, in its order of time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.lab.compiled import compiled
from hil.lab.lanes import COUNT
from hil.lab.twin import devices as told
from hil.lab.twin import ship as ships
from hil.lab.twin import turning
from hil.lab.twin.devices import THERE_S, Devices
from hil.lab.twin.kalman import Floats
from hil.lab.twin.ship import GRID_S, HULL_STATES, PSI, STEPS_PER_SECOND, Series, Ship

STEPS_PER_ROW = 5
QUEUE = 16

# Of Afloat.counts, and of Afloat.clock.
STEP, ROW, SAMPLE, EPOCH, FILTERED, HEADINGS, FIXES, GIVEN = range(8)
FEEDBACK_RAD, NORTH_M_S, EAST_M_S, FIRST_FIX_S, DEADLINE_S, NEXT_S, UNTIL_S, SHAFT_RAD = range(8)

# Ship and devices as they stand: hull, shaft, sentences on their way to the autopilot, counts.
AFLOAT = np.dtype(
    [
        ("hull", np.float64, (HULL_STATES,)),
        ("shaft", np.float64, (3,)),
        ("headings", np.float64, (QUEUE, 2)),
        ("fixes", np.float64, (QUEUE, 4)),
        ("clock", np.float64, (8,)),
        ("counts", np.int64, (8,)),
    ]
)
Afloat = Any  # a record of AFLOAT


class Sea(NamedTuple):
    """Everything of a run that the autopilot has no part in."""

    ship: Ship
    series: Series
    devices: Devices


class Record(NamedTuple):
    """What is filled in: heading and rudder ten times a second as in truth.csv, and a row for each tick if any."""

    heading_rad: Floats
    rudder_rad: Floats
    ticks: Floats


class Waters(NamedTuple):
    """What the boats of a batch sail in, and how they stand there: records of all lanes, and rooms of numbers.

    `waiting` is the rudder on its way to the water, a row for each lane, `turns` what turns the hulls.
    """

    ships: NDArray[Any]
    devices: NDArray[Any]
    afloat: NDArray[Any]
    series: Series
    waiting: Floats
    turns: Floats


@compiled
def begin_afloat(at: Afloat, ship: Ship) -> None:
    """Lie at the start with the rudder amidships."""
    ships.begin_hull(at.hull, ship)
    at.clock[FIRST_FIX_S] = np.nan


@compiled
def sail(waters: Waters, record: Record, going: int) -> None:
    """Let the ships of the lanes in `going`, a bit for each, sail on the grid until their times."""
    series, turns, most = waters.series, waters.turns, 1
    for k in range(COUNT):
        if going >> k & 1 > 0:
            turning.be_beside(waters.afloat[k].hull, waters.ships[k], turns, k)
            most = max(most, waters.ships[k].inner_steps)
    while True:
        moved = 0
        for k in range(COUNT):
            turns[turning.ON, k] = 0.0
            at, ship = waters.afloat[k], waters.ships[k]
            step = at.counts[STEP]
            next_s = (step + 1) / STEPS_PER_SECOND
            if going >> k & 1 > 0 and next_s <= at.clock[UNTIL_S]:
                rudder_rad = told.shaft_angle(at.shaft, next_s)
                at.clock[SHAFT_RAD] = rudder_rad
                rudder_rad = turning.in_water(ship, waters.waiting, k, step, rudder_rad)
                turning.drive(at.hull, ship, series, turns, k, step, rudder_rad)
                moved |= 1 << k
        if moved == 0:
            return
        turning.turn_hulls(turns, most)
        for k in range(COUNT):
            if moved >> k & 1 > 0:
                at = waters.afloat[k]
                turning.end_step(at.hull, waters.ships[k], series, turns, k, at.counts[STEP])
                at.counts[STEP] += 1
                write_row(at, record, k)


@compiled
def write_row(at: Afloat, record: Record, k: int) -> None:
    """Fill the row of a grid step, if it has one."""
    row = at.counts[STEP] // STEPS_PER_ROW
    if row * STEPS_PER_ROW == at.counts[STEP] and row < record.heading_rad.shape[1]:
        record.heading_rad[k, row], record.rudder_rad[k, row] = at.hull[PSI], at.clock[SHAFT_RAD]
        at.counts[ROW] = row


@compiled
def sense_velocity(at: Afloat, ship: Ship, devices: Devices, series: Series, offset_s: float) -> None:
    """Feed the receiver's own filter."""
    clock = at.clock
    north_m_s, east_m_s = told.sensed_velocity(at.hull, ship, series, at.counts[STEP], offset_s)
    share = 1.0
    if devices.filter_s > 0.0 and at.counts[FILTERED] > 0:
        share = -math.expm1(-told.FILTER_SAMPLE_S / devices.filter_s)
        north_m_s = clock[NORTH_M_S] + share * (north_m_s - clock[NORTH_M_S])
        east_m_s = clock[EAST_M_S] + share * (east_m_s - clock[EAST_M_S])
    clock[NORTH_M_S], clock[EAST_M_S] = north_m_s, east_m_s


@compiled
def next_event(at: Afloat, devices: Devices) -> float:
    """Return when compass or receiver does something next."""
    counts = at.counts
    compass_s = devices.compass_phase_s + counts[SAMPLE] * devices.compass_period_s
    fix_s = devices.fix_phase_s + counts[EPOCH] * devices.fix_period_s
    filter_s = np.inf
    if devices.filter_s > 0.0:
        filter_s = devices.fix_phase_s + counts[FILTERED] * told.FILTER_SAMPLE_S
    return float(min(compass_s, fix_s, filter_s))


@compiled
def happen(at: Afloat, ship: Ship, devices: Devices, series: Series, now_s: float) -> None:
    """Let compass or receiver do what is due now."""
    counts, clock = at.counts, at.clock
    offset_s = min(max(now_s - counts[STEP] / STEPS_PER_SECOND, 0.0), GRID_S)
    if now_s == devices.compass_phase_s + counts[SAMPLE] * devices.compass_period_s:
        shown_rad = ships.shown_heading(at.hull, ship, series, counts[STEP], offset_s)
        told.tell_heading(at.headings[counts[HEADINGS]], devices, series, counts[SAMPLE], now_s, shown_rad)
        counts[SAMPLE] += 1
        counts[HEADINGS] += 1
    elif devices.filter_s > 0.0 and now_s == devices.fix_phase_s + counts[FILTERED] * told.FILTER_SAMPLE_S:
        sense_velocity(at, ship, devices, series, offset_s)
        counts[FILTERED] += 1
    else:
        if not devices.filter_s > 0.0:
            sense_velocity(at, ship, devices, series, offset_s)
        fix = at.fixes[counts[FIXES]]
        told.tell_fix(fix, devices, series, counts[EPOCH], clock[NORTH_M_S], clock[EAST_M_S])
        if counts[EPOCH] == 0:
            clock[FIRST_FIX_S] = fix[THERE_S]
        counts[EPOCH] += 1
        counts[FIXES] += 1


@compiled
def until_tick(waters: Waters, record: Record, going: int) -> None:
    """Let ships and devices of the lanes in `going`, a bit for each, go on until their ticks are due."""
    left = going
    while left > 0:
        for k in range(COUNT):
            if left >> k & 1 > 0:
                clock = waters.afloat[k].clock
                clock[NEXT_S] = next_event(waters.afloat[k], waters.devices[k])
                clock[UNTIL_S] = min(clock[NEXT_S], clock[DEADLINE_S])
        sail(waters, record, left)
        for k in range(COUNT):
            if left >> k & 1 > 0:
                clock = waters.afloat[k].clock
                if clock[NEXT_S] > clock[DEADLINE_S]:
                    left ^= 1 << k
                else:
                    happen(waters.afloat[k], waters.ships[k], waters.devices[k], waters.series, clock[NEXT_S])


@compiled
def send_rudder(at: Afloat, now_s: float, rudder_rad: float) -> None:
    """Send the shaft to a rudder command; when it is acknowledged, the servo tells its angle, before the next tick."""
    told.send_shaft(at.shaft, now_s, rudder_rad)
    at.clock[FEEDBACK_RAD] = told.counted_angle(at.shaft, now_s + told.ACKNOWLEDGED_S)


@compiled
def drop(rows: Floats, gone: int, count: int) -> None:
    """Forget the first rows."""
    for k in range(gone, count):
        for i in range(rows.shape[1]):
            rows[k - gone, i] = rows[k, i]
