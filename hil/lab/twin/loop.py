"""The closed loop of the delivered boat.

Times are those of the harness in lockstep: a sentence is there when its last byte has been transferred, the servo takes
a goal at the tick and is asked for its angle with it, the ticks follow the compass.
tests/process/test_twin.py holds the whole of it against the real autopilot on ptys, to the last bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.lab.compiled import compiled
from hil.lab.lane_math import fails
from hil.lab.lane_rows import fields, lent, rows
from hil.lab.lanes import any_of, bits_of, mask_of
from hil.lab.twin import helm, intake, kalman, oscillation, pilot, sources
from hil.lab.twin.afloat import (
    BEFORE_S,
    DEADLINE_S,
    ROW,
    TICKS,
    Afloat,
    Record,
    Waters,
    begin_afloat,
    send_rudder,
    until_tick,
)  # fmt: skip
from hil.lab.twin.crew import (
    NEWEST_S,
    OWN_COMMAND_RAD,
    OWN_ERROR_RAD,
    OWN_HEADING_RAD,
    OWN_RATE_RAD_S,
    Crew,
    Orders,
)  # fmt: skip
from hil.lab.twin.kalman import Floats
from hil.lab.twin.wave_filter_state import RUDDER

Lanes = Any
MORE_TICKS = 8  # than rows there are not

# Columns of the ticks of a record.
# Those of what the autopilot makes of a tick are NaN while it steers for no heading, or shows none.
(TICK_S, COMMAND_RAD, MEASURED_RAD, HEADING_RAD, YAW_RATE_RAD_S, HEADING_SD_RAD, SPEED_M_S, ERROR_RAD, SHOWN_RAD,
 SOFTNESS, OSCILLATING) = range(11)  # fmt: skip
TICK_COLUMNS = 11


@compiled
def note(row: Floats, crew: Crew, k: int, now_s: float) -> None:
    """Fill the row of a tick of a lane."""
    me, f = crew.pilots[0], crew.filters[0]
    own, source = me.own, me.source
    row[TICK_S], row[COMMAND_RAD], row[MEASURED_RAD] = now_s, own[OWN_COMMAND_RAD, k], f.w[RUDDER, k]
    row[HEADING_RAD], row[YAW_RATE_RAD_S] = own[OWN_HEADING_RAD, k], own[OWN_RATE_RAD_S, k]
    row[HEADING_SD_RAD], row[SPEED_M_S] = me.known[helm.E_HEADING_SD, k], f.x[kalman.SPEED, k]
    row[ERROR_RAD] = own[OWN_ERROR_RAD, k]
    row[SHOWN_RAD] = source[sources.RAW, k] if source[sources.IN_USE, k] == sources.COMPASS else np.nan
    row[SOFTNESS], row[OSCILLATING] = me.swing[oscillation.SOFTNESS, k], me.swing[oscillation.OSCILLATING, k]


@compiled
def voyage(w: Waters, c: Crew, o: Orders, r: Record, ticks: NDArray[np.int64]) -> None:
    """Sail a batch, the arrays of which are lent to all that work on them."""
    sail(
        Waters(
            lent(w.ships), lent(w.devices), lent(w.beside), lent(w.devices_beside), lent(w.afloat), lent(w.series),
            lent(w.waiting),
        ),
        Crew(lent(c.boats), lent(c.pilots), lent(c.filters), lent(c.covariances)),
        Orders(lent(o.laws), lent(o.given_s), lent(o.goals_rad)),
        Record(lent(r.heading_rad), lent(r.rudder_rad), lent(r.ticks)),
        lent(ticks),
    )  # fmt: skip


@compiled
def steer(crew: Crew, orders: Orders, at: Afloat, on: Lanes) -> None:
    """End a tick: steer, and find when the next one is due."""
    clock, boats = rows(at.clock, on), fields(crew.boats[0])
    now_s, own = clock[DEADLINE_S], rows(crew.pilots[0].own, on)
    pilot.settle(crew, at, on, now_s)
    pilot.steer(crew, orders, on, now_s)
    send_rudder(at, on, now_s, boats.servo_sign * own[OWN_COMMAND_RAD])
    clock[DEADLINE_S] = pilot.next_deadline(now_s, own[NEWEST_S])


@compiled
def sail(waters: Waters, crew: Crew, orders: Orders, record: Record, ticks: NDArray[np.int64]) -> None:
    """Sail as many lanes as there are numbers of ticks, as long as there are rows; fill records and numbers of ticks.

    A boat with a fix waits for the others to have theirs, so that most ticks are alike in all lanes.
    """
    begin_afloat(waters)
    at, last = waters.afloat[0], record.heading_rad.shape[1] - 1
    sailing = mask_of((1 << ticks.size) - 1)
    fixed = mask_of(0)
    pilot.begin_pilots(crew, orders, sailing)
    while any_of(sailing):
        looking = sailing & fails(fixed)
        until_tick(waters, record, looking)
        found = pilot.look(crew, orders, at, looking)
        going, fixed = looking & fails(found), fixed | found
        if not any_of(going):
            going, fixed = fixed, mask_of(0)
        intake.estimate(crew, at, going)
        clock = rows(at.clock, going)
        clock[BEFORE_S] = clock[DEADLINE_S]
        steer(crew, orders, at, going)
        counts = rows(at.counts, going)
        counts[TICKS] = counts[TICKS] + 1.0
        if record.ticks.shape[1] > 0:
            for k in range(ticks.size):
                if bits_of(going) >> k & 1 > 0:
                    note(record.ticks[k, int(at.counts[TICKS, k]) - 1], crew, k, at.clock[BEFORE_S, k])
        sailing = sailing & fails(going & ((counts[ROW] >= last) | (counts[TICKS] >= last + 1 + MORE_TICKS)))
    for k in range(ticks.size):
        ticks[k] = int(at.counts[TICKS, k])
