"""Ships and devices between two ticks: what happens, in its order of time, in all lanes that wait for it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.lab.compiled import compiled
from hil.lab.lane_math import fails, least, most
from hil.lab.lane_rows import fields, rows
from hil.lab.lanes import COUNT, any_of, bits_of, where
from hil.lab.twin import devices as told
from hil.lab.twin import ship as ships
from hil.lab.twin import turning
from hil.lab.twin.devices import SAID_RAD, THERE_S, Devices
from hil.lab.twin.kalman import Floats
from hil.lab.twin.ship import GRID_S, HULL_STATES, PSI, STEPS_PER_SECOND, Series, Ship

STEPS_PER_ROW = 5
QUEUE = 16

# Of Afloat.counts, and of Afloat.clock.
STEP, ROW, SAMPLE, EPOCH, FILTERED, HEADINGS, FIXES, GIVEN, TICKS = range(9)
FEEDBACK_RAD, NORTH_M_S, EAST_M_S, FIRST_FIX_S, DEADLINE_S, NEXT_S, UNTIL_S, SHAFT_RAD, BEFORE_S = range(9)

# Ships and devices of all lanes as they stand: hulls, shafts, sentences on their way to the autopilot, whole numbers.
AFLOAT = np.dtype(
    [
        (name, np.float64, (*shape, COUNT))
        for name, *shape in (
            ("hull", HULL_STATES), ("shaft", 3), ("headings", QUEUE, 2), ("fixes", QUEUE, 4),
            ("clock", 9), ("counts", 9),
        )
    ]
)  # fmt: skip
Afloat = Any  # a record of AFLOAT
Lanes = Any


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
    """What the boats of a batch sail in, and how they stand there.

    `ships` and `devices` are records of each lane, `beside` and `devices_beside` one of the same numbers side by side;
    `waiting` is the rudder on its way to the water, a row for each lane.
    """

    ships: NDArray[Any]
    devices: NDArray[Any]
    beside: NDArray[Any]
    devices_beside: NDArray[Any]
    afloat: NDArray[Any]
    series: Series
    waiting: Floats


@compiled
def begin_afloat(waters: Waters) -> None:
    """Lie at the start with the rudders amidships."""
    at = waters.afloat[0]
    ships.begin_hull(rows(at.hull, True), fields(waters.beside[0]))
    rows(at.clock, True)[FIRST_FIX_S] = np.nan


@compiled
def sail(waters: Waters, record: Record, going: Lanes) -> None:
    """Let the ships of the lanes in `going` sail on the grid until their times."""
    at, ship = waters.afloat[0], fields(waters.beside[0])
    until_s = rows(at.clock, going)[UNTIL_S]
    while True:
        step = rows(at.counts, going)[STEP]
        next_s = (step + 1.0) / STEPS_PER_SECOND
        on = going & (next_s <= until_s)
        if not any_of(on):
            return
        shaft_rad = told.shaft_angle(rows(at.shaft, on), next_s)
        rows(at.clock, on)[SHAFT_RAD] = shaft_rad
        rudder_rad = turning.in_water(at.hull, on, ship, waters.waiting, step, shaft_rad)
        turning.turn_hulls(at.hull, on, ship, waters.series, step, rudder_rad)
        rows(at.counts, on)[STEP] = step + 1.0
        write_rows(at, record, on, step + 1.0)


@compiled
def write_rows(at: Afloat, record: Record, on: Lanes, step: Lanes) -> None:
    """Fill the rows of a grid step, in the lanes that have one."""
    row = math.floor(step / STEPS_PER_ROW)
    due = on & (row * STEPS_PER_ROW == step) & (row < record.heading_rad.shape[1])
    if any_of(due):
        rows(at.counts, due)[ROW] = row
        for k in range(record.heading_rad.shape[0]):
            if bits_of(due) >> k & 1 > 0:
                place = int(at.counts[ROW, k])
                record.heading_rad[k, place], record.rudder_rad[k, place] = at.hull[PSI, k], at.clock[SHAFT_RAD, k]


@compiled
def sense_velocity(at: Afloat, k: int, ship: Ship, devices: Devices, series: Series, offset_s: float) -> None:
    """Feed the receiver's own filter of a lane."""
    clock = at.clock
    north_m_s, east_m_s = told.sensed_velocity(at.hull[:, k], ship, series, int(at.counts[STEP, k]), offset_s)
    share = 1.0
    if devices.filter_s > 0.0 and at.counts[FILTERED, k] > 0.0:
        share = -math.expm1(-told.FILTER_SAMPLE_S / devices.filter_s)
        north_m_s = clock[NORTH_M_S, k] + share * (north_m_s - clock[NORTH_M_S, k])
        east_m_s = clock[EAST_M_S, k] + share * (east_m_s - clock[EAST_M_S, k])
    clock[NORTH_M_S, k], clock[EAST_M_S, k] = north_m_s, east_m_s


