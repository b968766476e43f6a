"""The closed loop of the delivered boat.

Times are those of the harness in lockstep: a sentence is there when its last byte has been transferred, the servo takes
a goal at the tick and is asked for its angle when it has acknowledged that, the ticks follow the compass.
tests/process/test_twin.py holds the whole of it against the real autopilot on ptys, to the last bit.
"""

from __future__ import annotations

import math

import numpy as np

from hil.lab.compiled import compiled
from hil.lab.twin import devices as told
from hil.lab.twin import helm, kalman, oscillation, sources, wave_filter
from hil.lab.twin.afloat import MEASURE_S, ROW, Record, Sea, new_afloat, until_tick
from hil.lab.twin.kalman import Floats
from hil.lab.twin.pilot import (
    BEFORE_S,
    NEWEST_S,
    OWN_COMMAND_RAD,
    OWN_ERROR_RAD,
    OWN_HEADING_RAD,
    OWN_RATE_RAD_S,
    Boat,
    Pilot,
    Task,
    estimate,
    new_pilot,
    next_deadline,
    steer,
    take_goals,
)  # fmt: skip

LONGEST_STEP_S = 1.0

# Columns of the ticks of a record.
# Those of what the autopilot makes of a tick are NaN while it steers for no heading, or shows none.
(TICK_S, COMMAND_RAD, MEASURED_RAD, HEADING_RAD, YAW_RATE_RAD_S, HEADING_SD_RAD, SPEED_M_S, ERROR_RAD, SHOWN_RAD,
 SOFTNESS, OSCILLATING) = range(11)  # fmt: skip
TICK_COLUMNS = 11


@compiled
def note(row: Floats, pilot: Pilot, now_s: float) -> None:
    """Fill the row of a tick."""
    own, f, source = pilot.own, pilot.waves, pilot.source
    row[TICK_S], row[COMMAND_RAD], row[MEASURED_RAD] = now_s, own[OWN_COMMAND_RAD], f.w[wave_filter.RUDDER]
    row[HEADING_RAD], row[YAW_RATE_RAD_S] = own[OWN_HEADING_RAD], own[OWN_RATE_RAD_S]
    row[HEADING_SD_RAD], row[SPEED_M_S] = pilot.known[helm.E_HEADING_SD], f.x[kalman.SPEED]
    row[ERROR_RAD] = own[OWN_ERROR_RAD]
    row[SHOWN_RAD] = source[sources.RAW] if source[sources.IN_USE] == sources.COMPASS else np.nan
    row[SOFTNESS], row[OSCILLATING] = pilot.swing[oscillation.SOFTNESS], pilot.swing[oscillation.OSCILLATING]


@compiled
def voyage(boat: Boat, law: Floats, sea: Sea, task: Task, record: Record) -> int:
    """Sail as long as there are rows; fill the record and return how many ticks there were."""
    at, pilot = new_afloat(sea.ship), new_pilot(boat)
    own, deadline_s, tick = pilot.own, 0.0, 0
    while at.counts[ROW] < record.heading_rad.size - 1 and tick < record.ticks.shape[0]:
        until_tick(at, sea, record, deadline_s)
        step_s = 0.0 if math.isnan(own[BEFORE_S]) else min(max(0.0, deadline_s - own[BEFORE_S]), LONGEST_STEP_S)
        armed = take_goals(own, task, deadline_s)
        estimate(pilot, boat, at, deadline_s)
        steer(pilot, boat, law, deadline_s, step_s, armed)
        told.send_shaft(at.shaft, deadline_s, boat.servo_sign * own[OWN_COMMAND_RAD])
        at.clock[MEASURE_S] = deadline_s + told.ACKNOWLEDGED_S
        note(record.ticks[tick], pilot, deadline_s)
        tick += 1
        own[BEFORE_S] = deadline_s
        deadline_s = next_deadline(deadline_s, own[NEWEST_S])
    return tick
