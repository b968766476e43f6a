from dataclasses import replace

import pytest

from firmware_py.common.parameters import ParameterSet
from hil.lab.campaign.row import MODEL_PARAMETERS, extremes, rows
from hil.sim.vehicle_file import model_of, standard_vehicle
from support.campaign import read


def test_a_row_does_not_depend_on_its_batch():
    spec = read()
    all_rows = list(rows(spec, 0, 8))
    assert [next(rows(spec, index, index + 1)) for index in reversed(range(8))] == all_rows[::-1]
    assert len({row.seed for row in all_rows}) == 8


def test_an_added_draw_does_not_change_the_others():
    fewer, more = read(), read(ship={"K": {"uniform": [0.7, 1.4]}, "speed": [0.8, 1.2], "T": {"uniform": [0.5, 2]}})
    for first, second in zip(rows(fewer, 0, 8), rows(more, 0, 8), strict=True):
        assert first.seed == second.seed
        assert first.drawn_values.items() < second.drawn_values.items()


def test_ship_factors_change_the_simulated_ship_but_not_the_parameters():
    row = next(rows(read(ship={"K": 2.0, "T": 0.5, "alpha": 3.0, "speed": 1.5}), 0, 1))
    base, ship = model_of(standard_vehicle()), model_of(row.vehicle)
    assert ship.turning_ability_1_s == 2.0 * base.turning_ability_1_s
    assert ship.turning_lag_s == 0.5 * base.turning_lag_s
    assert ship.norrbin_s2 == 3.0 * base.norrbin_s2
    defaults = ParameterSet()
    assert {name: row.settings[name] for name in MODEL_PARAMETERS.values()} == {
        name: defaults[name] for name in MODEL_PARAMETERS.values()
    }
    assert row.scenario.speed_m_s == pytest.approx(1.5 * {"tank": 0.4, "swell": 0.7}[row.scenario.name])


def test_options_replace_those_of_the_scenario():
    row = next(rows(read(scenarios="swell+leeway=3,float", **{"with": {"leeway": 7, "delay": 2}}), 0, 1))
    assert row.scenario.disturbances.leeway.body_deg == 7.0
    assert row.scenario.disturbances.float_body is not None
    assert row.scenario.disturbances.delay.delay_s == 2.0


def test_a_fault_has_drawn_times():
    fault = {"what": ["none", "killed"], "at_s": {"uniform": [100, 200]}, "for_s": 20}
    faults = [row.fault for row in rows(read(engine="firmware", fault=fault, **{"with": None}), 0, 40)]
    assert {drawn.name for drawn in faults} == {"none", "killed"}
    assert all(100 <= drawn.at_s <= 200 and drawn.for_s == 20 for drawn in faults)
    assert next(rows(read(), 0, 1)).fault is None


def test_run_options_contain_all_of_a_row(tmp_path):
    row = next(rows(read(set={"CTL_PRICE": 2}), 0, 1))
    options = row.options(tmp_path)
    assert (options.seed, options.scenario, options.goals, options.seconds) == (row.seed, row.scenario, row.goals, 400)
    assert options.settings["CTL_PRICE"] == 2.0
    assert options.vehicle == row.vehicle


def test_extremes_of_every_scenario():
    receivers = [(row.scenario.name, row.scenario.disturbances.receiver.lost) for row in extremes(read())]
    assert receivers == [("tank", 0.02), ("tank", 1.0), ("swell", 0.02), ("swell", 1.0)]
    assert replace(next(extremes(read())), index=0).index == 0
