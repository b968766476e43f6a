"""The compiled closed loop: plant and autopilot of one run.

Times are those of the harness in lockstep: a message arrives with its last byte, the servo receives a command and
returns its angle at the tick, and the ticks follow the compass. tests/process/test_twin.py compares the loop with the
real autopilot on ptys, to the last bit.
"""

from __future__ import annotations

from hil.lab.compiled import compiled
from hil.lab.numeric_core import inner
from hil.lab.twin import autopilot, estimator, plant
from hil.lab.twin.autopilot import Autopilot, ControlState, EstimatorState, Task, TickEstimate
from hil.lab.twin.plant import Plant, Record, Waters
from hil.lab.twin.ship import Floats

MAX_EXTRA_TICKS = 8  # maximum number of ticks minus number of rows

# Columns of the ticks in a record; the estimates are NaN without a heading goal or before the first heading.
(TICK_S, COMMAND_RAD, MEASURED_RAD, HEADING_RAD, YAW_RATE_RAD_S, HEADING_SD_RAD, SPEED_M_S, ERROR_RAD, COMPASS_RAD,
 GAIN_REDUCTION, OSCILLATING, LOSS_EVIDENCE, LOST, REVERSED, INCONSISTENT, CURRENT_STRONG) = range(16)  # fmt: skip
TICK_COLUMNS = 16


@inner
def write_row(row: Floats, a: Autopilot, control: ControlState, tick: TickEstimate, now_s: float) -> None:
    """Write the row of a tick."""
    state = a.state
    row[TICK_S], row[COMMAND_RAD], row[MEASURED_RAD] = now_s, state.command_rad, tick.rudder_rad
    row[HEADING_RAD], row[YAW_RATE_RAD_S] = state.heading_rad, state.rate_rad_s
    row[HEADING_SD_RAD], row[SPEED_M_S] = state.heading_sd_rad, tick.estimate.speed_m_s
    row[ERROR_RAD] = state.error_rad
    row[COMPASS_RAD] = tick.compass_rad
    row[GAIN_REDUCTION], row[OSCILLATING] = control.oscillation.gain_reduction, control.oscillation.oscillating
    loss = control.steering.loss
    row[LOSS_EVIDENCE], row[LOST] = loss.boats[0].evidence, loss.lost
    row[REVERSED] = control.steering.reversal.reversed
    row[INCONSISTENT], row[CURRENT_STRONG] = tick.inconsistent, tick.current_strong


@compiled
def voyage(
    plant_state: Plant,
    waters: Waters,
    a: Autopilot,
    estimators: EstimatorState,
    control: ControlState,
    task: Task,
    record: Record,
) -> int:
    """Simulate until all rows of the record are written; return the number of ticks."""
    plant.begin(plant_state, waters.ship)
    autopilot.begin(a)
    last, ticks, deadline_s = record.heading_rad.size - 1, 0, 0.0
    while plant_state.row < last and ticks < last + 1 + MAX_EXTRA_TICKS:
        plant.advance_to_tick(plant_state, waters, record, deadline_s)
        autopilot.receive_goals(a, task, deadline_s)
        estimators, tick = estimator.update(a, plant_state, estimators, deadline_s)
        control = autopilot.steer(a, control, tick, deadline_s)
        plant.send_rudder(plant_state, deadline_s, a.boat.servo_sign * a.state.command_rad)
        if record.ticks.shape[0] > 0:
            write_row(record.ticks[ticks], a, control, tick, deadline_s)
        ticks += 1
        deadline_s = autopilot.next_deadline(deadline_s, a.state.newest_s)
    return ticks
