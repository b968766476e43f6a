"""Summary, page and text of a run that was made by hand."""

import json
import math
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from firmware_py.common.angles import radians
from hil.report import run_page, summary
from hil.report.figures import goal_figures
from hil.report.run_picture import MOST_POINTS, thinned
from hil.report.text import figures_text
from hil.ship import scenarios
from hil.sim.goals import parse_goals
from hil.sim.ground_station import GroundStation
from hil.sim.runner import Run, RunOptions
from hil.sim.truth import COLUMNS, Truth, TruthFile
from hil.sim.world import World


@pytest.fixture
def run(tmp_path):
    goals = parse_goals("0:0,60:30")
    truth = TruthFile(tmp_path / "truth.csv")
    world = World(scenarios.named("tank"), 1, goals, end_s=300.0, truth=truth)
    world.shaft.set_torque(on=True)
    world.advance_to(60.0)
    world.shaft.set_target(radians(20.0))
    world.advance_to(95.0)
    world.shaft.set_target(0.0)
    world.advance_to(300.0)
    options = RunOptions(scenarios.named("tank"), 300.0, tmp_path, goals=goals, settings={"CTL_K1": 30.0})
    orders = GroundStation(goals).orders
    orders[-1].accepted_s = 60.02
    truth.close()
    return Run(options, truth, orders, 3.0)


def test_the_summary_has_what_others_read(run):
    found = summary.summarise(run)
    assert set(found["goals"][1]) >= {
        "overshoot_deg",
        "settling_s",
        "mean_error_deg",
        "rms_error_deg",
        "p95_error_deg",
        "steady_from_s",
    }
    assert found["goals"][1]["accepted_s"] == 60.02
    assert found["goals"][0]["accepted_s"] is None
    assert found["goals"][1]["step_deg"] == pytest.approx(30.0, abs=0.01)
    assert found["speed_ratio"] == 100.0
    assert found["with"] == ""
    assert found["loop"] is None
    assert found["settings"] == {"CTL_K1": 30.0}
    assert found["rudder_travel_deg_per_h"] == 0.0
    assert found["rudder_travel_whole_deg_per_h"] == pytest.approx(40.0 * 12.0, rel=0.01)
    summary.write(found, run.options.out / "summary.json")
    assert json.loads((run.options.out / "summary.json").read_text()) == found


def test_the_page_stands_alone_and_shows_the_figures(run):
    found = summary.summarise(run)
    path = run_page.write(run, found, run.options.out)
    text = path.read_text(encoding="utf-8")
    assert (run.options.out / "run.png").read_bytes().startswith(b"\x89PNG")
    assert "data:image/png;base64," in text
    assert not re.search(r'(src|href)="(?!data:)', text)
    assert "30 deg at 60 s" in text
    assert "CTL_K1" in text


def test_the_text_names_units_and_the_loop(run):
    found = summary.summarise(run)
    found["loop"] = {"ticks": 9, "skipped": 1, "lateness_us": {"p50": 60.0, "max": 200.0}, "note": ""}
    found["goals"][0]["settling_s"] = None
    text = figures_text(found)
    assert "9 ticks, 1 skipped; ticks late by p50 60 us, max 200 us; 100.0 x real time" in text
    assert "never" in text


def test_a_run_without_a_row_of_goals_still_makes_a_page(tmp_path):
    truth = TruthFile(tmp_path / "truth.csv")
    world = World(scenarios.named("calm"), 1, end_s=1.0, truth=truth)
    world.advance_to(1.0)
    truth.close()
    run = Run(RunOptions(scenarios.named("calm"), 1.0, tmp_path), truth, (), 0.0)
    found = summary.summarise(replace(run, wall_s=0.5))
    assert found["goals"] == []
    assert found["rudder_travel_deg_per_h"] is None
    assert run_page.write(run, found, tmp_path).exists()
    assert math.isnan(run.speed_ratio)


@pytest.mark.parametrize("rows", [36_001, 86_401, 864_001])
def test_the_picture_of_a_day_has_few_points_and_every_peak(rows):
    columns = np.random.default_rng(1).normal(size=(len(COLUMNS), rows))
    columns[0] = np.arange(rows) / 10.0
    whole = Truth(*columns)
    pieces = [Truth(*(column[cut : cut + 4096] for column in columns)) for cut in range(0, rows, 4096)]
    few = thinned(pieces, rows)
    assert few.time_s.size <= 1.1 * MOST_POINTS + 2
    assert np.all(np.diff(few.time_s) >= 0.0)
    assert (few.time_s[0], few.time_s[-1]) == (0.0, whole.time_s[-1])
    assert (few.heading_rad.min(), few.heading_rad.max()) == (whole.heading_rad.min(), whole.heading_rad.max())
    assert np.array_equal(thinned((pieces[0],), 4096).heading_rad, pieces[0].heading_rad)


class Days:
    """A truth of any length that is never in memory, of one goal."""

    def __init__(self, rows):
        self.rows = rows

    def __iter__(self):
        chances = np.random.default_rng(1)
        for first in range(0, self.rows, 4096):
            time_s = np.arange(first, min(first + 4096, self.rows)) / 10.0
            noise = chances.normal(size=(len(COLUMNS) - 1, time_s.size))
            noise[5] = 1.0
            yield Truth(time_s, *noise)


@pytest.mark.parametrize("use", [goal_figures, lambda days: thinned(days, days.rows)])
def test_figures_and_picture_of_a_day_take_little_memory(use):
    use(Days(100))
    tracemalloc.start()
    try:
        use(Days(864_001))  # one column of it is 7 MB
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 6e6


def test_what_the_sea_was_sailed_with_is_told(run):
    sea = scenarios.sea_of("tank+float=0.3:0.7,sway")
    run = replace(run, options=replace(run.options, scenario=sea))
    found = summary.summarise(run)
    assert found["with"] == "float=0.3:0.7,sway=1"
    text = run_page.write(run, found, run.options.out).read_text(encoding="utf-8")
    assert "own frequency 0.3 rad/s, damping 0.7" in text
    assert "10 m long; float, sway" in text
