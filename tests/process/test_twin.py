"""The compiled closed loop and the real autopilot on ptys give bit-identical rudder commands in every sea."""

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

from firmware_py.control.law import LawSettings
from firmware_py.core.state_codec import state_from_text
from firmware_py.core.step import step
from firmware_py.log.disk import log_files
from firmware_py.log.reader import read_log
from hil.lab.compare.score import score_of
from hil.lab.twin import loop, sailing
from hil.lab.twin.sea import sea_of
from hil.ship.scenarios import TABLE, parse_scenario
from hil.sim.goals import parse_goals
from hil.sim.logbook import RunOptions
from hil.sim.runner import run
from support import voyage
from support.paths import ROOT

pytestmark = pytest.mark.timeout(600)  # includes half a minute for compilation of the twin

SHORT_RUN = ("0:0,25:60", 45.0)
TURNS_TO_BOTH_SIDES = ("0:0,30:60,80:-30", 120.0)  # a turn to each side
MIN_SCORED_S = 310.0  # scores ignore goals of shorter duration
TASK = ("0:0,120:60,720:-30", 1320.0)
SEEDS = int(os.environ.get("SEEDS", "20"))  # of the proof
# Floats on which the heading oscillates, so that the gain is reduced.
REDUCED_GAIN = ("calm+float=0.1:0.3", "tank+float=0.08:0.4")
RECORDED = ("fjord", "coast", "offshore")  # disturbances there resemble an oscillation
SCENARIOS = tuple(row.name for row in TABLE)
OTHER_SCENARIOS = ("sea+float=0.3:0.6,receiver=0:1", *REDUCED_GAIN, "swell+kt=0.5:2,delay=2")


# In a process without the compiler of numba; interpreted code needs numpy records.
INTERPRETED = """
import pickle, sys
import numpy as np
from hil.lab.twin import loop, sailing

assert not hasattr(loop.voyage, "py_func")
zeros, record_of = sailing.zeros, sailing.record_of
sailing.zeros = lambda kind: np.array([zeros(kind)]).view(np.recarray)[0]
sailing.record_of = lambda numbers: np.array([record_of(numbers)]).view(np.recarray)[0]
record, count = sailing.sail(*pickle.load(sys.stdin.buffer))
pickle.dump((tuple(record), count), sys.stdout.buffer)
"""


def replay_monitors(log):
    """Yield evidence and verdicts of the steering monitor after each tick, computed by replay."""
    state = None
    for tick in read_log(log):
        if state is None:
            state, _ = state_from_text(tick.checkpoint)
        state, _ = step(state, tick.inputs)
        loss, reversal = state.supervisor.steering_monitor.loss, state.supervisor.steering_monitor.reversal
        yield loss.boats[0].evidence, loss.lost, reversal.reversed


def count_differences(logged_rows, computed_rows):
    return sum(logged != tuple(computed) for logged, computed in zip(logged_rows, computed_rows, strict=False))


def compare_run(directory, text, seed, goals, seconds, **parameters):
    """Run the autopilot and the twin in a sea; return the largest gain reduction and the number of differences."""
    scenario, goals_of_run = parse_scenario(text), parse_goals(goals)
    options = RunOptions(scenario, seconds, directory, seed=seed, goals=goals_of_run, settings=parameters)
    truth = run(options).truth.table()
    parameter_set, sea = voyage.parameters_with(**parameters), sea_of(scenario, seed, seconds)
    boat, law, task = sailing.boat_of(parameter_set), LawSettings.of(parameter_set), sailing.task_of(goals_of_run)
    record, count = sailing.sail(boat, law, sea, task, seconds)
    twin_truth = sailing.truth_of(record, goals_of_run)
    # truth.csv has nine digits.
    rows = np.char.mod("%.9g", np.stack((twin_truth.heading_low_rad, twin_truth.rudder_rad))).astype(float)
    differences = int(np.sum(rows != np.stack((truth.heading_low_rad, truth.rudder_rad))))
    assert np.array_equal(np.char.mod("%.9g", twin_truth.goal_rad), np.char.mod("%.9g", truth.goal_rad))
    log = next(path for _, path in sorted(log_files(directory / "state" / "logs").items()))
    logged_ticks = [tick for tick in read_log(log) if tick.inputs.tick.t_s <= seconds]
    ticks = [(tick.inputs.tick.t_s, tick.command.shaft_rad) for tick in logged_ticks]
    assert len(ticks) > 9.9 * seconds
    commands = record.ticks[:count, [loop.TICK_S, loop.COMMAND_RAD]]
    differences += count_differences(ticks, commands)
    fixes = [voyage.row_of(sample) for tick in logged_ticks for sample in tick.inputs.positions]
    assert len(fixes) > seconds - 3.0
    rows = voyage.fixes(sea, ticks, seconds)[: len(fixes)]
    differences += len(fixes) - int(np.sum(np.all((rows == fixes) | np.isnan(rows) & np.isnan(fixes), axis=1)))
    monitors = record.ticks[:count, [loop.LOSS_EVIDENCE, loop.LOST, loop.REVERSED]]
    differences += count_differences(replay_monitors(log), monitors)
    return float(record.ticks[:count, loop.GAIN_REDUCTION].max()), differences


