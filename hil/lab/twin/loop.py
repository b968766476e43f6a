"""The closed loop of the delivered boat.

Times are those of the harness in lockstep: a sentence is there when its last byte has been transferred, the servo takes
a goal at the tick and is asked for its angle when it has acknowledged that, the ticks follow the compass.
tests/process/test_twin.py holds the whole of it against the real autopilot on ptys, to the last bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.lab.compiled import compiled
from hil.lab.lanes import COUNT, lent
from hil.lab.twin import helm, kalman, oscillation, pilot, sources
from hil.lab.twin.afloat import DEADLINE_S, ROW, Afloat, Record, Waters, begin_afloat, send_rudder, until_tick
from hil.lab.twin.kalman import Floats
from hil.lab.twin.pilot import (
    ARMED,
    BEFORE_S,
    NEWEST_S,
    OWN_COMMAND_RAD,
    OWN_ERROR_RAD,
    OWN_HEADING_RAD,
    OWN_RATE_RAD_S,
    Crew,
    Pilot,
)  # fmt: skip
from hil.lab.twin.wave_filter_state import RUDDER, WaveFilter

LONGEST_STEP_S = 1.0
MORE_TICKS = 8  # than rows there are not

# Columns of the ticks of a record.
# Those of what the autopilot makes of a tick are NaN while it steers for no heading, or shows none.
(TICK_S, COMMAND_RAD, MEASURED_RAD, HEADING_RAD, YAW_RATE_RAD_S, HEADING_SD_RAD, SPEED_M_S, ERROR_RAD, SHOWN_RAD,
 SOFTNESS, OSCILLATING) = range(11)  # fmt: skip
TICK_COLUMNS = 11


class Orders(NamedTuple):
    """The laws of the helms, and the goals, a row for each lane; a time of inf stands for no goal more."""

    laws: Floats
    given_s: Floats
    goals_rad: Floats


@compiled
def note(row: Floats, pilot: Pilot, f: WaveFilter, now_s: float) -> None:
    """Fill the row of a tick."""
    own, source = pilot.own, pilot.source
    row[TICK_S], row[COMMAND_RAD], row[MEASURED_RAD] = now_s, own[OWN_COMMAND_RAD], f.w[RUDDER]
    row[HEADING_RAD], row[YAW_RATE_RAD_S] = own[OWN_HEADING_RAD], own[OWN_RATE_RAD_S]
    row[HEADING_SD_RAD], row[SPEED_M_S] = pilot.known[helm.E_HEADING_SD], f.x[kalman.SPEED]
    row[ERROR_RAD] = own[OWN_ERROR_RAD]
    row[SHOWN_RAD] = source[sources.RAW] if source[sources.IN_USE] == sources.COMPASS else np.nan
    row[SOFTNESS], row[OSCILLATING] = pilot.swing[oscillation.SOFTNESS], pilot.swing[oscillation.OSCILLATING]


@compiled
def begin(waters: Waters, crew: Crew, boats: int) -> None:
    """Begin the runs of the first lanes."""
    for k in range(boats):
        begin_afloat(waters.afloat[k], waters.ships[k])
        pilot.begin_pilot(crew.pilots[k], crew.filters[k], crew.boats[k])
    for k in range(COUNT):
        crew.filters[k].lane = k


@compiled
def look(crew: Crew, orders: Orders, at: Afloat, k: int) -> bool:
    """Begin a tick of a lane; return whether there is a fix."""
    me, now_s = crew.pilots[k], at.clock[DEADLINE_S]
    armed = pilot.take_goals(me.own, orders.given_s[k], orders.goals_rad[k], now_s)
    me.own[ARMED] = 1.0 if armed else 0.0
    return pilot.look(me, crew.filters[k], crew.covariances[0], crew.boats[k], at, now_s)


@compiled
def steer(crew: Crew, orders: Orders, at: Afloat, k: int) -> None:
    """End a tick of a lane: steer, and find when the next one is due."""
    me, f, boat, now_s = crew.pilots[k], crew.filters[k], crew.boats[k], at.clock[DEADLINE_S]
    own = me.own
    step_s = 0.0 if math.isnan(own[BEFORE_S]) else min(max(0.0, now_s - own[BEFORE_S]), LONGEST_STEP_S)
    pilot.settle(me, f, boat, at, now_s)
    pilot.steer(me, f, crew.covariances[0], boat, orders.laws[k], now_s, step_s)
    send_rudder(at, now_s, boat.servo_sign * own[OWN_COMMAND_RAD])
    own[BEFORE_S] = now_s
    at.clock[DEADLINE_S] = pilot.next_deadline(now_s, own[NEWEST_S])


@compiled
def voyage(w: Waters, c: Crew, o: Orders, r: Record, ticks: NDArray[np.int64]) -> None:
    """Sail a batch, the arrays of which are lent to all that work on them."""
    sail(
        Waters(lent(w.ships), lent(w.devices), lent(w.afloat), lent(w.series), lent(w.waiting), lent(w.turns)),
        Crew(
            lent(c.boats), lent(c.pilots), lent(c.filters), lent(c.covariances), lent(c.samples), lent(c.fixes)
        ),
        Orders(lent(o.laws), lent(o.given_s), lent(o.goals_rad)),
        Record(lent(r.heading_rad), lent(r.rudder_rad), lent(r.ticks)),
        lent(ticks),
    )  # fmt: skip


@compiled
def sail(waters: Waters, crew: Crew, orders: Orders, record: Record, ticks: NDArray[np.int64]) -> None:
    """Sail as many lanes as there are numbers of ticks, as long as there are rows; fill records and numbers of ticks.

    A boat with a fix waits for the others to have theirs, so that most ticks are alike in all lanes.
    """
    begin(waters, crew, ticks.size)
    rows, sailing, fixed = record.heading_rad.shape[1], (1 << ticks.size) - 1, 0
    while sailing > 0:
        until_tick(waters, record, sailing & ~fixed)
        going = 0
        for k in range(ticks.size):
            if (sailing & ~fixed) >> k & 1 > 0:
                if look(crew, orders, waters.afloat[k], k):
                    fixed |= 1 << k
                else:
                    going |= 1 << k
        if going == 0:
            going, fixed = fixed, 0
        pilot.estimate(crew, waters.afloat, going)
        for k in range(ticks.size):
            if going >> k & 1 > 0:
                at = waters.afloat[k]
                now_s = at.clock[DEADLINE_S]
                steer(crew, orders, at, k)
                if record.ticks.shape[1] > 0:
                    note(record.ticks[k, ticks[k]], crew.pilots[k], crew.filters[k], now_s)
                ticks[k] += 1
                if at.counts[ROW] >= rows - 1 or ticks[k] >= rows + MORE_TICKS:
                    sailing ^= 1 << k
