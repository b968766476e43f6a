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
from hil.lab.twin.ship import (
    GRID_S,
    HULL_STATES,
    PSI,
    RUDDER,
    STEPS_PER_SECOND,
    SWAPPED,
    YAW_RATE,
    Series,
    Ship,
)  # fmt: skip

STEPS_PER_ROW = 5
QUEUE = 16

# Of Afloat.counts, and of Afloat.clock.
STEP, ROW, SAMPLE, EPOCH, FILTERED, HEADINGS, FIXES, GIVEN, TICKS, NOTED, SEEN_STEP = range(11)
(FEEDBACK_RAD, NORTH_M_S, EAST_M_S, FIRST_FIX_S, DEADLINE_S, NEXT_S, SHAFT_RAD, BEFORE_S, ROW_PSI_RAD, ROW_SHAFT_RAD,
 SEEN_S) = range(11)  # fmt: skip

# Ships and devices of all lanes as they stand: hulls, as they are and as the compass saw them last, shafts, sentences
# on their way to the autopilot, whole numbers.
AFLOAT = np.dtype(
    [
        (name, np.float64, (*shape, COUNT))
        for name, *shape in (
            ("hull", HULL_STATES), ("seen", HULL_STATES), ("shaft", 3), ("headings", QUEUE, 2), ("fixes", QUEUE, 4),
            ("clock", 11), ("counts", 11),
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
    for hull in (at.hull, at.seen):
        ships.begin_hull(rows(hull, True), fields(waters.beside[0]))
    rows(at.clock, True)[FIRST_FIX_S] = np.nan


@compiled
def sail(waters: Waters, on: Lanes, step: Lanes, next_s: Lanes) -> None:
    """Let the ships of the lanes that are on sail from a step of the grid to the next, which is at next_s."""
    at, ship = waters.afloat[0], fields(waters.beside[0])
    clock, counts = rows(at.clock, on), rows(at.counts, on)
    shaft_rad = told.shaft_angle(rows(at.shaft, on), next_s)
    clock[SHAFT_RAD] = shaft_rad
    rudder_rad = turning.in_water(at.hull, on, ship, waters.waiting, step, shaft_rad)
    turning.turn_hulls(at.hull, on, ship, waters.series, step, rudder_rad)
    counts[STEP] = step + 1.0


@compiled
def note_rows(at: Afloat, record: Record, on: Lanes, step: Lanes) -> None:
    """Note the rows of a grid step, in the lanes that have one; a lane that has one noted already has it written."""
    row = math.floor(step / STEPS_PER_ROW)
    due = on & (row * STEPS_PER_ROW == step) & (row < record.heading_rad.shape[1])
    if any_of(due):
        if any_of(due & (rows(at.counts, due)[NOTED] > 0.0)):
            write_rows(at, record)
        clock, counts = rows(at.clock, due), rows(at.counts, due)
        counts[ROW], counts[NOTED] = row, 1.0
        clock[ROW_PSI_RAD], clock[ROW_SHAFT_RAD] = rows(at.hull, due)[PSI], clock[SHAFT_RAD]


@compiled
def write_rows(at: Afloat, record: Record) -> None:
    """Write what was noted last of each lane, again where it has been written."""
    for k in range(record.heading_rad.shape[0]):
        place = int(at.counts[ROW, k])
        record.heading_rad[k, place], record.rudder_rad[k, place] = at.clock[ROW_PSI_RAD, k], at.clock[ROW_SHAFT_RAD, k]
    rows(at.counts, True)[NOTED] = 0.0


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
def look(at: Afloat, ship: Ship, on: Lanes, now_s: Lanes) -> None:
    """Keep how ships stand when their compasses look; what these show is computed later."""
    hull, seen, clock, counts = rows(at.hull, on), rows(at.seen, on), rows(at.clock, on), rows(at.counts, on)
    seen[PSI], seen[YAW_RATE], seen[RUDDER] = hull[PSI], hull[YAW_RATE], hull[RUDDER]
    if any_of(ship.has_more):
        for number in range(RUDDER + 1, SWAPPED):
            seen[number] = hull[number]
    clock[SEEN_S], counts[SEEN_STEP] = now_s, counts[STEP]
    counts[SAMPLE] = counts[SAMPLE] + 1.0


@compiled
def show_headings(waters: Waters, on: Lanes) -> None:
    """Let the compasses of the lanes that are on tell what they have seen."""
    at, ship, devices = waters.afloat[0], fields(waters.beside[0]), fields(waters.devices_beside[0])
    counts, now_s = rows(at.counts, on), rows(at.clock, on)[SEEN_S]
    step, sample, number = counts[SEEN_STEP], counts[SAMPLE] - 1.0, counts[HEADINGS]
    offset_s = least(most(now_s - step / STEPS_PER_SECOND, 0.0), GRID_S)
    shown_rad = ships.shown_heading(rows(at.seen, on), ship, waters.series, step, offset_s)
    there_s, said_rad = told.heard(devices, waters.series, sample, now_s, shown_rad)
    counts[HEADINGS] = number + 1.0
    place = 0
    while any_of(on & (number >= place)):
        headings = rows(at.headings, on & (number == place))
        headings[2 * place + THERE_S], headings[2 * place + SAID_RAD] = there_s, said_rad
        place += 1


@compiled
def receive(waters: Waters, on: Lanes, now_s: Lanes) -> None:
    """Let the receivers of the lanes that are on do what is due now."""
    at, heard = waters.afloat[0], bits_of(on)
    rows(at.clock, on)[NEXT_S] = now_s
    for k in range(COUNT):
        if heard >> k & 1 > 0:
            speak(at, k, waters.ships[k], waters.devices[k], waters.series)


@compiled
def next_fix(at: Afloat, devices: Devices, on: Lanes) -> Lanes:
    """Return when the receivers have something to do next."""
    counts = rows(at.counts, on)
    fix_s = devices.fix_phase_s + counts[EPOCH] * devices.fix_period_s
    filter_s = devices.fix_phase_s + counts[FILTERED] * told.FILTER_SAMPLE_S
    return least(fix_s, where(devices.filter_s > 0.0, filter_s, np.inf))


@compiled
def until_tick(waters: Waters, record: Record, going: Lanes) -> None:
    """Let ships and devices of the lanes in `going` go on until their ticks are due.

    All go by steps of the grid. What comes before the next one of a lane is done first: its compass looks, not twice
    between two steps, and its receiver does what it has to.
    """
    at, ship, devices = waters.afloat[0], fields(waters.beside[0]), fields(waters.devices_beside[0])
    counts, deadline_s = rows(at.counts, going), rows(at.clock, going)[DEADLINE_S]
    left, seen = going, going & fails(going)
    while any_of(left):
        step = counts[STEP]
        next_s = (step + 1.0) / STEPS_PER_SECOND
        compass_s = devices.compass_phase_s + counts[SAMPLE] * devices.compass_period_s
        looks = left & (compass_s < next_s) & (compass_s <= deadline_s)
        if any_of(looks):
            if any_of(looks & seen):
                show_headings(waters, seen)
                seen = seen & fails(seen)
            look(at, ship, looks, compass_s)
            seen = seen | looks
        fix_s = next_fix(at, devices, left)
        heard = left & (fix_s < next_s) & (fix_s <= deadline_s)
        left = left & (next_s <= deadline_s)
        on = left
        if any_of(heard):
            receive(waters, heard, fix_s)
            again_s = next_fix(at, devices, heard)
            again = heard & (again_s < next_s) & (again_s <= deadline_s)
            on, left = left & fails(again), left | again
        if any_of(on):
            sail(waters, on, step, next_s)
            note_rows(at, record, on, step + 1.0)
    write_rows(at, record)
    if any_of(seen):
        show_headings(waters, seen)


@compiled
def send_rudder(at: Afloat, on: Lanes, now_s: Lanes, rudder_rad: Lanes) -> None:
    """Send the shafts to rudder commands; asked in the same breath, a servo tells where it is then."""
    shaft = rows(at.shaft, on)
    told.send_shaft(shaft, now_s, rudder_rad)
    rows(at.clock, on)[FEEDBACK_RAD] = told.counted_angle(shaft, now_s)
