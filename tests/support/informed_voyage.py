"""The compiled loop with variants for comparison: a filter with the true noise levels, or gains without a model."""

import math
from typing import NamedTuple

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled_here
from hil.lab.numeric_core import LawSettings, heading_filter, heading_model, heading_tick
from hil.lab.twin import autopilot, estimator, loop, plant, sailing
from hil.lab.twin.autopilot import STATE, Autopilot, EstimatorState, TickEstimate, initial_state
from hil.lab.twin.plant import PLANT, Record


class Levels(NamedTuple):
    """Noise levels of a sea: D [deg^2/s], wave yaw [deg], period [s] and damping, rudder bias [deg] and memory [s]."""

    diffusion: float
    wave_deg: float
    wave_period_s: float
    wave_damping: float
    bias_deg: float
    bias_memory_s: float
    compass_deg: float = 0.3


RECORDED_LIKE = {
    "fjord": Levels(0.4, 0.5, 2.0, 0.3, 8.0, 900.0),
    "coast": Levels(2.0, 1.1, 2.5, 0.18, 10.0, 1500.0),
    "offshore": Levels(6.0, 2.4, 3.2, 0.25, 12.0, 3000.0),
}


def levels_of(sea):
    """Return the noise levels of a sea in the form of the filter."""
    walk = radians(sea.bias_deg) * math.sqrt(2.0 / sea.bias_memory_s)
    diffusion = max(sea.diffusion, 1e-5) * radians(1.0) ** 2
    numbers = (
        diffusion, radians(sea.wave_deg), sea.wave_period_s, sea.wave_damping, radians(sea.compass_deg), walk,
    )  # fmt: skip
    return heading_model.NoiseLevels(*map(math.log, numbers))


@compiled_here
def voyage(plant_state, waters, a, estimators, control, task, record, levels, informed, fixed):
    """Simulate like hil/lab/twin/loop.py.

    `informed`: the filter has the true noise levels `levels`. `fixed`: the law has gains without a model.
    """
    plant.begin(plant_state, waters.ship)
    autopilot.begin(a)
    deadline_s, ticks = 0.0, 0
    while plant_state.row < record.heading_rad.size - 1:
        plant.advance_to_tick(plant_state, waters, record, deadline_s)
        autopilot.receive_goals(a, task, deadline_s)
        if informed:
            s, f = estimators.heading, estimators.heading.filter
            # With an early start time the filter does not choose a candidate.
            f = heading_filter.HeadingFilter(
                f.t_s, -1e6, f.motion, levels, f.learning, f.unexplained_s, f.innovation_rad, f.innovation_sd_rad,
                f.innovation_square,
            )  # fmt: skip
            s = heading_tick.HeadingTick(
                s.sources, f, s.uncorrected, s.uncorrected_s, s.check, s.delay, s.smoothed, s.bias_mean_rad,
                s.rudder_rad, s.wave_yaw_rad2,
            )  # fmt: skip
            estimators = EstimatorState(
                s,
                estimators.water,
                estimators.heading_s,
                estimators.heading_interval_s,
                estimators.fix_s,
                estimators.fix_interval_s,
            )
        estimators, tick = estimator.update(a, plant_state, estimators, deadline_s)
        if fixed:
            tick = TickEstimate(
                tick.started, False, tick.estimate, tick.heading_sd_rad, tick.wave_period_s, tick.delay_log_ratio,
                tick.disturbance, tick.rudder_rad, tick.compass_rad, tick.heading_interval_s, tick.inconsistent,
                tick.current_strong,
            )  # fmt: skip
        control = autopilot.steer(a, control, tick, deadline_s)
        plant.send_rudder(plant_state, deadline_s, a.boat.servo_sign * a.state.command_rad)
        if ticks < record.ticks.shape[0]:
            loop.write_row(record.ticks[ticks], a, control, tick, deadline_s)
            ticks += 1
        deadline_s = autopilot.next_deadline(deadline_s, a.state.newest_s)
    return ticks


def sail(sea, goals, seconds, parameters, levels, informed=False, fixed=False, ticks=False):
    """Sail in a drawn sea; return the record with its ticks."""
    rows = round(seconds * 10.0) + 1
    record = Record(np.zeros(rows), np.zeros(rows), np.zeros((rows if ticks else 0, loop.TICK_COLUMNS)))
    boat = sailing.boat_of(parameters)
    a, task = Autopilot(boat, sailing.zeros(STATE), LawSettings.of(parameters)), sailing.task_of(goals)
    waters = sailing.waters_of(sea)
    tick_count = voyage(
        sailing.zeros(PLANT), waters, a, *initial_state(boat), task, record, levels_of(levels), informed, fixed
    )
    return record._replace(ticks=record.ticks[:tick_count])
