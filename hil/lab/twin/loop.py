"""The closed loop of the delivered boat.

Times are those of the harness in lockstep: a sentence is there when its last byte has been transferred, the servo takes
a goal at the tick and is asked for its angle when it has acknowledged that, the ticks follow the compass.
tests/process/test_twin.py holds the whole of it against the real autopilot on ptys, to the last bit.
"""

from __future__ import annotations

import math

from hil.lab.compiled import compiled
from hil.lab.twin import devices as told
from hil.lab.twin import helm, oscillation, wave_filter
from hil.lab.twin.afloat import MEASURE_S, ROW, Record, Sea, new_afloat, until_tick
from hil.lab.twin.kalman import Floats
from hil.lab.twin.pilot import (
    BEFORE_S,
    NEWEST_S,
    OWN_COMMAND_RAD,
    OWN_HEADING_RAD,
    OWN_RATE_RAD_S,
    Boat,
    Task,
    estimate,
    new_pilot,
    next_deadline,
    steer,
    take_goals,
)  # fmt: skip

LONGEST_STEP_S = 1.0

# Columns of the ticks of a record.
TICK_S, COMMAND_RAD, MEASURED_RAD, HEADING_RAD, YAW_RATE_RAD_S, HEADING_SD_RAD, SOFTNESS = range(7)
TICK_COLUMNS = 7


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
        told.send_shaft(at.shaft, deadline_s, own[OWN_COMMAND_RAD])
        at.clock[MEASURE_S] = deadline_s + told.ACKNOWLEDGED_S
        record.ticks[tick, TICK_S], record.ticks[tick, COMMAND_RAD] = deadline_s, own[OWN_COMMAND_RAD]
        record.ticks[tick, MEASURED_RAD] = pilot.waves.w[wave_filter.RUDDER]
        record.ticks[tick, HEADING_RAD], record.ticks[tick, YAW_RATE_RAD_S] = own[OWN_HEADING_RAD], own[OWN_RATE_RAD_S]
        record.ticks[tick, HEADING_SD_RAD] = pilot.known[helm.E_HEADING_SD]
        record.ticks[tick, SOFTNESS] = pilot.swing[oscillation.SOFTNESS]
        tick += 1
        own[BEFORE_S] = deadline_s
        deadline_s = next_deadline(deadline_s, own[NEWEST_S])
    return tick
