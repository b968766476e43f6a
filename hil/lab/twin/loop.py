"""The closed loop of the delivered boat, compiled: plant and autopilot of one run.

Times are those of the harness in lockstep: a sentence is there when its last byte has been transferred, the servo takes
a goal at the tick and is asked for its angle with it, the ticks follow the compass.
tests/process/test_twin.py holds the whole of it against the real autopilot on ptys, to the last bit.
"""

from __future__ import annotations

from hil.lab.compiled import compiled
from hil.lab.numeric_core import inner
from hil.lab.twin import intake, pilot, plant
from hil.lab.twin.autopilot import Autopilot, Helm, Intake, Seen, Task
from hil.lab.twin.plant import Plant, Record, Waters
from hil.lab.twin.ship import Floats

MORE_TICKS = 8  # than rows there are not

# Columns of the ticks of a record.
# Those of what the autopilot makes of a tick are NaN while it steers for no heading, or shows none.
(TICK_S, COMMAND_RAD, MEASURED_RAD, HEADING_RAD, YAW_RATE_RAD_S, HEADING_SD_RAD, SPEED_M_S, ERROR_RAD, SHOWN_RAD,
 SOFTNESS, OSCILLATING, LOSS_EVIDENCE, LOST, REVERSED, INCONSISTENT, CURRENT_STRONG) = range(16)  # fmt: skip
TICK_COLUMNS = 16


@inner
def note(row: Floats, a: Autopilot, helm: Helm, seen: Seen, now_s: float) -> None:
    """Fill the row of a tick."""
    me = a.state
    row[TICK_S], row[COMMAND_RAD], row[MEASURED_RAD] = now_s, me.command_rad, seen.rudder_rad
    row[HEADING_RAD], row[YAW_RATE_RAD_S] = me.heading_rad, me.rate_rad_s
    row[HEADING_SD_RAD], row[SPEED_M_S] = me.heading_sd_rad, seen.estimate.speed_m_s
    row[ERROR_RAD] = me.error_rad
    row[SHOWN_RAD] = seen.shown_rad
    row[SOFTNESS], row[OSCILLATING] = helm.oscillation.gain_reduction, helm.oscillation.oscillating
    loss = helm.steering.loss
    row[LOSS_EVIDENCE], row[LOST] = loss.boats[0].evidence, loss.lost
    row[REVERSED] = helm.steering.reversal.reversed
    row[INCONSISTENT], row[CURRENT_STRONG] = seen.inconsistent, seen.current_strong


@compiled
def voyage(at: Plant, waters: Waters, a: Autopilot, taken: Intake, helm: Helm, task: Task, record: Record) -> int:
    """Sail as long as there are rows, and fill them; return how many ticks there were."""
    plant.begin(at, waters.ship)
    pilot.begin(a)
    last, ticks, deadline_s = record.heading_rad.size - 1, 0, 0.0
    while at.row < last and ticks < last + 1 + MORE_TICKS:
        plant.until_tick(at, waters, record, deadline_s)
        pilot.take_goals(a, task, deadline_s)
        taken, seen = intake.update(a, at, taken, deadline_s)
        helm = pilot.steer(a, helm, seen, deadline_s)
        plant.send_rudder(at, deadline_s, a.boat.servo_sign * a.state.command_rad)
        if record.ticks.shape[0] > 0:
            note(record.ticks[ticks], a, helm, seen, deadline_s)
        ticks += 1
        deadline_s = pilot.next_deadline(deadline_s, a.state.newest_s)
    return ticks