@compiled
def speak(at: Afloat, k: int, ship: Ship, devices: Devices, series: Series) -> None:
    """Let the receiver of a lane do what is due now."""
    counts, clock, now_s = at.counts, at.clock, at.clock[NEXT_S, k]
    offset_s = min(max(now_s - counts[STEP, k] / STEPS_PER_SECOND, 0.0), GRID_S)
    if devices.filter_s > 0.0 and now_s == devices.fix_phase_s + counts[FILTERED, k] * told.FILTER_SAMPLE_S:
        sense_velocity(at, k, ship, devices, series, offset_s)
        counts[FILTERED, k] += 1.0
    else:
        if not devices.filter_s > 0.0:
            sense_velocity(at, k, ship, devices, series, offset_s)
        fix = at.fixes[int(counts[FIXES, k]), :, k]
        told.tell_fix(fix, devices, series, int(counts[EPOCH, k]), clock[NORTH_M_S, k], clock[EAST_M_S, k])
        if counts[EPOCH, k] == 0.0:
            clock[FIRST_FIX_S, k] = fix[THERE_S]
        counts[EPOCH, k] += 1.0
        counts[FIXES, k] += 1.0


@compiled
def show_headings(waters: Waters, on: Lanes, now_s: Lanes) -> None:
    """Let the compasses of the lanes that are on do what is due now."""
    at, ship, devices = waters.afloat[0], fields(waters.beside[0]), fields(waters.devices_beside[0])
    counts = rows(at.counts, on)
    step, sample, number = counts[STEP], counts[SAMPLE], counts[HEADINGS]
    offset_s = least(most(now_s - step / STEPS_PER_SECOND, 0.0), GRID_S)
    shown_rad = ships.shown_heading(rows(at.hull, on), ship, waters.series, step, offset_s)
    there_s, said_rad = told.heard(devices, waters.series, sample, now_s, shown_rad)
    counts[SAMPLE], counts[HEADINGS] = sample + 1.0, number + 1.0
    place = 0
    while any_of(on & (number >= place)):
        headings = rows(at.headings, on & (number == place))
        headings[2 * place + THERE_S], headings[2 * place + SAID_RAD] = there_s, said_rad
        place += 1


@compiled
def until_tick(waters: Waters, record: Record, going: Lanes) -> None:
    """Let ships and devices of the lanes in `going` go on until their ticks are due; receivers wait for compasses."""
    at, devices = waters.afloat[0], fields(waters.devices_beside[0])
    left = going
    while any_of(left):
        clock, counts = rows(at.clock, left), rows(at.counts, left)
        compass_s = devices.compass_phase_s + counts[SAMPLE] * devices.compass_period_s
        fix_s = devices.fix_phase_s + counts[EPOCH] * devices.fix_period_s
        filter_s = devices.fix_phase_s + counts[FILTERED] * told.FILTER_SAMPLE_S
        other_s = least(fix_s, where(devices.filter_s > 0.0, filter_s, np.inf))
        clock[NEXT_S] = least(compass_s, other_s)
        next_s, deadline_s = clock[NEXT_S], clock[DEADLINE_S]
        sailing, comes = left, next_s <= deadline_s
        spoken = left & comes & (other_s < compass_s)
        if any_of(left & fails(spoken)):
            sailing = left & fails(spoken)
        rows(at.clock, sailing)[UNTIL_S] = least(next_s, deadline_s)
        sail(waters, record, sailing)
        left = left & (fails(sailing) | comes)
        shown = sailing & comes & (next_s == compass_s)
        if any_of(shown):
            show_headings(waters, shown, next_s)
        heard = bits_of(sailing & comes & fails(shown))
        for k in range(COUNT):
            if heard >> k & 1 > 0:
                speak(at, k, waters.ships[k], waters.devices[k], waters.series)


@compiled
def send_rudder(at: Afloat, on: Lanes, now_s: Lanes, rudder_rad: Lanes) -> None:
    """Send the shafts to rudder commands; asked in the same breath, a servo tells where it is then."""
    shaft = rows(at.shaft, on)
    told.send_shaft(shaft, now_s, rudder_rad)
    rows(at.clock, on)[FEEDBACK_RAD] = told.counted_angle(shaft, now_s)
