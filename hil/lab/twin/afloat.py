"""Ship and devices between two ticks: what happens, in its order of time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.lab.compiled import compiled
from hil.lab.twin import devices as told
from hil.lab.twin import ship as ships
from hil.lab.twin.devices import THERE_S, Devices
from hil.lab.twin.kalman import Floats
from hil.lab.twin.ship import GRID_S, HULL_STATES, PSI, STEPS_PER_SECOND, Series, Ship

STEPS_PER_ROW = 5
QUEUE = 16

# Of Afloat.counts, and of Afloat.clock.
STEP, ROW, SAMPLE, EPOCH, FILTERED, HEADINGS, FIXES, GIVEN = range(8)
MEASURE_S, FEEDBACK_RAD, NORTH_M_S, EAST_M_S, FIRST_FIX_S = range(5)


class Sea(NamedTuple):
    """Everything of a run that the autopilot has no part in."""

    ship: Ship
    series: Series
    devices: Devices


class Record(NamedTuple):
    """What is filled in: heading and rudder ten times a second as in truth.csv, and a row for each tick."""

    heading_rad: Floats
    rudder_rad: Floats
    ticks: Floats


class Afloat(NamedTuple):
    """Ship and devices as they stand: hull, shaft, rudder on its way to the water, sentences on theirs, counts."""

    hull: Floats
    shaft: Floats
    waiting: Floats
    headings: Floats
    fixes: Floats
    clock: Floats
    counts: NDArray[np.int64]


@compiled
def new_afloat(ship: Ship) -> Afloat:
    """Lie at the start with the rudder amidships."""
    at = Afloat(
        np.zeros(HULL_STATES),
        np.zeros(3),
        np.zeros(max(ship.delay_steps, 1)),
        np.zeros((QUEUE, 2)),
        np.zeros((QUEUE, 4)),
        np.zeros(5),
        np.zeros(8, np.int64),
    )
    ships.begin_hull(at.hull, ship)
    at.clock[MEASURE_S], at.clock[FIRST_FIX_S] = np.inf, np.nan
    return at


@compiled
def sail_to(at: Afloat, sea: Sea, record: Record, t_s: float) -> None:
    """Let the ship sail on the grid until a time."""
    counts = at.counts
    while (counts[STEP] + 1) / STEPS_PER_SECOND <= t_s:
        next_s = (counts[STEP] + 1) / STEPS_PER_SECOND
        rudder_rad = told.shaft_angle(at.shaft, next_s)
        ships.step_hull(at.hull, sea.ship, sea.series, at.waiting, counts[STEP], rudder_rad)
        counts[STEP] += 1
        row = counts[STEP] // STEPS_PER_ROW
        if row * STEPS_PER_ROW == counts[STEP] and row < record.heading_rad.size:
            record.heading_rad[row], record.rudder_rad[row] = at.hull[PSI], rudder_rad
            counts[ROW] = row


@compiled
def sense_velocity(at: Afloat, sea: Sea, offset_s: float) -> None:
    """Feed the receiver's own filter."""
    clock = at.clock
    north_m_s, east_m_s = told.sensed_velocity(at.hull, sea.ship, sea.series, at.counts[STEP], offset_s)
    share = 1.0
    if sea.devices.filter_s > 0.0 and at.counts[FILTERED] > 0:
        share = -math.expm1(-told.FILTER_SAMPLE_S / sea.devices.filter_s)
        north_m_s = clock[NORTH_M_S] + share * (north_m_s - clock[NORTH_M_S])
        east_m_s = clock[EAST_M_S] + share * (east_m_s - clock[EAST_M_S])
    clock[NORTH_M_S], clock[EAST_M_S] = north_m_s, east_m_s


@compiled
def until_tick(at: Afloat, sea: Sea, record: Record, deadline_s: float) -> None:
    """Let ship and devices go on until a tick is due."""
    devices, counts, clock = sea.devices, at.counts, at.clock
    while True:
        compass_s = devices.compass_phase_s + counts[SAMPLE] * devices.compass_period_s
        fix_s = devices.fix_phase_s + counts[EPOCH] * devices.fix_period_s
        filter_s = np.inf
        if devices.filter_s > 0.0:
            filter_s = devices.fix_phase_s + counts[FILTERED] * told.FILTER_SAMPLE_S
        now_s = min(compass_s, fix_s, filter_s, clock[MEASURE_S])
        sail_to(at, sea, record, min(now_s, deadline_s))
        if now_s > deadline_s:
            return
        offset_s = min(max(now_s - counts[STEP] / STEPS_PER_SECOND, 0.0), GRID_S)
        if now_s == clock[MEASURE_S]:
            clock[FEEDBACK_RAD], clock[MEASURE_S] = told.counted_angle(at.shaft, now_s), np.inf
        elif now_s == compass_s:
            shown_rad = ships.shown_heading(at.hull, sea.ship, sea.series, counts[STEP], offset_s)
            told.tell_heading(at.headings[counts[HEADINGS]], devices, counts[SAMPLE], now_s, shown_rad)
            counts[SAMPLE] += 1
            counts[HEADINGS] += 1
        elif now_s == filter_s:
            sense_velocity(at, sea, offset_s)
            counts[FILTERED] += 1
        else:
            if not devices.filter_s > 0.0:
                sense_velocity(at, sea, offset_s)
            fix = at.fixes[counts[FIXES]]
            told.tell_fix(fix, devices, counts[EPOCH], clock[NORTH_M_S], clock[EAST_M_S])
            if counts[EPOCH] == 0:
                clock[FIRST_FIX_S] = fix[THERE_S]
            counts[EPOCH] += 1
            counts[FIXES] += 1


@compiled
def drop(rows: Floats, gone: int, count: int) -> None:
    """Forget the first rows."""
    for k in range(gone, count):
        for i in range(rows.shape[1]):
            rows[k - gone, i] = rows[k, i]
