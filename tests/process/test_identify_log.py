"""The autopilot's own log identified: the ship that it sailed is known."""

import json

import pytest

from hil.report.figure_file import entry
from hil.ship import scenarios
from hil.sim.goals import parse_goals
from hil.sim.logbook import RunOptions
from hil.sim.runner import run
from support.harness import rambler_hil

LOG = "state/logs/00000001.BIN"
TRUE = {"K": 0.049, "T": 4.0}
UNITS = {"K": "1/s", "T": "s"}


@pytest.mark.proof
@pytest.mark.timeout(300)
def test_a_zigzag_of_goals_identifies_the_ship(tmp_path, figures):
    goals = ",".join(f"{40 * number}:{30 if number % 2 == 0 else -30}" for number in range(5))
    run(RunOptions(scenarios.find_scenario("tank"), 200.0, tmp_path, goals=parse_goals(goals)))
    code, output, errors = rambler_hil("identify", tmp_path / LOG, "--json", "-")
    assert (code, errors) == (0, "")
    found = json.loads(output)
    assert found["rows"] > 1600
    for name, true in TRUE.items():
        one = found[name]
        assert one["verdict"] == "identifiable"
        assert abs(one["value"] - true) <= 3.0 * one["se"], (name, one)
        assert abs(one["value"] / true - 1.0) < 0.25, (name, one)
        value = f"{one['value']:.3g} +-{one['se']:.2g}"
        figures.merge({f"identify_tank_log_{name.lower()}": entry(value, UNITS[name], figures.source)})
    assert found["alpha"]["verdict"] == "not identifiable"


@pytest.mark.proof
@pytest.mark.timeout(300)
def test_a_log_without_motion_is_refused_as_such(tmp_path):
    run(
        RunOptions(
            scenarios.find_scenario("calm"),
            40.0,
            tmp_path,
            goals=parse_goals("0:0"),
            settings={"EST_MODE": 0, "CTL_MODE": 0},
        )
    )
    code, output, errors = rambler_hil("identify", tmp_path / LOG)
    assert code == 1
    assert errors == "rambler-hil: no model: these logs are as likely without a rudder; see the verdicts\n"
    assert "the rudder explains next to nothing of the motion" in output
    assert "sail a zigzag" in output
