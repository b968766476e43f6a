"""The compiled closed loop compared with the real autopilot on ptys, and the reproduction of the paper."""

import json

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.lab.tune.cases import COMPASS_NOISE_DEG, autopilot_of, steps_in
from hil.lab.tune.loop_kernel import Task, closed_loop
from hil.lab.tune.trials import FIXED_GAINS, Setting, Trials
from hil.report.figure_file import entry, key_of
from hil.report.figures import rudder_travel_deg_per_h
from hil.ship import scenarios
from hil.sim.goals import parse_goals
from hil.sim.logbook import RunOptions
from hil.sim.runner import run
from support.harness import rambler_hil

SECONDS = 200


@pytest.mark.proof
@pytest.mark.parametrize(("scenario", "tau_s"), [("tank", 1.5), ("swell", 8.0)])
def test_trial_run_matches_the_autopilot_in_the_same_waves(tmp_path, scenario, tau_s):
    """The runs are not equal bit for bit: the noise and the sample phase of the compass differ."""
    sea = scenarios.find_scenario(scenario)
    parameters = ParameterSet().replaced("EST_TAU_S", tau_s)
    settings = {**FIXED_GAINS, "EST_TAU_S": tau_s}
    options = RunOptions(sea, float(SECONDS), tmp_path, goals=parse_goals("0:60"), settings=settings)
    truth = run(options).truth.table()
    ticks = truth.time_s.size
    noise = np.radians(COMPASS_NOISE_DEG) * np.random.default_rng(1).standard_normal(ticks)
    waves = truth.heading_rad - truth.heading_low_rad
    ship = OCEAN_RAMBLER.at_speed(sea.speed_m_s)
    # The rudder bias that explains the true heading: the K-T equation solved for the bias.
    yaw_rate = np.gradient(truth.heading_low_rad, 0.1)
    bias = (
        truth.rudder_rad
        - (np.gradient(yaw_rate, 0.1) * ship.turning_lag_s + yaw_rate + ship.norrbin_s2 * yaw_rate**3)
        / ship.turning_ability_1_s
    )
    smooth_bias = np.convolve(np.pad(bias, 200, mode="edge"), np.ones(401) / 401.0, mode="valid")
    ship_row = np.array([ship.turning_ability_1_s, ship.turning_lag_s, ship.norrbin_s2, steps_in(ship, 0.1)])
    heading, rudder = np.zeros(ticks), np.zeros(ticks)
    setting = Trials.row_of(Setting.of(parameters))
    task = Task(np.radians([60.0]), ticks, 0, 0.1)
    closed_loop(setting, autopilot_of(parameters), task, ship_row, waves + noise, smooth_bias, heading, rudder)
    # The autopilot starts a few ticks later: it first opens its devices and is armed.
    delay_ticks = int(np.argmax(np.abs(truth.rudder_rad) > 0.1)) - int(np.argmax(np.abs(rudder) > 0.1))
    assert 0 <= delay_ticks < 60
    steady = slice(1000, ticks)
    error_deg = np.degrees(heading[steady] - truth.heading_low_rad[steady])
    assert np.sqrt(np.mean(error_deg**2)) < (0.15 if scenario == "tank" else 1.0)
    travel = [rudder_travel_deg_per_h(truth.time_s[steady], angle[steady]) for angle in (rudder, truth.rudder_rad)]
    assert travel[0] == pytest.approx(travel[1], rel=0.15)


@pytest.mark.proof
def test_results_of_the_paper_are_reproduced(tmp_path, figures):
    code, output, errors = rambler_hil("reproduce", "--out", tmp_path)
    assert code == 0, errors
    report = json.loads((tmp_path / "reproduce.json").read_text())
    for row in report["rows"]:
        if row["verdict"] != "silent":
            name = key_of("reproduce", row["quantity"])
            figures.merge({name: entry(row["ours"], "", figures.source, name=row["quantity"], others=row["paper"])})
    assert report["all_match"]
    verdicts = [row["verdict"] for row in report["rows"]]
    assert verdicts.count("matches") >= 16
    assert (tmp_path / "reproduce.html").stat().st_size > 50_000
    assert "MISSES" not in output
