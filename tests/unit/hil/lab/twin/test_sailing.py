"""Runs of the compiled loop in several threads are identical to single runs."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from hil.lab.numeric_core import LawSettings
from hil.lab.twin import sailing
from hil.lab.twin.sea import sea_of as draw_sea
from hil.ship.scenarios import parse_scenario
from hil.sim.goals import parse_goals

pytestmark = pytest.mark.timeout(600)  # the loop is compiled first

SECONDS = 90.0
# Different ships, devices, delays and seas, and a receiver without any fix.
SEAS = ("ocean-1", "ocean-4", "calm", "gusts", "swell+kt=0.5:2,delay=2", "sea+float=0.3:0.6,receiver=0:1", "ocean-3")


def run_of(number):
    parameters = ParameterSet().replaced("RUD_REVERSE", float(number % 2)).replaced("CTL_PRICE", 1.0 + 0.5 * number)
    goals = parse_goals(("0:0,30:60", "0:170", "20:-90,40:-80,60:0")[number % 3])
    sea = draw_sea(parse_scenario(SEAS[number]), number + 1, SECONDS)
    return sailing.boat_of(parameters), LawSettings.of(parameters), sea, sailing.task_of(goals)


def test_run_in_a_thread_without_tick_rows_is_identical():
    runs = [run_of(number) for number in range(len(SEAS))]
    with ThreadPoolExecutor(2) as pool:
        parallel_results = list(pool.map(lambda run: sailing.sail(*run, SECONDS, ticks=False), runs))
    for run, (record, ticks) in zip(runs, parallel_results, strict=True):
        record_alone, count = sailing.sail(*run, SECONDS)
        assert (record.ticks.size, ticks) == (0, count)
        assert np.array_equal(record.heading_rad, record_alone.heading_rad)
        assert np.array_equal(record.rudder_rad, record_alone.rudder_rad)
    assert len({record.rudder_rad.tobytes() for record, _ in parallel_results}) == len(SEAS)
