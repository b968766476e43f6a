"""Long voyages of the delivered boat in the compiled loop, with the watch over its steering beside it.

tests/process/test_twin.py holds both to what the real autopilot makes of the same sea, bit for bit.
"""

import math

import numpy as np

from firmware_py.common.angles import degrees
from firmware_py.common.parameters import ParameterSet
from firmware_py.control.law import LawSettings
from firmware_py.safety import steering_monitor
from firmware_py.safety.steering_monitor import SteeringInput, SteeringMonitorSettings, SteeringMonitorState
from hil.lab.twin import loop, sailing
from hil.lab.twin.sea import sea_of as drawn
from hil.ship.scenarios import sea_of
from hil.sim.goals import Goal

SEEN = [loop.MEASURED_RAD, loop.HEADING_RAD, loop.HEADING_SD_RAD, loop.SPEED_M_S, loop.ERROR_RAD, loop.SHOWN_RAD]


def told(**parameters):
    """Return the delivered parameters with others in their place."""
    values = ParameterSet()
    for name, value in parameters.items():
        values = values.replaced(name, value)
    return values


def sail(text, seed, goals, seconds, *, blade_lost_s=math.inf, parameters=None):
    """Sail a sea for goals of (time, heading [rad]); return the rows of the ticks, and of heading and rudder."""
    values = parameters or told()
    sea = drawn(sea_of(text), seed, seconds)
    sea = sea._replace(ship=sea.ship._replace(blade_lost_s=blade_lost_s))
    task = sailing.task_of([Goal(t_s, degrees(heading_rad)) for t_s, heading_rad in goals])
    record, count = sailing.sail(sailing.boat_of(values), LawSettings.of(values), sea, task, seconds)
    return record.ticks[:count], record


def watched(ticks, parameters=None):
    """Let the firmware's watch over the steering look at the ticks as its step does; yield its state after each."""
    known, state = SteeringMonitorSettings.of(parameters or told()), SteeringMonitorState()
    for now_s, seen in zip(ticks[:, loop.TICK_S].tolist(), ticks[:, SEEN].tolist(), strict=True):
        rudder_rad, heading_rad, sd_rad, speed_m_s, error_rad, shown_rad = seen
        steered = not math.isnan(error_rad)
        given = SteeringInput(
            rudder_rad,
            heading_rad if steered else None,
            sd_rad,
            speed_m_s,
            error_rad if steered else None,
            None if math.isnan(shown_rad) else shown_rad,
        )
        state = steering_monitor.update(known, state, given, now_s)
        yield state


def lost_and_reversed(ticks, parameters=None):
    """Return when the watch says that she does not answer, and when that she turns the wrong way: [s], of each tick."""
    said = np.array([(state.answer.missing, state.wrong_way.reversed) for state in watched(ticks, parameters)], bool)
    return ticks[said[:, 0], loop.TICK_S], ticks[said[:, 1], loop.TICK_S]
