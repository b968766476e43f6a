"""Identification of the K-T model from a log of the autopilot, compared with the simulated ship."""

import json

import pytest

from hil.report.figure_file import entry
from hil.ship import scenarios
from hil.sim.goals import parse_goals
from hil.sim.logbook import RunOptions
from hil.sim.runner import run
from support.harness import rambler_hil

LOG = "state/logs/00000001.BIN"
TRUE_VALUES = {"K": 0.049, "T": 4.0}
UNITS = {"K": "1/s", "T": "s"}


@pytest.mark.proof
@pytest.mark.timeout(300)
def test_zigzag_of_goals_identifies_the_ship(tmp_path, figures):
    goals = ",".join(f"{40 * number}:{30 if number % 2 == 0 else -30}" for number in range(5))
    run(RunOptions(scenarios.find_scenario("tank"), 200.0, tmp_path, goals=parse_goals(goals)))
    code, output, errors = rambler_hil("identify", tmp_path / LOG, "--json", "-")
    assert (code, errors) == (0, "")
    result = json.loads(output)
    assert result["rows"] > 1600
    for name, true_value in TRUE_VALUES.items():
        estimate = result[name]
        assert estimate["verdict"] == "identifiable"
        assert abs(estimate["value"] - true_value) <= 3.0 * estimate["se"], (name, estimate)
        assert abs(estimate["value"] / true_value - 1.0) < 0.25, (name, estimate)
        value = f"{estimate['value']:.3g} +-{estimate['se']:.2g}"
        figures.merge({f"identify_tank_log_{name.lower()}": entry(value, UNITS[name], figures.source)})
    assert result["alpha"]["verdict"] == "not identifiable"


@pytest.mark.proof
@pytest.mark.timeout(300)
def test_log_without_motion_is_refused(tmp_path):
    settings = {"EST_MODE": 0, "CTL_MODE": 0}
    run(RunOptions(scenarios.find_scenario("calm"), 40.0, tmp_path, goals=parse_goals("0:0"), settings=settings))
    code, output, errors = rambler_hil("identify", tmp_path / LOG)
    assert (code, errors.startswith("rambler-hil: no model: ")) == (1, True)
    assert "no effect of the rudder on the motion" in output
    assert "a zigzag" in output