OTHER_PARAMETERS = {"CTL_PRICE": 2.0, "MDL_K": 0.04, "MDL_T_S": 5.0, "RUD_SLEW_DEG_S": 20.0, "RUD_DBAND_DEG": 0.5}


@pytest.mark.parametrize(
    ("name", "changes"), [("coast", OTHER_PARAMETERS), pytest.param("ocean-4", {}, marks=pytest.mark.proof)]
)
def test_compiled_loop_equals_the_autopilot_in_mixed_seas(tmp_path, name, changes):
    assert compare_run(tmp_path, name, 1, *SHORT_RUN, **changes) == (1.0, 0)


@pytest.mark.proof
@pytest.mark.parametrize("text", SCENARIOS)
def test_compiled_loop_equals_the_autopilot_in_every_scenario(tmp_path, text):
    assert compare_run(tmp_path, text, 1, *TURNS_TO_BOTH_SIDES)[1] == 0


@pytest.mark.proof
@pytest.mark.parametrize("text", SCENARIOS)
def test_interpreted_and_compiled_loop_agree_in_every_scenario(text):
    parameters, seconds = voyage.parameters_with(), TURNS_TO_BOTH_SIDES[1]
    sea, task = sea_of(parse_scenario(text), 1, seconds), sailing.task_of(parse_goals(TURNS_TO_BOTH_SIDES[0]))
    run_arguments = (sailing.boat_of(parameters), LawSettings.of(parameters), sea, task, seconds)
    compiled, count = sailing.sail(*run_arguments)
    process = subprocess.run(
        [sys.executable, "-c", INTERPRETED],
        input=pickle.dumps(run_arguments),
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"},
        check=False,
        capture_output=True,
    )
    assert process.returncode == 0, process.stderr.decode()
    assert count > 9.9 * seconds
    interpreted = pickle.loads(process.stdout)
    assert interpreted[1] == count
    for compiled_array, interpreted_array in zip(compiled, interpreted[0], strict=True):
        assert compiled_array.tobytes() == interpreted_array.tobytes()


# Mean and longest time [s] until the error is below 5 deg after a turn by 60 deg at the start.
@pytest.mark.parametrize(
    ("name", "mean_s", "max_s"), [("sea", 46.0, 58.0), ("swell", 58.0, 110.0), ("tank", 48.0, 50.0)]
)
def test_first_turn_ends_within_the_time_limits(name, mean_s, max_s):
    values, parameters, goals_of_run = [], voyage.parameters_with(), parse_goals("0:60")
    boat, law, task = sailing.boat_of(parameters), LawSettings.of(parameters), sailing.task_of(goals_of_run)
    for seed in (11, 1, 2, 3, 4, 5):
        record, _ = sailing.sail(boat, law, sea_of(parse_scenario(name), seed, MIN_SCORED_S), task, MIN_SCORED_S)
        values.append(score_of(sailing.truth_of(record, goals_of_run)).near_s)
    assert np.mean(values) <= mean_s
    assert max(values) <= max_s


@pytest.mark.proof
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("text", [*SCENARIOS, *OTHER_SCENARIOS])
@pytest.mark.parametrize("seed", range(1, SEEDS + 1))
def test_compiled_loop_equals_the_autopilot_over_the_whole_task(tmp_path, text, seed):
    gain_reduction, differences = compare_run(tmp_path, text, seed, *TASK)
    assert differences == 0
    assert text in RECORDED or (gain_reduction > 1.0) == (text in REDUCED_GAIN)
