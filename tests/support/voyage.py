"""Long voyages of the default boat in the compiled loop.

tests/process/test_twin.py compares this loop with the autopilot in the same sea, bit for bit.
"""

import math

import numpy as np

from firmware_py.common.angles import degrees
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType
from firmware_py.control.law import LawSettings
from hil.lab.twin import loop, plant, sailing
from hil.lab.twin.sea import sea_of as drawn
from hil.ship.scenarios import parse_scenario
from hil.sim.goals import Goal


def parameters_with(**parameters):
    """Return the default parameters with changes."""
    values = ParameterSet()
    for name, value in parameters.items():
        values = values.replaced(name, value)
    return values


def sail(text, seed, goals, seconds, *, blade_lost_s=math.inf, parameters=None):
    """Simulate a sea with goals of (time, heading [rad]); return the rows of the ticks, and the record."""
    values = parameters or parameters_with()
    sea = drawn(parse_scenario(text), seed, seconds)
    sea = sea._replace(ship=sea.ship._replace(blade_lost_s=blade_lost_s))
    task = sailing.task_of([Goal(t_s, degrees(heading_rad)) for t_s, heading_rad in goals])
    record, count = sailing.sail(sailing.boat_of(values), LawSettings.of(values), sea, task, seconds)
    return record.ticks[:count], record


def loss_and_reversal_times(ticks):
    """Return the times [s] of the ticks with loss of steering, and of those with reversed steering."""
    times_s = ticks[:, loop.TICK_S]
    return times_s[ticks[:, loop.LOST] > 0.0], times_s[ticks[:, loop.REVERSED] > 0.0]


def fixes(sea, orders, seconds):
    """Return the rows of the fixes in the compiled plant; `orders` are times and shaft angles."""
    waters, no_record, rows = sailing.waters_of(sea), plant.Record(np.zeros(0), np.zeros(0), np.zeros((0, 0))), []
    at, from_s = sailing.zeros(plant.PLANT), 0.0
    plant.begin(at, waters.ship)
    for to_s, angle_rad in [*orders, (seconds, None)]:
        for now_s in [*np.arange(from_s, to_s).tolist(), to_s]:
            plant.advance_to_tick(at, waters, no_record, now_s)
            rows += [row.copy() for row in at["fixes"][: at["fix_count"]]]
            at["fix_count"] = at["heading_count"] = 0
        if angle_rad is not None:
            plant.send_rudder(at, to_s, angle_rad)
        from_s = to_s
    return np.array(rows)


def row_of(sample):
    """Return a position sample of the firmware as a row of the compiled plant's fixes."""
    numbers = (sample.speed_over_ground_m_s, sample.course_over_ground_rad, sample.latitude_rad, sample.longitude_rad)
    speed_m_s, course_rad, *place = (math.nan if number is None else number for number in numbers)
    return (sample.t_s, speed_m_s, course_rad, sample.fix is FixType.NONE, *place)
