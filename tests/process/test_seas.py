"""The seas of physics.md section 6, through the real autopilot on ptys; figures from the truth alone."""

from dataclasses import replace

import pytest

from firmware_py.control.law import LawSettings
from hil.cli.compare import as_entries
from hil.lab.compare.runs import OURS, Task, compare
from hil.lab.compare.score import mean_of, score_of
from hil.lab.twin import sailing
from hil.lab.twin.sea import sea_of as drawn
from hil.report.figure_file import key_of
from hil.ship import scenarios
from hil.sim.goals import parse_goals
from hil.sim.logbook import RunOptions
from hil.sim.runner import run
from hil.sim.vehicle_file import standard_vehicle
from support import voyage

# What is asked for: rms [deg], rudder travel [deg/h].
MUST = {"tank": (0.22, 500.0), "sea": (1.45, 1500.0), "swell": (3.6, 3500.0), "weak": (1.3, 1450.0)}


@pytest.mark.parametrize(("name", "limits"), [("sea", (1.9, 3000.0))])
def test_waves_move_the_rudder_little(name, limits):
    """One short run of the compiled loop: the limits leave room for chance, the proof below leaves none.

    Before the first turn the speed is not known: the model is at 0.5 m/s where the boat makes 0.9.
    """
    values, goals = voyage.parameters_with(), parse_goals("0:60")
    sea = drawn(scenarios.find_scenario(name), 11, 340.0)
    record, _ = sailing.sail(sailing.boat_of(values), LawSettings.of(values), sea, sailing.task_of(goals), 340.0)
    score = score_of(sailing.truth_of(record, goals))
    assert score.rms_deg <= limits[0]
    assert score.travel_deg_per_h <= limits[1]
    assert score.overshoot_deg <= 8.0
    assert score.near_s <= 48.0


@pytest.mark.proof
@pytest.mark.timeout(3600)
def test_the_task_in_the_four_seas_over_ten_seeds(figures):
    task = Task(tuple(MUST), tuple(range(1, 11)), parse_goals("0:0,120:60,720:-30"), 1320.0)
    sailed = compare(task, [OURS], lambda *_: None)
    figures.merge(as_entries(sailed, figures.source))
    rows = {row.scenario: row for row in sailed}
    for name, row in rows.items():
        mean = row.mean
        print(name, mean)
        # Weak lies at the limit of what compass and receiver tell (docs/explanation/capabilities.md).
        share = 1.1 if name == "weak" else 1.0
        assert mean.rms_deg <= share * MUST[name][0]
        assert mean.travel_deg_per_h <= MUST[name][1]
        assert abs(mean.mean_deg) <= 0.2
    assert rows["tank"].mean.overshoot_deg <= 3.0
    assert rows["sea"].mean.overshoot_deg <= 3.0
    assert rows["swell"].mean.overshoot_deg <= 6.0
    assert rows["tank"].mean.near_s <= 45.0
    assert rows["sea"].mean.near_s <= 30.0


# Seas that nothing was chosen in; seeds far from those above. Name, sea, how K and T of the ship differ, rms limit.
OTHERS = [
    ("fast, short waves", ("sea", 1.2, 2.0, 6.0, -4.0, 2.0, 0.2), 1.0, 1.0, 2.2),
    ("slow, long swell", ("swell", 0.25, 10.0, 15.0, 2.0, 1.0, 0.1), 1.0, 1.0, 4.0),
    ("K high, T low", ("sea", 0.9, 6.0, 4.0, 5.0, 2.0, 0.3), 1.3, 0.7, 1.9),
    ("K low, T high", ("swell", 0.7, 8.0, 20.0, 5.0, 2.0, 0.0), 0.7, 1.3, 3.6),
]


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("name", "sea", "k", "t", "limit_deg"), OTHERS, ids=[row[0] for row in OTHERS])
def test_other_seas_and_other_ships(tmp_path, figures, name, sea, k, t, limit_deg):
    scores = []
    for seed in (501, 502, 503):
        scenario = scenarios.Scenario(sea[0], name, *sea[1:])
        # The autopilot keeps the model of the tank; the ship is another.
        options = RunOptions(
            scenario,
            900.0,
            tmp_path / str(seed),
            seed=seed,
            goals=parse_goals("0:0,120:60,480:-30"),
            vehicle=replace(standard_vehicle(), parameters={"MDL_K": 0.049 * k, "MDL_T_S": 4.0 * t}),
            settings={"MDL_K": 0.049, "MDL_T_S": 4.0},
        )
        scores.append(score_of(run(options).truth.table()))
    mean = mean_of(scores)
    figures.keep(key_of("other seas", name, "rms"), mean.rms_deg, "deg")
    figures.keep(key_of("other seas", name, "travel"), mean.travel_deg_per_h, "deg/h")
    assert mean.rms_deg <= limit_deg
    assert mean.travel_deg_per_h <= 3500.0
    assert abs(mean.mean_deg) <= 0.7
