"""The table of scenarios and its listing."""

import json

import pytest

from hil.__main__ import main
from hil.ship import disturbance_options
from hil.ship.scenarios import TABLE, UnknownScenarioError, find_scenario

COLUMNS = ("speed_m_s", "wave_period_s", "wave_yaw_deg", "bias_deg", "drift_deg", "current_m_s")
EXPECTED_VALUES = {
    "calm": (0.4, 0.0, 0.0, 0.0, 0.0, 0.0),
    "tank": (0.4, 2.53, 1.5, 0.0, 0.0, 0.0),
    "sea": (0.9, 6.0, 4.0, 5.0, 2.0, 0.3),
    "swell": (0.7, 8.0, 20.0, 5.0, 2.0, 0.0),
    "weak": (0.2, 4.0, 10.0, 3.0, 2.0, 0.0),
    "storm": (0.5, 7.0, 30.0, 8.0, 4.0, 0.6),
    "mission": (0.5, 6.0, 6.0, 3.0, 2.0, 0.25),
    "gusts": (0.6, 4.0, 6.0, 4.0, 2.0, 0.2),
    "surge": (0.7, 8.0, 20.0, 5.0, 2.0, 0.0),
    "ocean-1": (0.6, 6.0, 15.0, 4.0, 2.0, 0.15),
    "ocean-2": (0.7, 8.0, 20.0, 5.0, 2.0, 0.0),
    "ocean-3": (0.2, 4.0, 10.0, 3.0, 2.0, 0.2),
    "ocean-4": (0.5, 8.0, 20.0, 6.0, 3.0, 0.3),
    "fjord": (0.5, 5.5, 0.5, 3.0, 0.0, 0.1),
    "coast": (0.5, 8.0, 1.1, 3.0, 0.0, 0.15),
    "offshore": (0.5, 8.5, 2.4, 3.0, 0.0, 0.2),
}


def test_table_contains_the_specified_scenarios():
    assert {row.name: tuple(getattr(row, column) for column in COLUMNS) for row in TABLE} == EXPECTED_VALUES


def test_error_of_an_unknown_scenario_lists_the_names():
    with pytest.raises(UnknownScenarioError, match="calm, tank, sea"):
        find_scenario("lake")


def test_scenarios_command_lists_scenarios_and_options(capsys):
    assert main(["scenarios"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in EXPECTED_VALUES)
    assert "ocean-1 has float=0.5:0.6,leeway=3:0:0,receiver=0.5:0.02:10:1:0.05" in text
    assert all(row.source in text for row in disturbance_options.TABLE)
    assert main(["scenarios", "--json"]) == 0
    assert [row["name"] for row in json.loads(capsys.readouterr().out)] == list(EXPECTED_VALUES)
